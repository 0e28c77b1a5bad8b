"""Every calibration predicts each patch from the others and says whether the light can be right."""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from calibrate_cameras import GRID

from spectrabox.calibrate import chart_findings
from spectrabox.calibrate.chart_calibration import (
    calibrate_chart,
    evidence_on_lights,
)
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.prior.camera_prior import shipped_prior
from spectrabox.measure import rules
from spectrabox.measure.held_out_spectra import held_out_patches
from spectrabox.measure.results.calibration_facts import held_out_facts, light_facts
from spectrabox.radiometry.chart import CLASSIC, chart_reflectances
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Severity, faults
from spectrabox.radiometry.records.calibration import HeldOutPatches
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight
from spectrabox.radiometry.spectra.named_spectra import light, sensitivities
from spectrabox.sampling.prior.mixture import PRIOR_GRID

SURFACES = chart_reflectances("BabelColor Average", GRID)
CURVES = sensitivities("Nikon 5100 (NPL)", GRID)     # a camera that the shipped prior leaves out


def chart_photo(name, stated, seed=3, excluded=None, raise_patch=1.0):
    """A chart under a CIE light with 1 % of noise, said to be under another."""
    signal = SURFACES @ (CURVES * light(name, GRID) * GRID.weights_nm).T
    signal *= 0.9 / signal.max() * (1 + 0.01 * np.random.default_rng(seed).standard_normal((24, 3)))
    signal[4] *= raise_patch
    samples = PatchSamples(signal, np.zeros((24, 3, 3)), np.ones(24), 0 * signal, 0 * signal)
    return ChartPhoto(samples, SURFACES, stated, excluded=excluded)


def spectrum(name):
    return Spectrum(GRID, light(name, GRID), Quantity.RELATIVE, f"CIE {name}")


@pytest.mark.parametrize("method", ["prior", "unknown", "smooth", "nonnegative", "file"])
def test_every_calibration_predicts_each_patch_from_the_others(method):
    photo = chart_photo("LED-B3", UnknownLight() if method == "unknown" else spectrum("LED-B3"))
    made = calibrate_chart([photo], GRID, **options_of(method))
    patches = held_out_patches(made, SURFACES)
    assert patches.mean.shape == (24, 61) and not patches.excluded.any()
    # Three signals leave an rms of 0.02 to 0.04 to a learnt prior even with the true curves.
    assert patches.rmse.mean() < 0.045
    # 24 curves of about 3 independent readings each: 95 % less 3 standard errors of 2.6 %.
    assert patches.inside.mean() > 0.87
    # 95 % bands of any surface, of familiar ones
    assert method != "unknown" or patches.expected.mean() > 0.98
    facts = held_out_facts(patches, CLASSIC.names)
    assert facts["rmse_mean"] == pytest.approx(patches.rmse.mean())
    assert facts["patches"][4]["name"] == "blue flower"


@pytest.mark.usefixtures("light_as_stated")
@pytest.mark.parametrize("stated", [UnknownLight(kind="led"), spectrum("LED-B3")])
def test_a_patch_kept_out_changes_nothing_but_itself(stated):
    excluded = np.arange(24) == 4
    fits = [calibrate_chart([chart_photo("LED-B3", stated, excluded=excluded,
                                         raise_patch=factor)], GRID) for factor in (1.0, 1.5)]
    first, second = (fit.calibration.sensitivity.curves for fit in fits)
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(fits[0].predicted, fits[1].predicted)
    before, after = (held_out_patches(fit, SURFACES) for fit in fits)
    assert before.excluded[4] and after.excluded.sum() == 1
    assert np.abs(after.mean[4] - before.mean[4]).max() > 0.05    # its own signal is 50 % more
    others = ~excluded
    np.testing.assert_allclose(after.mean[others], before.mean[others], atol=1e-9)


def options_of(method):
    return {"method": "prior" if method == "unknown" else method,
            "curves": CURVES if method == "file" else None}


def clipped_photo(seed, reading, method, left_out=False):
    """The three lightest patches clipped in green: white reads the most, the others some share."""
    bright = [18, 19, 15]
    photo = chart_photo("D65", UnknownLight() if method == "unknown" else spectrum("D65"), seed,
                        np.isin(np.arange(24), bright) if left_out else None)
    mean, fraction = photo.samples.mean.copy(), np.zeros((24, 3))
    mean[bright, 1] = 0.8 * np.r_[1, reading, reading]
    fraction[bright, 1] = 0.0 if left_out else 1.0
    return dataclasses.replace(photo, samples=dataclasses.replace(
        photo.samples, mean=mean, saturated_fraction=fraction))


@pytest.mark.usefixtures("light_as_stated")
@pytest.mark.parametrize("method", ["prior", "unknown", "smooth", "nonnegative", "paper", "file"])
def test_a_clipped_band_of_a_patch_says_nothing(method):
    fits = [calibrate_chart([clipped_photo(3, reading, method)], GRID, **options_of(method))
            for reading in (1.0, 0.5)]
    first, second = fits
    # a clipped signal has 1e-8 of the weight of others, and is off by 50 of their standard errors
    np.testing.assert_allclose(second.calibration.sensitivity.curves,
                               first.calibration.sensitivity.curves, atol=1e-4)
    np.testing.assert_allclose(second.predicted, first.predicted, atol=1e-4)
    lost = [one.values for one in first.calibration.findings
            if one.code == "calibration.patch-clipped"]
    assert [each["bands"] for each in lost] == [["G"]] * 3 and lost[1]["patch"] == "white 9.5"
    known = first.without.known_within(SURFACES)[[18, 19, 15]]
    assert np.all(known[:, 0] < 0.05) and np.all(known[:, 1] < known[:, 0])
    patches = held_out_patches(first, SURFACES)
    assert patches.judged.all() and patches.inside[[18, 19, 15]].mean() > 0.6


@pytest.mark.usefixtures("light_as_stated")
def test_patches_with_a_clipped_band_tell_more_than_none():
    truth = SURFACES @ (CURVES * light("D65", GRID) * GRID.weights_nm).T
    truth *= 0.9 / truth.max()
    off = {}
    for left_out in (False, True):
        fits = [calibrate_chart([clipped_photo(seed, 1.0, "prior", left_out)], GRID)
                for seed in range(6)]
        off[left_out] = np.array([fit.predicted - truth for fit in fits]) / truth.max(axis=0)
    rms = {key: np.sqrt(np.mean(error**2)) for key, error in off.items()}
    bright = {key: np.sqrt(np.mean(error[:, [18, 19, 15]]**2)) for key, error in off.items()}
    # of 40 photos .93 to 1.00 of the error of all patches, and .75 to .92 of that of these
    assert rms[False] < 1.02 * rms[True] and bright[False] < bright[True]


@pytest.mark.parametrize("name, kind", [("D65", "daylight"), ("LED-RGB1", "led")])
def test_an_unknown_light_leaves_products_and_a_posterior_of_its_own(name, kind):
    made = calibrate_chart([chart_photo(name, UnknownLight())], GRID).calibration
    np.testing.assert_array_equal(made.light.values, 1)
    found = light_facts(made)
    assert found["kind"] == kind and sum(found["kinds"].values()) == pytest.approx(1)
    true = light(name, GRID) / light(name, GRID).mean()
    known = made.light_posterior
    # A 90 % band of a curve with about 8 independent readings: at least 6 of 8.
    assert np.mean((known.lower <= true) & (true <= known.upper)) > 0.75
    assert known.mean.mean() == pytest.approx(1)


@pytest.mark.parametrize("true, stated, contradicts", [
    ("LED-B3", "LED-B3", False), ("D65", "D65", False), ("A", "A", False), ("FL11", "FL11", False),
    ("LED-B3", "A", True), ("A", "D65", True), ("D65", "FL11", True), ("FL11", "LED-B3", True)])
def test_a_light_that_contradicts_the_chart_is_named(true, stated, contradicts):
    photo = chart_photo(true, spectrum(stated))
    evidence, = evidence_on_lights([photo], [photo.equations(GRID)], shipped_prior(), GRID)
    assert (evidence.code == "light.contradicted") == contradicts


def test_the_doubt_is_in_the_calibration_and_the_run_goes_on_with_an_unknown_light():
    wrong = calibrate_chart([chart_photo("LED-B3", spectrum("A"))], GRID).calibration
    doubt = next(one for one in faults(wrong.findings) if one.code == "light.contradicted")
    assert doubt.values["stated"] == "CIE A"
    free = calibrate_chart([chart_photo("LED-B3", UnknownLight())], GRID).calibration
    assert not faults(free.findings)
    of_wrong, of_free = ({(one.code, one.subject) for one in faults(rules.of_fits(SimpleNamespace(
        calibration=made, other_calibrations=others, calibration_findings=())))}
        for made, others in ((wrong, {}), (free, {"dusk": wrong})))
    assert ("light.contradicted", "") in of_wrong
    assert ("light.contradicted", "") not in of_free and ("light.contradicted", "dusk") in of_free


def test_an_unknown_light_needs_the_method_that_can_find_it():
    with pytest.raises(InputError, match="method paper needs the spectrum of the light"):
        calibrate_chart([chart_photo("A", UnknownLight())], GRID, "paper")
    with pytest.raises(InputError, match="must all be under that light"):
        calibrate_chart([chart_photo("A", UnknownLight()), chart_photo("D65", spectrum("D65"), 4)],
                        GRID)


def test_cameras_of_five_bands_have_no_lamp_told_and_say_so():
    peaks = np.array([430.0, 490, 545, 600, 660])[:, None]
    curves = np.exp(-0.5 * ((GRID.nm - peaks) / 25) ** 2)
    signal = SURFACES @ (curves * light("D65", GRID) * GRID.weights_nm).T
    signal *= 0.9 / signal.max()
    samples = PatchSamples(signal, np.zeros((24, 5, 5)), np.ones(24), 0 * signal, 0 * signal)
    made = calibrate_chart([ChartPhoto(samples, SURFACES, UnknownLight())], GRID).calibration
    assert made.light_posterior is None
    assert {"bands": 5} in [one.values for one in made.findings
                            if one.code == "light.lines-smoothed"]


def left_out(inside, expected):
    """A chart whose bands hold a share of the reference, with what is expected of it."""
    reference = np.full((24, 61), 0.5)
    upper = np.where(np.arange(61) < inside * 61, 0.6, 0.45) * np.ones((24, 1))
    return HeldOutPatches(PRIOR_GRID, reference, reference - 0.2, upper, reference,
                          np.zeros(24, bool), np.full(24, expected), 0.95)


@pytest.mark.parametrize("inside, severity", [(1.0, Severity.INFO), (0.9, Severity.WARN)])
def test_a_chart_that_holds_less_than_its_familiar_colours_should_is_a_warning(inside, severity):
    patches = left_out(inside, 0.99)
    found, = chart_findings.held_out(patches, CLASSIC.names)
    assert found.severity is severity
    assert found.values["value"] == pytest.approx(inside, abs=0.02)
    assert found.values["expected"] == pytest.approx(0.99)
    assert held_out_facts(patches, CLASSIC.names)["expected_95"] == pytest.approx(0.99)


@pytest.mark.parametrize("tilt, code, severity", [
    (0.02, "patches.colours", Severity.INFO), (0.10, "patches.colours-off", Severity.WARN)])
def test_patches_whose_colours_are_off_on_the_mean_are_a_warning(tilt, code, severity):
    patches = left_out(1.0, 0.99)
    # redder or bluer from patch to patch; saturated ones do not count
    sides = np.resize([-1.0, 1.0], 24)[:, None] * np.linspace(-1, 1, 61)
    patches = dataclasses.replace(patches, mean=patches.reference * (1 + tilt * sides))
    found = chart_findings.colours(patches)
    assert (found.code, found.severity) == (code, severity)
    assert found.values["value"] == pytest.approx(
        np.mean(chart_findings.patch_differences(patches)))
    judged = np.arange(24) > 0
    odd = dataclasses.replace(patches, mean=np.where(judged[:, None], patches.mean, 0.9),
                              saturated=~judged)
    assert chart_findings.colours(odd).code == code


@pytest.mark.parametrize("brighter, colour, code", [
    ({}, {}, None),
    ({18: -0.05}, {}, None),                        # an error and a half: chance
    ({18: 0.3}, {}, "patches.glare"),
    ({18: -0.3}, {}, "patches.unlike-reference"),
    ({18: 0.02}, {14: 1e-6}, "patches.unusual"),     # 2 % within chance, and a colour alone
    ({}, {14: 1e-6}, "patches.unusual"),
    ({}, {14: 3e-4}, None),             # colours of faultless copies are off by as much
    ({18: 0.3}, {14: 1e-6}, "patches.unlike-reference")])
def test_a_chart_at_fault_is_told_from_glare_on_it(brighter, colour, code):
    level, chance = np.zeros(24), np.ones(24)
    level[list(brighter)], chance[list(colour)] = list(brighter.values()), list(colour.values())
    patches = dataclasses.replace(left_out(1.0, 0.99), brighter=level,
                                  brighter_error=np.full(24, 0.03), colour_chance=chance)
    found = chart_findings.at_fault(patches, CLASSIC.names)
    assert [one.code for one in found] == ([code] if code else [])
    # a colour alone is no evidence
    assert [one.severity for one in found] == ([] if code is None else [
        Severity.NOTE if code == "patches.unusual" else Severity.WARN])
    named = sorted([patch for patch in brighter if abs(brighter[patch]) > 0.1] + [*colour]) \
        if code else []
    for one in found:
        assert [row["patch"] for row in one.values["patches"]] == [
            CLASSIC.names[patch] for patch in named]
    # a stated light is named beside the chart, where colours are off and not levels alone
    under = chart_findings.at_fault(patches, CLASSIC.names, "CIE FL2")
    assert ([one.code for one in under] == ["patches.unlike-reference-or-light"]) \
        == (bool(colour) and code not in (None, "patches.unusual"))
    kept_out = dataclasses.replace(patches, excluded=np.isin(np.arange(24), named))
    assert not chart_findings.at_fault(kept_out, CLASSIC.names)
