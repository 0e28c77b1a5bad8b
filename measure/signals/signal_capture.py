"""What `sample` is asked of signals, and what is to be said of how they were given."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.sampling.further.more_measurements import MoreMeasurement
from spectrabox.sampling.prior.mixture import LogitMixture

NEARLY_BLACK_XYZ = 1.1      # of white where it has Y = 1: who gives such values may mean that scale
OF_SRGB = Finding("signal.of-srgb", Severity.NOTE)


def of_colours(kind: str, values: np.ndarray) -> tuple[Finding, ...]:
    """What is to be known of colours that are given in place of signals.

    Parameters
    ----------
    kind : str
        "srgb", "lab" or "xyz".
    values : (..., 3) array
        As they were given.
    """
    largest = values.max(initial=0)
    if kind == "xyz":
        return (Finding("signal.xyz-nearly-black", Severity.NOTE),) \
            if 0 < largest <= NEARLY_BLACK_XYZ else ()
    if kind == "srgb":
        return (*([Finding("signal.srgb-nearly-black", Severity.NOTE)] if 0 < largest <= 1 else []),
                OF_SRGB)
    return ()


def of_curves(error: float | None, allowed_for: float,
              doubts: Sequence[Finding] = ()) -> tuple[Finding, ...]:
    """What is to be known of a camera that was fitted.

    Parameters
    ----------
    error : float or None
        Standard error of its curves, of their highest peak; None where it is not known.
    allowed_for : float
        Relative error of each curve that is stated to the answer.
    doubts : sequence of Finding
        Of its fit.
    """
    found = tuple(Finding("camera.doubtful", Severity.NOTE, doubt.subject, {
        "code": doubt.code, "doubt": dict(doubt.values)}) for doubt in doubts)
    if error and not allowed_for:
        return (Finding("camera.errors-not-used", Severity.NOTE, values={"error": error}), *found)
    return found


def unstated(white: np.ndarray | None, noise: np.ndarray | None) -> tuple[Finding, ...]:
    """What was not stated of signals, and what was taken in its place.

    Parameters
    ----------
    white, noise : (K,) arrays or None
        As of `SignalCapture`.
    """
    return (*([Finding("signal.no-white", Severity.NOTE)] if white is None else []),
            *([Finding("signal.no-noise", Severity.NOTE)] if noise is None else []))


@dataclass(frozen=True, eq=False)
class SignalCapture:
    """Signals that one camera gave under one light, and what is stated of them.

    Attributes
    ----------
    relative_response : (K, 301) array
        At every nm, rows summing to 1.
    signals : (S, K) array
    names : tuple of S str
        Empty of a signal that stands alone.
    white : (K,) array, optional
        What a perfect white reads, in the signals' unit; 1 by default. Ones of colours, which are
        relative to white by what they are.
    noise : (K,) array, optional
        Standard errors in the signals' unit; none by default, which the answer says.
    light_error, sensitivity_error : float
        Relative standard errors of the light scale and of each curve.
    prior : LogitMixture, optional
        On reflectances; the one shipped by default.
    more : sequence of MoreMeasurement
        Of the same surface as each signal.
    twice : SpectralMeasurement, optional
        Light reflected twice off the surface.
    given : tuple of Finding
        Of where the signals are from, and of the camera's curves.
    """

    relative_response: np.ndarray
    signals: np.ndarray
    names: tuple[str, ...]
    white: np.ndarray | None = None
    noise: np.ndarray | None = None
    light_error: float = 0.0
    sensitivity_error: float = 0.0
    prior: LogitMixture | None = None
    more: Sequence[MoreMeasurement] = ()
    twice: SpectralMeasurement | None = None
    given: tuple[Finding, ...] = ()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was taken of the signals where nothing was stated, where they are from, and what is
        not known of the camera.
        """
        return (*unstated(self.white, self.noise), *self.given)
