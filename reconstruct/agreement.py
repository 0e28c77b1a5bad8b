"""Photo against rendering: which pixels can be compared, and how each surface agrees."""
from __future__ import annotations

import numpy as np

from radiometry.records import LinearImage, SurfaceAgreement

EDGE_CONTRAST = 0.6      # (max - min) / mean within 3 x 3 pixels: above, an edge or a shadow boundary runs through
DARKEST_SIGNAL = 1e-4    # of the photo's 99th percentile: below, a ratio says nothing
BLOCK = 4                # pixels: blocks over which the spread of photo / rendering is taken


def usable_pixels(photo: LinearImage, surface: np.ndarray) -> np.ndarray:
    """Pixels (H, W) that one surface fills, unsaturated, lit, and not on an edge or shadow boundary of the photo."""
    signal = photo.signal
    floor = DARKEST_SIGNAL * np.percentile(signal, 99, axis=(0, 1))
    return ((surface >= 0) & ~photo.saturated.any(axis=2) & (signal > floor).all(axis=2)
            & (_local_contrast(signal.mean(axis=2)) < EDGE_CONTRAST))


def surface_agreement(names: tuple[str, ...], materials: tuple[str, ...], measured: np.ndarray, rendered: np.ndarray,
                      surface: np.ndarray, used: np.ndarray) -> SurfaceAgreement:
    """Ratio of photo to rendering of each surface and the scatter of that ratio within it.

    Parameters
    ----------
    names, materials : tuple of str
        Shape ids and their materials.
    measured, rendered : (H, W, K) signal
    surface : (H, W) index into ``names``
    used : (H, W) bool

    Returns
    -------
    SurfaceAgreement
        Of the surfaces that have usable pixels, in the given order.
    """
    rows = []
    for index, (name, material) in enumerate(zip(names, materials, strict=True)):
        mask = used & (surface == index)
        if mask.any():
            ratio = measured[mask].sum(axis=0) / rendered[mask].sum(axis=0)
            rows.append((f"{material} / {name}", material, int(mask.sum()), ratio,
                         _block_spread(measured, rendered, mask)))
    kept, kept_materials, pixels, ratios, spreads = zip(*rows, strict=True) if rows else ((), (), (), (), ())
    bands = measured.shape[2]
    return SurfaceAgreement(kept, kept_materials, np.array(pixels, dtype=int), np.array(ratios).reshape(-1, bands),
                            np.array(spreads).reshape(-1, bands))


def model_covariance(agreement: SurfaceAgreement, material: str) -> np.ndarray:
    """Relative covariance (K, K) of one material's signal by which photo and model disagree on its surfaces.

    The second moment about zero of log(photo / rendering): between surfaces, plus the mean of the scatter within
    them. Nothing is divided by a number of pixels, since such errors (light, pose, glare) are the same in all of them.
    """
    mine = [index for index, name in enumerate(agreement.materials) if name == material]
    if not mine:
        return np.zeros((agreement.ratio.shape[1],) * 2)
    weight = agreement.pixels[mine] / agreement.pixels[mine].sum()
    offset = np.log(agreement.ratio[mine])
    between = np.einsum("s,sk,sl->kl", weight, offset, offset)
    within = np.einsum("s,sk,sl->kl", weight, agreement.spread[mine], agreement.spread[mine])
    return between + within


def _local_contrast(grey: np.ndarray) -> np.ndarray:
    padded = np.pad(grey, 1, mode="edge")
    shifts = np.stack([padded[i:i + grey.shape[0], j:j + grey.shape[1]] for i in range(3) for j in range(3)])
    return (shifts.max(axis=0) - shifts.min(axis=0)) / np.maximum(np.abs(shifts).mean(axis=0), 1e-12)


def _block_spread(measured: np.ndarray, rendered: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Standard deviation (K,) of log(photo / rendering) over blocks; 0 where there are fewer than two blocks."""
    row, column = np.nonzero(mask)
    block = (row // BLOCK) * (mask.shape[1] // BLOCK + 1) + column // BLOCK
    _, member, count = np.unique(block, return_inverse=True, return_counts=True)
    full = count >= BLOCK
    if full.sum() < 2:
        return np.zeros(measured.shape[2])
    sums = [np.stack([np.bincount(member, image[mask][:, band]) for band in range(image.shape[2])], axis=1)[full]
            for image in (measured, rendered)]
    ratio = np.log(np.maximum(sums[0], 1e-12) / np.maximum(sums[1], 1e-12))
    return ratio.std(axis=0, ddof=1)
