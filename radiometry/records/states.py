"""What is unknown of a capture beyond Gaussian errors: a few states, each with its probability.

    signal (J,) = response @ reflectance + pattern (J, V) @ variables (V,) + errors

The variables, such as the gloss of a surface, are Gaussian in every state, and their distribution a
mixture over states. With one state of no mean it is one more Gaussian error.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

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
