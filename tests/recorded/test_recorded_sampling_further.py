"""Recorded: methods and summaries of one signal, further measurements of it, plans, identification,
and what others published.
"""
import dataclasses

import numpy as np
import pytest
from sampling_cameras import camera, curves, response, surface
from sampling_inputs import (
    lopsided_measurement,
    lopsided_noise,
    lopsided_prior,
    result_or_refusal,
)
from scipy import stats

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import ConvergenceError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import SpectralMeasurement
from spectrabox.radiometry.response import response_matrix
from spectrabox.sampling import measurement as measurement_file
from spectrabox.sampling.checks import check_bands, check_measurement
from spectrabox.sampling.error_budget import (
    error_budget,
    error_budgets,
    sensitivity_covariance,
    shares_by_cause,
)
from spectrabox.sampling.further.conditioning import (
    Reading,
    check_agreement,
    condition,
    same_bands,
    same_material,
)
from spectrabox.sampling.further.more_measurements import (
    MoreMeasurement,
    check_possible,
    doubtful,
    joined,
    measured_rows,
)
from spectrabox.sampling.further.planner import (
    after,
    expected_rmse,
    mean_width,
    photo_candidate,
    plan,
    ranked,
    wavelength_candidates,
)
from spectrabox.sampling.further.self_reflection import given_reflected_twice, proposals_for
from spectrabox.sampling.judge.identification import identify
from spectrabox.sampling.measurement import (
    MeasurementOperator,
    nearest_coefficients,
    nearest_splines,
    response_on,
    spline_operator,
)
from spectrabox.sampling.methods import draw_spectra
from spectrabox.sampling.prior.mixture import GRID, load_prior
from spectrabox.sampling.prior.posterior import posterior
from spectrabox.sampling.published.baselines import (
    baseline_spectra,
    greedy_draws,
    to_tristimulus,
)
from spectrabox.sampling.published.options import ranked as ranked_by_others
from spectrabox.sampling.published.options import refined_as_published
from spectrabox.sampling.published.per_axis_box import axis_intervals, sample_per_axis
from spectrabox.sampling.published.ranking import best_by_readings, best_by_signals
from spectrabox.sampling.published.sampler import sample_published
from spectrabox.sampling.summary import check_draws, check_level, next_measurement_nm, summarise


def photo_by_another_camera(seed=4, off=0.0, step_nm=5):
    """The same surface through four bands under another light."""
    grid = visible_grid(step_nm)
    sensitivity, light = curves(grid.nm, 4)
    matrix = response_matrix(grid, sensitivity, light * (grid.nm / 500)**2)
    matrix /= matrix.sum(axis=1, keepdims=True)
    return SpectralMeasurement(grid, matrix, matrix @ surface(grid.nm, seed) + off,
                               lopsided_noise(4, 0.009, 2))


@pytest.mark.parametrize("method", ["paper", "uniform", "prior"])
def test_draws_of_every_method_and_their_summary(recorded, method):
    measured = lopsided_measurement()
    found = draw_spectra(measured, method, 1300, 6, 7, lopsided_prior())
    recorded(found)
    recorded((summarise(found, measured), summarise(found, measured, 0.81, "what was said"),
              next_measurement_nm(found.grid, np.cov(found.spectra, rowvar=False))),
             case="summary")


def test_draws_of_default_priors(recorded):
    measured = lopsided_measurement()
    found = draw_spectra(measured, "prior", 60, 2, 9)
    recorded((found.method, found.outcome, found.sentence))
    # eigenvectors of the shipped covariances turn with the machine, and draws by a share of their
    # deviation
    recorded(found.spectra, rtol=0.1, case="draws")
    recorded(posterior(load_prior(), measured.relative_response, measured.signal[None],
                       measured.noise_covariance), rtol=1e-5, case="posterior")
    recorded(result_or_refusal(draw_spectra, measured, "papers", 60, 2, 9), case="refused")


def test_published_draws(recorded):
    measured = lopsided_measurement()
    far = dataclasses.replace(measured, signal=np.array([0.2, 0.95, 0.15]))
    start = sample_published(measured, 50, 3, 5, unbounded_start=True)
    recorded((start, sample_published(far, 50, 3, 7)), rtol=1e-5)
    recorded((result_or_refusal(sample_published, measured, 0, 3, 7),
              str(result_or_refusal(sample_published, far, 50, 3, 7, unbounded_start=True))),
             case="refused")
    operator = spline_operator(measured, 6)
    inside = np.clip(nearest_coefficients(operator.A, operator.y), 0.02, 0.98)
    found = {}
    for name, c0 in {"inside": inside, "short": inside[:5], "a little low": inside - 5e-10
                     - inside * np.eye(6)[2], "low": inside - (inside + 2e-9) * np.eye(6)[2],
                     "high": inside + (1 + 2e-9 - inside) * np.eye(6)[4]}.items():
        found[name] = result_or_refusal(
            lambda c0=c0: dataclasses.astuple(sample_per_axis(operator, c0, 40, 1))[1:])
    recorded(found, case="starts")
    recorded(axis_intervals(inside, np.random.default_rng(1).normal(size=(6, 3)) * [1, 0, 2]),
             case="intervals")


def test_refinement_as_published(recorded):
    measured = lopsided_measurement()
    recorded((refined_as_published(measured, 5, 9, 40, 3).acceptance,
              result_or_refusal(refined_as_published, measured, 5, 8, 40, 3),
              result_or_refusal(refined_as_published, lopsided_measurement(5), 5, 7, 40, 3)),
             rtol=0.3)
    box = refined_as_published(measured, 5, 9, 400, 3).coefficients
    signal = measured.relative_response @ basis_matrix(measured.grid.nm, 9) @ box.T
    recorded(signal[:, :3], rtol=1e-4, case="signals")


def test_baselines(recorded):
    measured = lopsided_measurement()
    recorded((baseline_spectra(measured), to_tristimulus(
        measured.relative_response, np.array([measured.signal, [1, 1, 1], [-0.3, 0.2, -0.4]]))),
        rtol=1e-4)                       # optimisers of another library
    operator = MeasurementOperator(camera(7), camera(7) @ np.linspace(0.2, 0.7, 7),
                                   np.zeros((3, 3)))
    blind = operator.A * (np.abs(np.linspace(-1, 1, 3)[:, None] - np.linspace(-1, 1, 7)) < 1.5)
    recorded((greedy_draws(operator, 90, 3, 500), greedy_draws(operator, 5, 3),
              greedy_draws(dataclasses.replace(operator, A=blind), 90, 3, 500)), case="greedy")
    recorded(result_or_refusal(baseline_spectra, lopsided_measurement(2)), case="refused")


def test_ranking(recorded):
    rng = np.random.default_rng(1)
    spectra = rng.random((30, 9))
    recorded((best_by_readings(spectra, np.array([2, 7]), np.array([0.3, 0.8]), 6),
              best_by_signals(rng.random((30, 2, 2)), rng.random((2, 2)), 5),
              [str(result_or_refusal(best_by_readings, spectra, np.array([1]), np.array([0.3]),
                                     keep)) for keep in (0, 1, 30, 31)]))
    measured = lopsided_measurement()
    samples = draw_spectra(measured, "uniform", 200, 6, 7)
    more = [MoreMeasurement("spots", (Reading.at_wavelength(620, 0.4), Reading.at_wavelength(
        455, 0.2, 0.01))), MoreMeasurement("photo", (), photo_by_another_camera())]
    twice = np.array([0.2, 0.1, 0.3])
    recorded([ranked_by_others(samples, measured, *call) for call in
              ((more, None, 9), (more, twice, 11), ([], twice, 3))]
             + [result_or_refusal(ranked_by_others, samples, measured, [], None, 9)],
             case="options")


def test_readings_and_bands_become_one_measurement(recorded):
    measured = lopsided_measurement()
    readings = [Reading.at_wavelength(431.7, 0.2), Reading("a band", np.array([500., 540, 600]),
                                                           np.array([0.2, 1, 0.1]), 0.33, 0.02)]
    recorded((condition(measured, readings), [one.row(visible_grid(1)) for one in readings],
              condition(measured, []).signal))
    other, again = photo_by_another_camera(), dataclasses.replace(
        measured, signal=measured.signal + np.array([0.004, -0.006, 0.009]),
        noise_covariance=lopsided_noise(3, 0.02, 9))
    one = same_material([measured, again])
    recorded((one, same_material([measured, other, again]), same_material([other])),
             case="materials")
    # the weighted mean of two is that of inverse covariances
    inverse = [np.linalg.inv(each.noise_covariance) for each in (measured, again)]
    np.testing.assert_allclose(one.noise_covariance, np.linalg.inv(sum(inverse)), rtol=1e-6)
    np.testing.assert_allclose(one.signal, one.noise_covariance @ (
        inverse[0] @ measured.signal + inverse[1] @ again.signal), rtol=1e-6)
    more = [MoreMeasurement("spots", tuple(readings)), MoreMeasurement("again", (), again),
            MoreMeasurement("photo", (), other), MoreMeasurement("both", (readings[0],), other)]
    recorded((joined(measured, more[:3]), [measured_rows(measured, each) for each in more]),
             case="joined")


def test_readings_that_cannot_be(recorded):
    grid, measured = visible_grid(5), lopsided_measurement()
    recorded([result_or_refusal(Reading.at_wavelength, *values) for values in
              ((399.9, 0.3), (400, 0.3), (700, 0.3), (700.1, 0.3), (500, -0.051), (500, -0.05),
               (500, 1.05), (500, 1.051), (500, 0.3, -1e-9), (500, 0.3, 0.0), (500, np.nan),
               (500, 0.3, np.nan))])
    beyond = Reading("the far one", np.array([720.0, 800]), np.array([1.0, 1]), 0.3, 0.01)
    recorded((result_or_refusal(beyond.row, grid), result_or_refusal(same_material, []),
              result_or_refusal(same_material, [measured, lopsided_measurement(step_nm=1)])),
             case="refused")
    # chi-square with one degree exceeds 23.93 = 4.892^2 once in a million
    found = {}
    for sigmas in (4.87, 4.91, -4.87, -4.91):
        spread = np.hypot(0.01, 0.02)
        pair = [Reading.at_wavelength(550, 0.3, 0.01),
                Reading.at_wavelength(551, 0.3 + sigmas * spread, 0.02)]
        found[f"{sigmas}"] = result_or_refusal(check_agreement, grid, pair)
    for nm in (552.45, 552.55, 560):        # that share more than 97.5 % of their light, or less
        found[f"{nm}"] = result_or_refusal(check_agreement, visible_grid(1), [
            Reading.at_wavelength(550, 0.3, 0.01), Reading("b", np.array([500, 550, nm]),
                                                           np.array([0, 1.0, 0]), 0.3, 0.01)])
    recorded(found, case="agreement")


def test_measurements_that_contradict(recorded):
    measured, found = lopsided_measurement(), {}
    total = 2 * measured.noise_covariance
    direction = np.array([0.5, 1.0, -0.7])
    length = np.sqrt(direction @ np.linalg.solve(total, direction))
    # chi-square with three degrees exceeds 30.66 once in a million
    for share in (0.98, 1.02):
        again = dataclasses.replace(
            measured, signal=measured.signal + share * np.sqrt(30.66485) * direction / length)
        found[f"{share}"] = str(result_or_refusal(same_material, [measured, again])).partition(
            "(")[0]
        found[f"joined {share}"] = str(result_or_refusal(
            joined, measured, [MoreMeasurement("a patch", (), again)])).partition("(")[0]
    exact = dataclasses.replace(measured, noise_covariance=np.zeros((3, 3)))
    for off in (0.9e-9, 1.1e-9):
        again = dataclasses.replace(exact, signal=exact.signal + np.array([0, -off, 0]))
        found[f"exact {off}"] = str(result_or_refusal(
            lambda again=again: same_material([exact, again]).signal))
    for off in (0.9e-9, 1.1e-9):
        again = dataclasses.replace(exact, relative_response=exact.relative_response + off)
        found[f"alike {off}"] = same_bands(exact, again)
    recorded(found)
    assert same_bands(measured, dataclasses.replace(measured, signal=0 * measured.signal))
    assert not same_bands(measured, lopsided_measurement(2))


def test_measurements_that_are_impossible_or_hard_to_believe(recorded):
    measured, prior, found = lopsided_measurement(), lopsided_prior(), {}
    spot = MoreMeasurement("a spot", (Reading.at_wavelength(450, 0.3, 0.01),))
    for off in (0.05, 0.25, 0.28, 0.3, 0.34, 0.4):
        more = [spot, MoreMeasurement("photo", (), photo_by_another_camera(off=off))]
        found[f"possible {off}"] = result_or_refusal(check_possible, measured, more)
    for value in (0.1, 0.2, 0.4, 0.6, 0.8, 0.95):
        more = [MoreMeasurement("one", (Reading.at_wavelength(580, value, 0.01),
                                        Reading.at_wavelength(620, 0.31, 0.02))),
                MoreMeasurement("two", (), photo_by_another_camera())]
        found[f"doubtful {value}"] = result_or_refusal(doubtful, measured, more, prior, 3)
    recorded((found, result_or_refusal(check_possible, measured, [])))


def test_where_doubt_begins(recorded):
    """A reading moved finely over the limit of belief, on both sides."""
    measured, prior, steps = lopsided_measurement(), lopsided_prior(), np.arange(0.0, 1.0, 0.02)
    said = [bool(doubtful(measured, [MoreMeasurement("one", (Reading.at_wavelength(
        640, value, 0.005),))], prior, 3)) for value in steps]
    recorded(steps[~np.array(said)])
    photo = [isinstance(result_or_refusal(check_possible, measured, [MoreMeasurement(
        "photo", (), photo_by_another_camera(off=off))]), str) for off in steps - 0.5]
    recorded((steps - 0.5)[~np.array(photo)], case="possible")


def test_plans(recorded):
    spectra = draw_spectra(lopsided_measurement(), "prior", 300, 2, 9, lopsided_prior()).spectra
    covariance = np.cov(spectra, rowvar=False)
    candidates = [*wavelength_candidates(GRID, 30, 3.0, 0.01), *wavelength_candidates(GRID, 70),
                  photo_candidate("another light", photo_by_another_camera().relative_response),
                  photo_candidate("a good one", response(5)[1], 11.0, 0.002)]
    steps = plan(spectra, candidates, 4)
    recorded((steps, plan(spectra, candidates[:5])), rtol=1e-5)
    recorded(([step.fall_per_minute for step in ranked(covariance, candidates)],
              after(covariance, candidates[-1]), mean_width(covariance),
              expected_rmse(covariance), [one.name for one in candidates]), rtol=1e-5, case="ranks")
    recorded([str(result_or_refusal(plan, *values)).partition("[")[0] for values in
              ((spectra[:99], candidates, 1), (spectra[:100], candidates, 1), (spectra, [], 1),
               (spectra, candidates, 0))], case="refused")


def test_light_reflected_twice(recorded):
    measured = lopsided_measurement()
    samples = draw_spectra(measured, "prior", 900, 2, 9, lopsided_prior())
    twice = dataclasses.replace(measured, signal=measured.relative_response @ surface(GRID.nm, 4)**2
                                + [0.01, -0.01, 0.02], noise_covariance=lopsided_noise(3, 0.02))
    recorded((given_reflected_twice(samples, twice, 120), given_reflected_twice(samples, twice, 9),
              [proposals_for(draws) for draws in (10, 9999, 10_001, 200_001)]), rtol=1e-4)


@pytest.mark.parametrize("noise", [0.0, 0.012])
def test_what_the_variance_comes_from(recorded, noise):
    measured, prior = lopsided_measurement(4, noise), lopsided_prior()
    parts = {"photo": 0.7 * measured.noise_covariance, "light": 0.3 * measured.noise_covariance}
    found = error_budget(prior, measured, parts)
    recorded((found, shares_by_cause({name: one[None] for name, one in found.items()})))
    mixture = posterior(prior, measured.relative_response, measured.signal[None],
                        measured.noise_covariance)
    best = int(np.argmax(mixture.weights[0]))
    rho = 1 / (1 + np.exp(-mixture.logits[best, 0]))
    # without remainder: the causes are the variance of the most probable component
    np.testing.assert_allclose(sum(found.values()), (rho * (1 - rho))**2
                               * mixture.variances[best, 0], rtol=1e-4)
    recorded(error_budgets(prior, measured.relative_response, mixture,
                           {"all": measured.noise_covariance[None]}), case="one cause")
    scale = np.abs(measured.noise_covariance).max()
    limit = 1e-9 + 1e-6 * scale
    recorded([str(result_or_refusal(error_budget, prior, measured, {
        "a": measured.noise_covariance + share * limit * np.eye(4)})).partition("{")[0]
        for share in (0.97, 1.03)], case="refused")


def test_errors_of_sensitivities(recorded):
    rng = np.random.default_rng(2)
    root = rng.normal(size=(15, 4))
    light, weights, spectrum = rng.random((3, 5))
    found = sensitivity_covariance(light, weights, spectrum, root @ root.T)
    recorded(found)
    draws = root.reshape(3, 5, 4)
    signals = np.einsum("kpr,p->kr", draws, light * weights * spectrum)
    np.testing.assert_allclose(found, signals @ signals.T, rtol=1e-12)


@pytest.mark.parametrize("bands", [2, 3, 5])
def test_identification(recorded, bands):
    measured, prior = lopsided_measurement(bands), lopsided_prior()
    rng = np.random.default_rng(3)
    library = np.array([surface(GRID.nm, 4) + shift for shift in np.linspace(-0.1, 0.12, 12)])
    errors = rng.uniform(0, 0.03, library.shape)
    recorded((identify(measured, library, prior),
              identify(measured, library, prior, standard_error=errors, variation=0.02,
                       evidence_ratio=3.0),
              identify(measured, library, prior, standard_error=0 * errors, variation=0.004),
              identify(measured, library[:1], prior)))
    many = surface(GRID.nm, 4) + np.linspace(-0.09, 0.1, 300)[:, None]
    found = [identify(measured, many, prior, evidence_ratio=ratio) for ratio in (None, 1e5)]
    recorded([np.flatnonzero(np.diff(one.indistinguishable)) for one in found], case="limits")
    # with an ample ratio only those are told apart that 1 in 100 misfits reach
    np.testing.assert_array_equal(found[1].indistinguishable,
                                  stats.chi2.sf(found[1].misfit**2, bands) >= 0.01)


def test_splines_and_responses(recorded, monkeypatch):
    rng, basis = np.random.default_rng(1), basis_matrix(GRID.nm, 8)
    spectra = np.array([surface(GRID.nm, seed) for seed in range(3)] + [rng.random(61)])
    spectra[1] = np.clip(3 * spectra[1] - 0.4, 0, 1)
    fine = lopsided_measurement(step_nm=1)
    splines = nearest_splines(spectra, basis)
    monkeypatch.setattr(measurement_file, "PROJECTION_STEPS", 3)
    recorded(nearest_splines(spectra, basis), case="after three steps")
    recorded((splines, response_on(fine, GRID)))
    for spectrum, c in zip(spectra, splines, strict=True):
        np.testing.assert_allclose(basis @ c, basis @ nearest_coefficients(basis, spectrum),
                                   atol=1e-5)


def test_measurements_that_are_refused(recorded):
    measured = lopsided_measurement()
    nan, noise = np.array([0.1, np.inf, 0.2]), measured.noise_covariance
    whole = measured.relative_response
    found = {name: result_or_refusal(check_measurement, dataclasses.replace(measured, **changed),
                                     draws)
             for name, (draws, changed) in {
                 "good": (1, {}), "draws": (0, {}), "signal": (1, {"signal": nan}),
                 "response": (1, {"relative_response": whole * nan[:, None]}),
                 "noise": (1, {"noise_covariance": np.diag(nan)}),
                 "negative": (1, {"noise_covariance": noise - np.eye(3)}),
                 "alike": (1, {"relative_response": whole[[0, 1, 1]]}),
                 "blind": (1, {"relative_response": whole * [[1], [0], [1]]})}.items()}
    recorded(found)
    one, other = np.eye(6)[0], np.eye(6)[1]
    # the smaller singular value of two directions an angle a apart is about a / sqrt 2
    recorded([str(result_or_refusal(check_bands, np.array([3 * one, one + angle * other])))
              for angle in (1.38e-6, 1.45e-6)], case="alike")
    recorded([result_or_refusal(check_draws, draws, level) for draws, level in
              ((999.4, 0.95), (1000, 0.95), (99, 0.5), (100, 0.5), (2499, 0.98), (5000, 1.0))]
             + [result_or_refusal(check_level, level) for level in (0, 1e-9, 1 - 1e-9, 1, np.nan)],
             case="levels")
    with pytest.raises(ConvergenceError):
        summarise(draw_spectra(measured, "uniform", 999, 6, 7), measured)
