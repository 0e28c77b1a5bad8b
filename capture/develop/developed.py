"""Photos, their bands, dark frames, a flat field and a bracket to one linear image (``spectrabox
develop``).

Even out lens shading and uneven light with a photo of a white card in the same position.

The card's log signal is smoothed by a polynomial in the picture's coordinates, so that neither its
noise nor its texture enters the result.
"""


from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spectrabox.capture.develop.bracket import merge_exposures
from spectrabox.capture.develop.dark import DarkFrame, common_variance, mean_dark, subtract_dark
from spectrabox.capture.photo import image_files, linear, preview, processed_photos, raw
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.findings import Finding, Severity, each_once
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind, RawFrame

WELL_EXPOSED_PERCENTILE = 99.0
# of the strongest channel under one filter or lamp: what lies below is mostly glare and black level
DARK_CHANNEL = 0.03


def stack_bands(images: Sequence[LinearImage], names: Sequence[str],
                channels: Sequence[int] | None = None,
                exposures_s: Sequence[float] | None = None) -> LinearImage:
    """One image of K bands, in the order of the photos.

    Parameters
    ----------
    images : sequence of LinearImage
        A photo for each band, of one camera that did not move.
    names : sequence of K str
        What makes each band: "450 nm", "blue LED".
    channels : sequence of K int or None
        Which channel of each photo to take; None for the one that sees most light.
    exposures_s : sequence of K float or None
        Exposure to bring each band to; None leaves each at its own, which a calibration takes up as
        a gain of the band, provided it is the same for all scenes.

    Raises
    ------
    InputError
        If the photos differ in size or camera, or their number is not that of the names; where
        exposures are asked for, also if a photo does not state its own, or the photos differ in ISO
        or f-number.
    """
    if len(images) != len(names) or not images:
        raise InputError(f"{len(images)} photos and {len(names)} band names were given; one name "
                         "per photo is needed")
    first = images[0]
    for image, name in zip(images, names, strict=True):
        if image.signal.shape[:2] != first.signal.shape[:2] or image.camera != first.camera:
            raise InputError(f"band {name}: photo {image.source} differs from {first.source} in "
                             "size or camera; the bands of a multispectral image come from one "
                             "camera that does not move")
    chosen = [strongest_channel(image) for image in images] if channels is None else list(channels)
    scales = [1.0] * len(images) if exposures_s is None else \
        [wanted / _exposure_like(image, first, name)
         for wanted, image, name in zip(exposures_s, images, names, strict=True)]
    pick = list(zip(images, chosen, scales, strict=True))
    exposures = {image.exposure_s for image in images} if exposures_s is None else set(exposures_s)
    return dataclasses.replace(
        first,
        signal=np.stack([image.signal[..., channel] * np.float32(scale)
                         for image, channel, scale in pick], -1),
        variance=np.stack([image.variance[..., channel] * np.float32(scale**2)
                           for image, channel, scale in pick], -1),
        saturated=np.stack([image.saturated[..., channel] for image, channel, _ in pick], -1),
        exposure_s=exposures.pop() if len(exposures) == 1 else None,
        source="; ".join(f"{name}: {image.source}"
                         for name, image in zip(names, images, strict=True)))


def _exposure_like(image: LinearImage, first: LinearImage, name: str) -> float:
    """Exposure time of a band whose signal differs from the first one's by that time alone."""
    if image.exposure_s is None:
        raise InputError(f"band {name}: photo {image.source} states no exposure time, so that it "
                         "cannot be brought to another; give photos that do")
    ours, theirs = (
        " and ".join(f"{name}{'unknown' if value is None else f'{value:g}'}" for name, value in
                     (("ISO ", photo.iso), ("f/", photo.f_number))) for photo in (image, first))
    if ours != theirs:
        raise InputError(f"band {name}: photo {image.source} was taken at {ours}, {first.source} "
                         f"at {theirs}; change the exposure time alone from band to band")
    return image.exposure_s


def only_channels(image: LinearImage, channels: Sequence[int] | None) -> LinearImage:
    """The photo with some of its channels, in their order; all where none are named.

    Parameters
    ----------
    image : LinearImage
    channels : sequence of int or None
    """
    if channels is None or list(channels) == list(range(image.signal.shape[2])):
        return image
    chosen = list(channels)
    return dataclasses.replace(image, signal=image.signal[..., chosen],
                               variance=image.variance[..., chosen],
                               saturated=image.saturated[..., chosen])


def bright_channels(image: LinearImage) -> tuple[int, ...]:
    """The channels that see more than ``DARK_CHANNEL`` of what the strongest sees, in order.

    Parameters
    ----------
    image : LinearImage
    """
    bright = _brightest(image)
    return tuple(np.flatnonzero(bright > DARK_CHANNEL * bright.max()).tolist()) \
        or (strongest_channel(image),)


def strongest_channel(image: LinearImage) -> int:
    """The channel that sees most light in the bright parts of the photo.

    Parameters
    ----------
    image : LinearImage
    """
    return int(np.argmax(_brightest(image)))


def _brightest(image: LinearImage) -> np.ndarray:
    """Signal (K,) of each channel in the bright parts of a photo."""
    stride = max(1, int(np.sqrt(image.signal[..., 0].size / 100_000)))
    return np.asarray(np.percentile(image.signal[::stride, ::stride], WELL_EXPOSED_PERCENTILE,
                                    axis=(0, 1)))


# ---- even out lens shading and uneven light with a photo of a white card in the same position ----

ORDER = 4                    # of the polynomial in x and y together: 15 terms
BLOCKS = 24                  # block means along each side, at most
CLIPPED_LIMIT = 0.01         # of a block: a few hot pixels do not spoil it
MIN_SIGNAL = 0.02            # of full scale: below it black-level errors exceed 1 % of the card
MAX_ROUGH = 0.05             # of a block against the smooth card: holes, shadows, writing
MIN_USABLE_BLOCKS = 0.75     # of all: a polynomial must not be trusted over more than the rest


def divide_by_flat(image: LinearImage, flat: LinearImage) -> LinearImage:
    """The photo divided by the smoothed card, which is 1 in each band where it is brightest.

    Parameters
    ----------
    image, flat : LinearImage
        The photo, and that of the white card, of one camera and size.

    Raises
    ------
    InputError
        If the two photos differ in size or camera.
    CheckError
        If the card is saturated or dark over too much of its photo, or has holes.
    """
    if flat.signal.shape != image.signal.shape or flat.sensor_step != image.sensor_step:
        raise InputError(f"flat field {flat.source} is {_size(flat)} and photo {image.source} is "
                         f"{_size(image)}; photograph the white card at the same size")
    if flat.camera != image.camera:
        raise InputError(f"flat field {flat.source} was taken with "
                         f"{flat.camera or 'an unnamed camera'} and photo {image.source} with "
                         f"{image.camera or 'an unnamed camera'}; use the same camera and lens")
    shading = smooth_flat(flat)
    signal = image.signal / shading
    variance = image.variance / np.square(shading)
    return dataclasses.replace(image, signal=signal, variance=variance,
                               source=f"{image.source} / flat {flat.source}")


def smooth_flat(flat: LinearImage) -> np.ndarray:
    """Smoothed card (H, W, K) float32, 1 in each band where it is brightest.

    Parameters
    ----------
    flat : LinearImage
        Photo of a white card.
    """
    height, width, bands = flat.signal.shape
    y, x, means, usable = _block_means(flat)
    if np.mean(usable) < MIN_USABLE_BLOCKS:
        raise CheckError(f"flat field {flat.source} is saturated in {1 - np.mean(usable):.0%} of "
                         "its area; photograph the white card with a shorter exposure")
    darkest = means[usable].min()
    if darkest < MIN_SIGNAL:
        raise CheckError(f"flat field {flat.source} falls to {darkest:.4f} of full scale and at "
                         f"least {MIN_SIGNAL} is needed; photograph the white card filling the "
                         "frame, with a longer exposure")
    # powers of y and x whose sum is at most ORDER
    powers = powers_y, powers_x = np.nonzero(np.add.outer(*[np.arange(ORDER + 1)] * 2) <= ORDER)
    terms = (y[:, None] ** powers_y * x[:, None] ** powers_x)[usable]
    shading = np.empty((height, width, bands), np.float32)
    across = np.stack([_coordinate(np.arange(width), width) ** power for power in range(ORDER + 1)])
    down = np.stack([_coordinate(np.arange(height), height) ** power for power in range(ORDER + 1)])
    for band in range(bands):
        coefficients = np.zeros((ORDER + 1, ORDER + 1))
        logs = np.log(means[usable, band])
        coefficients[powers] = np.linalg.lstsq(terms, logs, rcond=None)[0]
        _require_smooth(flat, logs - terms @ coefficients[powers])
        log_shading = (down.T @ coefficients @ across).astype(np.float32)
        shading[..., band] = np.exp(log_shading - log_shading.max())
    return shading


def _require_smooth(flat: LinearImage, log_residuals: np.ndarray) -> None:
    """Refuse a card with holes, shadows or writing: the polynomial would spread them over the
    picture.
    """
    rough = np.abs(np.expm1(log_residuals))
    if rough.max() > MAX_ROUGH:
        raise CheckError(f"flat field {flat.source}: {np.count_nonzero(rough > MAX_ROUGH)} of "
                         f"{rough.size} parts differ from a smooth card, by up to "
                         f"{rough.max():.0%} ({MAX_ROUGH:.0%} is the most); photograph a clean "
                         "white card without holes, shadows or edges that fills the frame")


def _block_means(flat: LinearImage) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Centre coordinates (Q,), means (Q, K) and usability (Q,) of blocks that cover the picture."""
    height, width = flat.signal.shape[:2]
    tops, lefts = (np.linspace(0, side, min(side, BLOCKS) + 1).astype(int)
                   for side in (height, width))
    area = np.diff(tops)[:, None] * np.diff(lefts)
    summed = _block_sums(flat.signal, tops, lefts)
    clipped = _block_sums(np.asarray(flat.saturated.any(axis=2)), tops,
                          lefts) > CLIPPED_LIMIT * area
    y = _coordinate((tops[:-1] + tops[1:] - 1) / 2, height)
    x = _coordinate((lefts[:-1] + lefts[1:] - 1) / 2, width)
    grid_y, grid_x = np.meshgrid(y, x, indexing="ij")
    means = (summed / area[..., None]).reshape(-1, flat.signal.shape[2])
    return grid_y.ravel(), grid_x.ravel(), means, ~clipped.ravel()


def _block_sums(values: np.ndarray, tops: np.ndarray, lefts: np.ndarray) -> np.ndarray:
    return np.add.reduceat(np.add.reduceat(values, tops[:-1], axis=0, dtype=float), lefts[:-1],
                           axis=1)


def _coordinate(index: np.ndarray, size: int) -> np.ndarray:
    """Pixel index as -1 to 1 across the picture, which keeps the powers well conditioned."""
    return (2 * np.asarray(index, float) + 1) / size - 1


def _size(image: LinearImage) -> str:
    height, width, bands = image.signal.shape
    return (f"{width} x {height} pixels of {bands} bands, each over {image.sensor_step:g} of the "
            "sensor's")


# ---- developed -----------------------------------------------------------------------------------

NOT_LINEAR = "NOT LINEAR: decoded as sRGB, colour matrix and tone curve remain"


def develop_photos(photos: Sequence[Path], darks: Sequence[Path], flat: Path | None,
                   not_linear: bool = False, channels: Sequence[int] | None = None,
                   orientation: int = preview.AS_READ) -> tuple[LinearImage, tuple[Finding, ...]]:
    """One linear image from photos of one scene, and what was found of dark frames and exposures.

    Dark frames are averaged by exposure and subtracted from the photos of theirs; photos of several
    exposures are merged; the flat is divided out last.

    Parameters
    ----------
    photos, darks : sequences of Path
        Raw files where dark frames are given, else any photos.
    flat : Path or None
        Photo of a white card in the same position.
    not_linear : bool
        As in ``open_any``.
    channels : sequence of int, optional
        Of the photos, those that the result has: a flat may be too dark in others. All by default.
    orientation : int
        1 to 8, as EXIF numbers them: how the result is turned, whatever the files state. By default
        it is as the sensor read it.

    Raises
    ------
    InputError
        If a file cannot be used, or a photo lacks a dark frame of its exposure while others have
        one.
    CheckError
        If exposures disagree, or the dark frame or the flat is not fit for use.
    """
    by_exposure: dict[float | None, list[RawFrame]] = {}
    for path in darks:
        frame = raw.read_raw(path)
        by_exposure.setdefault(frame.exposure_s, []).append(frame)
    dark_frames = {exposure: mean_dark(frames) for exposure, frames in by_exposure.items()}
    findings = [Finding("dark.hot-pixels", Severity.INFO, dark.source,
                        {"hot": int(dark.hot.sum())}) for dark in dark_frames.values()]
    images = [] if darks else [open_any(path, not_linear) for path in photos]
    sharing: dict[str, list[tuple[RawFrame, DarkFrame]]] = {}
    for path in photos if darks else ():
        frame = raw.read_raw(path)
        only = next(iter(dark_frames.values())) if len(dark_frames) == 1 else None
        # a wrong exposure is refused by name below
        dark = dark_frames.get(frame.exposure_s) or only
        if dark is None:
            raise InputError(f"photo {path.name} was exposed for {frame.exposure_s} s and no dark "
                             "frame was; take one at each exposure of the bracket")
        sharing.setdefault(dark.source, []).append((frame, dark))
    for pairs in sharing.values():
        mean, ratios = merge_exposures([subtract_dark(frame, dark) for frame, dark in pairs])
        # the dark frame's own noise, which no number of photos averages away
        left = (1 - 1 / len(pairs)) * common_variance(*pairs[0])
        images.append(dataclasses.replace(mean, variance=mean.variance + left.astype(np.float32)))
        findings += ratios
    findings = [*each_once(one for image in images for one in image.findings), *findings]
    merged, ratios = merge_exposures(images)
    merged = only_channels(merged, channels)
    if flat is not None:
        merged = divide_by_flat(merged, only_channels(open_any(flat, not_linear), channels))
    if any(image.kind is PhotoKind.PROCESSED for image in images):
        findings.append(Finding("photo.not-linear", Severity.WARN))
    return preview.turned(merged, orientation), (*findings, *ratios)


def open_any(path: Path, not_linear: bool = False) -> LinearImage:
    """As ``open_photo``, and where allowed also files that are not linear, marked as such.

    Parameters
    ----------
    path : Path
    not_linear : bool
        Whether to take JPEG, PNG and 8-bit files too, decoded as sRGB.

    Raises
    ------
    InputError
    """
    try:
        return linear.open_photo(path)
    except processed_photos.NotLinearError:
        if not not_linear:
            raise
    image = image_files.read_encoded_file(path)
    return dataclasses.replace(image, source=f"{image.source} ({NOT_LINEAR})")
