"""Identification in libraries of measured spectra: how often the truth is counted among what may be
it, how many cannot be told from it, and what is said where it is missing.

Every signal is that of a spectrum of the library, changed as another sample of that material may be
(the stated variation), with 1 % of noise in every band. The libraries are read as ``spectrabox
match`` reads them and judged by what it calls: three published ones, and those of ``--data``, a
folder with ``reflectance/``. Cases of the truth missing leave it out of the library.
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.measure.matching import LIKELY_NONE, SpectralLibrary
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import SpectralMeasurement
from spectrabox.radiometry.response import response_matrix, white_signal
from spectrabox.radiometry.spectra.named_spectra import light, sensitivities
from spectrabox.sampling.judge.identification import ALIKE_NM, VARIATION, identify
from spectrabox.sampling.prior.mixture import load_prior
from spectrabox.session.signals.spectral_library import read_spectral_libraries

GRID = visible_grid(5)
CAMERA, LIGHTS = "Nikon 5100 (NPL)", ("D65", "A")
NOISE = 0.01                # relative, of every band
PUBLISHED = ("BabelColor Average", "NIST CQS test colours", "CES99")
MEASURED = ("usgs_minerals", "ntu_watercolour", "cassava")


def response(lights: tuple[str, ...]) -> np.ndarray:
    """Response (3 each light, P), rows summing to 1."""
    matrix = np.vstack([response_matrix(GRID, sensitivities(CAMERA, GRID), light(name, GRID))
                        for name in lights])
    return np.asarray(matrix / white_signal(matrix)[:, None])


def judged(library: SpectralLibrary, lights: tuple[str, ...], cases: int, seed: int,
           variation: float) -> dict[str, Any]:
    """Figures of one library under one or two lights."""
    rng, prior, seen = np.random.default_rng(seed), load_prior(), response(lights)
    distance = GRID.nm[:, None] - GRID.nm
    alike = variation**2 * np.exp(-distance**2 / (2 * ALIKE_NM**2))
    count = len(library.names)
    counted, first, told, refused = [], [], [], []
    for truth in rng.choice(count, min(cases, count), replace=False):
        sample = np.clip(library.spectra[truth] + rng.multivariate_normal(
            np.zeros(GRID.nm.size), alike, method="eigh"), 0, 1)
        exact = seen @ sample
        signal = exact * (1 + NOISE * rng.standard_normal(exact.size))
        measurement = SpectralMeasurement(GRID, seen, signal, np.diag((NOISE * signal) ** 2))
        found = identify(measurement, library.spectra, prior, variation=variation)
        counted.append(found.indistinguishable[truth])
        first.append(np.argmax(found.log_evidence) == truth)
        told.append(found.indistinguishable.sum())
        without = identify(measurement, np.delete(library.spectra, truth, axis=0), prior,
                           variation=variation)
        refused.append(not without.indistinguishable.any()
                       or without.probability_of_none > LIKELY_NONE)
    return {"spectra": count, "bands": len(seen), "cases": len(counted),
            "truth_counted": float(np.mean(counted)), "truth_first": float(np.mean(first)),
            "may_be_it": float(np.median(told)), "may_be_it_90": float(np.quantile(told, 0.9)),
            "none_said_without_it": float(np.mean(refused))}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--data", type=Path, help="folder with reflectance/")
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--variation", type=float, default=VARIATION)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    words = [*PUBLISHED, *([str(asked.data / "reflectance" / name) for name in MEASURED]
                           if asked.data else [])]
    rows = []
    for word in words:
        library = read_spectral_libraries([word], GRID)
        for lights in (LIGHTS[:1], LIGHTS):
            rows.append({"library": Path(word).name, **judged(library, lights, asked.cases,
                                                              asked.seed, asked.variation)})
    if asked.json:
        print(json.dumps(rows))
        return
    print(" | ".join(rows[0]))
    for each in rows:
        print(" | ".join(f"{value:.3g}" if isinstance(value, float) else str(value)
                         for value in each.values()))


if __name__ == "__main__":
    main()
