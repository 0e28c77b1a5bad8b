"""The stated covariance of a material's signal against signals recomputed with every cause
perturbed.
"""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.measure.surfaces.surface_signals import (
    errors_by_cause,
    measurement,
    relative_errors,
    scene_signals,
)
from spectrabox.radiometry.error_model import (
    REPEATABILITY,
    light_covariance,
    sensitivity_covariance,
    with_common_error,
)
from spectrabox.radiometry.grid import basis_matrix, interpolation_matrix, visible_grid
from spectrabox.radiometry.interreflection import response_matrix, white_signal
from spectrabox.radiometry.records.calibration import Calibration, LightScale, SensitivityFit
from spectrabox.radiometry.records.scenes import JointReconstruction
from spectrabox.radiometry.records.spectra import Outcome, Quantity, Spectrum, SurfaceSignals

GRID = visible_grid(5)
BASIS = basis_matrix(GRID.nm, 12)
LIGHTS = np.array([np.ones(GRID.nm.size), 0.2 + ((GRID.nm - 400) / 300) ** 2])
SCALE_ERRORS = (0.01, 0.03)
REFLECTANCE = 0.1 + 0.6 / (1 + np.exp((580 - GRID.nm) / 20))
DRAWS = 20_000


def curves_and_covariance():
    """Coefficients (3, 12) of three bands, and a covariance that ties neighbours and bands
    together.
    """
    places = np.linspace(400, 700, 12)
    coefficients = np.exp(-0.5 * ((places - np.array([[600.0], [540.0], [460.0]])) / 40) ** 2)
    rng = np.random.default_rng(5)
    mixed = rng.standard_normal((36, 50))
    return coefficients, (0.004**2 / 50) * mixed @ mixed.T


def calibration(light, coefficients, covariance):
    fit = SensitivityFit(GRID, coefficients @ BASIS.T, BASIS, coefficients, covariance, None, None,
                         None, None,
                         "given", Outcome.CONVERGED)
    return Calibration(fit, Spectrum(GRID, light, Quantity.RELATIVE, "lamp"), None,
                       0.01**2 * np.eye(3), ())


def joint(coefficients, photo=None, model=None):
    """Two photos of one material under two lights."""
    bands = np.vstack([response_matrix(GRID, coefficients @ BASIS.T, light) for light in LIGHTS])
    response = bands / white_signal(bands)[:, None]
    views = tuple(SimpleNamespace(light_scale=LightScale(2.0, 2.0 * error, None, "chart"))
                  for error in SCALE_ERRORS)
    zero = np.zeros((1, 6, 6))
    return JointReconstruction(
        views, ("a", "b"), ("paint",), (False,), GRID, REFLECTANCE[None], tuple("RGBrgb"),
        np.repeat([0, 1], 3), response, (response @ REFLECTANCE)[None], zero if photo is None
        else photo, zero if model is None else model)


def seen(made):
    """The signals of a reconstruction, their errors left open."""
    return SurfaceSignals(made.materials, made.known, made.grid, made.spectra, made.bands,
                          made.view_of_band, made.response, made.signal, {})


def signals_of(coefficients):
    """Signals (T, 6) relative to white that curves of coefficients (T, 3, 12) predict, by plain
    sums.
    """
    curves = coefficients @ BASIS.T
    rows = [np.einsum("tkp,p->tk", curves, light * GRID.weights_nm * spectrum) for light in LIGHTS
            for spectrum in (REFLECTANCE, np.ones_like(REFLECTANCE))]
    return np.hstack([rows[0] / rows[1], rows[2] / rows[3]])


def test_the_error_of_the_curves_is_that_of_signals_with_perturbed_curves():
    coefficients, covariance = curves_and_covariance()
    calibrations = [calibration(light, coefficients, covariance) for light in LIGHTS]
    stated = sensitivity_covariance(calibrations, seen(joint(coefficients)))[0]
    draws = np.random.default_rng(1).multivariate_normal(coefficients.ravel(), covariance, DRAWS)
    scatter = np.cov(signals_of(draws.reshape(DRAWS, 3, 12)), rowvar=False)
    errors = np.sqrt(np.diag(scatter))
    # 20 000 draws tell a variance to 0.5 % of its root (1 sigma); the first order costs 1 %.
    np.testing.assert_allclose(np.sqrt(np.diag(stated)), errors, rtol=0.03)
    # Correlations, also between the two photos: 0.7 % (1 sigma) by the draws.
    np.testing.assert_allclose(stated / np.outer(errors, errors),
                               scatter / np.outer(errors, errors), atol=0.03)


def test_all_causes_together_are_the_scatter_of_photos_read_with_wrong_scales_and_curves():
    coefficients, covariance = curves_and_covariance()
    calibrations = [calibration(light, coefficients, covariance) for light in LIGHTS]
    photo = np.diag(np.square([0.002, 0.003, 0.001, 0.004, 0.002, 0.003]))
    model = np.kron(np.eye(2), 0.01**2 * (0.5 + 0.5 * np.eye(3)))
    answer = joint(coefficients, photo[None], model[None])
    rng = np.random.default_rng(2)
    truth = answer.signal[0]
    noise = rng.multivariate_normal(np.zeros(6), photo, DRAWS)
    disagreement = rng.multivariate_normal(np.zeros(6), model, DRAWS)
    scale = 1 + np.repeat(rng.standard_normal((DRAWS, 2)) * SCALE_ERRORS, 3, axis=1)
    curves = rng.multivariate_normal(coefficients.ravel(), covariance, DRAWS).reshape(DRAWS, 3, 12)
    # What the photo seems to say, less what the right spectrum predicts: what a sampler takes for
    # noise.
    read = (truth * (1 + disagreement) + noise) / scale - signals_of(curves)
    signals = scene_signals(answer, calibrations)
    stated = measurement(signals, 0).noise_covariance
    scatter = np.cov(read, rowvar=False)
    errors = np.sqrt(np.diag(scatter))
    # As above: 2 % is 4 sigma; dividing by a scale that errs by 3 % is first order to 1 %.
    np.testing.assert_allclose(np.sqrt(np.diag(stated)), errors, rtol=0.03)
    np.testing.assert_allclose(stated / np.outer(errors, errors),
                               scatter / np.outer(errors, errors), atol=0.05)
    parts = errors_by_cause(signals, 0)
    total = np.sqrt(np.sum([np.square(part) for part in relative_errors(signals, 0).values()],
                           axis=0))
    # Round-off.
    np.testing.assert_allclose(total, np.sqrt(np.diag(sum(parts.values()))) / truth, rtol=1e-12)


def test_the_scale_of_one_photo_says_nothing_of_another():
    coefficients, covariance = curves_and_covariance()
    calibrations = [calibration(light, coefficients, covariance) for light in LIGHTS]
    parts = errors_by_cause(scene_signals(joint(coefficients), calibrations), 0)
    scale = parts["light scale"]
    np.testing.assert_array_equal(scale[:3, 3:], 0)
    relative = np.sqrt(np.diag(scale)) / joint(coefficients).signal[0]
    # Round-off.
    assert relative == pytest.approx(np.repeat(SCALE_ERRORS, 3), rel=1e-12)


def test_curves_without_covariance_err_by_the_stated_share_of_the_brightest_band():
    coefficients, _ = curves_and_covariance()
    answer = joint(coefficients)
    covariance = sensitivity_covariance([calibration(light, coefficients, None)
                                         for light in LIGHTS], seen(answer))[0]
    brightest = np.repeat([answer.signal[0, :3].max(), answer.signal[0, 3:].max()], 3)
    # round-off
    np.testing.assert_allclose(covariance, np.diag((0.01 * brightest) ** 2), rtol=1e-12)


def test_the_error_of_a_lights_readings_is_that_of_signals_under_perturbed_readings():
    coefficients, covariance = curves_and_covariance()
    coarse = visible_grid(20)
    readings = np.array([np.interp(coarse.nm, GRID.nm, light) for light in LIGHTS])
    error = 0.05 * readings
    calibrations = [dataclasses.replace(calibration(light, coefficients, covariance),
                                        light=Spectrum(
                                            coarse, light, Quantity.RELATIVE, "meter",
                                            standard_error))
                    for light, standard_error in zip(readings, error, strict=True)]
    stated = light_covariance(calibrations, seen(joint(coefficients)))[0]
    rng = np.random.default_rng(4)
    curves = coefficients @ BASIS.T * GRID.weights_nm
    signals = []
    for light, standard_error in zip(readings, error, strict=True):
        drawn = light + standard_error * rng.standard_normal((DRAWS, coarse.nm.size))
        fine = drawn @ interpolation_matrix(coarse.nm, GRID.nm).T
        signals.append((fine * REFLECTANCE) @ curves.T / (fine @ curves.T))
    scatter = np.cov(np.hstack(signals), rowvar=False)
    # 20 000 draws tell a root variance to 0.5 %; the lights in the reconstruction are on the fine
    # grid, 1 to 2 % apart.
    np.testing.assert_allclose(np.sqrt(np.diag(stated)), np.sqrt(np.diag(scatter)), rtol=0.04)
    np.testing.assert_array_equal(stated[:3, 3:], 0)


def test_what_the_light_did_between_the_photos_befalls_all_bands_of_a_photo_and_no_other():
    coefficients, covariance = curves_and_covariance()
    calibrations = [dataclasses.replace(calibration(light, coefficients, covariance),
                                        light_scale=LightScale(2.0, 0.02, None, "chart"))
                    for light in LIGHTS]
    answer = joint(coefficients)
    scales = (with_common_error(answer.views[0].light_scale, REPEATABILITY, 0.04),
              answer.views[1].light_scale)
    answer = dataclasses.replace(answer, views=tuple(SimpleNamespace(light_scale=scale)
                                                     for scale in scales))
    parts = errors_by_cause(scene_signals(answer, calibrations), 0)
    signal = answer.signal[0]
    # Round-off. Curves that were fitted give every band its own scale; the lamp's error is common.
    np.testing.assert_allclose(parts[REPEATABILITY][:3, :3],
                               0.04**2 * np.outer(signal[:3], signal[:3]))
    np.testing.assert_array_equal(parts[REPEATABILITY][3:], 0)
    np.testing.assert_allclose(parts["light scale"][:3, :3],
                               np.diag((SCALE_ERRORS[0] * signal[:3]) ** 2))
