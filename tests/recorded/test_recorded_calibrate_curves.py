"""Recorded: joint estimates of curves from chart photos, what they leave open, whether to trust
them, and what to expect of a photo beforehand.
"""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from calibrate_cameras import GRID
from uneven_charts import (
    UNEVEN,
    bands,
    blue_light,
    camera,
    positions,
    sizes,
    small_prior,
    surfaces,
    uneven_photo,
    warm_light,
)

from spectrabox.calibrate import colour_matrix, measured_curves, sensitivity, trust
from spectrabox.calibrate.chart_equations import PatchError, some_patches
from spectrabox.calibrate.preflight import preflight
from spectrabox.calibrate.prior import prior_fit
from spectrabox.calibrate.prior.curve_posterior import (
    CurvePosterior,
    curve_moments,
    draw_curves,
    nonnegative,
    photo_states,
    sensitivity_draws,
)
from spectrabox.calibrate.prior.measured_prior import prior_of_curves
from spectrabox.calibrate.sensitivity import fit_with_prior
from spectrabox.radiometry.errors import CalibrationError, CheckError, InputError
from spectrabox.radiometry.records import Calibration, Quantity, Spectrum

# Gauss-Newton stops at a tenth of a standard error, always after the same step; matrices of
# condition numbers up to 1e8 are inverted on the way.
ITERATED = 1e-5
# What is left of a variance of 9, of an unknown exposure: 1e-16 of it in errors of 1e-6 squared.
CANCELLED = 3e-3


def said(call, *arguments, **more):
    try:
        return call(*arguments, **more)
    except (CalibrationError, CheckError, InputError) as error:
        return f"{type(error).__name__}: {error}"


def of_posterior(posterior):
    fields = {field.name: getattr(posterior, field.name)
              for field in dataclasses.fields(posterior)}
    return fields | {"covariances": [sizes(one) for one in posterior.covariances[:3]]}


def of_fit(fit):
    """All of a joint estimate, every error on its own scale."""
    fields = {field.name: getattr(fit, field.name) for field in dataclasses.fields(fit)}
    made = fields.pop("sensitivity")
    curves = {field.name: getattr(made, field.name) for field in dataclasses.fields(made)
              if field.name != "grid"}
    whites = [sizes(state.white.covariance) for state in fit.photos]
    without = fields.pop("without")
    left = {field.name: getattr(without, field.name) for field in dataclasses.fields(without)
            if field.name != "covariance"}
    return fields | {"posterior": of_posterior(fit.posterior), "whites": whites, **curves,
                     "errors": sizes(made.covariance), "without": left,
                     "model error": fit.model_error, "disagrees": fit.disagrees}


def left_out(fit, reflectances):
    """Errors of patches that were left out."""
    return {"errors": sizes(fit.without.error_covariance(reflectances)),
            "states": sizes(fit.without.covariance)["log sd"]}


# ---- joint estimates -----------------------------------------------------------------------------

@pytest.fixture(scope="module")
def alone():
    return uneven_photo(17)


@pytest.fixture(scope="module")
def one(alone):
    return fit_with_prior([alone], small_prior(), UNEVEN)


@pytest.fixture(scope="module")
def linked():
    """Two charts of one camera, whose exposures are known to each other within 2 %."""
    return [uneven_photo(13, glare=False), uneven_photo(
        10, light=blue_light(), seed=3, field=False, tie=0.02, level=0.45)]


def test_curves_of_one_photo(recorded, alone, one):
    recorded(of_fit(one), rtol=ITERATED)
    recorded(left_out(one, alone.reflectances), rtol=CANCELLED, case="left out")


def test_curves_of_two_photos_with_patches_kept_out(recorded, linked):
    first, second = linked
    used = np.arange(13) % 5 != 3
    found = fit_with_prior([some_patches(first, used), second], small_prior(floor=False), UNEVEN,
                           model_errors=(0.003, 0.011), apart=some_patches(first, ~used))
    recorded(of_fit(found) | {"scales": [sensitivity.scale_of_photo(found, index)
                                         for index in (0, 1)]}, rtol=ITERATED)
    inside = [first.reflectances[used], first.reflectances[~used]]
    recorded(left_out(found, np.vstack(inside)), rtol=CANCELLED, case="left out")


def test_curves_of_a_prior_without_families(recorded, linked):
    found = fit_with_prior(linked[::-1], small_prior(5), UNEVEN)
    recorded(of_fit(found), rtol=ITERATED)
    recorded(left_out(found, linked[1].reflectances), rtol=CANCELLED, case="left out")


@pytest.mark.parametrize("count", [3, 5])
def test_curves_with_the_prior_that_their_number_calls_for(recorded, count):
    photo = uneven_photo(15, curves=bands(count) if count > 3 else None,
                         light=np.where(UNEVEN.nm < 440, 0.0, warm_light()))
    found = fit_with_prior([photo], None, UNEVEN, model_errors=(0.004, 0.016))
    curves = found.sensitivity
    recorded({"curves": curves.curves, "error": curves.standard_error, "said": curves.method,
              "families": found.families[:5], "share": found.prior_share,
              "errors": found.patch_error, "states": found.photos, "held out": found.held_out,
              "chi square": found.chi_square}, rtol=ITERATED)


def test_photos_that_cannot_be_fitted_are_refused(recorded):
    photo = uneven_photo(9)
    recorded({"few": said(fit_with_prior, [photo, some_patches(photo, np.arange(9) > 1)],
                          small_prior(), UNEVEN),
              "grey": said(fit_with_prior, [dataclasses.replace(
                  photo, signal=photo.signal[:, [0, 1, 1]])], small_prior(), UNEVEN),
              "bands": said(fit_with_prior, [photo, uneven_photo(9, curves=bands(4))],
                            small_prior(), UNEVEN),
              "no evidence": said(prior_fit._mixture, [SimpleNamespace(log_weight=-np.inf)],
                                  {}, None, None, None, [photo])})


def test_the_state_of_a_fit_before_and_while_it_is_found(recorded, linked):
    known = small_prior()
    spread = known.covariances()
    from spectrabox.calibrate.chart_equations import unlit_design
    from spectrabox.radiometry.grid import interpolation_matrix
    basis = interpolation_matrix(known.nm, UNEVEN.nm)
    cases = {}
    for name, photos in (("tied", linked), ("alone", linked[1:]), ("three", [
            *linked, uneven_photo(9, seed=6, field=False, glare=False)])):
        designs = [unlit_design(photo, basis) for photo in photos]
        total, start = prior_fit._joint_prior(known, spread[1], len(known.weights) // 2, 0.31,
                                              photos, designs)
        cases[name] = {"start": start, "covariance": sizes(total), "whole": total[-8:, -8:],
                       "logarithms": prior_fit._logarithms(photos, known.means.shape[1]),
                       "row": prior_fit._whole(designs, known)}
        for kind in ("start", "far"):
            guess = None if kind == "start" else start + np.r_[np.full(39, 2.1), np.full(
                start.size - 39, 0.02)]
            cases[name][kind] = prior_fit._linearise(photos, designs, start, total, known, guess)
    recorded(cases, rtol=ITERATED)


def test_the_evidence_of_gaussians(recorded):
    rng = np.random.default_rng(41)
    roots = rng.standard_normal((4, 6, 6))
    covariances = roots @ roots.transpose(0, 2, 1) + np.eye(6)
    innovation = rng.standard_normal(6)
    found = prior_fit._log_evidence(covariances, innovation)
    broken = covariances.copy()
    broken[2] = -broken[2]
    recorded({"all": found, "one broken": prior_fit._log_evidence(broken, innovation)})
    expected = [-0.5 * innovation @ np.linalg.solve(one, innovation)
                - 0.5 * np.linalg.slogdet(one)[1] for one in covariances]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_when_a_fit_disagrees(recorded, one):
    """Just within and just beyond each limit."""
    recorded({f"{error} {chi}": dataclasses.replace(
        one, patch_error=PatchError(0.6 * error, 0.8 * error), chi_square=chi).disagrees
        for error in (0.02, 0.0495, 0.0505) for chi in (1.0, 2.97, 3.03)})


# ---- what later stages read ----------------------------------------------------------------------

def test_curves_held_above_zero(recorded):
    rng, cases = np.random.default_rng(42), {}
    for seed in range(5):
        root = rng.standard_normal((7, 7))
        mean = rng.uniform(-0.3, 1.0, 7)
        cases[seed] = nonnegative(mean, root @ root.T + 0.3 * np.eye(7))
    cases["rounding"] = nonnegative(np.array([1.0, -0.9e-9, 0.5]), np.diag([1.0, 2, 3]))
    recorded(cases)


def plain_posterior(size=39, nuisances=9):
    """A mixture of three with independent errors, so that draws of it hang on no rounding."""
    known, rng = small_prior(), np.random.default_rng(43)
    from spectrabox.radiometry.grid import interpolation_matrix
    mean = np.r_[known.curves(known.means[-1]), 0.4, 0.05 * rng.standard_normal(nuisances - 1)]
    means = mean * (1 + 0.03 * rng.standard_normal((3, size + nuisances)))
    means[1, 5:8] -= 0.3
    spreads = [np.diag(np.linspace(0.5, 2, size + nuisances) * scale) for scale in (
        1e-3, 3e-4, 2e-3)]
    return CurvePosterior(interpolation_matrix(known.nm, UNEVEN.nm), np.array([0.5, 0.3, 0.2]),
                          means, np.array(spreads), np.array([0.7, 0.3]), PatchError(0.01, 0.004),
                          -12.5, 1, 0.05, PatchError(0.008))


def test_moments_and_draws_of_a_mixture(recorded):
    mixture = plain_posterior()
    moments = curve_moments(mixture, 3)
    draws = draw_curves(mixture, 3, 40, 7)
    states = photo_states(mixture, [uneven_photo(11)], moments)
    bare = photo_states(mixture, [uneven_photo(11, field=False, glare=False)], moments)
    recorded({"moments": moments, "error": sizes(moments.covariance), "draws": draws,
              "states": states, "whites": [sizes(state.white.covariance) for state in states],
              "bare": bare})
    assert moments.coefficients.min() >= 0 and (moments.coefficients @ mixture.basis.T).max() == \
        pytest.approx(1)
    np.testing.assert_allclose(draws.curves.max(axis=(1, 2)), 1, rtol=1e-12)


def test_draws_of_what_a_calibration_carries(recorded, one):
    fit = dataclasses.replace(one.sensitivity, covariance=np.diag(np.linspace(1e-5, 1e-3, 39)))
    light = Spectrum(UNEVEN, warm_light(), Quantity.RELATIVE, "lamp")
    carried = Calibration(fit, light, None, np.eye(3), ())
    bare = dataclasses.replace(carried, sensitivity=dataclasses.replace(fit, covariance=None))
    recorded({"draws": sensitivity_draws(carried, 30, 5), "none": said(
        sensitivity_draws, bare, 30, 5)}, rtol=ITERATED)


# ---- whether to trust it -------------------------------------------------------------------------

def test_colour_differences_of_a_chart(recorded, alone):
    rng = np.random.default_rng(44)
    predicted = alone.signal * (1 + 0.02 * rng.standard_normal(alone.signal.shape))
    found = trust.chart_colour_differences(alone.signal, predicted, alone.reflectances, UNEVEN)
    recorded(found, rtol=1e-5)      # square roots near 0
    np.testing.assert_allclose(trust.chart_colour_differences(
        predicted, predicted, alone.reflectances, UNEVEN), 0, atol=1e-6)


def test_sentences_on_a_fit_near_every_limit(recorded, one):
    state, table = one.photos[0], {}

    def say(**changes):
        return trust.sentences(dataclasses.replace(one, **changes), UNEVEN)

    for share in (0.499, 0.501):
        for name, where in (("start", UNEVEN.nm < 412), ("two", np.abs(np.abs(
                UNEVEN.nm - 540) - 40) < 9), ("end", UNEVEN.nm > 684)):
            of_bands = np.zeros((3, UNEVEN.nm.size))
            of_bands[1, where], of_bands[2, where] = share, 0.2
            table[f"share {share} {name}"] = say(prior_share=of_bands)
    for last in (0.0495, 0.0505):
        families = (("A", 0.6), ("B, C", 0.2), ("D", last), ("E", 0.0501))
        table[f"families {last}"] = say(families=families)
        table[f"only {last}"] = say(families=(("A", last),), prior_share=np.ones((3, 86)))
    table["no families"] = say(families=(), prior_share=np.ones((3, 86)))
    brightest = state.predicted.max(axis=0)
    for share in (0.0198, 0.0202, -0.0202, 0.31):
        for sigmas in (2.97, 3.03):
            glare = share * brightest * [0.1, 1.0, 0.5]
            changed = dataclasses.replace(state, glare=glare, glare_error=np.abs(glare) / sigmas)
            table[f"glare {share} {sigmas}"] = say(photos=(changed,))
    even = dataclasses.replace(state, field=np.full(17, 1.2))
    table["photos"] = say(photos=(state, even, dataclasses.replace(
        state, glare=0.05 * brightest, glare_error=1e-4 * brightest)))
    recorded(table, rtol=ITERATED)


def test_doubts_near_the_limit(recorded, one):
    unlike = one.families[[name for name, _ in one.families].index(trust.UNLIKE)][0]
    recorded({f"{share} of {count}": trust.doubts(dataclasses.replace(one, families=(
        (name, share), ("others", 1 - share))[:count]))
        for share in (0.891, 0.909, 1.0) for count in (1, 2) for name in (unlike, "others, two")
        if name == unlike or share == 1.0})


READINGS = {
    "as it is": lambda signal: signal,
    "mirrored": lambda signal: signal.reshape(3, 6, 3)[:, ::-1].reshape(18, 3),
    "upside down": lambda signal: signal.reshape(3, 6, 3)[::-1].reshape(18, 3),
    "turned": lambda signal: signal[::-1],
    "blue first": lambda signal: signal[:, ::-1],
    "encoded": lambda signal: np.where(signal <= 0.0031308, 12.92 * signal,
                                       1.055 * np.maximum(signal, 1e-9) ** (1 / 2.4) - 0.055),
    "glare": lambda signal: signal + np.array([0.3, 0.2, 0.25]),
    "random": lambda signal: np.random.default_rng(3).permutation(signal)}


@pytest.mark.parametrize("reading", READINGS)
def test_how_else_a_photo_may_be_read(recorded, reading):
    photo = uneven_photo(18, rows=3, relative=0.004)
    misread = dataclasses.replace(photo, signal=np.ascontiguousarray(
        READINGS[reading](photo.signal)))
    known = small_prior(6)
    recorded({"reading": trust.other_reading(misread, known, UNEVEN),
              "no grid": trust.other_reading(dataclasses.replace(misread, rows=None), known,
                                             UNEVEN),
              "evidence": trust._evidence(misread, misread.signal, known, UNEVEN),
              "decoded": trust._decoded(misread.signal),
              "shaded": trust._without_glare(misread)}, rtol=1e-4)    # of sums that cancel


def test_how_much_better_another_reading_has_to_be(recorded, monkeypatch):
    photo, table = uneven_photo(18, rows=3), {}
    for gain in (19.8, 20.2):
        for first in range(6):
            for disagrees in (False, True):
                gains = iter([*(gain if number == first else 1.0 for number in range(6)), 0.0])
                monkeypatch.setattr(trust, "_evidence", lambda *_, gains=gains: next(gains))
                monkeypatch.setattr(trust, "fit_with_prior", lambda *_, no=disagrees:
                                    SimpleNamespace(disagrees=no))
                table[f"{gain} {first} {disagrees}"] = trust.other_reading(
                    photo, small_prior(6), UNEVEN)
    recorded(table)


# ---- measured curves -----------------------------------------------------------------------------

def test_whether_measured_curves_explain_a_photo(recorded):
    photo, curves = uneven_photo(18, rows=3), camera()
    wide = np.interp(UNEVEN.nm - 25, UNEVEN.nm, curves[0])
    cases = {"right": curves, "of any scale": 4.2 * curves, "order": curves[[1, 0, 2]],
             "shifted": np.array([wide, curves[1], curves[2]])}
    table = {name: said(measured_curves.check_measured_curves, photo, each, UNEVEN)
             for name, each in cases.items()}
    mirrored = dataclasses.replace(photo, signal=READINGS["mirrored"](photo.signal))
    table["mirrored"] = said(measured_curves.check_measured_curves, mirrored, curves, UNEVEN)
    table["prior"] = sizes(measured_curves._about(curves, UNEVEN).covariances()[0])
    table["mean"] = measured_curves._about(curves, UNEVEN).means
    recorded(table, rtol=1e-4)      # chi-squares are written with one digit or two


def test_when_measured_curves_are_doubted(recorded, monkeypatch):
    photo, table = uneven_photo(18, rows=3), {}
    for chi in (1.485, 1.515, 4.4):
        for disagrees in (False, True):
            for reading in (None, "mirrored left to right"):
                fit = SimpleNamespace(chi_square=chi, disagrees=disagrees, model_error=0.0123,
                                      held_out=[1.05 * photo.signal])
                monkeypatch.setattr(measured_curves, "fit_with_prior", lambda *_, fit=fit: fit)
                monkeypatch.setattr(measured_curves, "other_reading",
                                    lambda *_, reading=reading: reading)
                table[f"{chi} {disagrees} {reading}"] = said(
                    measured_curves.check_measured_curves, photo, camera(), UNEVEN)
    recorded(table)


# ---- the colour matrix of a raw file -------------------------------------------------------------

def test_a_colour_matrix_held_against_curves(recorded):
    curves = camera(GRID)
    to_xyz = np.array([[0.6, 0.25, 0.1], [0.25, 0.8, -0.05], [0.02, -0.1, 1.0]])
    stated = np.linalg.inv(to_xyz / curves.sum(axis=1))
    table = {"deviation": colour_matrix.matrix_deviation(stated, curves, GRID),
             "doubt": colour_matrix.matrix_doubt(stated, curves, GRID),
             "uneven": colour_matrix.matrix_doubt(stated, camera(), UNEVEN)}
    np.testing.assert_allclose(colour_matrix.matrix_deviation(3.7 * stated, 0.2 * curves, GRID),
                               table["deviation"], rtol=1e-9, atol=1e-12)
    for share in np.linspace(0.3, 2.1, 9):
        moved = stated * (1 + share * np.array([[0.1, -0.3, 0.2], [0.0, 0.1, -0.1], [0.3, 0, 0]]))
        table[f"{share:.2f}"] = (colour_matrix.matrix_doubt(moved, curves, GRID),
                                 colour_matrix.matrix_contradicts(moved, curves, GRID))
    table["none"] = colour_matrix.matrix_contradicts(None, curves, GRID)
    table["other bands"] = colour_matrix.matrix_contradicts(stated, bands(4, GRID), GRID)
    recorded(table)


@pytest.mark.parametrize("factor", [0.99, 1.0, 1.01])
def test_the_limit_of_a_colour_matrix_belongs_to_the_doubt(recorded, monkeypatch, factor):
    monkeypatch.setattr(colour_matrix, "matrix_doubt", lambda *_: factor * 4.5)
    recorded(colour_matrix.matrix_contradicts(np.eye(3), camera(), UNEVEN))


# ---- before shooting -----------------------------------------------------------------------------

@pytest.mark.parametrize("count", [16, 5])
def test_what_to_expect_of_a_photo(recorded, count):
    chart, known = surfaces(14), small_prior(count)
    second = {"blue": blue_light(), "red": np.exp((UNEVEN.nm - 600) / 40), "same": warm_light()}
    bare = np.where(UNEVEN.nm < 433, 0.0, warm_light())
    recorded({"plain": preflight(known, chart, warm_light(), UNEVEN),
              "all": preflight(known, chart, bare, UNEVEN, relative_error=0.023,
                               positions=positions(14), second=second),
              "one camera": preflight(prior_of_curves(UNEVEN, camera(), 0.05), chart, bare,
                                      UNEVEN)}, rtol=ITERATED)
    # light of any unit
    np.testing.assert_allclose(preflight(known, chart, 7 * bare, UNEVEN).expected_error,
                               preflight(known, chart, bare, UNEVEN).expected_error, rtol=1e-9)
