"""More measurements of the same surface: readings, bands, spectrometer spots, other photos, other
patches.

All become rows of one measurement, which every draw then obeys (`condition`). One that
contradicts the others is named: outright where no reflectance between 0 and 1 gives all of them, as
doubtful where the prior finds it hard to believe.
"""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from spectrabox.radiometry.covariance import block_diagonal
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records import spectra
from spectrabox.sampling import spectral_measurement, summary
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture
from spectrabox.sampling.prior.mixture_posterior import with_floor
from spectrabox.sampling.prior.signal_posterior import solve_posterior

DOUBT_DRAWS = 400


# its name, and what was measured of the surface: readings, or another measurement by a camera
MoreMeasurement = tuple[str, "tuple[Reading, ...] | spectra.SpectralMeasurement"]


def joined(base: spectra.SpectralMeasurement,
           more: list[MoreMeasurement]) -> spectra.SpectralMeasurement:
    """One measurement of all.

    Parameters
    ----------
    base : SpectralMeasurement
        What the photo says of the surface.
    more : list of MoreMeasurement
        Further measurements of the same surface.

    Raises
    ------
    InputError
        If some cannot be true together; they are named.
    """
    photos = [base]        # one a camera and light: what came twice is averaged
    readings: list[Reading] = []
    for name, photo in more:
        if isinstance(photo, tuple):
            readings += photo
            continue
        twin = next((index for index, known in enumerate(photos) if same_bands(known, photo)), None)
        try:
            if twin is None:
                photos.append(photo)
            else:
                photos[twin] = same_material([photos[twin], photo])
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
    whole = condition(same_material(photos), readings)
    check_possible(base, more)
    return whole


def check_possible(base: spectra.SpectralMeasurement, more: list[MoreMeasurement]) -> None:
    """Raise where no reflectance between 0 and 1 gives all measurements within their errors (chance
    1 in a million).

    Parameters
    ----------
    base : SpectralMeasurement
        What the photo says of the surface.
    more : list of MoreMeasurement
        Further measurements of the same surface.

    Raises
    ------
    InputError
        Naming the measurements without which the rest would agree.
    """
    if not more or _possible(base, more):
        return
    blamed = [name for index, (name, _) in enumerate(more)
              if _possible(base, more[:index] + more[index + 1:])]
    names = " or ".join(blamed) if blamed else ", ".join(name for name, _ in more)
    raise InputError(f"{names} contradicts the other measurements: no reflectance between 0 and 1 "
                     "gives all of them within their errors; measure again, state larger errors, "
                     "or leave it out")


def doubtful(base: spectra.SpectralMeasurement, more: list[MoreMeasurement], prior: LogitMixture,
             seed: int) -> list[Finding]:
    """Measurements that lie far from what the others and the prior let expect (1 in a million).

    Parameters
    ----------
    base : SpectralMeasurement
        What the photo says of the surface.
    more : list of MoreMeasurement
        Further measurements of the same surface.
    prior : LogitMixture
    seed : int
        Of the random generator; the same seed gives the same draws bit for bit.
    """
    findings = []
    for index, (name, measured) in enumerate(more):
        rest = joined(base, more[:index] + more[index + 1:])
        rows, values, covariance = measured_rows(base, measured)
        expected = solve_posterior(prior, rest).draws(DOUBT_DRAWS, seed) @ rows.T
        spread = np.atleast_2d(np.cov(expected, rowvar=False)) + with_floor(covariance)
        away = values - expected.mean(axis=0)
        if away @ np.linalg.solve(spread, away) > chdtri(len(away), CONTRADICTION):
            worst = int(np.argmax(np.abs(away)))
            findings.append(Finding("reading.hard-to-believe", Severity.WARN, name, {
                "value": float(values[worst]), "expected": float(expected[:, worst].mean()),
                "error": float(np.sqrt(spread[worst, worst]))}))
    return findings


def _possible(base: spectra.SpectralMeasurement, more: list[MoreMeasurement]) -> bool:
    whole = spectral_measurement.without_states(base)
    parts = [(spectral_measurement.response_on(whole,
                                               PRIOR_GRID), whole.signal, whole.noise_covariance),
             *(measured_rows(base, measured) for _, measured in more)]
    rows, targets = [], []
    for part, values, covariance in parts:
        whiten = np.linalg.inv(np.linalg.cholesky(with_floor(covariance)))
        rows.append(whiten @ part)
        targets.append(whiten @ values)
    A, y = np.vstack(rows), np.concatenate(targets)
    misfit = np.sum((A @ spectral_measurement.nearest_coefficients(A, y) - y)**2)
    return bool(misfit < chdtri(y.size, CONTRADICTION))


def measured_rows(base: spectra.SpectralMeasurement,
                  more: tuple[Reading, ...] | spectra.SpectralMeasurement
                  ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows (J, 61) on the prior's wavelengths, values (J,) and covariance (J, J) of one more
    measurement.

    Parameters
    ----------
    base : SpectralMeasurement
        Whose grid readings are put on.
    more : tuple of Reading, or SpectralMeasurement
    """
    if not isinstance(more, tuple):
        photo = spectral_measurement.without_states(more)
        return spectral_measurement.response_on(photo,
                                                PRIOR_GRID), photo.signal, photo.noise_covariance
    both, bands = condition(base, list(more)), len(base.signal)
    return (spectral_measurement.response_on(both, PRIOR_GRID)[bands:], both.signal[bands:],
            both.noise_covariance[bands:, bands:])


# ---- rows of a measurement -----------------------------------------------------------------------
# More measurements of a surface become rows of the measurement: conditioning, never ranking.
#
# The published method ranks draws by how well they agree with an extra measurement (Eq. 9) and
# keeps the best. That is rejection with a loose tolerance: it leaves spectra that contradict the
# reading and wastes those that do not. As a row of the measurement the reading is obeyed by every
# draw, within its own error.

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
    def at_wavelength(nm: float, value: float,
                      standard_error: float = summary.READING_ERROR) -> Reading:
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

    def row(self, grid: spectra.WavelengthGrid) -> np.ndarray:
        """Weights (P,) on a grid, with sum 1."""
        row = np.interp(grid.nm, self.nm, self.weights, left=0, right=0) * grid.weights_nm
        if row.sum() <= 0:
            raise InputError(f"{self.name} sees nothing of {grid.nm[0]:g}-{grid.nm[-1]:g} nm; "
                             "leave it out")
        return row / row.sum()


def condition(measurement: spectra.SpectralMeasurement,
              readings: list[Reading]) -> spectra.SpectralMeasurement:
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


def same_material(measurements: list[spectra.SpectralMeasurement]) -> spectra.SpectralMeasurement:
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
    joined, *others = map(spectral_measurement.without_states,
                          measurements) if len(measurements) > 1 else measurements
    for other in others:
        if same_bands(other, joined):
            joined = _averaged(joined, other)
        else:
            joined = _stacked(joined, other.relative_response, other.signal,
                              other.noise_covariance, other.relative_covariance)
    return joined


def same_bands(first: spectra.SpectralMeasurement, second: spectra.SpectralMeasurement) -> bool:
    """Whether two measurements are by the same camera under the same light."""
    a, b = first.relative_response, second.relative_response
    return a.shape == b.shape and np.allclose(a, b, atol=1e-9)


def _averaged(first: spectra.SpectralMeasurement,
              second: spectra.SpectralMeasurement) -> spectra.SpectralMeasurement:
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
    both = np.hstack([np.eye(len(gain)) - gain, gain])
    _, _, relative = spectral_measurement.reduced_errors(
        both, np.tile(np.eye(len(gain)), (2, 1)), np.r_[first.signal, second.signal],
        block_diagonal(first.noise_covariance, second.noise_covariance),
        _of_both(first, second.relative_covariance, len(gain)))
    return spectra.SpectralMeasurement(first.grid, first.relative_response,
                               first.signal + gain @ difference,
                               first.noise_covariance - gain @ first.noise_covariance,
                               relative_covariance=relative)


def _of_both(measurement: spectra.SpectralMeasurement, relative: np.ndarray | None,
             more: int) -> np.ndarray | None:
    """Covariance of what multiplies a measurement and further bands, so many; None for nothing."""
    own, bands = measurement.relative_covariance, len(measurement.signal)
    if own is None and relative is None:
        return None
    return block_diagonal(np.zeros((bands, bands)) if own is None else own,
                          np.zeros((more, more)) if relative is None else relative)


def _stacked(measurement: spectra.SpectralMeasurement, rows: np.ndarray, values: np.ndarray,
             covariance: np.ndarray,
             relative: np.ndarray | None = None) -> spectra.SpectralMeasurement:
    bands, more = len(measurement.signal), len(values)
    noise = np.zeros((bands + more, bands + more))
    noise[:bands, :bands], noise[bands:, bands:] = measurement.noise_covariance, covariance
    states = measurement.states
    return spectra.SpectralMeasurement(
        measurement.grid, np.vstack([measurement.relative_response,
                                     rows]), np.r_[measurement.signal, values], noise,
        None if states is None else states.through(np.eye(bands + more, bands)),
        _of_both(measurement, relative, more))


# ---- light reflected twice -----------------------------------------------------------------------
# What light that was reflected twice off a surface tells of it, as in a concave corner: response
# times rho squared.
#
# The paper ranks draws by it (Eq. 10). Here draws are weighted by its likelihood and drawn again,
# which is exact as the number of draws grows; the effective sample size says whether there were
# enough.

PROPOSALS_PER_DRAW, MAX_PROPOSALS = 20, 200_000


def proposals_for(draws: int) -> int:
    """How many draws to weight where so many are wanted."""
    return min(PROPOSALS_PER_DRAW * draws, max(MAX_PROPOSALS, draws))


def given_reflected_twice(samples: spectra.SpectrumSamples, twice: spectra.SpectralMeasurement,
                          draws: int) -> spectra.SpectrumSamples:
    """Draws (T, 61) conditioned on the signal (K,) of light reflected twice, relative to white.

    Parameters
    ----------
    samples : SpectrumSamples
        Many, not conditioned on it.
    twice : SpectralMeasurement
        Its response, and the signal with its covariance; 0.1 % of white is always added.
    draws : int

    Returns
    -------
    SpectrumSamples
        ``effective_samples`` is that of the weights, at most ``draws``.
    """
    away = samples.spectra**2 @ spectral_measurement.response_on(twice, PRIOR_GRID).T - twice.signal
    weights = np.einsum("tk,kl,tl->t", away, np.linalg.inv(with_floor(twice.noise_covariance)),
                        away)
    weights = np.exp(-0.5 * (weights - weights.min()))
    weights /= weights.sum()
    effective = min(1 / np.sum(weights**2), float(draws))
    # Systematic: the least noise that drawing again can add.
    at = (np.arange(draws) + np.random.default_rng(samples.seed).random()) / draws
    chosen = np.minimum(np.searchsorted(np.cumsum(weights), at), len(weights) - 1)
    return replace(samples, spectra=samples.spectra[chosen],
                   coefficients=samples.coefficients[chosen], effective_samples=float(effective),
                   method=f"{samples.method}, weighted by light reflected twice")
