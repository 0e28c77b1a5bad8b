"""Lamps of a kind that the prior does not hold: how far products err, kind by kind.

One kind of lamp after another is left out of the prior, and lamps of that kind, published and by
formula, light simulated charts (see bench_unknown_light.py) that cameras photograph whose makers
are left out too. What the fit states of the products' errors is held against the errors made. The
widening of ``calibrate.products.product_fit`` is the factor by which standard errors are to be
multiplied so that the 90 % band of the products holds 90 % on average over the kinds; it is set
from this table with its default seed. Surfaces are 30 published test colours.
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from spectrabox.calibrate.prior.camera_database import CameraDatabase, read_camera_database
from spectrabox.calibrate.products.lamps import all_lamps
from spectrabox.calibrate.products.product_fit import WIDENING, fit_products
from spectrabox.radiometry.spectra.light_words import LIGHT_KINDS
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import on_grid

from benchmarks.bench_unknown_light import (
    GRID,
    SURFACES,
    judged,
    lamps_without,
    products_found,
    simulated,
)
from benchmarks.bench_unknown_makers import makers_of, prior_without

NORMAL_90, HELD = 1.645, 0.90
EXACT = 1e-12               # of a product's whole mass: what is held at zero has no error


def run(database: CameraDatabase, kind: int, cases: int,
        rng: np.random.Generator) -> tuple[np.ndarray, dict[str, float]]:
    """Errors of products in standard errors before widening, and figures of bands, of a kind."""
    lamps, makers = all_lamps(), np.asarray(makers_of(database))
    rest = lamps_without(lamps, lamps.kind != kind)
    of_kind = np.flatnonzero(lamps.kind == kind)
    share = lamps.weights[of_kind] / lamps.weights[of_kind].sum()
    sets = test_reflectances(GRID)
    tests = np.vstack([sets["CES99"], sets["NIST CQS test colours"]])
    errors, rows = [], []
    for _ in range(cases):
        camera, lamp = rng.integers(len(makers)), rng.choice(of_kind, p=share)
        prior = prior_without(database, makers == makers[camera])
        curves = on_grid(database.nm, database.curves[camera] / database.curves[camera].max(),
                         GRID, database.names[camera])
        case = simulated(curves, lamps.spectra[lamp],
                         tests[rng.choice(len(tests), SURFACES, replace=False)], rng)
        found = fit_products([case.photo], prior, rest, GRID, "unknown light")
        nodes, truth, error = products_found(case, found)
        errors.append(np.abs(nodes - truth) / np.maximum(error / WIDENING, EXACT))
        rows.append(judged(case, prior, rest, found))
        print(".", end="", flush=True)
    return np.array(errors), {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/")
    parser.add_argument("--cases", type=int, default=15, help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    database = read_camera_database(arguments.data / "cameras")
    table, errors = {}, []
    with threadpool_limits(1):
        for kind, name in enumerate(LIGHT_KINDS):
            of_kind, figures = run(database, kind, arguments.cases,
                                   np.random.default_rng([arguments.seed, kind]))
            errors.append(of_kind)
            table[name] = {"needs": float(np.quantile(of_kind, HELD) / NORMAL_90), **figures}
    factors = np.arange(0.5, 4.0, 0.01)
    held = [np.mean([np.mean(of_kind < NORMAL_90 * factor) for of_kind in errors])
            for factor in factors]
    print()
    print(json.dumps({"kinds": table, "widening": float(factors[np.searchsorted(held, HELD)]),
                      "widening in use": WIDENING}, indent=1))


if __name__ == "__main__":
    main()
