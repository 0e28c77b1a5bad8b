"""Charts made before and after November 2014: which of them a photo shows."""
import numpy as np
import pytest
from calibrate_cameras import GRID, cameras_at_10_nm, led, on_grid, prior, samples, signals

from spectrabox.calibrate.chart_calibration import CalibrationOptions
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.measure.camera import fit_camera
from spectrabox.radiometry.appearance import tristimulus_weights
from spectrabox.radiometry.chart import AFTER, AFTER_2014, BEFORE, CLASSIC, chart_reflectances
from spectrabox.radiometry.published.published_tables import published_colours
from spectrabox.radiometry.records.spectra import Quantity, Spectrum

GENERATIONS = {name: chart_reflectances(name, GRID) for name in CLASSIC.generations}


def test_colours_of_the_later_chart_have_changed_as_published_and_spectra_smoothly():
    earlier, later = GENERATIONS.values()
    to_xyz = tristimulus_weights(GRID.nm, "D50").T
    # Newton's method ends at round-off; 1e-9 is the ridge of its matrix of about 1
    np.testing.assert_allclose((later @ to_xyz) / (earlier @ to_xyz),
                               published_colours(AFTER) / published_colours(BEFORE), rtol=1e-7)
    change = np.log(later / earlier)
    assert np.abs(np.diff(change, axis=1)).max() < 0.005 and np.abs(change).max() < 0.2


@pytest.mark.parametrize("shown", CLASSIC.generations)
def test_a_photo_says_of_which_generation_its_chart_is(shown):
    curves, rng = cameras_at_10_nm(1, 80)[0], np.random.default_rng(81)
    signal = signals(on_grid(curves), led(), GENERATIONS[shown])
    signal *= 1 + 0.01 * rng.standard_normal(signal.shape)
    photo = ChartPhoto(samples(signal), GENERATIONS["BabelColor Average"],
                       Spectrum(GRID, led(), Quantity.RELATIVE, "lamp.csv"))
    options = CalibrationOptions(prior=prior())
    fit = fit_camera([photo], GRID, options, generations=GENERATIONS)
    assert fit.generation.reference == shown and fit.generation.words.startswith(
        f"chart reference {shown}: explains the chart better than")
    assert fit_camera([photo], GRID, options).generation is None
    if shown == AFTER_2014:
        stated = fit_camera([photo], GRID, options)
        off = [np.sqrt(np.mean((one.sensitivity.curves - on_grid(curves / curves.max())) ** 2))
               for one in (fit, stated)]
        assert off[0] < off[1]
