"""Regions of one photo and of several, relative to white: derivatives by differences, errors by
matrices, and what is concluded from a known region by the formula of a Gaussian's condition.
"""
from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.calibrate.chart_equations import PatchError
from spectrabox.measure.regions import flat_signals, white
from spectrabox.measure.regions.pointing import joined_samples
from spectrabox.radiometry import error_model
from spectrabox.radiometry.findings import Severity
from spectrabox.radiometry.records.photos import RegionSamples

BANDS = 4
NAMES = ("card", "leaf", "wall")
CAUSES = (error_model.REPEATABILITY, error_model.SAMPLE_PLANE)
Z = 2 * BANDS + len(NAMES) + len(CAUSES)
STEP = 1e-6


def samples_of(names=NAMES, seed=1, clipped=None):
    drawn = np.random.default_rng(seed)
    mean = drawn.uniform(0.1, 0.5, (len(names), BANDS))
    root = 0.002 * drawn.standard_normal((len(names), BANDS, BANDS))
    return RegionSamples(names, mean, root @ root.transpose(0, 2, 1), np.full(len(names), 100),
                         np.full((len(names), BANDS), 0.01),
                         drawn.uniform(0, 50, (len(names), 4, 2)), clipped)


def white_of(seed=2, size=0.02, **changed):
    """White at three regions, its unknowns correlated and away from 0."""
    drawn = np.random.default_rng(seed)
    root = size * drawn.standard_normal((Z, Z)) / np.sqrt(Z)
    return white.PhotoWhite(
        **{"samples": samples_of(), "level": drawn.uniform(0.4, 0.8, BANDS),
           "field": drawn.normal(0, 0.1, len(NAMES)), "exposure": 0.7,
           "glare": drawn.uniform(0.005, 0.02, BANDS), "causes": CAUSES,
           "mean": drawn.normal(0, 0.02, Z), "covariance": root @ root.T} | changed)


def derivative(function, mean):
    """Of a function of the unknowns, by central differences, one column each."""
    return np.stack([(function(mean + step) - function(mean - step)) / (2 * STEP)
                     for step in STEP * np.eye(Z)], axis=-1)


# ---- one photo

@pytest.mark.parametrize("region", range(len(NAMES)))
def test_errors_of_a_region_are_those_of_its_signal(region):
    one = white_of()
    by_hand = derivative(lambda mean: replace(one, mean=mean).signal[region], one.mean)
    np.testing.assert_allclose(one.jacobian(region), by_hand, atol=1e-7)
    whole = by_hand @ one.covariance @ by_hand.T
    np.testing.assert_allclose(sum(one.errors(region).values()), whole,
                               atol=1e-6 * np.abs(whole).max())
    assert set(one.errors(region)) == {error_model.WHITE, error_model.LIGHT_FIELD, *CAUSES}


def test_errors_about_another_signal_are_in_proportion_to_it():
    one = white_of(glare=np.zeros(BANDS), mean=np.zeros(Z))
    no_glare = one.covariance.copy()
    no_glare[one.glare_part] = no_glare[:, one.glare_part] = 0
    one = replace(one, covariance=no_glare)
    twice = one.errors(1, 2 * one.signal[1])
    for cause, covariance in one.errors(1).items():
        np.testing.assert_allclose(twice[cause], 4 * covariance, atol=1e-12)


@pytest.mark.parametrize("at, cause", [(2 * BANDS + 1, error_model.LIGHT_FIELD),
                                       (Z - 2, CAUSES[0]), (Z - 1, CAUSES[1])])
def test_an_error_that_bands_share_has_its_own_cause(at, cause):
    covariance = 1e-12 * np.eye(Z)
    covariance[at, at] = 0.03**2
    one = white_of(covariance=covariance)
    signal, errors = one.signal[1], one.errors(1)
    np.testing.assert_allclose(errors[cause], 0.03**2 * np.outer(signal, signal), rtol=1e-3)
    for other in set(errors) - {cause}:
        assert np.abs(errors[other]).max() < 1e-6


def test_the_light_on_other_regions_is_no_error_of_this_one():
    covariance = np.zeros((Z, Z))
    covariance[2 * BANDS, 2 * BANDS] = 0.1**2
    one = white_of(covariance=covariance + 1e-14 * np.eye(Z))
    assert np.abs(sum(one.errors(1).values())).max() < 1e-9 < np.abs(
        sum(one.errors(0).values())).max()


@pytest.mark.parametrize("region", range(len(NAMES)))
def test_white_and_glare_vary_together_as_their_derivatives_say(region):
    one = white_of()

    def both(mean):
        other = replace(one, mean=mean)
        return np.r_[np.log(other.white[region]), other.glare + mean[other.glare_part]]
    by_hand = derivative(both, one.mean)
    np.testing.assert_allclose(one.white_and_glare(region), by_hand @ one.covariance @ by_hand.T,
                               atol=1e-10)


def test_the_error_of_the_light_holds_that_of_the_plane_and_no_other():
    one = white_of()
    rows = derivative(lambda mean: replace(one, mean=mean).log_field + mean[-1], one.mean)
    np.testing.assert_allclose(one.field_error, np.sqrt(np.diag(rows @ one.covariance @ rows.T)),
                               rtol=1e-7)


def test_noise_is_relative_to_white_in_both_bands():
    one = white_of()
    by_hand = one.samples.covariance_of_mean[2] / one.white[2][:, None] / one.white[2]
    np.testing.assert_allclose(one.noise(2), by_hand)


def test_some_regions_are_what_they_were_among_all():
    one = white_of()
    some = one.of_regions(RegionSamples(*(
        value if isinstance(value, dict | None) else tuple(np.array(value)[[2, 0]])
        if isinstance(value, tuple) else value[[2, 0]] for value in (
            getattr(one.samples, name) for name in (
                "names", "mean", "covariance_of_mean", "pixels", "scatter", "points_px", "clipped",
                "edges")))))
    for place, row in enumerate((2, 0)):
        np.testing.assert_allclose(some.signal[place], one.signal[row])
        for cause, covariance in one.errors(row).items():
            np.testing.assert_allclose(some.errors(place)[cause], covariance, atol=1e-12)


# ---- known regions

OWN = (0.003 * np.eye(BANDS)) ** 2


def conditioned(one, name, target, bands):
    """Mean and covariance of the unknowns given a signal in some bands: the textbook's formula."""
    region = one.samples.names.index(name)
    rows = one.jacobian(region)[bands]
    spread = rows @ one.covariance @ rows.T + (one.noise(region) + OWN)[np.ix_(bands, bands)]
    gain = one.covariance @ rows.T @ np.linalg.inv(spread)
    return (one.mean + gain @ (target - one.signal[region])[bands],
            one.covariance - gain @ spread @ gain.T)


@pytest.mark.parametrize("clipped", [None, 0, 2])
def test_a_card_tells_of_the_light_in_the_bands_that_it_is_read_in(clipped):
    lost = None if clipped is None else np.zeros((len(NAMES), BANDS), bool)
    if clipped is not None:
        lost[0, clipped] = True
    one = white_of(samples=samples_of(clipped=lost))
    target = one.signal[0] * 1.01
    read = [band for band in range(BANDS) if band != clipped]
    if clipped is not None:
        target[clipped] *= 3        # nobody can tell
    found = white.condition_on_known(one, {"card": target}, {"card": OWN})
    mean, covariance = conditioned(one, "card", target, read)
    np.testing.assert_allclose(found.mean, mean, atol=1e-12)
    np.testing.assert_allclose(found.covariance, covariance, atol=1e-12)
    assert set(found.level_misfits) == {"card"} and found.left_out == ()


def test_a_card_that_is_clipped_in_every_band_tells_nothing():
    lost = np.zeros((len(NAMES), BANDS), bool)
    lost[0] = True
    one = white_of(samples=samples_of(clipped=lost))
    found = white.condition_on_known(one, {"card": 3 * one.signal[0]}, {"card": OWN})
    np.testing.assert_array_equal(found.mean, one.mean)
    assert found.level_misfits == {} and found.left_out == ()


def test_two_cards_may_come_in_any_order():
    one = white_of()
    told = {name: one.signal[NAMES.index(name)] * factor
            for name, factor in (("card", 1.004), ("leaf", 0.997))}
    both = [white.condition_on_known(one, {name: told[name] for name in order},
                                     dict.fromkeys(told, OWN))
            for order in (("card", "leaf"), ("leaf", "card"))]
    # derivatives are taken anew after the first, which moved white by less than a hundredth
    np.testing.assert_allclose(both[0].white, both[1].white, rtol=1e-4)


@pytest.mark.parametrize("band, clipped", [*((band, None) for band in range(BANDS)), (1, 0),
                                           (3, 1)])
@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_card_of_another_colour_is_left_out_and_its_band_named(band, clipped, factor):
    lost = np.zeros((len(NAMES), BANDS), bool)
    lost[0, clipped] = clipped is not None
    noiseless = replace(samples_of(clipped=lost),
                        covariance_of_mean=np.zeros((len(NAMES), BANDS, BANDS)))
    one = white_of(covariance=1e-14 * np.eye(Z), samples=noiseless)
    target = one.signal[0].copy()
    target[band] /= factor
    found = white.condition_on_known(one, {"card": target},
                                     {"card": np.diag((0.005 * target) ** 2)}, "second")
    assert found.mean is one.mean and found.level_misfits == {}
    (said,) = found.left_out
    assert (said.code, said.subject, said.severity) == ("flat.known-other-colour", "card",
                                                        Severity.WARN)
    assert said.values["band"] == band + 1 and said.values["photo"] == "second"
    assert np.sign(said.values["off"]) == np.sign(factor - 1)
    read = ~lost[0]
    assert said.values["stated"] == pytest.approx(target[read].mean())
    assert said.values["read"] == pytest.approx(one.signal[0][read].mean())


@pytest.mark.parametrize("errors, kept", [(-8, False), (-3, True), (3, True), (8, False)])
def test_a_card_of_another_level_is_left_out_beyond_five_standard_errors(errors, kept):
    noiseless = replace(samples_of(), covariance_of_mean=np.zeros((len(NAMES), BANDS, BANDS)))
    one = white_of(covariance=1e-14 * np.eye(Z), samples=noiseless)
    spread = 0.01       # of the level, alone
    target = one.signal[0] / (np.exp(errors * spread) if errors > 0 else 1 + errors * spread)
    own = spread**2 * np.outer(target, target) + 1e-12 * np.eye(BANDS)
    found = white.condition_on_known(one, {"card": target}, {"card": own})
    if kept:
        assert found.level_misfits["card"] == pytest.approx(errors, rel=0.01)
    else:
        assert [said.code for said in found.left_out] == ["flat.known-other-level"]
        assert found.left_out[0].values["errors"] == pytest.approx(abs(errors), rel=0.01)


# ---- several photos

ERRORS = white.FlatErrors(repeatability=0.01, glare=0.002, disagreement=PatchError(0.01, 0.02),
                          chart_gloss=0.001)


def photo(name, mean=0.3, response=1.0, lamp=None, moved=False):
    """As much of a photo of flat samples as its errors rest on."""
    return SimpleNamespace(name=name, image=SimpleNamespace(signal=np.full((4, 6, BANDS), mean)),
                           lamp=lamp, moved=moved, response=response * np.ones((BANDS, 5)))


def test_noise_of_several_photos_is_averaged_and_what_they_share_is_not():
    whites = [white_of(seed) for seed in (2, 3, 4)]
    shown = [(photo(str(number)), each) for number, each in enumerate(whites)]
    found = flat_signals.errors_of_region("leaf", shown, ERRORS)
    np.testing.assert_allclose(found[error_model.PHOTO_NOISE],
                               sum(each.noise(1) for each in whites) / 9)
    for cause in (error_model.WHITE, error_model.LIGHT_FIELD, *CAUSES):
        np.testing.assert_allclose(found[cause],
                                   np.mean([each.errors(1)[cause] for each in whites], axis=0))
    of_model = [0.01**2 * np.diag(each.signal[1]**2)
                + 0.02**2 * np.outer(each.signal[1], each.signal[1]) for each in whites]
    np.testing.assert_allclose(found[error_model.DISAGREEMENT], np.mean(of_model, axis=0))


def test_stray_light_is_a_veil_what_of_haze_is_uneven_and_what_patches_mirror():
    one = white_of(mean=np.zeros(Z))
    at = one.white[1]
    hazy = replace(one, glare=np.array([0.01, 0.05, 0.1, 0.03]) * at)     # of white: one is no haze
    rows = [0.002 * 0.3 * np.ones(BANDS), 0.3 * np.array([0, 0.02, 0.07, 0]) * at, 0.001 * at]
    np.testing.assert_allclose(flat_signals.stray_light(photo("p"), hazy, 1, ERRORS),
                               sum(np.outer(row, row) for row in rows), rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_a_band_is_dark_beside_the_brightest_of_its_photo(scale):
    np.testing.assert_array_equal(flat_signals.dark_bands(scale * np.array([0.009, 1.0, 0.011])),
                                  [True, False, False])


@pytest.mark.parametrize("cause, one_lamp, two_lamps", [
    (error_model.SAMPLE_PLANE, 1.0, 0.0), (error_model.SURFACE_REFLECTION, 1.0, 0.5),
    (error_model.LIGHT_FIELD, 0.95, 0.6), (error_model.WHITE, 0.0, 0.0),
    (error_model.DISAGREEMENT, None, 0.0)])
def test_photos_share_of_an_error_what_its_cause_says(cause, one_lamp, two_lamps):
    signal = np.array([0.2, 0.3, 0.4, 0.5, 0.6, 0.0])
    lamps = np.array(["a", "a", "a", "a", "b", ""], dtype=object)
    spread = np.array([0.01, 0.02, 0.03, 0.04, 0.05, 0.0])
    covariance = np.zeros((6, 6))
    for own in (slice(0, 2), slice(2, 4), slice(4, 5)):       # of each photo
        covariance[own, own] = np.outer(spread[own], spread[own]) if one_lamp is not None else (
            PatchError(0.01, 0.02).among_bands(len(signal[own]))
            * np.outer(signal[own], signal[own]))
    found = flat_signals.common_to_photos(cause, covariance, signal, lamps, PatchError(0.01, 0.02))
    expected = np.zeros((6, 6))
    for first, others, share in (((0, 1), (2, 3), one_lamp), ((0, 1, 2, 3), (4,), two_lamps)):
        for row in first:
            for column in others:
                value = 0.02**2 * signal[row] * signal[column] if share is None \
                    else share * spread[row] * spread[column]
                expected[row, column] = expected[column, row] = value
    np.testing.assert_allclose(found, expected, atol=1e-15)
    assert np.linalg.eigvalsh(covariance + found).min() > -1e-12


def test_photos_are_alike_by_response_and_by_lamp_where_it_moved():
    first, same, other = photo("a", lamp="x"), photo("b", lamp="y"), photo("c", response=2.0)
    moved = photo("d", lamp="z", moved=True)
    again = photo("e", lamp="z", moved=True)
    assert flat_signals.first_alike([first, same, other]) == [0, 0, 2]
    assert flat_signals.first_alike([first, moved, same, again]) == [0, 1, 0, 1]
    # a last digit of the response is none of another filter
    close = photo("f", response=1 + 1e-12)
    assert flat_signals.first_alike([first, close]) == [0, 0]


@pytest.mark.parametrize("own, known", [(True, False), (False, True), (True, True), (False, False)])
def test_known_regions_stand_after_a_region_with_what_is_clipped_of_each(own, known):
    def lost(names):
        return np.arange(len(names) * BANDS).reshape(-1, BANDS) % 2 == 0
    one, others = samples_of(("new",), 5, lost(("new",)) if own else None), samples_of(
        NAMES[:2], 6, lost(NAMES[:2]) if known else None)
    both = joined_samples(one, others)
    assert both.names == ("new", "card", "leaf")
    np.testing.assert_array_equal(both.mean, np.vstack([one.mean, others.mean]))
    np.testing.assert_array_equal(both.points_px[1:], others.points_px)
    assert (both.clipped is None) == (not own and not known)
    if both.clipped is not None:
        np.testing.assert_array_equal(both.clipped[:1], lost(("new",)) if own
                                      else np.zeros((1, BANDS), bool))
        np.testing.assert_array_equal(both.clipped[1:], lost(NAMES[:2]) if known
                                      else np.zeros((2, BANDS), bool))
    assert joined_samples(one, None) is one and joined_samples(None, others) is None
