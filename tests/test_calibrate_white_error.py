"""The light scale's standard error is that of a perfect reflector's signal, curves included."""
import numpy as np
import pytest
from calibrate_cameras import GRID, NODES, cameras, led, on_grid, reflectances, samples, signals

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.prior.learnt_prior import build_prior
from spectrabox.radiometry.records.spectra import Quantity, Spectrum

SCALE, NOISE = 3.7, 0.01
SURFACES = reflectances()
IRRADIANCE = 0.05 * np.linspace(0.9, 1.1, 24)
POWER = led()


def white_errors(method, relative_noise, camera, curves, known):
    """Relative errors (3,) of the signals of a white surface, and the stated standard error."""
    truth = on_grid(curves / curves.max())
    signal = SCALE * signals(truth, POWER, SURFACES) * (IRRADIANCE / np.pi)[:, None]
    signal *= 1 + relative_noise * np.random.default_rng(500 + camera).standard_normal(signal.shape)
    lamp = Spectrum(GRID, POWER, Quantity.RADIANCE, "lamp")
    fit = calibrate_chart([ChartPhoto(samples(signal), SURFACES, lamp, IRRADIANCE)], GRID,
                          method, known)
    fitted = fit.scale.value * fit.calibration.sensitivity.curves @ (POWER * GRID.weights_nm)
    return fitted / (SCALE * truth
                     @ (POWER * GRID.weights_nm)) - 1, fit.scale.standard_error / fit.scale.value


@pytest.mark.usefixtures("light_as_stated")
@pytest.mark.parametrize("method", ["prior", "smooth"])
def test_white_is_known_as_well_as_stated(method):
    # Thirty makers: with one, the prior would widen every error for knowing so few.
    known = build_prior(NODES, cameras(30, 1), tuple(f"maker{index} one" for index in range(30)),
                        source="simulated", licence="none") if method == "prior" else None
    estimate = [white_errors(method, NOISE, camera, curves, known)
                for camera, curves in enumerate(cameras(16, 95))]
    normal = np.array([errors / stated for errors, stated in estimate])
    # 48 errors in standard errors: their rms is 1 +- 0.10; three of these either way.
    assert 0.7 < np.sqrt(np.mean(normal**2)) < 1.3
