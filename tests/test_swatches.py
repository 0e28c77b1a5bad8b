"""Swatches of the material at hand: what is learnt on materials whose truth is known.

Surfaces are drawn with normal deviates; a prior is off by a linear function of the signals, or not
at all. Statistical tests have a significance of 1e-4 each, at fixed seeds.
"""
import dataclasses
import json
from fractions import Fraction

import numpy as np
import pytest
from flat_example import CHART, SIZE, light_over
from scipy import stats
from session_runs import call

import spectrabox as sb
from spectrabox.fixtures import lamp
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities
from spectrabox.fixtures.flat_sample import box, chart_corners, surface_signals, write_photo
from spectrabox.fixtures.paints import NM as PAINT_NM
from spectrabox.fixtures.paints import chart_copy
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import MIN_SWATCHES, Quantity
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.sampling.further.learnt_swatches import (
    Swatches,
    correct,
    corrected_draws,
    learn_correction,
)
from spectrabox.sampling.further.swatch_files import read_swatches
from spectrabox.sampling.prior.mixture import PRIOR_GRID

SIGMAS = stats.norm.isf(0.5e-4)
NM, BANDS, OWN = np.linspace(400, 700, 61), 6, 0.01
SHAPES = 0.05 * np.array([np.cos(np.pi * order * (NM - 400) / 300) for order in range(4)])
RESPONSE = np.array([np.exp(-0.5 * ((NM - centre) / 25)**2) for centre in range(420, 690, 50)])
RESPONSE /= RESPONSE.sum(axis=1, keepdims=True)


def material(rng, count, bias, own=OWN):
    """Swatches of one material; the prior's mean is off by ``bias`` times a smooth function of the
    signals, and by errors of each one's own.
    """
    truth = 0.45 + rng.standard_normal((count, 4)) @ SHAPES
    signals = truth @ RESPONSE.T + 0.001 * rng.standard_normal((count, BANDS))
    off = bias * (signals[:, :3] - 0.4) @ np.sin(np.outer([1, 2, 3], NM / 80))
    errors = own / 2**0.5 * rng.standard_normal((count, 4)) @ np.sin(np.outer([2, 3, 4, 5],
                                                                             NM / 60))
    return Swatches(signals, truth, truth - off + errors, np.full(truth.shape, own))


def rmse(one, other):
    return np.sqrt(np.mean((one - other)**2, axis=1)).mean()


def evidence(signals):
    """Log density under a prior of surfaces of any kind."""
    return stats.multivariate_normal(np.full(BANDS, 0.45), 0.2**2 * np.eye(BANDS)).logpdf(signals)


def corrected(swatches, samples):
    return correct(learn_correction(swatches), samples.signals, samples.mean, samples.deviation,
                   evidence(samples.signals))


@pytest.mark.parametrize("seed", range(3))
def test_what_a_prior_is_off_for_a_material_is_learnt_and_the_band_holds(seed):
    rng = np.random.default_rng(seed)
    swatches, samples = material(rng, 24, 0.3), material(rng, 60, 0.3)
    found = corrected(swatches, samples)
    truth = samples.reflectances
    # a linear function of six signals and 24 swatches: its errors add a quarter to what is random
    assert rmse(found.mean, truth) < min(1.3 * OWN, 0.6 * rmse(samples.mean, truth))
    inside = np.mean(np.abs(truth - found.mean) <= 1.96 * found.deviation)
    # 60 samples of four independent errors: 0.95 within 4 standard errors, wider at times
    assert inside > 0.95 - SIGMAS * np.sqrt(0.95 * 0.05 / 240)


@pytest.mark.parametrize("seed", range(3))
def test_swatches_of_a_prior_that_is_right_do_no_harm(seed):
    rng = np.random.default_rng(seed)
    swatches, samples = (dataclasses.replace(one, mean=one.reflectances + 0.2 * (
        one.mean - one.reflectances)) for one in (material(rng, 24, 0.0), material(rng, 60, 0.0)))
    found = corrected(swatches, samples)
    # the prior errs by 0.002 and so could not be told from the correction's own error
    assert rmse(found.mean, samples.reflectances) < rmse(samples.mean, samples.reflectances) + 2e-4


def test_where_the_correction_predicts_swatches_no_better_the_prior_stays_alone():
    rng = np.random.default_rng(1)
    swatches = material(rng, 12, 0.0)
    exact = dataclasses.replace(swatches, mean=swatches.reflectances)
    correction = learn_correction(exact)
    assert not correction.helps and "leave the spectra as they are" in correction.sentence
    found = correct(correction, swatches.signals, swatches.mean, swatches.deviation,
                    evidence(swatches.signals))
    np.testing.assert_array_equal(found.mean, swatches.mean)
    np.testing.assert_allclose(found.deviation, swatches.deviation, rtol=1e-12)     # round-off


def test_samples_unlike_the_swatches_keep_the_mean_of_the_prior_and_at_least_its_band():
    rng = np.random.default_rng(2)
    swatches, samples = material(rng, 24, 0.3), material(rng, 20, 0.3)
    across = np.linalg.svd(swatches.signals - swatches.signals.mean(axis=0))[2][-1]
    unlike = dataclasses.replace(samples, signals=samples.signals + 0.5 * across)
    found = corrected(swatches, unlike)
    assert found.probability.max() < 0.02   # 0.5 of white where the swatches stay within 0.001
    np.testing.assert_allclose(found.mean, samples.mean, atol=0.01)     # 2 % of the correction
    assert np.all(found.deviation > 0.98 * samples.deviation)           # the rest is the prior's


def test_swatches_and_samples_of_three_bands_whose_kinds_are_one_blend_at_even_odds():
    """A signal that surfaces of any kind show as often as the material is of it by one half."""
    rng = np.random.default_rng(8)
    whole = material(rng, 200, 0.3)
    swatches = dataclasses.replace(whole, signals=whole.signals[:, :3])
    correction = learn_correction(swatches)
    centre = swatches.signals.mean(axis=0)[None]
    density = stats.multivariate_normal(centre[0], np.cov(swatches.signals.T)).logpdf(centre)
    mean, deviation = np.full((1, 61), 0.5), np.full((1, 61), OWN)
    even, likely, unlikely = (correct(correction, centre, mean, deviation, density + more)
                              for more in (0.0, -9.0, 9.0))
    # covariances of 200 swatches in 3 bands: the density is known to a tenth or so
    assert even.probability == pytest.approx(0.5, abs=0.1)
    assert likely.probability > 0.99 and unlikely.probability < 0.01
    # what correction and prior differ by is in the band
    apart = np.abs(likely.mean - unlikely.mean)
    assert np.all(even.deviation > 0.4 * apart)
    assert np.all(unlikely.deviation >= 0.98 * deviation)


def test_the_order_of_swatches_does_not_matter():
    rng = np.random.default_rng(3)
    swatches, samples = material(rng, 16, 0.3), material(rng, 5, 0.3)
    order = rng.permutation(16)
    turned = Swatches(*(getattr(swatches, field.name)[order]
                        for field in dataclasses.fields(swatches)))
    for one, other in zip(*(dataclasses.astuple(corrected(each, samples))
                            for each in (swatches, turned)), strict=True):
        # inverses of matrices with a condition of 1e6 or less
        np.testing.assert_allclose(one, other, rtol=1e-7)


def test_draws_are_moved_to_the_corrected_mean_and_deviation():
    rng = np.random.default_rng(4)
    draws = 0.5 + 0.01 * rng.standard_normal((500, 61))
    moved = corrected_draws(draws, np.full(61, 0.4), np.full(61, 0.03))
    np.testing.assert_allclose(moved.mean(axis=0), 0.4, rtol=1e-12)     # round-off
    np.testing.assert_allclose(moved.std(axis=0), 0.03, rtol=1e-12)


def test_too_few_swatches_and_swatches_of_one_colour_are_refused():
    swatches = material(np.random.default_rng(5), MIN_SWATCHES - 1, 0.3)
    with pytest.raises(InputError, match=f"7 swatches are given; a correction needs "
                                         f"{MIN_SWATCHES}"):
        learn_correction(swatches)
    alike = Swatches(*(np.repeat(getattr(swatches, field.name)[:1], 9, axis=0)
                       for field in dataclasses.fields(swatches)))
    with pytest.raises(InputError, match="have the same signal"):
        learn_correction(alike)


CAMERA = {"camera": "Nikon 5100 (NPL)", "light": "D65", "noise": 0.003}


def dyed(count, seed):
    """Reflectances (n, 61) of one dye in various amounts and with a varying ground, far from what
    the learnt prior expects; and signals (n, 3).
    """
    from spectrabox.radiometry.spectra.named_spectra import relative_response

    rng = np.random.default_rng(seed)
    amounts, ground = rng.uniform(0.1, 2, (count, 1)), rng.uniform(0.6, 0.9, (count, 1))
    absorbed = np.exp(-0.5 * ((NM - 520) / 12)**2) + 0.7 * np.exp(-0.5 * ((NM - 610) / 10)**2)
    truth = ground * 10**-(amounts * absorbed)
    response = relative_response("Nikon 5100 (NPL)", "D65", PRIOR_GRID)
    return truth, truth @ response.T * (1 + 0.003 * rng.standard_normal((count, 3)))


def test_swatches_correct_the_spectra_behind_signals_of_three_bands():
    (known, known_signals), (truth, signals) = dyed(24, 1), dyed(12, 2)
    swatches = (known_signals, NM, known)
    before, after = (sb.sample(signals, swatches=each, **CAMERA) for each in (None, swatches))
    off = [np.mean([rmse(one.mean[None], each[None]) for one, each in
                    zip(estimates.values(), truth, strict=True)]) for estimates in (before, after)]
    assert off[1] < 0.5 * off[0]
    inside = np.mean([np.mean((one.band()[0] <= each) & (each <= one.band()[1]))
                      for one, each in zip(after.values(), truth, strict=True)])
    # 12 samples of two independent errors: 0.95 within four standard errors
    assert inside > 0.95 - SIGMAS * np.sqrt(0.95 * 0.05 / 24)
    first = after["signal 1"]
    assert "3 bands say little of a material" in first.outcome
    assert first.causes == {} and np.all(first.band(0.5)[0] >= first.band()[0])


def test_a_table_of_swatches_is_read_whatever_the_order_of_its_wavelengths(tmp_path):
    truth, signals = dyed(9, 3)
    table = tmp_path / "swatches.csv"
    head = ["name", *(f"{nm:g}" for nm in NM[::-1]), "R", "G", "B"]
    rows = [[f"s{at}", *map(repr, spectrum[::-1].tolist()), *map(repr, signal.tolist())]
            for at, (spectrum, signal) in enumerate(zip(truth, signals, strict=True))]
    table.write_text("\n".join(",".join(row) for row in [head, *rows]))
    read = read_swatches(table, "RGB")
    np.testing.assert_array_equal(read[0], signals)
    np.testing.assert_allclose(read[1], truth, rtol=1e-12)      # of pchip at nodes
    for text, sentence in (("R,G,B\n1,2,3", "is no table of swatches"),
                           ("R,G,B,400,700\n1,1,1,50,60", "divide percentages by 100"),
                           ("R,G,B,400,700\n1,1,1,0.5", "row 2 does not hold a number"),
                           ("R,G,B,450,700\n1,1,1,0.5,0.5", "covers 450-700 nm"),
                           ("R,G,B,400,400,700\n1,1,1,0.5,0.5,0.5", "not all different")):
        table.write_text(text)
        with pytest.raises(InputError, match=sentence):
            read_swatches(table, "RGB")


def test_swatches_go_with_the_learnt_prior_alone():
    truth, signals = dyed(9, 3)
    with pytest.raises(InputError, match="take --method prior"):
        sb.sample(signals[0], swatches=(signals, NM, truth), method="uniform", **CAMERA)
    with pytest.raises(InputError, match=r"give signals \(n, 3\)"):
        sb.sample(signals[0], swatches=(signals[:, :2], NM, truth), **CAMERA)


SWATCHES = 14               # of 20 areas beside the chart


@pytest.fixture(scope="module")
def dyed_photo(tmp_path_factory):
    """A photo of a chart beside swatches and samples of one dye; the swatches' spectra in a file;
    regions, and the truths of all.
    """
    folder = tmp_path_factory.mktemp("dyed")
    truth = dict(zip([*(f"swatch {at}" for at in range(SWATCHES)), *"abcdef"],
                     dyed(20, 5)[0], strict=True))
    places = [(0.55 + 0.085 * column, 0.03 + 0.15 * row) for row in range(4) for column in range(5)]
    areas = [(box(x, y, x + 0.075, y + 0.13), np.interp(PAINT_NM, NM, spectrum))
             for (x, y), spectrum in zip(places, truth.values(), strict=True)]
    responses = camera_sensitivities() * lamp.radiance(PAINT_NM)
    light = surface_signals(SIZE, responses, chart_copy(np.random.default_rng(1)),
                            chart_corners(*CHART), areas, np.full(PAINT_NM.size, 0.2))
    write_photo(folder / "dyed.dng", light * light_over()[..., None], Fraction(1, 60),
                np.random.default_rng(3))
    columns = {name: spectrum for name, spectrum in truth.items() if name.startswith("swatch")}
    (folder / "swatches.csv").write_text(table_text(NM, columns, quantity=Quantity.REFLECTANCE,
                                                    source="simulated"), encoding="utf-8")
    regions = {name: [round(480 * edge) for edge in (x + 0.015, y + 0.02, x + 0.06, y + 0.11)]
               for name, (x, y) in zip(truth, places, strict=True)}
    return folder, regions, truth


@pytest.fixture(scope="module")
def without_and_with(dyed_photo):
    """Estimates of the photo's regions without swatches and with them."""
    folder, regions, _ = dyed_photo
    return [sb.flat(folder / "dyed.dng", regions, surface="matt", swatches=each)
            for each in (None, folder / "swatches.csv")]


def test_swatches_in_the_photo_correct_the_samples(dyed_photo, without_and_with):
    truth, (before, after) = dyed_photo[2], without_and_with
    off = [np.mean([rmse(found[name].mean[None], np.interp(found[name].nm, NM, truth[name])[None])
                    for name in "abcdef"]) for found in (before, after)]
    assert off[1] < 0.6 * off[0]
    assert f"{SWATCHES} swatches of the operator corrected the spectra" in after["a"].outcome
    assert after["a"].prior is None and after["swatch 0"].given is not None


def test_the_command_corrects_by_swatches_as_python_does(dyed_photo, without_and_with):
    folder, regions, _ = dyed_photo
    said = call("flat", folder / "dyed.dng", "--swatches", folder / "swatches.csv", "--surface",
                "matt", "--json", "--quiet", *(
                    word for name, rect in regions.items()
                    for word in ("--region", f"{name}={','.join(map(str, rect))}")))
    facts = json.loads(said.stdout)
    found = {region["name"]: region for region in facts["regions"]}
    assert found["swatch 3"]["known"] and not found["a"]["known"]
    assert "swatches of the operator corrected the spectra" in facts["swatches"]
    page = (folder / "dyed-flat" / "report.html").read_text(encoding="utf-8")
    assert page.count(facts["swatches"]) >= 2        # beside the answer and among the methods
    # files and preview are stored in single precision
    np.testing.assert_allclose(found["a"]["mean"], without_and_with[1]["a"].mean[::5], atol=1e-4)


def test_swatches_whose_spectra_were_exchanged_are_named(dyed_photo, without_and_with, tmp_path):
    folder, regions, truth = dyed_photo
    assert not [said for said in without_and_with[1].found.warnings if "swatches" in said]
    by_lightness = sorted((name for name in truth if name.startswith("swatch")),
                          key=lambda name: truth[name].mean())
    dark, light = by_lightness[0], by_lightness[-1]
    exchanged = {dark: light, light: dark}
    columns = {name: truth[exchanged.get(name, name)] for name in truth
               if name.startswith("swatch")}
    path = tmp_path / "swatches.csv"
    path.write_text(table_text(NM, columns, quantity=Quantity.REFLECTANCE, source="simulated"),
                    encoding="utf-8")
    found = sb.flat(folder / "dyed.dng", regions, surface="matt", swatches=path)
    first, second = sorted((dark, light), key=list(truth).index)
    assert [said for said in found.found.warnings
            if said.startswith(f"{first} and {second}: the spectra of these swatches contradict")]


def test_swatches_that_are_too_few_or_not_named_as_regions_are_refused(dyed_photo):
    folder, regions, _ = dyed_photo
    some = {name: rect for name, rect in regions.items() if name in ("a", "swatch 1", "swatch 2")}
    with pytest.raises(InputError, match="2 swatches are given"):
        sb.flat(folder / "dyed.dng", some, swatches=folder / "swatches.csv")
    with pytest.raises(InputError, match="no region has such a name"):
        sb.flat(folder / "dyed.dng", {"a": regions["a"]}, swatches=folder / "swatches.csv")
    said = call("flat", folder / "dyed.dng", "--swatches", folder / "swatches.csv", "--session",
                folder / "few", *(word for name, rect in some.items()
                                  for word in ("--region", f"{name}={','.join(map(str, rect))}")))
    assert said.exit_code == 3 and "2 regions are swatches; a correction needs 8" in said.stderr
