"""Recorded: equations of chart photos, checks of them, patches left out, splines."""
import dataclasses

import numpy as np
import pytest
from uneven_charts import (
    UNEVEN,
    blue_light,
    covariances,
    patch_samples,
    positions,
    sizes,
    uneven_photo,
    warm_light,
)

from spectrabox.calibrate import chart_equations, left_out, photo_checks, spline_fit
from spectrabox.calibrate.chart_equations import PatchError
from spectrabox.calibrate.left_out import PatchesWithout
from spectrabox.calibrate.sensitivity import (
    condition_number,
    fit_sensitivities,
    relative_prediction_covariance,
)
from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import CalibrationError, CheckError, InputError
from spectrabox.radiometry.records import Quantity, Spectrum

RNG_SEED = 31


def said(call, *arguments, **more):
    """What came of a call: its value, or the error's kind and sentence."""
    try:
        return call(*arguments, **more)
    except (CalibrationError, CheckError, InputError) as error:
        return f"{type(error).__name__}: {error}"


def test_an_error_of_patches_has_two_parts(recorded):
    errors = [PatchError(0.013, 0.007), PatchError(0.02), PatchError(0.0, 0.011)]
    recorded({"whole": [error.whole for error in errors],
              "bands": [error.among_bands(3) for error in errors],
              "mean": chart_equations.mean_error(np.array([0.5, 2.0, 0.7]), errors),
              "possible": chart_equations.patch_errors((0.003, 0.02))})


def test_field_terms_here_and_beyond(recorded):
    places, beyond = positions(9), positions(5, 3) * [2.0, -1.5]
    recorded({"terms": chart_equations.field_terms(places),
              "beyond": chart_equations.field_terms_at(beyond, places)})


def test_the_equations_of_a_photo(recorded):
    photo = uneven_photo(9)
    samples = patch_samples(photo)
    made = {name: chart_equations.chart_equations(
        samples, photo.reflectances, warm_light(), photo.irradiance, UNEVEN, **more)
        for name, more in (("even", {}), ("field", {"positions": positions(9)}),
                           ("grid", {"positions": positions(9), "rows": 3}))}
    chosen = np.arange(9) % 3 != 1
    recorded(made | {"some": chart_equations.some_patches(made["grid"], chosen)})


@pytest.mark.parametrize("field, glare", [(True, True), (True, False), (False, True),
                                          (False, False)])
def test_signals_and_their_derivatives(recorded, field, glare):
    photo, rng = uneven_photo(8, field=field, glare=glare), np.random.default_rng(RNG_SEED)
    basis = rng.uniform(0, 1, (UNEVEN.nm.size, 4))
    design = chart_equations.unlit_design(photo, basis)
    sd = chart_equations.nuisance_sd(photo)
    coefficients, nuisance = rng.uniform(0.1, 1, (3, 4)), sd * rng.standard_normal(sd.size)
    signal, slope = chart_equations.predicted_signal(photo, design, coefficients, -0.37, nuisance)
    recorded({"design": design, "sd": sd, "signal": signal, "slope": slope,
              "noise": chart_equations.noise_covariance(photo, PatchError(0.013, 0.006)),
              "pixels": chart_equations.noise_covariance(photo, PatchError(0.0))})
    # the slope is that of the signal
    step = 1e-6
    unit = np.eye(13 + sd.size)
    ahead, behind = ([chart_equations.predicted_signal(
        photo, design, coefficients + sign * one[:12].reshape(3, 4), -0.37 + sign * one[12],
        nuisance + sign * one[13:])[0] for one in step * unit] for sign in (1, -1))
    np.testing.assert_allclose(slope, (np.array(ahead) - behind).T / (2 * step),
                               atol=1e-7 * np.abs(slope).max())


# ---- checks before and after a fit ---------------------------------------------------------------

def test_signals_that_cannot_be_a_chart_are_refused(recorded):
    signal = np.random.default_rng(4).uniform(0.1, 1, (10, 3))
    table = {f"{count} patches": said(photo_checks.require_patches, signal[:count])
             for count in (1, 7, 8, 9)}
    for value in (np.nan, 0.0, -0.01, 1e-12):
        for band in range(3):
            changed = signal.copy()
            changed[4 + band, band] = value
            table[f"{value} in band {band}"] = said(photo_checks.require_patches, changed)
    rng = np.random.default_rng(6)
    for spread in (0.0, 9.0e-4, 9.8e-4, 1.02e-3, 1.1e-3):
        for first, second in ((0, 1), (2, 0), (1, 2)):
            off = rng.standard_normal(10)
            off = (off - off.mean()) / off.std()
            alike = signal.copy()
            alike[:, second] = 3 * alike[:, first] * (1 + spread * off)
            table[f"bands {first} {second} alike within {spread}"] = said(
                photo_checks.require_apart, alike)
    recorded(table)


def lamp(values, quantity=Quantity.RELATIVE):
    return Spectrum(UNEVEN, values, quantity, "lamp.csv")


def test_lights_that_cannot_be_one_are_refused(recorded):
    top = warm_light() / warm_light().max()
    table = {}
    for value in (-0.0105, -0.0099, -1e-9, 0.0, 9.8e-4, 1.02e-3):
        for name, where in (("start", UNEVEN.nm < 421), ("middle", np.abs(UNEVEN.nm - 540) < 9),
                            ("end", UNEVEN.nm > 683)):
            table[f"{value} of the largest at the {name}"] = said(
                photo_checks.light_power, lamp(np.where(where, value, top)), UNEVEN)
    for most in (49.5, 50.5):
        for quantity in (Quantity.IRRADIANCE, Quantity.RELATIVE):
            table[f"{most} {quantity.name}"] = said(photo_checks.light_power,
                                                    lamp(most * top, quantity), UNEVEN)
    table["none"] = said(photo_checks.light_power, lamp(0 * top), UNEVEN)
    two = np.where((UNEVEN.nm < 433) | (np.abs(UNEVEN.nm - 600) < 20), 0.0, top)
    table["two ranges"] = photo_checks.dark_ranges(two, UNEVEN)
    table["unlit"] = photo_checks.unlit(two)
    recorded(table)


def test_a_photo_that_is_not_explained_is_refused(recorded):
    rng = np.random.default_rng(7)
    signal = np.geomspace(1, 0.004, 11)[:, None] * [0.5, 1.0, 0.8]
    rms = photo_checks.disagreement(signal, signal * (1 + 0.1 * rng.standard_normal(signal.shape)))
    recorded({"rms": rms} | {f"{off} {reading}": said(
        photo_checks.refuse_disagreement, "no camera explains it", off, 4.567, reading)
        for off in (0.04321, rms, 1.234) for reading in (None, "mirrored left to right")})


# ---- patches left out ----------------------------------------------------------------------------

def test_patches_left_out_of_linear_equations(recorded):
    rng = np.random.default_rng(12)
    root = rng.standard_normal((9, 9))
    inverse, weighted = np.linalg.inv(root @ root.T + np.eye(9)), rng.standard_normal((4, 9))
    gain, covariance = rng.standard_normal((6, 9)), np.diag(np.arange(1.0, 7.0))
    rows = slice(3, 6)
    weights = left_out.weights_without(inverse, weighted, rows)
    recorded({"weights": weights,
              "one": left_out.weights_without(inverse, weighted[1], rows),
              "covariance": left_out.covariance_without(covariance, gain, inverse, rows)})
    # what is left out weighs nothing
    np.testing.assert_allclose(weights[:, rows], 0, atol=1e-12)


def without(field=True, glare=True):
    """The record of patches of two photos, of any state."""
    photo, rng = uneven_photo(6, field=field, glare=glare), np.random.default_rng(13)
    size = 1 + chart_equations.nuisance_sd(photo).size
    basis = rng.uniform(0, 1, (UNEVEN.nm.size, 4))
    patches = []
    for patch in range(6):
        state = np.r_[rng.uniform(0.2, 1, 12), 0.3, 0.05 * rng.standard_normal(size - 1)]
        root = rng.standard_normal((12 + size, 12 + size)) / 50
        patches.append(left_out.patch_moments(photo, patch, state, root @ root.T, 12))
    two = [chart_equations.some_patches(photo, np.arange(6) < 4),
           chart_equations.some_patches(photo, np.arange(6) >= 4)]
    return photo, patches, left_out.gathered(two, basis, PatchError(0.011, 0.004), patches)


@pytest.mark.parametrize("field, glare", [(True, True), (False, True), (True, False)])
def test_what_is_known_of_patches_left_out(recorded, field, glare):
    photo, patches, record = without(field, glare)
    recorded({"patches": patches, "record": record, "response": record.response,
              "predicted": record.predicted(photo.reflectances),
              "error": sizes(record.error_covariance(photo.reflectances)),
              "order": left_out.in_chart_order(record, np.array([1, 0, 1, 1, 0, 1], bool))})


def test_a_covariance_below_zero_by_rounding_counts_as_none(recorded):
    photo, _, record = without()
    lower = dataclasses.replace(record, covariance=record.covariance - 0.002 * np.eye(15))
    assert isinstance(lower, PatchesWithout)
    recorded(lower.error_covariance(photo.reflectances))


# ---- splines -------------------------------------------------------------------------------------

@pytest.mark.parametrize("method", ["paper", "nonnegative", "smooth"])
@pytest.mark.parametrize("some", [False, True])
def test_curves_by_splines(recorded, method, some):
    photo = uneven_photo(19, field=False, glare=False, relative=0.002)
    used = np.arange(19) % 6 != 2
    more = {"coefficients": 8, "used": used} if some else {}
    fit, scale, left = fit_sensitivities(patch_samples(photo), photo.reflectances, warm_light(),
                                         photo.irradiance, UNEVEN, method=method, **more)
    # curves of patches that hardly determine them: 1e-10 of round-off, times the condition number
    recorded({"fit": fit, "scale": scale, "left": left, "bands": sizes(fit.covariance),
              "standing": fit.outcome}, rtol=1e-5)
    signal = scale.value * (photo.reflectances * photo.power) @ fit.curves.T
    np.testing.assert_allclose(signal * (photo.irradiance / np.pi)[:, None],
                               photo.signal * (1 - fit.residuals), rtol=1e-9)


def test_solvers_of_one_band(recorded):
    rng = np.random.default_rng(14)
    design, sigma = rng.uniform(0, 1, (13, 5)), 0.01 * rng.uniform(0.5, 2, 13)
    rough = np.diag([1.0, 20.0, 3.0, 50.0, 7.0])
    cases = {}
    for name, truth in (("inside", [0.4, 1.0, 0.2, 0.7, 0.3]), ("at zero", [0.4, -0.6, 0.9, 0, 1])):
        signal = design @ truth
        for misfit in (0.3, 3.0):
            noisy = signal + misfit * sigma * rng.standard_normal(13)
            cases[f"{name}, misfit {misfit}"] = {
                "paper": spline_fit._solve_paper(design, noisy, sigma),
                "nonnegative": spline_fit._solve_nonnegative(design, noisy, sigma),
                "smooth": spline_fit._solve_smooth(design, noisy, sigma, roughness=rough)}
    signals = np.stack([noisy, 0.6 * noisy[::-1] + 0.2], axis=1)
    errors = np.stack([sigma, 2 * sigma[::-1]], axis=1)
    cases["left out"] = spline_fit._left_out_error(design, signals, errors, rough)
    cases["roughness"] = spline_fit._best_roughness(design, signals, errors)
    recorded(cases)


def test_what_splines_cannot_determine_is_refused(recorded):
    photo = uneven_photo(19, field=False, glare=False)
    samples = patch_samples(photo)

    def fit(light=None, patches=19, coefficients=10, method="paper", shown=samples):
        return said(lambda: fit_sensitivities(
            shown, photo.reflectances, warm_light() if light is None else light, photo.irradiance,
            UNEVEN, coefficients, method=method, used=np.arange(19) < patches)[0].condition_number)

    table = {f"{patches} patches, {method}": fit(patches=patches, method=method)
             for patches in (7, 8, 9) for method in ("paper", "smooth")}
    table |= {f"{coefficients} coefficients, {method}": fit(
        patches=9, coefficients=coefficients, method=method)
        for coefficients in (11, 12) for method in ("nonnegative", "smooth")}
    for width in (24.9, 25.2, 60.0):
        narrow = np.exp(-0.5 * ((UNEVEN.nm - 520) / width) ** 2)
        table |= {f"light of {width} nm, {method}": fit(narrow, method=method)
                  for method in ("paper", "smooth")}
    table["another method"] = fit(method="spline")
    dead = dataclasses.replace(samples, mean=np.column_stack(
        [samples.mean[:, :2], 1e-14 * samples.mean[:, 2] ** 2]))
    table["a dead band"] = fit(shown=dead, method="nonnegative")
    # a condition number of 1e8, the limit, loses eight digits
    recorded(table, rtol=1e-4)


def test_whether_light_and_chart_determine_ten_splines(recorded):
    photo = uneven_photo(19)
    blue = dataclasses.replace(photo, power=blue_light() * UNEVEN.weights_nm)
    found = [condition_number(one, UNEVEN) for one in (photo, blue)]
    recorded(found)
    design = (photo.reflectances * photo.power) @ basis_matrix(UNEVEN.nm, 10)[:, 1:-1]
    assert found[0] == pytest.approx(np.linalg.cond(design), rel=1e-9)


def test_a_condition_number_of_a_hundred_makes_a_fit_ill_posed(recorded):
    photo = uneven_photo(19, field=False, glare=False, relative=0.001)
    table = {}
    for width in np.linspace(40, 140, 6):
        light = np.exp(-0.5 * ((UNEVEN.nm - 550) / width) ** 2)
        fit, *_ = fit_sensitivities(patch_samples(photo), photo.reflectances, light,
                                    photo.irradiance, UNEVEN, 6, method="nonnegative")
        table[f"{width:g}"] = (fit.condition_number, fit.outcome)
    recorded(table, rtol=1e-5)


def test_predictions_of_unknown_surfaces_err_as_patches_that_were_left_out(recorded):
    rng = np.random.default_rng(15)
    residuals = 0.02 * rng.standard_normal((9, 3)) + [0.01, -0.02, 0.005]
    table = {}
    for share in (0.0294, 0.0306):      # below and above 3 % of the brightest
        mean = np.linspace(0.2, 0.9, 9)[:, None] * [1.0, 0.7, 0.4]
        mean[2, 1] = share * mean[:, 1].max()
        photo = uneven_photo(9)
        shown = dataclasses.replace(patch_samples(photo), mean=mean,
                                    covariance_of_mean=covariances(mean, 0.01))
        table[f"{share}"] = relative_prediction_covariance(residuals, shown)
    recorded(table)
    np.testing.assert_allclose(table["0.0306"], residuals.T @ residuals / 9, rtol=1e-12)
