"""Curves of cameras whose maker no one has measured: charts under one, two and four lights.

Every camera of a folder photographs 24 BabelColor patches under CIE lights, with noise of 1 % that
is not stated, fall-off and glare unknown. The prior holds all cameras of other makers ("maker"), or
all other cameras ("camera"), and the fit is the one that ``spectrabox camera fit`` runs. The error
of a camera is the relative RMSE of each curve, scaled to the green maximum, mean of the bands;
"holds" is the share of wavelengths and bands at which the 90 % band holds the true curve.
``--lens`` puts a lens of its own in front of every camera that is photographed: a smooth factor of
that standard deviation, the same for all bands.
"""
from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.chart_calibration import (
    CalibrationOptions,
    ChartPhoto,
    calibrate_chart,
    curve_band,
)
from spectrabox.calibrate.prior.camera_database import CameraDatabase, read_camera_database
from spectrabox.calibrate.prior.camera_prior import CameraPrior, matern
from spectrabox.calibrate.prior.learnt_prior import CONSTANTS, PriorConstants, build_prior
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import PatchSamples, Quantity, Spectrum
from spectrabox.radiometry.spectra.named_spectra import light
from spectrabox.radiometry.spectra.spectrum_files import on_grid

GRID = visible_grid()
LIGHTS = (("D65",), ("LED-B3",), ("D65", "A"), ("LED-B3", "A"), ("D65", "A", "LED-B3", "FL11"))
NOISE = 0.01
LENS_NM = 100.0
MISS = 20.0                  # of the interval score: 2 / (1 - 0.9)


def prior_without(database: CameraDatabase, left_out: np.ndarray,
                  constants: PriorConstants = CONSTANTS) -> CameraPrior:
    """The prior of all cameras that the mask ``left_out`` (C,) does not name."""
    names = tuple(name for name, out in zip(database.names, left_out, strict=True) if not out)
    return build_prior(database.nm, database.curves[~left_out], names, source="benchmark",
                       licence="", constants=constants)


def fitted(truth: np.ndarray, names: tuple[str, ...], prior: CameraPrior,
           rng: np.random.Generator) -> tuple[float, float, float]:
    """Error, share that the 90 % band holds and interval score of one camera (K, P)."""
    reflectances, zero = chart_reflectances("BabelColor Average", GRID), np.zeros((24, 3))
    photos = []
    for name in names:
        power = light(name, GRID)
        signal = reflectances @ (truth * power * GRID.weights_nm).T
        signal = signal * (1 + NOISE * rng.standard_normal(signal.shape))
        samples = PatchSamples(signal, np.zeros((24, 3, 3)), np.ones(24), zero, zero)
        photos.append(ChartPhoto(samples, reflectances,
                                 Spectrum(GRID, power, Quantity.RELATIVE, name)))
    found = calibrate_chart(photos, GRID, CalibrationOptions(prior=prior))
    band = curve_band(found, 0)
    curves = found.calibration.sensitivity.curves
    ours, true = curves / curves[1].max(), truth / truth[1].max()
    error = np.sqrt(((ours - true) ** 2).sum(axis=1) / (true**2).sum(axis=1)).mean()
    top = truth / truth.max()
    outside = np.maximum(band.lower - top, 0) + np.maximum(top - band.upper, 0)
    score = np.mean(band.upper - band.lower + MISS * outside) / top.mean()
    return float(error), float(np.mean(outside < 1e-9)), float(score)


def run(database: CameraDatabase, by_maker: bool, lights: tuple[tuple[str, ...], ...],
        constants: PriorConstants = CONSTANTS, lens_sd: float = 0.0) -> np.ndarray:
    """Error, holds and score (C, lights, 3) of every camera; NaN where the photo was refused."""
    makers = makers_of(database)
    root = np.linalg.cholesky(matern(GRID.nm, LENS_NM, 2.5) + 1e-9 * np.eye(GRID.nm.size))
    figures = np.full((len(makers), len(lights), 3), np.nan)
    for camera, curves in enumerate(database.curves):
        rng = np.random.default_rng(camera)
        lens = np.exp(lens_sd * root @ rng.standard_normal(GRID.nm.size))
        truth = on_grid(database.nm, curves / curves.max(), GRID, database.names[camera]) * lens
        left_out = makers == makers[camera] if by_maker else np.arange(len(makers)) == camera
        prior = prior_without(database, left_out, constants)
        for index, names in enumerate(lights):
            try:
                figures[camera, index] = fitted(truth, names, prior, rng)
            except CheckError as error:
                print(f"{database.names[camera]}, {' '.join(names)}: {error}")
    return figures


def makers_of(database: CameraDatabase) -> np.ndarray:
    """First word of each camera's name, (C,)."""
    return np.array([name.split()[0] for name in database.names])


def rows_of(figures: np.ndarray, lights: tuple[tuple[str, ...], ...]) -> list[dict[str, Any]]:
    """Median and worst error and mean share held, for each set of lights."""
    return [{"lights": " + ".join(names), "median": float(np.nanmedian(figures[:, index, 0])),
             "worst": float(np.nanmax(figures[:, index, 0])),
             "holds": float(np.nanmean(figures[:, index, 1]))}
            for index, names in enumerate(lights)]


def print_rows(title: str, rows: list[dict[str, Any]]) -> None:
    for row in rows:
        print(f"{title:<8}{row['lights']:<24} median {row['median']:.3f}  worst {row['worst']:.3f}"
              f"  holds {row['holds']:.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/")
    parser.add_argument("--lens", type=float, default=0.0, help="standard deviation of a lens")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    database = read_camera_database(arguments.data / "cameras")
    start = time.process_time()
    rows = {title: rows_of(run(database, by_maker, LIGHTS, lens_sd=arguments.lens), LIGHTS)
            for title, by_maker in (("maker", True), ("camera", False))}
    if arguments.json:
        print(json.dumps(rows))
        return
    for title, table in rows.items():
        print_rows(title, table)
    print(f"{time.process_time() - start:.0f} s of processor time")


if __name__ == "__main__":
    main()
