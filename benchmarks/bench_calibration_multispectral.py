"""Cameras of many bands from one simulated chart photo: the joint estimate with a smoothness prior,
and ``smooth``.

Bands are lopsided bumps over a low pedestal, drawn at random; 24 BabelColor patches under a CIE
light, noise proportional to the signal, illumination and glare unknown to the joint estimate.
Errors are the relative RMSE of each curve, mean of bands and cameras; "holds" is the share of
wavelengths at which the 90 % band holds the true curve.
"""
from __future__ import annotations

import argparse
import json
import time
from typing import Any

import numpy as np

from spectrabox.calibrate.chart_equations import ChartEquations, field_terms
from spectrabox.calibrate.prior.curve_posterior import draw_curves
from spectrabox.calibrate.sensitivity import fit_sensitivities, fit_with_prior
from spectrabox.radiometry.chart import chart_reflectances, patch_centres_uv
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import PatchSamples
from spectrabox.radiometry.spectra.named_spectra import light

GRID = visible_grid()
BANDS = (5, 8, 16)
CELLS = (("D65", 0.005), ("LED-B3", 0.02))


def bumps(bands: int, rng: np.random.Generator) -> np.ndarray:
    """Curves (K, P) of largest value 1."""
    apart = GRID.nm - (np.linspace(425, 675, bands) + rng.normal(0, 4, bands))[:, None]
    width, skew = (max(12, 110 / bands) * rng.uniform(0.7, 1.3, (bands, 1)),
                   rng.uniform(0.7, 1.5, (bands, 1)))
    shape = np.exp(-0.5 * (apart / np.where(apart > 0, width * skew, width / skew)) ** 2)
    curves = rng.uniform(0.5, 1, (bands, 1)) * (shape + rng.uniform(0, 0.03, (bands, 1)))
    return curves / curves.max()


def judge(truth: np.ndarray, reflectances: np.ndarray, power: np.ndarray, noise: float,
          rng: np.random.Generator) -> tuple[float, ...]:
    """Error and coverage of the joint estimate, the same of ``smooth``, and seconds of the joint
    estimate.
    """
    signal = reflectances @ (truth * power * GRID.weights_nm).T
    signal = signal * (1 + noise * rng.standard_normal(signal.shape))
    covariance = np.einsum("ik,kl->ikl", (noise * signal) ** 2, np.eye(len(truth)))
    photo = ChartEquations(signal, covariance, reflectances, power * GRID.weights_nm,
                       np.full(24, np.pi), field_terms(patch_centres_uv()), True)
    start = time.perf_counter()
    found = fit_with_prior([photo], None, GRID)
    seconds = time.perf_counter() - start
    lower, upper = np.quantile(draw_curves(found.posterior, len(truth), 400, 0).curves,
                               [0.05, 0.95], axis=0)
    zero = np.zeros(signal.shape)
    plain, _, _ = fit_sensitivities(PatchSamples(signal, covariance, np.ones(24), zero, zero),
                                 reflectances, power, np.full(24, np.pi), GRID, method="smooth")
    assert plain.standard_error is not None
    return (_error(found.sensitivity.curves, truth),
            float(np.mean((truth >= lower) & (truth <= upper))), _error(plain.curves, truth),
            float(np.mean(np.abs(truth - plain.curves) < 1.645 * plain.standard_error)), seconds)


def _error(curves: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(((curves - truth) ** 2).sum(axis=1) / (truth**2).sum(axis=1)).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cameras", type=int, default=10, help="simulated cameras in each row")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    reflectances = chart_reflectances("BabelColor Average", GRID)
    rows: list[dict[str, Any]] = []
    for bands in BANDS:
        for name, noise in CELLS:
            rng = np.random.default_rng(3)
            power = light(name, GRID)
            judged = np.mean([judge(bumps(bands, rng), reflectances, power, noise, rng)
                              for _ in range(arguments.cameras)], axis=0)
            keys = ("error", "coverage", "smooth_error", "smooth_coverage", "seconds")
            rows.append({"bands": bands, "light": name, "noise": noise,
                         **dict(zip(keys, judged.tolist(), strict=True))})
    if arguments.json:
        print(json.dumps({"cameras": arguments.cameras, "rows": rows}))
        return
    print(f"{'bands':>5}{'light, noise':>16}{'joint':>8}{'holds':>7}{'smooth':>8}{'holds':>7}"
          f"{'s a fit':>9}")
    for row in rows:
        name = f"{row['light']} {row['noise']:.1%}"
        print(f"{row['bands']:5d}{name:>16}{row['error']:8.3f}{row['coverage']:7.3f}"
              f"{row['smooth_error']:8.3f}"
              f"{row['smooth_coverage']:7.3f}{row['seconds']:9.2f}")


if __name__ == "__main__":
    main()
