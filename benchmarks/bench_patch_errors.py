"""Charts whose patches are off: do stated errors hold where a patch is off in all bands alike?

Simulated chart photos of a folder's cameras, whole makers left out of the prior, under the lamps of
the folder, with light that falls off and glare. A patch departs from the reference by so much in
all bands in common, and by so much in each band for itself. Every photo is fitted with its light
stated and with its light unknown. Chi-squares are per datum, 1 where errors are as stated: of white
at the middle of the chart, of the field's terms, of the signals of patches predicted without them;
beside them how often the 90 % band of the curves (of the products) holds.
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from spectrabox.calibrate.chart_equations import ChartEquations, chart_equations, field_terms
from spectrabox.calibrate.prior.learnt_prior import CameraDatabase, read_camera_database
from spectrabox.calibrate.products.lamps import all_lamps
from spectrabox.calibrate.products.product_fit import fit_products
from spectrabox.calibrate.sensitivity import PriorFit, fit_with_prior
from spectrabox.measure.held_out_spectra import patches_without
from spectrabox.radiometry.chart import CLASSIC, chart_reflectances
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.spectra.spectrum_files import on_grid

from benchmarks.bench_unknown_light import FIELD_SD, MAX_GLARE
from benchmarks.bench_unknown_makers import makers_of, prior_without

GRID = visible_grid()
ERRORS = {"1 % in common, 0.2 % a band": (0.01, 0.002), "1 % a band": (0.0, 0.01),
          "0.7 % in common, 0.7 % a band": (0.007, 0.007)}
TERMS = field_terms(CLASSIC.centres_uv)
NORMAL_90 = 1.645


def photographed(curves: np.ndarray, lamp: np.ndarray, error: tuple[float, float], stated: bool,
                 rng: np.random.Generator) -> tuple[ChartEquations, np.ndarray, np.ndarray]:
    """A photo by curves (K, P) under a lamp (P,); its white (K,) and field terms (5,)."""
    responses = curves * lamp * GRID.weights_nm
    white = responses.sum(axis=1)
    reflectances = chart_reflectances("BabelColor Average", GRID)
    field = rng.standard_normal(5) * FIELD_SD
    off = error[0] * rng.standard_normal((24, 1)) + error[1] * rng.standard_normal((24, 3))
    signal = reflectances @ responses.T * np.exp(TERMS @ field)[:, None] * (1 + off)
    signal = signal + rng.uniform(0, MAX_GLARE) * white.max()
    zero = np.zeros(signal.shape)
    samples = PatchSamples(signal, np.zeros((24, 3, 3)), np.ones(24), zero, zero)
    photo = chart_equations(samples, reflectances, lamp if stated else np.ones_like(lamp),
                            np.full(24, np.pi), GRID, positions=CLASSIC.centres_uv)
    return photo, white, field


def judged(fit: PriorFit, photo: ChartEquations, white: np.ndarray, field: np.ndarray,
           truth: np.ndarray) -> dict[str, float]:
    """Chi-squares and coverage of one fit; true curves (K, P) of any scale."""
    found, bands = fit.photos[0].white, len(white)
    def chi_square(off: np.ndarray, covariance: np.ndarray) -> float:
        return float(off @ np.linalg.solve(covariance, off) / off.size)
    terms = slice(bands, bands + 5)
    without = fit.without
    off = without.signal - without.predicted(photo.reflectances)
    covariances = without.error_covariance(photo.reflectances)
    left_out = patches_without(without, GRID, photo.reflectances, np.zeros(24, bool))
    seen = fit.sensitivity
    nodes = seen.basis.shape[1]
    true = np.linalg.lstsq(seen.basis, truth.T, rcond=None)[0].T
    scale = np.sum(true * seen.coefficients) / np.sum(true**2)
    error = np.sqrt(np.diag(seen.covariance)).reshape(bands, nodes)
    return {"white": chi_square(np.log(white / found.level), found.covariance[:bands, :bands]),
            "field": chi_square(field - found.field, found.covariance[terms, terms]),
            "patches": float(np.mean([chi_square(*one) for one in
                                      zip(off, covariances, strict=True)])),
            "curves hold": float(np.mean(np.abs(scale * true - seen.coefficients)
                                         < NORMAL_90 * error)),
            "white off": float(np.sqrt(np.mean(np.log(white / found.level) ** 2))),
            "left out, inside": float(left_out.inside.mean()),
            "left out, expected": float(left_out.expected.mean()),
            "refused": float(fit.disagrees)}


def run(database: CameraDatabase, lamps: np.ndarray, error: tuple[float, float], cases: int,
        seed: int) -> dict[str, dict[str, float]]:
    """Means over cases, light stated and unknown."""
    rng, makers = np.random.default_rng(seed), makers_of(database)
    rows: dict[str, list[dict[str, float]]] = {"stated": [], "unknown": []}
    known = all_lamps()
    for _ in range(cases):
        camera, lamp = rng.integers(len(makers)), lamps[rng.integers(len(lamps))]
        prior = prior_without(database, np.asarray(makers) == makers[camera])
        curves = on_grid(database.nm, database.curves[camera] / database.curves[camera].max(),
                         GRID, database.names[camera])
        state = rng.bit_generator.state
        for kind, of_kind in rows.items():
            rng.bit_generator.state = state     # the same photo for both
            photo, white, field = photographed(curves, lamp, error, kind == "stated", rng)
            try:
                fit = fit_with_prior([photo], prior, GRID) if kind == "stated" else fit_products(
                    [photo], prior, known, GRID, "unknown light")[0]
            except CheckError:
                continue
            of_kind.append(judged(fit, photo, white, field,
                                  curves if kind == "stated" else curves * lamp))
        print(".", end="", flush=True)
    found = {}
    for kind, of_kind in rows.items():
        table = {name: np.array([row[name] for row in of_kind]) for name in of_kind[0]}
        short = table["left out, expected"] - table["left out, inside"]
        found[kind] = {name: float(values.mean()) for name, values in table.items()} | {
            "left out, short by, 98 %": float(np.quantile(short, 0.98)),
            "left out, short by, worst": float(short.max())}
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/ and lights/")
    parser.add_argument("--cases", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    database = read_camera_database(arguments.data / "cameras")
    stored = np.load(arguments.data / "lights" / "lights_for_checks.npz")
    lamps = np.array([np.interp(GRID.nm, stored["wavelengths_nm"], one)
                      for one in stored["spectra"]])
    with threadpool_limits(1):
        found = {words: run(database, lamps, error, arguments.cases, arguments.seed)
                 for words, error in ERRORS.items()}
    print()
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
