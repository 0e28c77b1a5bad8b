"""Uniform draws as ``sample`` makes them, many at once, beside hopsy where it is installed, in one
process.

Also exact bounds against HiGHS, draws from the learnt prior per second, and the error of the table
of ``uplift``. The camera is synthetic. Times are the processor's, of all threads together.
"""
from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from spectrabox.radiometry.grid import basis_matrix, visible_grid
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.sampling.draw_methods import draw_spectra
from spectrabox.sampling.polytope.bounds import bounds_of_many, linear_programmes, signal_boxes
from spectrabox.sampling.polytope.tilt import max_entropy_tilt, tilt_moments
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior, reflectance
from spectrabox.sampling.prior.uplift_table import (
    build_tables,
    relative_errors,
    uplift_pixels,
    uplift_signals,
)
from spectrabox.sampling.spectral_measurement import MeasurementOperator, spline_operator

NM = PRIOR_GRID.nm
NOISE_OF_TABLE = 0.01   # relative
REPEATS = 5
COEFFICIENTS = 11       # of the splines fitted to draws of the prior


def measurement() -> SpectralMeasurement:
    """A three-band camera under a smooth light, seeing an orange."""
    grid = visible_grid(5)
    curves = np.exp(-0.5 * ((grid.nm - np.array([[450], [530], [610]])) / 35)**2)
    response = curves * (1 + 0.3 * np.sin(grid.nm / 40)) * grid.weights_nm
    response /= response.sum(axis=1, keepdims=True)
    surface = 0.06 + 0.55 / (1 + np.exp(-(grid.nm - 570) / 18))
    return SpectralMeasurement(grid, response, response @ surface, np.zeros((3, 3)))


def seconds(work: Callable[[], Any]) -> float:
    """Processor seconds of the shortest of five runs, after one that is not counted."""
    work()
    times = []
    for _ in range(REPEATS):
        started = time.process_time()
        work()
        times.append(time.process_time() - started)
    return min(times)


def uniform_row(coefficients: int, draws: int) -> dict[str, Any]:
    """``draw_spectra`` with the method "uniform", as ``sample --method uniform`` calls it; every
    draw is independent.
    """
    one = measurement()
    taken = seconds(lambda: draw_spectra(one, "uniform", draws, 1, coefficients))
    return {"coefficients": coefficients, "ms": 1e3 * taken, "per_second": draws / taken,
            "hopsy": hopsy_row(spline_operator(one, coefficients),
                               basis_matrix(NM, coefficients))}


def hopsy_row(operator: MeasurementOperator, basis: np.ndarray) -> dict[str, float] | None:
    """Effective draws per second of hopsy's uniform coordinate hit-and-run on the rounded polytope,
    or None.
    """
    try:
        import hopsy  # a peer to compare with, no dependency of the project
    except ImportError:
        return None
    from scipy.linalg import null_space
    theta, _ = max_entropy_tilt(operator)
    point, Z = tilt_moments(theta @ operator.A)[1], null_space(operator.A)
    started = time.process_time()
    problem = hopsy.Problem(np.vstack([Z, -Z]), np.r_[1 - point, point],
                            starting_point=np.zeros(Z.shape[1]))
    problem = hopsy.round(problem)
    rounding = time.process_time() - started
    chain = hopsy.MarkovChain(problem, hopsy.UniformCoordinateHitAndRunProposal)
    started = time.process_time()
    _, states = hopsy.sample(chain, hopsy.RandomNumberGenerator(1), n_samples=20_000,
                             thinning=Z.shape[1])
    taken = time.process_time() - started
    spectra = (point + np.asarray(states)[0] @ Z.T) @ basis.T
    return {"effective_per_s": float(effective_sample_size(spectra[:, None]).min() / taken),
            "rounding_s": rounding}


def effective_sample_size(values: np.ndarray) -> np.ndarray:
    """Effective number of draws (D,) of one chain's values (steps, 1, D), by Geyer's initial
    positive sequence.
    """
    steps = len(values)
    spectrum = np.fft.rfft(values - values.mean(axis=0), 2 * steps, axis=0)
    correlation = np.fft.irfft(np.abs(spectrum)**2, axis=0)[:steps].mean(axis=1)
    correlation /= np.maximum(correlation[0], 1e-300)
    pairs = correlation[:steps // 2 * 2].reshape(-1, 2, values.shape[2]).sum(axis=1)
    positive = np.cumprod(pairs > 0, axis=0)
    return np.minimum(steps / np.maximum(2 * np.sum(pairs * positive, axis=0) - 1, 1e-3), steps)


def bounds_row(coefficients: int, signals: int) -> dict[str, float]:
    """122 linear programmes of a signal, many signals at once: ours, HiGHS through SciPy, and how
    far apart they are.
    """
    A, basis = spline_operator(measurement(), coefficients).A, basis_matrix(NM, coefficients)
    seen = np.random.default_rng(0).uniform(0.05, 0.95, (signals, coefficients)) @ A.T
    noise = np.zeros((signals, 3, 3))
    ours = seconds(lambda: bounds_of_many(A, seen, noise, basis)) / signals
    one = seconds(lambda: bounds_of_many(A, seen[:1], noise[:1], basis))
    directions, centre, half_width = signal_boxes(A, seen[:1], noise[:1], 0.95)
    started = time.process_time()
    theirs = linear_programmes(directions[0], centre[0], half_width[0], basis)
    highs = time.process_time() - started
    apart = np.abs(np.array(bounds_of_many(A, seen[:1], noise[:1], basis))[:, 0] - theirs).max()
    return {"coefficients": coefficients, "ms": 1e3 * ours, "one_ms": 1e3 * one,
            "highs_ms": 1e3 * highs, "ratio": highs / ours, "difference": float(apart)}


def prior_row(draws: int) -> dict[str, float]:
    """Draws of the learnt prior per second and how well they keep the signal."""
    one = measurement()
    taken = seconds(lambda: draw_spectra(one, "prior", draws, 1, COEFFICIENTS))
    spectra = draw_spectra(one, "prior", draws, 1, COEFFICIENTS).spectra
    misfit = float(np.abs(spectra @ one.relative_response.T - one.signal).max())
    return {"draws": draws, "per_second": draws / taken, "misfit": misfit}


def table_row(side: int) -> dict[str, float]:
    """How far the table of ``uplift`` is from the direct way, on 300 signals of the prior."""
    one, prior = measurement(), load_prior()
    rng = np.random.default_rng(0)
    chosen = rng.choice(prior.weights.size, 300, p=prior.weights)
    spectra = reflectance(np.array([rng.multivariate_normal(prior.means[c], prior.covariances[c])
                                    for c in chosen]))
    [table], row = build_tables(prior, one.relative_response,
                                lambda signals: [relative_errors(signals, NOISE_OF_TABLE)],
                                np.ones((side,) * 3, bool))
    signals = spectra @ one.relative_response.T
    exact_mean, exact_spread, _ = uplift_signals(prior, one.relative_response, signals,
                                                 relative_errors(signals, NOISE_OF_TABLE))
    mean, spread = uplift_pixels(table, row, signals)
    return {"side": side, "mean": float(np.sqrt(np.mean((mean - exact_mean)**2))),
            "standard_deviation": float(np.sqrt(np.mean((spread - exact_spread)**2))
                                        / exact_spread.mean())}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--coefficients", type=int, nargs="+", default=[7, 13, 15, 21, 31])
    parser.add_argument("--draws", type=int, default=100_000)
    parser.add_argument("--signals", type=int, default=1000, help="whose bounds are computed")
    parser.add_argument("--side", type=int, default=17, help="of the table for images")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the tables")
    arguments = parser.parse_args()
    found = {"uniform": [uniform_row(count, arguments.draws) for count in arguments.coefficients],
             "bounds": [bounds_row(count, arguments.signals) for count in arguments.coefficients],
             "prior": prior_row(arguments.draws), "table": table_row(arguments.side)}
    if arguments.json:
        print(json.dumps(found))
        return
    print(f"{'N':>3} {'ms':>7} {'draws/s':>8} {'hopsy ESS/s':>12} {'ratio':>6}")
    for row in found["uniform"]:
        peer = row["hopsy"]
        text = (f"{peer['effective_per_s']:12.3g} "
                f"{row['per_second'] / peer['effective_per_s']:6.0f}" if peer
                else f"{'absent':>12} {'':>6}")
        print(f"{row['coefficients']:3d} {row['ms']:7.1f} {row['per_second']:8.2g} {text}")
    print(f"\n{'N':>3} {'bounds ms':>10} {'alone ms':>10} {'HiGHS ms':>10} {'ratio':>7} "
          f"{'difference':>11}")
    for row in found["bounds"]:
        print(f"{row['coefficients']:3d} {row['ms']:10.3f} {row['one_ms']:10.1f} "
              f"{row['highs_ms']:10.0f} "
              f"{row['ratio']:7.0f} {row['difference']:11.1e}")
    one, table = found["prior"], found["table"]
    print(f"\nlearnt prior: {one['per_second']:.0f} draws per second, signal kept to "
          f"{one['misfit']:.0e}")
    print(f"table of side {table['side']}: mean within {table['mean']:.4f} rms, spread within "
          f"{100 * table['standard_deviation']:.0f} %")


if __name__ == "__main__":
    main()
