"""Charts under lamps that nobody measured, by cameras of makers that nobody measured.

Every case is a camera of the folder, its maker left out of the prior, under one of the lamps that
the prior does not hold: 24 BabelColor patches and 30 published test colours with 1 % of noise,
fall-off over the chart and glare. Spectra of the test colours are found with the light unknown, and
with camera and light known exactly; then the chart is held against the right spectrum of its lamp,
and against that of another. ``--shipped`` takes lamps of the prior in place of measured ones, all
lamps of their kind being left out of it; the limit for a wrong light was chosen by them.
"""
from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from spectrabox.calibrate.chart_equations import ChartEquations, chart_equations, field_terms
from spectrabox.calibrate.doubts import CONTRADICTS, evidence_on_spectrum
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.prior.learnt_prior import CameraDatabase, read_camera_database
from spectrabox.calibrate.products.lamps import Lamps, all_lamps
from spectrabox.calibrate.products.product_fit import fit_products
from spectrabox.calibrate.sensitivity import PriorFit, fit_with_prior
from spectrabox.radiometry.chart import CLASSIC, chart_reflectances
from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import on_grid
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.prior.summaries import PriorSummaries, summaries

from benchmarks.bench_unknown_makers import makers_of, prior_without

GRID = visible_grid()
NOISE, SURFACES, LEVEL = 0.01, 30, 0.95
FIELD_SD, MAX_GLARE = (0.08, 0.08, 0.03, 0.03, 0.02), 0.01      # of the terms; of white
TO_PRIOR = interpolation_matrix(PRIOR_GRID.nm, GRID.nm)


@dataclass(frozen=True)
class Case:
    """A chart photo and signals of unseen surfaces, with the truth behind them."""

    photo: ChartEquations
    products: np.ndarray    # (K, P) true, rows summing to 1
    level: np.ndarray       # (K,) white signal at the middle of the chart
    signals: np.ndarray     # (n, K) of the surfaces, in the same unit
    surfaces: np.ndarray    # (n, P)


def simulated(curves: np.ndarray, lamp: np.ndarray, surfaces: np.ndarray,
              rng: np.random.Generator, own: float = NOISE, common: float = 0.0) -> Case:
    """A photo by curves (K, P) under a lamp (P,); patches are off by ``own`` in each band, and by
    ``common`` in all.
    """
    product = curves * lamp * GRID.weights_nm
    level = product.sum(axis=1) / product.sum(axis=1).max()
    products = product / product.sum(axis=1, keepdims=True)
    reflectances = chart_reflectances("BabelColor Average", GRID)
    field = np.exp(field_terms(CLASSIC.centres_uv) @ (rng.standard_normal(5) * FIELD_SD))
    signal = reflectances @ products.T * level * field[:, None]
    off = own * rng.standard_normal(signal.shape)
    if common:
        off = off + common * rng.standard_normal((24, 1))
    signal = signal * (1 + off) + rng.uniform(0, MAX_GLARE)
    zero = np.zeros(signal.shape)
    samples = PatchSamples(signal, np.zeros((24, 3, 3)), np.ones(24), zero, zero)
    photo = chart_equations(samples, reflectances, np.ones_like(GRID.nm), np.full(24, np.pi), GRID,
                            positions=CLASSIC.centres_uv)
    seen = surfaces @ products.T * level
    return Case(photo, products, level, seen * (1 + NOISE * rng.standard_normal(seen.shape)),
                surfaces)


def judged(case: Case, cameras: CameraPrior, lamps: Lamps,
           fitted: PriorFit | None = None) -> dict[str, float]:
    """Errors and bands of one case, nothing known and everything known; ``fitted`` if it is."""
    start = time.process_time()
    found = fitted or fit_products([case.photo], cameras, lamps, GRID, "unknown light")[0]
    seconds = time.process_time() - start
    nodes, truth, error = products_found(case, found)
    true = _true(case)
    unknown = _recovered(case, found, np.ones_like(GRID.nm))
    known = summaries(load_prior(), case.products @ TO_PRIOR, case.signals / case.level,
                      {"all": _diagonal(NOISE * case.signals / case.level)}, LEVEL)
    row: dict[str, float] = {
        "products_error": float(np.mean(np.linalg.norm(nodes - truth, axis=1)
                                        / np.linalg.norm(truth, axis=1))),
        "products_hold": float(np.mean(np.abs(nodes - truth) < 1.645 * error)),
        "seconds": seconds, "chi_square": found.chi_square}
    for name, answer in (("unknown", unknown), ("known", known)):
        row[f"rmse_{name}"] = float(np.sqrt(np.mean((answer.mean - true) ** 2, axis=1)).mean())
        row[f"holds_{name}"] = float(np.mean((answer.lower <= true) & (true <= answer.upper)))
    return row


def products_found(case: Case, found: PriorFit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Products (K, N) of a fit, the true ones, and their stated standard errors; bands sum to 1.

    By wavelengths of the fit: what a lamp's lines do within 5 nm no reflectance tells.
    """
    fit = found.sensitivity
    assert fit.basis is not None and fit.coefficients is not None and fit.covariance is not None
    mass = GRID.weights_nm @ fit.basis
    weight = (fit.coefficients * mass).sum(axis=1)[:, None]
    blocks = fit.covariance.reshape(3, mass.size, 3, mass.size)
    error = np.array([np.sqrt(np.diag(blocks[band, :, band])) for band in range(3)]) * mass / weight
    return fit.coefficients * mass / weight, case.products @ fit.basis, error


def _recovered(case: Case, found: PriorFit, power: np.ndarray) -> PriorSummaries:
    """Spectra of the surfaces by a fit under a light (P,), with the errors that the fit states."""
    fit, white = found.sensitivity, found.photos[0].white
    response = fit.curves * power * GRID.weights_nm
    response /= response.sum(axis=1, keepdims=True)
    assert fit.basis is not None and fit.coefficients is not None and fit.covariance is not None
    lit = (power * GRID.weights_nm) @ fit.basis
    weight = (fit.coefficients * lit).sum(axis=1)[:, None]
    nodes = lit.size
    blocks = fit.covariance.reshape(3, nodes, 3, nodes)
    noise = _diagonal(NOISE * case.signals / white.level)
    relative = case.signals / white.level
    estimate = np.full((len(relative), PRIOR_GRID.nm.size), 0.4)
    for _ in range(2):
        contrast = (estimate @ TO_PRIOR.T)[:, None, :] - relative[..., None]
        rows = np.einsum("nkp,pq->nkq", contrast * power * GRID.weights_nm, fit.basis) / weight
        of_curves = np.einsum("nkq,kqlr,nlr->nkl", rows, blocks, rows)
        of_white = white.covariance[:3, :3] * relative[:, :, None] * relative[:, None, :]
        answer = summaries(load_prior(), response @ TO_PRIOR, relative,
                           {"all": noise + of_curves + of_white}, LEVEL)
        estimate = answer.mean
    return answer


def harm(case: Case, cameras: CameraPrior, stated: np.ndarray) -> dict[str, float]:
    """RMSE and coverage with a light (P,) stated, whether it is right or wrong."""
    answer = _recovered(case, fit_with_prior([replace(
        case.photo, power=stated * GRID.weights_nm)], cameras, GRID), stated)
    true = _true(case)
    return {"rmse": float(np.sqrt(np.mean((answer.mean - true) ** 2, axis=1)).mean()),
            "holds": float(np.mean((answer.lower <= true) & (true <= answer.upper)))}


def _true(case: Case) -> np.ndarray:
    return case.surfaces @ np.linalg.pinv(TO_PRIOR).T


def _diagonal(errors: np.ndarray) -> np.ndarray:
    return np.einsum("nk,kl->nkl", errors**2, np.eye(errors.shape[1]))


def run(database: CameraDatabase, spectra: np.ndarray, kinds: np.ndarray | None, cases: int,
        seed: int, spectrum_only: bool, harms: bool = False) -> list[dict[str, float]]:
    """Every case as a row; ``kinds`` (L,) leaves lamps of the case's kind out of the prior."""
    rng = np.random.default_rng(seed)
    sets = test_reflectances(GRID)
    tests = np.vstack([sets["CES99"], sets["NIST CQS test colours"]])
    makers, known, rows = makers_of(database), all_lamps(), []
    priors: dict[str, CameraPrior] = {}
    for _ in range(cases):
        camera, lamp = rng.integers(len(makers)), rng.integers(len(spectra))
        maker = str(makers[camera])
        if maker not in priors:
            priors[maker] = prior_without(database, makers == maker)
        curves = on_grid(database.nm, database.curves[camera] / database.curves[camera].max(),
                         GRID, database.names[camera])
        surfaces = tests[rng.choice(len(tests), SURFACES, replace=False)]
        case = simulated(curves, spectra[lamp], surfaces, rng)
        row: dict[str, float] = {"camera": float(camera), "lamp": float(lamp)}
        if not spectrum_only:
            lamps = known if kinds is None else lamps_without(known, known.kind != kinds[lamp])
            row |= judged(case, priors[maker], lamps)
        other = rng.integers(len(spectra))
        while np.array_equal(spectra[other], spectra[lamp]):
            other = rng.integers(len(spectra))
        row["other"] = float(other)
        for name, stated in (("right", spectra[lamp]), ("wrong", spectra[other])):
            row[name] = evidence_on_spectrum(
                name, replace(case.photo, power=stated * GRID.weights_nm), priors[maker],
                GRID).values["against"]
            if harms:
                row |= {f"{figure}_{name}": value for figure, value in harm(
                    case, priors[maker], stated).items()}
        rows.append(row)
        print(".", end="", flush=True)
    return rows


def lamps_without(lamps: Lamps, kept: np.ndarray) -> Lamps:
    """Those lamps alone that are kept (L,)."""
    weights = lamps.weights[kept]
    return Lamps(lamps.spectra[kept], lamps.kind[kept], weights / weights.sum(),
                 tuple(name for name, one in zip(lamps.names, kept, strict=True) if one))


def summary(rows: list[dict[str, float]]) -> dict[str, Any]:
    """Means over all cases, and the rates of naming."""
    table = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    found: dict[str, Any] = {name: float(np.mean(values)) for name, values in table.items()
                             if name not in ("camera", "lamp", "other", "right", "wrong")
             and not name.endswith(("_right", "_wrong"))}
    if "rmse_known" in found:
        found["ratio"] = found["rmse_unknown"] / found["rmse_known"]
        found["products_error_median"] = float(np.median(table["products_error"]))
    if "rmse_wrong" in table:
        named = table["wrong"] > CONTRADICTS
        for words, chosen in (("named", named), ("missed", ~named)):
            if chosen.any():
                found[words] = {name: float(np.mean(table[name][chosen])) for name in (
                    "rmse_right", "rmse_wrong", "holds_right", "holds_wrong")}
    return found | {"cases": len(rows),
                    "wrong_named": float(np.mean(table["wrong"] > CONTRADICTS)),
                    "right_named": float(np.mean(table["right"] > CONTRADICTS)),
                    "right_98th_percentile": float(np.percentile(table["right"], 98)),
                    "wrong_5th_percentile": float(np.percentile(table["wrong"], 5))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/ and lights/")
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--shipped", action="store_true", help="lamps of the prior, by kind left "
                        "out of it")
    parser.add_argument("--naming", action="store_true", help="wrong and right lights alone")
    parser.add_argument("--harm", action="store_true", help="also what is lost by either light, "
                        "where it is named and where it is missed")
    parser.add_argument("--json", action="store_true", help="rows too")
    arguments = parser.parse_args()
    database = read_camera_database(arguments.data / "cameras")
    if arguments.shipped:
        lamps = all_lamps()
        spectra, kinds = lamps.spectra, lamps.kind
    else:
        stored = np.load(arguments.data / "lights" / "lights_for_checks.npz")
        spectra, kinds = np.array([np.interp(GRID.nm, stored["wavelengths_nm"], one)
                                   for one in stored["spectra"]]), None
    with threadpool_limits(1):
        rows = run(database, spectra, kinds, arguments.cases, arguments.seed, arguments.naming,
                   arguments.harm)
    print()
    print(json.dumps({"summary": summary(rows)} | ({"rows": rows} if arguments.json else {}),
                     indent=None if arguments.json else 1))


if __name__ == "__main__":
    main()
