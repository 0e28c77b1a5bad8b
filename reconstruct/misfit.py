"""Which surfaces do not fit: tests of every surface and band, together wrong in at most one scene
of a hundred.

Two tests for each surface and band. Level: is the surface as a whole brighter or darker than the
rendering by more than its noise and the stated error of a surface explain (normal)? Shape: do its
blocks scatter more than noise and the stated error of the photo explain (chi-square), as a lamp in
the wrong position or vignetting makes them? The noise of photo and rendering together is read off
the median difference of neighbouring pixels, to which nothing smooth adds. A fit absorbs part of a
deviation, so the tests rather miss a misfit than invent one. Holm's correction (1979) bounds the
chance of any false alarm.
"""
from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.scenes import SurfaceAgreement

FALSE_ALARM = 0.01      # chance that a scene which fits is accused of anything
SHAPE_ERROR = 0.02      # relative error of a block besides its noise: pose, light profile, lens
BLOCK = 4               # pixels
MIN_PIXELS = 12         # of a surface, below which nothing is tested
CERTAIN = 3.0           # standard errors of noise that are taken off a block's deviation
MEDIAN_STEP = 0.6745 * 2**0.5   # median |difference of two| of normal noise of deviation 1
MANY = 3                # misfits, from which a common cause is looked for
COMMON = 0.75           # share of the squared deviations that a common cause explains
ALIKE = 0.3             # of the largest deviation: bands that differ by less are off alike
MIN_SHOWN = 0.005       # smaller deviations are left unsaid, however certain


def surface_tests(measured: np.ndarray, rendered: np.ndarray, masks: Sequence[np.ndarray],
                  surface_error: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Level and shape of every surface in every band; NaN where a surface has too few usable
    pixels, and in the shape of one that has a single block.

    Parameters
    ----------
    measured, rendered : (H, W, K) signal
    masks : sequence of S (H, W) bool arrays
        Usable pixels of each surface.
    surface_error : float
        Standard deviation of the log brightness of a surface by which scene and photo may differ.

    Returns
    -------
    deviation : (2, S, K) array
        Of the level, photo / rendering - 1; and the scatter of the blocks.
    expected : (2, S, K) array
        Standard deviation of both that noise and stated errors explain.
    p : (2, S, K) array
    """
    from scipy.special import chdtrc, ndtr

    deviation, expected, p = np.full((3, 2, len(masks), measured.shape[2]), np.nan)
    for index, mask in enumerate(masks):
        if mask.sum() < MIN_PIXELS or not np.all(rendered[mask].sum(axis=0) > 0):
            continue
        for band, (ratio, photo, model) in enumerate(_bands(measured, rendered, mask)):
            noise = _relative_noise(photo, model, mask)
            error = np.hypot(noise / np.sqrt(mask.sum()), surface_error)
            score = np.log(ratio) / error if error > 0 else np.inf
            level, shape = (0, index, band), (1, index, band)
            deviation[level], expected[level], p[level] = ratio - 1, error, 2 * ndtr(-abs(score))
            blocks, pixels = _blocks(photo, model, mask)
            if len(blocks) > 1:
                variance = noise**2 / pixels + SHAPE_ERROR**2
                centre = np.sum(blocks / variance) / np.sum(1 / variance)
                deviation[shape], expected[shape] = blocks.std(ddof=1), np.sqrt(variance.mean())
                p[shape] = chdtrc(len(blocks) - 1, np.sum((blocks - centre) ** 2 / variance))
    return deviation, expected, p


def holm(p: np.ndarray) -> np.ndarray:
    """Holm's adjusted p-values (T,), 0 to 1.

    Each is the chance of any false alarm at or below it, whatever the tests have in common (Holm
    1979).

    Parameters
    ----------
    p : (T,) array
        Of the single tests.
    """
    order = np.argsort(p)
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * (p.size - np.arange(p.size))),
                                 1.0)
    return adjusted


def surface_misfits(names: Sequence[str], bands: Sequence[str], measured: np.ndarray,
                    rendered: np.ndarray, masks: Sequence[np.ndarray],
                    surface_error: float) -> tuple[Finding, ...]:
    """The surfaces on which photo and rendering differ beyond chance and beyond what was stated,
    worst first.

    Parameters
    ----------
    names, bands : S and K names
    measured, rendered, masks, surface_error
        As of ``surface_tests``.

    Returns
    -------
    tuple of Finding
        About each surface: ``value``, the size of its largest deviation; ``level``, photo /
        rendering - 1 of the surface by band; ``scatter`` of its parts among themselves, None where
        it is by chance; ``part``, photo / rendering - 1 of the part that deviates most, None where
        something else does more; and ``p`` after Holm's correction.
    """
    deviation, expected, p = surface_tests(measured, rendered, masks, surface_error)
    tested = ~np.isnan(deviation)
    p[tested] = holm(p[tested])
    wrong = tested & ~(p >= FALSE_ALARM) & (np.abs(deviation) >= MIN_SHOWN)
    by_severity = np.lexsort((-np.abs(deviation[wrong]) / np.maximum(expected[wrong], 1e-12),
                              p[wrong]))
    misfits = []
    for index in dict.fromkeys(np.nonzero(wrong)[1][by_severity].tolist()):
        (level, shape), (off, scatter) = wrong[:, index], deviation[:, index]
        part = worst_part(measured, rendered, masks[index])
        largest = max((*off[level], *scatter[shape], part), key=abs)
        misfits.append(Finding("scene.misfit", Severity.WARN, names[index], {
            "value": float(abs(largest)),
            "level": {bands[band]: float(off[band]) for band in np.flatnonzero(level).tolist()},
            "scatter": float(scatter[shape].max()) if shape.any() else None,
            "part": part if largest == part else None,
            "p": float(p[:, index][wrong[:, index]].min())}))
    return tuple(misfits)


def worst_part(measured: np.ndarray, rendered: np.ndarray, mask: np.ndarray) -> float:
    """Photo / rendering - 1 of the block of a surface that is farthest off in any band, less
    ``CERTAIN`` standard errors of noise; 0 where noise explains it.

    Parameters
    ----------
    measured, rendered : (H, W, K) signal
    mask : (H, W) bool
        Usable pixels of the surface.
    """
    worst = 0.0
    for ratio, photo, model in _bands(measured, rendered, mask):
        blocks, pixels = _blocks(photo, model, mask)
        off = ratio * (1 + blocks) - 1
        error = ratio * _relative_noise(photo, model, mask) / np.sqrt(pixels)
        certain = np.sign(off) * np.maximum(np.abs(off) - CERTAIN * error, 0)
        worst = max((worst, *certain.tolist()), key=abs)
    return worst


def common_cause(agreement: SurfaceAgreement, misfits: Sequence[Finding],
                 bands: Sequence[str]) -> Finding | None:
    """What the deviations of many surfaces have in common; None of fewer than three misfits, or
    where less than half of the surfaces do not fit.

    Parameters
    ----------
    agreement : SurfaceAgreement
        Of the same photo.
    misfits : sequence of Finding
    bands : sequence of K str
    """
    log = np.log(agreement.ratio[(agreement.ratio > 0).all(axis=1)])
    if len(misfits) < MANY or 2 * len(misfits) < len(agreement.names) or not log.size:
        return None
    common = log.mean(axis=0)
    values = {"count": len(misfits), "compared": len(agreement.names)}
    if len(log) * (common**2).sum() < COMMON * (log**2).sum():
        return Finding("scene.each-by-its-own", Severity.WARN, values=values)
    if np.ptp(common) < ALIKE * np.abs(common).max():
        return Finding("scene.one-factor", Severity.WARN,
                       values=values | {"ratio": float(np.exp(common.mean()))})
    return Finding("scene.factor-of-bands", Severity.WARN, values=values | {
        "ratios": dict(zip(bands, np.exp(common).tolist(), strict=True))})


def _bands(measured: np.ndarray, rendered: np.ndarray,
           mask: np.ndarray) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """Of each band photo / rendering over a surface, and both (H, W), as bright there."""
    for photo, model in zip(np.moveaxis(measured, 2, 0), np.moveaxis(rendered, 2, 0), strict=True):
        ratio = photo[mask].sum() / model[mask].sum()
        yield ratio, photo, model * ratio


def _relative_noise(photo: np.ndarray, model: np.ndarray, mask: np.ndarray) -> float:
    """Standard deviation of photo - model, relative to the surface's mean, from neighbours'
    differences.
    """
    residual = photo - model
    across = (residual[:, 1:] - residual[:, :-1])[mask[:, 1:] & mask[:, :-1]]
    down = (residual[1:] - residual[:-1])[mask[1:] & mask[:-1]]
    steps = np.concatenate([across, down])
    if not steps.size:
        return 0.0
    # the median, to which the steps of a highlight do not add
    return float(np.median(np.abs(steps)) / MEDIAN_STEP / photo[mask].mean())


def _blocks(photo: np.ndarray, model: np.ndarray,
            mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Relative deviation (B,) of the blocks of a surface that have ``MIN_PIXELS`` pixels, and their
    pixels (B,).
    """
    row, column = np.nonzero(mask)
    member = np.unique((row // BLOCK) * mask.shape[1] + column // BLOCK,
                       return_inverse=True)[1].ravel()
    pixels = np.bincount(member)
    sums = [np.bincount(member, image[mask]) for image in (photo, model)]
    full = (pixels >= MIN_PIXELS) & (sums[1] > 0)
    # Relative to the surface's mean where a block is darker than it: noise does not shrink with the
    # light.
    scale = np.maximum(sums[1] / pixels, photo[mask].mean())[full]
    return ((sums[0] - sums[1]) / pixels)[full] / scale, pixels[full]
