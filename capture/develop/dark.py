"""Dark frames: photos with the lens cap on, at the exposure and ISO of the photo, in place of its
black level.

They hold what the black level cannot: dark current, glow at the edges, and hot pixels.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.capture.photo.linear import linear_image, tile_step
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.records.photos import LinearImage, RawFrame

HOT_SIGMA = 8.0              # above the median of the dark frame: none of 60 million normal pixels
SIGMA_PER_MAD = 1.4826       # of a normal distribution
MAX_EXPOSURE_RATIO = 1.05    # dark current grows with the exposure
MAX_HOT_SHARE = 0.01         # of the pixels: more is light that leaked in
ROUNDING_VARIANCE = 1 / 12   # DN squared


@dataclass(frozen=True, eq=False)
class DarkFrame:
    """Mean of dark frames, with its variance and the pixels that are hot."""

    level: np.ndarray        # (H, W) float32 DN
    variance: np.ndarray     # (H, W) float32 DN squared, of the mean
    hot: np.ndarray          # (H, W) bool
    exposure_s: float | None
    iso: float | None
    camera: str
    source: str


def mean_dark(frames: Sequence[RawFrame], cut_off_dn: float = 0.0) -> DarkFrame:
    """Average dark frames of the same camera and settings.

    Parameters
    ----------
    frames : sequence of RawFrame
    cut_off_dn : float
        What a photo lost to cut-off digits and a dark frame that reads 0 did not: 0.5 where 12 bits
        were cut to 8, 0 where values are as the sensor gave them.

    Raises
    ------
    InputError
        If there are none, or they differ in size, camera, exposure or ISO.
    CheckError
        If they are not dark: more than a hundredth of their pixels stand out.
    """
    if not frames:
        raise InputError("no dark frame was given; photograph with the lens cap on, at the "
                         "exposure of the photo")
    first = frames[0]
    for frame in frames[1:]:
        _require_alike(first, frame, "dark frames")
    stack = np.stack([frame.mosaic for frame in frames]).astype(np.float32)
    level = stack.mean(axis=0)
    scatter = max(float(stack.var(axis=0, ddof=1).mean()) if len(frames) > 1
                  else _spatial_variance(level, first.cfa), ROUNDING_VARIANCE)
    hot = np.zeros(level.shape, bool)
    for y, x in np.ndindex(*first.cfa.shape):
        tile = (slice(y, None, first.cfa.shape[0]), slice(x, None, first.cfa.shape[1]))
        sigma = max(SIGMA_PER_MAD * float(np.median(np.abs(level[tile] - np.median(level[tile])))),
                    np.sqrt(scatter / len(frames)))
        hot[tile] = level[tile] > np.median(level[tile]) + HOT_SIGMA * sigma
    if hot.mean() > MAX_HOT_SHARE:
        raise CheckError(f"dark frame {first.file}: {hot.mean():.1%} of its pixels stand out and "
                         f"at most {MAX_HOT_SHARE:.0%} may; it is not dark: put the cap on and "
                         "cover the viewfinder")
    variance = np.full(level.shape, scatter / len(frames), np.float32)
    return DarkFrame(level - np.float32(cut_off_dn), variance, hot,
                     first.exposure_s, first.iso, first.camera,
                     ", ".join(frame.file for frame in frames))


def subtract_dark(frame: RawFrame, dark: DarkFrame,
                  noise: tuple[np.ndarray, np.ndarray] | None = None) -> LinearImage:
    """Linear signal of a photo with the dark frame in place of its black level.

    A hot pixel takes the mean of the nearest pixels of its colour to the left and right that are
    not hot. The variance includes that of the dark frame, which photos that share a dark frame have
    in common (``common_variance``).

    Parameters
    ----------
    frame : RawFrame
    dark : DarkFrame
    noise : two (K,) arrays or None
        Read noise and gain; None to take them from the photo itself.

    Raises
    ------
    InputError
        If size, camera, exposure or ISO differ.
    CheckError
        If the dark frame is brighter than the photo.
    """
    _require_fits(frame, dark)
    brightness, darkness = float(np.median(frame.mosaic)), float(np.median(dark.level))
    if darkness > brightness:
        raise CheckError(f"dark frame {dark.source} is brighter ({darkness:.0f} DN) than photo "
                         f"{frame.file} ({brightness:.0f} DN, medians); are the two exchanged, or "
                         "was the cap off?")
    filled = _filled(frame.mosaic, dark.hot, frame.cfa.shape[1]) if dark.hot.any() else frame.mosaic
    level = _filled(dark.level, dark.hot, frame.cfa.shape[1]) if dark.hot.any() else dark.level
    image = linear_image(dataclasses.replace(frame, mosaic=filled), noise, level, dark.variance)
    return dataclasses.replace(image, source=f"{image.source} - dark {dark.source}")


def common_variance(frame: RawFrame, dark: DarkFrame) -> np.ndarray:
    """Variance (K,) of the signal by the dark frame, the same error in every photo that uses it.

    Parameters
    ----------
    frame : RawFrame
        A photo from which it was subtracted.
    dark : DarkFrame
    """
    step = tile_step(frame.cfa, frame.file)
    share = np.zeros(int(frame.cfa.max()) + 1)
    for top, left in np.ndindex(frame.cfa.shape[0] // step, frame.cfa.shape[1] // step):
        block = frame.cfa[top * step:(top + 1) * step, left * step:(left + 1) * step]
        share += 1 / np.bincount(block.ravel())
    tiles = frame.cfa.size / step**2
    return np.asarray(share / tiles * dark.variance.mean()
                      / (frame.white_level - frame.black_level.mean()) ** 2)


def _filled(plane: np.ndarray, hot: np.ndarray, period: int) -> np.ndarray:
    """The plane with hot pixels replaced by the mean of the nearest good ones of their colour."""
    filled = plane.copy()
    width = plane.shape[1]
    for y, x in np.argwhere(hot):
        sides = [next((column for column in range(x + step, width if step > 0 else -1, step)
                       if not hot[y, column]), None) for step in (-period, period)]
        values = [float(plane[y, column]) for column in sides if column is not None]
        if values:
            # Rounded, where the plane holds whole numbers: cut off, hot pixels would read a quarter
            # of a DN too dark.
            filled[y, x] = np.mean(values) if plane.dtype.kind == "f" else np.rint(np.mean(values))
    return filled


def _spatial_variance(level: np.ndarray, cfa: np.ndarray) -> float:
    """Variance of one frame's pixels from differences along the row."""
    difference = level[:, cfa.shape[1]:] - level[:, :-cfa.shape[1]]
    # The median of whole numbers is coarse (0 or 1 for a sigma of 1.5), good only to tell hot
    # pixels from the rest.
    most = HOT_SIGMA * max(SIGMA_PER_MAD * float(np.median(np.abs(difference))), 1.0)
    return float(np.mean(np.square(difference[np.abs(difference) <= most], dtype=float)) / 2)


def _require_fits(frame: RawFrame, dark: DarkFrame) -> None:
    if dark.level.shape != frame.mosaic.shape:
        raise InputError(f"dark frame {dark.source} is {dark.level.shape[1]} x "
                         f"{dark.level.shape[0]} pixels and photo {frame.file} "
                         f"{frame.mosaic.shape[1]} x {frame.mosaic.shape[0]}; use the same camera "
                         "and mode")
    if dark.camera != frame.camera:
        raise InputError(f"dark frame {dark.source} was taken with "
                         f"{dark.camera or 'an unnamed camera'} and photo {frame.file} with "
                         f"{frame.camera or 'an unnamed camera'}; use the same camera")
    if dark.iso is not None and frame.iso is not None and dark.iso != frame.iso:
        raise InputError(f"dark frame {dark.source} was taken at ISO {dark.iso:g} and photo "
                         f"{frame.file} at ISO {frame.iso:g}; take dark frames at the photo's ISO")
    if dark.exposure_s and frame.exposure_s:
        ratio = dark.exposure_s / frame.exposure_s
        if not 1 / MAX_EXPOSURE_RATIO <= ratio <= MAX_EXPOSURE_RATIO:
            raise InputError(f"dark frame {dark.source} was exposed for {dark.exposure_s:g} s and "
                             f"photo {frame.file} for {frame.exposure_s:g} s; take dark frames at "
                             "the photo's exposure")


def _require_alike(first: RawFrame, other: RawFrame, what: str) -> None:
    for name, a, b in (("size", first.mosaic.shape, other.mosaic.shape),
                       ("camera", first.camera, other.camera),
                       ("exposure", first.exposure_s, other.exposure_s),
                       ("ISO", first.iso, other.iso)):
        if a != b:
            raise InputError(f"{what} {first.file} and {other.file} differ in {name} ({a} and "
                             f"{b}); give frames of one camera at one setting")
