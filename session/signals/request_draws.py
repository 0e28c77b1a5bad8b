"""Draws for one signal and everything else that was measured, by the method and options that were
asked for.
"""
from __future__ import annotations

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import SpectralMeasurement, SpectrumSamples
from spectrabox.sampling.draw_methods import METHODS, draw_spectra
from spectrabox.sampling.further.more_measurements import MoreMeasurement, joined
from spectrabox.sampling.further.self_reflection import given_reflected_twice, proposals_for
from spectrabox.sampling.polytope.refinement import sample_refined
from spectrabox.sampling.prior.mixture import LogitMixture, load_prior
from spectrabox.sampling.prior.signal_posterior import SignalPosterior, solve_posterior
from spectrabox.sampling.published.per_axis_box import sample_published
from spectrabox.sampling.published.ranking_and_refinement import ranked, refined_as_published
from spectrabox.sampling.spline_measurement import spline_operator
from spectrabox.sampling.uniform import as_spectra, into_reach
from spectrabox.session.commands.requests import SampleRequest


def check_options(options: SampleRequest) -> None:
    """Raise unless the options go together.

    Raises
    ------
    InputError
    """
    if options.method not in METHODS:
        raise InputError(f"the method {options.method!r} is not known; known are "
                         f"{', '.join(METHODS)}")
    if options.start not in ("bounded", "unbounded"):
        raise InputError(f"the start {options.start!r} is not known; known are bounded and "
                         "unbounded")
    if options.keep is not None and options.method != "paper":
        raise InputError(f"--keep ranks draws as published; the method {options.method} obeys "
                         "further measurements without it: leave it out, or take --method paper")
    if options.refine is not None and options.method == "prior":
        raise InputError("--refine belongs to splines; the learnt prior has none: take --method "
                         "uniform or paper")


def draws_of(options: SampleRequest, base: SpectralMeasurement, more: list[MoreMeasurement],
             twice: SpectralMeasurement | None, prior: LogitMixture | None
             ) -> tuple[SpectrumSamples, SpectralMeasurement, SignalPosterior | None]:
    """Draws, the measurement that they obey, and its posterior (of the method "prior" only).

    Raises
    ------
    InputError, CalibrationError, ConvergenceError
        Contradictory measurements are named.
    """
    if options.keep is not None:
        samples = _drawn(options, base, options.samples)
        return ranked(samples, base, more, None if twice is None else twice.signal,
                      options.keep), base, None
    measurement = joined(base, more)
    count = options.samples if twice is None else proposals_for(options.samples)
    posterior = None
    if options.method == "prior":
        posterior = solve_posterior(prior or load_prior(), measurement)
        samples = posterior.samples(count, options.seed, options.coefficients)
    else:
        samples = _drawn(options, measurement, count)
    if twice is not None:
        samples = given_reflected_twice(samples, twice, options.samples)
    return samples, measurement, posterior


def _drawn(options: SampleRequest, measurement: SpectralMeasurement,
           draws: int) -> SpectrumSamples:
    seed, count = options.seed, options.coefficients
    if options.refine is not None:
        return _refined(options, options.refine, measurement, draws)
    if options.method == "paper" and options.start == "unbounded":
        return sample_published(measurement, draws, seed, count, unbounded_start=True)
    return draw_spectra(measurement, options.method, draws, seed, count)


def _refined(options: SampleRequest, fine: int, measurement: SpectralMeasurement,
             draws: int) -> SpectrumSamples:
    coarse, seed = options.coefficients, options.seed
    if options.method == "paper":
        refined = refined_as_published(measurement, coarse, fine, draws, seed)
        method = (f"one solution of {coarse} coefficients refined to {fine} as published (far too "
                  "narrow)")
    else:
        operator, _ = into_reach(spline_operator(measurement, coarse))
        refined = sample_refined(measurement, operator, fine, draws, seed)
        method = f"uniform, refined from {coarse} to {fine} coefficients"
    return as_spectra(refined, method, seed, refined.outcome, refined.outcome.value)
