"""Curves of cameras whose maker no one has measured: charts under one, two and four lights.

Every camera of a folder photographs 24 BabelColor patches under CIE lights, with noise of 1 % that
is not stated, fall-off and glare unknown. The prior holds all cameras of other makers ("maker"), or
all other cameras ("camera"), and the fit is the one that ``spectrabox camera fit`` runs. The error
of a camera is the relative RMSE of each curve, scaled to the green maximum, mean of the bands;
"holds" is the share of wavelengths and bands at which the 90 % band holds the true curve.
``--lens`` puts a lens of its own in front of every camera that is photographed: a smooth factor of
that standard deviation, the same for all bands.

``--real`` photographs as others do: lights that are only nearly the stated one (daylights by a
model of the atmosphere, stated as the nearest of D50, D55, D65 and D75, give or take 10 mired;
tinted filaments near CIE A), light that falls off, glare, patches off by 0.5 to 1.6 % a band and 0
to 2.5 % in common; charts of the average spectra, of the generation after November 2014, and one
that was measured (flea3_chart/), all fitted without a stated reference; cameras of makers that are
left out, and those of two laboratories with the third's prior.
"""
from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.camera_curves import camera_curves, curve_band, curve_draws
from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_equations import field_terms
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.prior.camera_prior import CameraPrior, matern
from spectrabox.calibrate.prior.learnt_prior import (
    CameraDatabase,
    build_prior,
    read_camera_database,
)
from spectrabox.calibrate.products.lamps import blackbodies, colour_temperatures
from spectrabox.radiometry.chart import AFTER_2014, CLASSIC, chart_reflectances
from spectrabox.radiometry.charts.references import editions
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.named_spectra import light, spectrum_of_name
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_table

GRID = visible_grid()
LIGHTS = (("D65",), ("LED-B3",), ("D65", "A"), ("LED-B3", "A"), ("D65", "A", "LED-B3", "FL11"))
NOISE = 0.01
DAYLIGHTS = {"D50": 199.9, "D55": 181.7, "D65": 153.7, "D75": 133.3}       # mired
REAL = ("daylight, average chart", "filament, average chart", "daylight, chart after November 2014",
        "daylight, a measured chart", "daylight, another laboratory")
OTHER_LABORATORIES = ("ARRI D21", "Canon Digital Rebel XTi", "Canon PowerShot S90", "Nikon D5100",
                      "Nikon D70", "Nikon D700", "Nikon D7000")
LENS_NM = 100.0
MISS = 20.0                  # of the interval score: 2 / (1 - 0.9)


def prior_without(database: CameraDatabase, left_out: np.ndarray) -> CameraPrior:
    """The prior of all cameras that the mask ``left_out`` (C,) does not name."""
    names = tuple(name for name, out in zip(database.names, left_out, strict=True) if not out)
    return build_prior(database.nm, database.curves[~left_out], names, source="benchmark",
                       licence="")


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
    return judged(photos, prior, truth)


def judged(photos: list[ChartPhoto], prior: CameraPrior,
           truth: np.ndarray) -> tuple[float, float, float]:
    """Error, share that the 90 % band holds and interval score of the fit to photos by (K, P)."""
    fit = calibrate_chart(photos, GRID, prior=prior)
    band, curves = curve_band(fit, curve_draws(fit)), camera_curves(fit).curves
    assert band is not None
    lower, upper = band
    ours, true = curves / curves[1].max(), truth / truth[1].max()
    error = np.sqrt(((ours - true) ** 2).sum(axis=1) / (true**2).sum(axis=1)).mean()
    top = truth / truth.max()
    outside = np.maximum(lower - top, 0) + np.maximum(top - upper, 0)
    score = np.mean(upper - lower + MISS * outside) / top.mean()
    return float(error), float(np.mean(outside < 1e-9)), float(score)


def run(database: CameraDatabase, by_maker: bool, lights: tuple[tuple[str, ...], ...],
        lens_sd: float = 0.0) -> np.ndarray:
    """Error, holds and score (C, lights, 3) of every camera; NaN where the photo was refused."""
    makers = makers_of(database)
    root = np.linalg.cholesky(matern(GRID.nm, LENS_NM, 2.5) + 1e-9 * np.eye(GRID.nm.size))
    figures = np.full((len(makers), len(lights), 3), np.nan)
    for camera, curves in enumerate(database.curves):
        rng = np.random.default_rng(camera)
        lens = np.exp(lens_sd * root @ rng.standard_normal(GRID.nm.size))
        truth = on_grid(database.nm, curves / curves.max(), GRID, database.names[camera]) * lens
        left_out = makers == makers[camera] if by_maker else np.arange(len(makers)) == camera
        prior = prior_without(database, left_out)
        for index, names in enumerate(lights):
            try:
                figures[camera, index] = fitted(truth, names, prior, rng)
            except CheckError as error:
                print(f"{database.names[camera]}, {' '.join(names)}: {error}")
    return figures


def real_photo(truth: np.ndarray, surfaces: np.ndarray, name: str,
               rng: np.random.Generator) -> ChartPhoto:
    """A photo by curves (K, P) of a chart (24, P), of "daylight" or "filament" light."""
    # bench_light_kinds and bench_unknown_light import this module
    from benchmarks.bench_light_kinds import PATCH_ERRORS, daylight
    from benchmarks.bench_unknown_light import FIELD_SD, MAX_GLARE
    if name == "daylight":
        power = daylight(rng)
        mired = 1e6 / colour_temperatures(power[None])[0] + 10 * rng.standard_normal()
        stated = min(DAYLIGHTS, key=lambda each: abs(DAYLIGHTS[each] - mired))
    else:
        tint = np.exp(0.1 * rng.standard_normal() * (GRID.nm - 550) / 150)
        power, stated = blackbodies(rng.normal(2856, 120, 1))[0] * tint, "A"
    own, common = ((0.005, 0.004), *PATCH_ERRORS)[rng.integers(1 + len(PATCH_ERRORS))]
    field = np.exp(field_terms(CLASSIC.centres_uv) @ (FIELD_SD * rng.standard_normal(5)))
    signal = field[:, None] * (surfaces @ (truth * power * GRID.weights_nm).T)
    off = own * rng.standard_normal(signal.shape) + common * rng.standard_normal((24, 1))
    signal = signal / signal.max() * (1 + off) + rng.uniform(0, MAX_GLARE)
    zero, of = np.zeros(signal.shape), editions(CLASSIC)
    return ChartPhoto(PatchSamples(signal, np.zeros((24, 3, 3)), np.ones(24), zero, zero),
                      of[0].mean, spectrum_of_name(stated, GRID), editions=of)


def run_real(data: Path, database: CameraDatabase) -> dict[str, np.ndarray]:
    """Error, holds and score (n, 3) by kind of photo, of every second camera."""
    table = read_table(data / "flea3_chart" / "spectra_averaged.csv")
    first = table.names.index("dark skin")
    measured = np.array([np.interp(GRID.nm, table.nm, column)
                         for column in table.values[first:first + 24]])
    average, later = (chart_reflectances(name, GRID) for name in ("BabelColor Average", AFTER_2014))
    kinds = (("daylight", average, False), ("filament", average, False),
             ("daylight", later, False), ("daylight", measured, False),
             ("daylight", average, True))
    rows: dict[str, list[tuple[float, float, float]]] = {title: [] for title in REAL}
    makers, others = makers_of(database), np.isin(database.names, OTHER_LABORATORIES)
    for title, (name, surfaces, laboratory) in zip(REAL, kinds, strict=True):
        for camera, curves in enumerate(database.curves):
            if not others[camera] if laboratory else camera % 2:
                continue
            left_out = others if laboratory else makers == makers[camera]
            truth = on_grid(database.nm, curves / curves.max(), GRID, database.names[camera])
            photo = real_photo(truth, surfaces, name, np.random.default_rng([camera, 5]))
            rows[title].append(judged([photo], prior_without(database, left_out), truth))
    return {title: np.array(of_kind) for title, of_kind in rows.items()}


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
    parser.add_argument("--real", action="store_true", help="photos as others take them")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    database = read_camera_database(arguments.data / "cameras")
    start = time.process_time()
    if arguments.real:
        for title, figures in run_real(arguments.data, database).items():
            error, holds, _ = figures.T
            print(f"{title:<40} median {np.median(error):.3f}  mean {error.mean():.3f}  worst "
                  f"{error.max():.3f}  holds {holds.mean():.2f}")
        return
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
