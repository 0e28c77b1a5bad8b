"""What any session says of its surfaces, as samplers and error budgets take it."""
from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from spectrabox.radiometry.covariance import symmetric
from spectrabox.radiometry.records import SignalError, SpectralMeasurement, SurfaceSignals
from spectrabox.sampling.prior.family_coverage import FamilyCoverage, family_coverages
from spectrabox.sampling.prior.mixture import load_prior, of_families
from spectrabox.sampling.prior.signal_posterior import solve_posterior
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.stages.error_budget import signal_covariances
from spectrabox.session.stages.stored_records import calibrations_of, joint_of, signals_of
from spectrabox.session.store.store import StoredStage


def surface_signals(config: SessionConfig, stored: Mapping[str, StoredStage]) -> SurfaceSignals:
    """Signals of all surfaces of a session, of a flat sample or of a scene, with their errors."""
    if config.flat:
        return signals_of(stored)
    calibrations, joint = calibrations_of(config, stored), joint_of(stored)
    causes = [signal_covariances(calibrations, joint, index)
              for index in range(len(joint.materials))]
    errors = tuple(SignalError(cause, np.array([parts[cause] for parts in causes]))
                   for cause in causes[0])
    return SurfaceSignals(joint.materials, joint.known, joint.grid, joint.spectra, joint.bands,
                          joint.view_of_band, joint.response, joint.signal, errors)


def errors_by_cause(signals: SurfaceSignals, index: int) -> dict[str, np.ndarray]:
    """Covariance of one surface's signal by cause, in the bands that show it.

    Parameters
    ----------
    index : int
        Of the surface.
    """
    seen = np.flatnonzero(np.isfinite(signals.signal[index]))
    return {error.cause: error.covariance[index][np.ix_(seen, seen)] for error in signals.errors}


def measurement(signals: SurfaceSignals, index: int) -> SpectralMeasurement:
    """What the photos said of one surface, in the bands that show it.

    Parameters
    ----------
    index : int
        Of the surface.
    """
    seen = np.isfinite(signals.signal[index])
    total = np.sum(list(errors_by_cause(signals, index).values()), axis=0)
    return SpectralMeasurement(signals.grid, signals.response[seen], signals.signal[index][seen],
                               symmetric(total))


def relative_errors(signals: SurfaceSignals, index: int) -> dict[str, np.ndarray]:
    """Relative standard error of one surface's signal by cause, in the bands that show it."""
    value = signals.signal[index][np.isfinite(signals.signal[index])]
    return {cause: np.sqrt(np.diag(covariance)) / value
            for cause, covariance in errors_by_cause(signals, index).items()}


def variance_shares(signals: SurfaceSignals, index: int,
                    families: Sequence[str]) -> dict[str, float]:
    """Share of each cause in the variance of a spectrum drawn from the learnt prior.

    Parameters
    ----------
    index : int
        Of the surface.
    families : sequence of str
        Which it is said to be of.

    Returns
    -------
    dict
        From each cause to its share, 0 to 1, mean over wavelengths; they sum to 1.
    """
    posterior = solve_posterior(of_families(load_prior(), families), measurement(signals, index))
    return posterior.variance_shares(errors_by_cause(signals, index))


def families_allowed(signals: SurfaceSignals, index: int,
                     stated: Sequence[str]) -> tuple[FamilyCoverage, ...]:
    """The families that a surface's signal allows, or those stated, and how their bands were
    certified.

    Parameters
    ----------
    index : int
        Of the surface.
    stated : sequence of str
        Which it is said to be of.
    """
    prior = of_families(load_prior(), stated)
    shares = solve_posterior(prior, measurement(signals, index)).family_shares
    return family_coverages(shares, prior.stated, prior.certificates)
