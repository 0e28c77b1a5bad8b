"""Even out lens shading and uneven light with a photo of a white card in the same position.

The card's log signal is smoothed by a polynomial in the picture's coordinates, so that neither its
noise nor its texture enters the result.
"""
from __future__ import annotations

import dataclasses

import numpy as np

from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.records.photos import LinearImage

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
