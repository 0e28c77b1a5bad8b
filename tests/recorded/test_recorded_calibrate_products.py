"""Recorded: products of sensitivity and light from chart photos under a light nobody measured."""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from calibrate_cameras import GRID, NODES, cameras
from uneven_charts import bands, blue_light, camera, sizes, small_prior, uneven_photo, warm_light

from spectrabox.calibrate.chart_equations import PatchError, some_patches
from spectrabox.calibrate.products import light_posterior as light_said
from spectrabox.calibrate.products import product_posterior as posteriors
from spectrabox.calibrate.products.lamps import (
    Lamps,
    all_lamps,
    blackbodies,
    colour_temperatures,
    daylights,
    lamps_like,
)
from spectrabox.calibrate.products.light_posterior import light_posterior
from spectrabox.calibrate.products.product_fit import fit_products, in_curves
from spectrabox.calibrate.products.product_prior import draw_cameras, paired, product_prior
from spectrabox.calibrate.products.stated_light import evidence_for_another_light, light_doubts
from spectrabox.radiometry.errors import CalibrationError, InputError
from spectrabox.radiometry.records import UnknownLight
from spectrabox.radiometry.spectra.light_words import LIGHT_KINDS

# Kernels of 1 % of a covariance are inverted; a hundred posteriors are mixed.
MIXED = 1e-5
CANCELLED = 1e-3    # what is left of a variance of 9, of an unknown exposure


def lamps(count=9, seed=4):
    """Lamps of three kinds and of unequal probability."""
    rng = np.random.default_rng(seed)
    narrow = np.exp(-0.5 * ((GRID.nm - rng.uniform(440, 465, (count, 1))) / 12) ** 2)
    broad = np.exp(-0.5 * ((GRID.nm - rng.uniform(540, 600, (count, 1))) / 50) ** 2)
    spectra = np.vstack([blackbodies(rng.uniform(2500, 6500, count // 2)),
                         (rng.uniform(0.3, 1.2, (count, 1)) * narrow + broad + 0.02)[count // 2:]])
    weights = rng.uniform(0.5, 2, count)
    return Lamps(spectra / spectra.mean(axis=1, keepdims=True), np.arange(count) * 3 // count + 1,
                 weights / weights.sum(), tuple(f"lamp {index}" for index in range(count)))


def product_of(count=27, seed=6):
    made = np.maximum(cameras(count, seed), 1e-3)[..., ::6]
    return paired(NODES[::6], made, np.arange(count) % 9, lamps())


def unlit(photo):
    return dataclasses.replace(photo, power=GRID.weights_nm)


@pytest.fixture(scope="module")
def photos():
    """Two photos of a camera under a lamp that is none of the prior's."""
    light = 0.6 * warm_light(GRID) + 0.4 * blue_light(GRID)
    first = uneven_photo(12, light=light, grid=GRID, curves=camera(GRID))
    second = uneven_photo(9, light=light, grid=GRID, curves=camera(GRID), seed=3, field=False,
                          level=0.4)
    return [unlit(first), unlit(second)]


# ---- lamps ---------------------------------------------------------------------------------------

def test_every_lamp_that_is_known(recorded):
    made = all_lamps()
    by_kind = {kind: made.spectra[made.kind == index] for index, kind in enumerate(LIGHT_KINDS)}
    recorded({"kinds": made.kind, "weights": made.weights, "by kind": by_kind,
              "names": " | ".join(made.names),
              "shares": {kind: made.weights[made.kind == index].sum()
                         for index, kind in enumerate(LIGHT_KINDS)}})
    assert made.weights.sum() == pytest.approx(1)


@pytest.mark.parametrize("kind", [None, *LIGHT_KINDS])
@pytest.mark.parametrize("cct", [None, 3150.0, 5600.0])
def test_lamps_by_what_is_said_of_them(recorded, kind, cct):
    found = lamps_like(UnknownLight(kind, cct))
    recorded({"weights": found.weights, "kinds": found.kind, "names": " | ".join(found.names),
              "spectra": found.spectra})


def test_spectra_by_formula(recorded):
    kelvin = np.array([2300.0, 3000, 4500, 6990, 7010, 12000])
    bodies, days = blackbodies(kelvin), daylights(kelvin[2:])
    recorded({"bodies": bodies, "days": days, "temperatures": colour_temperatures(
        np.vstack([bodies, days, np.eye(301)[[10, 60, 290]] + 1e-3]))})
    # McCamy's formula is right within some kelvin on the locus of blackbodies
    np.testing.assert_allclose(colour_temperatures(bodies)[1:4], kelvin[1:4], rtol=0.01)


# ---- the prior on products -----------------------------------------------------------------------

def test_a_prior_of_pairs(recorded):
    made = product_of()
    recorded({"prior": made, "parts": [str(made.products), str(made.balance), str(made.light)],
              "products": made.components[:, made.products], "lamps": made.components[
                  :, made.light], "balance": made.components[:, made.balance],
              "errors": sizes(made.covariance)})
    np.testing.assert_allclose(made.components[:, made.products].reshape(27, 3, -1).sum(axis=2), 1)


@pytest.mark.parametrize("more", [{}, {"components": 40}, {"components": 5}])
def test_a_prior_of_drawn_cameras(recorded, more):
    made = product_prior(small_prior(), lamps(), 3, **more)
    recorded({"components": made.components, "weights": made.weights, "lamp": made.lamp,
              "errors": sizes(made.covariance)}, rtol=1e-4)     # of a Cholesky factor of 1e6


def test_cameras_drawn_from_a_prior(recorded):
    recorded([draw_cameras(known, 30, np.random.default_rng(2))
              for known in (small_prior(), small_prior(floor=False))], rtol=1e-4)


# ---- posteriors ----------------------------------------------------------------------------------

def of_chart(chart):
    return {field.name: getattr(chart, field.name) for field in dataclasses.fields(chart)}


def test_equations_about_a_state(recorded, photos):
    prior, rng = product_of(), np.random.default_rng(7)
    count = posteriors._nuisances(photos)
    start, now = 0.1 * rng.standard_normal((2, count))
    chart = posteriors.linearised(photos, prior, prior.components[4], now,
                                  0.1 * rng.standard_normal(3), start)
    table = {"chart": of_chart(chart), "nodes": posteriors.node_reflectances(photos[0], prior.nm),
             "exposures": posteriors._exposures(photos),
             "first": [posteriors._first_exposure(photo, prior, prior.components[4])
                       for photo in photos]}
    weighed = posteriors._weighed(photos, prior, chart, ((0.02, 0.7), (0.3, 0.3)),
                                  ((0.1, 0.6), (0.5, 0.4)), (0.005, 0.03), (0.0, 0.01))
    table |= {"innovation": weighed.innovation, "level": weighed.level,
              "tried": [(*each[:3], each[3], each[4], sizes(each[5])) for each in weighed.tried]}
    recorded(table, rtol=MIXED)


def test_equations_about_the_best_state(recorded, photos):
    """Of a photo whose light falls off so much that the steps towards it do not end."""
    terms = photos[0].field_terms @ [0.5, -0.4, 0.3, 0.4, -0.2]
    steep = dataclasses.replace(photos[0], signal=photos[0].signal * np.exp(terms)[:, None])
    recorded(of_chart(posteriors._about_the_best([steep], product_of())), rtol=MIXED)


@pytest.fixture(scope="module")
def posterior(photos):
    return posteriors.posterior_of_products(photos, product_of())


def test_a_posterior_of_products(recorded, photos, posterior):
    mean, covariance = posterior.moments()
    recorded({"chart": of_chart(posterior.chart), "evidence": posterior.log_evidence,
              "alone": posteriors.evidence_of_products(photos, product_of()),
              "settings": [(each.width, each.gain_sd, each.error, each.share, each.chi_square)
                           for each in posterior.hypotheses], "mean": mean}, rtol=MIXED)
    recorded({"errors": sizes(covariance), "weights": [
        np.maximum(each.log_weights, -50) for each in posterior.hypotheses]},
             rtol=CANCELLED, case="errors")
    assert sum(each.share for each in posterior.hypotheses) == pytest.approx(1, abs=0.03)


def test_hypotheses_without_some_patches(recorded, posterior):
    first, *others = sorted(posterior.hypotheses, key=lambda each: -each.share)
    table = {}
    for patch in (0, 7):
        rows = slice(3 * patch, 3 * patch + 3)
        mean, covariance = posteriors.hypothesis_moments(posterior, first, rows, 9)
        table[patch] = {
            "shares": posteriors.shares_without([first, *others], rows),
            "weights": posteriors.weights_of_components(first, rows), "mean": mean,
            "errors": sizes(covariance)["log sd"],
            "states": posteriors.states_of_components(posterior, first, np.array([3, 1]), rows)}
    table["all"] = posteriors.states_of_components(posterior, first, np.array([3, 1]))
    table["mixed"] = posteriors.mixed([0.2, 0.5], [(np.array([1.0, 2.0]), np.diag([1.0, 3.0])),
                                                   (np.array([4.0, 1.0]), np.eye(2))])
    recorded(table, rtol=CANCELLED)


def test_curves_of_a_state(recorded):
    prior, rng = product_of(), np.random.default_rng(8)
    size = prior.components.shape[1] + 5 + 3
    mean = np.r_[prior.components[2], 0.1 * rng.standard_normal(8)]
    mean[4] = -0.01
    root = rng.standard_normal((size, size)) / 100
    state, covariance = in_curves(prior, mean, root @ root.T, rng.uniform(20, 40, 11))
    recorded({"state": state, "errors": sizes(covariance)})


# ---- the fit and the light -----------------------------------------------------------------------

@pytest.mark.parametrize("kept_out", [False, True])
def test_a_fit_of_products(recorded, photos, kept_out):
    used = np.arange(12) % 4 != 1 if kept_out else np.ones(12, bool)
    apart = some_patches(photos[0], ~used) if kept_out else None
    found = fit_products([some_patches(photos[0], used), *photos[1:]], small_prior(), lamps(),
                         GRID, "unknown light", apart)
    fit = found.fit
    white = [sizes(state.white.covariance)["log sd"] for state in fit.photos]
    made = fit.sensitivity
    recorded({"curves": made.curves, "coefficients": made.coefficients,
              "error": made.standard_error, "residuals": made.residuals,
              "held out residuals": made.held_out_residuals, "said": made.method,
              "condition": made.condition_number, "states": [
                  dataclasses.replace(state, white=dataclasses.replace(
                      state.white, covariance=np.eye(len(state.white.covariance))))
                  for state in fit.photos], "white": white, "held out": fit.held_out,
              "share": fit.prior_share, "families": fit.families, "errors": fit.patch_error,
              "chi": fit.chi_square, "left out": (fit.without.coefficients, fit.without.offset,
                                                  fit.without.noise, fit.without.signal),
              "light": found.light, "best": (fit.posterior.best_error, fit.posterior.weights)},
             rtol=CANCELLED)
    recorded(sizes(made.covariance), rtol=CANCELLED, case="errors")


def test_what_is_said_of_a_light(recorded, posterior):
    found = light_posterior(posterior, GRID)
    recorded({"light": found, "before": light_said._spread_before(posterior)}, rtol=CANCELLED)
    kinds = len(LIGHT_KINDS)
    table, mean, half = {}, np.linspace(1, 2, 7), np.linspace(0.2, 0.5, 7)
    for first, second in ((0.891, 0.05), (0.909, 0.05), (0.7, 0.2475), (0.7, 0.2525),
                          (0.909, 0.2525)):
        for place in range(kinds):
            shares = np.full(kinds, 0.001)
            shares[place], shares[(place + 2) % kinds] = first, second
            table[f"{place} {first} {second}"] = light_said._sentences(shares, half, half, mean)
    for width in (0.742, 0.758):
        table[f"width {width}"] = light_said._sentences(np.eye(kinds)[1], width * half, half, mean)
    recorded(table, case="sentences")


def test_whether_another_light_explains_a_photo_better(recorded, photos):
    light = 0.6 * warm_light(GRID) + 0.4 * blue_light(GRID)
    stated = [dataclasses.replace(photo, power=light * GRID.weights_nm) for photo in photos]
    recorded({name: evidence_for_another_light(stated[:1], small_prior(), power, GRID)
              for name, power in (("right", light), ("bright", 30 * light),
                                  ("wrong", blue_light(GRID)))}, rtol=1e-3)    # of differences
    recorded({f"{evidence}": light_doubts(evidence) for evidence in (-3.0, 6.93, 7.0, 7.07)},
             case="doubts")


def test_an_evidence_far_apart_is_a_share(recorded):
    tried = [(0.1, 0.2, PatchError(0.01), logs, np.zeros(3), None) for logs in (
        np.array([-1000.0, -1002, -1001]), np.array([-1004.0, -999, -1003]))]
    recorded(posteriors._shares(tried))
    surprise = SimpleNamespace(seen=np.arange(6.0).reshape(2, 3), inverse=np.diag([1.0, 2, 4]))
    np.testing.assert_allclose(posteriors._surprise(surprise, slice(1, 3)),
                               [1 / 2 + 4 / 4, 16 / 2 + 25 / 4])


def test_photos_that_no_mixture_can_be_fitted_to_are_refused(recorded, photos):
    """Also those of another number of bands than the cameras have."""
    four = unlit(uneven_photo(10, curves=bands(4, GRID), grid=GRID))
    grey = dataclasses.replace(photos[0], signal=photos[0].signal[:, [0, 0, 1]])
    few = some_patches(photos[0], np.arange(12) < 7)
    table = {}
    for name, photo, error in (("bands", four, InputError), ("grey", grey, CalibrationError),
                               ("few", few, CalibrationError)):
        with pytest.raises(error) as caught:
            fit_products([photos[0], photo], small_prior(), lamps(), GRID, "unknown light")
        table[name] = str(caught.value)
    recorded(table)
