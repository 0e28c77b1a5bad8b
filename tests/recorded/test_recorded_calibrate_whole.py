"""Recorded: whole calibrations by every method, what they say of themselves, what is refused."""
import dataclasses

import numpy as np
import pytest
from calibrate_cameras import GRID
from uneven_charts import (
    UNEVEN,
    bands,
    blue_light,
    camera,
    covariances,
    patch_samples,
    sizes,
    small_prior,
    surfaces,
    uneven_photo,
    warm_light,
)

from spectrabox.calibrate import calibration as whole
from spectrabox.calibrate.calibration import (
    CalibrationOptions,
    ChartPhoto,
    calibrate_chart,
    calibration_from_curves,
)
from spectrabox.calibrate.chart_equations import field_terms
from spectrabox.calibrate.curve_band import curve_band
from spectrabox.calibrate.prior.prior_fit import CurvePosterior
from spectrabox.calibrate.products import stated_light
from spectrabox.radiometry.chart import patch_centres_uv
from spectrabox.radiometry.errors import CalibrationError, CheckError, InputError
from spectrabox.radiometry.records import PatchSamples, Quantity, Spectrum, UnknownLight

# Gauss-Newton, and condition numbers up to 1e8 on the way.
ITERATED = 1e-4
CANCELLED = 3e-3    # what is left of a variance of 9, of an unknown exposure


def said(call, *arguments, **more):
    try:
        return call(*arguments, **more)
    except (CalibrationError, CheckError, InputError) as error:
        return f"{type(error).__name__}: {error}"


def spectrum(values, name="lamp.csv", quantity=Quantity.RELATIVE):
    return Spectrum(UNEVEN, values, quantity, name)


def shot(seed=1, *, curves=None, light=None, stated=None, even=False, kept_out=None, level=0.7,
         matrix=None, relative=0.006):
    """A photo of a Classic chart; ``stated`` is the light that the operator gives."""
    rng = np.random.default_rng(seed)
    power = np.interp(GRID.nm, UNEVEN.nm, warm_light() if light is None else light)
    patches = surfaces(24, GRID, 7)
    made = camera(GRID) if curves is None else curves
    irradiance = rng.uniform(2, 4, 24)
    bare = patches @ (made * power * GRID.weights_nm).T
    if even:
        bare *= irradiance[:, None]
    else:
        bare *= np.exp(field_terms(patch_centres_uv()) @ [0.06, -0.04, 0.03, -0.05, 0.02])[:, None]
    bare *= level / bare.max()
    signal = bare * (1 + relative * rng.standard_normal(bare.shape)) + bare.max(axis=0) * 0.006
    samples = PatchSamples(signal, covariances(signal, relative, seed), 90.0 + np.arange(24),
                           np.zeros(signal.shape), np.zeros(signal.shape), matrix)
    said_of = spectrum(warm_light() if light is None else light) if stated is None else stated
    return ChartPhoto(samples, patches, said_of, irradiance if even else None, kept_out)


def of_calibration(made):
    """All of a calibration but covariances that only round-off tells apart."""
    fields = {field.name: getattr(made, field.name) for field in dataclasses.fields(made)}
    calibration = fields.pop("calibration")
    fit = calibration.sensitivity
    without = fields.pop("without")
    prior_fit = fields.pop("prior_fit")
    white = made.white
    shown = {name: getattr(fit, name) for name in (
        "curves", "coefficients", "standard_error", "residuals", "held_out_residuals",
        "condition_number", "method", "outcome")}
    return fields | shown | {
        "light": calibration.light.source, "scaled": calibration.light_scale is not None,
        "covariance": calibration.relative_covariance, "checks": calibration.checks,
        "doubts": calibration.doubts, "posterior": calibration.light_posterior,
        "standing": made.prior_standing,
        "without": {field.name: getattr(without, field.name)
                    for field in dataclasses.fields(without) if field.name != "covariance"},
        "chi": None if prior_fit is None else prior_fit.chi_square,
        "white": None if white is None else (white.level, white.field, white.glare,
                                             sizes(white.covariance)["log sd"])}


def errors(made, reflectances):
    fit = made.calibration.sensitivity
    return {"curves": None if fit.covariance is None else sizes(fit.covariance)["log sd"],
            "left out": sizes(made.without.error_covariance(reflectances))}


KEPT_OUT = np.isin(np.arange(24), (3, 10, 22))


# ---- by every method -----------------------------------------------------------------------------

@pytest.mark.parametrize("method, even", [
    *((method, True) for method in ("prior", "paper", "nonnegative", "smooth", "file")),
    ("prior", False), ("smooth", False), ("file", False)])
def test_a_whole_calibration(recorded, light_as_stated, method, even):
    photo = shot(even=even, kept_out=KEPT_OUT if even else None)
    options = CalibrationOptions("prior" if method == "file" else method, small_prior(),
                                 8 if even else 10, camera(GRID) if method == "file" else None)
    made = calibrate_chart([photo], GRID, options)
    recorded(of_calibration(made), rtol=ITERATED)
    recorded(errors(made, photo.reflectances), rtol=CANCELLED, case="errors")
    recorded({"used": photo.used, "lit": photo.lit}, case="photo")
    assert (made.calibration.light_scale is None) == (not even)
    np.testing.assert_allclose(made.held_out, made.without.predicted(photo.reflectances)
                               if method != "file" else made.predicted, rtol=1e-6)


@pytest.fixture
def fewer_pairs(monkeypatch):
    """A tenth of the cameras and lamps by which a stated light is doubted."""
    made = stated_light.product_prior
    monkeypatch.setattr(stated_light, "product_prior",
                        lambda *arguments: made(*arguments, components=600))


def test_a_calibration_of_two_photos_as_it_is_by_default(recorded, fewer_pairs):
    photos = [shot(), shot(2, light=blue_light(), even=True, level=0.4)]
    made = calibrate_chart(photos, GRID)
    recorded({"checks": made.calibration.checks, "doubts": made.calibration.doubts,
              "curves": made.calibration.sensitivity.curves, "scale": made.scale,
              "held out": made.held_out, "families": made.prior_standing.families[:4],
              "share": made.prior_standing.share}, rtol=ITERATED)


@pytest.mark.parametrize("count", [4, 6])
def test_a_calibration_of_bands_of_which_no_camera_is_known(recorded, count):
    photo = shot(curves=bands(count, GRID), kept_out=KEPT_OUT)
    made = calibrate_chart([photo], GRID)
    recorded({"checks": made.calibration.checks, "curves": made.calibration.sensitivity.curves,
              "scale": made.scale, "families": made.prior_standing,
              "covariance": made.calibration.relative_covariance}, rtol=ITERATED)


@pytest.mark.parametrize("light", [UnknownLight(), UnknownLight("halogen"),
                                   UnknownLight(None, 3400.0)])
def test_a_calibration_under_an_unknown_light(recorded, light):
    photos = [shot(stated=light, kept_out=KEPT_OUT), shot(2, stated=light, level=0.4)]
    made = calibrate_chart(photos if light.kind else photos[:1], GRID,
                           CalibrationOptions(prior=small_prior()))
    recorded(of_calibration(made), rtol=CANCELLED)


def test_an_unknown_light_on_bands_of_which_no_camera_is_known(recorded):
    made = calibrate_chart([shot(curves=bands(4, GRID), stated=UnknownLight())], GRID)
    recorded({"checks": made.calibration.checks, "light": made.calibration.light,
              "posterior": made.calibration.light_posterior,
              "curves": made.calibration.sensitivity.curves}, rtol=ITERATED)


def test_a_calibration_from_curves_alone(recorded):
    made = calibration_from_curves(UNEVEN, camera(), spectrum(blue_light()), 0.0234)
    recorded(made)


# ---- doubts --------------------------------------------------------------------------------------

def test_what_makes_a_calibration_doubtful(recorded, fewer_pairs):
    from_xyz = np.array([[1.2, -0.4, -0.1], [-0.5, 1.4, 0.1], [0.0, 0.1, 0.7]])
    table = {}
    for name, photo in {
            "right": shot(), "wrong light": shot(stated=spectrum(blue_light(), "blue.csv")),
            "odd camera": shot(curves=bands(3, GRID)[:, ::-1][[2, 1, 0]], relative=0.003),
            "matrix": shot(matrix=from_xyz), "other matrix": shot(matrix=from_xyz[::-1]),
            "dark": shot(light=np.where(UNEVEN.nm < 421, 0, warm_light()))}.items():
        found = said(calibrate_chart, [photo], GRID, CalibrationOptions(prior=small_prior()))
        table[name] = found if isinstance(found, str) else (found.calibration.doubts,
                                                            found.calibration.checks)
    recorded(table, rtol=1e-3)      # numbers are written with two or three digits


def test_when_a_stated_light_is_doubted(recorded, monkeypatch):
    """Of two photos each by its own evidence; of bands of which no camera is known never."""
    table = {}
    for count in (3, 4):
        shots = [shot(curves=bands(count, GRID)), shot(2, curves=bands(count, GRID),
                                                       stated=spectrum(blue_light(), "blue.csv"))]
        equations = [whole._as_equations(photo, GRID)[0] for photo in shots]
        for first, second in ((6.93, 7.07), (12.3, 7.5), (-40.0, 6.9)):
            evidence = iter((first, second))
            monkeypatch.setattr(whole, "evidence_for_another_light",
                                lambda *_, evidence=evidence: next(evidence))
            table[f"{count} bands, {first} {second}"] = whole._light_doubts(
                shots, equations, GRID, None)
    recorded(table)


# ---- refusals ------------------------------------------------------------------------------------

def test_what_no_calibration_takes_is_refused(recorded):
    def calibrated(photos, **options):
        made = said(calibrate_chart, photos, GRID, CalibrationOptions(**options))
        return made if isinstance(made, str) else "a calibration"

    unknown = UnknownLight()
    table = {f"{count} bands": calibrated([shot(curves=bands(4, GRID)[:count], relative=0.02)])
             for count in (1, 2)}
    curves = camera(GRID)
    table |= {
        "two, smooth": calibrated([shot(), shot(2)], method="smooth"),
        "two, file": calibrated([shot(), shot(2)], curves=curves),
        "method": calibrated([shot()], method="splines"),
        "unknown, paper": calibrated([shot(stated=unknown)], method="paper"),
        "unknown, file": calibrated([shot(stated=UnknownLight("led"))], curves=curves),
        "one unknown": calibrated([shot(stated=unknown), shot(2)]),
        "two unknown": calibrated([shot(stated=unknown), shot(2, stated=UnknownLight())]),
        "second unknown": said(whole._require_one_unknown, [shot(stated=unknown)] * 2, unknown,
                               CalibrationOptions()),
        "few left": calibrated([shot(kept_out=np.arange(24) > 6)], prior=small_prior()),
        "negative": calibrated([shot(stated=spectrum(warm_light() - 1))]),
        "unit": calibrated([shot(stated=spectrum(90 * warm_light(), "uW.csv",
                                                 Quantity.IRRADIANCE))])}
    recorded(table)


def test_photos_that_no_camera_explains_are_refused(recorded):
    rng = np.random.default_rng(9)
    mixed = shot(even=True)
    mixed = dataclasses.replace(mixed, samples=dataclasses.replace(
        mixed.samples, mean=rng.permutation(mixed.samples.mean)))
    mirrored = shot(2)
    mirrored = dataclasses.replace(mirrored, samples=dataclasses.replace(
        mirrored.samples, mean=mirrored.samples.mean.reshape(4, 6, 3)[:, ::-1].reshape(24, 3)))
    other = shot(4, curves=camera(GRID)[::-1] * [[1.0], [0.8], [1.1]], relative=0.001)
    table = {}
    for name, photos in {"mixed": [mixed], "mirrored": [mirrored], "second": [shot(), mirrored],
                         "other camera": [shot(relative=0.001), other]}.items():
        equations = [whole._as_equations(photo, GRID)[0] for photo in photos]
        found = said(whole.prior_calibration, equations, GRID, small_prior(6))
        table[name] = found if isinstance(found, str) else found.chi_square
    unknown = UnknownLight()
    table["unknown"] = said(lambda: calibrate_chart(
        [dataclasses.replace(mixed, light=unknown)], GRID,
        CalibrationOptions(prior=small_prior(6))).calibration.checks)
    recorded(table, rtol=CANCELLED)


def test_one_camera_that_cannot_have_taken_both_photos(recorded):
    """Each by itself is explained."""
    apart = camera(GRID).copy()
    apart[0] = np.interp(GRID.nm - 18, GRID.nm, apart[0])
    apart[2] = np.interp(GRID.nm + 14, GRID.nm, apart[2])
    photos = [shot(relative=0.001), shot(4, curves=apart, relative=0.001)]
    equations = [whole._as_equations(photo, GRID)[0] for photo in photos]
    recorded(said(lambda: whole.prior_calibration(equations, GRID, small_prior(12)).chi_square),
             rtol=CANCELLED)


# ---- bands of curves -----------------------------------------------------------------------------

def test_bands_and_draws_of_curves(recorded, light_as_stated):
    photo = shot(even=True)
    made = {method: calibrate_chart([photo], GRID, CalibrationOptions(method, small_prior()))
            for method in ("prior", "paper")}
    posterior = made["prior"].prior_fit.posterior
    # independent errors, so that draws hang on no rounding
    spreads = np.array([np.diag(np.linspace(1, 3, one.shape[0])) * 1e-5
                        for one in posterior.covariances[:2]])
    plain = CurvePosterior(posterior.basis, np.array([0.7, 0.3]), posterior.means[:2], spreads,
                           posterior.families, posterior.model_error, posterior.log_evidence,
                           posterior.best_family, posterior.best_gain_sd, posterior.best_error)
    drawn = dataclasses.replace(made["prior"], prior_fit=dataclasses.replace(
        made["prior"].prior_fit, posterior=plain))
    recorded({"default": curve_band(drawn), "seed": curve_band(drawn, 5),
              "paper": curve_band(made["paper"]), "file": curve_band(calibrate_chart(
                  [photo], GRID, CalibrationOptions(curves=camera(GRID), prior=small_prior())))},
             rtol=ITERATED)


def test_curves_as_a_table_of_patches_gives_them(recorded):
    """Patches of any number, on another grid, as spline fits take them."""
    photo = uneven_photo(20, field=False, glare=False)
    found, scale, predicted, without = whole._from_measured(
        ChartPhoto(patch_samples(photo), photo.reflectances, spectrum(warm_light()),
                   photo.irradiance, np.arange(20) == 4), warm_light(), photo.irradiance, UNEVEN,
        camera())
    recorded({"fit": found, "scale": scale, "predicted": predicted, "without": without,
              "checks": whole._checks(found, np.diag([1e-4, 4e-4, 2e-4]), scale),
              "no error": whole._checks(dataclasses.replace(found, condition_number=123.456),
                                        np.eye(3), dataclasses.replace(
                                            scale, standard_error=None))})
