"""Figures 1 and 4: one spectrum from its colour, then with two more readings at 400 and 700 nm.

The paper ranks draws of its box by the readings (Eq. 9). Beside it: exact uniform draws and the learnt prior, which are
conditioned on the readings. Table of RMSE, standard deviation and coverage over the 24 chart colours.
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from radiometry.errors import ConvergenceError
from radiometry.grid import visible_grid
from radiometry.named_spectra import relative_response, test_reflectances
from sampling.conditioning import Reading, condition
from sampling.logit_mixture import GRID, load_prior
from sampling.methods import draw_spectra
from sampling.ranking import best_by_readings
from sampling.spectral_samples import SpectralMeasurement

FINE = visible_grid(1)
DRAWS, KEPT = 10_000, 1_000
COEFFICIENTS = 7


def draws_of(method: str, readings: bool, measurement: SpectralMeasurement, truth: np.ndarray) -> np.ndarray:
    """Draws (T, 61), the paper's ranked by the two readings, the others conditioned on them."""
    extra = [Reading.at_wavelength(nm, float(np.interp(nm, GRID.nm, truth)), 0.005) for nm in (400.0, 700.0)]
    if method == "paper":
        spectra = draw_spectra(measurement, "paper", DRAWS, 0, COEFFICIENTS).spectra
        return spectra[best_by_readings(spectra, np.array([0, 60]), truth[[0, 60]], KEPT)] if readings else spectra
    measured = condition(measurement, extra) if readings else measurement
    return draw_spectra(measured, method, 2000, 0, COEFFICIENTS, load_prior()).spectra


def rows() -> tuple[list[dict[str, Any]], dict[str, np.ndarray]]:
    """The table, and the draws of one colour (the orange) to plot."""
    response = relative_response("CIE 1931 2 Degree Standard Observer", "D65", FINE)
    truths = test_reflectances(FINE)["BabelColor Average"]
    table, shown = [], {"truth": truths[6][::5]}
    for method in ("paper", "uniform", "prior"):
        for readings in (False, True):
            found = []
            for index, truth in enumerate(truths):
                measurement = SpectralMeasurement(FINE, response, response @ truth, np.zeros((3, 3)))
                try:
                    spectra = draws_of(method, readings, measurement, truth[::5])
                except ConvergenceError:
                    continue
                if index == 6:
                    shown[f"{method}{' + 400, 700 nm' if readings else ''}"] = spectra
                lower, upper = np.quantile(spectra, [0.025, 0.975], axis=0)
                inside = (truth[::5] >= lower) & (truth[::5] <= upper)
                found.append((np.sqrt(np.mean((spectra.mean(axis=0) - truth[::5])**2)), spectra.std(axis=0).mean(),
                              inside.mean()))
            rmse, sigma, held = np.mean(found, axis=0)
            table.append({"method": method, "readings": readings, "colours": len(found), "rmse": float(rmse),
                          "standard_deviation": float(sigma), "coverage_95": float(held)})
    return table, shown


def picture(shown: dict[str, np.ndarray], path: Path) -> None:
    """Mean and 95 % band of every method for one colour."""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    names = [name for name in shown if name != "truth"]
    figure, axes = plt.subplots(2, 3, figsize=(11, 6), sharex=True, sharey=True)
    for axis, name in zip(axes.T.ravel(), names, strict=True):
        lower, upper = np.quantile(shown[name], [0.025, 0.975], axis=0)
        axis.fill_between(GRID.nm, lower, upper, color="0.85", label="95 % of draws")
        axis.plot(GRID.nm, shown[name].mean(axis=0), color="tab:green", label="mean")
        axis.plot(GRID.nm, shown["truth"], color="black", label="measured")
        axis.set(title=name, xlabel="wavelength (nm)", ylabel="reflectance", ylim=(0, 1))
    axes[0, 0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("figure_4.png"))
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    table, shown = rows()
    picture(shown, arguments.out)
    if arguments.json:
        print(json.dumps({"rows": table, "picture": str(arguments.out)}))
        return
    print("Paper: two more readings bring the mean close to the truth and shrink the uncertainty.")
    print(f"{'method':<8} {'readings':<10} {'colours':>7} {'RMSE':>7} {'sd':>7} {'95 % holds':>11}")
    for row in table:
        print(f"{row['method']:<8} {'400, 700' if row['readings'] else 'none':<10} {row['colours']:7d} "
              f"{row['rmse']:7.4f} {row['standard_deviation']:7.4f} {row['coverage_95']:11.3f}")


if __name__ == "__main__":
    main()
