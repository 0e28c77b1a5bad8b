"""Figure 4: 20 measured spectra, each on an object in a photo; then with two more readings, at 400
and 700 nm.

The object is a ball beside a flash. Its colour is what the transport engine finds in the photo. The
paper ranks draws of its box by the readings (Eq. 9); beside it exact uniform draws and the learnt
prior, which are conditioned on them. Table of the RMSE of the mean, the standard deviation and the
coverage over all spectra.

The spectra are CES99 samples, which the learnt prior was not trained on. ``--data`` adds a table of
those of the data folder, which are what it was trained on: there its rows show how it does on what
it knows, no more.
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.fixtures.object_views import cameras, view_xml
from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.records.calibration import LightScale
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.reconstruct.inverse_rendering import reconstruct
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.view import MaterialSpec, PhotoView
from spectrabox.sampling.draw_methods import draw_spectra
from spectrabox.sampling.further.more_measurements import Reading, condition
from spectrabox.sampling.prior.libraries import read_library
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.published.baselines import best_by_signals

from benchmarks.paper.synthetic_photo import (
    BANDS,
    GRID,
    measured_camera,
    photograph,
    plain_settings,
    scene_of,
)

SPECTRA, WIDTH, PHOTO_SPP, COEFFICIENTS = 20, 24, 256, 7
DRAWS, KEPT, READING_ERROR = 10_000, 1_000, 0.005
METHODS = ("paper", "uniform", "prior")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="folder with reflectance/, for a second table")
    parser.add_argument("--out", type=Path, default=Path("figure_4.png"))
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    start_mitsuba("cpu")
    tables: dict[str, list[dict[str, Any]]] = {}
    for data in (None,) if arguments.data is None else (None, arguments.data):
        truths, source = measured_spectra(data)
        tables[source], shown = rows(truths)
        if data is None:
            picture(shown, arguments.out)
    if arguments.json:
        print(json.dumps({"rows": tables, "picture": str(arguments.out)}))
        return
    print("Paper: two more readings bring the mean close to the truth and shrink the uncertainty.")
    for source, table in tables.items():
        print(f"{SPECTRA} spectra of {source}")
        print(f"{'method':<8} {'readings':<10} {'spectra':>7} {'RMSE':>7} {'sd':>7} "
              f"{'95 % holds':>11}")
        for row in table:
            print(f"{row['method']:<8} {'400, 700' if row['readings'] else 'none':<10} "
                  f"{row['spectra']:7d} {row['rmse']:7.4f} {row['standard_deviation']:7.4f} "
                  f"{row['coverage_95']:11.3f}")
    if arguments.data is None:
        print("missing: spectra of the measured libraries; give the folder that holds reflectance/ "
              "with --data")


def measured_spectra(data: Path | None) -> tuple[np.ndarray, str]:
    """Twenty reflectances (20, P), spread over what there is, and where they come from."""
    if data is None:
        curves = test_reflectances(GRID)["CES99"]
        return curves[np.linspace(0, len(curves) - 1, SPECTRA).astype(int)], "CES99, every fifth"
    if not (data / "reflectance").is_dir():
        raise InputError(f"{data} has no folder reflectance/: give the data folder, or leave "
                         "--data out")
    folders = sorted(path for path in (data / "reflectance").iterdir() if path.is_dir())
    chosen = []
    for folder in folders:
        curves = read_library(folder)
        chosen += list(curves[np.linspace(0, len(curves) - 1,
                                          -(-SPECTRA // len(folders))).astype(int)])
    fine = np.array([np.interp(GRID.nm, PRIOR_GRID.nm, curve) for curve in chosen[:SPECTRA]])
    names = ", ".join(folder.name for folder in folders)
    return fine, f"{names} (the learnt prior's own training sets)"


def spectra_behind(method: str, readings: bool, measurement: SpectralMeasurement, truth: np.ndarray,
                   coefficients: int) -> np.ndarray:
    """Draws (T, 61), the paper's ranked by the two readings of the truth (P,), the others
    conditioned on them.
    """
    at = np.interp((400.0, 700.0), GRID.nm, truth)
    if method == "paper":
        spectra = draw_spectra(measurement, "paper", DRAWS, 0, coefficients).spectra
        return spectra[best_by_signals(spectra[:, [0, 60]], at,
                                        KEPT)] if readings else spectra
    extra = [Reading.at_wavelength(nm, float(value), READING_ERROR)
             for nm, value in zip((400.0, 700.0), at, strict=True)]
    measured = condition(measurement, extra) if readings else measurement
    return draw_spectra(measured, method, 2000, 0, coefficients, load_prior()).spectra


def rows(truths: np.ndarray) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The table, and for four of the spectra the draws to plot."""
    measurements = [found_in_photo(truth) for truth in truths]
    table: list[dict[str, Any]] = []
    shown: list[dict[str, Any]] = [{"truth": truths[index]} for index in range(2, len(truths), 5)]
    for method in METHODS:
        for readings in (False, True):
            scores = []
            for index, (truth, measurement) in enumerate(zip(truths, measurements, strict=True)):
                try:
                    spectra = spectra_behind(method, readings, measurement, truth, COEFFICIENTS)
                except ConvergenceError:
                    continue
                if index % 5 == 2:
                    shown[index // 5][f"{method}{', readings' if readings else ''}"] = spectra
                at = np.interp(PRIOR_GRID.nm, GRID.nm, truth)
                lower, upper = np.quantile(spectra, [0.025, 0.975], axis=0)
                scores.append((np.sqrt(np.mean((spectra.mean(axis=0) - at) ** 2)),
                               spectra.std(axis=0).mean(), np.mean((at >= lower) & (at <= upper))))
            error, deviation, held = np.mean(scores, axis=0)
            table.append({"method": method, "readings": readings, "spectra": len(scores),
                          "rmse": float(error), "standard_deviation": float(deviation),
                          "coverage_95": float(held)})
    return table, shown


def found_in_photo(truth: np.ndarray) -> SpectralMeasurement:
    """The ball's colour as the transport engine finds it in a photo of the ball with this paint."""
    camera, scene = measured_camera(), scene_of(view_xml(cameras(6)[3], WIDTH))
    photo = photograph(scene, {"paint": truth}, camera, PHOTO_SPP)
    view = PhotoView("photo", scene, photo, camera, BANDS, (MaterialSpec("paint", "paint"),),
                     LightScale(1.0, None, None, "given"))
    found = reconstruct(view, plain_settings(COEFFICIENTS), lambda done, what: None)
    response = camera.sensitivity.curves * GRID.weights_nm
    return SpectralMeasurement(GRID, response / response.sum(axis=1, keepdims=True),
                               found.signal[0], np.zeros((3, 3)))


def picture(shown: list[dict[str, Any]], path: Path) -> None:
    """Mean and 95 % band of every method, before (grey) and after (green) the readings."""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, len(shown), figsize=(12, 7), sharex=True, sharey=True)
    for column, curves in enumerate(shown):
        for axis, method in zip(axes[:, column], METHODS, strict=True):
            for name, colour in ((method, "0.5"), (f"{method}, readings", "tab:green")):
                if name in curves:
                    lower, upper = np.quantile(curves[name], [0.025, 0.975], axis=0)
                    axis.fill_between(PRIOR_GRID.nm, lower, upper, color=colour, alpha=0.3)
                    axis.plot(PRIOR_GRID.nm, curves[name].mean(axis=0), color=colour)
            axis.plot(GRID.nm, curves["truth"], color="black")
            axis.set(ylim=(0, 1))
            axis.set_title(method, fontsize=9)
    figure.supxlabel("wavelength (nm)")
    figure.supylabel("reflectance")
    figure.suptitle("black: measured; grey: from the colour alone; green: with two readings",
                    fontsize=10)
    figure.tight_layout()
    figure.savefig(path, dpi=75)


if __name__ == "__main__":
    main()
