"""How far one photo of a scene is shifted and turned against another from the same tripod.

Lamps and filters change what is bright and what is dark, but edges stay where they are: photos are
compared by the size of their gradients, band by band, since the colour sites of a sensor lie beside
each other. Phase correlation finds the shift, the enhanced correlation coefficient (Evangelidis and
Psarakis 2008) what is left of it and the turn.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import cv2
import numpy as np

from spectrabox.capture.photo.preview import thumbnail
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.records.photos import LinearImage, Registration

WIDTH = 1000                # pixels, of the pictures of edges that are compared
SMOOTHED_PX = 1.0           # before gradients are taken: the mosaic's own steps
NOISE_OF_GRADIENT = 1.5     # of a pixel's; a smaller gradient is none
MIN_CORRELATION = 0.3       # of the edges of a band, below which it says nothing
STEPS, PRECISION, BLUR_PX = 60, 1e-5, 5     # of the correlation coefficient
MAX_SHIFT = 0.05            # of the photo's width
# a sample's own motion: the share of the photo's width and pixels that are tolerated, the pixels of
# the picture of edges about its outline, and how much better it fits where it is said to be
TOLERATED, TOLERATED_PX, MARGIN, SURROUND_PX = 0.003, 3.0, 0.2, 12
MIN_LIKENESS = 0.6
PARTS, MIN_PART_PX, MIN_RESPONSE = 4, 32, 0.3   # of the shorter side, whose residual is stated


@dataclass(frozen=True)
class Edges:
    """Where a photo has edges, band by band, (H, W, K) float32."""

    size: np.ndarray
    sensor_step: float      # pixels of the sensor a side of one of these

    @property
    def photo_px(self) -> tuple[int, int]:
        """Width and height of the photo."""
        height, width = self.size.shape[:2]
        return round(width * self.sensor_step), round(height * self.sensor_step)

    @property
    def all_bands(self) -> np.ndarray:
        """Of all bands together (H, W)."""
        return np.asarray(self.size.sum(axis=2))


def find_edges(image: LinearImage) -> Edges:
    """The edges of a photo: square roots of gradients in standard errors of the noise.

    Parameters
    ----------
    image : LinearImage
    """
    small = thumbnail(image, WIDTH) if image.signal.shape[1] > WIDTH else image
    bands = []
    for band in range(small.signal.shape[2]):
        signal = cv2.GaussianBlur(np.ascontiguousarray(small.signal[..., band], np.float32),
                                  (0, 0), SMOOTHED_PX)
        across, down = (cv2.Sobel(signal, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
        noise = np.sqrt(np.maximum(small.variance[..., band], np.finfo(np.float32).tiny))
        bands.append(np.sqrt(np.maximum(np.hypot(across, down) / noise - NOISE_OF_GRADIENT, 0)))
    return Edges(np.stack(bands, axis=2).astype(np.float32), small.sensor_step)


def register(first: Edges, other: Edges,
             chart_px: tuple[np.ndarray, np.ndarray] | None = None) -> Registration | None:
    """The motion between two photos; None where they have too little in common.

    Parameters
    ----------
    first, other : Edges
        Of photos of one size.
    chart_px : two (I, 4, 2) arrays, optional
        Patches of the chart in both photos, where both show it.
    """
    matrix = _by_edges(first, other)
    if matrix is None:
        return None
    middle = (np.array(first.size.shape[1::-1]) * first.sensor_step - 1) / 2
    shift = matrix[:, :2] @ middle + matrix[:, 2] - middle
    registration = Registration(matrix, float(np.hypot(*shift)),
                                _residual(first, _brought_back(other, matrix)), None)
    if chart_px is None:
        return registration
    before, after = (patches.reshape(-1, 2) for patches in chart_px)
    off = before @ matrix[:, :2].T + matrix[:, 2] - after
    return replace(registration, chart_px=float(np.sqrt(np.mean(np.sum(off**2, axis=1)))))


def registered(first: Edges, other: Edges, names: tuple[str, str],
               outlines: Mapping[str, Sequence[Sequence[float]]],
               chart_px: tuple[np.ndarray, np.ndarray] | None) -> Registration | None:
    """The motion between two photos from one tripod; None where they have too little in common.

    Parameters
    ----------
    first, other : Edges
    names : two str
        Of the photos.
    outlines : mapping
        Corners [x, y] in pixels of the first photo of what both show, by name.
    chart_px : two (I, 4, 2) arrays or None
        As of ``register``.

    Raises
    ------
    InputError
        If the photos are of different sizes.
    CheckError
        If the other photo moved too far, its chart or samples moved by themselves, or its chart
        alone tells that it moved.
    """
    _require_one_size(first, other, *names)
    registration = register(first, other, chart_px)
    if registration is None:
        if chart_px is not None:
            _require_chart_stayed(_CHART_ELSEWHERE, chart_px, float(first.photo_px[0]), *names)
    else:
        if chart_px is not None and samples_stayed(first, other, outlines):
            _require_chart_stayed(_CHART_MOVED, chart_px, float(first.photo_px[0]), *names)
        _require_registered(registration, own_motion_px(first, other, registration, outlines),
                            float(first.photo_px[0]), *names)
    return registration


def tolerated_px(width_px: float) -> float:
    """By how many pixels parts of a scene may move against each other in a photo of a width."""
    return max(TOLERATED_PX, TOLERATED * width_px)


def own_motion_px(first: Edges, other: Edges, registration: Registration,
                  outlines: Mapping[str, Sequence[Sequence[float]]]) -> dict[str, float]:
    """By how many pixels regions moved that did not stay where the rest of the photo did.

    A region without edges in or around it tells nothing, and is left out.

    Parameters
    ----------
    first, other : Edges
    registration : Registration
        Of the other photo to the first.
    outlines : mapping
        From names to corners [x, y] in pixels of the first photo.
    """
    step = first.sensor_step
    height, width = first.size.shape[:2]
    before, back = first.all_bands, _brought_back(other, registration.matrix)
    tolerated = tolerated_px(width * step) / step
    reach = int(np.ceil(MAX_SHIFT * width))
    moved = {}
    for name, outline in outlines.items():
        corners = np.asarray(outline, float) / step
        low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - SURROUND_PX, 0)
        high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + SURROUND_PX, [width, height])
        shown = before[low[1]:high[1], low[0]:high[0]]
        start = np.maximum(low - reach, 0)
        around = back[start[1]:high[1] + reach, start[0]:high[0] + reach]
        if shown.std() == 0 or around.std() == 0:
            continue
        likeness = cv2.matchTemplate(around, shown, cv2.TM_CCOEFF_NORMED)
        column, row = (low - start).tolist()
        best_row, best_column = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
        distance = float(np.hypot(best_row - row, best_column - column))
        if distance > tolerated and likeness.max() > max(MIN_LIKENESS,
                                                         likeness[row, column] + MARGIN):
            moved[name] = distance * step
    return moved


def samples_stayed(first: Edges, other: Edges,
                   outlines: Mapping[str, Sequence[Sequence[float]]]) -> bool:
    """Whether the regions lie where the first photo shows them: neither camera nor samples moved,
    whatever else did.

    Parameters
    ----------
    first, other : Edges
    outlines : mapping
        As of ``own_motion_px``.
    """
    step, size = first.sensor_step, first.size.shape[1::-1]
    before, after = first.all_bands, other.all_bands
    likeness = []
    for outline in outlines.values():
        corners = np.asarray(outline, float) / step
        low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - SURROUND_PX, 0)
        high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + SURROUND_PX, size)
        part = slice(low[1], high[1]), slice(low[0], high[0])
        if before[part].std() > 0 and after[part].std() > 0:
            likeness.append(np.corrcoef(before[part].ravel(), after[part].ravel())[0, 1])
    return bool(likeness) and float(np.median(likeness)) > MIN_LIKENESS


def distance_px(chart_px: tuple[np.ndarray, np.ndarray]) -> float:
    """How far the chart of one photo lies from where it lies in another (rms of its corners).

    Parameters
    ----------
    chart_px : two (I, 4, 2) arrays
    """
    before, after = chart_px
    return float(np.sqrt(np.mean(np.sum((before - after) ** 2, axis=-1))))


def _require_chart_stayed(refusal: str, chart_px: tuple[np.ndarray, np.ndarray], width_px: float,
                          first: str, other: str) -> None:
    """Refuse a photo in which the chart lies elsewhere and the samples do not: a large chart is
    most of what two photos have in common, and its motion is taken for the camera's. Or one that
    has nothing else in common with the first.
    """
    distance = distance_px(chart_px)
    if distance > tolerated_px(width_px):
        raise CheckError(refusal.format(first=first, other=other, distance=distance))


_CHART_MOVED = ("from {first} to {other} the chart moved by {distance:.0f} pixels against what "
                "else the photos show: leave chart and samples where they are from photo to photo")
_CHART_ELSEWHERE = ("in {other} the chart lies {distance:.0f} pixels from where it lies in "
                    "{first}, and little else is in both: it is a photo of other samples, or the "
                    "camera moved; take all photos of the same samples from one tripod, or measure "
                    "each photo by itself (--each)")


def _require_one_size(first: Edges, other: Edges, first_name: str, other_name: str) -> None:
    """Refuse photos of different sizes."""
    if first.size.shape != other.size.shape or first.sensor_step != other.sensor_step:
        said = " and ".join(f"{name} of {' x '.join(map(str, edges.photo_px))}" for name, edges
                            in ((first_name, first), (other_name, other)))
        raise InputError(f"{said} pixels show the same regions: take all photos with one camera in "
                         "one position")


def _require_registered(registration: Registration, own_motion: Mapping[str, float],
                        width_px: float, first: str, other: str) -> None:
    """Refuse a photo that moved too far, or whose chart or samples moved by themselves."""
    if registration.shift_px > MAX_SHIFT * width_px:
        raise CheckError(f"{other} is shifted by {registration.shift_px:.0f} pixels against "
                         f"{first}, {registration.shift_px / width_px:.0%} of its width: the "
                         "camera moved, and saw other light and gloss; take all photos from one "
                         "tripod")
    if own_motion:
        name, distance = max(own_motion.items(), key=lambda item: item[1])
        raise CheckError(f"from {first} to {other} region {name!r} moved by {distance:.0f} pixels "
                         "against what else the photos show: leave the samples where they are "
                         "from photo to photo, or give the region the one photo that shows it "
                         "there")
    chart = registration.chart_px
    if chart is not None and chart > tolerated_px(width_px):
        raise CheckError(_CHART_MOVED.format(first=first, other=other, distance=chart))


def _by_edges(first: Edges, other: Edges) -> np.ndarray | None:
    """Motion (2, 3) between pixels of the sensor; None where no band has enough edges."""
    window = cv2.createHanningWindow(first.size.shape[1::-1], cv2.CV_32F)
    (across, down), _ = cv2.phaseCorrelate(first.all_bands, other.all_bands, window)
    start = np.array([[1, 0, across], [0, 1, down]], np.float32)
    bands = range(first.size.shape[2])
    seen = [(matrix, correlation) for matrix, correlation
            in (_band_motion(np.ascontiguousarray(first.size[..., band]),
                             np.ascontiguousarray(other.size[..., band]), start) for band in bands)
            if correlation > MIN_CORRELATION]
    if not seen:
        return None
    # the error of a motion falls as the correlation nears 1
    weights = np.array([correlation**2 / max(1 - correlation**2, 1e-3) for _, correlation in seen])
    matrix = np.average([matrix for matrix, _ in seen], axis=0, weights=weights)
    return _at_full_resolution(matrix, first.sensor_step)


def _brought_back(other: Edges, matrix: np.ndarray) -> np.ndarray:
    """Edges (H, W) of all bands of the other photo, in the pixels of the first."""
    inverse = _at_full_resolution(matrix, 1 / other.sensor_step).astype(np.float32)
    return np.asarray(cv2.warpAffine(other.all_bands, inverse, other.size.shape[1::-1],
                                     flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP))


def _residual(first: Edges, back: np.ndarray) -> float | None:
    """By how many pixels of the sensor parts of the photo are still off (median), None where no
    part has edges that both photos show.
    """
    before = first.all_bands
    side = max(min(before.shape) // PARTS, MIN_PART_PX)
    window = cv2.createHanningWindow((side, side), cv2.CV_32F)
    off = []
    for row in range(0, before.shape[0] - side + 1, side):
        for column in range(0, before.shape[1] - side + 1, side):
            part = slice(row, row + side), slice(column, column + side)
            (across, down), response = cv2.phaseCorrelate(
                np.ascontiguousarray(before[part]), np.ascontiguousarray(back[part]), window)
            if response > MIN_RESPONSE:
                off.append(np.hypot(across, down))
    return float(np.median(off) * first.sensor_step) if off else None


def _band_motion(first: np.ndarray, other: np.ndarray,
                 start: np.ndarray) -> tuple[np.ndarray, float]:
    """Motion (2, 3) of one band's edges (H, W) and their correlation; 0 where none is found."""
    if not (first.std() > 0 and other.std() > 0):
        return start, 0.0
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, STEPS, PRECISION)
    try:
        correlation, matrix = cv2.findTransformECC(
            first, other, start.copy(), cv2.MOTION_EUCLIDEAN, criteria, None, BLUR_PX)
    except cv2.error:       # the edges have nothing in common
        return start, 0.0
    return np.asarray(matrix), float(correlation)


def _at_full_resolution(matrix: np.ndarray, step: float) -> np.ndarray:
    """A motion between pixels of ``step`` sensor pixels a side as one between the sensor's."""
    middle = (step - 1) / 2         # of the first pixel
    turn = np.asarray(matrix[:, :2], float)
    return np.column_stack([turn, step * matrix[:, 2] + middle - turn @ [middle, middle]])


# ---- resampling ----------------------------------------------------------------------------------
# A photo in the pixels of another, by linear interpolation, and where it is uncertain there.

ROWS_AT_ONCE = 64
SIGNAL_TOLERATED = 0.05     # of the signal: what a pixel may err by since it is off its position


def resampled(photo: LinearImage, matrix: np.ndarray, x_px: np.ndarray,
              y_px: np.ndarray) -> tuple[LinearImage, np.ndarray]:
    """A photo as another's pixels show it, which are moved against its own.

    A pixel is the mean of the four around it by their weights w, its variance the sum of w^2 times
    theirs: as little as a quarter half-way between four, and neighbours then share noise. Clipped
    are those of which any of the four is, and those beyond the photo.

    Parameters
    ----------
    photo : LinearImage
    matrix : (2, 3) array
        From pixels (x, y, 1) of the other photo to those of this one.
    x_px, y_px : (W,), (H,) arrays
        Columns and rows of the other photo, at full resolution.

    Returns
    -------
    image : LinearImage
        Of H x W pixels.
    off_px : (H, W) array
        What interpolation smears a straight edge by, in pixels of the image: 2 w (1 - w), half a
        pixel at most.
    """
    step, shape = photo.sensor_step, (y_px.size, x_px.size, photo.signal.shape[2])
    last = np.array(photo.signal.shape[1::-1])[:, None, None] - 1
    signal, variance = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    saturated, off_px = np.zeros(shape, bool), np.zeros(shape[:2], np.float32)
    for start in range(0, y_px.size, ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        across, down, shift = matrix.T[:, :, None, None]
        at = (across * x_px + down * y_px[rows, None] + shift + 0.5) / step - 0.5
        low = np.clip(np.floor(at), 0, last - 1).astype(int)
        share = np.clip(at - low, 0, 1).astype(np.float32)
        off_px[rows] = np.max(2 * share * (1 - share), axis=0)
        for right, below in product((0, 1), repeat=2):
            x, y = low[0] + right, low[1] + below
            weight = np.where(right, share[0], 1 - share[0]) * np.where(below, share[1],
                                                                        1 - share[1])
            signal[rows] += weight[..., None] * photo.signal[y, x]
            variance[rows] += weight[..., None]**2 * photo.variance[y, x]
            saturated[rows] |= photo.saturated[y, x] & (weight > 0)[..., None]
        saturated[rows] |= np.any((at < -0.5) | (at > last + 0.5), axis=0)[..., None]
    for array in (signal, variance, saturated):
        array.flags.writeable = False       # records then keep it without a copy
    return replace(photo, signal=signal, variance=variance, saturated=saturated), off_px


def uncertain_edges(image: LinearImage, off_px: np.ndarray | float) -> np.ndarray:
    """Pixels (H, W) at edges so high that the signal is uncertain if they are off their position:
    by more than a standard error of noise, and more than 5 % of the signal.

    Parameters
    ----------
    image : LinearImage
    off_px : (H, W) array or float
        In its pixels.
    """
    uncertain = np.zeros(image.signal.shape[:2], bool)
    for band in range(image.signal.shape[2]):
        signal = image.signal[..., band]
        slope = np.hypot(*np.gradient(signal))
        tolerated = image.variance[..., band] + (SIGNAL_TOLERATED * signal)**2
        uncertain |= (off_px * slope)**2 > tolerated
    return uncertain
