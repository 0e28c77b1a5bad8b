"""Lowest and highest reflectance over all spectra that fit: closed forms, draws inside, signals out
of reach, many signals at once.
"""

import numpy as np
import pytest
from sampling_cameras import camera, grey, measurement
from scipy.stats import chi2

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import basis_matrix
from spectrabox.sampling.polytope import bounds, simplex
from spectrabox.sampling.polytope.bounds import (
    bounds_of_many,
    linear_programmes,
    reflectance_bounds,
    signal_boxes,
    widening,
    widenings,
)
from spectrabox.sampling.polytope.tilted_rejection import sample_polytope
from spectrabox.sampling.spectral_measurement import MeasurementOperator

NM = np.linspace(400, 700, 13)
# HiGHS keeps every constraint to 1e-7; small pivots of these cameras enlarge that less than ten
# times
SOLVER = 1e-6
TIGHT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}    # of HiGHS


def test_a_coefficient_seen_alone_is_bounded_by_its_noise():
    error = 0.05
    lower, upper = reflectance_bounds(measurement(np.eye(2, 4), np.array([0.5, 0.02]), error),
                                      np.eye(4), level=0.9)
    radius = error * np.sqrt(chi2.ppf(0.9, 2))
    np.testing.assert_allclose(lower, [0.5 - radius, 0, 0, 0], atol=SOLVER)
    np.testing.assert_allclose(upper, [0.5 + radius, 0.02 + radius, 1, 1], atol=SOLVER)


@pytest.mark.parametrize("coefficients", [5, 9, 21])
def test_every_draw_lies_within_the_bounds(coefficients):
    operator, basis = grey(coefficients), basis_matrix(NM, coefficients)
    spectra = sample_polytope(operator, 2_000, seed=1)[0] @ basis.T
    lower, upper = reflectance_bounds(operator, basis)
    assert np.all(spectra > lower - SOLVER)
    assert np.all(spectra < upper + SOLVER)


def boxes_of(operator, level=0.95):
    return signal_boxes(operator.A, operator.y[None], operator.noise_covariance[None], level)


def reference(operator, basis):
    directions, centre, half_width = (each[0] for each in boxes_of(operator))
    wider = half_width + widening(directions, centre, half_width, TIGHT)
    return linear_programmes(directions, centre, wider, basis, TIGHT)


def random_problem(kind, noise, seed):
    """A camera of random weights, a signal, and its noise; five functions to bound."""
    rng = np.random.default_rng(seed)
    bands = int(rng.integers(1, 6))
    coefficients = int(rng.integers(bands + 2, 22))
    A = rng.dirichlet(np.ones(coefficients), bands)
    c = rng.uniform(0.05, 0.95, coefficients)
    if kind == "degenerate":            # a corner of the box, or a point on an edge of it
        c = np.round(c)
        c[:bands - 1] = 0.5
    y = A @ c + (0.8 * rng.uniform(0.5, 1, bands) if kind == "unreachable" else 0.0)
    root = {"none": np.zeros((bands, 1)), "one direction": 0.01 * rng.standard_normal((bands, 1)),
            "every band": 0.01 * rng.standard_normal((bands, bands))}[noise]
    return MeasurementOperator(A, y, root @ root.T), rng.uniform(size=(5, coefficients))


@pytest.mark.parametrize("noise", ["none", "one direction", "every band"])
@pytest.mark.parametrize("kind", ["inside", "degenerate", "unreachable"])
def test_bounds_of_random_problems_equal_those_of_a_general_solver(kind, noise):
    for seed in range(12):
        operator, functions = random_problem(kind, noise, seed)
        for ours, theirs in zip(reflectance_bounds(operator, functions),
                                reference(operator, functions), strict=True):
            # HiGHS keeps its constraints to 1e-10, the largest dual prices here are below ten.
            np.testing.assert_allclose(ours, theirs, atol=1e-9)


@pytest.mark.parametrize("coefficients, bands", [(5, 3), (13, 3), (40, 3), (13, 1), (13, 8)])
@pytest.mark.parametrize("error", [0.0, 0.01])
def test_bounds_of_cameras_need_no_general_solver(coefficients, bands, error, monkeypatch):
    operator, basis = grey(coefficients, error, bands), basis_matrix(NM, coefficients)
    theirs = reference(operator, basis)
    monkeypatch.setattr(bounds, "bounds_of_one", None)
    # HiGHS keeps its constraints to 1e-10; eight narrow bands have dual prices up to a hundred.
    np.testing.assert_allclose(reflectance_bounds(operator, basis), theirs, atol=1e-8)


@pytest.mark.parametrize("error", [0.0, 0.01])
def test_out_of_reach_the_bounds_widen_by_the_least_that_fits(error):
    operator = measurement(np.eye(2, 4), np.array([0.5, 1.3]), error)
    slack = 0.3 - error * np.sqrt(chi2.ppf(0.95, 2))
    assert widenings(*boxes_of(operator)) == pytest.approx(slack, abs=SOLVER)
    lower, upper = reflectance_bounds(operator, np.eye(4))
    np.testing.assert_allclose(lower, [0.2, 1, 0, 0], atol=SOLVER)
    np.testing.assert_allclose(upper, [0.8, 1, 1, 1], atol=SOLVER)


@pytest.mark.parametrize("error", [0.0, 0.01])
def test_signals_within_reach_need_no_widening(error):
    assert widenings(*boxes_of(grey(7, error))) == 0


def many_signals(coefficients=13, count=40, seed=3):
    """A camera, signals within its reach, on its edge (black, white) and beyond it, and noise of
    their own.
    """
    rng = np.random.default_rng(seed)
    A = camera(coefficients)
    signals = rng.uniform(size=(count, coefficients)) @ A.T
    signals[:2], signals[2:5] = [[0.0], [1.0]], rng.uniform(1.05, 1.4, (3, 3))
    roots = rng.uniform(0, 0.01, (count, 3, 1)) * rng.standard_normal((count, 3, 3))
    roots[::2] = 0
    return A, signals, roots @ roots.transpose(0, 2, 1), basis_matrix(NM, coefficients)


@pytest.mark.parametrize("coefficients", [5, 13, 21])
def test_many_signals_have_the_bounds_of_each_alone(coefficients):
    A, signals, noise, basis = many_signals(coefficients)
    together = np.array(bounds_of_many(A, signals, noise, basis))
    alone = np.array([reflectance_bounds(MeasurementOperator(A, y, R), basis)
                      for y, R in zip(signals, noise, strict=True)]).transpose(1, 0, 2)
    # Another order of pivots: round-off over the smallest weight of a coefficient in A, 1e-3.
    np.testing.assert_allclose(together, alone, atol=1e-10)


def test_more_signals_than_are_walked_at_once_keep_their_bounds():
    A, signals, noise, basis = many_signals()
    once = np.array(bounds_of_many(A, signals, noise, basis))
    many = np.array(bounds_of_many(A, np.tile(signals, (30, 1)), np.tile(noise, (30, 1, 1)), basis))
    # round-off, as above
    np.testing.assert_allclose(many, np.tile(once, (1, 30, 1)), atol=1e-10)


def test_where_the_walk_stalls_the_general_solver_takes_over(monkeypatch):
    A, signals, noise, basis = many_signals(count=12)
    walked = np.array(bounds_of_many(A, signals, noise, basis))
    monkeypatch.setattr(simplex, "MAX_PIVOTS", 3)
    # HiGHS's 1e-7 over the smallest weight of a coefficient in A, 1e-3.
    np.testing.assert_allclose(bounds_of_many(A, signals, noise, basis), walked, atol=1e-4)


@pytest.mark.parametrize("level", [0.0, 1.0, 95.0])
def test_a_level_that_is_no_probability_is_an_error(level):
    with pytest.raises(InputError, match=f"a level of {level} was asked for; it is a probability "
                       "between 0 and 1"):
        reflectance_bounds(grey(7), basis_matrix(NM, 7), level)


def test_a_basis_of_another_size_is_an_error():
    with pytest.raises(InputError, match=r"the basis has shape \(13, 9\); \(P, 7\) is needed"):
        reflectance_bounds(grey(7), basis_matrix(NM, 9))


def test_a_signal_that_is_not_finite_is_an_error():
    with pytest.raises(InputError, match="y of the measurement holds numbers that are not finite"):
        reflectance_bounds(measurement(camera(7), np.array([0.5, np.inf, 0.5])),
                           basis_matrix(NM, 7))
