"""The estimate of one surface: what it is said to be, by draws that are held, solved, or given."""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import spectrabox as sb
from spectrabox.measure import estimate as estimates
from spectrabox.measure.estimate import Estimate
from spectrabox.measure.surfaces.surface_spectra import resample_summary, score
from spectrabox.radiometry import appearance, error_model, gloss
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import spectra
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.prior.signal_posterior import solve_posterior

NM = PRIOR_GRID.nm
BANDS = np.array([np.exp(-(((FINE_GRID.nm - peak) / 35) ** 2)) for peak in (610, 540, 460)])
BANDS /= BANDS.sum(axis=1, keepdims=True)
MEAN = 0.3 + 0.2 * (NM > 550)
DRAWS = MEAN + 0.03 * np.random.default_rng(5).standard_normal((1200, 1)) * np.ones(61)
EXACT = spectra.Outcome.EXACT


def held(draws=DRAWS, level=0.9, name="a", outcome=EXACT, **fields):
    """An estimate by draws alone, of no learnt prior."""
    samples = spectra.SpectrumSamples(PRIOR_GRID, draws, draws[:, :5], "polytope",
                                      float(len(draws)), 7, outcome, (outcome.finding(),))
    lower, upper = np.quantile(draws, [(1 - level) / 2, (1 + level) / 2], axis=0)
    summary = spectra.SpectrumSummary(
        PRIOR_GRID, draws.mean(axis=0), draws.std(axis=0), lower, upper, lower - 0.2, upper + 0.2,
        level, (), 470.0, samples)
    return Estimate(name, summary, **fields)


def solved(signal=(0.45, 0.3, 0.25), **fields):
    """An estimate under the learnt prior in closed form, without draws."""
    measured = spectra.SpectralMeasurement(FINE_GRID, BANDS, np.array(signal), 1e-5 * np.eye(3))
    posterior = solve_posterior(load_prior(), measured)
    lower, upper = posterior.band(0.95)
    summary = spectra.SpectrumSummary(
        PRIOR_GRID, posterior.mean, posterior.standard_deviation, lower, upper, np.zeros(61),
        np.ones(61), 0.95, (), 470.0)
    return Estimate("b", summary, measured, {error_model.PHOTO_NOISE: 1e-5 * np.eye(3)},
                    load_prior(), **fields), posterior


def given(values=MEAN):
    return Estimate("g", None, given=(NM, values))


# ---- curves

def test_a_spectrum_that_was_given_is_certain():
    one = given()
    assert one.known and one.as_intended and one.ending is None and one.within is None
    np.testing.assert_array_equal(one.nm, NM)
    np.testing.assert_array_equal(one.mean, MEAN)
    np.testing.assert_array_equal(one.standard_deviation, 0)
    for pair in (one.band(), one.bounds(), one.draws(2)):
        np.testing.assert_array_equal(pair, [MEAN, MEAN])
    assert one.band_width == 0 and one.next_reading_nm is None and one.error_budget == {}
    np.testing.assert_array_equal(one.lab().standard_error, 0)
    assert one.facts() == {"name": "g", "known": True, "wavelengths_nm": NM.tolist(),
                           "mean": MEAN.tolist()}
    assert one.findings == () and "given" in one.outcome and "given" in repr(one)
    assert one.text() == f"g: {one.outcome}"


@pytest.mark.parametrize("level", [0.5, 0.8])
def test_a_band_of_held_draws_has_their_quantiles(level):
    one = held()
    lower, upper = one.band(level)
    np.testing.assert_allclose([lower, upper], np.quantile(
        DRAWS, [0.5 - level / 2, 0.5 + level / 2], axis=0), rtol=1e-12)
    np.testing.assert_array_equal(one.band(0.9), [one.summary.lower, one.summary.upper])
    assert not one.known and one.band_width == pytest.approx(
        np.mean(one.summary.upper - one.summary.lower))
    np.testing.assert_array_equal(one.bounds(),
                                  [one.summary.bound_lower, one.summary.bound_upper])


def test_a_band_in_closed_form_is_that_of_the_posterior_on_the_estimate_s_wavelengths():
    one, posterior = solved()
    lower, upper = one.band(0.8)
    np.testing.assert_allclose([lower, upper], posterior.band(0.8), rtol=1e-6)
    fine = replace(one, summary=resample_summary(one.summary, FINE_GRID))
    np.testing.assert_allclose(fine.band(0.8)[0], np.interp(FINE_GRID.nm, NM, lower), rtol=1e-6)
    assert fine.draws(3).shape == (3, 301)
    np.testing.assert_allclose(fine.draws(3)[:, ::5], one.draws(3), rtol=1e-6)
    # what rests on more than its own signal is not solved from that
    with pytest.raises(AssertionError, match="draws"):
        replace(one, from_more=True).band(0.8)


@pytest.mark.parametrize("level", [0, 1, -0.2, 1.5])
def test_a_level_is_a_probability(level):
    for one in (held(), given()):
        with pytest.raises(sb.InputError):
            one.band(level)


def test_held_draws_are_given_as_they_are_and_no_more_than_there_are():
    one = held()
    np.testing.assert_array_equal(one.draws(1200, 7), DRAWS)
    np.testing.assert_array_equal(one.draws(10), DRAWS[:10])
    np.testing.assert_array_equal(one.draws(1200, 1), DRAWS)
    with pytest.raises(sb.InputError, match="1201 draws were asked for and 'a' holds 1200"):
        one.draws(1201)


def test_draws_of_the_posterior_have_its_moments():
    one, posterior = solved()
    drawn = one.draws(3000, 4)
    np.testing.assert_allclose(drawn.mean(axis=0), posterior.mean, atol=0.01)
    np.testing.assert_array_equal(one.draws(3000, 4), drawn)
    assert np.any(one.draws(3000, 5) != drawn) and one.posterior is one.posterior
    known = replace(one, solved=posterior)
    assert known.posterior is posterior
    with pytest.raises(sb.InputError, match="not estimated with the learnt prior"):
        _ = held().posterior


# ---- colours

@pytest.mark.parametrize("light", ["D65", "A"])
def test_a_colour_is_that_of_the_mean_with_the_spread_of_draws(light):
    one = held()
    colour = one.lab(light)
    np.testing.assert_allclose(colour.value,
                               appearance.reflectance_to_lab(NM, one.mean, light), rtol=1e-9)
    np.testing.assert_allclose(colour.standard_error, appearance.reflectance_to_lab(
        NM, DRAWS, light).std(axis=0), rtol=1e-9)
    assert one.lab(light) is colour
    np.testing.assert_allclose(one.srgb, appearance.reflectance_to_srgb(NM, one.mean), atol=1e-9)
    with pytest.raises(sb.InputError, match="is no light"):
        one.lab(5)


def test_draws_lie_within_what_is_stated_as_often_as_the_level_says():
    one = held()
    colour, spectrum = one.within
    labs = appearance.reflectance_to_lab(NM, DRAWS)
    off = appearance.ciede2000(labs, np.broadcast_to(one.lab().value, labs.shape))
    assert np.mean(off <= colour) == pytest.approx(0.9, abs=0.002)
    away = np.sqrt(np.mean((DRAWS - one.mean)**2, axis=1))
    assert np.mean(away <= spectrum) == pytest.approx(0.9, abs=0.002)
    assert spectrum == pytest.approx(0.03 * 1.645, rel=0.1)
    assert held(DRAWS[:1]).within is None
    closed, posterior = solved()
    spread = np.sqrt(np.mean((posterior.draws(2000, 1) - closed.mean)**2, axis=1))
    assert closed.within[1] == pytest.approx(np.quantile(spread, 0.95), rel=1e-6)


def test_a_difference_of_colours_errs_by_both():
    one, other = held(), held(DRAWS + 0.1, name="c")
    value, error = one.delta_e(other)
    means = [appearance.reflectance_to_lab(NM, each.mean) for each in (one, other)]
    assert value == pytest.approx(appearance.ciede2000(*means))
    # independent draws: by about the root of two what the difference to a known colour errs
    certain = one.delta_e(other.mean)
    assert certain.value == pytest.approx(float(value))
    mine = appearance.reflectance_to_lab(NM, DRAWS)
    assert certain.standard_error == pytest.approx(appearance.ciede2000(
        mine, np.broadcast_to(means[1], mine.shape)).std())
    assert 1.15 * certain.standard_error < error < 1.6 * certain.standard_error
    # the same draws twice would err alike
    assert one.delta_e(one).standard_error > 0 and one.delta_e(one).value == 0
    fewer = one.delta_e(held(DRAWS[:50] + 0.1))
    assert fewer.value == pytest.approx(float(value), rel=0.1) and fewer.standard_error > 0
    for wrong in (("D65",), (other, 5)):
        with pytest.raises(sb.InputError, match="give the other surface"):
            one.delta_e(*wrong)


# ---- what is said of it

def test_an_estimate_ends_as_its_draws_did_or_as_its_posterior():
    one = held(outcome=spectra.Outcome.UNREACHABLE)
    assert one.ending is spectra.Outcome.UNREACHABLE and not one.as_intended
    assert one.findings == (spectra.Outcome.UNREACHABLE.finding(),)
    assert one.method == "polytope" and one.families == () and one.certificate is None
    closed, posterior = solved()
    assert closed.ending is posterior.outcome is spectra.Outcome.FAMILIAR and closed.as_intended
    assert next(each.code for each in closed.findings) == "draws.familiar"
    said = replace(closed, ended=spectra.Outcome.UNFAMILIAR)
    assert said.ending is spectra.Outcome.UNFAMILIAR and not said.as_intended
    assert [each.code for each in said.findings][-1] == "families.none-alike"
    beyond = replace(closed, ended=spectra.Outcome.BEYOND_LEARNT)
    assert [each.code for each in beyond.findings][-1] == "families.smoothness"
    assert beyond.families == () and closed.families != ()


def test_shares_of_causes_sum_to_all_and_a_summary_s_own_come_first():
    one, posterior = solved()
    assert sum(one.causes.values()) == pytest.approx(1)
    assert one.causes == posterior.variance_shares(one.errors)
    own = replace(one, summary=replace(one.summary, variance_shares={"noise": 1.0}))
    assert own.causes == {"noise": 1.0}
    assert held().causes == {} and replace(one, from_more=True).causes == {}
    stated = replace(one, summary=replace(one.summary, family_shares={"paint": 1.0}))
    assert [each.name for each in stated.families] == ["paint"]


def test_the_budget_is_relative_to_the_signal_and_counts_gloss():
    one, _ = solved(signal=(0.4, 0.2, 0.1))
    np.testing.assert_allclose(one.error_budget[error_model.PHOTO_NOISE],
                               1e-5**0.5 / np.array([0.4, 0.2, 0.1]))
    shining = replace(one, measurement=replace(
        one.measurement, states=gloss.gloss_states("satin", ["lamp"] * 3)))
    added = shining.error_budget[error_model.SURFACE_REFLECTION]
    np.testing.assert_allclose(added * [0.4, 0.2, 0.1], added[0] * 0.4)
    assert added[0] > 0 and held().error_budget == {}


def test_what_was_not_stated_is_said_first():
    told = sb.sample([0.45, 0.3, 0.25], camera="Nikon 5100 (NPL)", light="D65")
    assert told.of_signal and told.findings[0] is told.of_signal[0]
    assert len(told.caveats) == len(told.of_signal)
    assert told.facts()["caveat"] == "\n".join(told.caveats)
    assert all(caveat in told.text() and caveat in repr(told) for caveat in told.caveats)


def test_advice_that_fails_is_no_advice_and_says_why():
    def fails():
        raise ValueError("no lamp")

    one = held(advise=fails)
    assert one.advice == () and "no lamp" in str(one.failed_extras[0].values["error"])
    fine = held(advise=lambda: ("a gel",))
    assert fine.advice == ("a gel",) and fine.failed_extras == ()


def test_scores_compare_with_the_truth_where_both_are_known():
    truth = spectra.Spectrum(FINE_GRID, np.interp(FINE_GRID.nm, NM, MEAN) + 0.01,
                             spectra.Quantity.REFLECTANCE, "measured")
    one = held(truth=truth)
    assert one.scores.rmse_mean == pytest.approx(0.01, abs=0.003)
    assert one.scores.rmse_inverse_rendering is None and held().scores is None
    rendered = replace(one, inverse_rendering=MEAN + 0.05)
    assert rendered.scores.rmse_inverse_rendering == pytest.approx(0.04, abs=0.003)


def test_scores_are_shares_of_wavelengths():
    one = held()
    truth = np.where(NM < 480, 0.9, MEAN)               # 16 of 61 are beyond all
    found = score(truth, None, one.summary, one.samples)
    assert found.coverage == found.coverage_95 == pytest.approx(45 / 61)
    high = np.where(NM < 480, one.summary.upper + 0.1, MEAN)
    assert score(high, None, one.summary, one.samples).coverage_bounds == 1
    edge = score(one.summary.upper, None, one.summary, one.samples)
    assert edge.coverage == 1 and edge.band_width == pytest.approx(one.band_width)
    assert found.delta_e00_mean == pytest.approx(appearance.delta_e00(NM, one.mean, truth))


# ---- other programs

def test_mitsuba_gets_the_spectrum_with_its_ends_carried_on():
    spectrum = given(np.linspace(-0.1, 1.1, 61)).to_mitsuba()
    nm, values = (np.array([float(each) for each in spectrum[key].split(",")])
                  for key in ("wavelengths", "values"))
    assert spectrum["type"] == "irregular" and (nm[0], nm[-1]) == (360, 830)
    np.testing.assert_array_equal(nm[1:-1], NM)
    assert values[0] == values[1] == 0 and values[-1] == values[-2] == 1


def test_tables_hold_the_curves_of_every_surface(tmp_path):
    one, two = held(), given()
    table = (estimates.to_csv({"a": one, "g": two}, tmp_path / "t.csv")).read_text()
    rows = [line.split(",") for line in table.splitlines() if line[:1].isdigit()]
    values = np.array(rows, float)
    assert values.shape == (61, 13)
    for column, curve in enumerate((NM, one.mean, one.standard_deviation, *one.band(),
                                    *one.bounds(), MEAN, np.zeros(61), *4 * [MEAN])):
        np.testing.assert_allclose(values[:, column], curve, atol=1e-6)
    with pytest.raises(sb.InputError, match="no surface"):
        estimates.to_csv({}, tmp_path / "t.csv")
    columns = estimates.columns_of([one])
    assert list(columns) == ["a mean", "a standard_deviation", "a lower", "a upper"]
    arrays = estimates.draws_of([one, one])
    assert arrays["spectra"].shape == (2, 1200, 61) and arrays["coefficients"].shape == (2, 1200, 5)
    assert estimates.draws_of([replace(one, name="")])["spectra"].shape == (1200, 61)
    assert estimates.draws_of([one, solved()[0]]) == {}
    assert one.renamed("z").name == "z" and one.to_colour()[550] == pytest.approx(one.mean[30])


def test_facts_are_those_of_the_summary():
    one, _ = solved()
    facts = one.facts()
    for name in (*estimates.CURVES, *estimates.BOUNDS):
        assert facts[name] == getattr(one.summary, name).tolist()
    assert facts["samples"] == 0 and facts["effective_samples"] is None
    assert facts["error_budget"] == one.causes and facts["ended"] == "familiar"
    assert facts["next_measurement_nm"] == 470.0 and facts["certificate"] == one.certificate
    assert "computed in closed form" in one.text() and "470 nm" in one.text()
    drawn = held().facts()
    assert drawn["samples"] == 1200 and "families" not in drawn and "error_budget" not in drawn
    assert "1200 draws, polytope" in held().text()
    shown = [line for line in held().text().splitlines() if line.strip()[:3].isdigit()]
    assert [int(line[:5]) for line in shown[:13]] == list(range(400, 701, 25))
    assert float(shown[6].split()[1]) == pytest.approx(held().mean[30], abs=5e-4)


def test_what_is_no_ordinary_ending_is_said_at_a_glance():
    assert held().outcome not in repr(held())
    one = held(outcome=spectra.Outcome.UNREACHABLE)
    assert one.outcome in repr(one) and "90 % band" in repr(one)
    wide = replace(one.summary, upper=one.summary.lower + np.linspace(0, 1, 61)**2)
    assert replace(one, summary=wide).band_width == pytest.approx(np.mean(np.linspace(0, 1, 61)**2))
    assert one.facts()["effective_samples"] == 1200


def test_a_plot_has_the_truth_that_is_asked_for_or_the_estimate_s_own():
    truth = spectra.Spectrum(FINE_GRID, np.full(301, 0.7), spectra.Quantity.REFLECTANCE, "measured")
    one = held(truth=truth)
    for axes, expected in ((one.plot(), 0.7), (one.plot(truth=np.full(61, 0.6)), 0.6)):
        assert any(np.allclose(line.get_ydata(), expected) for line in axes.lines)
    assert len(held().plot().lines) == len(one.plot().lines) - 1


def test_an_estimate_is_a_dataset_over_wavelength():
    pytest.importorskip("xarray")
    found = held().to_xarray(draws=3)
    assert found["mean"].dims == ("wavelength",) and found["draws"].shape == (3, 61)
    np.testing.assert_allclose(found["mean"], held().mean)
    np.testing.assert_allclose(found["lower"], held().band()[0])
    np.testing.assert_allclose(found["bound_upper"], held().summary.bound_upper)
