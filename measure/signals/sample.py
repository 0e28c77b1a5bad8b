"""Spectra behind signals of a camera: signals, response and errors in, one estimate a signal out.

The posterior of a signal is solved once; draws, families and shares of variance come from it.
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from spectrabox.measure.estimate import Estimate
from spectrabox.measure.signals.options import SampleOptions
from spectrabox.measure.signals.signal_capture import SignalCapture
from spectrabox.radiometry.error_model import split_errors, stated_causes
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import FINE_GRID, basis_matrix
from spectrabox.radiometry.records import spectra as spectral_records
from spectrabox.sampling import spectral_measurement, uniform
from spectrabox.sampling.draw_methods import METHODS, draw_spectra
from spectrabox.sampling.evaluation import metrics
from spectrabox.sampling.further import more_measurements
from spectrabox.sampling.polytope import bounds, refinement
from spectrabox.sampling.prior import signal_posterior
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.prior.summaries import summaries
from spectrabox.sampling.published.baselines import ranked, refined_as_published
from spectrabox.sampling.summary import METAMERISM, READING_ERROR, check_level, summarise

MAX_SAMPLES = 5_000_000
FWHM_TO_SD = 1 / (2 * np.sqrt(2 * np.log(2)))
BASELINE_NM = 50        # between the wavelengths at which single spectra are told
CURVE_DIGITS = 7    # of curves that are known to 1e-6, so that thousands are written quickly


def sample_signals(capture: SignalCapture, options: SampleOptions, *,
                   with_draws: bool = True) -> list[Estimate]:
    """Estimate the reflectance behind each of some signals.

    Parameters
    ----------
    capture : SignalCapture
    options : SampleOptions
    with_draws : bool
        Without, signals that the learnt prior explains get none, which is far faster.

    Raises
    ------
    InputError, CalibrationError, ConvergenceError
        With what to change; contradictory measurements are named.
    """
    check_options(options)
    for name, error in (("light", capture.light_error), ("sensitivity", capture.sensitivity_error)):
        if not 0 <= error < 0.5:
            raise InputError(f"--{name}-error {error:g} is a relative error; 0 to 0.5 is needed")
    alone = not capture.more and capture.twice is None
    if not with_draws and options.method == "prior" and alone:
        return _estimate_without_draws(capture, options)
    return [estimate_from_draws(name, *_measured(capture, signal), options, capture)
            for name, signal in zip(capture.names, capture.signals, strict=True)]


def _measured(capture: SignalCapture,
              signal: np.ndarray) -> tuple[spectral_records.SpectralMeasurement,
                                           dict[str, np.ndarray]]:
    """The measurement with the photo's noise alone, and the covariances (K, K) of all errors."""
    base = measurement_of_signal(capture.relative_response, signal, capture.white, capture.noise)
    return base, stated_causes(base.signal, base.noise_covariance, capture.light_error,
                               capture.sensitivity_error)


def check_options(options: SampleOptions) -> None:
    """Raise unless the options go together.

    Raises
    ------
    InputError
    """
    method = options.method
    if method not in METHODS:
        raise InputError(f"the method {method!r} is not known; known are {', '.join(METHODS)}")
    if options.keep is not None and method != "paper":
        raise InputError(f"--best ranks draws as published; the method {method} obeys further "
                         "measurements without it: leave it out, or take --method paper")
    if options.refine is not None and method == "prior":
        raise InputError("--refine belongs to splines; the learnt prior has none: take --method "
                         "uniform or paper")
    spectral_measurement.check_seed(options.seed)
    for name, number in (("samples", options.samples), ("coefficients", options.coefficients)):
        if not isinstance(number, int | np.integer):
            raise InputError(f"{name} {number!r} is no whole number")
    if not 1 <= options.samples <= MAX_SAMPLES:
        raise InputError(f"{options.samples} samples were asked for; ask for 1 to {MAX_SAMPLES}")


def estimate_from_draws(name: str, base: spectral_records.SpectralMeasurement,
                        causes: Mapping[str, np.ndarray], options: SampleOptions,
                        capture: SignalCapture) -> Estimate:
    """One estimate; ``base`` has the photo's noise alone, ``causes`` (K, K) those of all errors."""
    base = _with_all_errors(base, causes)
    more, twice = list(capture.more), capture.twice
    measurement = base if options.keep is not None else more_measurements.joined(base, more)
    count = options.samples if twice is None or options.keep is not None \
        else more_measurements.proposals_for(options.samples)
    prior = posterior = None
    if options.method == "prior":
        prior = capture.prior or load_prior()
        posterior = signal_posterior.solve_posterior(prior, measurement)
        draws = posterior.samples(count, options.seed, options.coefficients)
    elif options.refine is not None:
        draws = _draw_refined(options, options.refine, measurement, count)
    else:
        draws = draw_spectra(measurement, options.method, count, options.seed,
                             options.coefficients)
    if options.keep is not None:
        draws = ranked(draws, base, more, None if twice is None else twice.signal, options.keep)
    elif twice is not None:
        draws = more_measurements.given_reflected_twice(draws, twice, options.samples)
    # More measurements than coefficients leave no spline to bound: the signal alone then does, as
    # wide as it may be.
    over_determined = len(measurement.signal) >= draws.coefficients.shape[1]
    bounded, said = base if over_determined else measurement, capture.findings
    if posterior is not None and posterior.unreached is not None:
        own = slice(base.signal.size)
        bounded = posterior.measurement if not over_determined else replace(
            base, noise_covariance=base.noise_covariance + posterior.unreached[own, own])
        # it has an error after all
        said = tuple(each for each in said if each.code != "signal.no-noise")
    summary = summarise(draws, bounded, options.level)
    contradicting = more_measurements.doubtful(base, more, capture.prior or load_prior(),
                                               options.seed) \
        if more else None
    return Estimate(
        name, summary, base, causes, prior, of_signal=said, solved=posterior,
        from_more=bool(more) or twice is not None,
        bounds_from="the signal alone" if over_determined or options.keep else "all measurements",
        contradicting=None if contradicting is None else tuple(contradicting))


def _with_all_errors(base: spectral_records.SpectralMeasurement,
                     causes: Mapping[str, np.ndarray]) -> spectral_records.SpectralMeasurement:
    relative = split_errors(base.signal, causes).relative
    return replace(base, noise_covariance=sum(causes.values(), np.zeros((base.signal.size,) * 2)),
                   relative_covariance=relative if relative.any() else None)


def _draw_refined(options: SampleOptions, fine: int,
                  measurement: spectral_records.SpectralMeasurement,
                  count: int) -> spectral_records.SpectrumSamples:
    coarse, seed = options.coefficients, options.seed
    if options.method == "paper":
        refined = refined_as_published(measurement, coarse, fine, count, seed)
        method = (f"one solution of {coarse} coefficients refined to {fine} as published (far too "
                  "narrow)")
    else:
        operator, _ = uniform.into_reach(spectral_measurement.spline_operator(measurement, coarse))
        refined = refinement.sample_refined(measurement, operator, fine, count, seed)
        method = f"uniform, refined from {coarse} to {fine} coefficients"
    return uniform.as_spectra(refined, method, seed, spectral_records.Outcome.CONVERGED)


def _estimate_without_draws(capture: SignalCapture,
                            options: SampleOptions) -> list[Estimate]:
    """Estimates of many signals at once, with draws only where no spectrum of the prior fits."""
    check_level(options.level)
    prior = capture.prior or load_prior()
    first = measurement_of_signal(capture.relative_response, capture.signals[0], capture.white,
                                  capture.noise)
    spectral_measurement.check_measurement(first)
    y = relative_to_white(np.asarray(capture.signals), capture.white)
    photo_noise = np.broadcast_to(first.noise_covariance, (len(y), *first.noise_covariance.shape))
    causes = stated_causes(y, photo_noise, capture.light_error, capture.sensitivity_error)
    total = np.sum(list(causes.values()), axis=0)
    coefficients = signal_posterior.enough_coefficients(options.coefficients, first.signal.size)
    bound_lower, bound_upper = bounds.bounds_of_many(
        spectral_measurement.spline_operator(first, coefficients).A, y, total,
        basis_matrix(PRIOR_GRID.nm, coefficients), options.level)
    summary = summaries(prior, spectral_measurement.response_on(first, PRIOR_GRID), y, causes,
                        options.level)
    estimates = []
    for row, (name, outcome) in enumerate(zip(capture.names, summary.outcome, strict=True)):
        own = {cause: covariance[row] for cause, covariance in causes.items()}
        if outcome is spectral_records.Outcome.TOO_ROUGH:  # draws tell how near one can come
            estimates.append(estimate_from_draws(name, replace(first, signal=y[row]), own, options,
                                                  capture))
            continue
        shares = dict(zip(prior.families, summary.family_shares[row].tolist(), strict=True))
        mean, deviation, lower, upper = (curves[row].round(CURVE_DIGITS) for curves in (
            summary.mean, summary.standard_deviation, summary.lower, summary.upper))
        conditional_on = (Finding("band.closed-form", Severity.INFO,
                                  values={"method": signal_posterior.prior_named(outcome)}),
                          *signal_posterior.outcome_findings(outcome, prior.stated, shares))
        estimates.append(Estimate(
            name, spectral_records.SpectrumSummary(
                PRIOR_GRID, mean, deviation, lower, upper, bound_lower[row], bound_upper[row],
                options.level, conditional_on, float(summary.next_measurement_nm[row]),
                variance_shares=dict(zip((METAMERISM, *causes), summary.budget[row].tolist(),
                                         strict=True)), family_shares=shares),
            replace(first, signal=y[row], noise_covariance=total[row]), own, prior,
            of_signal=capture.findings, ended=outcome))
    return estimates


def compared(estimate: Estimate, options: SampleOptions, truth: np.ndarray | None,
             lights: tuple[str, ...],
             with_baselines: bool) -> tuple[dict[str, object], str]:
    """The estimate beside other authors' spectra, and all of them judged where the truth is known.

    Parameters
    ----------
    estimate : Estimate
        With draws.
    options : SampleOptions
        Of the estimate.
    truth : (61,) array, optional
        Reflectance at 400, 405 ... 700 nm.
    lights : names
        Of the colour differences.
    with_baselines : bool
        The greedy sampler has no draws for some signals that can be reached.

    Returns
    -------
    facts : dict
        For JSON: ``baselines``, the others' single spectra (61,), None of one who finds none;
        ``judged``, scores by method. Neither where it does not apply.
    text : str
        For a person.
    """
    assert estimate.measurement is not None and estimate.samples is not None
    others = metrics.baselines(estimate.measurement, options.samples, options.seed,
                               options.coefficients) \
        if with_baselines else {}
    facts: dict[str, object] = {}
    singles = {name: None if other is None else other[0] for name, other in others.items()}
    if with_baselines:
        facts["baselines"] = singles
    if truth is not None:
        spectra = estimate.samples.spectra
        ours = {options.method: (spectra.mean(axis=0), spectra)}
        scores = {name: metrics.judged(PRIOR_GRID.nm, truth, other[0], lights, other[1])
                  for name, other in (ours | others).items() if other is not None}
        facts["judged"] = scores
        return facts, metrics.judgement_text([("signal", method, score)
                                              for method, score in scores.items()])
    shown = np.flatnonzero(estimate.nm % BASELINE_NM == 0)
    lines = [f"{'nm':<22}" + "".join(f"{nm:7.0f}" for nm in estimate.nm[shown])]
    for name, values in {estimate.method: estimate.mean, **singles}.items():
        cells = " found no spectrum" if values is None \
            else "".join(f"{value:7.3f}" for value in values[shown])
        lines.append(f"{name[:22]:<22}{cells}")
    return facts, "\n".join(lines)


def measurement_of_signal(relative_response: np.ndarray, signal: np.ndarray,
                          white: np.ndarray | None = None,
                          noise: np.ndarray | None = None) -> spectral_records.SpectralMeasurement:
    """The measurement relative to white, from a signal as the camera gives it.

    Parameters
    ----------
    relative_response : (K, 301) array
        At every nm, rows summing to 1.
    signal : (K,) array
    white : (K,) array, optional
        What a perfect white reads, in the signal's unit; 1 by default.
    noise : (K,) array, optional
        Standard errors in the signal's unit; 0 by default.

    Raises
    ------
    InputError
        If white is not positive, the noise is negative, or the signal lies beyond twice white.
    """
    relative = relative_to_white(signal, white)
    noise = np.zeros_like(signal) if noise is None else noise
    if np.any(noise < 0):
        raise InputError(f"the noise {listed(noise)} is negative; give standard errors")
    return spectral_records.SpectralMeasurement(FINE_GRID, relative_response, relative,
                                                np.diag((noise if white is None
                                                         else noise / white)**2))


def relative_to_white(signals: np.ndarray, white: np.ndarray | None) -> np.ndarray:
    """Signals (..., K) over what a perfect white (K,) reads in the same unit, 1 by default.

    Raises
    ------
    InputError
        If white is not positive, or a signal lies beyond twice white.
    """
    if white is None:
        white = np.ones(signals.shape[-1])
    if np.any(white <= 0):
        raise InputError(f"the white {listed(white)} is not positive in every band; give what a "
                         "perfect white reads")
    relative = signals / white
    if np.any(np.abs(relative) > 2):
        raise InputError(f"the signal is {np.abs(relative).max():.3g} times white; give what a "
                         "perfect white reads (white)")
    return relative


def listed(values: np.ndarray) -> str:
    """Numbers as an option takes them, such as 0.2,0.3,0.1."""
    return ",".join(f"{value:g}" for value in values)


def reading_at(nm: float, reflectance: float, error: float = READING_ERROR,
               fwhm_nm: float = 0.0) -> more_measurements.Reading:
    """A reading at one wavelength, or through a Gaussian band of that full width at half maximum.

    Raises
    ------
    InputError
        As `Reading.at_wavelength`.
    """
    narrow = more_measurements.Reading.at_wavelength(nm, reflectance, error)
    if fwhm_nm <= 0:
        return narrow
    weights = np.exp(-0.5 * ((FINE_GRID.nm - nm) / (fwhm_nm * FWHM_TO_SD))**2)
    return more_measurements.Reading(f"the reading at {nm:g} nm, {fwhm_nm:g} nm wide", FINE_GRID.nm,
                                     weights, reflectance, error)
