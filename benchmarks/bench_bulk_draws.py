"""Bulk uniform draws: circuit hit-and-run against tilted rejection and, where it is installed,
hopsy, in one process.

Also exact bounds against HiGHS, draws from the learnt prior per second, and a million pixels
through the table. The camera is synthetic; run with OMP_NUM_THREADS=1 and NUMBA_NUM_THREADS=1 for
one thread.
"""
from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import SpectralMeasurement
from spectrabox.sampling.measurement import MeasurementOperator, spline_operator
from spectrabox.sampling.polytope.bounds import bounds_of_many, signal_boxes
from spectrabox.sampling.polytope.circuit_hit_and_run import STARTS, plan_moves, run_chains
from spectrabox.sampling.polytope.diagnostics import diagnose
from spectrabox.sampling.polytope.linear_programmes import linear_programmes
from spectrabox.sampling.polytope.tilt import max_entropy_tilt
from spectrabox.sampling.polytope.tilted_rejection import collect, sample_polytope, tilted_proposals
from spectrabox.sampling.prior.draws import prior_spectra
from spectrabox.sampling.prior.mixture import GRID, load_prior
from spectrabox.sampling.prior.tables import build_table, uplift_pixels

NM = GRID.nm
REPEATS = 5


def measurement() -> SpectralMeasurement:
    """A three-band camera under a smooth light, seeing an orange."""
    grid = visible_grid(5)
    curves = np.exp(-0.5 * ((grid.nm - np.array([[450], [530], [610]])) / 35)**2)
    response = curves * (1 + 0.3 * np.sin(grid.nm / 40)) * grid.weights_nm
    response /= response.sum(axis=1, keepdims=True)
    surface = 0.06 + 0.55 / (1 + np.exp(-(grid.nm - 570) / 18))
    return SpectralMeasurement(grid, response, response @ surface, np.zeros((3, 3)))


def seconds(work: Callable[[], Any]) -> float:
    """Shortest of five runs, after one that is not counted."""
    work()
    times = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return min(times)


def bulk_row(coefficients: int, draws: int) -> dict[str, Any]:
    """Circuit hit-and-run and tilted rejection at one size."""
    operator = spline_operator(measurement(), coefficients)
    basis = basis_matrix(NM, coefficients)
    rng = np.random.default_rng(0)
    started = time.perf_counter()
    tilt = max_entropy_tilt(operator)
    order, circuits = plan_moves(operator, tilt, rng)
    planned = time.perf_counter() - started
    starts = collect(tilted_proposals(operator, tilt, rng), STARTS)[0]
    set_up = time.perf_counter() - started
    one = seconds(lambda: run_chains(starts, circuits, order, draws, rng, False))
    both = seconds(lambda: run_chains(starts, circuits, order, draws, rng, True))
    ends = run_chains(starts, circuits, order, draws, rng, False)
    found = diagnose(starts[np.arange(draws) % STARTS] @ basis.T, ends @ basis.T)
    independent = min(draws, 5000)
    started = time.perf_counter()
    reference = sample_polytope(operator, independent, 1).coefficients @ basis.T
    rejection = (time.perf_counter() - started) / independent * draws
    spread = (ends @ basis.T).std(axis=0) / reference.std(axis=0)
    return {"coefficients": coefficients, "steps": len(order), "plan_ms": 1e3 * planned,
            "set_up_ms": 1e3 * set_up, "ms_one_thread": 1e3 * one, "ms_all_threads": 1e3 * both,
            "r_hat": found.r_hat,
            "effective_share": found.effective_samples / draws, "rejection_ms": 1e3 * rejection,
            "ratio": rejection / one,
            "drift": float(np.abs(ends @ operator.A.T - operator.y).max() / operator.y.max()),
            "sigma_ratio": [float(spread.min()), float(spread.max())],
            "effective_per_s": found.effective_samples / one, "hopsy": hopsy_row(operator, basis)}


def hopsy_row(operator: MeasurementOperator, basis: np.ndarray) -> dict[str, float] | None:
    """Effective draws per second of hopsy's uniform coordinate hit-and-run on the rounded polytope,
    or None.
    """
    try:
        import hopsy  # a peer to compare with, no dependency of the project
    except ImportError:
        return None
    from scipy.linalg import null_space
    point, Z = max_entropy_tilt(operator).c, null_space(operator.A)
    started = time.perf_counter()
    problem = hopsy.Problem(np.vstack([Z, -Z]), np.r_[1 - point, point],
                            starting_point=np.zeros(Z.shape[1]))
    problem = hopsy.round(problem)
    rounding = time.perf_counter() - started
    chain = hopsy.MarkovChain(problem, hopsy.UniformCoordinateHitAndRunProposal)
    started = time.perf_counter()
    _, states = hopsy.sample(chain, hopsy.RandomNumberGenerator(1), n_samples=20_000,
                             thinning=Z.shape[1])
    taken = time.perf_counter() - started
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
    boxes = signal_boxes(A, seen[:1], noise[:1], 0.95)
    started = time.perf_counter()
    theirs = linear_programmes(boxes, basis)
    highs = time.perf_counter() - started
    apart = np.abs(np.array(bounds_of_many(A, seen[:1], noise[:1], basis))[:, 0] - theirs).max()
    return {"coefficients": coefficients, "ms": 1e3 * ours, "one_ms": 1e3 * one,
            "highs_ms": 1e3 * highs, "ratio": highs / ours, "difference": float(apart)}


def prior_row(draws: int) -> dict[str, float]:
    """Draws of the learnt prior per second and how well they keep the signal."""
    one, prior = measurement(), load_prior()
    taken = seconds(lambda: prior_spectra(one, draws, 1, prior))
    spectra = prior_spectra(one, draws, 1, prior).spectra
    misfit = float(np.abs(spectra @ one.relative_response.T - one.signal).max())
    return {"draws": draws, "per_second": draws / taken, "misfit": misfit}


def map_row(pixels: int, side: int) -> dict[str, float]:
    """Mean and spread at 61 wavelengths of many pixels."""
    from spectrabox.sampling.prior.tables import table_error

    one, prior = measurement(), load_prior()
    started = time.perf_counter()
    table = build_table(prior, one.relative_response, side=side)
    built = time.perf_counter() - started
    rng = np.random.default_rng(0)
    means = 1 / (1 + np.exp(-np.array([rng.multivariate_normal(prior.means[c], prior.covariances[c])
                                       for c in rng.choice(prior.weights.size, 300,
                                                           p=prior.weights)])))
    signals = np.repeat(means @ one.relative_response.T, pixels // 300 + 1,
                        axis=0)[:pixels].astype(np.float32)
    taken = seconds(lambda: uplift_pixels(table, signals))
    return {"pixels": pixels, "side": side, "build_s": built, "s": taken,
            **table_error(table, prior, means @ one.relative_response.T)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--coefficients", type=int, nargs="+", default=[5, 7, 13, 15, 21, 31])
    parser.add_argument("--draws", type=int, default=100_000)
    parser.add_argument("--signals", type=int, default=1000, help="whose bounds are computed")
    parser.add_argument("--side", type=int, default=17, help="of the table for images")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the tables")
    arguments = parser.parse_args()
    found = {"bulk": [bulk_row(count, arguments.draws) for count in arguments.coefficients],
             "bounds": [bounds_row(count, arguments.signals)
                        for count in arguments.coefficients if count > 5],
             "prior": prior_row(arguments.draws), "map": map_row(1_000_000, arguments.side)}
    if arguments.json:
        print(json.dumps(found))
        return
    print(f"{'N':>3} {'steps':>5} {'plan':>6} {'set-up':>7} {'1 thread':>9} {'all':>6} "
          f"{'R-hat':>8} {'ESS/n':>6} {'rejection ms':>12} {'ratio':>6} {'drift':>8} "
          f"{'sigma ratio':>13} {'hopsy ESS/s':>12} {'ratio':>6}")
    for row in found["bulk"]:
        peer = row["hopsy"]
        text = (f"{peer['effective_per_s']:12.3g} "
                f"{row['effective_per_s'] / peer['effective_per_s']:6.0f}" if peer
                else f"{'absent':>12} {'':>6}")
        print(f"{row['coefficients']:3d} {row['steps']:5d} {row['plan_ms']:6.1f} "
              f"{row['set_up_ms']:7.1f} {row['ms_one_thread']:9.1f} {row['ms_all_threads']:6.1f} "
              f"{row['r_hat']:8.5f} {row['effective_share']:6.3f} {row['rejection_ms']:12.0f} "
              f"{row['ratio']:6.0f} {row['drift']:8.1e} "
              f"{row['sigma_ratio'][0]:6.3f}-{row['sigma_ratio'][1]:.3f} {text}")
    print(f"\n{'N':>3} {'bounds ms':>10} {'alone ms':>10} {'HiGHS ms':>10} {'ratio':>7} "
          f"{'difference':>11}")
    for row in found["bounds"]:
        print(f"{row['coefficients']:3d} {row['ms']:10.3f} {row['one_ms']:10.1f} "
              f"{row['highs_ms']:10.0f} "
              f"{row['ratio']:7.0f} {row['difference']:11.1e}")
    one, image = found["prior"], found["map"]
    print(f"\nlearnt prior: {one['per_second']:.0f} draws per second, signal kept to "
          f"{one['misfit']:.0e}")
    print(f"{image['pixels']} pixels, mean and spread at 61 wavelengths: {image['s']:.2f} s (table "
          f"of side {image['side']} built in {image['build_s']:.1f} s); mean within "
          f"{image['mean']:.4f} rms, spread within {100 * image['standard_deviation']:.0f} %")


if __name__ == "__main__":
    main()
