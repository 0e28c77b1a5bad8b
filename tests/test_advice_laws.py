"""What to do next, part by part: lists and their means, and the signals that an action would give.
"""
from __future__ import annotations

import json
from dataclasses import dataclass, make_dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.measure.advice import advice as kinds
from spectrabox.measure.advice import advise, flat_actions, forecast, further
from spectrabox.measure.advice.forecast import Unknown
from spectrabox.radiometry import appearance, error_model, gloss, grid
from spectrabox.radiometry.records import spectra
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.prior.signal_posterior import solve_posterior

NM = grid.FINE_GRID.nm
WIDE, NARROW = np.array([0.2, 3.0]), np.array([0.1, 1.0])
BANDS = np.array([np.exp(-(((NM - peak) / 35) ** 2)) for peak in (610, 540, 460)])
BANDS /= BANDS.sum(axis=1, keepdims=True)
TO_FINE = grid.interpolation_matrix(PRIOR_GRID.nm, NM)
SPECTRUM = 0.3 + 0.2 * np.sin((PRIOR_GRID.nm - 400) / 60)


def unknown(signal=None, noise=0.004, states=(), variables=(), **fields):
    """A surface of a known spectrum, seen in three bands with noise alone."""
    signal = BANDS @ TO_FINE @ SPECTRUM if signal is None else np.asarray(signal, float)
    signals = spectra.SurfaceSignals(
        ("a",), (False,), grid.FINE_GRID, (TO_FINE @ SPECTRUM)[None], ("R", "G", "B"),
        np.zeros(3, int), BANDS, signal[None],
        {error_model.PHOTO_NOISE: noise**2 * np.eye(3)[None]}, states)
    return Unknown(load_prior(), 0.95, signals, SPECTRUM, np.array(variables, float), np.ones(2),
                   np.ones(2), 550.0, **fields)


def photo(peak=580.0, *, same_lamp=True, white=(1.0, 0.5, 0.25), dark=(), stops=0.0, name="a gel"):
    response = BANDS * np.exp(-(((NM - peak) / 60) ** 2))
    return SimpleNamespace(response=response / response.sum(axis=1, keepdims=True),
                           white=np.array(white), same_lamp=same_lamp, dark=np.array(dark, int),
                           stops=stops, name=name)


# ---- lists

def test_an_action_takes_its_photos_and_keeps_what_it_was_made_of():
    one = kinds.advice("two-gels", WIDE, NARROW, "a gel", [0.5, 1.0], [4])
    assert (one.width_before, one.width_after) == (0.2, 0.1)
    assert (one.colour_before, one.colour_after) == (3.0, 1.0)
    assert (one.times, one.stops, one.dark) == (2, (0.5, 1.0), (4,))
    assert kinds.advice("gel", WIDE, NARROW).times == 1
    assert one.finding.values == {"times": 2, "stops": [0.5, 1.0], "dark": [4]}
    assert one.facts | {"width_after": 0.1, "says": one.says, "cost": "two photos",
                        "how_to": "docs/how-to/next.md#two-gels"} == one.facts
    for figure in ("0.200", "0.100", "3.0", "1.0", one.short, one.cost):
        assert figure in one.text


def test_what_narrows_most_by_photo_comes_first():
    pair = kinds.advice("two-gels", WIDE, np.array([0.1, 1.0]))         # 0.71 by each
    gel = kinds.advice("gel", WIDE, np.array([0.13, 1.0]))              # 0.65
    lamp = kinds.advice("second-lamp", WIDE, np.array([0.15, 1.0]))     # 0.75
    assert kinds.ranked([pair, lamp, gel]) == (gel, pair, lamp)


@pytest.mark.parametrize("left, listed", [(0.975, True), (0.985, False), (1.2, False)])
def test_what_brings_less_than_a_fiftieth_is_not_listed(left, listed):
    assert len(kinds.ranked([kinds.advice("gel", WIDE, left * WIDE)])) == listed


def test_an_action_with_other_words_is_another_and_readings_of_all_are_one():
    gels = [kinds.advice("gel", WIDE, WIDE / 2, name) for name in ("red", "blue")]
    readings = [kinds.advice("reading", WIDE, WIDE / 4, f"{nm} nm") for nm in (450, 600)]
    both = kinds.advised({"a": [*gels, readings[0]], "b": [*gels, readings[1]]},
                         {"a": WIDE, "b": WIDE})
    said = {(one.action, one.subject): one for one in both.overall}
    assert set(said) == {("gel", "red"), ("gel", "blue"), ("reading", "")}
    assert said["reading", ""].width_after == pytest.approx(0.05)
    assert said["reading", ""].times == 2 and said["gel", "red"].times == 1
    alone = kinds.advised({"a": [readings[0]]}, {"a": WIDE}).overall[0]
    assert alone.subject == "450 nm" and alone.times == 1


def test_a_surface_that_an_action_is_not_for_stays_as_it_is_in_the_mean():
    gel = kinds.advice("gel", WIDE, np.array([0.1, 1.0]))
    (one,) = kinds.advised({"a": [gel], "b": [], "c": []}, {
        "a": WIDE, "b": np.array([0.1, 2.0]), "c": np.array([0.09, 1.0])}).overall
    assert one.width_before == pytest.approx(0.13) and one.width_after == pytest.approx(0.29 / 3)
    assert one.colour_before == pytest.approx(2.0) and one.colour_after == pytest.approx(4 / 3)
    nothing = kinds.advised({}, {})
    assert nothing == kinds.Advised() and nothing.line == ""


def test_lists_are_the_same_read_again():
    gel = kinds.advice("gel", WIDE, NARROW, "a gel", [0.5], [4])
    both = kinds.advised({"a": [gel], "b": [gel]}, {"a": WIDE, "b": WIDE})
    assert kinds.advised_of_facts(json.loads(json.dumps(both.facts))) == both
    assert both.line == f"next: {both.overall[0].text} (means of 2)"
    assert kinds.advised({"a": [gel]}, {"a": WIDE}).line == f"next: {gel.text}"


def test_exposures_are_said_from_a_twentieth_of_a_stop_and_dark_bands_by_their_numbers():
    first, second = photo(stops=0.02, dark=(1,)), photo(stops=-0.04, dark=(0, 2))
    assert advise.exposure([first, second]) == ([], [2, 4, 6])
    second.stops = -0.06
    assert advise.exposure([first, second]) == ([0.02, -0.06], [2, 4, 6])


def test_an_action_is_said_as_a_ratio_to_what_was_found():
    surface = replace(unknown(), found=np.array([0.1, 2.0]), solved=np.array([0.2, 1.0]))
    one = surface.advice("gel", np.array([0.1, 0.5]), "a gel", [1.0], [2])
    assert (one.width_before, one.width_after) == (0.1, pytest.approx(0.05))
    assert (one.colour_before, one.colour_after) == (2.0, pytest.approx(1.0))
    assert (one.subject, one.stops, one.dark) == ("a gel", (1.0,), (2,))


# ---- how well a spectrum is known

def test_an_outlook_is_the_mean_width_and_the_colour_s_root_mean_square():
    rng = np.random.default_rng(3)
    drawn = SPECTRUM + 0.02 * rng.standard_normal((400, 1)) * np.ones(61)
    samples = SimpleNamespace(grid=PRIOR_GRID, spectra=drawn)
    width = np.linspace(0.1, 0.3, 61)**2
    found = forecast.outlook_of_answer(samples, SPECTRUM - width, SPECTRUM + width)
    assert found[forecast.WIDTH] == pytest.approx(2 * width.mean())
    labs = appearance.reflectance_to_lab(PRIOR_GRID.nm, drawn)
    middle = appearance.reflectance_to_lab(PRIOR_GRID.nm, drawn.mean(axis=0))
    assert found[forecast.COLOUR] == pytest.approx(
        np.sqrt(np.mean(appearance.ciede2000(middle, labs)**2)))


def test_an_outlook_of_a_signal_is_that_of_its_posterior():
    now = unknown()
    posterior = solve_posterior(now.prior, spectra.SpectralMeasurement(
        grid.FINE_GRID, BANDS, now.signals.signal[0], 0.004**2 * np.eye(3)))
    lower, upper = posterior.band(0.8)
    np.testing.assert_allclose(
        forecast.outlook_of_signals(now.prior, 0.8, now.signals)[forecast.WIDTH],
        np.mean(upper - lower), rtol=1e-6)
    slope = (appearance.reflectance_to_lab(PRIOR_GRID.nm, posterior.mean + 1e-4 * np.eye(61))
             - appearance.reflectance_to_lab(PRIOR_GRID.nm, posterior.mean)).T / 1e-4
    middle = appearance.reflectance_to_lab(PRIOR_GRID.nm, posterior.mean)
    drawn = np.random.default_rng(0).multivariate_normal(
        np.zeros(3), slope @ posterior.covariance @ slope.T / 100, 20_000)
    # a tenth of the deviation, where differences of colour are in proportion to it
    expected = 10 * np.sqrt(np.mean(appearance.ciede2000(middle, middle + drawn)**2))
    assert forecast.outlook_of(posterior, 0.8)[forecast.COLOUR] == pytest.approx(expected, rel=0.05)


# ---- signals that are to be expected

def test_what_is_left_of_a_signal_is_its_error():
    signal = BANDS @ TO_FINE @ SPECTRUM + [0.01, -0.02, 0.03]
    np.testing.assert_allclose(forecast.left_errors(unknown(signal)), [0.01, -0.02, 0.03],
                               atol=1e-12)
    states = (gloss.gloss_states("glossy", ["lamp"] * 3),)
    shining = unknown(signal + 0.05, states=states, variables=[0.05])
    np.testing.assert_allclose(forecast.left_errors(shining), [0.01, -0.02, 0.03], atol=1e-12)


def test_an_error_that_an_action_takes_off_is_not_expected_any_more():
    error = np.array([0.01, -0.02, 0.03])
    now = unknown(BANDS @ TO_FINE @ SPECTRUM + error)
    for share, left in ((1.0, 1.0), (0.25, 0.25), (0.0, 0.0)):
        after = replace(now.signals, errors={
            cause: share * each for cause, each in now.signals.errors.items()})
        np.testing.assert_allclose(forecast._expected_signal(now, after),
                                   BANDS @ TO_FINE @ SPECTRUM + left * error, atol=1e-12)


def test_what_a_surface_mirrors_is_expected_again():
    states = (gloss.gloss_states("glossy", ["lamp"] * 3),)
    now = unknown(BANDS @ TO_FINE @ SPECTRUM + 0.04, states=states, variables=[0.03])
    signal = forecast._expected_signal(now, further.with_reading(now, 600.0))
    np.testing.assert_allclose(signal[:3], now.signals.signal[0], atol=1e-12)
    assert signal[3] == pytest.approx(np.interp(600.0, PRIOR_GRID.nm, SPECTRUM), abs=0.003)


def test_bands_that_do_not_show_a_surface_do_not_show_it_afterwards_and_say_nothing():
    error = np.array([0.01, -0.02, 0.03])
    signal = BANDS @ TO_FINE @ SPECTRUM + error
    signal[1] = np.nan
    now = unknown(signal)
    found = forecast._expected_signal(now, further.with_reading(now, 500.0))
    assert np.isnan(found[1])
    np.testing.assert_allclose(found[[0, 2]], signal[[0, 2]], atol=1e-12)
    assert found[3] == pytest.approx(np.interp(500.0, PRIOR_GRID.nm, SPECTRUM), abs=0.003)


def test_errors_in_proportion_grow_with_the_signal_and_added_ones_do_not(monkeypatch):
    now, given = unknown(), {}
    monkeypatch.setattr(forecast, "outlook_of_signals",
                        lambda prior, level, signals: given.update(signals=signals))
    half = replace(now.signals, signal=now.signals.signal / 2, errors={
        error_model.PHOTO_NOISE: 1e-6 * np.eye(3)[None],
        error_model.WHITE: 1e-4 * np.ones((1, 3, 3))})
    forecast.outlook_after(now, half)
    kept = given["signals"]
    np.testing.assert_allclose(kept.signal[0], now.signals.signal[0], rtol=1e-9)
    np.testing.assert_allclose(kept.errors[error_model.PHOTO_NOISE], 1e-6 * np.eye(3)[None])
    np.testing.assert_allclose(kept.errors[error_model.WHITE], 4e-4 * np.ones((1, 3, 3)))
    dark = np.array([0.0, 0.2, 0.2])        # of no signal there is no proportion
    np.testing.assert_allclose(forecast._scaled(np.ones((3, 3)), dark, np.full(3, 0.4)),
                               np.outer([1, 2, 2], [1, 2, 2]))


def test_a_gloss_that_is_known_tells_of_another_as_much_as_they_have_in_common():
    two = gloss.gloss_states("glossy", ["lamp", "aside"])
    mean, value = two.means[0, 0], two.means[0, 0] + 0.02
    given = forecast._variables_given(two, ["gloss"], np.array([value]))
    assert given[0] == value
    assert given[1] == pytest.approx(mean + 0.5 * 0.02, rel=1e-3)
    # of several kinds the likelier ones after it count
    unstated = gloss.gloss_states(None, ["lamp", "aside"])
    dull, bright = (forecast._variables_given(unstated, ["gloss"], np.array([each]))[1]
                    for each in (0.001, 0.08))
    assert dull < 0.005 and bright > 0.03
    assert forecast._variables_given(two, ["gloss"], np.array([-0.5])).min() >= 0


def test_the_kinds_of_gloss_count_by_share_and_likelihood():
    unstated = gloss.gloss_states(None, ["lamp", "aside"])
    value = np.array([0.01])
    weights = unstated.weights * [
        np.exp(-(value[0] - mean[0])**2 / 2 / own[0, 0]) / np.sqrt(own[0, 0])
        for mean, own in zip(unstated.means, unstated.covariances, strict=True)]
    each = [mean[1] + own[1, 0] / own[0, 0] * (value[0] - mean[0])
            for mean, own in zip(unstated.means, unstated.covariances, strict=True)]
    assert forecast._variables_given(unstated, ["gloss"], value)[1] == pytest.approx(
        weights @ each / weights.sum(), rel=1e-4)


# ---- one measurement more

def test_a_reading_is_a_band_of_one_wavelength_that_errs_by_half_a_per_cent():
    states = (gloss.gloss_states("satin", ["lamp"] * 3),)
    now = unknown(states=states, variables=[0.01])
    after = further.with_reading(now, 650.0)
    assert after.bands == ("R", "G", "B", "further 1")
    assert after.view_of_band.tolist() == [0, 0, 0, 1]
    assert after.response[3] @ np.ones(NM.size) == pytest.approx(1)
    assert after.response[3] @ NM == pytest.approx(650, abs=0.5)
    covariance = after.errors[error_model.PHOTO_NOISE][0]
    np.testing.assert_allclose(covariance, np.diag([0.004**2] * 3 + [0.005**2]))
    # an instrument does not see what the surface mirrors
    np.testing.assert_array_equal(after.states[0].pattern, [[1], [1], [1], [0]])
    other = replace(now, signals=replace(now.signals, errors={
        error_model.WHITE: 1e-4 * np.ones((1, 3, 3))}))
    both = further.with_reading(other, 650.0).errors
    np.testing.assert_allclose(both[error_model.WHITE][0][3], 0)
    np.testing.assert_allclose(both[error_model.PHOTO_NOISE][0], np.diag([0, 0, 0, 0.005**2]))


def test_photos_may_be_added_where_one_photo_shows_the_surface_in_its_few_bands():
    assert further.may_add_photos(unknown([np.nan, 0.3, 0.3]), 3, None)
    fitted = object()
    assert further.may_add_photos(unknown(), 3, fitted)
    assert not further.may_add_photos(unknown(), 6, fitted)
    assert not further.may_add_photos(unknown([np.nan, 0.3, 0.3]), 3, fitted)


def test_photos_through_a_filter_see_what_the_surface_mirrors_as_the_first_does():
    states = (gloss.gloss_states("satin", ["lamp"] * 3),)
    now = unknown(states=states, variables=[0.01])
    seen = photo(dark=(2,), white=(1.0, 0.5, 0.0))
    after = further.with_photos(now, [seen], np.ones(3), None)
    assert after.signal.shape == (1, 5) and after.view_of_band.tolist() == [0, 0, 0, 1, 1]
    np.testing.assert_allclose(after.response[3:], seen.response[:2])
    np.testing.assert_array_equal(after.states[0].pattern, np.ones((5, 1)))
    noise = np.diag(after.errors[error_model.PHOTO_NOISE][0])
    np.testing.assert_allclose(noise[:3], 0.004**2)
    # white is half as bright in the second band: noise of the same light in half the signal
    level = now.signals.signal[0]
    each = np.mean(0.004**2 / level)
    expected = seen.response[:2] @ TO_FINE @ SPECTRUM
    np.testing.assert_allclose(noise[3:], each * expected / [1.0, 0.5], rtol=0.02)


def test_under_another_lamp_a_surface_mirrors_another_image():
    states = (gloss.gloss_states("satin", ["lamp"] * 3),)
    now = unknown(states=states, variables=[0.01], stated="satin")
    after = further.with_photos(now, [photo(same_lamp=False)], np.ones(3), None)
    np.testing.assert_array_equal(after.states[0].pattern, [[1, 0]] * 3 + [[0, 1]] * 3)
    plain = further.with_photos(unknown(), [photo(same_lamp=False)], np.ones(3), None)
    assert plain.states == ()
    level = replace(states[0], names=(f"{flat_actions.LEVEL} 1",))
    assert further.with_photos(unknown(states=(level,), variables=[0.0]), [photo(same_lamp=False)],
                               np.ones(3), None) is None
    nothing = replace(states[0], pattern=np.zeros((3, 1)))
    assert further.with_photos(unknown(states=(nothing,), variables=[0.0]),
                               [photo(same_lamp=False)], np.ones(3), None) is None


def test_a_level_of_the_light_is_in_proportion_in_further_bands_too():
    level = gloss.gloss_states("satin", ["lamp"] * 3)
    signal = BANDS @ TO_FINE @ SPECTRUM
    states = (replace(level, names=(f"{flat_actions.LEVEL} 1",), pattern=signal[:, None]),)
    seen = photo()
    after = further.with_photos(unknown(states=states, variables=[0.0]), [seen], np.ones(3), None)
    np.testing.assert_allclose(after.states[0].pattern[3:, 0],
                               seen.response @ TO_FINE @ SPECTRUM, rtol=1e-9)


# ---- places of flat samples

def flat_photo(middle, size=(400, 300)):
    """A photo of one square region of 20 pixels about a point, and a chart at the left."""
    corners = np.array([[-10, -10], [10, -10], [10, 10], [-10, 10]], float)
    patches = np.array([[[20, 100], [120, 100], [120, 160], [20, 160]]], float)
    return SimpleNamespace(
        samples=SimpleNamespace(points_px=(corners + middle)[None]), patches_px=patches,
        image=SimpleNamespace(signal=np.zeros((size[1] // 2, size[0] // 2, 3)), sensor_step=2))


@pytest.mark.parametrize("middle, towards", [
    ((300, 150), (-1, 0)), ((40, 150), (1, 0)), ((205, 20), (0, 1)), ((205, 280), (0, -1))])
def test_a_card_lies_beside_a_region_towards_the_middle_of_the_photo(middle, towards):
    photo = flat_photo(middle)
    assert flat_actions._length(photo) == 100
    moved = flat_actions._beside(photo) - photo.samples.points_px
    # its size and a fifth of the chart's length
    np.testing.assert_allclose(moved, np.broadcast_to(np.array(towards) * 40.0, moved.shape))


@pytest.mark.parametrize("middle, to", [((300, 150), (140, 150)), ((60, 280), (60, 180)),
                                        ((300, 20), (140, 80)), ((130, 120), (130, 120))])
def test_a_region_beside_the_chart_lies_a_tenth_of_its_length_from_the_patches(middle, to):
    photo = flat_photo(middle)
    moved = flat_actions._by_the_chart(photo) - photo.samples.points_px
    np.testing.assert_allclose(moved, np.broadcast_to(np.subtract(to, middle) * 1.0, moved.shape))


def test_a_light_between_two_places_of_a_lamp_is_a_variable_of_the_capture():
    signal = BANDS @ TO_FINE @ SPECTRUM
    states = (gloss.gloss_states("satin", ["lamp"] * 3),)
    plane = error_model.proportional_covariance(signal, np.full((3, 3), 0.03**2))
    now = unknown(signal * 1.02 + 0.01, states=states, variables=[0.01])
    now = replace(now, signals=replace(now.signals, errors={
        **now.signals.errors, error_model.SAMPLE_PLANE: plane[None]}))
    turned = flat_actions.with_level(now)
    assert error_model.SAMPLE_PLANE not in turned.signals.errors
    joined = turned.signals.states[0]
    assert joined.names[0] == "gloss" and joined.names[1].startswith(flat_actions.LEVEL)
    np.testing.assert_allclose(joined.pattern[:, 1], now.signals.signal[0])
    sd = np.sqrt(np.diag(plane) / now.signals.signal[0]**2).max()
    np.testing.assert_allclose(joined.covariances[:, 1, 1], sd**2)
    # the mean of the level, given what is left of the signal
    covariance = 0.004**2 * np.eye(3) + plane
    expected = sd**2 * now.signals.signal[0] @ np.linalg.solve(covariance,
                                                               forecast.left_errors(now))
    np.testing.assert_allclose(turned.variables, [0.01, expected])
    black = replace(now, signals=replace(now.signals, signal=np.zeros((1, 3))))
    assert flat_actions.with_level(black) is black
    dim = replace(now, signals=replace(now.signals, signal=np.array([[np.nan, 0.2, 0.2]])))
    np.testing.assert_array_equal(flat_actions.with_level(dim).signals.states[0].pattern[:, 1],
                                  [0, 0.2, 0.2])


def test_the_light_in_another_place_of_a_lamp_is_taken_to_be_as_usual():
    glosses = gloss.gloss_states("glossy", ["lamp"] * 3)
    level = spectra.CaptureStates(
        (flat_actions.LEVEL,), (error_model.SAMPLE_PLANE,), np.ones((3, 1)), np.full(1, -1.0),
        ("", "off"), np.array([0.9, 0.1]), np.array([[0.0], [-0.3]]),
        np.array([[[1e-3]], [[0.04]]]))
    both = spectra.independent_states(glosses, level)
    sample = SimpleNamespace(signals=lambda name, moved: unknown(
        states=(both,)).signals if moved and name == "a" else None)
    states = flat_actions.with_lamp_moved(sample, "a").states[0]
    usual = [index for index, kind in enumerate(both.kinds) if not kind.endswith("off")]
    assert states.kinds == tuple(both.kinds[index] for index in usual)
    np.testing.assert_allclose(states.weights, glosses.weights)
    np.testing.assert_array_equal(states.means, both.means[usual])
    np.testing.assert_array_equal(states.covariances, both.covariances[usual])


def test_a_photo_that_is_divided_by_one_of_a_white_card_has_an_even_light(monkeypatch):
    @dataclass(frozen=True)
    class White:
        samples: object = None
        white: np.ndarray = None
        glare: np.ndarray = None
        field: np.ndarray = None

    @dataclass(frozen=True)
    class Samples:
        mean: np.ndarray

    asked = {}

    def by_chart(photo, errors):
        asked.update(photo=photo, errors=errors)
        return White(Samples(np.zeros((1, 3))), np.full((1, 3), 0.8), np.full(3, 0.02))

    monkeypatch.setattr(flat_actions.white_reference, "white_by_chart", by_chart)
    photo = replace_fields(samples="other", lost="some", white=White(field=np.ones(2)))
    now = White(Samples(np.full((1, 3), 0.25)), np.full((1, 3), 0.4), np.full(3, 0.05))
    found = flat_actions._divided(photo, now, "errors")
    # it reflects a half: of white that reads 0.8 then, above the veil
    np.testing.assert_allclose(found.samples.mean, 0.5 * 0.8 + 0.02)
    assert asked["errors"] == "errors" and asked["photo"].lost is None
    assert asked["photo"].samples is now.samples
    np.testing.assert_array_equal(asked["photo"].white.field, [0, 0])


def replace_fields(**fields):
    """A record of these fields, that `dataclasses.replace` takes."""
    return make_dataclass("Photo", list(fields))(**fields)
