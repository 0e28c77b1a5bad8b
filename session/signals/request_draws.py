"""Draws for one signal and everything else that was measured, by the method and options that were
asked for.
"""
from __future__ import annotations

from dataclasses import dataclass

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import SpectrumSamples
from spectrabox.sampling.further.more_measurements import MoreMeasurement, joined
from spectrabox.sampling.further.self_reflection import given_reflected_twice, proposals_for
from spectrabox.sampling.measurement import SpectralMeasurement, SpectralSamples
from spectrabox.sampling.methods import METHODS, draw_spectra, into_reach
from spectrabox.sampling.polytope.refinement import sample_refined
from spectrabox.sampling.prior.mixture import GRID, LogitMixture
from spectrabox.sampling.published.options import ranked, refined_as_published


@dataclass(frozen=True)
class DrawOptions:
    """How to draw: N, method, T, seed, c0 of the method paper, and what the paper does beyond."""

    coefficients: int
    method: str
    samples: int
    seed: int
    start: str
    keep: int | None  # rank by the further measurements and keep so many (Eqs. 9, 10); paper only
    refine: int | None          # coefficients of the fine basis; paper and uniform


def check_options(options: DrawOptions) -> None:
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


def draws_of(options: DrawOptions, base: SpectralMeasurement, more: list[MoreMeasurement],
             twice: SpectralMeasurement | None,
             prior: LogitMixture | None) -> tuple[SpectralSamples, SpectralMeasurement]:
    """Draws, and the measurement that they obey.

    Raises
    ------
    InputError, CalibrationError, ConvergenceError
        Contradictory measurements are named.
    """
    if options.keep is not None:
        samples = _drawn(options, base, options.samples, prior)
        return ranked(samples, base, more, None if twice is None else twice.signal,
                      options.keep), base
    measurement = joined(base, more)
    if twice is None:
        return _drawn(options, measurement, options.samples, prior), measurement
    many = _drawn(options, measurement, proposals_for(options.samples), prior)
    return given_reflected_twice(many, twice, options.samples), measurement


def _drawn(options: DrawOptions, measurement: SpectralMeasurement, draws: int,
           prior: LogitMixture | None) -> SpectralSamples:
    if options.refine is None:
        return draw_spectra(measurement, options.method, draws, options.seed, options.coefficients,
                            prior, options.start == "unbounded")
    if options.method == "paper":
        return _as_spectra(refined_as_published(measurement, options.coefficients, options.refine,
                                                draws, options.seed))
    operator, _ = into_reach(measurement.operator(options.coefficients))
    return _as_spectra(sample_refined(measurement.response, measurement.grid.nm, operator,
                                      options.refine, draws, options.seed))


def _as_spectra(samples: SpectrumSamples) -> SpectralSamples:
    spectra = samples.coefficients @ basis_matrix(GRID.nm, samples.coefficients.shape[1]).T
    return SpectralSamples(GRID, spectra, samples.coefficients, samples.method,
                           samples.effective_samples, samples.seed, samples.outcome.value)
