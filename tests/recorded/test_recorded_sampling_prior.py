"""Recorded: what signals say under the learnt prior, from its file to bands, draws, summaries."""
import dataclasses
import json

import numpy as np
import pytest
from sampling_cameras import response, surface
from sampling_inputs import (
    lopsided_measurement,
    lopsided_noise,
    lopsided_prior,
    result_or_refusal,
)

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import Outcome
from spectrabox.sampling.prior import drawn as drawn_file
from spectrabox.sampling.prior import draws as draws_file
from spectrabox.sampling.prior import mixture as mixture_file
from spectrabox.sampling.prior import posterior as posterior_file
from spectrabox.sampling.prior import summaries as summaries_file
from spectrabox.sampling.prior.certified import (
    certified_sentence,
    mostly_in_doubt,
    standing_facts,
    standings,
)
from spectrabox.sampling.prior.drawn import as_drawn
from spectrabox.sampling.prior.draws import (
    _component,
    family_shares,
    prior_spectra,
    sample_prior,
    sentence_of,
    solve_each,
)
from spectrabox.sampling.prior.families.words import WORDS, unknown_families
from spectrabox.sampling.prior.mixture import (
    check_prior,
    components_where_stated,
    condition_on_families,
    drawn_reflectances,
    load_prior,
    logit,
    of_families,
    reflectance,
    reflectance_moments,
    save_prior,
)
from spectrabox.sampling.prior.posterior import (
    allowed_misfit,
    band_factors,
    calibrated_bands,
    central_band,
    conformal_scores,
    mean_and_spread,
    mixture_quantile,
    posterior,
    unlikeness,
    width_factors,
)
from spectrabox.sampling.prior.quantiles import quantiles
from spectrabox.sampling.prior.smoothness import smoothness_prior
from spectrabox.sampling.prior.summaries import summaries

SINGLE = 2e-5       # quantiles and covariances of draws are of single precision


ZIGZAG = np.array([-1, 1, -0.9, 1.1, -1, 0.8])


def seven_signals(bands=3):
    """Signals (7, K) of unlike surfaces, familiar ones and one beyond, and their covariances."""
    grid, matrix = response(bands)
    truths = np.array([surface(grid.nm, seed) * scale for seed, scale in
                       enumerate([1.0, 0.4, 1.6, 0.9, 0.12, 1.9])])
    signals = np.vstack([truths @ matrix.T, np.linspace(0.9, 0.15, bands)])
    sizes = np.array([0.004, 0.009, 0.002, 0.015, 0.001, 0.006, 0.003])
    noise = np.array([lopsided_noise(bands, size, seed) for seed, size in enumerate(sizes)])
    return matrix, signals, noise


@pytest.fixture(scope="module")
def seven():
    prior, (matrix, signals, noise) = lopsided_prior(), seven_signals()
    return prior, matrix, signals, noise, posterior(prior, matrix, signals, noise)


def test_posteriors_of_many_signals(recorded, seven):
    prior, matrix, signals, noise, found = seven
    recorded(found)
    again = posterior(prior, matrix, signals, 1.7 * noise, found)
    recorded(again, case="from a start")
    recorded(posterior(prior, matrix, signals, 1.7 * noise, still=3e-2), rtol=1e-4, case="roughly")
    # the start is where to begin, not what is found, nor is it changed
    np.testing.assert_allclose(again.logits[again.weights.T > 0],
                               posterior(prior, matrix, signals, 1.7 * noise).logits[
                                   again.weights.T > 0], atol=1e-4)


@pytest.mark.parametrize("bands", [1, 3, 6])
def test_a_posterior_of_one_signal(recorded, bands):
    matrix, signals, noise = seven_signals(bands)
    prior = lopsided_prior()
    alone = [posterior(prior, matrix, signals[row:row + 1], noise[row]) for row in range(3)]
    recorded([(one.weights, one.logits, one.variances, one.misfit, one.surprise, one.log_evidence)
              for one in alone])
    # one signal is treated by components at once, many by signals at once: the same filter
    together = posterior(prior, matrix, signals[:3], noise[:3])
    np.testing.assert_allclose(np.concatenate([one.weights for one in alone]), together.weights,
                               atol=1e-8)


def test_bands_of_a_mixture(recorded, seven, monkeypatch):
    prior, _, _, noise, found = seven
    everything = {
        "spread": mean_and_spread(found),
        "quantiles": [mixture_quantile(found, p) for p in (0.003, 0.31, 0.5, 0.88)],
        "central": central_band(found, 0.8),
        "calibrated": calibrated_bands(prior, found, (0.3, 0.62, 0.95, 0.97)),
        "factors": [band_factors(prior, found, level) for level in (0.4, 0.5, 0.7, 0.995)],
        "width": width_factors(prior, np.linspace(0.01, 0.09, 122).reshape(2, 61)),
        "unlike": unlikeness(prior, found, noise),
        "unlike one noise": unlikeness(prior, found, noise[3]),
        "allowed": [allowed_misfit(size**2 * np.diag([1.0, 0.3, 0.8])) for size in
                    (0, 1.2e-3, 1.24e-3, 1.26e-3, 1.3e-3, 0.02)]}
    recorded(everything, rtol=SINGLE)
    monkeypatch.setattr(posterior_file, "BLOCK", 3)
    in_blocks = calibrated_bands(prior, found, (0.95,))
    np.testing.assert_allclose(in_blocks[1][0][0], everything["calibrated"][1][2][0], atol=1e-6)


def test_scores_of_bands(recorded):
    rng = np.random.default_rng(3)
    mean = rng.uniform(0.2, 0.8, (4, 5))
    lower, upper = mean - rng.uniform(0, 0.1, (4, 5)), mean + rng.uniform(0, 0.2, (4, 5))
    lower[1, 2] = mean[1, 2] - 5e-5
    upper[2, 3] = mean[2, 3] + 2e-5
    scores = conformal_scores(mean, lower, upper, rng.uniform(0, 1, (4, 5)))
    recorded(scores)
    assert np.all(conformal_scores(mean, lower - 1, upper + 2, upper + 2) == pytest.approx(1))


def test_quantiles_of_skewed_mixtures(recorded):
    rng = np.random.default_rng(4)
    weights = rng.dirichlet([3, 1, 0.6], 4)
    weights[2] = [0.8, 0.2, 0.0]
    centres, deviations = rng.normal(0, 2, (4, 3, 5)), rng.uniform(0.05, 0.9, (4, 3, 5))
    skews = rng.uniform(-0.4, 0.4, (4, 3, 5))
    recorded([quantiles(weights, centres, deviations, each, probability)
              for each in (None, skews) for probability in (0.002, 0.2, 0.5, 0.501, 0.93, 0.999)],
             rtol=SINGLE)


def test_the_law_of_draws(recorded, seven, monkeypatch):
    prior, matrix, signals, noise, found = seven
    law, covariance = as_drawn(prior, matrix, signals, noise, found)
    recorded((law, covariance, mean_and_spread(law), central_band(law, 0.9)), rtol=1e-4)
    monkeypatch.setattr(drawn_file, "PAIRS", 3)     # so that a signal's pairs lie in two blocks
    again, in_blocks = as_drawn(prior, matrix, signals, noise, found)
    np.testing.assert_allclose(in_blocks, covariance, atol=1e-6 * np.abs(covariance).max())
    np.testing.assert_allclose(again.skews, law.skews, atol=1e-6)


def test_what_draws_of_a_component_are_made_of(recorded, seven):
    prior, matrix, signals, noise, _ = seven
    measured = dataclasses.replace(lopsided_measurement(), signal=signals[1],
                                   noise_covariance=noise[1])
    alone = posterior(prior, matrix, signals[1:2], noise[1])
    factor = band_factors(prior, alone, 0.95)[0]
    for index in np.flatnonzero(alone.weights[0])[:2]:
        one = _component(prior, alone, matrix, measured, factor, int(index))
        recorded((one.centre, one.root @ one.root.T, one.gain, one.noise_mean,
                  one.noise_root @ one.noise_root.T), rtol=SINGLE, case=str(index))


def test_draws_that_do_not_reach_the_signal(recorded, monkeypatch):
    monkeypatch.setattr(draws_file, "ROUNDS", 1)
    measured = dataclasses.replace(lopsided_measurement(noise=0.3), signal=np.full(3, 1.2))
    recorded(result_or_refusal(prior_spectra, measured, 50, 1, lopsided_prior(1e9)))


@pytest.mark.parametrize("bands", [2, 3, 5])
def test_small_systems(recorded, bands):
    rng = np.random.default_rng(bands)
    matrices, right = rng.normal(size=(5, bands, bands)), rng.normal(size=(5, bands))
    matrices[3] = 0
    matrices[4] *= 3e-3
    found = solve_each(matrices, right)
    recorded(found)
    np.testing.assert_allclose(np.einsum("nkl,nl->nk", matrices[:3], found[:3]), right[:3],
                               atol=1e-12)


@pytest.mark.parametrize("scale", [1e-12 * (1 - 0.03), 1e-12 * (1 + 0.03)])
@pytest.mark.parametrize("bands", [2, 3])
def test_a_system_is_singular_below_a_determinant(recorded, scale, bands):
    matrix = np.diag([scale, *np.ones(bands - 1)])
    recorded(solve_each(matrix[None], np.full((1, bands), 1e-12)))


@pytest.mark.parametrize("case", ["familiar", "no noise", "stated", "unfamiliar", "too rough",
                                  "out of reach", "fine grid"])
def test_draws_and_what_is_said_of_them(recorded, case):
    prior, measured = lopsided_prior(), lopsided_measurement(step_nm=1 if case == "fine grid"
                                                             else 5)
    match case:
        case "no noise":
            measured = dataclasses.replace(measured, noise_covariance=np.zeros((3, 3)))
        case "stated":
            prior = of_families(prior, ["skin", "leaf"])
        case "unfamiliar":
            prior = lopsided_prior(familiar_surprise=1e-3)
        case "too rough":
            measured = lopsided_measurement(6, 1e-4)
            measured = dataclasses.replace(measured, signal=0.46 + 0.17 * ZIGZAG)
        case "out of reach":
            measured = dataclasses.replace(measured, signal=np.array([0.4, 1.09, 0.3]))
    found = sample_prior(measured, 2500, 3, 9, prior)
    recorded((found.method, found.outcome, found.sentence, found.effective_samples, found.seed,
              found.spectra.shape, found.coefficients.shape))
    # the smoothness prior has eigenvalues that are alike, whose eigenvectors turn with the machine:
    # of single draws 3 % of the deviation, of splines through them and of means little
    wide = "smoothness" in found.method
    recorded(found.spectra, rtol=0.15 if wide else 1e-6, case="draws")
    recorded((found.coefficients, found.spectra.mean(axis=0)), rtol=2e-3 if wide else 1e-6,
             case="splines")
    signals = found.spectra @ (measured.relative_response if case != "fine grid" else
                               response(3)[1]).T
    if case in ("no noise",):
        np.testing.assert_allclose(signals, np.tile(measured.signal, (2500, 1)), atol=1e-9)
    assert prior_spectra(measured, 5, 3, prior).spectra.shape == (5, 61)


def test_the_first_draws_are_those_of_one_seed(recorded):
    """Draws themselves; their roots come from eigenvectors that are unlike one another."""
    measured = lopsided_measurement()
    first, again = (prior_spectra(measured, count, 7, lopsided_prior()) for count in (2100, 2100))
    np.testing.assert_array_equal(first.spectra, again.spectra)
    assert not np.array_equal(first.spectra[:52], first.spectra[2048:])
    other = prior_spectra(measured, 2100, 8, lopsided_prior())
    assert not np.array_equal(first.spectra, other.spectra)
    recorded(first)
    assert family_shares(lopsided_prior(), measured) == first.shares


def test_sentences_of_families(recorded):
    shares = {"paint": 0.0051, "leaves": 0.0049, "skin": 0.99}
    recorded([sentence_of(outcome, stated, shares)
              for outcome in (Outcome.FAMILIAR, Outcome.UNFAMILIAR)
              for stated in ((), ("skin",), ("skin", "paint"))])


@pytest.mark.parametrize("bands", [3, 5])
def test_summaries_of_many_signals(recorded, bands, monkeypatch):
    prior, (matrix, signals, noise) = lopsided_prior(), seven_signals(bands)
    signals = np.vstack([signals, np.r_[[0.3, 1.15], np.full(bands - 2, 0.2)]])
    noise = np.concatenate([noise, noise[:1]])
    causes = {"photo": 0.3 * noise, "light": 0.2 * noise[::-1] + 0.5 * noise}
    whole = summaries(prior, matrix, signals, causes, 0.9)
    recorded(whole, rtol=1e-4)
    assert {*whole.outcome} >= {Outcome.FAMILIAR, Outcome.TOO_ROUGH}
    np.testing.assert_allclose(whole.budget.sum(axis=1), 1, rtol=1e-9)
    monkeypatch.setattr(summaries_file, "BATCH", 3)
    parts = summaries(prior, matrix, signals, causes, 0.9)
    np.testing.assert_allclose(parts.lower, whole.lower, atol=1e-5)
    np.testing.assert_array_equal(parts.outcome, whole.outcome)


def test_where_signals_become_strange(recorded):
    """Bands that differ more and more from their neighbours: familiar, unfamiliar, too rough, out
    of reach.
    """
    measured, prior = lopsided_measurement(6, 1e-4), lopsided_prior()
    found = [prior_spectra(dataclasses.replace(measured, signal=0.46 + step * ZIGZAG), 1, 1,
                           prior).outcome for step in np.linspace(0.02, 0.2, 73)]
    recorded([found.count(outcome) for outcome in (Outcome.FAMILIAR, Outcome.UNFAMILIAR,
                                                   Outcome.TOO_ROUGH, Outcome.OUT_OF_REACH)])
    assert len({*found}) == 4


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_a_signal_is_unfamiliar_beyond_a_surprise(recorded, share):
    """The limit is moved to either side of the surprise of one signal; all ways agree."""
    measured = lopsided_measurement()
    plain = lopsided_prior()
    surprise = posterior(plain, measured.relative_response, measured.signal[None],
                         measured.noise_covariance).surprise[0]
    prior = lopsided_prior(familiar_surprise=surprise * share)
    one = prior_spectra(measured, 3, 1, prior)
    many = summaries(prior, measured.relative_response, measured.signal[None],
                     {"noise": measured.noise_covariance[None]}, 0.95)
    assert one.outcome is many.outcome[0]
    recorded((one.outcome, many.outcome[0], one.method))


def test_priors_of_stated_families(recorded):
    prior = lopsided_prior()
    words = ([], ["paint"], ["leaf"], ["Skin"], ["skin", "leaves"], ["paint", "fur"], ["nothing"],
             ["leaves", "paint", "skin"])
    recorded({" ".join(stated): result_or_refusal(of_families, prior, stated) for stated in words})
    recorded([components_where_stated(prior, kept) for kept in ([0], [1], [1, 2])],
             case="components")
    recorded([condition_on_families(of_families(prior, stated)) for stated in
              ([], ["skin"], ["skin", "paint"])], case="said")
    recorded((WORDS, [unknown_families(words) for words in ([], ["Wood", "SKIN"], ["a", "b"])]),
             case="words")
    recorded((prior.family_factors(0.3), prior.family_factors(0.85), prior.family_factors(0.999),
              prior.shares(np.array([[0.1, 0.2, 0.3, 0.15, 0.25]]))), case="factors")


def test_moments_of_a_prior(recorded):
    prior, values = lopsided_prior(), np.array([0, 0.0039, 0.0041, 0.3, 0.9959, 0.9961, 1])
    recorded((logit(values), reflectance(np.linspace(-9, 8, 7)), smoothness_prior()))
    drawn, (mean, covariance) = drawn_reflectances(prior, 4000), reflectance_moments(prior, 4000)
    recorded((mean, covariance, drawn), case="draws")
    np.testing.assert_allclose(np.cov(drawn, rowvar=False), covariance, atol=1e-12)


def test_a_prior_that_is_kept(recorded, tmp_path, monkeypatch):
    prior = lopsided_prior()
    save_prior(tmp_path / "a.prior", prior)
    again = load_prior(tmp_path / "a.prior")
    recorded(again)
    for name in ("weights", "levels", "nm", "family"):
        np.testing.assert_array_equal(getattr(again, name), getattr(prior, name))
    with np.load(tmp_path / "a.prior", allow_pickle=False) as stored:
        recorded({name: (str(stored[name].dtype), stored[name].shape) for name in sorted(stored)},
                 case="file")
        recorded(json.loads(str(stored["certificates"])), case="certificates")
    save_prior(tmp_path / "plain", dataclasses.replace(prior, where_stated=None, certificates={}))
    assert load_prior(tmp_path / "plain").where_stated is None
    (tmp_path / "broken").write_bytes((tmp_path / "plain").read_bytes()[:3000])
    np.savez(tmp_path / "other.npz", format=np.array("spectrabox prior 2"))
    np.savez(tmp_path / "none.npz", nothing=np.zeros(2))
    folder = str(tmp_path)
    recorded({name: str(result_or_refusal(load_prior, tmp_path / name)).replace(folder, "FOLDER")
              for name in ("other.npz", "none.npz", "missing")}, case="refused")
    assert "damaged" in result_or_refusal(load_prior, tmp_path / "broken")
    monkeypatch.setattr(mixture_file, "FORMAT", mixture_file.BEFORE)
    save_prior(tmp_path / "before", prior)
    monkeypatch.undo()
    assert load_prior(tmp_path / "before").families == prior.families


def _changed(name, index, value):
    prior = lopsided_prior()
    values = getattr(prior, name).copy()
    values[index] = value if np.isnan(value) else values[index] + value
    return dataclasses.replace(prior, **{name: values})


def test_priors_that_are_refused(recorded):
    prior, other = lopsided_prior(), lopsided_prior().where_stated
    skewed = prior.covariances.copy()
    skewed[2, 3, 4] += 1.5e-6 * np.abs(skewed[2]).max()
    nearly = prior.covariances.copy()
    nearly[2, 3, 4] += 0.5e-6 * np.abs(nearly[2]).max()
    flat = prior.covariances.copy()
    flat[1] = np.outer(np.ones(61), np.ones(61))
    cases = {
        "good": prior, "wavelengths": _changed("nm", 3, 2e-6), "nearly": _changed("nm", 3, 5e-7),
        "weight not finite": _changed("weights", 1, np.nan),
        "mean not finite": _changed("means", (1, 3), np.nan),
        "factor not finite": _changed("band_factors", (1, 2, 3), np.nan),
        "stated factor not finite": _changed("stated_factors", (1, 2, 3), np.nan),
        "level not finite": _changed("levels", 0, np.nan),
        "sum": _changed("weights", 1, 2e-6), "sum nearly": _changed("weights", 1, 5e-7),
        "no weight": dataclasses.replace(prior, weights=np.array([0.3, 0.22, 0.3, 0.0, 0.18])),
        "family": _changed("family", 4, 1.0),
        "skewed": dataclasses.replace(prior, covariances=skewed),
        "nearly skewed": dataclasses.replace(prior, covariances=nearly),
        "flat": dataclasses.replace(prior, covariances=flat)}
    for name, part in {
            "sum": dataclasses.replace(other, weights=np.array([0.35, 0.65 + 2e-6])),
            "sum nearly": dataclasses.replace(other, weights=np.array([0.35, 0.65 + 5e-7])),
            "no weight": dataclasses.replace(other, weights=np.array([0.0, 1.0])),
            "family": dataclasses.replace(other, family=np.array([7, 7])),
            "two families": dataclasses.replace(other, family=np.array([1, 2])),
            "flat": dataclasses.replace(other, covariances=flat[:2])}.items():
        cases[f"stated: {name}"] = dataclasses.replace(prior, where_stated=part)
    recorded({name: result_or_refusal(check_prior, case, "a.npz") for name, case in cases.items()})


def test_how_families_stand(recorded):
    certificates = lopsided_prior().certificates
    found = {}
    for stated in ((), ("leaves",), ("skin", "paint")):
        for share in (0.0, 0.0495, 0.05, 0.0505, 0.49, 0.51, 0.93):
            shares = {"skin": share, "paint": 0.97 - share, "leaves": 0.03}
            families = standings(shares, stated, certificates)
            found[f"{stated} {share}"] = (certified_sentence(families), mostly_in_doubt(families),
                                          standing_facts(families),
                                          [one.in_doubt for one in families])
    recorded(found)
    assert certified_sentence(()) == ""
    for coverage in (0.9299, 0.93):
        bands = dataclasses.replace(certificates["paint"].stated, coverage=coverage)
        held = {kind: dataclasses.replace(certificates["paint"], **{kind: bands})
                for kind in ("stated", "unstated")}
        assert [standings({"paint": 1.0}, stated, {"paint": held[kind]})[0].in_doubt
                for kind, stated in (("stated", ["paint"]), ("unstated", []))] \
            == [coverage < 0.93] * 2
    assert mostly_in_doubt(standings({"skin": 0.5}, (), {}))
    with pytest.raises(InputError):
        of_families(lopsided_prior(), ["nothing"])
