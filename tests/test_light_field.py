"""The light beyond a chart, where patches are off from their reference in all bands alike."""
import numpy as np

from spectrabox.calibrate.chart_equations import FIELD_SD, field_terms
from spectrabox.calibrate.light_field import LightElsewhere, PicturePoints, light_elsewhere
from spectrabox.radiometry.chart import CLASSIC, plane_centres
from spectrabox.radiometry.records import ChartWhite

PATCHES = plane_centres(CLASSIC)
PROJECT = np.linalg.pinv(field_terms(PATCHES))      # from log light on the patches to the terms
PATCH_ERROR, BANDS = 0.01, 3
OWN = slice(BANDS, BANDS + 5)
PLACES = np.array([[1.2, 0.2], [1.6, 0.4], [2.2, 0.5]])


def _points(plane):
    return PicturePoints(plane, (plane - [1.25, 0.8]) / 1.5)


def _white(log_light, terms_covariance):
    """What a fit says of white whose patches alone tell the terms with that covariance."""
    information = np.linalg.inv(terms_covariance)
    covariance = 1e-6 * np.eye(2 * BANDS + 5)
    covariance[OWN, OWN] = np.linalg.inv(information + np.eye(5) / FIELD_SD**2)
    terms = covariance[OWN, OWN] @ information @ PROJECT @ log_light
    return ChartWhite(np.ones(BANDS), terms, np.zeros(BANDS), covariance)


def _light(white, patch_error) -> LightElsewhere:
    return light_elsewhere(white, _points(PATCHES), [_points(place[None]) for place in PLACES],
                           False, patch_error=patch_error)


def test_bands_that_err_alike_say_no_more_of_the_light_than_one():
    light = 0.1 * (PATCHES - PATCHES.mean(axis=0)) @ [1, 0.5] \
        + PATCH_ERROR * np.random.default_rng(3).standard_normal(len(PATCHES))
    of_one = PATCH_ERROR**2 * PROJECT @ PROJECT.T
    alone = _light(_white(light, of_one), 0.0)
    found = _light(_white(light, of_one / BANDS), PATCH_ERROR)
    np.testing.assert_allclose(found.field, alone.field, atol=1e-9)
    np.testing.assert_allclose(found.covariance[-3:, -3:], alone.covariance[-3:, -3:], rtol=1e-7)
    np.testing.assert_allclose(found.distances, alone.distances, atol=1e-9)
    believed = _light(_white(light, of_one / BANDS), 0.0)
    assert np.abs(believed.field - alone.field).max() > 0.005
