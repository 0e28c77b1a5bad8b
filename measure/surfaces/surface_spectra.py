"""Spectra behind the signals of surfaces, of flat samples and of scenes alike, and how near they
came to measured truths.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.measure.shoot import options
from spectrabox.measure.surfaces.surface_signals import errors_by_cause, measurement
from spectrabox.radiometry import appearance, findings
from spectrabox.radiometry.records import spectra as spectral_records
from spectrabox.sampling import draw_methods, spectral_measurement
from spectrabox.sampling.prior import mixture, signal_posterior
from spectrabox.sampling.summary import summarise


def sample_surfaces(signals: spectral_records.SurfaceSignals, chosen: options.Sampling, seed: int,
                    families: Mapping[str, Sequence[str]], progress: spectral_records.Progress,
                    joint_draws: Mapping[str, spectral_records.SpectrumSamples] | None = None
                    ) -> dict[str, spectral_records.SpectrumSummary]:
    """Summary of every unknown surface, with its draws.

    Parameters
    ----------
    signals : SurfaceSignals
    chosen : Sampling
    seed : int
        Of the first surface; each further one has the next.
    families : mapping
        From the name of a surface to the families it is said to be of.
    progress : callable
    joint_draws : mapping, optional
        Draws of all surfaces at once, where they were made so (``measure.scene.draws``).

    Raises
    ------
    InputError, CalibrationError, ConvergenceError
        As ``sampling.draw_methods.draw_spectra``.
    """
    spectra = {}
    for index, name in enumerate(signals.names):
        if not signals.known[index]:
            progress(index / len(signals.names), name)
            spectra[name] = _sample_surface(
                signals, index, chosen, seed + index, families.get(name, ()),
                (joint_draws or {}).get(name))
    return spectra


def _sample_surface(signals: spectral_records.SurfaceSignals, index: int, chosen: options.Sampling,
                    seed: int, families: Sequence[str],
                    draws: spectral_records.SpectrumSamples
                    | None) -> spectral_records.SpectrumSummary:
    seen = measurement(signals, index)
    prior = mixture.of_families(mixture.load_prior(), families)
    variance_shares: dict[str, float] = {}
    family_shares: dict[str, float] = {}
    states: spectral_records.StateEstimate | None = None
    if chosen.method == "prior":
        posterior = signal_posterior.solve_posterior(prior, seen)
        family_shares, states = posterior.family_shares, posterior.states
        unsaid = draws is not None and not posterior.says(draws.spectra.mean(axis=0))
        if draws is None or unsaid:
            variance_shares = posterior.variance_shares(errors_by_cause(signals, index))
            draws = posterior.samples(chosen.draws, seed, chosen.coefficients)
            seen = posterior.measurement
        if unsaid:      # of its own signal, which the draws of all surfaces at once left
            draws = dataclasses.replace(draws, outcome=spectral_records.Outcome.UNSAID,
                                        findings=(spectral_records.Outcome.UNSAID.finding(),))
    if draws is None:
        draws = draw_methods.draw_spectra(seen, chosen.method, chosen.draws, seed,
                             chosen.coefficients, prior)
    summary = summarise(draws, seen, chosen.level, conditions_of_band(draws, seen))
    return dataclasses.replace(resample_summary(summary, seen.grid), states=states,
                               variance_shares=variance_shares, family_shares=family_shares)


def conditions_of_band(draws: spectral_records.SpectrumSamples,
                       measured: spectral_records.SpectralMeasurement) -> tuple[findings.Finding,
                                                                                ...]:
    """What the band rests on."""
    errors = np.sqrt(np.diag(spectral_measurement.without_states(measured).noise_covariance))
    return (findings.Finding("band.gaussian-errors", findings.Severity.INFO,
                             values={"errors": errors.tolist()}),
            findings.Finding(
                "band.sampler", findings.Severity.INFO,
                values={"method": draws.method, "coefficients":
                        draws.coefficients.shape[1]}), *draws.findings)


def resample_summary(summary: spectral_records.SpectrumSummary,
                     grid: spectral_records.WavelengthGrid) -> spectral_records.SpectrumSummary:
    """The same summary on another grid, by straight lines between its wavelengths."""
    curves = ("mean", "standard_deviation", "lower", "upper", "bound_lower", "bound_upper")
    return dataclasses.replace(summary, grid=grid, **{
        name: np.interp(grid.nm, summary.grid.nm, getattr(summary, name)) for name in curves})


@dataclass(frozen=True)
class Scores:
    """How near a recovered spectrum came to a measured truth, over 400-700 nm."""

    rmse_mean: float                  # reflectance, mean of the samples
    # reflectance, the one spectrum of inverse rendering; None of a flat sample
    rmse_inverse_rendering: float | None
    coverage: float  # share of wavelengths at which the band at the stated level holds the truth
    coverage_95: float                # the same for the 95 % band
    coverage_bounds: float            # the same for the exact bounds
    band_width: float                 # mean width of the band, reflectance
    # CIEDE2000 under D65, 2 degree observer, mean of the samples against truth
    delta_e00_mean: float


def score(truth: np.ndarray, inverse_rendering: np.ndarray | None,
          summary: spectral_records.SpectrumSummary,
          samples: spectral_records.SpectrumSamples) -> Scores:
    """Scores of one material over the summary's grid.

    Parameters
    ----------
    truth : (P,) reflectance
    inverse_rendering : (P,) reflectance or None
        The one spectrum of inverse rendering, where there is one.
    """
    lower, upper = (np.interp(summary.grid.nm, samples.grid.nm, ends)
                    for ends in np.quantile(samples.spectra, [0.025, 0.975], axis=0))
    return Scores(
        rmse_mean=_rmse(summary.mean, truth),
        rmse_inverse_rendering=None if inverse_rendering is None
        else _rmse(inverse_rendering, truth),
        coverage=_share_inside(truth, summary.lower, summary.upper),
        coverage_95=_share_inside(truth, lower, upper),
        coverage_bounds=_share_inside(truth, summary.bound_lower, summary.bound_upper),
        band_width=float(np.mean(summary.upper - summary.lower)),
        delta_e00_mean=appearance.delta_e00(summary.grid.nm, summary.mean, truth))


def _rmse(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2)))


def _share_inside(truth: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    return float(np.mean((truth >= lower) & (truth <= upper)))
