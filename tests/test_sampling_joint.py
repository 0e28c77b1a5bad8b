"""Joint posterior of the materials of a scene: derivatives, what a second bounce tells, exactness
of the draws.
"""
from dataclasses import replace

import numpy as np
import pytest
from sampling_cameras import response, surface
from scipy.stats import multivariate_normal

from spectrabox.radiometry.error_model import (
    DISAGREEMENT,
    GLARE,
    SENSITIVITIES,
)
from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.records.scenes import RegionTransport
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.sampling.polytope.diagnostics import tail_shape
from spectrabox.sampling.prior.mixture import (
    PRIOR_GRID,
    load_prior,
    of_families,
    reflectance,
)
from spectrabox.sampling.scene.joint_posterior import (
    fit_modes,
    joint_problem,
    logits_of,
    products,
    residual_and_jacobian,
    residual_by_logit,
)
from spectrabox.sampling.scene.joint_sampling import find_modes, near_labels, sample_joint
from spectrabox.sampling.scene.scene_draws import (
    draw_scene,
    shared_errors,
    split_shared,
)

NONE = np.zeros(0)          # of errors that multiply
EXPONENTS = np.array([[1, 0], [0, 1], [1, 1], [2, 0], [0, 2], [1, 2], [2, 1]])


def covariance_at(problem, labels, z):
    """Covariance (M P, M P) of z about a mode, by Laplace's approximation."""
    jacobian = residual_and_jacobian(problem, labels, z)[1]
    return np.linalg.inv(jacobian.T @ jacobian + np.eye(z.size))


def information_bits(problem):
    """Bits (M,) that a picture gives of each material: -log2 det of covariance over prior, halved.

    Both covariances are those of the one Gaussian with the mixture's moments.
    """
    materials, size = len(problem.materials), problem.means.shape[1]
    labels = np.full(materials, len(problem.means) - 1)
    [mode], _ = fit_modes(problem, labels[None], np.zeros((1, materials * size)))
    covariance = covariance_at(problem, labels, mode).reshape(materials, size, materials, size)
    return np.array([-np.linalg.slogdet(covariance[m, :, m])[1] / (2 * np.log(2))
                     for m in range(materials)])


def regions_of(materials, exponents, coefficients, signal, noise):
    """Regions of one surface, whose model does not err."""
    first = np.zeros(len(signal), int)
    return RegionTransport(materials, exponents, coefficients, signal, noise, first, first, 0, 0)


def showing(transport, signal, noise):
    """The same regions with other signals."""
    return replace(transport, signal=signal, standard_error=noise)


def scene(error=0.01, regions=40, exponents=EXPONENTS, seed=0):
    """A synthetic scene of two materials: transport with light that met one, both, or one of them
    again.
    """
    rng = np.random.default_rng(seed)
    order = exponents.sum(axis=1)
    coefficients = rng.uniform(0.2, 1, (regions, len(exponents))) * 0.5**(order - 1.0)
    matrix = response(3)[1]
    truth = np.array([surface(PRIOR_GRID.nm, 3), surface(PRIOR_GRID.nm, 9)])
    clean = coefficients @ (np.exp(exponents @ np.log(truth)) @ matrix.T)
    noise = error * clean
    signal = clean + noise * rng.standard_normal(clean.shape)
    transport = regions_of(("a", "b"), exponents, coefficients, signal, noise)
    return transport, matrix, signal, noise, truth


@pytest.fixture(scope="module")
def prior():
    return load_prior()


def scenes_of_the_prior(problem, count, seed):
    """Logits (n, M, P) of scenes drawn from the prior."""
    rng = np.random.default_rng(seed)
    labels = np.array([rng.choice(len(problem.means) - 1, count, p=np.exp(log_weights[:-1]))
                       for log_weights in problem.log_weights]).T
    z = rng.standard_normal((*labels.shape, PRIOR_GRID.nm.size))
    return problem.means[labels] + np.array([[problem.roots[c] @ z_m for c, z_m in zip(row, z_n,
                                                                                       strict=True)]
                                             for row, z_n in zip(labels, z, strict=True)])


def misfit(problem, logits):
    """Squared residual (n,) of scenes in units of the noise."""
    received = (products(problem, logits)[1] @ problem.response.T).transpose(0, 2,
                                                                             1).reshape(len(logits),
                                                                                        -1)
    return np.sum((received @ problem.rows.reshape(len(problem.rows), -1).T - problem.targets)**2,
                  axis=1)


def rendered(transport, matrix, logits):
    """Signals (n, R, K), without any reduction."""
    terms = np.exp(np.einsum("em,nmp->nep", transport.exponents, np.log(reflectance(logits))))
    return np.einsum("re,nek->nrk", transport.coefficients, terms @ matrix.T)


def test_derivatives_agree_with_differences(prior):
    problem = joint_problem(*scene()[:2], prior)
    rng = np.random.default_rng(1)
    z, direction, labels = 0.3 * rng.standard_normal(122), rng.standard_normal(122), np.array(
        [2, 5])
    step = 1e-6
    _, jacobian = residual_and_jacobian(problem, labels, z)
    forward, backward = (residual_and_jacobian(problem, labels, z + sign * step * direction)[0]
                         for sign in (1, -1))
    # Central differences: h^2 times the third derivative and eps / h of a residual of order 100.
    np.testing.assert_allclose(jacobian @ direction, (forward - backward) / (2 * step), rtol=1e-5,
                               atol=1e-5)


def test_the_reduction_keeps_the_likelihood_up_to_a_constant(prior):
    transport, matrix, signal, noise, _ = scene()
    problem = joint_problem(transport, matrix, prior)
    logits = scenes_of_the_prior(problem, 5, 2)
    full = np.sum(((rendered(transport, matrix, logits) - signal) / noise)**2, axis=(1, 2))
    # Rows whose signals scatter by less than 0.05 were dropped, at most 21: each moves the misfit
    # by about 0.1.
    np.testing.assert_allclose(np.diff(full), np.diff(misfit(problem, logits)), rtol=1e-6, atol=2)


def test_shared_errors_are_those_of_the_full_covariance(prior):
    transport, matrix, signal, noise, _ = scene()
    common = shared_errors(signal, np.diag([4e-4, 1e-4, 1e-4]), 0.01, np.arange(40) // 20, 0.02,
                           0.03)
    assert common.shape == (3 + 1 + 2 + 6, 40, 3)
    problem = joint_problem(transport, matrix, prior, common)
    logits = scenes_of_the_prior(problem, 5, 3)
    covariance = np.diag((noise**2).ravel()) + common.reshape(12, -1).T @ common.reshape(12, -1)
    away = (rendered(transport, matrix, logits) - signal).reshape(5, -1)
    full = np.sum(away * np.linalg.solve(covariance, away.T).T, axis=1)
    np.testing.assert_allclose(np.diff(full), np.diff(misfit(problem, logits)), rtol=1e-6, atol=2)


def test_a_known_material_is_part_of_the_light(prior):
    transport, matrix, signal, noise, truth = scene()
    problem = joint_problem(transport, matrix, prior, known={"b": truth[1]})
    assert problem.materials == ("a",)
    logits = scenes_of_the_prior(problem, 5, 4)
    both = np.concatenate([logits, np.tile(np.log(truth[1] / (1 - truth[1])), (5, 1, 1))], axis=1)
    full = np.sum(((rendered(transport, matrix, both) - signal) / noise)**2, axis=(1, 2))
    np.testing.assert_allclose(np.diff(full), np.diff(misfit(problem, logits)), rtol=1e-6, atol=2)


def test_the_map_is_stationary(prior):
    problem = joint_problem(*scene()[:2], prior)
    labels, z, evidence = find_modes(problem)
    assert np.all(np.diff(evidence) <= 0)
    residual, jacobian = residual_and_jacobian(problem, labels[0], z[0])
    slope = jacobian.T @ residual + z[0]
    # A Newton step from where the cost fell by less than 0.01 at last would lower it by no more
    # than that.
    assert slope @ covariance_at(problem, labels[0], z[0]) @ slope / 2 < 0.01


@pytest.mark.parametrize("error", [0.02, 0.1])
def test_switching_labels_finds_the_best_of_all(prior, error):
    """Against every pair of labels, by the density of what a linear camera would have seen."""
    known = of_families(prior, ["leaves", "skin", "white", "animal"])
    problem = joint_problem(*scene(error=error)[:2], known)
    count = len(problem.means) - 1
    z, _ = fit_modes(problem, np.array([[count, count]]), np.zeros((1, 122)))
    logits = logits_of(problem, np.array([count, count]), z)[0]
    residual, by_logit, _ = residual_by_logit(problem, logits, NONE)
    seen = np.einsum("fmp,mp->f", by_logit, logits) - residual
    evidence = {}
    for labels in np.ndindex(count, count):
        mean = sum(by_logit[:, m] @ problem.means[c] for m, c in enumerate(labels))
        spread = np.eye(len(seen)) + sum(
            by_logit[:, m] @ problem.roots[c] @ problem.roots[c].T @ by_logit[:, m].T
            for m, c in enumerate(labels))
        evidence[labels] = multivariate_normal(mean, spread).logpdf(seen) + sum(
            problem.log_weights[m, c] for m, c in enumerate(labels))
    best = sorted(evidence, key=lambda labels: -evidence[labels])
    near, z = near_labels(problem, logits, NONE, 8)
    assert tuple(near[0]) == best[0] and z.shape == (len(near), 122)
    found = [evidence[tuple(labels)] for labels in near]
    assert found == sorted(found, reverse=True)
    # z is the mean of the posterior there: its slope vanishes
    for labels, mode in zip(near, z, strict=True):
        columns = np.hstack([by_logit[:, m] @ problem.roots[c] for m, c in enumerate(labels)])
        mean = sum(by_logit[:, m] @ problem.means[c] for m, c in enumerate(labels))
        slope = columns.T @ (seen - mean - columns @ mode) - mode
        # round-off of a system whose information reaches 1e6
        assert np.abs(slope).max() < 1e-6 * np.linalg.norm(columns) * np.linalg.norm(seen)


def test_without_products_materials_do_not_inform_each_other(prior):
    alone = np.array([[1, 0], [0, 1]])
    problem = joint_problem(*scene(exponents=alone)[:2], prior)
    labels, z, _ = find_modes(problem)
    across = covariance_at(problem, labels[0], z[0])[:61, 61:]
    # Regions see sums of the two materials: only the three signals of each are coupled, and those
    # are well known.
    assert np.abs(across).max() < 0.02


def test_products_tell_more_than_direct_light(prior):
    direct = joint_problem(*scene(exponents=EXPONENTS[:2], error=0.001)[:2], prior)
    both = joint_problem(*scene(error=0.001)[:2], prior)
    assert np.all(information_bits(both) > information_bits(direct))


def test_half_the_noise_tells_one_bit_more_of_every_number_that_is_well_known(prior):
    """Direct light alone: three signals of each material, far better known than by the prior."""
    bits = [information_bits(joint_problem(*scene(exponents=EXPONENTS[:2], error=error)[:2], prior))
            for error in (2e-5, 1e-5)]
    # what the prior still adds is a millionth of the signals' information
    np.testing.assert_allclose(bits[1] - bits[0], 3.0, atol=0.02)


def test_the_draws_have_the_law_of_the_posterior(prior):
    # So noisy that scenes drawn from the prior and weighted with the likelihood are a second way to
    # the same law.
    # Of few components, so that all labels are drawn from.
    few = of_families(prior, ["skin", "white"])
    problem = joint_problem(*scene(error=0.4, regions=6)[:2], few)
    drawn, effective_samples, tail = sample_joint(problem, seed=1)
    assert effective_samples >= 400 and tail < 0.7
    logits = scenes_of_the_prior(problem, 20_000, 5)
    log_weights = -misfit(problem, logits) / 2
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    effective = 1 / np.sum(weights**2)
    assert effective > 500
    spectra = reflectance(logits)
    mean = np.einsum("n,nmp->mp", weights, spectra)
    variance = np.einsum("n,nmp->mp", weights, (spectra - mean)**2)
    error = np.sqrt(variance * (1 / effective + 1 / effective_samples))
    # 122 strongly correlated tests at 1e-4 in all: 4.9 standard errors of their difference.
    assert np.abs((drawn.mean(axis=0) - mean) / error).max() < 4.9
    # The standard deviation of n draws is known to 1 / sqrt(2 n) for normal ones; five of those.
    relative = 5 * np.sqrt(0.5 / effective + 0.5 / effective_samples)
    np.testing.assert_allclose(drawn.std(axis=0), np.sqrt(variance), rtol=relative)


def test_too_few_effective_draws_are_refused(prior):
    problem = joint_problem(*scene(error=0.05)[:2], prior)
    with pytest.raises(ConvergenceError, match="has not converged after 16000 proposals"):
        sample_joint(problem, 0, effective_wanted=1e6)


def test_a_scene_is_drawn_with_its_shared_errors_or_said_to_disagree(prior):
    transport, matrix, signal, noise, truth = scene(error=0.01)
    wrong = np.array([1.05, 1.0, 0.96])[None] * np.where(np.arange(40) < 20, 1.06, 0.95)[:, None]
    common = shared_errors(signal * wrong, 2.5e-3 * np.eye(3), 0, np.arange(40) // 20, 0.05)
    seen = showing(transport, signal * wrong, noise)
    samples = draw_scene(seen, matrix, 1000, 1, prior, common=common)
    assert set(samples) == {"a", "b"}
    assert samples["a"].outcome is Outcome.THROUGH_TRANSPORT
    assert samples["a"].effective_samples >= 1000
    assert samples["a"].coefficients.shape == (1000, 13)
    lower, upper = np.quantile([samples[name].spectra for name in "ab"], [0.005, 0.995], axis=1)
    assert np.mean((truth >= lower) & (truth <= upper)) > 0.9
    unstated = draw_scene(seen, matrix, 1000, 1, prior)
    assert unstated["a"].outcome is Outcome.DISAGREES


def test_an_error_of_the_light_that_all_regions_share_does_not_explain_a_white_room_as_black(prior):
    rng = np.random.default_rng(0)
    matrix, bounces = response(3)[1], np.arange(1, 5)
    coefficients = rng.uniform(0, 1, (200, 4)) * 0.7**np.arange(4)
    signal = (coefficients @ 0.85**bounces)[:, None] * matrix.sum(axis=1)
    transport = regions_of(("a",), bounces[:, None], coefficients, signal, 0.003 * signal)
    common = shared_errors(signal, 4e-4 * np.ones((3, 3)))      # 2 % of white, in all bands
    samples = draw_scene(transport, matrix, 500, 1, prior, common=common)
    assert samples["a"].outcome is Outcome.THROUGH_TRANSPORT
    # the light is known to 2 %, and four reflections make it less
    assert abs(samples["a"].spectra.mean() - 0.85) < 0.02


# ---- errors that multiply ------------------------------------------------------------------------

def disagreeing(prior, error, regions=4, noise=0.3, seed=0):
    """A scene of two surfaces drawn from a prior, photo and model of each of which disagree by such
    a share in all bands alike, and by half of it in each band: transport, response, signals, their
    noise, what the disagreement does to the true signals, and the number of each region's surface.
    """
    rng = np.random.default_rng(seed)
    transport, matrix, _, _, _ = scene(regions=regions, seed=seed)
    ones = np.ones((regions, 3))
    problem = joint_problem(showing(transport, ones, ones), matrix, prior)
    truth = scenes_of_the_prior(problem, 1, seed)
    clean, surfaces = rendered(transport, matrix, truth)[0], 2 * np.arange(regions) // regions
    errors = shared_errors(clean, np.zeros((3, 3)), 0, surfaces, error / 2, error)
    off = np.exp(np.tensordot(rng.standard_normal(len(errors)), errors, 1) / clean)
    signal = clean * off + noise * clean * rng.standard_normal(clean.shape)
    return (showing(transport, signal, noise * clean), matrix, signal, noise * clean,
            {DISAGREEMENT: errors}, surfaces, clean, reflectance(truth[0]))


def log_weights_by_importance(given, signal, noise, logs, rng):
    """Log weights (n,) of scenes that give some signals (n, R, K): each with errors (Q,) drawn
    about those that would explain the picture, weighed by all that is stated.
    """
    logs = logs.reshape(len(logs), -1)
    share = (noise / signal).ravel()
    covariance = np.linalg.inv(np.eye(len(logs)) + (logs / share**2) @ logs.T)
    drawn = rng.standard_normal((len(given), len(logs)))
    errors = np.log(signal / given).reshape(len(given), -1) / share**2 @ logs.T @ covariance \
        + 1.2 * drawn @ np.linalg.cholesky(covariance).T
    off = given * np.exp(errors @ logs).reshape(given.shape) - signal
    return (-np.sum((off / noise)**2, axis=(1, 2)) - np.sum(errors**2, axis=1)
            + np.sum(drawn**2, axis=1)) / 2


@pytest.mark.parametrize("error", [0.3, 0.4, 0.6])
def test_draws_under_errors_that_multiply_have_the_law_of_importance_sampling(prior, error):
    few = of_families(prior, ["skin", "white"])
    transport, matrix, signal, noise, causes, surfaces, clean, _ = disagreeing(few, error)
    common, logs = split_shared(clean, surfaces, causes)
    problem = joint_problem(transport, matrix, few, common, logs=logs)
    drawn, effective_samples, _ = sample_joint(problem, seed=1)
    logits = np.concatenate([scenes_of_the_prior(problem, 10_000, seed) for seed in range(3)])
    log_weights = log_weights_by_importance(rendered(transport, matrix, logits), signal, noise,
                                            logs, np.random.default_rng(9))
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    effective = 1 / np.sum(weights**2)
    assert effective > 1000
    spectra = reflectance(logits)
    mean = np.einsum("n,nmp->mp", weights, spectra)
    variance = np.einsum("n,nmp->mp", weights, (spectra - mean)**2)
    standard_error = np.sqrt(variance * (1 / effective + 1 / effective_samples))
    # as of the draws without such errors above
    assert np.abs((drawn.mean(axis=0) - mean) / standard_error).max() < 4.9
    relative = 5 * np.sqrt(0.5 / effective + 0.5 / effective_samples)
    np.testing.assert_allclose(drawn.std(axis=0), np.sqrt(variance), rtol=relative)
    # of errors that add at the measured signals the mean is off by more than these are known to
    added, _, _ = sample_joint(joint_problem(transport, matrix, few,
                                             causes[DISAGREEMENT] * signal / clean), seed=1)
    assert np.abs((added.mean(axis=0) - mean) / standard_error).max() > 10


def test_derivatives_by_errors_that_multiply_agree_with_differences(prior):
    transport, matrix, _, _, causes, surfaces, clean, _ = disagreeing(prior, 0.4)
    # of curves, by other shares in every region
    rng, step, labels = np.random.default_rng(1), 1e-6, np.array([2, 5])
    causes[SENSITIVITIES] = clean * 0.1 * rng.standard_normal((2, *clean.shape))
    common, logs = split_shared(clean, surfaces, causes)
    problem = joint_problem(transport, matrix, prior, common, logs=logs)
    z, direction = 0.3 * rng.standard_normal((2, 122 + len(problem.logs)))
    assert len(problem.logs) and np.abs(problem.added).max() > 0
    _, jacobian = residual_and_jacobian(problem, labels, z)
    forward, backward = (residual_and_jacobian(problem, labels, z + sign * step * direction)[0]
                         for sign in (1, -1))
    np.testing.assert_allclose(jacobian @ direction, (forward - backward) / (2 * step), rtol=1e-5,
                               atol=1e-5)


def test_the_reduction_keeps_the_likelihood_under_errors_that_multiply(prior):
    """What adds by all errors, as one covariance."""
    transport, matrix, signal, noise, causes, surfaces, clean, _ = disagreeing(
        prior, 0.4, regions=10, noise=0.02)
    rng = np.random.default_rng(2)
    causes[SENSITIVITIES] = clean * 0.1 * rng.standard_normal((2, *clean.shape))
    causes[GLARE] = 0.01 * rng.uniform(size=(1, *clean.shape))
    common, logs = split_shared(clean, surfaces, causes)
    problem = joint_problem(transport, matrix, prior, common, logs=logs)
    logits = scenes_of_the_prior(problem, 5, 3)
    errors = rng.standard_normal((5, len(problem.logs)))
    multiplies = logs.any(axis=(1, 2))
    adds = common[~multiplies].reshape(-1, signal.size)
    covariance = np.diag((noise**2).ravel()) + adds.T @ adds
    away = (rendered(transport, matrix, logits) * np.exp(np.tensordot(errors, logs[multiplies], 1))
            + np.tensordot(errors, common[multiplies], 1) - signal).reshape(5, -1)
    full = np.sum(away * np.linalg.solve(covariance, away.T).T, axis=1)
    reduced = [np.sum(residual_by_logit(problem, *each)[0]**2)
               for each in zip(logits, errors, strict=True)]
    np.testing.assert_allclose(np.diff(full), np.diff(reduced), rtol=1e-6, atol=2)


def test_shared_errors_are_split_as_those_of_one_surface(prior):
    *_, causes, surfaces, clean, _ = disagreeing(prior, 0.4)
    causes |= {GLARE: 0.01 * np.ones((1, *clean.shape)),
               SENSITIVITIES: 0.2 * np.eye(3)[:, None] * clean}
    common, logs = split_shared(clean, surfaces, causes)
    region = len(clean) - 1
    np.testing.assert_allclose(logs[:, region].T @ logs[:, region], 0.16 + 0.08 * np.eye(3),
                               atol=1e-12)
    np.testing.assert_allclose(common[:, region].T @ common[:, region], 1e-4, atol=1e-12)
    # to first order all of it is what was stated, from region to region as well
    whole = (common + clean * logs).reshape(len(common), -1)
    stated = np.concatenate(list(causes.values())).reshape(len(common), -1)
    np.testing.assert_allclose(whole.T @ whole, stated.T @ stated, atol=1e-12)


def test_errors_of_curves_add_to_a_dark_band_of_a_scene_too():
    signal = np.array([[0.4, 0.3, 0.01], [0.4, 0.3, 0.3]])
    errors = {SENSITIVITIES: 0.02 * np.eye(3)[:, None] * np.ones((2, 1))}
    _, logs = split_shared(signal, np.arange(2), errors)
    assert not logs[:, 0].any() and logs[:, 1].any()


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_errors_of_a_few_per_cent_add_and_give_the_problem_that_they_gave(prior, error):
    transport, matrix, _, _, causes, surfaces, clean, _ = disagreeing(prior, error)
    common, logs = split_shared(clean, surfaces, causes)
    assert not logs.any()
    problems = [joint_problem(transport, matrix, prior, *each)
                for each in ((common, None, None, logs), (causes[DISAGREEMENT],))]
    for name in ("rows", "targets"):
        np.testing.assert_array_equal(*(getattr(problem, name) for problem in problems))


def test_a_picture_that_is_off_by_half_is_not_of_black_materials(prior):
    transport, matrix, _, _, causes, surfaces, clean, truth = disagreeing(
        prior, 0.5, regions=20, noise=0.02, seed=3)
    signal, noise = clean * np.exp(np.where(surfaces == 0, -0.5, 0.5))[:, None], 0.02 * clean
    common, logs = split_shared(signal, surfaces, {
        DISAGREEMENT: causes[DISAGREEMENT] * signal / clean})
    found = draw_scene(showing(transport, signal, noise), matrix, 500, 1, prior, common=common,
                       logs=logs)
    assert found["a"].outcome is Outcome.THROUGH_TRANSPORT
    for name, spectrum in zip("ab", truth, strict=True):
        # known to e^.5 or better
        assert abs(np.log(found[name].spectra.mean() / spectrum.mean())) < 0.5


@pytest.mark.parametrize("shape", [0.3, 0.6, 1.0])
def test_the_tail_of_weights_is_recognised(shape):
    weights = np.random.default_rng(6).pareto(1 / shape, 50_000) + 1
    # From 670 tail values the shape is known to (1 + k) / sqrt(670), up to 0.08; three of those.
    assert abs(tail_shape(weights) - shape) < 0.24


def test_bad_scenes_are_errors(prior):
    transport, matrix, signal, noise, truth = scene()
    with pytest.raises(InputError, match=r"must both be \(40, 2\)"):
        joint_problem(transport, matrix[:2], prior)
    with pytest.raises(ValueError, match=r"has shape \(5, 3\); \(R K\) with R = 40 is needed"):
        showing(transport, signal[:5], noise)
    with pytest.raises(InputError, match="a positive standard error"):
        joint_problem(showing(transport, signal, 0 * noise), matrix, prior)
    with pytest.raises(InputError, match=r"must be \(Q, 40, 3\)"):
        joint_problem(transport, matrix, prior, noise)
    with pytest.raises(InputError, match="5 draws were asked for"):
        sample_joint(joint_problem(transport, matrix, prior), 0, kept=5)
    with pytest.raises(InputError, match="c are not in the transport, which has a, b"):
        draw_scene(transport, matrix, 100, 0, prior, known={"c": truth[0]})
    with pytest.raises(InputError, match="every material of the scene is known"):
        draw_scene(transport, matrix, 100, 0, prior,
                   known={"a": truth[0], "b": truth[1]})
    with pytest.raises(InputError, match="must be positive semi-definite"):
        shared_errors(signal, -np.eye(3))


def test_a_material_of_a_stated_family_takes_its_components_alone(prior):
    transport, matrix, *_ = scene(error=0.02)
    problem = joint_problem(transport, matrix, prior, families={"a": ["skin"]})
    count, skins = prior.weights.size, np.sum(prior.family == prior.families.index("skin"))
    possible = np.isfinite(problem.log_weights[:, :-1])
    assert possible.shape == (2, count + skins)
    # materials in the order of the transport: a of three skins, b of anything
    assert possible[0].sum() == skins and possible[1].sum() == count
    np.testing.assert_allclose(np.exp(problem.log_weights[:, :-1]).sum(axis=1), 1)
    labels, _, _ = find_modes(problem)
    assert np.all(possible[0][labels[:, 0]]) and np.all(possible[1][labels[:, 1]])
    with pytest.raises(InputError, match="'jam' is no family of surfaces"):
        joint_problem(transport, matrix, prior, families={"b": ["jam"]})
