"""Spectra, lights, and what is known of a surface's spectrum: signals, states, draws, summaries.

What is unknown of a capture beyond Gaussian errors: a few states, each with its probability.

    signal (J,) = response @ reflectance + pattern (J, V) @ variables (V,) + errors

The variables, such as the gloss of a surface, are Gaussian in every state, and their distribution a
mixture over states. With one state of no mean it is one more Gaussian error.
"""


from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Annotated, Any

import numpy as np

from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.shaped import Record


@dataclass(frozen=True, eq=False)
class CaptureStates(Record):
    """The H states in which a capture may have been, and V variables that add to the signal."""

    names: tuple[str, ...]                          # of the V variables
    causes: tuple[str, ...]                         # of error under which each is counted
    pattern: Annotated[np.ndarray, "J V"]           # what one unit of a variable adds to a band
    least: Annotated[np.ndarray, "V"]               # that a variable can be; -inf for any
    kinds: tuple[str, ...]                          # of the H states; several may be of one kind
    weights: Annotated[np.ndarray, "H"]             # probabilities beforehand; they sum to 1
    means: Annotated[np.ndarray, "H V"]
    # of variables of different causes uncorrelated within a state
    covariances: Annotated[np.ndarray, "H V V"]

    @property
    def added(self) -> np.ndarray:
        """What the mean of the variables adds to the signal in each state (H, J)."""
        return np.asarray(self.means @ self.pattern.T)

    @property
    def added_covariances(self) -> np.ndarray:
        """Covariances (H, J, J) of what the variables add in each state."""
        return np.asarray(self.pattern @ self.covariances @ self.pattern.T)

    @property
    def mean(self) -> np.ndarray:
        """Mean (V,) of the variables over all states."""
        return np.asarray(self.weights @ self.means)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (V, V) of the variables over all states."""
        off = self.means - self.mean
        return np.asarray(np.einsum("h,hvw->vw", self.weights, self.covariances)
                          + (self.weights[:, None] * off).T @ off)

    def of_cause(self, cause: str) -> np.ndarray:
        """The pattern (J, V) with zeros for variables of other causes."""
        return np.asarray(self.pattern * (np.array(self.causes) == cause))

    def through(self, gain: np.ndarray) -> CaptureStates:
        """The same for signals that are a matrix (K, J) times these."""
        return replace(self, pattern=gain @ self.pattern)


def added_by_cause(states: CaptureStates) -> dict[str, np.ndarray]:
    """Covariances (J, J) of what the variables of each cause add to the signal, over all states.

    Parameters
    ----------
    states : CaptureStates
    """
    covariance = states.covariance
    return {cause: pattern @ covariance @ pattern.T for cause in dict.fromkeys(states.causes)
            for pattern in [states.of_cause(cause)]}


def independent_states(first: CaptureStates, second: CaptureStates) -> CaptureStates:
    """All pairs of the states of two independent things that befell one signal (J,).

    Parameters
    ----------
    first : CaptureStates
    second : CaptureStates
        Of the same bands.
    """
    count, own = len(first.weights), len(first.names)
    pairs = [(a, b) for a in range(count) for b in range(len(second.weights))]
    covariances = np.zeros((len(pairs), *(2 * [own + len(second.names)])))
    for number, (a, b) in enumerate(pairs):
        covariances[number, :own, :own] = first.covariances[a]
        covariances[number, own:, own:] = second.covariances[b]
    return CaptureStates(
        first.names + second.names, first.causes + second.causes,
        np.hstack([first.pattern, second.pattern]), np.r_[first.least, second.least],
        tuple(", ".join(kind for kind in (first.kinds[a], second.kinds[b]) if kind)
              for a, b in pairs),
        np.array([first.weights[a] * second.weights[b] for a, b in pairs]),
        np.array([np.r_[first.means[a], second.means[b]] for a, b in pairs]), covariances)


@dataclass(frozen=True, eq=False)
class StateEstimate(Record):
    """What one signal says of the states of its capture."""

    names: tuple[str, ...]                          # of the V variables
    mean: Annotated[np.ndarray, "V"]
    standard_deviation: Annotated[np.ndarray, "V"]
    shares: dict[str, float]                        # probability of each kind; they sum to 1


# ---- spectra, lights, and what is known of a surface's spectrum: signals, draws, summaries -------

# Callback of long work: the share that is done, 0 to 1, and what is being done.
Progress = Callable[[float, str], None]


class Quantity(Enum):
    """What a spectrum is a spectrum of; the value is its unit."""

    REFLECTANCE = "1"
    IRRADIANCE = "W m-2 nm-1"
    RADIANCE = "W m-2 sr-1 nm-1"
    RELATIVE = "relative"


# How a source names curves that were fitted under a light that nobody knew: they hold for photos
# under that light alone.
PRODUCTS = "products of sensitivity and light"


DRAWS = "draws."     # topic of the findings on how a fit or a sampler ended


class Outcome(Enum):
    """How a fit or a sampler ended; the value is the end of its finding's code, "draws.converged".
    """

    CONVERGED = "converged"
    STEP_LIMIT = "step-limit"
    ILL_POSED = "ill-posed"

    # draws of spectra as intended
    EXACT = "exact"
    FAMILIAR = "familiar"
    THROUGH_TRANSPORT = "through-transport"

    # draws of spectra with a reservation
    UNREACHABLE = "unreachable"
    MOVED = "moved"
    AS_PUBLISHED = "as-published"
    RANKED = "ranked"
    UNFAMILIAR = "unfamiliar"
    BEYOND_LEARNT = "beyond-learnt"
    TOO_ROUGH = "too-rough"
    OUT_OF_REACH = "out-of-reach"
    UNSAID = "unsaid"
    DISAGREES = "disagrees"

    @property
    def as_intended(self) -> bool:
        """Whether draws ended so without a reservation."""
        return self in (Outcome.EXACT, Outcome.FAMILIAR, Outcome.THROUGH_TRANSPORT)

    def finding(self, **values: Any) -> Finding:
        """It as a finding: evidence of a fault but of what is as intended. What was solved though
        the data leave something open is, as bands carry that; and so they do of a colour that is
        unlike those learnt from, as saturated ones are in faultless photos.
        """
        severity = Severity.WARN
        if self.as_intended or self in (Outcome.CONVERGED, Outcome.ILL_POSED):
            severity = Severity.INFO
        elif self is Outcome.UNFAMILIAR:
            severity = Severity.NOTE
        return Finding(DRAWS + self.value, severity, values=values)


@dataclass(frozen=True, eq=False)
class WavelengthGrid(Record):
    """Wavelengths and the weights that integrate over them (trapezoid rule)."""

    nm: Annotated[np.ndarray, "P"]
    weights_nm: Annotated[np.ndarray, "P"]


@dataclass(frozen=True, eq=False)
class Spectrum(Record):
    """One spectrum on its own grid. ``standard_error`` is None where nobody stated it."""

    grid: WavelengthGrid
    values: Annotated[np.ndarray, "P"]
    quantity: Quantity
    source: str
    standard_error: Annotated[np.ndarray, "P"] | None = None


@dataclass(frozen=True, eq=False)
class UnknownLight(Record):
    """A light whose spectrum nobody stated; what is known of it narrows the lamps it may be."""

    kind: str | None = None     # one of light_words.LIGHT_KINDS
    cct: float | None = None    # correlated colour temperature, K

    @property
    def stated(self) -> str:
        """What was stated of it: a kind, a temperature; empty where nothing was."""
        return (self.kind or "") if self.cct is None else f"{self.cct:g} K"

    @property
    def words(self) -> str:
        """What is known of it, as a report says it."""
        if self.cct is not None:
            return f"unknown light of {self.stated}"
        return f"unknown light, {self.stated}" if self.stated else "unknown light"


def default_band_names(count: int) -> tuple[str, ...]:
    """Names of bands that nobody named: R, G, B of three, else band 1, band 2 ..."""
    return ("R", "G", "B") if count == 3 else tuple(f"band {band + 1}" for band in range(count))


@dataclass(frozen=True, eq=False)
class SurfaceSignals(Record):
    """What the photos of a session say of M surfaces, in the J bands of all lights.

    ``signal = response @ reflectance + errors``, relative to a perfect white in the surface's
    position. The errors are independent of each other, and of what the states of the capture add.
    """

    names: tuple[str, ...]
    known: tuple[bool, ...]                         # True: spectrum given, not estimated
    grid: WavelengthGrid
    spectra: Annotated[np.ndarray, "M P"]           # given, or the estimate about which errors hold
    bands: tuple[str, ...]                          # J names
    view_of_band: Annotated[np.ndarray, "J"]        # int, index of the photo's view
    response: Annotated[np.ndarray, "J P"]          # of each band; rows sum to 1
    signal: Annotated[np.ndarray, "M J"]            # relative to white; NaN where not photographed
    errors: dict[str, Annotated[np.ndarray, "M J J"]]   # covariance by cause: what bands share too
    # of each surface, in the J bands: what its gloss may have added; none where nothing may
    states: tuple[CaptureStates, ...] = ()


@dataclass(frozen=True, eq=False)
class SpectralMeasurement(Record):
    """What the camera said of one surface: ``signal = relative_response @ reflectance + noise``.

    ``relative_response`` is sensitivity x light x weight in nm, divided by its sum in each band, so
    that every row sums to 1 and a reflectance of 1 gives a signal of 1. The noise is without what
    the states of the capture add. ``relative_covariance`` is that of the errors among it that
    multiply the signal, of the logarithm of their factor (`error_model.split_errors`); None: all
    errors add to it.
    """

    grid: WavelengthGrid
    relative_response: Annotated[np.ndarray, "K P"]
    signal: Annotated[np.ndarray, "K"]
    noise_covariance: Annotated[np.ndarray, "K K"]     # of all errors, about the signal
    states: CaptureStates | None = None
    relative_covariance: Annotated[np.ndarray, "K K"] | None = None


@dataclass(frozen=True, eq=False)
class SpectrumSamples(Record):
    """Draws from all spectra that fit one measurement, all equally likely, and the spline nearest
    to each.
    """

    grid: WavelengthGrid
    spectra: Annotated[np.ndarray, "T P"]
    coefficients: Annotated[np.ndarray, "T N"]      # of the splines, in [0, 1]
    method: str
    effective_samples: float
    seed: int
    outcome: Outcome
    findings: tuple[Finding, ...]                   # the outcome, and what it is conditional on
    # of the variables of the capture's states, such as the gloss, that each draw goes with
    variables: Annotated[np.ndarray, "T V"] | None = None


@dataclass(frozen=True, eq=False)
class SpectrumSummary(Record):
    """What is known of one spectrum, and conditional on what."""

    grid: WavelengthGrid
    mean: Annotated[np.ndarray, "P"]
    standard_deviation: Annotated[np.ndarray, "P"]
    lower: Annotated[np.ndarray, "P"]               # pointwise band at ``level``
    upper: Annotated[np.ndarray, "P"]
    # exact lowest and highest over all spectra of the class
    bound_lower: Annotated[np.ndarray, "P"]
    bound_upper: Annotated[np.ndarray, "P"]
    level: float
    conditional_on: tuple[Finding, ...]
    next_measurement_nm: float  # one more reading here would narrow the band most
    samples: SpectrumSamples | None = None          # that it was made from, where there were any
    # of the variance of the spectrum, by cause; none of draws of all surfaces at once
    variance_shares: dict[str, float] = field(default_factory=dict)
    # that the signal allows; none without the learnt prior
    family_shares: dict[str, float] = field(default_factory=dict)
    # what the signal says of the surface's gloss; None where the learnt prior was not asked
    states: StateEstimate | None = None

    @property
    def draws(self) -> SpectrumSamples:
        """``samples``, of a summary that was made from draws."""
        assert self.samples is not None, "the summary was made from draws"
        return self.samples
