"""What `sample` is asked of signals, and what is to be said of how they were given."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.measure import texts
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.sampling.further.more_measurements import MoreMeasurement
from spectrabox.sampling.prior.mixture import LogitMixture

NEARLY_BLACK_XYZ = 1.1      # of white where it has Y = 1: who gives such values may mean that scale
SRGB_ORIGIN = ("an sRGB colour is what a camera's processing or a designer made: these are spectra "
               "of surfaces that would look so in daylight, not of what was photographed")
NEARLY_BLACK_SRGB = ("R, G, B are taken with 255 for white, so that this colour is nearly black; "
                     "multiply them by 255 where white is 1")
NEARLY_BLACK = ("X, Y, Z are taken with Y = 100 for white, so that this colour is nearly black; "
                "multiply them by 100 where white has Y = 1")
NO_WHITE = ("no white was stated (--white, white=): the signal is taken as relative to a perfect "
            "white, which values of a raw photo are not")
NO_NOISE = ("no noise was stated (--noise, noise=): the signal is taken as exact, and the band is "
            "narrower than a photo's")


def origin_of_colours(kind: str, values: np.ndarray) -> str | None:
    """What an answer has to say of colours that are given in place of signals; None of most.

    Parameters
    ----------
    kind : str
        "srgb", "lab" or "xyz".
    values : (..., 3) array
        As they were given.
    """
    if kind == "xyz":
        return NEARLY_BLACK if values.size and 0 < values.max() <= NEARLY_BLACK_XYZ else None
    if kind == "srgb":
        dark = values.size and 0 < values.max() <= 1
        return f"{NEARLY_BLACK_SRGB}\n{SRGB_ORIGIN}" if dark else SRGB_ORIGIN
    return None


def curve_caveats(error: float | None, allowed_for: float,
                  doubts: Sequence[Finding] = ()) -> tuple[str, ...]:
    """What an answer has to say of a camera that was fitted.

    Parameters
    ----------
    error : float or None
        Standard error of its curves, of their highest peak; None where it is not known.
    allowed_for : float
        Relative error of each curve that is stated to the answer.
    doubts : sequence of Finding
        Of its fit.
    """
    said = tuple(f"the camera's fit is doubtful: {texts.says(doubt)}" for doubt in doubts)
    if error and not allowed_for:
        said = (f"the camera's curves have standard errors ({100 * error:.2g} % of the highest "
                "peak, root mean square), which are not used here: the band is narrower than they "
                "make it; state an error of each curve (--sensitivity-error, sensitivity_error=), "
                "or measure by the chart of the photo itself (spectrabox flat)", *said)
    return said


def unstated(white: np.ndarray | None, noise: np.ndarray | None) -> tuple[str, ...]:
    """What was not stated of signals, and what was taken in its place, in sentences.

    Parameters
    ----------
    white, noise : (K,) arrays or None
        As of `SignalCapture`.
    """
    return (*([NO_WHITE] if white is None else []), *([NO_NOISE] if noise is None else []))


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
    origin : str, optional
        What an answer has to say of where the signals are from.
    camera_caveats : tuple of str
        What it has to say of the camera's curves.
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
    origin: str | None = None
    camera_caveats: tuple[str, ...] = ()

    @property
    def caveats(self) -> tuple[str, ...]:
        """Where the signals are from, what was taken of them where nothing was stated, and what is
        not known of the camera.
        """
        return (*([] if self.origin is None else [self.origin]),
                *unstated(self.white, self.noise), *self.camera_caveats)
