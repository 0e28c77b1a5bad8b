"""Two kinds of light on a chart: drifts of its colours beyond chance, and none under one lamp."""
import numpy as np
import pytest
from calibrate_cameras import GRID

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_equations import chart_equations
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.colour_drift import colour_drift
from spectrabox.calibrate.prior.camera_prior import shipped_prior
from spectrabox.calibrate.sensitivity import fit_with_prior
from spectrabox.radiometry import chart_causes
from spectrabox.radiometry.chart import CLASSIC, chart_reflectances
from spectrabox.radiometry.findings import faults
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight
from spectrabox.radiometry.spectra.named_spectra import light

REFLECTANCES = chart_reflectances("BabelColor Average", GRID)


def chart_photo(from_left, from_right, stated, seed):
    """A chart between two lamps, each 25 % brighter on its own side, patches off by 1 %."""
    prior = shipped_prior()
    curves = prior.curves(prior.means[3]).reshape(3, -1) @ interpolation_matrix(
        prior.nm, GRID.nm).T
    along = CLASSIC.centres_uv[:, 0] - CLASSIC.centres_uv[:, 0].mean()
    side = np.exp(0.25 * along / np.abs(along).max())
    signal = sum((REFLECTANCES @ (curves * light(lamp, GRID)).T) * field[:, None]
                 for lamp, field in ((from_left, 1 / side), (from_right, side)))
    signal = signal / signal.max() * (
        1 + 0.01 * np.random.default_rng(seed).standard_normal(signal.shape))
    zero = np.zeros(signal.shape)
    samples = PatchSamples(signal, np.zeros((24, 3, 3)), np.ones(24), zero, zero)
    known = UnknownLight() if stated is None else Spectrum(
        GRID, light(stated, GRID), Quantity.RELATIVE, stated)
    return ChartPhoto(samples, REFLECTANCES, known, chart=CLASSIC)


@pytest.mark.parametrize("stated", [None, "D65"])
def test_daylight_from_one_side_and_a_filament_from_the_other_are_two_kinds_of_light(stated):
    one, two = (calibrate_chart([chart_photo("D65", other, stated, 3)], GRID).calibration
                for other in ("D65", "A"))
    assert "light.one-kind" in {each.code for each in one.findings}
    # a lens that shades each colour in its own way does nearly the same to a chart that lies at one
    # side of the picture
    found = next(each for each in faults(two.findings)
                 if each.code in ("light.two-kinds", "calibration.cause"))
    assert set(found.values.get("causes", [])) <= {chart_causes.TWO_LIGHTS, chart_causes.SHADING}
    drift = found.values.get("doubts", {}).get("light.two-kinds", found.values)
    # the ratio of blue to red of D65 is about 4 times that of A, and each gives 56 to 44 % of the
    # light at its side: the ratio changes by tens of percent, of which a fit with one light keeps
    # a part as patches that are off
    assert 0.1 < drift["drift"] < 0.6


def test_one_kind_of_light_that_falls_off_is_seldom_taken_for_two():
    power, prior = light("LED-B3", GRID), shipped_prior()
    chances = []
    for seed in range(10):
        photo = chart_photo("LED-B3", "LED-B3", "LED-B3", seed)
        equations = chart_equations(photo.samples, REFLECTANCES, power, np.full(24, np.pi), GRID,
                                    positions=CLASSIC.centres_uv)
        fit = fit_with_prior([equations], prior, GRID)
        chances.append(colour_drift(fit.posterior, [equations], 0)[1])
    # uniform between 0 and 1 if the fit's errors are as stated; the fit keeps errors that are
    # larger than made for possible, so that one-sided: 3 of 10 below 0.01 have a chance of 1e-4
    assert np.sum(np.array(chances) < 0.01) < 3
