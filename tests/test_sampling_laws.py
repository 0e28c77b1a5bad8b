"""Laws of what is said of one signal or one scene: evidence, draws, and judgements of them.

Statistical tests have a significance of 1e-4 each (3.9 sigma), at fixed seeds.
"""
import dataclasses

import numpy as np
import pytest
from sampling_cameras import response, seen
from scipy import stats
from test_posterior_laws import SMOOTH, mixture_of

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.gloss import gloss_states
from spectrabox.radiometry.records.scenes import RegionTransport
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.sampling.evaluation.identification import (
    ALIKE_NM,
    SpectralLibrary,
    evidence,
    usual_ratio,
)
from spectrabox.sampling.evaluation.metrics import curve_band
from spectrabox.sampling.further.more_measurements import Reading, check_possible
from spectrabox.sampling.prior.calibrated_marginals import COARSE, marginal_moments
from spectrabox.sampling.prior.families import layered
from spectrabox.sampling.prior.families.leaves import leaf
from spectrabox.sampling.prior.mixture import PRIOR_GRID, reflectance
from spectrabox.sampling.prior.mixture_posterior import (
    SIGNAL_FLOOR,
    UNMOVED,
    mean_and_spread,
    posterior,
    width_factors,
)
from spectrabox.sampling.prior.signal_posterior import sample_prior, solve_posterior
from spectrabox.sampling.prior.summaries import summaries
from spectrabox.sampling.scene.joint_posterior import (
    JointProblem,
    fit_modes,
    gaussian_of,
    joint_problem,
)
from spectrabox.sampling.scene.joint_sampling import sample_joint
from spectrabox.sampling.scene.scene_draws import shared_errors, surprise
from spectrabox.sampling.summary import READING_ERROR, shares_by_cause

from tools.prior_training import FLOOR, MIN_CURVES, fit_mixture

SIGMAS = stats.norm.isf(0.5e-4)


def two_components(apart=1.0, factor=1.0):
    """Two components on the prior's wavelengths, so narrow that the logit is nearly straight."""
    tilt = apart * np.linspace(-0.06, 0.06, PRIOR_GRID.nm.size)
    return mixture_of(PRIOR_GRID.nm, [0.4, 0.6], [-tilt, 1.5 * tilt],
                      [0.05**2 * SMOOTH, 0.08**2 * SMOOTH], factor)


@pytest.mark.parametrize("bands", [1, 2])
def test_the_evidence_of_a_signal_is_its_density_under_the_mixture(bands):
    covariance = np.array([[1.0, 0.4], [0.4, 1.0]])
    known = mixture_of([450.0, 650.0], [0.7, 0.3], [[-0.2, 0.1], [0.2, 0.4]],
                       [0.1**2 * covariance, 0.2**2 * covariance])
    rows = np.array([[0.7, 0.3], [0.2, 0.8]])[:bands]
    signal, noise = np.array([[0.51, 0.54]])[:, :bands], 0.01**2 * np.eye(bands)
    line, step = np.linspace(-1.6, 1.6, 641, retstep=True)
    x = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    density = sum(weight * stats.multivariate_normal(mean, spread).pdf(x)
                  for weight, mean, spread in zip(known.weights, known.means, known.covariances,
                                                  strict=True))
    likelihood = stats.multivariate_normal(signal[0], noise + SIGNAL_FLOOR**2 * np.eye(bands)).pdf(
        reflectance(x) @ rows.T)
    exact = np.log(density @ likelihood * step**2)
    # Laplace's method errs by the squared spread of 0.2 logits
    assert posterior(known, rows, signal, noise).log_evidence[0] == pytest.approx(exact, abs=0.02)


def test_the_law_that_draws_follow_is_that_of_draws():
    """Means, deviations and covariances of draws of a mixture whose components lie apart."""
    known, measured = two_components(factor=1.5), seen(np.full(61, 0.5), 0.004)
    signals, noise = measured.signal[None], measured.noise_covariance[None]
    mixture = posterior(known, measured.relative_response, signals, noise)
    assert 0.2 < mixture.weights[0, 0] < 0.8
    law, covariance = marginal_moments(known, measured.relative_response, signals, noise, mixture)
    mean, spread = mean_and_spread(law)
    drawn = sample_prior(measured, 20_000, 5, prior=known).spectra
    # 20 000 draws know a mean to 0.7 % of a deviation, a deviation to 0.5 %, a covariance to 0.7 %
    np.testing.assert_allclose(drawn.mean(axis=0), mean[0], atol=0.04 * spread.max())
    np.testing.assert_allclose(drawn.std(axis=0), spread[0], rtol=0.04)
    of_draws = np.cov(drawn, rowvar=False)[:, COARSE]
    size = np.outer(spread[0], spread[0, COARSE])
    np.testing.assert_allclose(covariance[0] / size, of_draws / size, atol=0.06)
    # the test can tell: the components lie apart, and are not where the band's middle is
    between = np.ptp(reflectance(mixture.logits[:, 0]), axis=0).max()
    assert between > spread.max()


def test_a_bent_logit_makes_the_law_of_draws_as_wide_as_draws_are():
    """Dark surfaces, where the logit bends: the second order counts."""
    known = mixture_of(PRIOR_GRID.nm, [1.0], np.full((1, 61), -1.6), [0.8**2 * SMOOTH])
    measured = seen(reflectance(np.linspace(-2.4, -0.8, 61)), 0.0)
    signals, noise = measured.signal[None], measured.noise_covariance[None]
    mixture = posterior(known, measured.relative_response, signals, noise)
    law, _ = marginal_moments(known, measured.relative_response, signals, noise, mixture)
    logits = np.log(drawn := sample_prior(measured, 20_000, 6, prior=known).spectra)
    logits -= np.log1p(-drawn)
    skew = law.skews[0, 0]
    variance = law.variances[0, 0] * np.exp(skew**2) * np.expm1(skew**2) / skew**2
    # to second order: what is left is of the fourth order in spreads of half a logit
    np.testing.assert_allclose(logits.std(axis=0), np.sqrt(variance), rtol=0.03)
    mean = law.logits[0, 0] + np.sqrt(law.variances[0, 0]) * np.expm1(skew**2 / 2) / skew
    bent = np.abs(mean - mixture.logits[0, 0]).max()
    # 20 000 draws know a mean to 0.7 % of a deviation
    np.testing.assert_allclose(logits.mean(axis=0), mean, atol=0.03 * logits.std(axis=0).max())
    assert bent > 0.06 * logits.std(axis=0).max()       # the test can tell: the bend moves it


def test_shared_errors_add_up_to_the_covariance_that_is_stated():
    rng = np.random.default_rng(1)
    signal, root = rng.uniform(0.1, 0.9, (5, 3)), 0.03 * rng.standard_normal((3, 3))
    surface = np.array([0, 0, 1, 1, 2])
    errors = shared_errors(signal, root @ root.T, 0.02, surface, 0.01, 0.04)
    found = np.einsum("qrk,qsl->rksl", errors, errors)
    same = (surface[:, None] == surface)[:, None, :, None]
    relative = (root @ root.T + 0.02**2)[None, :, None, :] + same * (
        0.01**2 * np.eye(3) + 0.04**2)[None, :, None, :]
    np.testing.assert_allclose(found, relative * signal[:, :, None, None] * signal, atol=1e-15)


def linear_problem(rng, materials=2, size=4, rows=5):
    """A scene so near to grey that its signals are straight in the logits."""
    roots = np.stack([scale * np.eye(size) for scale in (2e-3, 2e-3)])
    reading = rng.uniform(200, 900, (rows, 1, materials))
    return JointProblem(("a", "b"), np.eye(materials), np.ones((materials, size)), reading,
                        np.zeros(rows), rng.uniform(0.5, 1.5, (1, size)),
                        np.zeros((materials, 2)), np.zeros((2, size)), roots, np.zeros((0, 1)),
                        np.zeros((rows, 0)))


def test_how_surprising_a_scene_is_is_uniform_where_the_prior_holds():
    rng = np.random.default_rng(2)
    problem, labels, chances = linear_problem(rng), np.zeros((1, 2), int), []
    zero = (problem.rows.sum(axis=2) * problem.response.sum() / 2)[:, 0]
    for _ in range(250):
        z = rng.standard_normal(8)
        logits = (problem.roots[0] @ z.reshape(2, 4).T).T
        seen_light = np.einsum("fm,m->f", problem.rows[:, 0],
                               reflectance(logits) @ problem.response[0])
        scene = dataclasses.replace(problem, targets=seen_light + rng.standard_normal(zero.size))
        chances.append(surprise(scene, labels, *fit_modes(scene, labels, np.zeros((1, 8)))))
    assert stats.kstest(chances, "uniform").pvalue > 1e-4


def test_draws_of_a_scene_take_each_component_by_its_evidence():
    """Two components on either side of grey, of which a picture tells a little."""
    size, apart, weights = 4, 0.02, np.array([0.3, 0.7])
    means = apart * np.array([[-1.0], [1.0], [0.0]]) * np.ones(size)
    response = np.full((1, size), 1.0)
    reading = np.array([[[35.0]]])
    problem = JointProblem(("a",), np.ones((1, 1)), np.ones((1, size)), reading,
                           np.array([35.0 * 0.5 * size - 1.2]), response,
                           np.log([[*weights, 1.0]]), means, np.repeat(2e-3 * np.eye(size)[None], 3,
                                                                       axis=0),
                           np.zeros((0, 1)), np.zeros((1, 0)))
    labels = np.array([[0], [1]])
    modes = labels, *fit_modes(problem, labels, np.zeros((2, size)))
    drawn = sample_joint(problem, 3, modes, 4000)[0][:, 0].mean(axis=1)
    slope = 35.0 / 4        # of the signal by the sum of the logits
    density = stats.norm(35.0 * 0.5 * size + slope * size * apart * np.array([-1, 1]),
                         np.hypot(1, slope * 2e-3 * np.sqrt(size))).pdf(problem.targets)
    exact = weights * density / (weights @ density)
    # the logit is straight to 1e-4; some thousand proposals, half of them or more effective
    assert np.mean(drawn > 0.5) == pytest.approx(exact[1], abs=0.04)
    assert 0.2 < exact[1] < 0.45        # neither half nor what the prior said


def test_components_of_a_scene_are_as_wide_as_their_families_are_calibrated_to_be():
    plain = two_components()
    factors = np.linspace(1.1, 1.8, 61) * np.ones((1, 5, 1))
    known = dataclasses.replace(plain, band_factors=factors, stated_factors=factors)
    signal, first = np.full((4, 3), 0.5), np.zeros(4, int)
    regions = RegionTransport(("a",), np.array([[1]]), np.ones((4, 1)), signal, 0.01 * signal,
                              first, first, 0.0, 0.0)
    problem = joint_problem(regions, response(3)[1], known)
    for root, covariance in zip(problem.roots, plain.covariances, strict=False):
        np.testing.assert_allclose(root @ root.T, np.outer(factors[0, 0], factors[0, 0])
                                   * covariance, atol=1e-12)


def test_one_gaussian_has_the_covariance_of_the_mixture():
    """Within the components and between them."""
    known = two_components(apart=3.0)
    mean, root = gaussian_of(known)
    second = sum(weight * (covariance + np.outer(at, at)) for weight, at, covariance in zip(
        known.weights, known.means, known.covariances, strict=True))
    np.testing.assert_allclose(mean, known.weights @ known.means, atol=1e-12)
    np.testing.assert_allclose(root @ root.T, second - np.outer(mean, mean), atol=1e-12)


def test_a_true_spectrum_is_rejected_as_often_as_stated():
    """Samples that vary as stated, by smooth curves, beside errors of the library's curves."""
    rng, grid = np.random.default_rng(5), PRIOR_GRID
    measured = seen(np.full(61, 0.5), 0.003)
    library = np.full((400, 61), 0.4)
    error, variation = np.full(library.shape, 0.02), 0.015
    alike = np.exp(-((grid.nm[:, None] - grid.nm) / ALIKE_NM)**2 / 2)
    root = np.linalg.cholesky(alike + 1e-9 * np.eye(61))
    noise = measured.noise_covariance + SIGNAL_FLOOR**2 * np.eye(3)
    chances = []
    for curve in library:
        own = curve + np.hypot(error[0], variation) * (root @ rng.standard_normal(61))
        signal = measured.relative_response @ own + rng.multivariate_normal(np.zeros(3), noise)
        _, _, chance = evidence(dataclasses.replace(measured, signal=signal), SpectralLibrary(
            ("",), ("",), curve[None], error[:1], ()), variation)
        chances.append(float(chance[0]))
    assert stats.kstest(chances, "uniform").pvalue > 1e-4


@pytest.mark.parametrize("bands", [3, 6])
def test_a_true_spectrum_is_less_evident_than_allowed_once_in_twenty(bands):
    """Against the likeliest of all signals: the ratio of densities is exp(chi-square / 2)."""
    rng, ratio = np.random.default_rng(11), usual_ratio(bands)
    chi_square = np.sum(rng.standard_normal((40_000, bands))**2, axis=1)
    # 40 000 draws know a share of a twentieth to 0.11 %
    assert np.mean(np.exp(chi_square / 2) > ratio) == pytest.approx(0.05, abs=0.005)


@pytest.mark.parametrize("level", [0.5, 0.95])
def test_a_band_of_curves_holds_that_share_of_whole_draws(level):
    drawn = np.random.default_rng(6).multivariate_normal(np.zeros(61), SMOOTH, 4000)
    lower, upper = curve_band(drawn, level)
    inside = np.all((drawn >= lower) & (drawn <= upper), axis=1).mean()
    assert inside == pytest.approx(level, abs=1e-3)     # a quantile of the same draws


def test_many_signals_are_unfamiliar_where_one_by_one_they_are():
    """Signals from familiar to strange: those that surprise, and those that nothing fits."""
    known = dataclasses.replace(mixture_of(PRIOR_GRID.nm, [1.0], np.zeros((1, 61)),
                                           [0.15**2 * SMOOTH]),
                                familiar_surprise=12.0)
    measured = seen(np.full(61, 0.5), 0.002)
    steps = np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.1, 0.1, 0.1], [0.25, 0.2, 0.25],
                      [0.3, -0.3, 0.3], [0.12, -0.02, 0.1]])
    one_by_one = [solve_posterior(known, dataclasses.replace(
        measured, signal=measured.signal + step)).outcome for step in steps]
    together = summaries(known, measured.relative_response, measured.signal + steps,
                         {"noise": np.repeat(measured.noise_covariance[None], len(steps), axis=0)},
                         0.95).outcome
    near = {Outcome.OUT_OF_REACH: Outcome.TOO_ROUGH}
    assert [near.get(each, each) for each in one_by_one] == together.tolist()
    assert set(one_by_one) == {Outcome.FAMILIAR, Outcome.UNFAMILIAR, Outcome.BEYOND_LEARNT}


@pytest.mark.parametrize("tail", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("gloss", [False, True])
def test_an_answer_does_not_jump_where_a_signal_becomes_unfamiliar(tail, gloss):
    """Along a line of signals, at the two numbers next to each other where the outcome changes."""
    known = dataclasses.replace(two_components(), familiar_surprise=6.0, tail=tail)
    away, base = np.array([0.06, 0.01, 0.04]), seen(np.full(61, 0.5), 0.002)
    base = dataclasses.replace(base, states=gloss_states(None, ("lamp",) * 3) if gloss else None)

    def solved(share):
        return solve_posterior(known, dataclasses.replace(base, signal=base.signal + share * away))

    low, high = 0.0, 1.0
    assert solved(low).outcome is Outcome.FAMILIAR and solved(high).outcome is Outcome.UNFAMILIAR
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if solved(middle).outcome is Outcome.FAMILIAR \
            else (low, middle)
    before, after = solved(low), solved(high)
    assert before.outcome is Outcome.FAMILIAR and after.outcome is Outcome.UNFAMILIAR
    assert before.method == after.method == "learnt prior"
    # signals are 1e-13 apart; modes are found to 1e-6, quantiles to single precision
    for name in ("mean", "standard_deviation"):
        np.testing.assert_allclose(getattr(after, name), getattr(before, name), atol=1e-6)
    np.testing.assert_allclose(after.band(0.95), before.band(0.95), atol=1e-6)
    together = summaries(known, base.relative_response, np.array(
        [each.measurement.signal for each in (before, after)]),
        {"noise": np.repeat(base.noise_covariance[None], 2, axis=0)}, 0.95)
    if not gloss:
        assert together.outcome.tolist() == [Outcome.FAMILIAR, Outcome.UNFAMILIAR]
    np.testing.assert_allclose(together.lower[1], together.lower[0], atol=1e-6)


def test_bands_of_unlikely_signals_grow_as_those_of_student_t():
    """Truths whose covariance is known up to a factor: those of surprising signals scatter more
    about their means, by (n + d) / (n + bands), over n + bands degrees of freedom.
    """
    freedom, bands = 8.0, 3
    rng = np.random.default_rng(31)
    spread = 0.05**2 * SMOOTH
    known = dataclasses.replace(mixture_of(PRIOR_GRID.nm, [1.0], np.zeros((1, 61)), [spread]),
                                familiar_surprise=bands / UNMOVED, tail=bands / UNMOVED / freedom)
    size = np.sqrt(freedom / rng.chisquare(freedom, 20_000))[:, None]
    logits = size * rng.multivariate_normal(np.zeros(61), spread, len(size))
    M = seen(np.full(61, 0.5), bands=bands).relative_response
    found = posterior(known, M, reflectance(logits) @ M.T, np.zeros((bands, bands)))
    off = (logits - found.logits[0]) / (np.sqrt(found.variances[0]) * found.growth[:, None])
    degrees = freedom + bands
    for least, most in ((bands, 6), (6, 12), (12, np.inf)):
        some = (found.surprise > least) & (found.surprise <= most)
        assert some.sum() > 500
        square = np.mean(off[some]**2, axis=1)
        # 3.9 standard errors, and what the noise floor of 0.1 % of white and the bend of the logit
        # take off
        assert square.mean() == pytest.approx(degrees / (degrees - 2),
                                              abs=SIGMAS * square.std() / some.sum()**0.5 + 0.05)


@pytest.mark.parametrize("sigmas, possible", [(4.0, True), (7.0, False)])
def test_a_reading_beyond_white_is_refused_where_chance_makes_it_so_once_in_a_million(sigmas,
                                                                                     possible):
    """Chi-square of four with a chance of 1e-6 lies at 5.8 standard errors squared."""
    base = seen(np.full(61, 0.999), 0.002)
    more = ("spot", (Reading.at_wavelength(
        550, 1 + sigmas * np.hypot(0.003, SIGNAL_FLOOR), 0.003),))
    if possible:
        check_possible(base, [more])
    else:
        with pytest.raises(InputError, match="spot contradicts the other measurements"):
            check_possible(base, [more])


def test_many_signals_ask_for_the_reading_that_one_by_one_they_ask_for():
    """Of the law of draws and of its draws: the reading that takes most off the variance."""
    edges = 0.02 + np.linspace(-1, 1, 61)**2
    known = mixture_of(PRIOR_GRID.nm, [1.0], np.zeros((1, 61)),
                       [0.02 * np.outer(edges, edges) * SMOOTH])
    measured = seen(np.full(61, 0.5), 0.002)
    drawn = sample_prior(measured, 8000, 7, prior=known).spectra
    covariance = np.cov(drawn, rowvar=False)
    reduction = PRIOR_GRID.weights_nm @ covariance**2 / (np.diag(covariance) + READING_ERROR**2)
    found = summaries(known, measured.relative_response, measured.signal[None],
                      {"noise": measured.noise_covariance[None]}, 0.95).next_measurement_nm[0]
    # sums over every third wavelength, and 8000 draws: as good a choice to 3 %
    assert reduction[PRIOR_GRID.nm == found][0] > 0.97 * reduction.max()
    assert np.median(reduction) < 0.9 * reduction.max()


def inside_transmission(index, rays=200_000):
    """Share of light from all directions within a plate that leaves it: Fresnel, all angles."""
    sine = np.sqrt((np.arange(rays) + 0.5) / rays)      # uniform in sin^2, as Lambert's law
    leaves = sine * index < 1
    cosine, outside = np.sqrt(1 - sine[leaves]**2), np.sqrt(1 - (index * sine[leaves])**2)
    across = (index * cosine - outside) / (index * cosine + outside)
    along = (index * outside - cosine) / (index * outside + cosine)
    return np.sum(1 - (across**2 + along**2) / 2) / rays


@pytest.mark.parametrize("index", [1.33, 1.5])
def test_a_plate_that_absorbs_nothing_returns_all_light_and_sends_some_through(index):
    """Light that runs to and fro within a plate, summed up reflection by reflection; what enters
    from 40 degrees about the normal is of the first surface alone.
    """
    one = np.full(3, index)
    r, t = leaf(np.ones((1, 1)), np.zeros((1, 3)), one)
    np.testing.assert_allclose(r + t, 1, atol=1e-4)     # the least absorption is 1e-6
    out = inside_transmission(index)
    # of what enters, t out (1 + r^2 + r^4 ...) leaves below, with r = 1 - out
    entering = t[0, 0] / (out / (1 - (1 - out)**2))
    cone = np.sqrt((np.arange(20_000) + 0.5) / 20_000) * np.sin(np.deg2rad(40))
    cosine, inside = np.sqrt(1 - cone**2), np.sqrt(1 - (cone / index)**2)
    across = (cosine - index * inside) / (cosine + index * inside)
    along = (index * cosine - inside) / (index * cosine + inside)
    assert entering == pytest.approx(np.mean(1 - (across**2 + along**2) / 2), rel=1e-3)


def test_blood_of_150_grams_a_litre_passes_a_tenth_for_every_unit_of_absorbance():
    molar = 150 / 64_500        # mol / l of haemoglobin
    extinction_cm, depth_cm = 53_236.0, 0.004
    assert np.exp(-layered.MOLAR_BLOOD * extinction_cm * depth_cm) == pytest.approx(
        10 ** -(extinction_cm * molar * depth_cm))


def test_vessels_that_let_nothing_through_absorb_as_their_shadows_do(monkeypatch):
    """Black tubes of radius r that fill a share of the skin: 1 / (2 r) of it, per unit of length,
    whatever is in them.
    """
    dermis = []
    monkeypatch.setattr(layered, "log_uniform", lambda rng, low, high, count:
                        np.full((count, 1), np.sqrt(low * high)))
    for extinction in (1e-9, 1e15):
        monkeypatch.setattr(layered, "_blood", lambda rng, count, full=extinction:
                            np.full((count, 61), full))
        dermis.append(layered._layers(np.random.default_rng(9), 3)[1])
    radius_cm, share = np.sqrt(5e-4 * 4e-3), np.sqrt(0.003 * 0.07)
    np.testing.assert_allclose(dermis[1] - dermis[0], share / (2 * radius_cm), rtol=1e-6)


def test_a_logit_is_never_known_better_than_training_shows():
    """Curves that a few directions hold altogether: what is left is the floor's variance."""
    rng, shapes = np.random.default_rng(10), np.sin(np.outer([1, 2, 3], PRIOR_GRID.nm / 60))
    curves = reflectance(0.5 * rng.standard_normal((MIN_CURVES, 3)) @ shapes)
    fitted = fit_mixture(curves, 2, 0, smooth=0.0)
    for covariance in fitted.covariances:
        assert np.linalg.eigvalsh(covariance)[0] == pytest.approx(FLOOR, rel=1e-3)


def test_shares_of_causes_are_shares_of_the_variance():
    """Two independent errors, one three times the other: a tenth and nine tenths."""
    rng = np.random.default_rng(8)
    small, large = rng.normal(0, [[0.1]], (20_000, 5)), rng.normal(0, [[0.3]], (20_000, 5))
    shares = shares_by_cause({"small": small.var(axis=0)[None], "large": large.var(axis=0)[None]})
    without = 1 - large.var(axis=0).mean() / (small + large).var(axis=0).mean()
    assert shares["small"][0] == pytest.approx(without, abs=0.01)      # by chance correlation


def test_a_band_is_of_the_usual_width_where_95_per_cent_of_a_normal_one_lie_within_it():
    known = dataclasses.replace(two_components(), width_power=-0.3)
    spread = 0.12 / (stats.norm.ppf(0.975) - stats.norm.ppf(0.025))
    assert width_factors(known, np.full((1, 61), spread))[0, 0] == pytest.approx(1, abs=1e-6)
