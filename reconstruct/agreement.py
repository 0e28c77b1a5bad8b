"""Photo against rendering: which pixels can be compared, and how each surface agrees."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry import findings, light_scale
from spectrabox.radiometry.records import calibration, photos, scenes

# (max - min) / mean within 3 x 3 pixels: above, an edge or a shadow boundary runs through
MAX_CONTRAST = 0.6
MIN_SIGNAL = 1e-4    # of the photo's 99th percentile: below, a ratio is noise
SCALE_ERROR = 0.01       # relative: weight of a surface's mean in the light scale
FIELD_TERMS = 5          # of a quadratic field over a surface, its mean left out
MIN_SHIFT = 0.5          # pixels
# correlation of the edges of photo and rendering, below which they show different things
MIN_CORRELATION = 0.3
MIN_GAIN = 0.05          # of that correlation, by which a shift must be better than none
STATED_FREEDOM = 1       # deviations of surfaces for which a stated error counts
TAIL = 0.025             # on either side of what a covariance from few deviations must hold
BRIGHTEST_PERCENTILE = 99  # of the irradiance of pixels: above are edges and glints
BLOCK = 4                # pixels: blocks over which the spread of photo / rendering is taken


def usable_pixels(photo: photos.LinearImage, surface: np.ndarray) -> np.ndarray:
    """Pixels (H, W) bool that can be compared with a rendering.

    One surface fills them, they are unsaturated, lit, and not on an edge or shadow boundary.

    Parameters
    ----------
    photo : LinearImage
        (H, W, K) signal.
    surface : (H, W) int
        Index of the one surface that fills each pixel, -1 none or several.
    """
    signal = photo.signal
    floor = MIN_SIGNAL * np.percentile(signal, 99, axis=(0, 1))
    grey = signal.mean(axis=2)
    padded = np.pad(grey, 1, mode="edge")
    shifts = np.stack([padded[i:i + grey.shape[0], j:j + grey.shape[1]] for i in range(3)
                       for j in range(3)])
    contrast = (shifts.max(axis=0) - shifts.min(axis=0)) / np.maximum(
        np.abs(shifts).mean(axis=0), 1e-12)
    return ((surface >= 0) & ~photo.saturated.any(axis=2) & (signal > floor).all(axis=2)
            & (contrast < MAX_CONTRAST))


def surface_agreement(names: tuple[str, ...], materials: tuple[str, ...], photo: photos.LinearImage,
                      renderings: np.ndarray, surface: np.ndarray,
                      used: np.ndarray) -> scenes.SurfaceAgreement:
    """Ratio of photo to rendering of each surface and the scatter of that ratio within it.

    The photo's own noise is no part of the scatter, nor is that of the rendering where there are
    several renderings.

    Parameters
    ----------
    names, materials : tuple of str
        Shape ids and their materials.
    photo : LinearImage
        (H, W, K); the variance is that of its noise.
    renderings : (A, H, W, K) signal
        Of paths that are independent; their mean is compared.
    surface : (H, W) index into ``names``
    used : (H, W) bool

    Returns
    -------
    SurfaceAgreement
        Of the surfaces that have usable pixels, in the given order; one that the rendering leaves
        dark has no ratio.
    """
    rows, rendered = [], renderings.mean(axis=0)
    measured, variance = (image.astype(float) for image in (photo.signal, photo.variance))
    for index, (name, material) in enumerate(zip(names, materials, strict=True)):
        mask = used & (surface == index)
        seen, model = measured[mask].sum(axis=0), rendered[mask].sum(axis=0)
        if mask.any() and np.all(model > MIN_SIGNAL * seen):
            ratio = seen / model
            rows.append((f"{material} / {name}", material, int(mask.sum()), ratio,
                         _block_spread(measured, variance, renderings, mask)))
    columns = zip(*rows, strict=True) if rows else ((),) * 5
    kept, kept_materials, pixels, ratios, spreads = columns
    bands = measured.shape[2]
    return scenes.SurfaceAgreement(kept, kept_materials, np.array(pixels, dtype=int),
                                   np.array(ratios).reshape(-1, bands),
                                   np.array(spreads).reshape(-1, bands))


def surface_covariance(agreement: scenes.SurfaceAgreement, known: frozenset[str],
                       stated_error: float) -> np.ndarray:
    """Covariance (K, K) between surfaces of log(photo / rendering).

    It is that of errors of light, pose and geometry. A material that was fitted absorbs the mean
    error of its surfaces, so it tells only by the differences between them; a known material tells
    by every surface. The covariance is pooled over the scene, since such errors are common to all
    surfaces.

    Parameters
    ----------
    agreement : SurfaceAgreement
    known : names of the materials whose spectrum was given
    stated_error : float
        Standard deviation of a surface's log brightness in each band, before any is seen.
    """
    deviations, freedom = _deviations(agreement, known)
    return covariance_from_few(sum((own.T @ own for own in deviations),
                                   np.zeros((agreement.ratio.shape[1],) * 2)),
                               freedom, stated_error)


def _deviations(agreement: scenes.SurfaceAgreement,
                known: frozenset[str]) -> tuple[list[np.ndarray], int]:
    """Log(photo / rendering) (S_m, K) of the surfaces of each material that no fit explains, and
    their degrees of freedom: the mean of an unknown material is its spectrum's.
    """
    offset, deviations, freedom = np.log(agreement.ratio), [], 0
    for material in dict.fromkeys(agreement.materials):
        own = offset[[name == material for name in agreement.materials]]
        deviations.append(own if material in known else own - own.mean(axis=0))
        freedom += len(own) - (material not in known)
    return deviations, freedom


def covariance_from_few(scatter: np.ndarray, freedom: int, stated_error: float) -> np.ndarray:
    """Covariance (K, K) whose central 95 % hold the next deviation, estimated from few.

    Three remedies against few degrees of freedom nu. What is stated counts as one deviation more
    that was seen (``STATED_FREEDOM``). The matrix is drawn towards one of equal variances and
    correlations of 1/2, halfway between correlated and independent errors of bands, by all of its
    weight at nu = 1, where a single pair has rank 1 and promises that other colours hold no
    error, and by (K + 1) / (nu + K) beyond. And it is widened by the quotient of Student's and the
    normal quantile.

    Parameters
    ----------
    scatter : (K, K) array
        Sum of the outer products of the deviations.
    freedom : int
        nu, of the scatter; 0 leaves what is stated.
    stated_error : float
        Standard deviation in each band.
    """
    from scipy.special import ndtri, stdtrit

    bands = len(scatter)
    even = (np.eye(bands) + 1) / 2
    stated = stated_error**2 * even
    if freedom == 0:
        return stated
    own = (freedom - 1) / (freedom + bands)
    shrunk = own * scatter + (1 - own) * np.trace(scatter) / bands * even
    count = STATED_FREEDOM + freedom
    widening = stdtrit(count, TAIL) / ndtri(TAIL)
    return np.asarray(widening**2 * (STATED_FREEDOM * stated + shrunk) / count)


@dataclass(frozen=True)
class SceneErrors:
    """Standard deviations of log(photo / rendering) where materials cannot explain it.

    Within surfaces, and between surfaces of one material.
    """

    brightness: float       # of a surface, the same in all bands
    colour: float           # of a surface, independent in each band
    block: float            # of a block of pixels, as if the errors of blocks were independent
    pattern: float          # of brightness within a surface, the median of the surfaces


def scene_errors(agreement: scenes.SurfaceAgreement, known: frozenset[str],
                 regions: int) -> SceneErrors | None:
    """Errors that surfaces of known materials show, and surfaces of one material among themselves.

    Errors of neighbouring blocks are correlated: the pattern within a surface is taken to have as
    many independent parts as a quadratic field has terms (``FIELD_TERMS``), whatever the number of
    blocks, so each block weighs less.

    Parameters
    ----------
    agreement : SurfaceAgreement
    known : names of the materials whose spectrum was given
    regions : int
        Blocks that the fit compares, on all surfaces.

    Returns
    -------
    SceneErrors, or None where no two surfaces can be compared.
    """
    deviations, freedom = _deviations(agreement, known)
    if not freedom:
        return None
    deviation = np.concatenate(deviations)
    grey = deviation.mean(axis=1, keepdims=True)
    bands = deviation.shape[1]
    within = float(np.sqrt(np.mean(agreement.spread**2)))
    return SceneErrors(float(np.sqrt(np.sum(grey**2) / freedom)),
                       float(np.sqrt(np.sum((deviation - grey) ** 2)
                                     / (freedom * max(bands - 1, 1)))),
                       within * within_to_block(regions, len(deviation)),
                       float(np.median(np.sqrt(np.mean(agreement.spread**2, axis=1)))))


def within_to_block(regions: int, surfaces: int) -> float:
    """Factor from the scatter within a surface to that of a block whose errors count as
    independent, so that all blocks of a surface weigh as much as the terms of a quadratic field.
    """
    return float(np.sqrt(max(regions / surfaces / FIELD_TERMS, 1.0)))


def model_covariance(agreement: scenes.SurfaceAgreement, material: str, known: frozenset[str],
                     stated_error: float,
                     taken: np.ndarray | float = 1.0) -> np.ndarray:
    """Relative covariance (K, K) of one material's signal by which photo and model disagree.

    Three parts: the scatter between the scene's surfaces, divided by the number of this material's;
    the second moment of its own mean log(photo / rendering), which its signal does not absorb; and
    the scatter within its surfaces, which is not divided by the number of pixels, since the errors
    of neighbours are correlated.

    Parameters
    ----------
    agreement : SurfaceAgreement
    material : str
        One without usable surfaces gets zeros.
    known : names of the materials whose spectrum was given
    stated_error : float
        Standard deviation of a surface's log brightness in each band, before any is seen.
    taken : (K,) array, optional
        The signal that is taken for the material over that of the rendering: a rendering of the
        most probable spectrum is off by what the prior on spectra pulls, which is no disagreement.
    """
    own = [index for index, name in enumerate(agreement.materials) if name == material]
    if not own:
        return np.zeros((agreement.ratio.shape[1],) * 2)
    weight = agreement.pixels[own] / agreement.pixels[own].sum()
    mean = weight @ np.log(agreement.ratio[own]) - np.log(taken)
    within = np.einsum("s,sk,sl->kl", weight, agreement.spread[own], agreement.spread[own])
    between = surface_covariance(agreement, known, stated_error)
    return between / len(own) + np.outer(mean, mean) + within


def scale_from_surfaces(measured: np.ndarray, rendered: np.ndarray, surface: np.ndarray,
                        source: str) -> calibration.LightScale:
    """Light scale from the sums over each surface of known spectrum.

    Every band of every surface has the same weight. Sums, not pixels: a fit to single pixels is
    biased by the noise of the rendering.

    Parameters
    ----------
    measured, rendered : (H, W, K) signal
    surface : (H, W) int
        Index of the surface, -1 where a pixel does not count.
    source : str
        Where the scale comes from, in words, for the record.
    """
    return light_scale.scale_from_signals(surface_sums(measured, surface),
                                          surface_sums(rendered, surface), SCALE_ERROR, source)


def surface_sums(image: np.ndarray, surface: np.ndarray) -> np.ndarray:
    """Sums (S, K) of an image (H, W, K) over each surface (H, W), -1 where a pixel does not count.
    """
    mask = surface >= 0
    members = np.unique(surface[mask], return_inverse=True)[1]
    return np.stack([np.bincount(members, image[mask][:, band]) for band in range(image.shape[2])],
                    axis=1)


def _block_spread(measured: np.ndarray, variance: np.ndarray, renderings: np.ndarray,
                  mask: np.ndarray) -> np.ndarray:
    """Standard deviation (K,) of log(photo / rendering) over blocks, without the noise of the
    photo and of several renderings.

    Of several renderings it is the root of the ratios' covariance between any two of them, which
    their noise does not enter. What the noise of the photo's pixels, taken for independent, adds to
    the logarithm of a block's sum is subtracted. 0 where the rest is negative, or where there are
    fewer than two blocks.
    """
    row, column = np.nonzero(mask)
    block = (row // BLOCK) * (mask.shape[1] // BLOCK + 1) + column // BLOCK
    _, member, count = np.unique(block, return_inverse=True, return_counts=True)
    full = count >= BLOCK
    if full.sum() < 2:
        return np.zeros(measured.shape[2])
    blocks = np.full(mask.shape, -1)
    blocks[mask] = member
    sums, *models = (np.maximum(surface_sums(image, blocks)[full], 1e-12)
                     for image in (measured, *renderings))
    noise = surface_sums(variance, blocks)[full] / sums**2         # (B, K) of the logarithm
    deviation = np.log(sums) - np.log(models)               # (A, B, K)
    deviation -= deviation.mean(axis=1, keepdims=True)
    passes = len(models)
    own, whole = (deviation**2).sum(axis=0), deviation.sum(axis=0) ** 2
    product = own if passes == 1 else (whole - own) / (passes * (passes - 1))
    # of the squared deviation from the mean of B blocks, B - 1 parts are the noise's own
    return np.sqrt(np.maximum(product.sum(axis=0) / (full.sum() - 1) - noise.mean(axis=0), 0.0))


def edge_shift(measured: np.ndarray,
               rendered: np.ndarray) -> tuple[tuple[float, float], np.ndarray]:
    """Shift (x, y) in pixels of photo against rendering, and the correlation of their edges.

    The correlation (H, W) is that for every cyclic shift of the rendering, -1 to 1. Its peak is
    refined by a parabola; a rendering of another scene gives a number without meaning:
    ``shifted`` reports only a shift by which the edges agree better.

    Parameters
    ----------
    measured, rendered : (H, W, K) signal
    """
    edges = np.zeros((2, *measured.shape[:2]))      # their strength, without the frame's
    for strength, image in zip(edges, (measured, rendered), strict=True):
        grey = np.log(np.maximum(image.mean(axis=2), 1e-3 * np.percentile(image, 95)))
        strength[1:-1, 1:-1] = np.hypot(grey[2:, 1:-1] - grey[:-2, 1:-1],
                                        grey[1:-1, 2:] - grey[1:-1, :-2])
    a, b = edges - edges.mean(axis=(1, 2), keepdims=True)
    size = np.linalg.norm(a) * np.linalg.norm(b)
    correlation = np.fft.ifft2(np.fft.fft2(a) * np.conj(np.fft.fft2(b))).real
    correlation = correlation / (size if size else 1.0)
    peak = np.unravel_index(np.argmax(correlation), correlation.shape)
    shifts = []
    for axis in (1, 0):
        line = np.take(correlation, peak[1 - axis], axis=1 - axis)
        size, index = line.size, int(peak[axis])
        left, middle, right = line[index - 1], line[index], line[(index + 1) % size]
        bend = left - 2 * middle + right
        fine = 0.5 * (left - right) / bend if bend else 0.0
        shifts.append(float((index + fine + size / 2) % size - size / 2))
    return (shifts[0], shifts[1]), correlation


def shifted(measured: np.ndarray, rendered: np.ndarray) -> list[findings.Finding]:
    """By how much the photo is shifted against its scene, where the edges agree clearly better so.

    Parameters
    ----------
    measured, rendered : (H, W, K) signal
    """
    (right, down), correlation = edge_shift(measured, rendered)
    best = correlation.max()
    if (np.hypot(right, down) < MIN_SHIFT or best < MIN_CORRELATION
            or best - correlation[0, 0] < MIN_GAIN):
        return []
    return [findings.Finding("scene.shifted", findings.Severity.NOTE, values={
        "right_px": float(right), "down_px": float(down), "width_px": measured.shape[1],
        "correlation": float(best), "unmoved": float(correlation[0, 0])})]
