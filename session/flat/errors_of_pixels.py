"""White at every pixel of a photo of flat samples, and the errors of the pixels' signals.

Both change slowly over the photo: they are known at the nodes of a coarse grid, and between these
by straight lines. What a pixel errs by depends on its signal, on white there, and on its noise.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.light_drift import drift_covariance
from spectrabox.radiometry.records import Calibration, SurfaceSignals
from spectrabox.sampling.prior.mixture import GRID as PRIOR_GRID
from spectrabox.sampling.prior.mixture import LogitMixture
from spectrabox.sampling.prior.posterior import mean_and_spread, posterior
from spectrabox.session.config.session_schema import ViewInputs
from spectrabox.session.flat.signals_stage import (
    GUESSED,
    drift_of,
    model_error,
    response_of,
    white_of_photo,
)
from spectrabox.session.stages.error_budget import light_covariance, sensitivity_covariance
from spectrabox.session.stages.inputs import GRID
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import photo_of

COLUMNS = 24                # of the grid
GUESSED_AT_ONCE = 500
GUESSED_STILL = 1e-3        # logits: a guess need not be nearer to its mode


@dataclass(frozen=True)
class White:
    """White at n points, and what is unknown of it."""

    signal: np.ndarray          # (n, K)
    log: np.ndarray             # (n, K, K) covariance of its logarithm
    log_and_glare: np.ndarray   # (n, K, K) between its logarithm and the glare

    def repeated(self, count: int) -> White:
        """The first point ``count`` times."""
        return White(*(np.repeat(part[:1], count, axis=0)
                       for part in (self.signal, self.log, self.log_and_glare)))


@dataclass(frozen=True)
class PixelErrors:
    """White over a photo, at (h, w) nodes, and all else that its pixels' errors depend on."""

    x_px: np.ndarray            # (w,) of the nodes, in pixels of the photo
    y_px: np.ndarray            # (h,)
    white: White                # at the nodes, row by row
    glare: np.ndarray           # (K,) signal
    glare_covariance: np.ndarray    # (K, K)
    veil: np.ndarray            # (K,) signal: standard error of one veil over the whole photo
    shared: np.ndarray          # (K, K) relative covariance that all pixels share
    model: np.ndarray           # (K, K) relative covariance that every pixel has for itself
    calibration: Calibration
    response: np.ndarray        # (K, P) on GRID, rows summing to 1
    prior: LogitMixture

    @property
    def relative_response(self) -> np.ndarray:
        """Response (K, 61) on the prior's wavelengths."""
        return self.response @ interpolation_matrix(PRIOR_GRID.nm, GRID.nm)

    def over(self, values: np.ndarray, y_px: np.ndarray, x_px: np.ndarray) -> np.ndarray:
        """Values of the nodes (h w, ...) at rows and columns (n, m) of the photo, (n, m, ...)."""
        grid = values.reshape(self.y_px.size, self.x_px.size, -1)
        rows, columns = (interpolation_matrix(nodes, np.clip(at, nodes[0], nodes[-1]))
                         for nodes, at in ((self.y_px, y_px), (self.x_px, x_px)))
        found = np.stack([rows @ grid[..., part] @ columns.T for part in range(grid.shape[2])],
                         axis=-1)
        return found.reshape(*found.shape[:2], *values.shape[1:])

    def white_at(self, y_px: np.ndarray, x_px: np.ndarray) -> White:
        """White at every pixel (n m) of some rows and columns."""
        logs = np.log(self.white.signal)
        parts = [self.over(part, y_px, x_px) for part in (logs, self.white.log,
                                                          self.white.log_and_glare)]
        log, covariance, between = (part.reshape(-1, *part.shape[2:]) for part in parts)
        return White(np.exp(log), covariance, between)

    def covariance(self, signals: np.ndarray, white: White, variance: np.ndarray) -> np.ndarray:
        """Covariance (n, K, K) of signals relative to white.

        As ``at_white``, with what ``by_curves`` adds.
        """
        return self.at_white(signals, white, variance) + self.by_curves(signals)

    def at_white(self, signals: np.ndarray, white: White, variance: np.ndarray) -> np.ndarray:
        """Covariance (n, K, K) of signals by all but the curves of camera and light.

        Parameters
        ----------
        signals : (n, K) array
        white : White
            Where they were photographed.
        variance : (n, K) array
            Of the photo's noise there.
        """
        inverse = 1 / white.signal
        between = signals[:, :, None] * white.log_and_glare * inverse[:, None, :]
        veil = self.veil * inverse
        covariance = _outer(signals) * (white.log + self.shared + self.model) \
            + between + between.transpose(0, 2, 1) \
            + _outer(inverse) * self.glare_covariance + _outer(veil)
        own = variance * inverse**2
        covariance += own[:, :, None] * np.eye(signals.shape[1])
        return np.asarray((covariance + covariance.transpose(0, 2, 1)) / 2)

    def by_curves(self, signals: np.ndarray) -> np.ndarray:
        """Covariance (n, K, K) of signals by the errors of sensitivities and light, for the spectra
        that are likely behind.
        """
        bands = signals.shape[1]
        surfaces = SurfaceSignals(
            tuple(map(str, range(len(signals)))), (False,) * len(signals), GRID,
            self._guesses(signals), tuple(map(str, range(bands))), np.zeros(bands, int),
            self.response, signals, ())
        calibrations = [self.calibration]
        return np.array([sensitivity_covariance(calibrations, surfaces, index)
                         + light_covariance(calibrations, surfaces, index)
                         for index in range(len(signals))]).reshape(-1, bands, bands)

    def _guesses(self, signals: np.ndarray) -> np.ndarray:
        guesses = np.empty((len(signals), GRID.nm.size))
        to_fine = interpolation_matrix(PRIOR_GRID.nm, GRID.nm)
        for start in range(0, len(signals), GUESSED_AT_ONCE):
            some = signals[start:start + GUESSED_AT_ONCE]
            mixture = posterior(self.prior, self.relative_response, some,
                                GUESSED**2 * np.eye(signals.shape[1]), still=GUESSED_STILL)
            guesses[start:start + len(some)] = mean_and_spread(mixture)[0] @ to_fine.T
        return guesses


def errors_of_pixels(task: StageTask, view: ViewInputs, calibration: Calibration,
                     within_px: Sequence[float], prior: LogitMixture) -> PixelErrors:
    """White and errors over a rectangle of a photo.

    Parameters
    ----------
    view : ViewInputs
        The photo; it shows a region.
    calibration : Calibration
        Of its camera and light.
    within_px : (x0, y0, x1, y1)
        Pixels of the photo.
    prior : LogitMixture
    """
    x0, y0, x1, y1 = within_px
    rows = max(round(COLUMNS * (y1 - y0) / (x1 - x0)), 2)
    x_px, y_px = np.linspace(x0, x1, COLUMNS), np.linspace(y0, y1, rows)
    nodes = np.stack(np.meshgrid(x_px, y_px), axis=-1).reshape(-1, 2)
    response, drift = response_of(calibration), drift_of(task)
    found = white_of_photo(task, view, response, drift, nodes)
    assert found is not None
    bands, count = found.glare.size, len(nodes)
    total, regions = found.covariance, len(found.samples.names) - count
    level, glare = slice(0, bands), slice(bands, 2 * bands)
    causes = np.arange(2 * bands + regions + count, len(total))
    log, between = np.empty((count, bands, bands)), np.empty((count, bands, bands))
    for node in range(count):
        # what all bands share there: the field, and the errors of the exposure
        common = np.r_[2 * bands + regions + node, causes]
        with_level = total[level, common].sum(axis=1)
        log[node] = total[level, level] + with_level[:, None] + with_level \
            + total[np.ix_(common, common)].sum()
        between[node] = total[level, glare] + total[common, glare].sum(axis=0)
    # a signal falls as white rises, and as glare does
    white = White(found.white[regions:], log, between)
    shared = np.zeros((bands, bands)) if drift is None or view.name else drift_covariance(drift)
    veil = task.config.stray_light.glare * photo_of(task.stored, view).signal.mean(axis=(0, 1))
    return PixelErrors(x_px, y_px, white, found.glare + found.mean[glare], total[glare, glare],
                       veil, shared, model_error(task).among_bands(bands),
                       calibration, response, prior)


def _outer(values: np.ndarray) -> np.ndarray:
    return np.asarray(values[:, :, None] * values[:, None, :])
