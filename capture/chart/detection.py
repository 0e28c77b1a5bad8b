"""A chart detected in a photo, and how well it agrees (OpenCV's ``mcc`` module).

OpenCV proposes where the patches of a ColorChecker lie; of other charts the operator gives four
corners. The proposal is fitted to the outlines of the patches and accepted only if the signals
agree with those of the chart (chart_agreement.py), each patch for itself, and on the Classic the
gaps between patches are as wide as on the card.
"""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np

from spectrabox.capture.chart import chart_agreement
from spectrabox.capture.chart.patches import image_from_sensor, sensor_from_image
from spectrabox.capture.photo.preview import signal_rgb8
from spectrabox.radiometry import chart as charts
from spectrabox.radiometry import errors
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records import photos

QUAD_SHARE = 0.6                         # of a patch's side that is sampled
PICTURE_SIDES = (1600, 1000, 2400)       # px, long side of the picture searched, in this order
REGION_SHARE = 0.55                      # of the picture's sides, for a search of its parts
MAX_MAGNIFIED = 2.0                      # more only blurs
MIN_WIDTH_WORDS = "tenth"                # of the frame, that a chart fills: smaller ones are missed
# as commands call it, and session.toml
CORNERS = "--corners X,Y,X,Y,X,Y,X,Y (corners_px of [chart] in session.toml)"
ACCEPTED_CONTRAST = (0.6, 1.9)           # power of the light; sRGB taken as linear has 0.5
CONFIDENCE_SCALE = 0.25                  # confidence = exp(-residual / 0.25)
# Lengths are in units of which a patch's side is 40: mm on the large card.
RECTIFIED_PX_PER_UNIT, RECTIFIED_BORDER = 2.0, 20.0
SAME_PATCH_CODES = 10                    # sRGB code values, for what belongs to one patch
# Distance between patches / distance of their centres: 0.08 on the large card, 0.2 on the small
# ones; cards of other makers with the same colours have 0.02.
MIN_GAP = 0.05
GAP_PX_PER_UNIT, GAP_STRIP = 3.0, 12.0   # sampling of the strip that joins two patches
MIN_GAP_DEPTH = 15                       # sRGB code values by which a gap is darker than patches
# of the brightest band, below which the light has no power in a band: the warmest lamps leave blue
# 0.05
DARK_BAND = 0.02
BRIGHT_PERCENTILE = 99
PAINTED_OVER = 1.15                      # of the sampled patches' extent: the whole card
MIN_GAPS = 6                             # of 38
MIN_OUTLINED = 0.5                       # of the patches, to fit a chart to their outlines
OVERLAY_SIDE = 1400                      # px, what a report shows
KINDS = {(4, 6): cv2.mcc.MCC24, (10, 14): cv2.mcc.SG140}     # rows and columns that OpenCV knows


def find_chart(image: photos.LinearImage, reference: np.ndarray,
               corners_px: np.ndarray | None = None, chart: charts.Chart = charts.CLASSIC,
               excluded: np.ndarray | None = None) -> photos.ChartDetection:
    """The chart's patches, detected or checked at the corners that the operator gave.

    Parameters
    ----------
    image : LinearImage
    reference : (I, 3) or (I, K) array
        Signals that an ordinary camera would read, in any unit, in chart order.
    corners_px : (4, 2) array or None
        The chart's fiducials in sensor pixels: of the Classic the outer corners of the patch grid
        at dark skin, bluish green, black and white; None to search the photo.
    chart : Chart
    excluded : (I,) bool array, optional
        Patches that the operator leaves out, which need not look like the chart's.

    Raises
    ------
    ChartNotFoundError
        If no chart is detected, or the patches at the given corners do not look like one.
    CheckError
        If the photo shows the chart mirrored, its values are not proportional to light, or the
        reference lists the patches in another order.
    """
    detection = locate_chart(image, reference, corners_px, chart, excluded)
    if detection.mirrored:
        raise errors.CheckError(
            f"photo {image.source} shows the chart mirrored; give the photo as the "
            "camera took it, without flipping or a mirror in the light path")
    return detection


def locate_chart(image: photos.LinearImage, reference: np.ndarray,
                 corners_px: np.ndarray | None = None, chart: charts.Chart = charts.CLASSIC,
                 excluded: np.ndarray | None = None) -> photos.ChartDetection:
    """As ``find_chart``, but a mirrored chart is returned and marked.

    Parameters
    ----------
    image, reference, corners_px, chart, excluded
        As in ``find_chart``.

    Raises
    ------
    ChartNotFoundError, CheckError, InputError
    """
    patches, bands = len(chart.names), image.signal.shape[2]
    if reference.shape not in ((patches, chart_agreement.MIXED_BANDS), (patches, bands)):
        raise errors.InputError(
            f"photo {image.source} has {bands} bands and the chart reference is "
            f"{reference.shape}; signals of red, green and blue, or of each band, are "
            "needed for each patch")
    best = np.inf
    refusal: errors.CheckError | None = None
    reading: str | None = None
    picture = signal_rgb8(image.signal)
    for quads_px, how_found in _proposals(image, picture, corners_px, chart):
        agreement = chart_agreement.chart_agreement(image, quads_px, reference, chart, excluded)
        best = min(best, agreement.residual)
        if agreement.residual <= chart_agreement.ACCEPTED_RESIDUAL:
            ordered = quads_px[agreement.order]
            try:
                _require_chart(image, agreement, chart, by_hand=corners_px is not None)
                if chart.black_frame:
                    _require_gaps(image, picture, ordered, chart)
            except errors.CheckError as error:  # the next proposal may fit the patches better
                refusal = refusal or error
                continue
            # mirrored: the way along the first row and down the last column turns left, y down
            corners = charts.corner_patches(chart.rows, chart.columns)[:3]
            start, turn, end = (ordered[patch].mean(axis=0) for patch in corners)
            return photos.ChartDetection(corners_px=ordered,
                                  confidence=float(np.exp(-agreement.residual / CONFIDENCE_SCALE)),
                                  mirrored=bool(np.linalg.det([turn - start, end - turn]) < 0),
                                  how_found=how_found)
        neutral = None if refusal else chart_agreement.wrong_neutral(
            image, quads_px, reference, chart, chart_agreement.ACCEPTED_RESIDUAL, excluded)
        if neutral is not None:
            refusal = _one_neutral(image, *neutral, chart)
        elif corners_px is not None and not chart.has_known_colours:
            reading = reading or chart_agreement.reading_of_reference(
                image, quads_px, reference, chart, chart_agreement.ACCEPTED_RESIDUAL)
    if refusal is not None:
        raise refusal
    if reading is not None:
        raise errors.CheckError(_other_order(image, chart, reading))
    raise errors.ChartNotFoundError(_not_found(image, best, chart, by_hand=corners_px is not None))


def find_chart_again(image: photos.LinearImage, reference: np.ndarray,
                     before: photos.ChartDetection, chart: charts.Chart = charts.CLASSIC,
                     excluded: np.ndarray | None = None) -> photos.ChartDetection:
    """The chart in a photo through a filter or under odd light, from the same tripod as another:
    in the same position, which the bands that are bright confirm; else searched for.

    Parameters
    ----------
    image : LinearImage
    reference : (I, 3) or (I, K) array
        Signals that an ordinary camera would read there, in chart order.
    before : ChartDetection
        In the other photo, in the pixels of this one.
    chart : Chart
    excluded : (I,) bool array, optional
        As of ``find_chart``.

    Raises
    ------
    ChartNotFoundError, CheckError
        If there is no chart.
    """
    brightest = np.percentile(image.signal, BRIGHT_PERCENTILE, axis=(0, 1))
    bright = brightest >= DARK_BAND * brightest.max()
    seen = replace(image, signal=image.signal[..., bright], variance=image.variance[..., bright],
                   saturated=image.saturated[..., bright])
    agreement = chart_agreement.chart_agreement(seen, before.corners_px, reference[:, bright]
                                                if len(bright) == reference.shape[1] else reference,
                                                chart, excluded)
    if agreement.residual <= chart_agreement.ACCEPTED_RESIDUAL and np.array_equal(
            agreement.order, np.arange(len(chart.names))):
        return replace(before, confidence=float(np.exp(-agreement.residual / CONFIDENCE_SCALE)),
                       how_found=Finding("chart.found-in-same-place", Severity.INFO))
    return find_chart(image, reference, None, chart, excluded)


def chart_overlay(image: photos.LinearImage, detection: photos.ChartDetection) -> np.ndarray:
    """Picture (H, W, 3) uint8 of the photo with the I sampled quadrilaterals, numbered from 1.

    Parameters
    ----------
    image : LinearImage
    detection : ChartDetection
    """
    picture, scale = _resized(signal_rgb8(image.signal), OVERLAY_SIDE)
    picture = np.ascontiguousarray(picture)
    quads = (image_from_sensor(detection.corners_px, image.sensor_step) + 0.5) * scale - 0.5
    size = float(np.linalg.norm(quads[0, 1] - quads[0, 0]))
    for number, quad in enumerate(quads, start=1):
        outline = np.rint(quad).astype(np.int32)[None]
        cv2.polylines(picture, outline, True, (0, 0, 0), 3, cv2.LINE_AA)
        cv2.polylines(picture, outline, True, (255, 255, 255), 1, cv2.LINE_AA)
        origin = tuple(int(value)
                       for value in np.rint(quad.mean(axis=0) + np.array([-0.3, 0.2]) * size))
        for colour, thickness in (((0, 0, 0), 3), ((255, 255, 255), 1)):
            cv2.putText(picture, str(number), origin, cv2.FONT_HERSHEY_SIMPLEX, max(size / 60, 0.3),
                        colour, thickness, cv2.LINE_AA)
    return picture


def other_charts(image: photos.LinearImage, detection: photos.ChartDetection,
                 reference: np.ndarray, chart: charts.Chart = charts.CLASSIC) -> list[np.ndarray]:
    """Centres (2,) in sensor pixels of further charts in a photo, or cards much like one.

    Parameters
    ----------
    image : LinearImage
    detection : ChartDetection
        Of the one that is measured, which is painted over.
    reference, chart
        As of ``find_chart``.
    """
    if not chart.detectable:
        return []
    picture, scale = _resized(signal_rgb8(image.signal), PICTURE_SIDES[0])
    picture = np.ascontiguousarray(picture)
    corners = (image_from_sensor(detection.corners_px, image.sensor_step) + 0.5) * scale - 0.5
    middle = corners.mean(axis=(0, 1))
    outline = cv2.convexHull(np.rint(middle + PAINTED_OVER * (corners - middle)).astype(
        np.int32).reshape(-1, 1, 2))
    cv2.fillConvexPoly(picture, outline, (0, 0, 0))
    found: list[np.ndarray] = []
    for proposed in _mcc_quads(picture, chart):
        quads = sensor_from_image((_fitted_quads(picture, proposed, chart) + 0.5) / scale - 0.5,
                                  image.sensor_step)
        if chart_agreement.chart_agreement(image, quads, reference,
                                           chart).residual < chart_agreement.HOPELESS_RESIDUAL:
            found.append(quads.mean(axis=(0, 1)))
    return found


# ---- proposals -----------------------------------------------------------------------------------

def _proposals(image: photos.LinearImage, picture: np.ndarray, corners_px: np.ndarray | None,
               chart: charts.Chart) -> Iterator[tuple[np.ndarray, Finding]]:
    """Quadrilaterals (I, 4, 2) in sensor pixels and where they are from, the likeliest first."""
    if corners_px is not None:
        given = homography(chart_agreement.chart_units(chart, chart.fiducials),
                           np.asarray(corners_px, float))
        yield _printed_quads(given, chart), Finding("chart.corners-given", Severity.INFO)
        return
    if not chart.detectable:
        return
    for window, side, how_found in _windows(*picture.shape[:2]):
        part, scale = _resized(picture[window], side)
        for quads in _mcc_quads(part, chart):
            offset = np.array([window[1].start, window[0].start])
            fitted = (_fitted_quads(part, quads, chart) + 0.5) / scale - 0.5 + offset
            yield sensor_from_image(fitted, image.sensor_step), how_found


def _windows(height: int, width: int) -> Iterator[tuple[tuple[slice, slice], int, Finding]]:
    """Parts of the picture to search, and the long side in pixels to search them at."""
    longest = max(height, width)
    for side in dict.fromkeys(min(side, int(MAX_MAGNIFIED * longest)) for side in PICTURE_SIDES):
        yield (slice(0, height), slice(0, width)), side, Finding(
            "chart.found-in-photo", Severity.INFO, values={"side_px": side})
    h, w = int(REGION_SHARE * height), int(REGION_SHARE * width)
    for top in (0, (height - h) // 2, height - h):
        for left in (0, (width - w) // 2, width - w):
            side = min(PICTURE_SIDES[0], int(MAX_MAGNIFIED * max(h, w)))
            yield (slice(top, top + h), slice(left, left + w)), side, Finding(
                "chart.found-in-part", Severity.INFO, values={"side_px": side})


def _resized(picture: np.ndarray, side: int) -> tuple[np.ndarray, float]:
    scale = min(side / max(picture.shape[:2]), MAX_MAGNIFIED)
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    return cv2.resize(picture, None, fx=scale, fy=scale, interpolation=interpolation), scale


def _mcc_quads(rgb8: np.ndarray, chart: charts.Chart = charts.CLASSIC) -> list[np.ndarray]:
    """Proposals (I, 4, 2) of OpenCV in pixels of the picture."""
    detector = cv2.mcc.CCheckerDetector.create()
    # OpenCV 5.0.0 leaves it uninitialised, and then finds nothing
    detector.setColorChartType(KINDS[chart.rows, chart.columns])
    detector.setUseDnnModel(False)
    try:
        detected = detector.process(np.ascontiguousarray(rgb8[..., ::-1]), 1)
    # OpenCV 5.0.0 fails an assertion of its own on some pictures; others of the series may do
    except cv2.error:
        return []
    if not detected:
        return []
    return [np.array(checker.getColorCharts(), float).reshape(-1, 4, 2)
            for checker in detector.getListColorChecker()]


def _fitted_quads(rgb8: np.ndarray, proposed: np.ndarray, chart: charts.Chart) -> np.ndarray:
    """The sampled quadrilaterals after fitting the printed chart to the outlines of the patches.

    OpenCV's centres are off by up to a seventh of a patch. The chart is rectified, each patch is
    filled from its middle, and the centroids of those that come out square-sized give the
    homography.
    """
    centres = chart_agreement.chart_units(chart)
    picture_from_chart = homography(centres, proposed.mean(axis=1))
    for _ in range(2):
        centroids, complete = _patch_centroids(rgb8, picture_from_chart, chart)
        if np.count_nonzero(complete) < MIN_OUTLINED * len(centres):
            break
        correction, _ = cv2.findHomography(centres[complete], centroids[complete], cv2.RANSAC, 2.0)
        if correction is None:
            break
        picture_from_chart = picture_from_chart @ correction
    return _printed_quads(picture_from_chart, chart)


def _patch_centroids(rgb8: np.ndarray, picture_from_chart: np.ndarray,
                     chart: charts.Chart) -> tuple[np.ndarray, np.ndarray]:
    """True centre of each patch in units (I, 2), and whether its filled area is that of a patch."""
    scale, border, centres = RECTIFIED_PX_PER_UNIT, RECTIFIED_BORDER, chart_agreement.chart_units(
        chart)
    areas = (chart.sizes * chart_agreement.unit_scale(chart) * scale).prod(axis=1)
    chart_from_px = np.array([[1 / scale, 0, 0.5 / scale - border],
                           [0, 1 / scale, 0.5 / scale - border], [0, 0, 1]])
    width, height = (int(scale * (side + 2 * border))
                     for side in (centres + chart.sizes * chart_agreement.unit_scale(chart)
                                  / 2).max(axis=0))
    rectified = cv2.warpPerspective(rgb8, picture_from_chart @ chart_from_px, (width, height),
                                    flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    rectified = cv2.medianBlur(rectified, 9)
    centroids, complete = centres.copy(), np.zeros(len(centres), bool)
    for patch, centre in enumerate(centres):
        filled = np.zeros((height + 2, width + 2), np.uint8)
        seed = tuple(int(value) for value in scale * (centre + border))
        cv2.floodFill(rectified, filled, seed, 0, (SAME_PATCH_CODES,) * 3, (SAME_PATCH_CODES,) * 3,
                      4 | cv2.FLOODFILL_FIXED_RANGE | cv2.FLOODFILL_MASK_ONLY | 1 << 8)
        y, x = np.nonzero(filled[1:-1, 1:-1])
        complete[patch] = 0.75 < x.size / areas[patch] < 1.15
        if complete[patch]:
            centroids[patch] = (np.array([x.mean(), y.mean()]) + 0.5) / scale - border
    return centroids, complete


def _printed_quads(target_from_chart: np.ndarray, chart: charts.Chart) -> np.ndarray:
    halves = QUAD_SHARE * (chart.sizes * chart_agreement.unit_scale(chart)) / 2
    squares = chart_agreement.chart_units(chart)[:, None] + charts.SQUARE * halves[:, None]
    return cv2.perspectiveTransform(squares.reshape(1, -1, 2),
                                    target_from_chart).reshape(-1, 4, 2)


def homography(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) of the projection that takes points nearest to others.

    Parameters
    ----------
    source, target : (n, 2) arrays
        n >= 4; any unit.

    Raises
    ------
    InputError
        If the points lie on one line.
    """
    matrix, _ = cv2.findHomography(source, target)
    if matrix is None:
        raise errors.InputError(
            "the chart corners lie on one line; give the four outer corners of the "
            "patch grid")
    return matrix


# ---- verdicts ------------------------------------------------------------------------------------

def _other_order(image: photos.LinearImage, chart: charts.Chart, reading: str) -> str:
    return (f"photo {image.source}: the patches agree with the reference of the {chart.name} only "
            f"if one of the two is read {reading}; list the reference row by row, "
            f"{chart.names[0]} first, or name its samples after the patches, and give {CORNERS} "
            f"at {chart.corner_words}")


def _require_chart(image: photos.LinearImage, agreement: chart_agreement.Agreement,
                   chart: charts.Chart, by_hand: bool) -> None:
    """Refuse patches that agree with the chart as a whole but not in contrast, order or each."""
    lowest, highest = ACCEPTED_CONTRAST
    if not lowest <= agreement.contrast <= highest:
        raise errors.CheckError(
            f"photo {image.source} shows a chart, but its values go with the power "
            f"{agreement.contrast:.2f} of the light; give the camera raw, or a file "
            "without tone curve or sRGB encoding")
    # given corners or a reference in another order, where no published colours of the chart say
    # which of the two is the one to correct
    if by_hand and not chart.has_known_colours:
        for words, order in charts.table_orders(chart.rows, chart.columns).items():
            if np.array_equal(order, agreement.order) and words != charts.AS_ASKED:
                raise errors.CheckError(_other_order(image, chart, words))
    limit = (chart_agreement.WORST_PATCH if image.kind is photos.PhotoKind.RAW
             else chart_agreement.WORST_ENCODED_PATCH)
    unlike = np.flatnonzero(agreement.misfit > limit)
    if unlike.size:
        worst = unlike[np.argsort(-agreement.misfit[unlike])]
        remedy = _dark_bands(image) or ("uncover and clean the chart, keep reflections off it, and "
                                        f"use a {chart.name.removeprefix('ColorChecker ')}: "
                                        f"{len(chart.names)} patches of this very order")
        if len(chart.names) - worst.size >= photos.MIN_PATCHES:
            remedy += f"; {_leaving_out(worst.tolist())}"
        raise errors.CheckError(f"photo {image.source}: patch "
                         f"{', '.join(str(patch + 1) for patch in worst[:6])} of the chart "
                         f"read{'s' if worst.size == 1 else ''} unlike a {chart.name} "
                         f"(relative misfit {agreement.misfit[worst[0]]:.2f}, at most {limit} is "
                         f"accepted); {remedy}")


def _leaving_out(patches: Sequence[int]) -> str:
    """How the operator says that patches are left out."""
    numbers = ", ".join(str(patch + 1) for patch in sorted(patches))
    return (f"or measure on the others: --leave-out {numbers.replace(' ', '')} "
            f"(leave_out = [{numbers}] under [chart] of session.toml)")


def _one_neutral(image: photos.LinearImage, patch: int, others: chart_agreement.Agreement,
                 chart: charts.Chart) -> errors.CheckError:
    """The refusal of a chart whose other patches agree."""
    return errors.CheckError(
        f"photo {image.source}: patch {patch + 1} of the chart, {chart.names[patch]}, reads unlike "
        f"a {chart.name}, whose greys grow darker from patch to patch; the others agree with one "
        f"(relative rms {others.residual:.2f}); uncover and clean it, {_leaving_out([patch])}")


def _dark_bands(image: photos.LinearImage) -> str | None:
    """That the light leaves bands of the photo without signal, in words; None where it does not."""
    brightest = np.percentile(image.signal, BRIGHT_PERCENTILE, axis=(0, 1))
    share = brightest / brightest.max()
    dark = np.flatnonzero(share < DARK_BAND)
    if not dark.size:
        return None
    return (f"its band {' and '.join(str(band + 1) for band in dark)} reads {share.min():.1%} of "
            "the brightest band: the light has no power there, and patches of different colours "
            "look alike under it; photograph the chart under a light that covers 400-700 nm")


def _require_gaps(image: photos.LinearImage, picture: np.ndarray, quads_px: np.ndarray,
                  chart: charts.Chart) -> None:
    """Refuse a card whose patches stand closer than on any ColorChecker Classic."""
    gap = patch_gap(picture, image_from_sensor(quads_px, image.sensor_step), chart)
    if gap is None or gap < MIN_GAP:
        distance = ("at no visible distance" if gap is None
                    else f"only {gap:.1%} of their pitch")
        raise errors.CheckError(
            f"photo {image.source} shows a card with the colours of a ColorChecker "
            f"Classic, but its patches stand {distance} apart, 8 % or more on a "
            "Classic: it is another maker's card, of other reflectances, or out of "
            "focus; photograph a ColorChecker Classic in focus")


def patch_gap(rgb8: np.ndarray, quads: np.ndarray,
              chart: charts.Chart = charts.CLASSIC) -> float | None:
    """Median width of the dark gaps between patches / distance of their centres, at half depth.

    None where fewer than 6 of the 38 gaps can be seen. Blur can only widen a gap or hide it.

    Parameters
    ----------
    rgb8 : (H, W, 3) uint8 array
    quads : (I, 4, 2) array
        Patches in pixels of that picture.
    chart : Chart
    """
    scale, centres = GAP_PX_PER_UNIT, chart_agreement.chart_units(chart)
    last_column, last_row = chart.columns - 1, len(centres) - chart.columns
    matrix = np.diag([scale, scale, 1.0]) @ homography(quads.mean(axis=1), centres)
    width, height = (int(scale * (side + chart_agreement.PATCH / 2)) for side in centres[-1])
    reaches = np.array([centres[1, 0] - centres[0, 0], centres[chart.columns, 1] - centres[0, 1]])
    grey = cv2.warpPerspective(rgb8, matrix, (width, height), flags=cv2.INTER_LINEAR).mean(axis=2)
    widths = []
    (across, down), half = (reaches * scale).astype(int), int(GAP_STRIP * scale / 2)
    for patch, (x, y) in enumerate(np.rint(centres * scale).astype(int)):
        strips = ([grey[y - half:y + half, x:x + across].mean(axis=0)]
                  if patch % chart.columns < last_column else []) + \
                 ([grey[y:y + down, x - half:x + half].mean(axis=1)] if patch < last_row else [])
        for strip in strips:
            fifth, inner = strip.size // 5, strip[strip.size * 3 // 10:strip.size * 7 // 10]
            ends = min(float(np.median(strip[:fifth])), float(np.median(strip[-fifth:])))
            lowest = float(inner.min())
            if ends - lowest >= MIN_GAP_DEPTH:
                widths.append(float(np.mean(strip < (lowest + ends) / 2)))
    return float(np.median(widths)) if len(widths) >= MIN_GAPS else None


def _not_found(image: photos.LinearImage, residual: float, chart: charts.Chart,
               by_hand: bool) -> str:
    limit = f"at most {chart_agreement.ACCEPTED_RESIDUAL} is accepted"
    if by_hand:
        if not np.isfinite(residual):
            return (f"photo {image.source}: patches at the given corners lie outside the photo; "
                    f"give {CORNERS} as the outer corners of the patch grid at "
                    f"{chart.corner_words}")
        misfit = "disagree with a chart" if residual < chart_agreement.HOPELESS_RESIDUAL else \
            "are nothing like a chart"
        return (f"photo {image.source}: the patches at the given corners {misfit} (relative rms "
                f"{residual:.2f}, {limit}); give {CORNERS} as the outer corners of the patch grid "
                f"at {chart.corner_words}")
    if not chart.detectable:
        return (f"a {chart.name} cannot be found in photo {image.source} by itself; give {CORNERS} "
                f"({chart.corner_words}) in pixels of the photo")
    nearest = ""
    if np.isfinite(residual):
        nearest = f" (the likeliest place disagrees by {residual:.2f}, {limit})"
    remedy = _dark_bands(image) or (
        "photograph the whole chart, none of its patches cut off, so that it fills at least a "
        f"{MIN_WIDTH_WORDS} of the frame's width, in even light without glare; where it is there "
        f"and only not found, give {CORNERS} at {chart.corner_words}")
    named = "ColorChecker" if chart.name == charts.CLASSIC.name else chart.name
    return f"no {named} was found in photo {image.source}{nearest}; {remedy}"
