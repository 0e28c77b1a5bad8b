"""Recorded: uniform draws of all splines that give a signal, their exact bounds, and refinement."""
import dataclasses

import numpy as np
import pytest
from sampling_cameras import camera, measurement, response
from sampling_inputs import lopsided_measurement, lopsided_noise, result_or_refusal

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import ConvergenceError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import Outcome
from spectrabox.sampling.measurement import MeasurementOperator, spline_operator
from spectrabox.sampling.polytope import simplex
from spectrabox.sampling.polytope.bounds import (
    bounds_of_many,
    reflectance_bounds,
    signal_boxes,
    widenings,
)
from spectrabox.sampling.polytope.circuit_hit_and_run import plan_moves, run_chains, sample_in_bulk
from spectrabox.sampling.polytope.circuits import (
    Circuits,
    design,
    find_circuits,
    schedule,
    steps_for,
)
from spectrabox.sampling.polytope.diagnostics import Diagnosis, diagnose, refuse_poor, tail_shape
from spectrabox.sampling.polytope.linear_programmes import (
    bounds_of_one,
    linear_programmes,
    widening,
)
from spectrabox.sampling.polytope.null_space import null_space
from spectrabox.sampling.polytope.refinement import (
    choose_coefficients,
    lifting,
    log_evidence,
    residual_directions,
    sample_refined,
)
from spectrabox.sampling.polytope.simplex import Walk, highest
from spectrabox.sampling.polytope.tilt import (
    check_operator,
    is_reachable,
    max_entropy_tilt,
    tilt_moments,
)
from spectrabox.sampling.polytope.tilted_rejection import (
    basic_columns,
    collect,
    draw_tilted,
    noise_columns,
    sample_polytope,
)
from spectrabox.sampling.uniform import into_reach, sample_uniform


def operator(bands=3, coefficients=9, noise=0.0, seed=3, away=0.0):
    """A signal of uneven coefficients, moved away by so much in one band."""
    A = camera(coefficients, bands)
    c = np.random.default_rng(seed).uniform(0.05, 0.9, coefficients)
    covariance = lopsided_noise(bands, noise) if noise else np.zeros((bands, bands))
    return MeasurementOperator(A, A @ c + away * np.eye(bands)[0], covariance)


def test_moments_of_a_tilted_coefficient(recorded):
    h = np.array([-800, -40, -3, -0.0102, -0.0098, -1e-4, 0, 5e-3, 0.0099, 0.0101, 0.7, 9, 90, 1e5])
    log_z, mean, variance = tilt_moments(h)
    recorded((log_z, mean, variance))
    # mean and variance are the derivatives of the log-partition
    middle, step = np.array([-7.0, -0.5, 0.003, 2.0, 15.0]), 1e-3
    below, at, above = (tilt_moments(middle + move)[0] for move in (-step, 0, step))
    np.testing.assert_allclose((above - below) / (2 * step), tilt_moments(middle)[1], atol=1e-6)
    np.testing.assert_allclose((above - 2 * at + below) / step**2, tilt_moments(middle)[2],
                               atol=1e-5)


@pytest.mark.parametrize("bands, coefficients, noise, away", [
    (3, 9, 0.0, 0.0), (3, 7, 0.01, 0.0), (4, 13, 0.02, 0.0), (3, 5, 0.02, 0.5), (1, 6, 0.004, 0.0),
    (3, 6, 0.06, 0.9)])
def test_tilts(recorded, bands, coefficients, noise, away):
    one = operator(bands, coefficients, noise, away=away)
    tilt = max_entropy_tilt(one)
    # the gradient at the end is round-off
    recorded((tilt.theta, tilt.h, tilt.c, tilt.reachable, is_reachable(one), tilt.residual < 1e-8))
    recorded((log_evidence(one), noise_columns(one.noise_covariance)), case="evidence")
    np.testing.assert_allclose(one.A @ tilt.c + one.noise_covariance @ tilt.theta, one.y,
                               atol=1e-9)


def test_signals_near_the_edge_of_reach(recorded):
    """White and black, one per cent within and beyond, with noise and without."""
    A, found = camera(7), {}
    for level in (-0.01, 0.0, 0.01, 0.99, 1.0, 1.01):
        for noise in (0.0, 0.02):
            one = measurement(A, A @ np.full(7, level) + [0.0, 1e-3 * (level in (0.01, 0.99)), 0.0],
                              noise)
            found[f"{level} {noise}"] = (
                is_reachable(one), result_or_refusal(lambda one=one: max_entropy_tilt(one).c),
                result_or_refusal(log_evidence, one),
                result_or_refusal(lambda one=one: into_reach(one)))
    recorded(found, rtol=1e-4)      # where a tilt runs away, it stops at a step that round-off sets


@pytest.mark.parametrize("bands, coefficients, noise, away", [
    (3, 9, 0.0, 0.0), (3, 8, 0.01, 0.0), (5, 11, 0.03, 0.0), (2, 5, 0.02, 0.4), (3, 6, 0.06, 0.9)])
def test_exact_draws(recorded, bands, coefficients, noise, away):
    one = operator(bands, coefficients, noise, away=away)
    found = sample_polytope(one, 700, 5)
    recorded(found)
    # a band that reads 0.9 of white more than a reflectance gave it is out of reach
    assert (found.outcome is Outcome.UNREACHABLE) == (away == 0.9)
    if not noise:
        np.testing.assert_allclose(found.coefficients @ one.A.T, np.tile(one.y, (700, 1)),
                                   atol=1e-10)


def test_what_exact_draws_are_made_of(recorded):
    rng = np.random.default_rng(2)
    one = operator(3, 8, 0.01)
    columns = np.hstack([one.A, noise_columns(one.noise_covariance)])
    recorded((draw_tilted(np.array([-60.0, -1, 0, 0.4, 70]), rng.random((30, 5))),
              [basic_columns(columns, slope * max_entropy_tilt(one).theta @ columns, 8)
               for slope in (0.2, 1, 4)]))
    recorded([result_or_refusal(collect, lambda n, s=share: np.zeros((int(n * s), 2)), draws)
              for share, draws in ((0.5, 0), (0.5, 1), (0.31, 5000), (0.002, 9))], case="collected")


def test_a_hopeless_acceptance_is_refused(recorded):
    """Where 1 in 100 000 proposals or fewer is accepted, after two million."""
    def one_in(often):
        proposed = [0]

        def propose(count):
            before, proposed[0] = proposed[0] // often, proposed[0] + count
            return np.zeros((proposed[0] // often - before, 1))
        return propose
    recorded([result_or_refusal(lambda o=often: collect(one_in(o), 40)[1])
              for often in (95_000, 105_000)])


@pytest.mark.parametrize("bands, coefficients", [(3, 7), (4, 8)])
def test_bulk_draws(recorded, bands, coefficients):
    one = operator(bands, coefficients)
    found = sample_in_bulk(one, 1500, 4)
    serial = sample_in_bulk(one, 1500, 4, parallel=False)
    np.testing.assert_array_equal(found.coefficients, serial.coefficients)
    # single precision, and each machine fuses multiplications as it likes: chains of 30 moves
    recorded(found, rtol=1e-4)
    short = sample_in_bulk(one, 300, 4, steps=3)
    recorded(short, rtol=1e-4, case="short")
    np.testing.assert_allclose(found.coefficients @ one.A.T, np.tile(one.y, (1500, 1)), atol=1e-5)


@pytest.mark.parametrize("bands, coefficients", [(3, 7), (3, 13), (2, 6), (5, 9)])
def test_circuits_and_their_schedule(recorded, bands, coefficients):
    one, rng = operator(bands, coefficients), np.random.default_rng(6)
    found = find_circuits(one.A, rng)
    recorded(found)
    moved = np.zeros((len(found.members), coefficients))
    np.put_along_axis(moved, found.members, found.components, 1)
    np.testing.assert_allclose(one.A @ moved.T, 0, atol=3e-6)       # but for TINY components
    p = design(found, one.A, max_entropy_tilt(one).h, rng)
    order = schedule(found, p, 17, coefficients, rng)
    recorded((p, order, steps_for(coefficients, bands)), case="schedule")


def test_every_coefficient_is_visited(recorded):
    """A circuit that nobody would choose is put in for the coefficient that it moves."""
    circuits = Circuits(np.array([[0, 1, 2], [1, 2, 3], [0, 2, 3], [2, 3, 4]]),
                        np.array([[1, 0.31, -0.5], [-0.29, 1, 0.4], [0.6, -1, 0.35],
                                  [1, 0.5, 0.9]]))
    recorded([schedule(circuits, np.array([0.5, 0.3, 0.2, 0.0]), steps, 5,
                       np.random.default_rng(seed)) for seed, steps in enumerate((4, 7, 12))])
    recorded([steps_for(n, k) for n in (4, 5, 6, 10, 18, 31, 45) for k in (2, 3, 4, 6)],
             case="steps")


def test_chains_through_a_schedule(recorded):
    one, rng = operator(3, 8), np.random.default_rng(8)
    order, circuits = plan_moves(one, max_entropy_tilt(one), rng, steps=4)
    starts = sample_polytope(one, 37, 1).coefficients
    recorded(order)
    recorded(run_chains(starts, circuits, order, 290, rng, False), rtol=1e-4, case="ends")
    recorded([result_or_refusal(sample_in_bulk, operator(3, 8, 0.01), 10, 1)], case="refused")


def test_diagnoses(recorded):
    rng = np.random.default_rng(9)
    starts = rng.random((40, 4))
    ends = 0.6 * starts[np.arange(330) % 40] + 0.4 * rng.random((330, 4)) * [1, 2, 0.2, 3]
    ends[:, 3] = 0.5
    drifting = ends + np.linspace(0, 0.3, 330)[:, None]
    recorded((diagnose(starts, ends), diagnose(starts, drifting, 5), diagnose(starts[:30],
                                                                              ends[:30])))
    recorded([result_or_refusal(refuse_poor, Diagnosis(r_hat, effective, 2), 1000)
              for r_hat in (1.0099, 1.01, 1.0101) for effective in (499.0, 500.0, 501.0)],
             case="refused")
    recorded([tail_shape(weights) for weights in
              (np.ones(100), rng.random(24), rng.random(26), rng.pareto(1.2, 900),
               rng.pareto(3, 80), np.exp(rng.normal(0, 2, 400)),
               np.r_[np.zeros(95), rng.random(5)])], case="tails")


BOUNDS = [(3, 9, 0.0, 0.0, 0.95), (3, 7, 0.01, 0.0, 0.8), (3, 7, 0.002, 0.45, 0.95),
          (2, 6, 0.0, 0.6, 0.9), (5, 8, 0.02, 0.0, 0.99)]


@pytest.mark.parametrize("bands, coefficients, noise, away, level", BOUNDS)
def test_bounds(recorded, bands, coefficients, noise, away, level):
    one = operator(bands, coefficients, noise, away=away)
    basis = basis_matrix(visible_grid(20).nm, coefficients)
    found = reflectance_bounds(one, basis, level)
    boxes = signal_boxes(one.A, one.y[None], one.noise_covariance[None], level)
    # eigenvectors of the noise may turn their sign; what is asked of the box does not
    recorded((found, boxes.half_width, widenings(boxes), np.abs(boxes.centre)))
    recorded((bounds_of_one(boxes, 0, basis), widening(boxes, 0)), rtol=1e-5, case="by programmes")
    np.testing.assert_allclose(found, bounds_of_one(boxes, 0, basis), atol=1e-6)


def test_bounds_of_many_signals(recorded):
    one, rng = operator(3, 8, 0.01), np.random.default_rng(3)
    signals = np.vstack([one.y + rng.normal(0, 0.05, (4, 3)), [1, 1, 1], [1.3, 0.9, 0.8]])
    noise = np.array([lopsided_noise(3, size) for size in (0.001, 0.01, 0.02, 0.05, 0.003, 0.004)])
    noise[1] = 0
    basis = basis_matrix(visible_grid(30).nm, 8)
    found = bounds_of_many(one.A, signals, noise, basis)
    recorded(found)
    for row in range(6):
        np.testing.assert_allclose(np.array(found)[:, row], reflectance_bounds(
            MeasurementOperator(one.A, signals[row], noise[row]), basis), atol=1e-7)
    with pytest.MonkeyPatch.context() as patched:      # no walk ends: one programme at a time
        patched.setattr(simplex, "MAX_PIVOTS", 0)
        np.testing.assert_allclose(bounds_of_many(one.A, signals, noise, basis), found, atol=1e-6)
    white = signal_boxes(one.A, np.ones((1, 3)), np.zeros((1, 3, 3)), 0.95)
    np.testing.assert_allclose(bounds_of_one(white, 0, basis), 1, atol=1e-5)
    boxes = signal_boxes(one.A, signals, noise, 0.95)
    some = boxes.of(np.array([3, 1]), 0.01)
    np.testing.assert_allclose(some.half_width, boxes.half_width[[3, 1]] + 0.01)
    recorded(linear_programmes(boxes.of(np.array([3])), basis), rtol=1e-5, case="one")
    with pytest.raises(ConvergenceError, match=r"of the bounds was not solved .*; state a larger"):
        linear_programmes(boxes.of(np.array([5])), basis)


def test_walks_of_a_simplex(recorded, monkeypatch):
    rng = np.random.default_rng(5)
    A, upper = rng.normal(size=(6, 2, 5)), rng.uniform(0.5, 2, (6, 5))
    upper[2, 3] = 0
    y = np.einsum("skn,sn->sk", A, upper * rng.uniform(0.1, 0.9, (6, 5)))
    y[4] += 40
    functions = rng.normal(size=(7, 5))
    values, ends = highest(A, y, upper, functions)
    recorded((values, [str(end.name) for end in ends]))
    assert ends[4] is Walk.EMPTY
    monkeypatch.setattr(simplex, "AT_ONCE", 2)
    monkeypatch.setattr(simplex, "REFACTOR", 1)
    np.testing.assert_allclose(highest(A, y, upper, functions)[0], values, atol=1e-9)
    monkeypatch.setattr(simplex, "MAX_PIVOTS", 1)
    recorded([str(end.name) for end in highest(A, y, upper, functions)[1]], case="stalled")


def test_null_spaces(recorded):
    one = operator(3, 7)
    space = null_space(one, np.linspace(0.1, 0.7, 7))
    recorded((space.c0, space.singular_values, space.directions @ space.directions.T))
    found = {}
    for weakest in (0.97e-8, 1.03e-8):
        u, s, vt = np.linalg.svd(one.A, full_matrices=False)
        A = (u * [s[0], s[1], weakest * s[0]]) @ vt
        found[str(weakest)] = str(result_or_refusal(lambda A=A: null_space(
            dataclasses.replace(one, A=A), np.zeros(7)).directions.shape))
    recorded((found, result_or_refusal(null_space, dataclasses.replace(one, A=0 * one.A),
                                       np.zeros(7))), case="rank")


def test_operators_that_are_refused(recorded):
    one, nan = operator(3, 7, 0.01), np.array([0.1, np.nan, 0.2])
    skewed = one.noise_covariance + np.array([[0, 1e-4, 0], [0, 0, 0], [0, 0, 0]])
    basis = np.eye(7)
    recorded({
        "good": result_or_refusal(check_operator, one),
        "y": result_or_refusal(check_operator, dataclasses.replace(one, y=nan)),
        "A": result_or_refusal(check_operator, dataclasses.replace(one, A=one.A * nan[:, None])),
        "noise": result_or_refusal(check_operator, dataclasses.replace(
            one, noise_covariance=np.diag(nan))),
        "skewed": result_or_refusal(check_operator,
                                    dataclasses.replace(one, noise_covariance=skewed)),
        "many bands": result_or_refusal(check_operator, operator(4, 4, seed=1)),
        "more bands": result_or_refusal(check_operator, MeasurementOperator(
            camera(4, 5), np.zeros(5), np.zeros((5, 5)))),
        "basis": [result_or_refusal(reflectance_bounds, one, wrong)
                  for wrong in (np.eye(6), np.ones(7))],
        "level": [result_or_refusal(signal_boxes, one.A, one.y[None], one.noise_covariance[None],
                                    level) for level in (0, 1, -0.2, 95)],
        "signals": result_or_refusal(bounds_of_many, one.A, np.array([one.y, nan]),
                                     np.array([one.noise_covariance] * 2), basis),
        "covariances": result_or_refusal(bounds_of_many, one.A, np.array([one.y, one.y]),
                                         np.array([one.noise_covariance, skewed]), basis)})


@pytest.mark.parametrize("coarse, fine", [(5, 7), (5, 9), (7, 11), (6, 12)])
def test_refinement(recorded, coarse, fine):
    T = lifting(coarse, fine)
    recorded(T)
    np.testing.assert_allclose(T.sum(axis=1), 1, atol=1e-9)
    measured = lopsided_measurement(3, 0.004)
    directions = residual_directions(spline_operator(measured, fine).A, T)
    recorded((directions.shape, directions @ directions.T), case="directions")
    whole = spline_operator(measured, coarse)
    found = sample_refined(measured, whole, fine, 300, 7)
    # twenty moves along directions that rounding turns a little
    recorded(found, rtol=1e-4, case="draws")
    np.testing.assert_allclose(
        found.coefficients @ spline_operator(measured, fine).A.T,
        sample_polytope(whole, 300, 7).coefficients @ whole.A.T, atol=2e-4)


def test_the_number_of_coefficients(recorded):
    grid, matrix = response(3)
    signals = np.array([[0.31, 0.42, 0.27], [0.61, 0.33, 0.52], [0.2, 0.45, 0.71]])
    noise = lopsided_noise(3, 0.01)
    recorded((choose_coefficients(matrix, grid.nm, signals, noise),
              choose_coefficients(matrix, grid.nm, signals, noise, (7, 6, 12))))
    recorded([result_or_refusal(lifting, coarse, fine) for coarse, fine in
              ((5, 5), (5, 8), (7, 5), (9, 20))]
             + [result_or_refusal(choose_coefficients, matrix, grid.nm, signals + 1, 0 * noise)],
             case="refused")


@pytest.mark.parametrize("bands, noise, signal", [
    (3, 0.0, [0.35, 0.3, 0.41]), (3, 0.01, [0.35, 0.3, 0.41]), (3, 0.0, [0.2, 0.95, 0.15]),
    (3, 0.05, [0.9, 1.6, 0.7]), (3, 0.0, [0.9, 1.6, 0.7]), (3, 0.0, [40.0, -20, 30]),
    (6, 0.0, [.35, .3, .33, .41, .4, .45])])
def test_uniform_draws(recorded, bands, noise, signal):
    measured = dataclasses.replace(lopsided_measurement(bands, noise), signal=np.array(signal))
    found = result_or_refusal(sample_uniform, measured, 1100, 3, 13 if bands == 6 else 9)
    # a signal that had to be moved is the end of a bounded fit; more than five bands walk in single
    # precision
    recorded(found, rtol=1e-4)
    if isinstance(found, str):
        with pytest.raises(ConvergenceError):
            into_reach(spline_operator(measured, 9))
