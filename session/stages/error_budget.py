"""How well each material's signal is known, by cause: the likelihood of the samplers and the
report's error budget.
"""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spectrabox.radiometry.covariance import block_diagonal, symmetric
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.light_scale import error_of_each_band
from spectrabox.radiometry.records import (
    Calibration,
    JointReconstruction,
    SpectralMeasurement,
    SurfaceSignals,
)
from spectrabox.radiometry.response import white_signal
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.sampling.prior.family_coverage import FamilyCoverage, family_coverages
from spectrabox.sampling.prior.mixture import load_prior, of_families
from spectrabox.sampling.prior.signal_posterior import solve_posterior

DARK = 1e-12             # of the light's strongest wavelength
BandSignals = JointReconstruction | SurfaceSignals
SCALE = "light scale"    # what is left of its error beside causes of their own name


def measurement_of(calibrations: Sequence[Calibration], joint: JointReconstruction,
                   index: int) -> SpectralMeasurement:
    """What the photos said of one material, relative to white, with every error that is known.

    Parameters
    ----------
    calibrations : sequence of Calibration
        Of every view, in the order of ``joint.views``.
    index : int
        Of the material, in ``joint.materials``.
    """
    covariance = np.sum(list(signal_covariances(calibrations, joint, index).values()), axis=0)
    return SpectralMeasurement(joint.grid, joint.response, joint.signal[index], covariance)


def signal_covariances(calibrations: Sequence[Calibration], joint: JointReconstruction,
                       index: int) -> dict[str, np.ndarray]:
    """Covariance (J, J) of one material's signal, relative to white, by cause.

    Parameters
    ----------
    calibrations : of each view
    index : int
        Of the material.
    """
    signal = joint.signal[index]
    both = np.outer(signal, signal)
    views = np.unique(joint.view_of_band)
    by_view = [scale_covariances(calibrations[view], joint, view) for view in views]
    scales = {cause: block_diagonal(*(parts.get(cause, np.zeros_like(parts[SCALE]))
                                  for parts in by_view)) * both
              for cause in dict.fromkeys(cause for parts in by_view for cause in parts)}
    return {"photo and rendering noise": joint.signal_covariance[index],
            "sensitivities": sensitivity_covariance(calibrations, joint, index),
            "light spectrum": light_covariance(calibrations, joint, index), **scales,
            **{stray.cause: _within_views(joint, stray.relative[index]) * both
               for stray in joint.stray_light},
            "photo and model disagree": joint.model_covariance[index] * both}


def _within_views(joint: JointReconstruction, pattern: np.ndarray) -> np.ndarray:
    """Covariance (J, J) of an error that moves the bands of one photo by ``pattern`` (J,)."""
    same = joint.view_of_band[:, None] == joint.view_of_band
    return np.outer(pattern, pattern) * same


def scale_covariances(calibration: Calibration, joint: JointReconstruction,
                      view: int) -> dict[str, np.ndarray]:
    """Relative covariance (K, K) of what the bands of one view read of white, by cause.

    A known material sets one scale for all bands. A chart to which the curves are fitted too gives
    every band its own: their errors on white are uncorrelated within what
    benchmarks/bench_white_signal.py can tell. What befell the light or the shutter between the
    photos befell all bands.

    Parameters
    ----------
    view : int
        Its index in ``joint.views``.
    """
    scale, bands = joint.views[view].light_scale, int(np.count_nonzero(joint.view_of_band == view))
    fitted = calibration.light_scale is not None and calibration.sensitivity.covariance is not None
    alike = np.ones((bands, bands))
    own = error_of_each_band(scale)**2 * (np.eye(bands) if fitted else alike)
    return {SCALE: own} | {error.cause: error.relative**2 * alike for error in scale.common_errors}


def relative_errors(calibrations: Sequence[Calibration], joint: JointReconstruction,
                    index: int) -> dict[str, np.ndarray]:
    """Relative standard error (J,) of one material's signal, by cause.

    Parameters
    ----------
    calibrations : sequence of Calibration
        Of every view, in the order of ``joint.views``.
    index : int
        Of the material, in ``joint.materials``.
    """
    return {cause: np.sqrt(np.diag(covariance)) / joint.signal[index]
            for cause, covariance in signal_covariances(calibrations, joint, index).items()}


def light_covariance(calibrations: Sequence[Calibration], joint: BandSignals,
                     index: int) -> np.ndarray:
    """Covariance (J, J) of a signal, relative to white, by the stated errors of each light's
    readings, which are independent.

    To first order, as for the curves; zero for lights whose error nobody stated. Views under the
    same light share their bands, and these errors with them.

    Parameters
    ----------
    calibrations : sequence of Calibration
        Of every view, in the order of ``joint.views``.
    index : int
        Of the material, in ``joint.materials``.
    """
    rows, signal = [], joint.signal[index]
    for view in np.unique(joint.view_of_band):
        light, mine = calibrations[view].light, joint.view_of_band == view
        if light.standard_error is None:
            rows.append(np.zeros((int(mine.sum()), 1)))
            continue
        power = spectrum_on_grid(light, joint.grid)
        by_nm = (joint.spectra[index] - signal[mine, None]) * joint.response[mine]
        by_reading = by_nm / np.maximum(power, DARK * power.max()) \
            @ interpolation_matrix(light.grid.nm, joint.grid.nm)
        rows.append(by_reading * light.standard_error)
    return block_diagonal(*(row @ row.T for row in rows))


def variance_shares(calibrations: Sequence[Calibration], joint: JointReconstruction,
                    index: int, families: Sequence[str]) -> dict[str, float]:
    """Share of each cause in the variance of a spectrum drawn from the learnt prior, mean over
    wavelengths.

    Metamerism is what would remain if every signal were perfect.

    Parameters
    ----------
    calibrations : sequence of Calibration
        Of every view, in the order of ``joint.views``.
    index : int
        Of the material, in ``joint.materials``.

    Returns
    -------
    dict
        From each cause to its share, 0 to 1; they sum to 1.
    """
    posterior = solve_posterior(of_families(load_prior(), families),
                                measurement_of(calibrations, joint, index))
    return posterior.variance_shares(signal_covariances(calibrations, joint, index))


def families_allowed(calibrations: Sequence[Calibration], joint: JointReconstruction, index: int,
                     stated: Sequence[str]) -> tuple[FamilyCoverage, ...]:
    """The families of surfaces that a material's signal allows, or of those stated, and how their
    bands were certified.

    Parameters
    ----------
    calibrations : sequence of Calibration
        Of every view, in the order of ``joint.views``.
    index : int
        Of the material, in ``joint.materials``.
    stated : words for families
    """
    prior = of_families(load_prior(), stated)
    shares = solve_posterior(prior, measurement_of(calibrations, joint, index)).family_shares
    return family_coverages(shares, prior.stated, prior.certificates)


def sensitivity_covariance(calibrations: Sequence[Calibration], joint: BandSignals,
                           index: int) -> np.ndarray:
    """Covariance (J, J) of a signal, relative to white, by the error of the camera's curves.

    With a covariance of the curves, to first order: an error dM of a band changes the signal by the
    integral of dM x light x (reflectance - signal), divided by the white signal, since white itself
    is calibrated. The same error acts in the photos under every light. Without one, every band errs
    by the stated share of the brightest band, independently in each photo: an error of a curve's
    tail admits light from there.

    Parameters
    ----------
    calibrations : sequence of Calibration
        Of every view, in the order of ``joint.views``.
    index : int
        Of the material, in ``joint.materials``.
    """
    signal = joint.signal[index]
    views = [int(view) for view in np.unique(joint.view_of_band)]
    fits = [calibrations[view].sensitivity for view in views]
    if fits[0].covariance is None or fits[0].basis is None:
        return block_diagonal(*(calibrations[view].relative_covariance
                            * signal[joint.view_of_band == view].max() ** 2
                            for view in views))
    covariance = np.zeros((signal.size, signal.size))
    # photos under lights that are each unknown have products of their own
    first_of = [next(place for place, fit in enumerate(fits)
                     if np.array_equal(fit.curves, mine.curves)) for mine in fits]
    for group in sorted(set(first_of)):
        fit = fits[group]
        assert fit.covariance is not None and fit.basis is not None
        bands, coefficients = len(fit.curves), fit.basis.shape[1]
        jacobian = np.zeros((signal.size, bands, coefficients))
        for view in (view for view, first in zip(views, first_of, strict=True) if first == group):
            mine = np.flatnonzero(joint.view_of_band == view)
            weight = spectrum_on_grid(calibrations[view].light,
                                      joint.grid) * joint.grid.weights_nm
            white = white_signal(fit.curves * weight)[:, None]
            contrast = (joint.spectra[index] - signal[mine, None]) * weight / white
            jacobian[mine, np.arange(bands)] = contrast @ fit.basis
        rows = jacobian.reshape(signal.size, -1)
        covariance += rows @ fit.covariance @ rows.T
    return symmetric(covariance)
