"""More measurements of a surface become rows of the measurement: conditioning, never ranking.

The published method ranks draws by how well they agree with an extra measurement (Eq. 9) and keeps
the best. That is rejection with a loose tolerance: it leaves spectra that contradict the reading
and wastes those that do not. As a row of the measurement the reading is obeyed by every draw,
within its own error.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import SpectralMeasurement, WavelengthGrid

# chance of a disagreement as large as the one seen, below which two readings contradict each other
CONTRADICTION = 1e-6
SAME_WEIGHTS = 0.05     # sum of differences below which two readings are of the same
HALF_WIDTH_NM = 2.5     # of the triangular band that a single-wavelength reading stands for


@dataclass(frozen=True)
class Reading:
    """One extra measurement: reflectance ``value`` seen through ``weights``, a function of
    wavelength in nm.
    """

    name: str
    nm: np.ndarray              # (Q,) where the weights are given, ascending
    weights: np.ndarray         # (Q,) not negative
    value: float                # weighted mean reflectance
    standard_error: float

    @staticmethod
    def at_wavelength(nm: float, value: float, standard_error: float = 0.005) -> Reading:
        """A reading at one wavelength, as of a spectrometer spot or a monochromatic photo.

        Raises
        ------
        InputError
            For a wavelength outside 400-700 nm, a reflectance that cannot be, or a negative error.
        """
        if not 400 <= nm <= 700:
            raise InputError(f"the reading at {nm:g} nm lies outside 400-700 nm; leave it out")
        if not -0.05 <= value <= 1.05:
            raise InputError(f"the reading at {nm:g} nm gives a reflectance of {value:g}; 0 to 1 "
                             "is needed")
        if not standard_error >= 0:
            raise InputError(f"the reading at {nm:g} nm has the standard error {standard_error:g}; "
                             "0 or more is needed")
        return Reading(f"the reading at {nm:g} nm",
                       np.array([nm - HALF_WIDTH_NM, nm, nm + HALF_WIDTH_NM]),
                       np.array([0.0, 1.0, 0.0]), value, standard_error)

    def row(self, grid: WavelengthGrid) -> np.ndarray:
        """Weights (P,) on a grid, with sum 1."""
        row = np.interp(grid.nm, self.nm, self.weights, left=0, right=0) * grid.weights_nm
        if row.sum() <= 0:
            raise InputError(f"{self.name} sees nothing of {grid.nm[0]:g}-{grid.nm[-1]:g} nm; "
                             "leave it out")
        return row / row.sum()


def condition(measurement: SpectralMeasurement, readings: list[Reading]) -> SpectralMeasurement:
    """The measurement with each reading as a further band.

    Parameters
    ----------
    measurement : SpectralMeasurement
    readings : list of Reading

    Raises
    ------
    InputError
        If two readings of the same thing contradict each other by more than chance allows (1 in a
        million), or are the same measurement twice; both are named.
    """
    if not readings:
        return measurement
    rows = np.array([reading.row(measurement.grid) for reading in readings])
    limit = np.sqrt(chdtri(1, CONTRADICTION))
    for index, first in enumerate(readings):
        for other, second in enumerate(readings[:index]):
            if np.abs(rows[index] - rows[other]).sum() >= SAME_WEIGHTS:
                continue
            spread = max(np.hypot(first.standard_error, second.standard_error), 1e-9)
            if abs(first.value - second.value) > limit * spread:
                raise InputError(f"{second.name} ({second.value:g}) and {first.name} "
                                 f"({first.value:g}) contradict each other beyond their errors; "
                                 "measure both again or state larger errors")
            raise InputError(f"{second.name} and {first.name} are the same measurement twice; "
                             "give their mean once")
    values = np.array([reading.value for reading in readings])
    variances = np.array([reading.standard_error**2 for reading in readings])
    return _stacked(measurement, rows, values, np.diag(variances))


def same_material(measurements: list[SpectralMeasurement]) -> SpectralMeasurement:
    """Several measurements of one material as one: other lights, other cameras, other patches known
    to be the same.

    Bands that coincide are averaged with the weights of their errors, so that the result has
    independent bands.

    Parameters
    ----------
    measurements : list of SpectralMeasurement
        On one grid.

    Raises
    ------
    InputError
        If there are none, they are on different grids, or equal bands without noise disagree.
    """
    if not measurements:
        raise InputError("no measurement was given; give at least one")
    if any(other.grid.nm.shape != measurements[0].grid.nm.shape for other in measurements):
        raise InputError(
            "the measurements are on different wavelengths; put them on one grid first")
    joined = measurements[0]
    for other in measurements[1:]:
        if same_bands(other, joined):
            joined = _averaged(joined, other)
        else:
            joined = _stacked(joined, other.relative_response, other.signal,
                              other.noise_covariance)
    return joined


def same_bands(first: SpectralMeasurement, second: SpectralMeasurement) -> bool:
    """Whether two measurements are by the same camera under the same light."""
    a, b = first.relative_response, second.relative_response
    return a.shape == b.shape and np.allclose(a, b, atol=1e-9)


def _averaged(first: SpectralMeasurement, second: SpectralMeasurement) -> SpectralMeasurement:
    total = first.noise_covariance + second.noise_covariance
    difference = second.signal - first.signal
    if not total.any():
        if np.abs(difference).max() > 1e-9:
            raise InputError("two measurements of the same material without noise disagree; state "
                             "their noise")
        return first
    gain = first.noise_covariance @ np.linalg.pinv(total, hermitian=True)
    surprise = difference @ np.linalg.pinv(total, hermitian=True) @ difference
    if surprise > chdtri(len(difference), CONTRADICTION):
        raise InputError("two patches said to be the same material differ by "
                         f"{np.abs(difference).max():.3g} of white, far beyond their noise; they "
                         "are different materials, or the light on them differs")
    return SpectralMeasurement(first.grid, first.relative_response,
                               first.signal + gain @ difference,
                               first.noise_covariance - gain @ first.noise_covariance)


def _stacked(measurement: SpectralMeasurement, rows: np.ndarray, values: np.ndarray,
             covariance: np.ndarray) -> SpectralMeasurement:
    bands, more = len(measurement.signal), len(values)
    noise = np.zeros((bands + more, bands + more))
    noise[:bands, :bands], noise[bands:, bands:] = measurement.noise_covariance, covariance
    return SpectralMeasurement(measurement.grid, np.vstack([measurement.relative_response, rows]),
                               np.r_[measurement.signal, values], noise)
