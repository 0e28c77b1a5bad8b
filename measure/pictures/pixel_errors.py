"""Errors of pixels' signals by cause, and why a pixel has no spectrum.

White at every pixel of a photo, and the covariance of the pixels' signals.

White and its errors are known at nodes, and interpolated linearly between them. The covariance of a
pixel depends on its signal, on white there, and on its noise.
"""


from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from spectrabox.measure.pictures import illumination
from spectrabox.radiometry import error_model, grid
from spectrabox.radiometry.records.calibration import Calibration
from spectrabox.radiometry.records.spectra import CaptureStates, SurfaceSignals
from spectrabox.sampling.prior import local_posteriors, mixture_posterior
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, reflectance_moments

EXPECTED = 0.01         # of white: error of the signals whose spectra the errors are evaluated at
EXPECTED_AT_ONCE = 500
UNSEEN = 100.0          # of white: error of a band that says nothing
COARSE_TOLERANCE = 1e-3     # logits: a coarse spectrum need not be nearer to its mode


@dataclass(frozen=True)
class White:
    """White at n points, and what is unknown of it."""

    signal: np.ndarray          # (n, K)
    log: np.ndarray             # (n, K, K) covariance of its logarithm
    log_and_glare: np.ndarray   # (n, K, K) between its logarithm and the glare

    def rows(self, index: np.ndarray) -> White:
        """Some of the points, by their index."""
        return White(self.signal[index], self.log[index], self.log_and_glare[index])


@dataclass(frozen=True, eq=False)
class PixelErrors:
    """White and light over a photo, at N nodes, and all that its pixels' errors depend on."""

    between: Callable[[int, int], csr_array]    # weights (n, N) of the nodes at pixels of some rows
    white: White                # at the nodes
    light: illumination.Illumination         # at the nodes
    glare: np.ndarray           # (K,) signal
    glare_covariance: np.ndarray    # (K, K) of it and of the veil over the whole photo
    gloss: CaptureStates        # what surfaces may mirror, relative to white, in the K bands
    relative: np.ndarray        # (K, K) further relative covariance: disagreement of photo and
    # model
    # of the photos, with each of the J typical lights
    calibrations: Sequence[Sequence[Calibration]]
    photo_of_band: np.ndarray   # (K,) whose calibration is that of each band
    fine_responses: np.ndarray  # (J, K, P) on FINE_GRID, rows summing to 1
    prior: LogitMixture

    @cached_property
    def responses(self) -> np.ndarray:
        """Relative response (J, K, 61) under the typical lights."""
        return self.light.responses

    @cached_property
    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (61,) and covariance (61, 61) of reflectances by the prior."""
        return reflectance_moments(self.prior)

    @cached_property
    def by_gloss(self) -> np.ndarray:
        """Covariance (K, K) of signals by what surfaces mirror."""
        return np.asarray(self.gloss.pattern @ self.gloss.covariance @ self.gloss.pattern.T)

    def white_at(self, weights: csr_array) -> White:
        """White at the pixels (n) of some weights of the nodes."""
        logs = np.log(self.white.signal)
        parts = [(weights @ part.reshape(len(logs), -1)).reshape(-1, *part.shape[1:])
                 for part in (logs, self.white.log, self.white.log_and_glare)]
        return White(np.exp(parts[0]), *parts[1:])

    def at_white(self, signals: np.ndarray, white: White, variance: np.ndarray) -> np.ndarray:
        """Covariance (n, K, K) of signals by all but the curves of camera and light; gloss is one
        Gaussian error, since pictures hold means and standard deviations.

        Parameters
        ----------
        signals : (n, K) array
            Less the mean gloss, which errors of white and light act on as well.
        white : White
            Where they were photographed.
        variance : (n, K) array
            Of the photo's noise there.
        """
        inverse = 1 / white.signal
        signals = signals + self.gloss.pattern @ self.gloss.mean
        between = signals[:, :, None] * white.log_and_glare * inverse[:, None, :]
        covariance = _outer(signals) * (white.log + self.relative) \
            + between + between.transpose(0, 2, 1) \
            + _outer(inverse) * self.glare_covariance + self.by_gloss
        own = variance * inverse**2
        covariance += own[:, :, None] * np.eye(signals.shape[1])
        return np.asarray((covariance + covariance.transpose(0, 2, 1)) / 2)

    def errors(self, signals: np.ndarray, white: White, variance: np.ndarray,
               by_curves: np.ndarray | None = None) -> error_model.Errors:
        """All errors of signals (n, K), with those of the curves (n, K, K) if given: what white is
        off by multiplies them, as do curves unless a band is nearly dark.

        Parameters
        ----------
        signals, white, variance
            As of `at_white`.
        by_curves : (n, K, K) array, optional
            From `by_curves`.
        """
        total, relative = self.at_white(signals, white, variance), white.log + self.relative
        if by_curves is not None:
            total = total + by_curves
            relative = relative + error_model.split_errors(
                signals, {error_model.SENSITIVITIES: by_curves}).relative
        return error_model.Errors.of_total(total, signals, relative)

    def by_curves(self, signals: np.ndarray, light: int,
                  seen: np.ndarray | None = None) -> np.ndarray:
        """Covariance (n, K, K) of signals (n, K) under one typical light by the errors of
        sensitivities, light and filters, for the spectra that the prior expects behind them.

        Parameters
        ----------
        signals : (n, K) array
        light : int
            Index of the typical light.
        seen : (K,) bool array, optional
            The bands that say something; all by default.
        """
        seen = np.ones(signals.shape[1], bool) if seen is None else seen
        spectra = np.empty((len(signals), PRIOR_GRID.nm.size))
        noise = of_seen(EXPECTED**2 * np.eye(signals.shape[1]), seen)
        gain, response = local_posteriors.informative_bands(self.moments[1],
                                                            self.responses[light], noise)
        for start in range(0, len(signals), EXPECTED_AT_ONCE):
            some = signals[start:start + EXPECTED_AT_ONCE]
            mixture = mixture_posterior.posterior(self.prior, response, some @ gain.T,
                                                  gain @ noise @ gain.T, tolerance=COARSE_TOLERANCE)
            spectra[start:start + len(some)] = mixture_posterior.mean_and_spread(mixture)[0]
        surfaces = SurfaceSignals(
            ("",) * len(signals), (False,) * len(signals), grid.FINE_GRID,
            spectra @ grid.interpolation_matrix(PRIOR_GRID.nm, grid.FINE_GRID.nm).T,
            ("",) * seen.size, self.photo_of_band, self.fine_responses[light],
            np.where(seen, signals, 0.0), {})
        return np.sum([
            by_cause(self.calibrations[light], surfaces)
            for by_cause in (error_model.sensitivity_covariance, error_model.light_covariance,
                             error_model.filter_covariance)
        ], axis=0)


def of_seen(covariance: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """A covariance (..., K, K) of signals with errors so large in the bands that are not seen (K,)
    that these say nothing.
    """
    return np.where(np.outer(seen, seen), covariance, UNSEEN**2 * np.eye(seen.size))


def _outer(values: np.ndarray) -> np.ndarray:
    return np.asarray(values[:, :, None] * values[:, None, :])
