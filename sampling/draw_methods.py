"""One signal, one method, T spectra: every method is one file with one function of one signature.

A new method is a file with a function like these, and a line in METHODS.
"""
from __future__ import annotations

from collections.abc import Callable

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import SpectralMeasurement, SpectrumSamples
from spectrabox.sampling.prior import mixture, signal_posterior
from spectrabox.sampling.published.per_axis_box import sample_published
from spectrabox.sampling.uniform import sample_uniform

# (measurement, draws, seed, coefficients, prior) -> samples
Method = Callable[[SpectralMeasurement, int, int, int, mixture.LogitMixture | None],
                  SpectrumSamples]
METHODS: dict[str, Method] = {"paper": sample_published, "uniform": sample_uniform,
                              "prior": signal_posterior.sample_prior}


def draw_spectra(measurement: SpectralMeasurement, method: str, draws: int, seed: int,
                 coefficients: int, prior: mixture.LogitMixture | None = None) -> SpectrumSamples:
    """Spectra that fit a measurement, drawn by one of the METHODS.

    Parameters
    ----------
    measurement : SpectralMeasurement
        Its noise covariance should carry photo noise and calibration error; zeros for a hard
        equality.
    method : str
        A key of METHODS.
    draws : int
        T.
    seed : int
        The same seed gives the same draws bit for bit.
    coefficients : int
        N of the spline class; the learnt prior's draws are fitted by such splines afterwards.
    prior : LogitMixture, optional
        Of the method "prior"; the one shipped with the project by default.

    Raises
    ------
    InputError
        For an unknown method, or a measurement that cannot be sampled.
    CalibrationError
        If bands respond alike.
    ConvergenceError
        If the sampler fails; the message says what to change.
    """
    if method not in METHODS:
        raise InputError(f"the method {method!r} is not known; known are {', '.join(METHODS)}")
    return METHODS[method](measurement, draws, seed, coefficients, prior)
