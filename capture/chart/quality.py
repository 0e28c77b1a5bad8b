"""The verdict on a chart photo: good, or re-shoot, with the reasons and what to do.

Clipping, under-exposure, uneven light, glare, tilt, blur and size, each against a stated limit. The
limits are ours: they are set where the error of a patch mean, or of what follows from it, reaches
about 2 %.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from spectrabox.capture.chart.chart_agreement import (
    MIXED_BANDS,
    PATCH,
    chart_agreement,
    chart_units,
    unit_scale,
    veil_fit,
    white_excess,
)
from spectrabox.capture.chart.detection import homography
from spectrabox.capture.chart.patches import image_from_sensor, patches_and_excluded
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.records.photos import (
    ChartDetection,
    LinearImage,
    PatchSamples,
    PhotoKind,
)

MIN_WHITE_SIGNAL = 0.05          # of full scale: black-level errors are then 1 % of grey patches
MAX_RELATIVE_ERROR = 0.05        # standard error / mean of the black patch in its best band
MAX_UNEVEN = 0.40                # of the light over the chart: a smooth field leaves 2 % of it
MAX_GLARE = 0.03                 # of the white patch: 0.013 at most without glare, 40 cameras
# the same behind a tone curve, which a power undoes badly: greys of seven such photos of charts
# without a visible reflection seem to bear 0.037 to 0.074
MAX_PROCESSED_GLARE = 0.10
MAX_EXCLUDED = 0.10              # of the samples of a patch
MAX_TILT_DEG = 40.0              # beyond it paints are glossy
# of a patch's side, 10 to 90 %: then 0.5 % of the frame's contrast reaches the sampled middle
MAX_BLUR = 0.25
MAX_MEAN_ERROR = 0.02            # of a patch's mean, or of a tenth of the brightest's: best band
PROFILE_POINTS = 61
HALF_EDGE = 15.0                 # of the profile across an outer edge; a patch's side is 40
NO_EDGE = 2                      # darkest neutral patches, that do not stand out from the frame


@dataclass(frozen=True, eq=False)
class ChartVerdict:
    """What an operator should do with this photo, and the figures behind it."""

    verdict: str                     # "good" or "re-shoot"
    reasons: tuple[str, ...]
    samples: PatchSamples
    excluded: np.ndarray             # (I,) share of samples left out as dust or glints
    white_signal: float              # of the white patch in its brightest band, of full scale
    light: np.ndarray                # (I,) as it changes evenly over the chart, mean about 1
    uneven: float                    # largest / smallest light over the chart - 1
    glare: float                     # largest white light added to a patch / white patch's signal
    veil: float                      # the same on all patches alike, not in ``glare``; 0 if small
    tilt_deg: float
    blur: float                      # width of an edge, of the side of a patch
    pixels: int                      # samples of the smallest patch


def judge_chart(image: LinearImage, detection: ChartDetection, reference: np.ndarray,
                chart: Chart = CLASSIC, *, light_explained: bool = False) -> ChartVerdict:
    """Measure the patches and say whether to keep the photo.

    Parameters
    ----------
    image : LinearImage
    detection : ChartDetection
    reference : (I, 3) or (I, K) array
        Signals that an ordinary camera would read, in chart order.
    chart : Chart
    light_explained : bool
        The light over the chart will be compared with that of a scene (``uneven_light_reasons``):
        its fall-off alone is no reason to shoot again.

    Raises
    ------
    CheckError
        If a patch leaves the photo or holds fewer than 16 pixels.
    """
    samples, excluded = patches_and_excluded(image, detection)
    agreement = chart_agreement(image, detection.corners_px, reference, chart)
    uneven = float(agreement.light.max() / agreement.light.min() - 1)
    # A file that went through a tone curve is undone by its power, as well as one number can.
    linear = (samples.mean if image.kind is PhotoKind.RAW
              else np.maximum(samples.mean, 0) ** (1 / agreement.contrast))
    grey = reference.sum(axis=1)
    lightest, darkest = ((chart.neutrals[0], chart.neutrals[-1]) if chart.neutrals
                         else (int(grey.argmax()), int(grey.argmin())))
    veil, glare = 0.0, np.zeros(len(linear))
    if linear.shape[1] == MIXED_BANDS:      # other bands are no mixture of the reference's
        if image.kind is PhotoKind.RAW:
            veil = veil_fit(linear, reference, chart, contrast=1.0)[0]
        veil = veil if veil > MAX_GLARE else 0.0
        glare = white_excess(linear - veil * linear.max(axis=0), reference, agreement.light,
                             lightest)
    white, pixels = float(samples.mean[lightest].max()), int(samples.pixels.min())
    tilt = tilt_deg(detection.corners_px, chart)
    blur, names = edge_width(image, detection.corners_px, chart), chart.names
    # A camera that processes its photos smooths and sharpens: their noise says nothing.
    noise_known = image.kind is not PhotoKind.PROCESSED
    reasons = (*_exposure_reasons(samples, names, white, darkest, noise_known),
               *([] if light_explained else uneven_light_reasons(agreement.light)),
               *_figure_reasons(names, excluded if noise_known else np.zeros(1), glare, veil, tilt,
                                blur, MAX_PROCESSED_GLARE if image.kind is PhotoKind.PROCESSED
                                else MAX_GLARE),
               *(_size_reasons(samples, names) if noise_known else []))
    return ChartVerdict("re-shoot" if reasons else "good", reasons, samples, excluded, white,
                        agreement.light, uneven, float(glare.max()), veil, tilt, blur, pixels)


def tilt_deg(quads_px: np.ndarray, chart: Chart = CLASSIC) -> float:
    """Angle between the card and the sensor in degrees, 0 to 90 (weak perspective).

    Parameters
    ----------
    quads_px : (I, 4, 2) array
        Of the patches, in chart order.
    chart : Chart
    """
    printed = np.column_stack([chart_units(chart), np.ones(len(quads_px))])
    affine = np.linalg.lstsq(printed, quads_px.mean(axis=1), rcond=None)[0][:2]
    longest, shortest = np.linalg.svd(affine, compute_uv=False)
    return float(np.degrees(np.arccos(min(shortest / longest, 1.0))))


def edge_width(image: LinearImage, quads_px: np.ndarray, chart: Chart = CLASSIC) -> float:
    """Median width from 10 to 90 % of the outer edges of patches, in sides of a patch.

    Parameters
    ----------
    image : LinearImage
    quads_px : (I, 4, 2) array
        Of the patches in sensor pixels, in chart order.
    chart : Chart
    """
    quads, centres = image_from_sensor(quads_px, image.sensor_step), chart_units(chart)
    picture_from_chart = homography(centres, quads.mean(axis=1))
    half_sizes = chart.sizes * unit_scale(chart) / 2
    # Across an edge there is nothing but patch and frame as far as the card's frame reaches, or,
    # where that is not known, as much as lies between two patches.
    outer = chart.centres[-1] - chart.centres[0] + (chart.sizes[-1] + chart.sizes[0]) / 2
    frame = float(((chart.card - outer) / 2).min())
    between = float(chart.centres[1, 0] - chart.centres[0, 0] - chart.sizes[0, 0])
    half_edge = min(HALF_EDGE, unit_scale(chart) * max(frame, between))
    grey = image.signal.sum(axis=2, dtype=float)
    widths = []
    for patch, outward in _outer_edges(chart):
        along = np.linspace(-half_edge, half_edge, PROFILE_POINTS)[:, None] * np.array(outward)
        sideways = np.linspace(-8, 8, 9)[:, None] * np.array([outward[1], outward[0]])
        points = centres[patch] + half_sizes[patch] * np.array(outward) + along[:, None] + sideways
        projected = points @ picture_from_chart[:, :2].T + picture_from_chart[:, 2]
        x, y = np.moveaxis(projected[..., :2] / projected[..., 2:], -1, 0)
        width = _rise(map_coordinates(grey, (y, x), order=1, mode="nearest").mean(axis=1))
        if width is not None:
            widths.append(width * 2 * half_edge / (PROFILE_POINTS - 1) / PATCH)
    return float(np.median(widths)) if widths else 1.0


def _outer_edges(chart: Chart) -> list[tuple[int, tuple[float, float]]]:
    """Patches at the outside of a chart and the way out, less those as dark as its frame."""
    patches = np.arange(len(chart.names)).reshape(chart.rows, chart.columns)
    sides = ((patches[0], (0.0, -1.0)), (patches[-1], (0.0, 1.0)), (patches[:, 0], (-1.0, 0.0)),
             (patches[:, -1], (1.0, 0.0)))
    dark = chart.neutrals[-NO_EDGE:] if chart.black_frame else ()
    return [(int(patch), outward) for side, outward in sides for patch in side if patch not in dark]


def _exposure_reasons(samples: PatchSamples, names: tuple[str, ...], white: float,
                      darkest: int, noise_known: bool = True) -> list[str]:
    reasons = []
    clipped = np.flatnonzero(samples.clipped.any(axis=1))
    if clipped.size:
        reasons.append(f"clipping: {clipped.size} of {len(names)} patches are saturated "
                       f"({', '.join(names[i] for i in clipped)}); "
                       "halve the exposure")
    error = np.sqrt(np.diagonal(samples.covariance_of_mean[darkest]))
    relative = float(np.min(error / np.maximum(samples.mean[darkest], np.finfo(float).tiny)))
    if white < MIN_WHITE_SIGNAL:
        reasons.append(f"under-exposure: the white patch reaches {white:.1%} of full scale and "
                       f"{MIN_WHITE_SIGNAL:.0%} "
                       f"is needed; expose {min(0.7 / max(white, 1e-3), 500):.0f} times as long")
    elif noise_known and relative > MAX_RELATIVE_ERROR:
        reasons.append(f"under-exposure: the mean of the black patch is known to {relative:.0%} "
                       f"only and {MAX_RELATIVE_ERROR:.0%} is needed; expose longer or bring the "
                       "chart closer")
    return reasons


def uneven_light_reasons(light: np.ndarray, irradiance: np.ndarray | None = None) -> list[str]:
    """Why the light over the chart asks for another photo, if it does.

    Parameters
    ----------
    light : (I,) array
        On the patches, of a ``ChartVerdict``.
    irradiance : (I,) array, optional
        What a scene with lamp and chart in their places gives each patch: only the rest counts.
    """
    rest = light if irradiance is None else light / irradiance
    uneven = float(rest.max() / rest.min() - 1)
    if uneven <= MAX_UNEVEN:
        return []
    beyond = "" if irradiance is None else ", beyond what the chart scene explains,"
    return [f"uneven light: it changes by {uneven:.0%} over the chart{beyond} and {MAX_UNEVEN:.0%} "
            "is the most; move the lamp away or use two, or photograph a white card in the same "
            "place as flat field"]


def _figure_reasons(names: tuple[str, ...], excluded: np.ndarray, glare: np.ndarray, veil: float,
                    tilt: float, blur: float, max_glare: float) -> list[str]:
    reasons = []
    if veil:
        reasons.append(f"veiling glare of {veil:.0%} of white lies over the whole chart; the fit "
                       "takes it off, but is less certain: shade the lens from the sky and from "
                       "lamps, wipe it, and avoid haze")
    if glare.max() > max_glare:
        shining = np.flatnonzero(glare > max_glare)
        reasons.append(f"glare: white light of up to {glare.max():.1%} of the white patch lies on "
                       f"{', '.join(names[i] for i in shining[np.argsort(-glare[shining])][:4])}; "
                       "turn the chart or the lamp so that it does not mirror the lamp or a window")
    if excluded.max() > MAX_EXCLUDED:
        reasons.append(f"dust or glints: {excluded.max():.0%} of the samples of "
                       f"{names[int(excluded.argmax())]} stand out, {MAX_EXCLUDED:.0%} is the "
                       "most; clean the chart and keep reflections off it")
    if tilt > MAX_TILT_DEG:
        reasons.append(f"tilt: the chart is turned away by {tilt:.0f} degrees and "
                       f"{MAX_TILT_DEG:.0f} is the most; face it to the camera")
    if blur > MAX_BLUR:
        reasons.append(f"blur: edges are {blur:.0%} of a patch wide and {MAX_BLUR:.0%} is the "
                       "most; focus on the chart")
    return reasons


def _size_reasons(samples: PatchSamples, names: tuple[str, ...]) -> list[str]:
    """Whether a patch has too few pixels for their noise."""
    error = samples.standard_error
    relative = (error / np.maximum(samples.mean, samples.mean.max(axis=0) / 10)).min(axis=1)
    worst = int(relative.argmax())
    if relative[worst] <= MAX_MEAN_ERROR:
        return []
    return [f"too small: the mean of {names[worst]} is known to {relative[worst]:.1%} only, from "
            f"{int(samples.pixels[worst])} pixels, and {MAX_MEAN_ERROR:.0%} is needed; bring the "
            "chart closer or expose longer"]


def _rise(profile: np.ndarray) -> float | None:
    """Points from 90 to 10 % of an edge, or None where there is none."""
    fifth = profile.size // 5
    low, high = sorted((float(np.median(profile[:fifth])), float(np.median(profile[-fifth:]))))
    if not high > 2 * max(low, 0.0) or high <= 0:
        return None
    share = (profile - low) / (high - low)
    return float(np.count_nonzero((share > 0.1) & (share < 0.9)))
