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

from collections.abc import Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True)
class SurfaceTest:
    """One surface in one band."""

    surface: str
    band: int
    kind: str               # "level" or "shape"
    deviation: float        # level: photo / rendering - 1; shape: scatter of the blocks
    expected: float         # standard deviation that noise and stated errors explain
    p: float
    # Holm's: below the chance of a false alarm that one accepts, the surface does not fit
    adjusted: float
    # of the block that is farthest off: photo / rendering - 1, less CERTAIN standard errors of
    # noise, 0 where noise explains it
    worst_part: float

    @property
    def fits(self) -> bool:
        """False where the deviation is beyond chance, at ``FALSE_ALARM`` over the whole scene."""
        return self.adjusted >= FALSE_ALARM or abs(self.deviation) < MIN_SHOWN


def surface_tests(names: Sequence[str], measured: np.ndarray, rendered: np.ndarray,
                  surface: np.ndarray, used: np.ndarray,
                  surface_error: float) -> tuple[SurfaceTest, ...]:
    """Tests of every surface that has enough usable pixels, in all bands.

    Parameters
    ----------
    names : one for each index in ``surface``
    measured, rendered : (H, W, K) signal
    surface : (H, W) int
    used : (H, W) bool
    surface_error : float
        Standard deviation of the log brightness of a surface by which scene and photo may differ.
    """
    from scipy.special import chdtrc, ndtr

    tests: list[tuple[str, int, str, float, float, float]] = []
    parts: list[float] = []
    for index, name in enumerate(names):
        mask = used & (surface == index)
        if mask.sum() < MIN_PIXELS or not np.all(rendered[mask].sum(axis=0) > 0):
            continue
        for band in range(measured.shape[2]):
            photo, model = measured[..., band], rendered[..., band]
            ratio = photo[mask].sum() / model[mask].sum()
            noise = _relative_noise(photo, model * ratio, mask)
            level = np.hypot(noise / np.sqrt(mask.sum()), surface_error)
            score = np.log(ratio) / level if level > 0 else np.inf
            tests.append((name, band, "level", float(ratio - 1), float(level),
                          float(2 * ndtr(-abs(score)))))
            blocks, pixels = _blocks(photo, model * ratio, mask)
            deviation, error = ratio * (1 + blocks) - 1, ratio * noise / np.sqrt(pixels)
            certain = np.sign(deviation) * np.maximum(np.abs(deviation) - CERTAIN * error, 0)
            parts.append(float(max(certain, key=abs, default=0.0)))
            if len(blocks) > 1:
                variance = noise**2 / pixels + SHAPE_ERROR**2
                centre = np.sum(blocks / variance) / np.sum(1 / variance)
                p = chdtrc(len(blocks) - 1, np.sum((blocks - centre) ** 2 / variance))
                tests.append((name, band, "shape", float(blocks.std(ddof=1)),
                              float(np.sqrt(variance.mean())), float(p)))
                parts.append(parts[-1])
    adjusted = holm(np.array([row[-1] for row in tests]))
    return tuple(SurfaceTest(*row, adjusted=float(p), worst_part=part)
                 for row, p, part in zip(tests, adjusted, parts, strict=True))


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


def surface_misfits(tests: Sequence[SurfaceTest],
                    bands: Sequence[str]) -> tuple[Finding, ...]:
    """The surfaces on which photo and rendering differ beyond chance and beyond what was stated,
    worst first.

    Parameters
    ----------
    tests : sequence of SurfaceTest
        All of the scene.
    bands : K names

    Returns
    -------
    tuple of Finding
        About each surface: ``value``, the size of its largest deviation; ``level``, photo /
        rendering - 1 of the surface by band; ``scatter`` of its parts among themselves, None where
        it is by chance; ``part``, photo / rendering - 1 of the part that deviates most, None where
        something else does more; and ``p`` after Holm's correction.
    """
    wrong = [test for test in tests if not test.fits]
    worst_part: dict[str, float] = {}
    for test in tests:
        worst_part[test.surface] = max(worst_part.get(test.surface, 0.0), test.worst_part, key=abs)
    by_surface: dict[str, list[SurfaceTest]] = {}

    def severity(test: SurfaceTest) -> tuple[float, float]:
        return test.adjusted, -abs(test.deviation) / max(test.expected, 1e-12)

    for test in sorted(wrong, key=severity):
        by_surface.setdefault(test.surface, []).append(test)
    misfits = []
    for surface, own in by_surface.items():
        level = {bands[test.band]: test.deviation
                 for test in sorted(own, key=lambda test: test.band) if test.kind == "level"}
        scatter = max((test.deviation for test in own if test.kind == "shape"), default=None)
        part = worst_part[surface]
        largest = max((*(test.deviation for test in own), part), key=abs)
        misfits.append(Finding("scene.misfit", Severity.WARN, surface, {
            "value": abs(largest), "level": level, "scatter": scatter,
            "part": part if largest == part else None,
            "p": min(test.adjusted for test in own)}))
    return tuple(misfits)


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
