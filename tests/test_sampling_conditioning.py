"""More measurements, plans, budgets, scores, refinement and N: laws and cases with known
answers.
"""
import numpy as np
import pytest
from sampling_cameras import camera, grey, measurement, response, seen, surface
from scipy.integrate import trapezoid

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import basis_matrix
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.sampling.draw_methods import draw_spectra
from spectrabox.sampling.evaluation.metrics import (
    coverage,
    curve_coverage,
    rmse,
    spectral_angle,
    winkler_score,
)
from spectrabox.sampling.further.more_measurements import Reading, condition, same_material
from spectrabox.sampling.polytope.refinement import (
    lifting,
    residual_directions,
    sample_refined,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.prior.mixture_posterior import mean_and_spread, posterior, with_floor
from spectrabox.sampling.prior.signal_posterior import solve_posterior
from spectrabox.sampling.summary import METAMERISM, grown_by_causes
from spectrabox.sampling.uniform import into_reach

TRUTH = surface(PRIOR_GRID.nm, 7)


def test_every_draw_obeys_a_reading():
    reading = Reading.at_wavelength(700, float(TRUTH[-1]), 0.0)
    measured = condition(seen(TRUTH), [reading])
    for method in ("prior", "uniform"):
        spectra = draw_spectra(measured, method, 200, 1, 9).spectra
        # Newton to 1e-10, solves to 1e-12
        np.testing.assert_allclose(spectra[:, -1], TRUTH[-1], atol=1e-8)


def test_a_reading_narrows_the_band_where_it_was_taken():
    plain, more = (draw_spectra(one, "prior", 2000, 1, 9).spectra.std(axis=0) for one in (
        seen(TRUTH), condition(seen(TRUTH), [Reading.at_wavelength(700, float(TRUTH[-1]), 0.005)])))
    assert more[-1] < 0.3 * plain[-1]
    assert more.mean() < plain.mean()


@pytest.mark.parametrize("arguments, message", [
    ((390.0, 0.2), "lies outside 400-700 nm"), ((500.0, 3.0), "gives a reflectance of 3"),
    ((500.0, 0.2, -1.0), "has the standard error -1")])
def test_readings_that_cannot_be_are_errors(arguments, message):
    with pytest.raises(InputError, match=message):
        Reading.at_wavelength(*arguments)


def test_patches_of_one_material_are_averaged_by_their_errors():
    first, second = seen(TRUTH, 0.01), seen(TRUTH + 0.02, 0.02)
    joined = same_material([first, second])
    # Weights 4 : 1 of independent errors.
    np.testing.assert_allclose(joined.signal, 0.8 * first.signal + 0.2 * second.signal, atol=1e-12)
    # an inverse of numbers of 1e4, and their round-off
    np.testing.assert_allclose(joined.noise_covariance, np.eye(3) / (1 / 0.01**2 + 1 / 0.02**2),
                               rtol=1e-10, atol=1e-15)


def test_another_camera_adds_bands():
    joined = same_material([seen(TRUTH, 0.01), seen(TRUTH, 0.01, bands=4)])
    assert joined.relative_response.shape == (7, 61)
    assert joined.noise_covariance[:3, 3:].max() == 0


# ---- budget and scores ---------------------------------------------------------------------------

def budget_of(signal, causes):
    measured = type(seen(TRUTH))(seen(TRUTH).grid, seen(TRUTH).relative_response, signal,
                                 sum(causes.values()))
    found = solve_posterior(load_prior(), measured)
    return found, found.variances_by_cause(causes)


@pytest.mark.parametrize("size", [1e-4, 0.02])
def test_the_budget_adds_up_to_the_posterior_variance(size):
    signal = seen(TRUTH).signal
    found, budget = budget_of(signal, {"photo noise": size * np.eye(3),
                                       "light": 4 * size * np.outer(signal, signal)})
    assert set(budget) == {METAMERISM, "photo noise", "light"}
    spread = mean_and_spread(found.parts[0].mixture)[1]
    np.testing.assert_allclose(sum(budget.values()), spread**2, rtol=1e-9)
    assert all(np.all(variance >= 0) for variance in budget.values())


def test_metamerism_is_what_remains_without_errors_however_large_they_are():
    signal, zeros = seen(TRUTH).signal, {"photo noise": np.zeros((3, 3))}
    perfect = sum(budget_of(signal, zeros)[1].values()).mean()
    before = 1.0
    for size in (0.003, 0.03, 0.3):
        _, budget = budget_of(signal, {"photo noise": size**2 * np.eye(3)})
        left = budget[METAMERISM].mean()
        assert left <= 1.0001 * perfect and left > 0.5 * perfect    # at some wavelengths less
        assert left / sum(budget.values()).mean() < before
        before = left / sum(budget.values()).mean()
    assert before < 0.2


def test_errors_share_what_they_add_by_what_each_adds_as_they_grow_together():
    """Brute force: the gain at every size of the errors, integrated by the trapezoidal rule."""
    prior, one = load_prior(), seen(TRUTH)
    causes = {"noise": np.diag([1e-4, 4e-4, 9e-4]),
              "light": 0.04 * np.outer(one.signal, one.signal)}
    mixture = posterior(prior, one.relative_response, one.signal[None], sum(causes.values()))
    found = grown_by_causes(prior, one.relative_response, mixture,
                            {name: each[None] for name, each in causes.items()})
    index = int(np.argmax(mixture.weights[0]))
    level = prior.with_level[index]
    before = prior.covariances[index] + mixture.stretch[0, index] * np.outer(level, level)
    p = 1 / (1 + np.exp(-mixture.logits[index, 0]))
    jacobian = one.relative_response * p * (1 - p)
    total = with_floor(sum(causes.values()))
    sizes = np.geomspace(1e-9, 1, 4001)
    gains = [before @ jacobian.T @ np.linalg.inv(jacobian @ before @ jacobian.T + size * total)
             for size in sizes]
    for name, each in causes.items():
        added = [np.diag(gain @ each @ gain.T) * (p * (1 - p))**2 for gain in gains]
        np.testing.assert_allclose(found[name][0], trapezoid(added, sizes, axis=0), rtol=1e-3)


def test_an_error_that_is_named_twice_has_the_sum_of_both_shares():
    signal = seen(TRUTH).signal
    noise = 1e-4 * np.eye(3)
    _, once = budget_of(signal, {"a": 3 * noise, "b": 9 * noise})
    np.testing.assert_allclose(once["b"], 3 * once["a"], rtol=1e-6)


def test_a_budget_that_does_not_add_up_is_an_error():
    with pytest.raises(InputError, match="do not add up"):
        solve_posterior(load_prior(), seen(TRUTH, 0.01)).variances_by_cause(
            {"photo noise": np.eye(3)})


def test_scores_of_known_cases():
    truth = np.full((2, 4), 0.5)
    lower, upper = truth - 0.1, truth + np.array([[0.1, 0.1, 0.1, -0.05], [0.1] * 4])
    assert coverage(lower, upper, truth) == 7 / 8
    assert curve_coverage(lower, upper, truth) == 0.5
    np.testing.assert_allclose(winkler_score(lower, upper, truth), (7 * 0.2 + 0.05 + 40 * 0.05) / 8)
    np.testing.assert_allclose(rmse(truth + 0.1, truth), 0.1)
    np.testing.assert_allclose(spectral_angle(3 * truth, truth), 0, atol=1e-7)  # the root of eps
    np.testing.assert_allclose(spectral_angle(np.array([[1.0, 0]]), np.array([[0, 1.0]])),
                               np.pi / 2)


# ---- ranking, refinement, N ----------------------------------------------------------------------


@pytest.mark.parametrize("coarse, fine", [(5, 9), (7, 11), (7, 15)])
def test_lifting_nested_knots_changes_nothing(coarse, fine):
    T = lifting(coarse, fine)
    nm = np.linspace(400, 700, 77)
    # Knot insertion is exact; least squares over 301 wavelengths loses a few digits.
    np.testing.assert_allclose(basis_matrix(nm, fine) @ T, basis_matrix(nm, coarse), atol=1e-12)
    assert T.min() > -1e-12
    np.testing.assert_allclose(T.sum(axis=1), 1, atol=1e-12)


def test_knots_that_do_not_nest_are_an_error():
    with pytest.raises(InputError, match="7 coefficients cannot be refined to 9: the knots do not "
                       "nest; take 11"):
        lifting(7, 9)


def test_residual_directions_are_unseen_and_new():
    grid, matrix = response(3)
    T = lifting(5, 13)
    directions = residual_directions(matrix @ basis_matrix(grid.nm, 13), T)
    assert directions.shape == (13, 13 - 5 - 3)
    # Null space by singular values: a few eps.
    np.testing.assert_allclose(matrix @ basis_matrix(grid.nm, 13) @ directions, 0, atol=1e-12)


def test_refined_draws_keep_the_signal_and_the_box():
    grid, matrix = response(3)
    operator = measurement(matrix @ basis_matrix(grid.nm, 7), matrix @ surface(grid.nm, 2))
    measured = seen(surface(grid.nm, 2))
    samples = sample_refined(measured, operator, 15, 300, seed=1)
    np.testing.assert_allclose(samples @ (matrix @ basis_matrix(grid.nm, 15)).T,
                               # lifting to 1e-12, twenty moves
                               np.tile(operator.y, (300, 1)), atol=1e-9)
    assert samples.min() >= 0 and samples.max() <= 1


def test_an_unreachable_signal_is_moved_by_what_is_said():
    operator, moved = into_reach(measurement(camera(7), np.array([0.1, 0.9, 1.05])))
    assert moved == pytest.approx(np.abs(operator.y - [0.1, 0.9, 1.05]).max())
    assert into_reach(grey(7))[1] == 0
    samples = draw_spectra(type(seen(TRUTH))(PRIOR_GRID, response(3)[1],
                                             np.array([0.05, 0.95, 0.05]),
                                             np.zeros((3, 3))), "uniform", 100, 0, 7)
    assert samples.outcome is Outcome.MOVED and samples.findings[0].values["moved"] > 0


def test_an_unknown_method_is_an_error():
    with pytest.raises(InputError, match="the method 'magic' is not known; known are paper, "
                       "uniform, prior"):
        draw_spectra(seen(TRUTH), "magic", 10, 0, 7)
