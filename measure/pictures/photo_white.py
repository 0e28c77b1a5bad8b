"""What a perfect white would read on every pixel, also by surfaces that serve as references.

Light on a picture as its surfaces of known reflectance show it: scale, and disagreement.

The materials of the other surfaces may be painted with patterns, so that only the known ones tell
light from reflectance. They are compared under the light that the picture's own spectra give.
"""


from __future__ import annotations

import numpy as np

from spectrabox.calibrate import chart_equations, chart_findings
from spectrabox.measure import texts
from spectrabox.measure.camera import chart_signals
from spectrabox.measure.pictures.traced_photo import TracedPhoto
from spectrabox.measure.steps import chart_fit
from spectrabox.radiometry import chart, errors, findings, grid, light_scale
from spectrabox.radiometry.charts.references import reference_reflectances
from spectrabox.radiometry.records import calibration, photos, scenes
from spectrabox.reconstruct.agreement import SCALE_ERROR, surface_covariance

MIN_NODES = 8   # of a surface that is compared


def compare_reference_surfaces(scene: TracedPhoto, light: np.ndarray,
                               even: np.ndarray) -> tuple[calibration.LightScale, np.ndarray]:
    """Compare the surfaces of known reflectance with the light on them.

    Parameters
    ----------
    scene : TracedPhoto
    light : (N, P) array
        At the nodes, for a light scale of 1.
    even : (N,) bool array
        Nodes where light does not change too quickly to be compared.

    Returns
    -------
    scale : LightScale
        Of the photo.
    covariance : (K, K) array
        Relative, by which photo and light disagree.
    """
    view = scene.view
    measured, variance = scene.node_signals
    weights = view.sensitivities * view.grid.weights_nm
    materials_by_name = {material.name: material for material in view.scene_materials}
    rows = []
    for number, name in enumerate(view.scene_file.surfaces):
        material = materials_by_name[view.surface_materials[number]]
        own = np.flatnonzero((scene.nodes.keys[0] == number) & even & scene.compared)
        if material.reflectance is None or own.size < MIN_NODES:
            continue
        predicted = light[own] * material.reflectance @ weights.T
        if not np.all(predicted > 0) or not np.all(measured[own] > 0):
            continue
        logs = np.log(measured[own] / predicted)
        noise = np.mean(variance[own] / measured[own]**2, axis=0) \
            + np.mean(scene.relative_variance[own])
        rows.append((f"{material.name} / {name}", material.name, own.size,
                     measured[own].sum(axis=0), predicted.sum(axis=0),
                     np.sqrt(np.maximum(logs.var(axis=0) - noise, 0.0))))
    scale, bands = scene.joint.views[0].light_scale, measured.shape[1]
    # the light is that of the scene as stated: the scale of another says nothing of it
    estimated = any(one.code == "scene.estimated" for one in scene.joint.views[0].findings)
    if estimated and view.light_scale is not None:
        scale = view.light_scale
    if not rows:
        return scale, scene.disagreement**2 * (np.eye(bands) + 1) / 2
    names, materials, pixels, photo, model, spread = zip(*rows, strict=True)
    if estimated or view.light_scale is None:
        scale = light_scale.scale_from_signals(np.array(photo), np.array(model), SCALE_ERROR,
                                               scale.source)
    agreement = scenes.SurfaceAgreement(names, materials, np.array(pixels),
                                        np.array(photo) / (scale.value * np.array(model)),
                                        np.array(spread))
    within = np.einsum("sk,sl->kl", agreement.spread, agreement.spread) / len(rows)
    return scale, surface_covariance(agreement, frozenset(materials), scene.disagreement) + within


# ---- photo white ---------------------------------------------------------------------------------

DARK_SHARE = 0.02       # of the brightest patch in a band, below which noise is most of a signal


def white_of_chart(photo: photos.LinearImage,
                   relative_response: np.ndarray) -> tuple[np.ndarray, findings.Finding]:
    """What a perfect white in the chart's place reads (K,), and whether camera and light as stated
    explain the chart.

    White is from the lightest patch of no colour that is not clipped, and its usual reflectance.
    How the light changes from there over the photo is not seen.

    Parameters
    ----------
    photo : LinearImage
    relative_response : (K, 301) array
        On FINE_GRID; rows sum to 1.

    Raises
    ------
    ChartNotFoundError, CheckError, ClippedPhotoError
        As ``chart_fit.find_patches``.
    """
    reflectances = reference_reflectances(None, chart.CLASSIC, grid.FINE_GRID)
    _, samples = chart_fit.find_patches(photo, chart_signals(chart.CLASSIC, reflectances,
                                                             grid.FINE_GRID),
                                        chart.CLASSIC)
    lightest = next(patch for patch in chart.CLASSIC.neutrals if not samples.clipped[patch].any())
    predicted = reflectances @ relative_response.T
    residual = chart_residual(samples.mean, predicted, ~samples.clipped)
    passes, fails = chart_findings.chart_limits(stated=False)
    severity = findings.graded(residual, passes, fails)
    finding = findings.Finding("white.camera-explains-chart" if severity is findings.Severity.INFO
                               else "white.camera-unlike-chart", severity,
                               values={"value": residual, "passes": passes, "fails": fails})
    return np.asarray(samples.mean[lightest] / predicted[lightest]), finding


def chart_residual(signal: np.ndarray, predicted: np.ndarray, used: np.ndarray) -> float:
    """How far the patches of a ColorChecker are from a prediction, rms of (photo - predicted) /
    photo, with the gain of each band and a smooth field of light over the chart left free.

    Parameters
    ----------
    signal, predicted : (I, K) arrays
        The prediction in any unit.
    used : (I, K) bool array
        What is not clipped.
    """
    used = used & (signal > DARK_SHARE * signal.max(axis=0)) & (predicted > 0)
    patches, bands = np.nonzero(used)
    terms = np.column_stack([np.eye(signal.shape[1])[bands],
                             chart_equations.field_terms(chart.CLASSIC.centres_uv)[patches]])
    ratio = signal[used] / predicted[used]
    fitted = np.exp(terms @ np.linalg.lstsq(terms, np.log(ratio), rcond=None)[0])
    return float(np.sqrt(np.mean((1 - fitted / ratio) ** 2)))


def photo_white(photo: photos.LinearImage, relative_response: np.ndarray,
                remedy: str) -> tuple[np.ndarray, findings.Finding] | None:
    """The same, or None of a photo without a chart whose values may be shares of white already.

    Parameters
    ----------
    photo : LinearImage
    relative_response : (K, 301) array
    remedy : str
        How white is stated, for the error.

    Raises
    ------
    InputError
        If no chart tells the white of a camera's raw photo, whose values are shares of what its
        sensor can hold; or the photo is decoded from sRGB, whose values are no camera's.
    CheckError
        If camera and light contradict the chart.
    """
    require_camera_signal(photo.kind, photo.source)
    try:
        white, finding = white_of_chart(photo, relative_response)
    except (errors.ChartNotFoundError, errors.CheckError) as error:
        if photo.kind is not photos.PhotoKind.RAW:
            return None
        raise errors.InputError(
            f"{photo.source} is a raw photo: its values are shares of what the sensor "
            "can hold and not of white, and no chart in it tells what white reads "
            f"({str(error).partition(';')[0]}). {remedy}") from None
    if finding.severity is findings.Severity.FAIL:
        raise errors.CheckError(f"{photo.source}: {texts.says(finding)}")
    return white, finding


def require_camera_signal(kind: photos.PhotoKind, source: str) -> None:
    """Refuse a photo that was decoded from sRGB, whose values are no camera's.

    Parameters
    ----------
    kind : PhotoKind
    source : str
        Of the photo, for the error.

    Raises
    ------
    InputError
    """
    if kind is photos.PhotoKind.PROCESSED:
        raise errors.InputError(f"{source} was decoded from sRGB: its values are what a camera's "
                         "processing made for a screen, and no camera saw them. Take its colours "
                         "as they are, from the file itself (--encoded, encoded=True)")
