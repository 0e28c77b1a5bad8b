"""Before shooting: how well this chart under this light will determine a camera.

And what light of a second photo would help.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from spectrabox.calibrate.chart_consistency import unlit, wavelength_ranges
from spectrabox.calibrate.chart_equations import ChartEquations, field_terms, unlit_design
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.prior.curve_posterior import curve_variance
from spectrabox.calibrate.prior.prior_fit import expected_covariance
from spectrabox.calibrate.spline_fit import condition_number
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.radiometry.shaped import Record

NORMAL_QUANTILE = 1.645      # of a 90 % band, two-sided


@dataclass(frozen=True, eq=False)
class Preflight(Record):
    """Expected result of a chart photo that has not been taken."""

    expected_error: Annotated[np.ndarray, "K"]      # relative RMSE, of a camera like those measured
    unlike_error: Annotated[np.ndarray, "K"]        # the same of a camera unlike them
    half_width: Annotated[np.ndarray, "K P"]        # of the 90 % band, curves of largest value 1
    condition_number: float
    unlit_nm: tuple[tuple[float, float], ...]
    second_lights: tuple[tuple[str, float], ...]    # mean error with that light added, best first


def preflight(prior: CameraPrior, reflectances: np.ndarray, power: np.ndarray, grid: WavelengthGrid,
              *, relative_error: float = 0.01, positions: np.ndarray | None = None,
              second: dict[str, np.ndarray] | None = None) -> Preflight:
    """What to expect of a photo of a chart under a light, before it is taken.

    For a camera like those measured, the average over the families of the prior, and for one unlike
    them, its last component. Half width and second lights are of the first.

    Parameters
    ----------
    prior : CameraPrior
    reflectances : (I, P) array
    power : (P,) array
        Spectrum of the light.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    relative_error : float
        Of each patch: noise, chart against reference, field.
    positions : (I, 2) array or None
        Of the patches, where the illumination of the chart will not be known.
    second : dict or None
        Spectra (P,) of lights by name, each tried as a second photo.
    """
    spreads = prior.covariances()
    last = len(prior.weights) - 1
    known = [index for index in range(last) if prior.level[index] == 0] or [last]

    def expected(powers: list[np.ndarray], components: list[int]) -> tuple[np.ndarray, np.ndarray]:
        return _expected(prior, spreads, components, reflectances, powers, grid, relative_error,
                         positions)

    variance, relative = expected([power], known)
    tried = {name: float(expected([power, other], known)[1].mean())
             for name, other in (second or {}).items()}
    return Preflight(relative, expected([power], [last])[1], NORMAL_QUANTILE * np.sqrt(variance),
                     condition_number(reflectances * power * grid.weights_nm, grid),
                     tuple(wavelength_ranges(unlit(power), grid)),
                     tuple(sorted(tried.items(), key=lambda item: item[1])))


def _expected(prior: CameraPrior, spreads: np.ndarray, components: list[int],
              reflectances: np.ndarray, powers: list[np.ndarray], grid: WavelengthGrid,
              relative_error: float, positions: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Variance (K, P) of the curves and relative error (K,) of each, means over some components."""
    basis = interpolation_matrix(prior.nm, grid.nm)
    variance, relative = np.zeros((prior.bands, grid.nm.size)), np.zeros(prior.bands)
    weights = prior.weights[components] / prior.weights[components].sum()
    for component, weight in zip(components, weights, strict=True):
        coefficients = prior.curves(prior.means[component]).reshape(prior.bands, -1)
        photos = [_imagined(reflectances, power, coefficients, basis, grid,
                            positions) for power in powers]
        covariance = expected_covariance(photos, prior, component, relative_error, grid,
                                         spread=spreads[prior.level[component]])
        curves = coefficients @ basis.T
        expected = curve_variance(basis, covariance, prior.bands) / curves.max() ** 2
        variance += weight * expected
        relative += weight * expected.mean(axis=1) / np.mean((curves / curves.max()) ** 2, axis=1)
    return variance, np.sqrt(relative)


def _imagined(reflectances: np.ndarray, power: np.ndarray, coefficients: np.ndarray,
              basis: np.ndarray, grid: WavelengthGrid,
              positions: np.ndarray | None) -> ChartEquations:
    """The photo that a camera of these coefficients (K, N) would take."""
    patches, bands = len(reflectances), len(coefficients)
    terms = np.zeros((patches, 0)) if positions is None else field_terms(positions)
    blank = ChartEquations(np.ones((patches, bands)), np.zeros((patches, bands, bands)),
                           reflectances, power / power.max() * grid.weights_nm,
                           np.full(patches, np.pi), terms, glare=positions is not None)
    signal = unlit_design(blank, basis) @ coefficients.T
    return replace(blank, signal=signal)
