"""Sensitivities from one simulated chart photo: every method against the paper's fit, in one
process.

Leave one camera out over a folder of measured cameras: the prior is built from the others, the
left-out camera photographs 24 BabelColor patches under a CIE light with noise proportional to the
signal, and every method fits that photo. The error of a camera is the relative RMSE of each curve,
scaled to the green maximum, mean of the bands; tables give the median over cameras. "coverage" is
the share of wavelengths and bands at which the pointwise 90 % band holds the true curve. The
constants of the prior were chosen on these same cameras, so its figures are
optimistic by an unmeasured amount.
"""
from __future__ import annotations

import argparse
import json
import time
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from spectrabox.calibrate.chart_equations import ChartEquations, field_terms
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.prior.curve_posterior import draw_curves
from spectrabox.calibrate.prior.learnt_prior import (
    CameraDatabase,
    build_prior,
    read_camera_database,
)
from spectrabox.calibrate.sensitivity import fit_sensitivities, fit_with_prior
from spectrabox.radiometry.chart import CLASSIC, chart_reflectances
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.spectra.named_spectra import light
from spectrabox.radiometry.spectra.spectrum_files import on_grid

GRID = visible_grid()
CELLS = (("D65", 0.005), ("D65", 0.02), ("LED-B3", 0.005), ("LED-B3", 0.02), ("A", 0.02))
TARGETS = (0.030, 0.050, 0.038, 0.050, 0.050)
METHODS = ("paper", "nonnegative", "smooth", "prior")
FLOOR = 0.02  # of the maximum: the noise that is stated never falls below that of so dark a patch
FALL_OFF, GLARE = 0.2, 0.01
SECOND_LIGHT = "D65"


class Shot(NamedTuple):
    """One simulated photo: signals and variances (24, K), light (P,)."""

    signal: np.ndarray
    variance: np.ndarray
    power: np.ndarray


def curve_error(curves: np.ndarray, truth: np.ndarray) -> float:
    """Relative RMSE of each curve (K, P) scaled to the green maximum, mean of the bands."""
    ours, theirs = curves / curves[1].max(), truth / truth[1].max()
    return float(np.sqrt(((ours - theirs) ** 2).sum(axis=1) / (theirs**2).sum(axis=1)).mean())


def photograph(truth: np.ndarray, reflectances: np.ndarray, power: np.ndarray, noise: float,
               rng: np.random.Generator, distort: bool) -> tuple[np.ndarray, np.ndarray]:
    """Signals (24, 3) and their variances."""
    signal = reflectances @ (truth * power * GRID.weights_nm).T
    if distort:
        across = CLASSIC.centres_uv[:, 0]
        across = (across - across.min()) / np.ptp(across)
        signal = signal * (1 - FALL_OFF * across)[:, None] + GLARE * signal.max(axis=0)
    variance = (noise * np.maximum(signal, FLOOR * signal.max(axis=0))) ** 2
    return signal + noise * signal * rng.standard_normal(signal.shape), variance


def others(database: CameraDatabase, left_out: int, by_brand: bool) -> CameraPrior:
    """Prior without one camera, or without every camera of its maker."""
    maker = [name.split()[0] for name in database.names]
    keep = [index for index in range(len(maker))
            if (maker[index] != maker[left_out] if by_brand else index != left_out)]
    return build_prior(database.nm, database.curves[keep],
                       tuple(database.names[index] for index in keep), source="benchmark",
                       licence="")


def fit_one(method: str, shots: list[Shot], reflectances: np.ndarray, prior: CameraPrior | None,
            with_field: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Curves and their 90 % band, (K, P) each; methods other than ``prior`` see the first photo
    only.
    """
    covariances = [np.einsum("ik,kl->ikl", shot.variance, np.eye(shot.signal.shape[1]))
                   for shot in shots]
    if method == "prior":
        terms = field_terms(CLASSIC.centres_uv) if with_field else np.zeros((24, 0))
        photos = [ChartEquations(shot.signal, covariance, reflectances,
                                 shot.power * GRID.weights_nm, np.full(24, np.pi), terms,
                                 glare=with_field)
                  for shot, covariance in zip(shots, covariances, strict=True)]
        found = fit_with_prior(photos, prior, GRID)
        draws = draw_curves(found.posterior, len(found.sensitivity.curves), 400, seed=0)
        lower, upper = np.quantile(draws, [0.05, 0.95], axis=0)
        return found.sensitivity.curves, lower, upper
    first = shots[0]
    zero = np.zeros(first.signal.shape)
    samples = PatchSamples(first.signal, covariances[0], np.ones(24), zero, zero)
    fit, _, _ = fit_sensitivities(samples, reflectances, first.power, np.full(24, np.pi), GRID,
                                  method=method)
    assert fit.standard_error is not None
    half_width = 1.645 * fit.standard_error
    return fit.curves, fit.curves - half_width, fit.curves + half_width


def transfer_error(curves: np.ndarray, truth: np.ndarray, reflectances: np.ndarray,
                   power: np.ndarray) -> float:
    """Relative rms error of the RGB of reflectances (n, P) under a light (P,), each band relative
    to white.
    """
    response = GRID.weights_nm * power
    seen, true = (reflectances @ (bands * response).T / (bands @ response)
                  for bands in (curves, truth))
    return float(np.sqrt(np.mean((seen - true) ** 2) / np.mean(true**2)))


def run(database: CameraDatabase, reflectances: np.ndarray, lights: tuple[str, ...], noise: float,
        methods: tuple[str, ...], *, by_brand: bool = False, stated: bool = True,
        with_field: bool = False, distort: bool = False,
        surfaces: np.ndarray | None = None) -> dict[str, dict[str, float]]:
    """Medians and coverage of every method over the cameras of the database."""
    powers, other = [light(name, GRID) for name in lights], light("A", GRID)
    rng = np.random.default_rng(20)
    found: dict[str, list[tuple[float, float, float, float]]] = {method: [] for method in methods}
    for camera, curves in enumerate(database.curves):
        truth = on_grid(database.nm, curves / curves.max(), GRID, database.names[camera])
        shots = []
        for power in powers:
            signal, variance = photograph(truth, reflectances, power, noise, rng, distort)
            shots.append(Shot(signal, variance if stated else 0 * variance, power))
        prior = others(database, camera, by_brand)
        for method in methods:
            start = time.perf_counter()
            fitted, lower, upper = fit_one(method, shots, reflectances, prior, with_field)
            seconds = time.perf_counter() - start
            inside = float(np.mean((truth >= lower - 1e-9) & (truth <= upper + 1e-9)))
            transfer = transfer_error(fitted, truth, surfaces,
                                      other) if surfaces is not None else 0.0
            found[method].append((curve_error(fitted, truth), inside, transfer, seconds))
    return {method: {"error": float(np.median([row[0] for row in rows])),
                     "mean_error": float(np.mean([row[0] for row in rows])),
                     "coverage": float(np.mean([row[1] for row in rows])),
                     "transfer": float(np.median([row[2] for row in rows])),
                     "seconds": float(np.median([row[3] for row in rows]))}
            for method, rows in found.items()}


def read_surfaces(folder: Path) -> np.ndarray:
    """The 190 training reflectances of rawtoaces, (190, P)."""
    rows = json.loads((folder / "reflectance" / "rawtoaces190"
                       / "rawtoaces190.json").read_text(encoding="utf-8"))
    table = rows["spectral_data"]["data"]["main"]
    return on_grid(np.array([float(nm) for nm in table]), np.array(list(table.values())).T, GRID,
                   "rawtoaces190")


def measure(folder: Path) -> dict[str, Any]:
    """Every figure."""
    database = read_camera_database(folder / "cameras")
    reflectances = chart_reflectances("BabelColor Average", GRID)
    cells = [{"light": name, "noise": noise, "target": target,
              **run(database, reflectances, (name,), noise, METHODS)}
             for (name, noise), target in zip(CELLS, TARGETS, strict=True)]
    only, led = ("prior",), ("LED-B3",)
    transfer = run(database, reflectances, led, 0.01, ("paper", "prior"),
                   surfaces=read_surfaces(folder))
    return {"cameras": len(database.names), "cells": cells, "transfer": transfer,
            "brand_out": run(database, reflectances, led, 0.01, ("paper", "prior"), by_brand=True),
            "noise_not_stated": [{"light": name, "noise": noise,
                                  **run(database, reflectances, (name,), noise, only, stated=False)}
                                 for name, noise in CELLS],
            "flat": run(database, reflectances, led, 0.01, only, with_field=True),
            "fall_off_and_glare": run(database, reflectances, led, 0.01, ("paper", "prior"),
                                      with_field=True, distort=True),
            "one_light": run(database, reflectances, led, 0.02, only),
            "twice_one_light": run(database, reflectances, led * 2, 0.02, only),
            "two_lights": run(database, reflectances, ("LED-B3", SECOND_LIGHT), 0.02, only)}


def print_table(figures: dict[str, Any]) -> None:
    print(f"median relative RMSE of the curves over {figures['cameras']} cameras, each left out in "
          "turn")
    print(f"{'light, noise':<16}" + "".join(f"{method:>13}" for method in METHODS)
          + f"{'to reach':>10}{'paper/prior':>13}{'coverage':>10}{'of smooth':>11}{'s a fit':>9}")
    for cell in figures["cells"]:
        name = f"{cell['light']} {cell['noise']:.1%}"
        print(f"{name:<16}" + "".join(f"{cell[method]['error']:13.4f}" for method in METHODS)
              + f"{cell['target']:10.3f}{cell['paper']['error'] / cell['prior']['error']:13.1f}"
              f"{cell['prior']['coverage']:10.3f}{cell['smooth']['coverage']:11.3f}"
              f"{cell['prior']['seconds']:9.2f}")
    for title, key in (("whole brand left out, LED-B3 1 %", "brand_out"),
                       ("transfer LED-B3 1 % to A", "transfer"),
                       ("field and glare allowed, none there", "flat"),
                       (f"fall-off {FALL_OFF:.0%} and glare {GLARE:.0%}", "fall_off_and_glare")):
        figure = "transfer" if key == "transfer" else "error"
        print(f"{title:<38}" + "  ".join(f"{method} {row[figure]:.4f} (coverage "
                                         f"{row['coverage']:.3f})"
                                         for method, row in figures[key].items()))
    ratio = figures["fall_off_and_glare"]["prior"]["error"] / figures["flat"]["prior"]["error"]
    print(f"{'distorted / flat':<38}{ratio:.2f}")
    for row in figures["noise_not_stated"]:
        print(f"noise not stated, {row['light']} {row['noise']:.1%}: error "
              f"{row['prior']['error']:.3f}, coverage {row['prior']['coverage']:.3f}")
    for title, key in (("LED-B3 2 %, one photo", "one_light"),
                       ("two photos under LED-B3", "twice_one_light"),
                       (f"a second photo under {SECOND_LIGHT}", "two_lights")):
        print(f"{title:<38}prior {figures[key]['prior']['error']:.4f} (mean "
              f"{figures[key]['prior']['mean_error']:.4f}, coverage "
              f"{figures[key]['prior']['coverage']:.3f})")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True,
                        help="folder with cameras/ and reflectance/rawtoaces190/")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the tables")
    arguments = parser.parse_args()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        figures = measure(arguments.data)
    if arguments.json:
        print(json.dumps(figures))
    else:
        print_table(figures)


if __name__ == "__main__":
    main()
