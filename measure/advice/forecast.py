"""How well a spectrum would be known after an action, by the solver that finds it now.

A surface now has a reflectance r and variables v of its capture, such as its gloss; what they leave
of its signal are the errors e, of covariance S. An action makes the errors of the bands others, or
adds bands. With S' their covariance after it, and C the part of S' between all bands and the first
ones, the signal to expect is

    signal' = response' r + pattern' v' + C S^-1 e

since what an action takes off an error is independent of what it leaves. Errors in proportion to
the signal are in proportion to that one. It is solved as the photo will be. Of r, v and e the
expected values serve: the mean over draws of them is within 1 % of it for bands (after further
photos 2 to 3 % wider), and takes as many times longer as there are draws.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spectrabox.measure.advice.advice import Advice, advice
from spectrabox.measure.surfaces.surface_signals import measurement
from spectrabox.radiometry import appearance, error_model, grid
from spectrabox.radiometry.records import spectra
from spectrabox.sampling.prior import mixture, signal_posterior

SLOPE = 1e-3            # of reflectance, by which a colour's derivative is found
RANK = 1e-9             # of the largest variance: smaller ones are none
LEAST = 1e-6            # standard deviation of a variable that is certain
# of an outlook (2,), which is how well a spectrum is known: width of the band, mean over
# wavelength; CIEDE2000 under D65 from the mean, root mean square
WIDTH, COLOUR = 0, 1


@dataclass(frozen=True, eq=False)
class Unknown:
    """One surface as it is known now."""

    prior: mixture.LogitMixture
    level: float                    # of the band
    signals: spectra.SurfaceSignals         # of it alone
    spectrum: np.ndarray            # (61,) mean reflectance
    variables: np.ndarray           # (V,) mean of what its states add
    found: np.ndarray               # (2,) outlook that its answer states
    solved: np.ndarray              # (2,) the same by the forecast's way
    reading_nm: float               # where a reading tells most
    stated: str | None = None       # how much it mirrors
    matt: float = 0.0               # probability of that

    def advice(self, action: str, after: np.ndarray, subject: str = "",
               stops: Sequence[float] = (), dark: Sequence[int] = ()) -> Advice:
        """One action, as a ratio to what was found.

        Parameters
        ----------
        action, subject, stops, dark
            As of `advice.advice`.
        after : (2,) array
            Outlook by the forecast.
        """
        return advice(action, self.found, self.found * after / self.solved, subject, stops, dark)


def outlook_of(posterior: signal_posterior.SignalPosterior, level: float) -> np.ndarray:
    """Outlook (2,), WIDTH and COLOUR, of a spectrum by its posterior.

    Parameters
    ----------
    posterior : SignalPosterior
    level : float
        Of the band.
    """
    lower, upper = posterior.band(level)
    mean = posterior.mean
    colour = appearance.reflectance_to_lab(mixture.PRIOR_GRID.nm, mean)
    slope = (appearance.reflectance_to_lab(mixture.PRIOR_GRID.nm, mean + SLOPE * np.eye(mean.size))
             - colour).T / SLOPE
    values, vectors = np.linalg.eigh(slope @ posterior.covariance @ slope.T)
    off = appearance.ciede2000(colour, colour + (np.sqrt(np.maximum(values, 0)) * vectors).T)
    return np.array([np.mean(upper - lower), np.sqrt(np.sum(off**2))])


def outlook_of_answer(samples: spectra.SpectrumSamples, lower: np.ndarray,
                      upper: np.ndarray) -> np.ndarray:
    """Outlook (2,) of a spectrum by the draws and the band that an answer states of it.

    Parameters
    ----------
    samples : SpectrumSamples
    lower, upper : (P,) arrays
    """
    colours = appearance.reflectance_to_lab(samples.grid.nm, samples.spectra)
    colour = appearance.reflectance_to_lab(samples.grid.nm, samples.spectra.mean(axis=0))
    return np.array([np.mean(upper - lower),
                     np.sqrt(np.mean(appearance.ciede2000(colour, colours)**2))])


def outlook_of_signals(prior: mixture.LogitMixture, level: float,
                       signals: spectra.SurfaceSignals) -> np.ndarray:
    """Outlook (2,) of a spectrum by its signal.

    Parameters
    ----------
    prior : LogitMixture
    level : float
        Of the band.
    signals : SurfaceSignals
        Of the surface alone.
    """
    return outlook_of(signal_posterior.solve_posterior(prior, measurement(signals, 0)), level)


def outlook_after(unknown: Unknown, after: spectra.SurfaceSignals) -> np.ndarray:
    """Outlook (2,) that the spectrum is likely to have after an action.

    Parameters
    ----------
    unknown : Unknown
    after : SurfaceSignals
        Of the surface alone, whose first bands are those of now; their signals are not looked at.
    """
    signal = _expected_signal(unknown, after)
    return outlook_of_signals(
        unknown.prior, unknown.level,
        replace(
            after, signal=signal[None],
            errors={cause: covariance if error_model.CAUSES[cause].kind ==
                    "added" else _scaled(covariance, after.signal[0], signal)
                    for cause, covariance in after.errors.items()}))


def _scaled(covariance: np.ndarray, before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """The covariance of an error in proportion to signals (J,), of others."""
    scale = np.nan_to_num(np.divide(now, before, out=np.ones_like(now), where=before != 0), nan=1.0)
    return covariance * np.outer(scale, scale)


def left_errors(unknown: Unknown) -> np.ndarray:
    """What reflectance and variables leave of the signal (J,); NaN in bands that do not show it."""
    now = unknown.signals
    errors = now.signal[0] - now.response @ grid.interpolation_matrix(
        mixture.PRIOR_GRID.nm, now.grid.nm) @ unknown.spectrum
    return np.asarray(errors - now.states[0].pattern @ unknown.variables if now.states else errors)


def total_covariance(signals: spectra.SurfaceSignals) -> np.ndarray:
    """Covariance (J, J) of one surface's signal by all errors but its states."""
    return np.asarray(np.sum([covariance[0] for covariance in signals.errors.values()], axis=0))


def _expected_signal(unknown: Unknown, after: spectra.SurfaceSignals) -> np.ndarray:
    """The signal (J,) that the surface is likely to give; NaN in bands that do not show it."""
    now = unknown.signals
    seen = np.flatnonzero(np.isfinite(now.signal[0]))
    before, shared = total_covariance(now)[np.ix_(seen, seen)], total_covariance(after)[:, seen]
    errors = shared @ np.linalg.lstsq(before, left_errors(unknown)[seen], rcond=RANK)[0]
    spectrum = grid.interpolation_matrix(mixture.PRIOR_GRID.nm, now.grid.nm) @ unknown.spectrum
    signal = after.response @ spectrum + errors
    if after.states:
        signal += after.states[0].pattern @ _variables_given(after.states[0], now.states[0].names,
                                                             unknown.variables)
    signal[:now.signal.size][np.isnan(now.signal[0])] = np.nan
    return np.asarray(signal)


def _variables_given(states: spectra.CaptureStates, names: Sequence[str],
                     values: np.ndarray) -> np.ndarray:
    """Means (V,) of the variables of states, some of which have the values (v,) of these names."""
    given = [states.names.index(name) for name in names]
    rest = [index for index in range(len(states.names)) if index not in given]
    variables = np.zeros(len(states.names))
    variables[given] = values
    if rest:
        own = states.covariances[:, given][:, :, given] + LEAST**2 * np.eye(len(given))
        off = (values - states.means[:, given])[..., None]
        solved = np.linalg.solve(own, off)
        log = np.log(states.weights) - ((off * solved).sum(axis=(1, 2))
                                        + np.linalg.slogdet(own)[1]) / 2
        shares = np.exp(log - log.max())
        means = states.means[:, rest] + (states.covariances[:, rest][:, :, given] @ solved)[..., 0]
        variables[rest] = shares / shares.sum() @ means
    return np.maximum(variables, states.least)
