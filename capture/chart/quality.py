"""What speaks against a chart photo: one function a rule, each against a stated limit.

Clipping, under-exposure, uneven light, glare, tilt, blur and size. The limits are ours: they are
set where the error of a patch mean, or of what follows from it, reaches about 2 %. A new rule is a
function here that ``judge_chart`` calls, and its text in ``measure.texts``.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import map_coordinates

from spectrabox.capture.chart import chart_agreement
from spectrabox.capture.chart.detection import homography, other_charts
from spectrabox.capture.chart.patches import image_from_sensor, patches_and_excluded
from spectrabox.radiometry import appearance, chart_causes
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.findings import Finding, Severity, faults
from spectrabox.radiometry.records import photos

MIN_WHITE_SIGNAL = 0.05          # of full scale: black-level errors are then 1 % of grey patches
WANTED_WHITE_SIGNAL = 0.7        # of full scale, that a longer exposure is advised for
MAX_TIMES = 500.0                # longer exposure that is advised
MAX_RELATIVE_ERROR = 0.05        # standard error / mean of the black patch in its best band
# of the light over the chart, which a smooth field is fitted to: answers of simulated shoots with
# .4 to .63 are no worse than others; and of what a scene leaves of it, which nothing is fitted to
MAX_UNEVEN, MAX_BEYOND_SCENE = 1.0, 0.40
MAX_GLARE = 0.03                 # of the white patch: 0.013 at most without glare, 40 cameras
# the same behind a tone curve, which a power undoes badly: greys of seven such photos of charts
# without a visible reflection seem to bear 0.037 to 0.074
MAX_PROCESSED_GLARE = 0.10
MAX_EXCLUDED = 0.10              # of the samples of a patch
MAX_TILT_DEG = 40.0              # beyond it paints are glossy
# of a patch's side, 10 to 90 %: then 0.5 % of the frame's contrast reaches the sampled middle
MAX_BLUR = 0.25
MOVED = 2.0                      # times as wide as the others are edges along a movement
MAX_MEAN_ERROR = 0.02            # of a patch's mean, or of a tenth of the brightest's: best band
# of white, that a band of a camera holds of another band of an ordinary one: .09 on average of 40
# cameras under lamps with and without lines, .19 at most (red of green)
MIXING_SD = 0.12
CONVERTED = "file.converted-colours"
PROFILE_POINTS = 61
HALF_EDGE = 15.0                 # of the profile across an outer edge; a patch's side is 40
NO_EDGE = 2                      # darkest neutral patches, that do not stand out from the frame


@dataclass(frozen=True, eq=False)
class ChartVerdict:
    """What was found of a chart photo, and the figures behind it."""

    findings: tuple[Finding, ...]
    samples: photos.PatchSamples
    excluded: np.ndarray             # (I,) share of samples left out as dust or glints
    white_signal: float              # of the white patch in its brightest band, of full scale
    light: np.ndarray                # (I,) as it changes evenly over the chart, mean about 1
    uneven: float                    # largest / smallest light over the chart - 1
    glare: float                     # largest white light added to a patch / white patch's signal
    veil: float                      # the same on all patches alike, not in ``glare``; 0 if small
    tilt_deg: float
    blur: float                      # width of edges that are widest, of the side of a patch
    pixels: int                      # samples of the smallest patch

    @property
    def good(self) -> bool:
        """Whether nothing asks for another photo."""
        return not faults(self.findings)

    @property
    def verdict(self) -> str:
        """"good" or "re-shoot"."""
        return "good" if self.good else "re-shoot"


def judge_chart(image: photos.LinearImage, detection: photos.ChartDetection, reference: np.ndarray,
                chart: Chart = CLASSIC, *, light_explained: bool = False,
                excluded: np.ndarray | None = None) -> ChartVerdict:
    """Measure the patches and say whether to keep the photo.

    Parameters
    ----------
    image : LinearImage
    detection : ChartDetection
    reference : (I, 3) or (I, K) array
        Signals that an ordinary camera would read, in chart order.
    chart : Chart
    light_explained : bool
        The light over the chart will be compared with that of a scene (``uneven_light``): its
        fall-off alone is no reason to shoot again.
    excluded : (I,) bool array, optional
        Patches that the operator leaves out: nothing is found of them.

    Raises
    ------
    CheckError
        If a patch leaves the photo or holds fewer than 16 pixels.
    """
    samples, stand_out = patches_and_excluded(image, detection)
    left_out = np.zeros(len(chart.names), bool) if excluded is None else excluded
    agreement = chart_agreement.chart_agreement(image, detection.corners_px, reference, chart,
                                                left_out)
    uneven = _range(agreement.light)
    # A file that went through a tone curve is undone by its power, as well as one number can.
    linear = (samples.mean if image.kind is photos.PhotoKind.RAW
              else np.maximum(samples.mean, 0) ** (1 / agreement.contrast))
    grey = np.where(left_out, np.nan, reference.sum(axis=1))
    neutrals = [patch for patch in chart.neutrals if not left_out[patch]]
    lightest, darkest = ((neutrals[0], neutrals[-1]) if neutrals
                         else (int(np.nanargmax(grey)), int(np.nanargmin(grey))))
    veil, glare = 0.0, np.zeros(len(linear))
    # other bands are no mixture of the reference's
    if linear.shape[1] == chart_agreement.MIXED_BANDS:
        if image.kind is photos.PhotoKind.RAW:
            veil = chart_agreement.veil_fit(linear, reference, chart, 1.0, left_out)[0]
        veil = veil if veil > MAX_GLARE else 0.0
        glare = chart_agreement.white_excess(linear - veil * linear.max(axis=0), reference,
                                             agreement.light, lightest, left_out)
    shown, white, pixels = (_without(samples, left_out), float(samples.mean[lightest].max()),
                            int(samples.pixels.min()))
    tilt = tilt_deg(detection.corners_px, chart)
    widths, names = edge_widths(image, detection.corners_px, chart), chart.names
    blur = float(widths.max())
    kept_names = [name for name, out in zip(names, left_out, strict=True) if not out]
    processed = image.kind is photos.PhotoKind.PROCESSED
    findings = [*clipped(shown, kept_names), *dark(white),
                *([] if light_explained else uneven_light(agreement.light)), *veiled(veil),
                *glaring(glare, names, MAX_PROCESSED_GLARE if processed else MAX_GLARE),
                *tilted(tilt), *blurred(widths)]
    if not processed:   # a camera that smooths and sharpens its photos: their noise says nothing
        findings += [*black_noisy(samples, darkest, white),
                     *glints(stand_out[~left_out], kept_names), *small(shown, kept_names)]
    if any(one.code == CONVERTED for one in image.findings):    # that is the cause of them all
        findings = [one for one in findings if not chart_causes.claims([one])]
    findings = [*image.findings, *told_apart(findings, samples, reference, chart, left_out)]
    findings += [*others(image, detection, reference, chart), *no_raw_file(image),
                 Finding("chart.figures", Severity.INFO, values={
        "white": white, "uneven": uneven, "glare": float(glare.max()), "tilt_deg": tilt,
        "blur": blur, "pixels": pixels,
        "white_8bit": 255 * float(appearance.encode_srgb(np.array(white))) if processed else None})]
    return ChartVerdict(tuple(findings), samples, stand_out, white, agreement.light, uneven,
                        float(glare.max()), veil, tilt, blur, pixels)


# ---- rules ---------------------------------------------------------------------------------------

def told_apart(findings: Sequence[Finding], samples: photos.PatchSamples, reference: np.ndarray,
               chart: Chart = CLASSIC, excluded: np.ndarray | None = None) -> list[Finding]:
    """Findings, of which those that name a cause stay where the patches exclude its rivals; in
    place of the others comes one with the causes that they do not.

    Parameters
    ----------
    findings : sequence of Finding
    samples : PatchSamples
        As the photo has them, whatever it went through.
    reference : (I, 3) or (I, K) array
        As of ``judge_chart``; in other bands than three findings stay as they are.
    chart : Chart
    excluded : (I,) bool array, optional
        As of ``judge_chart``.
    """
    if samples.mean.shape[1] != chart_agreement.MIXED_BANDS or reference.shape[
            1] != chart_agreement.MIXED_BANDS \
            or not chart_causes.claims(findings):
        return list(findings)
    unread = samples.clipped if excluded is None else samples.clipped | excluded[:, None]
    ranking = chart_causes.ranked(
        np.where(unread, np.nan, samples.mean), reference, samples.standard_error,
        chart_agreement.chart_units(chart), MIXING_SD)
    return chart_causes.settled(findings, ranking, "chart.cause")


def _without(samples: photos.PatchSamples, excluded: np.ndarray) -> photos.PatchSamples:
    """Statistics of the patches that are not left out."""
    kept = ~excluded
    return replace(samples, mean=samples.mean[kept],
                   covariance_of_mean=samples.covariance_of_mean[kept],
                   pixels=samples.pixels[kept],
                   saturated_fraction=samples.saturated_fraction[kept],
                   gradient=samples.gradient[kept])


def others(image: photos.LinearImage, detection: photos.ChartDetection, reference: np.ndarray,
           chart: Chart) -> list[Finding]:
    """Further charts in view, or cards much like one.

    Parameters
    ----------
    image : LinearImage
    detection : ChartDetection
    reference, chart
        As of ``judge_chart``.
    """
    centres = other_charts(image, detection, reference, chart)
    return [Finding("chart.another", Severity.NOTE, values={
        "charts": len(centres), "centres_px": [centre.tolist() for centre in centres]})] \
        if centres else []


def clipped(samples: photos.PatchSamples, names: Sequence[str]) -> list[Finding]:
    """Saturated patches.

    Parameters
    ----------
    samples : PatchSamples
    names : sequence of I str
        Of the patches.
    """
    patches = np.flatnonzero(samples.clipped.any(axis=1)).tolist()
    return [Finding("chart.clipped", Severity.WARN, values={
        "names": [names[patch] for patch in patches], "clipped": len(patches),
        "patches": len(names)})] if patches else []


def dark(white: float) -> list[Finding]:
    """A white patch that is too dark against errors of the black level.

    Parameters
    ----------
    white : float
        Signal of the white patch in its brightest band, of full scale.
    """
    if white >= MIN_WHITE_SIGNAL:
        return []
    return [Finding("chart.dark", Severity.WARN, values={
        "white": white, "least": MIN_WHITE_SIGNAL,
        "times": min(WANTED_WHITE_SIGNAL / max(white, 1e-3), MAX_TIMES)})]


def black_noisy(samples: photos.PatchSamples, darkest: int, white: float) -> list[Finding]:
    """A black patch whose mean is lost in noise, of a photo that is not dark as a whole.

    Parameters
    ----------
    samples : PatchSamples
    darkest : int
        Index of the black patch.
    white : float
        As of ``dark``.
    """
    mean = np.maximum(samples.mean[darkest], np.finfo(float).tiny)
    relative = float((samples.standard_error[darkest] / mean).min())
    if relative <= MAX_RELATIVE_ERROR or white < MIN_WHITE_SIGNAL:
        return []
    return [Finding("chart.black-noisy", Severity.WARN, values={
        "relative_error": relative, "limit": MAX_RELATIVE_ERROR})]


def uneven_light(light: np.ndarray, irradiance: np.ndarray | None = None,
                 photo: str = "") -> list[Finding]:
    """Light that changes too much over the chart.

    Parameters
    ----------
    light : (I,) array
        On the patches, of a ``ChartVerdict``.
    irradiance : (I,) array, optional
        What a scene with lamp and chart in their places gives each patch: only the rest counts.
    photo : str
        Its name, where it is not clear by itself.
    """
    uneven = _range(light if irradiance is None else light / irradiance)
    code, limit = ("chart.uneven-light", MAX_UNEVEN) if irradiance is None \
        else ("chart.uneven-beyond-scene", MAX_BEYOND_SCENE)
    if uneven <= limit:
        return []
    return [Finding(code, Severity.WARN, photo, {"uneven": uneven, "limit": limit})]


def veiled(veil: float) -> list[Finding]:
    """Veiling glare over the whole chart.

    Parameters
    ----------
    veil : float
        Of the white patch; 0 if small.
    """
    return [Finding("chart.veiled", Severity.WARN, values={"veil": veil, "limit": MAX_GLARE})] \
        if veil else []


def glaring(glare: np.ndarray, names: Sequence[str], limit: float) -> list[Finding]:
    """Patches that mirror a lamp or a window.

    Parameters
    ----------
    glare : (I,) array
        White light on each patch, of the white patch's signal.
    names : sequence of I str
    limit : float
    """
    patches = [patch for patch in np.argsort(-glare).tolist() if glare[patch] > limit]
    return [Finding("chart.glare", Severity.WARN, values={
        "glare": float(glare.max()), "names": [names[patch] for patch in patches],
        "limit": limit})] if patches else []


def glints(excluded: np.ndarray, names: Sequence[str]) -> list[Finding]:
    """A patch with dust or glints.

    Parameters
    ----------
    excluded : (I,) array
        Share of each patch's samples that stand out.
    names : sequence of I str
    """
    most = int(excluded.argmax())
    return [Finding("chart.glints", Severity.WARN, values={
        "excluded": float(excluded[most]), "patch": names[most], "limit": MAX_EXCLUDED})] \
        if excluded[most] > MAX_EXCLUDED else []


def tilted(tilt: float) -> list[Finding]:
    """A chart that is turned away from the camera.

    Parameters
    ----------
    tilt : float
        Between card and sensor in degrees.
    """
    return [Finding("chart.tilted", Severity.WARN, values={
        "tilt_deg": tilt, "limit_deg": MAX_TILT_DEG})] if tilt > MAX_TILT_DEG else []


def blurred(widths: np.ndarray) -> list[Finding]:
    """Edges of patches that are too wide: out of focus where they are so in both directions, moved
    where they are in one.

    Parameters
    ----------
    widths : (2,) array
        Of edges above and below the chart, and of those at its sides, of the side of a patch.
    """
    blur, other = float(widths.max()), float(widths.min())
    if blur <= MAX_BLUR:
        return []
    if blur <= MOVED * other:
        return [Finding("chart.blurred", Severity.WARN, values={"blur": blur, "limit": MAX_BLUR})]
    return [Finding("chart.moved", Severity.WARN, values={
        "blur": blur, "other": other, "along": ("columns", "rows")[int(widths.argmax())],
        "limit": MAX_BLUR})]


def small(samples: photos.PatchSamples, names: Sequence[str]) -> list[Finding]:
    """A patch that has too few pixels for their noise.

    Parameters
    ----------
    samples : PatchSamples
    names : sequence of I str
    """
    error = samples.standard_error
    relative = (error / np.maximum(samples.mean, samples.mean.max(axis=0) / 10)).min(axis=1)
    worst = int(relative.argmax())
    if relative[worst] <= MAX_MEAN_ERROR:
        return []
    return [Finding("chart.small", Severity.WARN, values={
        "patch": names[worst], "relative_error": float(relative[worst]),
        "pixels": int(samples.pixels[worst]), "limit": MAX_MEAN_ERROR})]


def no_raw_file(image: photos.LinearImage) -> list[Finding]:
    """A photo that is no camera raw.

    Parameters
    ----------
    image : LinearImage
    """
    if image.kind is photos.PhotoKind.RAW:
        return []
    return [Finding("chart.processed-photo" if image.kind is photos.PhotoKind.PROCESSED
                    else "chart.image-file", Severity.NOTE)]


# ---- figures -------------------------------------------------------------------------------------

def tilt_deg(quads_px: np.ndarray, chart: Chart = CLASSIC) -> float:
    """Angle between the card and the sensor in degrees, 0 to 90 (weak perspective).

    Parameters
    ----------
    quads_px : (I, 4, 2) array
        Of the patches, in chart order.
    chart : Chart
    """
    printed = np.column_stack([chart_agreement.chart_units(chart), np.ones(len(quads_px))])
    affine = np.linalg.lstsq(printed, quads_px.mean(axis=1), rcond=None)[0][:2]
    longest, shortest = np.linalg.svd(affine, compute_uv=False)
    return float(np.degrees(np.arccos(min(shortest / longest, 1.0))))


def edge_widths(image: photos.LinearImage, quads_px: np.ndarray,
                chart: Chart = CLASSIC) -> np.ndarray:
    """Median width from 10 to 90 % of the outer edges of patches, in sides of a patch.

    Parameters
    ----------
    image : LinearImage
    quads_px : (I, 4, 2) array
        Of the patches in sensor pixels, in chart order.
    chart : Chart

    Returns
    -------
    (2,) array
        Of edges above and below the chart, and of those at its sides; of both where one has none,
        and 1 where no edge is seen.
    """
    quads, centres = image_from_sensor(quads_px,
                                       image.sensor_step), chart_agreement.chart_units(chart)
    picture_from_chart = homography(centres, quads.mean(axis=1))
    half_sizes = chart.sizes * chart_agreement.unit_scale(chart) / 2
    # Across an edge there is nothing but patch and frame as far as the card's frame reaches, or,
    # where that is not known, as much as lies between two patches.
    outer = chart.centres[-1] - chart.centres[0] + (chart.sizes[-1] + chart.sizes[0]) / 2
    frame = float(((chart.card - outer) / 2).min())
    between = float(chart.centres[1, 0] - chart.centres[0, 0] - chart.sizes[0, 0])
    half_edge = min(HALF_EDGE, chart_agreement.unit_scale(chart) * max(frame, between))
    grey = image.signal.sum(axis=2, dtype=float)
    widths: tuple[list[float], list[float]] = ([], [])
    for patch, outward in _outer_edges(chart):
        along = np.linspace(-half_edge, half_edge, PROFILE_POINTS)[:, None] * np.array(outward)
        sideways = np.linspace(-8, 8, 9)[:, None] * np.array([outward[1], outward[0]])
        points = centres[patch] + half_sizes[patch] * np.array(outward) + along[:, None] + sideways
        projected = points @ picture_from_chart[:, :2].T + picture_from_chart[:, 2]
        x, y = np.moveaxis(projected[..., :2] / projected[..., 2:], -1, 0)
        width = _rise(map_coordinates(grey, (y, x), order=1, mode="nearest").mean(axis=1))
        if width is not None:
            width *= 2 * half_edge / (PROFILE_POINTS - 1) / chart_agreement.PATCH
            widths[int(outward[0] != 0)].append(width)
    every = [*widths[0], *widths[1]] or [1.0]
    return np.array([np.median(some or every) for some in widths])


def _outer_edges(chart: Chart) -> list[tuple[int, tuple[float, float]]]:
    """Patches at the outside of a chart and the way out, less those as dark as its frame."""
    patches = np.arange(len(chart.names)).reshape(chart.rows, chart.columns)
    sides = ((patches[0], (0.0, -1.0)), (patches[-1], (0.0, 1.0)), (patches[:, 0], (-1.0, 0.0)),
             (patches[:, -1], (1.0, 0.0)))
    dark = chart.neutrals[-NO_EDGE:] if chart.black_frame else ()
    return [(int(patch), outward) for side, outward in sides for patch in side if patch not in dark]


def _range(light: np.ndarray) -> float:
    """Largest / smallest - 1."""
    return float(light.max() / light.min() - 1)


def _rise(profile: np.ndarray) -> float | None:
    """Points from 90 to 10 % of an edge, or None where there is none."""
    fifth = profile.size // 5
    low, high = sorted((float(np.median(profile[:fifth])), float(np.median(profile[-fifth:]))))
    if not high > 2 * max(low, 0.0) or high <= 0:
        return None
    share = (profile - low) / (high - low)
    return float(np.count_nonzero((share > 0.1) & (share < 0.9)))
