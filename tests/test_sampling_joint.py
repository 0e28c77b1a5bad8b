"""Joint posterior of the materials of a scene: derivatives, what a second bounce tells, convergence."""
import numpy as np
import pytest
from sampling_cameras import response, surface

from radiometry.errors import InputError
from radiometry.records import LightTransport, Outcome
from sampling.joint_posterior import (
    find_map,
    gaussian_of,
    information_bits,
    joint_problem,
    misfits_and_gradients,
    residual_and_jacobian,
    spectra_of,
)
from sampling.joint_sampling import effective_sample_size, sample_joint, split_r_hat
from sampling.logit_mixture import GRID, load_prior

EXPONENTS = np.array([[1, 0], [0, 1], [1, 1], [2, 0], [0, 2], [1, 2], [2, 1]])


def scene(error=0.01, regions=40, exponents=EXPONENTS, covariance=None, seed=0):
    """A synthetic scene of two materials: transport with light that met one, both, or one of them again."""
    rng = np.random.default_rng(seed)
    order = exponents.sum(axis=1)
    coefficients = rng.uniform(0.2, 1, (regions, len(exponents))) * 0.5**(order - 1.0)
    matrix = response(3)[1]
    truth = np.array([surface(GRID.nm, 3), surface(GRID.nm, 9)])
    clean = coefficients @ (np.exp(exponents @ np.log(truth)) @ matrix.T)
    noise = error * clean
    transport = LightTransport(("a", "b"), exponents, coefficients, covariance)
    return transport, matrix, clean + noise * rng.standard_normal(clean.shape), noise, truth


@pytest.fixture(scope="module")
def prior():
    return load_prior()


def test_derivatives_agree_with_differences(prior):
    problem = joint_problem(*scene()[:4], prior)
    rng = np.random.default_rng(1)
    z, direction = 0.3 * rng.standard_normal(122), rng.standard_normal(122)
    step = 1e-6
    residual, jacobian = residual_and_jacobian(problem, z)
    forward, backward = (residual_and_jacobian(problem, z + sign * step * direction)[0] for sign in (1, -1))
    # Central differences: h^2 times the third derivative and eps / h of a residual of order 100.
    np.testing.assert_allclose(jacobian @ direction, (forward - backward) / (2 * step), rtol=1e-5, atol=1e-5)
    value, gradient = misfits_and_gradients(problem, z[None])
    np.testing.assert_allclose(value[0], residual @ residual, rtol=1e-10)
    np.testing.assert_allclose(gradient[0], 2 * jacobian.T @ residual, rtol=1e-8, atol=1e-6 * np.abs(gradient).max())


def test_reduction_by_qr_keeps_the_likelihood_up_to_a_constant(prior):
    transport, matrix, signal, noise, truth = scene()
    problem = joint_problem(transport, matrix, signal, noise, prior)
    z = 0.1 * np.random.default_rng(2).standard_normal((3, 122))
    reduced = misfits_and_gradients(problem, z)[0]
    rho = spectra_of(problem, z)
    rendered = np.einsum("re,nek->nrk", transport.coefficients,
                         np.exp(np.einsum("em,nmp->nep", EXPONENTS, np.log(rho))) @ matrix.T)
    full = np.sum(((rendered - signal) / noise)**2, axis=(1, 2))
    # Misfits of order 1e5 are compared through their differences.
    np.testing.assert_allclose(np.diff(full), np.diff(reduced), rtol=1e-6)
    assert truth.shape == rho.shape[1:]


def test_the_map_is_stationary(prior):
    problem = joint_problem(*scene()[:4], prior)
    found = find_map(problem)
    assert found.outcome is Outcome.CONVERGED
    _, gradient = misfits_and_gradients(problem, found.z[None])
    # The cost fell by less than 1e-7 of itself in the last step; a gradient of 1 would move it by more.
    assert np.abs(gradient[0] / 2 + found.z).max() < 1.0


def test_without_products_materials_do_not_inform_each_other(prior):
    alone = np.array([[1, 0], [0, 1]])
    found = find_map(joint_problem(*scene(exponents=alone)[:4], prior))
    across = found.covariance[:61, 61:]
    # Regions see sums of the two materials: only the three signals of each are coupled, and those are well known.
    assert np.abs(across).max() < 0.02


def test_products_tell_more_than_direct_light(prior):
    direct = find_map(joint_problem(*scene(exponents=EXPONENTS[:2], error=0.001)[:4], prior))
    both = find_map(joint_problem(*scene(error=0.001)[:4], prior))
    assert np.all(information_bits(both, 2) > information_bits(direct, 2))


def test_less_noise_tells_more(prior):
    bits = [information_bits(find_map(joint_problem(*scene(error=error)[:4], prior)), 2).sum()
            for error in (0.05, 0.01, 0.002)]
    assert bits[0] < bits[1] < bits[2]


def test_monte_carlo_noise_of_the_transport_widens(prior):
    transport, matrix, signal, noise, _ = scene(error=0.002)
    noisy = LightTransport(transport.materials, transport.exponents, transport.coefficients,
                           np.tile(1e-4 * np.eye(len(EXPONENTS)), (40, 1, 1)))
    plain, wider = (find_map(joint_problem(one, matrix, signal, noise, prior)) for one in (transport, noisy))
    assert np.trace(wider.covariance) > np.trace(plain.covariance)


def test_the_sampler_converges_and_holds_the_truth(prior):
    transport, matrix, signal, noise, truth = scene(error=0.05)
    samples = sample_joint(joint_problem(transport, matrix, signal, noise, prior), seed=1, kept=2000)
    assert samples.r_hat < 1.01
    assert samples.effective_samples > 400
    lower, upper = np.quantile(samples.spectra, [0.005, 0.995], axis=0)
    assert np.mean((truth >= lower) & (truth <= upper)) > 0.9  # one case; calibration is measured by the benchmark
    assert samples.spectra.min() > 0 and samples.spectra.max() < 1


def test_one_gaussian_has_the_moments_of_the_mixture(prior):
    mean, root = gaussian_of(prior)
    rng = np.random.default_rng(3)
    component = rng.choice(prior.weights.size, 20_000, p=prior.weights)
    x = np.array([prior.means[c][30] for c in component]) + np.sqrt(
        prior.covariances[component, 30, 30]) * rng.standard_normal(20_000)
    sigma = np.sqrt((root @ root.T)[30, 30])
    assert abs(x.mean() - mean[30]) < 4 * sigma / np.sqrt(20_000)   # four standard errors
    assert abs(x.std() / sigma - 1) < 0.04                          # heavier tails than normal: four times 1 %


def test_diagnostics_of_known_series():
    rng = np.random.default_rng(4)
    noise = rng.standard_normal((2000, 8, 2))
    slow = np.empty_like(noise)
    slow[0] = noise[0]
    for t in range(1, len(noise)):
        slow[t] = 0.9 * slow[t - 1] + np.sqrt(1 - 0.81) * noise[t]
    # An autoregression of 0.9 has an integrated time of 1.9 / 0.1 = 19; estimates scatter by some ten percent.
    np.testing.assert_allclose(effective_sample_size(slow), 16_000 / 19, rtol=0.35)
    np.testing.assert_allclose(effective_sample_size(noise), 16_000, rtol=0.15)
    assert split_r_hat(noise).max() < 1.005
    assert split_r_hat(noise + 3 * np.arange(8)[None, :, None]).min() > 1.5


def test_bad_scenes_are_errors(prior):
    transport, matrix, signal, noise, _ = scene()
    with pytest.raises(InputError, match=r"must both be \(40, 3\)"):
        joint_problem(transport, matrix, signal[:5], noise, prior)
    with pytest.raises(InputError, match="a positive standard error"):
        joint_problem(transport, matrix, signal, 0 * noise, prior)
    with pytest.raises(InputError, match="5 draws were asked for"):
        sample_joint(joint_problem(transport, matrix, signal, noise, prior), 0, kept=5)
