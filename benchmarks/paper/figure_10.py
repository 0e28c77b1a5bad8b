"""Figure 10: chart photo and light to camera sensitivities, as published and with a prior of
measured cameras.

A chart photo is simulated with measured curves (Nikon 5100, National Physical Laboratory) under
LED-B3 with 1 % noise per patch: 24 BabelColor reflectances. The published fit has 10 spline
coefficients a band, zero at 400 and 700 nm (Eqs. 18-20); the prior was learnt on other bodies, see
docs/explanation/calibration.md. Both reproduce the photo of the chart, which says nothing about the
curves.
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.camera_curves import curve_band, curve_draws
from spectrabox.calibrate.chart_calibration import (
    ChartCalibration,
    calibrate_chart,
)
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.grid import grid_from_nm, visible_grid
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.named_spectra import light, sensitivities

GRID = visible_grid()
CAMERA, LIGHT, NOISE, PHOTOS = "Nikon 5100 (NPL)", "LED-B3", 0.01, 8
METHODS = ("paper", "nonnegative", "smooth", "prior")
COLOURS = ("tab:red", "tab:green", "tab:blue")


def photographed(curves: np.ndarray, reflectances: np.ndarray, power: np.ndarray,
                 seed: int) -> PatchSamples:
    """Signals of the chart with their noise, stated."""
    signal = reflectances @ (curves * power * GRID.weights_nm).T
    signal /= signal.max()
    noisy = signal * (1 + NOISE * np.random.default_rng(seed).standard_normal(signal.shape))
    covariance = np.einsum("ik,kl->ikl", (NOISE * signal)**2, np.eye(3))
    return PatchSamples(noisy, covariance, np.full(24, 100), np.zeros((24, 3)), np.zeros((24, 3)))


def to_green(curves: np.ndarray) -> np.ndarray:
    """Curves with the largest green value 1: the exposure cannot be known from a chart alone."""
    return curves / curves[1].max()


def judged(found: ChartCalibration, truth: np.ndarray, samples: PatchSamples) -> dict[str, float]:
    """Relative RMSE of the curves, coverage of the 90 % band, misfit of the photo, CIEDE2000 of
    held-out patches.
    """
    curves, band = found.calibration.sensitivity.curves, curve_band(found, curve_draws(found))
    ours, theirs = to_green(curves), to_green(truth)
    assert band is not None
    scale = curves[1].max() / truth[1].max()
    inside = (scale * truth >= band[0]) & (scale * truth <= band[1])
    return {"error": float(np.sqrt(((ours - theirs)**2).sum(axis=1)
                                   / (theirs**2).sum(axis=1)).mean()),
            "coverage_90": float(inside.mean()),
            "photo": float(np.sqrt(np.mean((found.predicted / samples.mean - 1)**2))),
            "held_out_delta_e00": float(np.mean(found.held_out_delta_e))}


def picture(answers: dict[str, ChartCalibration], truth: np.ndarray, power: np.ndarray,
            samples: PatchSamples,
            path: Path) -> None:
    """The light, the curves of both methods against the truth, and the chart as photographed and as
    predicted.
    """
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 4, figsize=(13, 3.2))
    axes[0].plot(GRID.nm, power / power.max(), color="black")
    axes[0].set(title=LIGHT, xlabel="wavelength (nm)")
    for axis, method in zip(axes[1:], ("paper", "prior"), strict=False):
        curves = answers[method].calibration.sensitivity.curves
        band_of = curve_band(answers[method], curve_draws(answers[method]))
        scale = truth[1].max() / curves[1].max()
        assert band_of is not None
        lower, upper = band_of
        for band, colour in enumerate(COLOURS):
            axis.fill_between(GRID.nm, scale * lower[band], scale * upper[band],
                              color=colour, alpha=0.2)
            axis.plot(GRID.nm, scale * curves[band], color=colour, linestyle="--")
            axis.plot(GRID.nm, truth[band], color=colour)
        axis.set(title=f"{method}: fit (dashed), measured", xlabel="wavelength (nm)",
                 ylim=(-0.1, 1.3))
    white = samples.mean[18]
    shown = [(one / white).clip(0, 1)**(1 / 2.2) for one in (samples.mean,
                                                             answers["prior"].predicted)]
    rows = [np.repeat(np.repeat(one.reshape(4, 6, 3), 10, axis=0), 10, axis=1) for one in shown]
    axes[3].imshow(np.concatenate([rows[0], np.ones((5, 60, 3)), rows[1]]))
    axes[3].set(title="photo; below it, predicted (prior)", xticks=[], yticks=[])
    figure.tight_layout()
    figure.savefig(path, dpi=80)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("figure_10.png"))
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    truth, power = sensitivities(CAMERA, GRID), light(LIGHT, GRID)
    reflectances = chart_reflectances("BabelColor Average", GRID)
    lamp = Spectrum(grid_from_nm(GRID.nm), power, Quantity.RELATIVE, LIGHT)
    found: dict[str, list[dict[str, float]]] = {method: [] for method in METHODS}
    for seed in range(PHOTOS):
        samples = photographed(truth, reflectances, power, seed)
        answers = {method: calibrate_chart([ChartPhoto(samples, reflectances, lamp)], GRID,
                                           method)
                   for method in METHODS}
        for method, answer in answers.items():
            found[method].append(judged(answer, truth, samples))
        if seed == 0:
            picture(answers, truth, power, samples, arguments.out)
    table: list[dict[str, Any]] = [{"method": method,
                                    **{key: float(np.mean([row[key] for row in rows]))
                                       for key in rows[0]}} for method, rows in found.items()]
    if arguments.json:
        print(json.dumps({"rows": table, "picture": str(arguments.out)}))
        return
    print(f"Paper: curves fitted to one chart photo, zero at both ends. {CAMERA}, {LIGHT}, mean of "
          f"{PHOTOS} photos:")
    print(f"{'method':<12} {'curve error':>11} {'90 % holds':>11} {'photo misfit':>13} "
          f"{'held-out dE00':>14}")
    for row in table:
        print(f"{row['method']:<12} {row['error']:11.3f} {row['coverage_90']:11.3f} "
              f"{row['photo']:13.4f} {row['held_out_delta_e00']:14.2f}")


if __name__ == "__main__":
    main()
