"""Signals of spectra that the prior was not learnt from, as ``spectrabox.sample`` explains them.

Nine sets by other formulas than those of the prior (other_surfaces.py), and the published sets that
colour-science ships; each set is one case, the mean over its surfaces. Errors are shares of the
signal: the greater part common to all bands, as of a level, the rest of each band, and they
multiply, as such errors do. Each with nothing stated of the surfaces, and with their family.
"""
from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import spectrabox as sb
from spectrabox.radiometry.chart import REFERENCES
from spectrabox.radiometry.grid import FINE_GRID, grid_from_nm
from spectrabox.radiometry.spectra.named_spectra import relative_response, test_reflectances

from benchmarks import other_surfaces
from benchmarks.ledger.task import Task

CAMERA, LIGHT = "Nikon 5100 (NPL)", "D65"
ERRORS = {"0.5 %": 0.005, "5 %": 0.05, "30 %": 0.3}
COMMON, OWN = 0.8, 0.6          # shares of an error: of all bands alike, of each band
NOISE = 0.0005                  # of white, besides
SURFACES, SEED = 30, 26
FAMILIES = {make.__name__: (make, family) for make, family in other_surfaces.OTHERS.items()}
PUBLISHED = tuple(name for name in test_reflectances(grid_from_nm(other_surfaces.NM))
                  if name not in REFERENCES)


def tasks(data: Path | None) -> Iterator[Task]:
    """One task for each set of surfaces, error, and statement."""
    for words in ERRORS:
        for name in (*FAMILIES, *PUBLISHED):
            yield Task(f"signals/error {words}", name, explained, (name, words, False))
        for name in FAMILIES:
            yield Task(f"signals/error {words}, family stated", name, explained,
                       (name, words, True))


def explained(name: str, words: str, stated: bool) -> dict[str, float]:
    """What bands of one set of surfaces hold, their RMSE and width."""
    truth, error = surfaces_of(name), ERRORS[words]
    rng = np.random.default_rng([SEED, len(name), *name.encode()])
    fine = np.array([np.interp(FINE_GRID.nm, other_surfaces.NM, one) for one in truth])
    clean = fine @ relative_response(CAMERA, LIGHT, FINE_GRID).T
    off = COMMON * rng.standard_normal((len(clean), 1)) + OWN * rng.standard_normal(clean.shape)
    signals = clean * np.exp(error * off) + NOISE * rng.standard_normal(clean.shape)
    found = sb.sample(np.maximum(signals, NOISE), camera=CAMERA, light=LIGHT,
                      noise=np.full(clean.shape[1], NOISE), white=np.ones(clean.shape[1]),
                      light_error=COMMON * error, sensitivity_error=OWN * error,
                      families=FAMILIES[name][1] if stated else None)
    rows = []
    for estimate, one in zip(found.values(), truth, strict=True):
        lower, upper = estimate.band(0.95)
        true = np.interp(estimate.nm, other_surfaces.NM, one)
        rows.append((np.mean((lower <= true) & (true <= upper)),
                     np.sqrt(np.mean((estimate.mean - true)**2)), np.mean(upper - lower)))
    return dict(zip(("held", "RMSE", "width"), np.mean(rows, axis=0).tolist(), strict=True))


def surfaces_of(name: str) -> np.ndarray:
    """Reflectances (n, P) at ``other_surfaces.NM`` of one set."""
    if name in FAMILIES:
        drawn = FAMILIES[name][0](np.random.default_rng(SEED), SURFACES)
        return np.clip(drawn, 0.005, 0.99)
    published = test_reflectances(grid_from_nm(other_surfaces.NM))[name]
    kept = published[np.all((published > 0) & (published < 1), axis=1)]
    return kept[:: max(1, len(kept) // SURFACES)][:SURFACES]
