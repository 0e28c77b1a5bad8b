"""Photo against rendering: which pixels can be compared, and how each surface agrees."""
from __future__ import annotations

import numpy as np

from radiometry.light_scale import scale_from_signals
from radiometry.records import LightScale, LinearImage, SurfaceAgreement

EDGE_CONTRAST = 0.6      # (max - min) / mean within 3 x 3 pixels: above, an edge or a shadow boundary runs through
DARKEST_SIGNAL = 1e-4    # of the photo's 99th percentile: below, a ratio says nothing
SCALE_ERROR = 0.01       # relative: weight of a surface's mean in the light scale
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
        Of the surfaces that have usable pixels, in the given order; one that the rendering leaves dark has no ratio.
    """
    rows = []
    for index, (name, material) in enumerate(zip(names, materials, strict=True)):
        mask = used & (surface == index)
        if mask.any() and np.all(rendered[mask].sum(axis=0) > DARKEST_SIGNAL * measured[mask].sum(axis=0)):
            ratio = measured[mask].sum(axis=0) / rendered[mask].sum(axis=0)
            rows.append((f"{material} / {name}", material, int(mask.sum()), ratio,
                         _block_spread(measured, rendered, mask)))
    kept, kept_materials, pixels, ratios, spreads = zip(*rows, strict=True) if rows else ((), (), (), (), ())
    bands = measured.shape[2]
    return SurfaceAgreement(kept, kept_materials, np.array(pixels, dtype=int), np.array(ratios).reshape(-1, bands),
                            np.array(spreads).reshape(-1, bands))


def surface_covariance(agreement: SurfaceAgreement, known: frozenset[str]) -> np.ndarray:
    """Covariance (K, K) between surfaces of log(photo / rendering): errors of light, pose and geometry.

    A material that was fitted absorbs the mean error of its surfaces, so it tells only by the differences between
    them; a known material tells by every surface. The covariance is pooled over the scene, since such errors befall
    all surfaces alike. Zeros where the scene has no surface to tell from.
    """
    offset = np.log(agreement.ratio)
    total, freedom = np.zeros((offset.shape[1],) * 2), 0
    for material in dict.fromkeys(agreement.materials):
        mine = offset[[name == material for name in agreement.materials]]
        deviation = mine if material in known else mine - mine.mean(axis=0)
        total += deviation.T @ deviation
        freedom += len(mine) - (material not in known)
    return total / freedom if freedom else total


def model_covariance(agreement: SurfaceAgreement, material: str, known: frozenset[str]) -> np.ndarray:
    """Relative covariance (K, K) of one material's signal by which photo and model disagree.

    Three parts: the scatter between the scene's surfaces, divided by the number of this material's; the second moment
    of its own mean log(photo / rendering), which a fit could not absorb; and the scatter within its surfaces, which
    is not divided by the number of pixels, since neighbours err alike.
    """
    mine = [index for index, name in enumerate(agreement.materials) if name == material]
    if not mine:
        return np.zeros((agreement.ratio.shape[1],) * 2)
    weight = agreement.pixels[mine] / agreement.pixels[mine].sum()
    mean = weight @ np.log(agreement.ratio[mine])
    within = np.einsum("s,sk,sl->kl", weight, agreement.spread[mine], agreement.spread[mine])
    return surface_covariance(agreement, known) / len(mine) + np.outer(mean, mean) + within


def scale_from_surfaces(measured: np.ndarray, rendered: np.ndarray, surface: np.ndarray, source: str) -> LightScale:
    """Light scale from the sums over each surface of known spectrum, with every band of every surface counting alike.

    Sums, not pixels: a fit to single pixels is biased by the noise of the rendering.

    Parameters
    ----------
    measured, rendered : (H, W, K) signal
    surface : (H, W) int
        Index of the surface, -1 where a pixel does not count.
    """
    return scale_from_signals(_sums(measured, surface), _sums(rendered, surface), SCALE_ERROR, source)


def _sums(image: np.ndarray, surface: np.ndarray) -> np.ndarray:
    mask = surface >= 0
    members = np.unique(surface[mask], return_inverse=True)[1]
    return np.stack([np.bincount(members, image[mask][:, band]) for band in range(image.shape[2])], axis=1)


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
    blocks = np.full(mask.shape, -1)
    blocks[mask] = member
    sums = [_sums(image, blocks)[full] for image in (measured, rendered)]
    ratio = np.log(np.maximum(sums[0], 1e-12) / np.maximum(sums[1], 1e-12))
    return ratio.std(axis=0, ddof=1)


def misalignment(measured: np.ndarray, rendered: np.ndarray) -> tuple[float, float]:
    """Shift (x, y) in pixels that the photo shows against the rendering, by the correlation of their edges.

    Both (H, W, K). The peak of the correlation is refined by a parabola; a rendering of another scene gives a number
    without meaning, so look at it only where the agreement is poor.
    """
    a, b = (_edges(image) for image in (measured, rendered))
    correlation = np.fft.ifft2(np.fft.fft2(a) * np.conj(np.fft.fft2(b))).real
    peak = np.unravel_index(np.argmax(correlation), correlation.shape)
    shifts = []
    for axis in (1, 0):
        line = np.take(correlation, peak[1 - axis], axis=1 - axis)
        size, place = line.size, int(peak[axis])
        left, middle, right = line[place - 1], line[place], line[(place + 1) % size]
        bend = left - 2 * middle + right
        fine = 0.5 * (left - right) / bend if bend else 0.0
        shifts.append(float((place + fine + size / 2) % size - size / 2))
    return shifts[0], shifts[1]


def misfit_sentences(agreement: SurfaceAgreement, tolerance: float) -> tuple[str, ...]:
    """One sentence for each surface and band whose photo differs from the rendering by more than ``tolerance``.

    Worst first: the surface at the top is the one whose geometry, light or material to check.
    """
    surface, band = np.nonzero(np.abs(np.log(agreement.ratio)) > np.log1p(tolerance))
    order = np.argsort(-np.abs(np.log(agreement.ratio[surface, band])), kind="stable")
    return tuple(f"{agreement.names[surface[i]]}: the photo is {abs(agreement.ratio[surface[i], band[i]] - 1):.0%} "
                 f"{'brighter' if agreement.ratio[surface[i], band[i]] > 1 else 'darker'} than the rendering in band "
                 f"{band[i] + 1} (scatter within it {agreement.spread[surface[i], band[i]]:.0%})" for i in order)


def _edges(image: np.ndarray) -> np.ndarray:
    """Strength (H, W) of the edges of a picture, relative to its brightness there, without the frame's."""
    grey = np.log(np.maximum(image.mean(axis=2), 1e-3 * np.percentile(image, 95)))
    edges = np.zeros(grey.shape)
    edges[1:-1, 1:-1] = np.hypot(grey[2:, 1:-1] - grey[:-2, 1:-1], grey[1:-1, 2:] - grey[1:-1, :-2])
    return edges - edges.mean()
