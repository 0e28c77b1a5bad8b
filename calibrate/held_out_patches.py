"""Each patch of a chart as a calibration without it sees it.

With a Gaussian prior, linear equations and W the inverse covariance of their innovations r, the
weights of all data but those of patch i are

    v = W r - W_i (W_ii)^-1 (W r)_i

[Rasmussen & Williams 2006, Sec. 5.4.2], and the posterior covariance grows by G_i (W_ii)^-1 G_i^T
with the gain G = P J^T W: nothing is fitted again.
"""
from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.special import chdtrc

from spectrabox.calibrate import chart_equations
from spectrabox.radiometry.shaped import Record

ROUND_OFF = 1e-6        # relative, of signals in single precision


@dataclass(frozen=True, eq=False)
class PatchesWithout(Record):
    """What is known of I patches by fits without them: signal = integral of response x reflectance
    + offset.

    response = (coefficients @ basis.T) x power. The covariance is that of the coefficients, then of
    what is added to each band by exposure, field and glare (D = K N + K); ``noise`` is that of the
    patch's own signal, with the model error, were it not clipped.
    """

    basis: Annotated[np.ndarray, "P N"]
    power: Annotated[np.ndarray, "P"]               # light x integration weight
    coefficients: Annotated[np.ndarray, "I K N"]
    offset: Annotated[np.ndarray, "I K"]
    covariance: Annotated[np.ndarray, "I D D"]
    signal: Annotated[np.ndarray, "I K"]
    noise: Annotated[np.ndarray, "I K K"]
    clipped: Annotated[np.ndarray, "I K"]           # bool: of the signals, those that say nothing

    @property
    def response(self) -> np.ndarray:
        """Signal (I, K, P) of a reflectance of 1 at one wavelength alone."""
        return np.asarray(self.coefficients @ self.basis.T * self.power)

    def predicted(self, reflectances: np.ndarray) -> np.ndarray:
        """Signals (I, K) of reflectances (I, P)."""
        return np.asarray(np.einsum("ikp,ip->ik", self.response, reflectances) + self.offset)

    def known_within(self, reflectances: np.ndarray) -> np.ndarray:
        """Relative error (I, 2) of what a fit predicts of each patch in its clipped bands (of a
        patch that has none, in all), rms over them: by the bands that can be read, and had the fit
        used the clipped ones as well.
        """
        lost = chart_equations.variance_of_clipped(self.clipped, self.signal)
        without = self.error_covariance(reflectances) - self.noise - lost
        bands = self.clipped | ~self.clipped.any(axis=1, keepdims=True)
        errors = []
        for noise in (self.noise + lost, self.noise):
            # measured curves and patches without noise leave nothing uncertain: no inverse
            used = without - without @ np.linalg.pinv(without + noise, hermitian=True) @ without
            variance = np.maximum(np.einsum("ikk->ik", used), 0) / self.predicted(reflectances)**2
            errors.append(np.sqrt(np.sum(bands * variance, axis=1) / bands.sum(axis=1)))
        return np.stack(errors, axis=1)

    def deviations(self, reflectances: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """How much brighter than predicted each patch is (I,), relative and by generalised least
        squares over its bands; the standard error of that (I,); and the chance (I,) of bands that
        differ as much among each other.
        """
        # exact curves and patches without noise leave the round-off of stored signals
        covariance = self.error_covariance(reflectances) \
            + (ROUND_OFF * self.signal[:, :, None] * np.eye(self.signal.shape[1])) ** 2
        off = self.signal - self.predicted(reflectances)
        light = self.signal - off - self.offset
        weighted, innovation = (np.linalg.solve(covariance, vector[..., None])[..., 0]
                                for vector in (light, off))
        information = np.sum(light * weighted, axis=1)
        brighter = np.sum(off * weighted, axis=1) / information
        rest = np.sum(off * innovation, axis=1) - brighter**2 * information
        readable = np.sum(~self.clipped, axis=1)
        return brighter, information**-0.5, chdtrc(np.maximum(readable - 1, 1), rest)

    def error_covariance(self, reflectances: np.ndarray) -> np.ndarray:
        """Covariance (I, K, K) of signals less predictions, for reflectances (I, P); clipped
        signals are not known at all.
        """
        bands = self.signal.shape[1]
        seen = (reflectances * self.power) @ self.basis
        rows = np.concatenate([np.einsum("kl,in->ikln", np.eye(bands), seen).reshape(
            len(seen), bands, -1), np.broadcast_to(np.eye(bands), (len(seen), bands, bands))],
            axis=2)
        predicted = rows @ self.covariance @ rows.transpose(0, 2, 1)
        # What is known exactly has a variance of 0, which rounding may take below.
        values, vectors = np.linalg.eigh((predicted + predicted.transpose(0, 2, 1)) / 2)
        predicted = (vectors * np.maximum(values, 0)[:, None]) @ vectors.transpose(0, 2, 1)
        return np.asarray(predicted + self.noise
                          + chart_equations.variance_of_clipped(self.clipped, self.signal))


def weights_without(inverse: np.ndarray, weighted: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """The weights (..., Y) W r of innovations r when some rows are left out, which weigh nothing.

    Parameters
    ----------
    inverse : (Y, Y) array
        Of the innovations' covariance.
    weighted : (..., Y) array
        W r of all rows.
    rows : int array
        Of the patch.
    """
    return np.asarray(weighted - np.linalg.solve(inverse[np.ix_(rows, rows)],
                                                 weighted[..., rows].T).T @ inverse[rows])


def covariance_without(covariance: np.ndarray, gain: np.ndarray, inverse: np.ndarray,
                       rows: np.ndarray) -> np.ndarray:
    """Posterior covariance (Z, Z) when some rows are left out.

    Parameters
    ----------
    covariance : (Z, Z) array
        With all data.
    gain : (Z, Y) array
    inverse, rows
        As in ``weights_without``.
    """
    return np.asarray(covariance + gain[:, rows] @ np.linalg.solve(inverse[np.ix_(rows, rows)],
                                                                   gain[:, rows].T))


def patch_moments(photo: chart_equations.ChartEquations, patch: int, state: np.ndarray,
                  covariance: np.ndarray,
                  basis: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients (K, N), offset (K,) and covariance (D, D) of one patch, see ``PatchesWithout``.

    Parameters
    ----------
    photo : ChartEquations
    patch : int
    state : (Z,) array
        Curves, then log exposure, field and glare of the photo.
    covariance : (Z, Z) array
    basis : (P, N) array
        From coefficients to curves.
    """
    bands, terms = photo.signal.shape[1], photo.field_terms.shape[1]
    size = bands * basis.shape[1]
    field = photo.field_terms[patch]
    irradiance = np.exp(state[size] + field @ state[size + 1:size + 1 + terms])
    irradiance *= photo.irradiance[patch] / np.pi
    glare = slice(size + 1 + terms, size + 1 + terms + bands)
    offset = state[glare] if photo.glare else np.zeros(bands)
    curves = irradiance * state[:size].reshape(bands, -1)
    # what a clipped band reads is no signal
    signal = np.where(photo.readable[patch], photo.signal[patch] - offset,
                      curves @ (basis.T @ (photo.reflectances[patch] * photo.power)))
    # of what is added to each band, by exposure, field and glare
    change = np.zeros((bands, state.size - size))
    change[:, 0] = signal
    change[:, 1:1 + terms] = np.outer(signal, field)
    if photo.glare:
        change[:, 1 + terms:1 + terms + bands] = np.eye(bands)
    moved = np.empty((size + bands, size + bands))
    moved[:size, :size] = irradiance**2 * covariance[:size, :size]
    moved[size:, :size] = irradiance * (change @ covariance[size:, :size])
    moved[:size, size:] = moved[size:, :size].T
    moved[size:, size:] = change @ covariance[size:, size:] @ change.T
    return curves, offset, moved


def gathered(photos: list[chart_equations.ChartEquations], basis: np.ndarray,
             error: chart_equations.PatchError,
             patches: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> PatchesWithout:
    """The record of patches from ``patch_moments`` of each.

    Parameters
    ----------
    photos : list of ChartEquations
        That hold the patches in their order.
    basis : (P, N) array
    error : PatchError
        Disagreement of patches and model.
    patches : list of tuples
    """
    coefficients, offset, covariance = (np.array(column) for column in zip(*patches, strict=True))
    covariance.flags.writeable = False      # else the record would copy it
    return PatchesWithout(
        basis, photos[0].power, coefficients, offset, covariance,
        np.concatenate([photo.signal for photo in photos]),
        np.concatenate([
            chart_equations.noise_covariance(dataclasses.replace(photo, clipped=None), error)
            for photo in photos
        ]), np.concatenate([~photo.readable for photo in photos]))


def in_chart_order(without: PatchesWithout, used: np.ndarray) -> PatchesWithout:
    """The record in the order of the chart; those that were used come first in it.

    Parameters
    ----------
    without : PatchesWithout
    used : (I,) bool array
        In the order of the chart.
    """
    if used.all():
        return without
    position = np.argsort(np.concatenate([np.flatnonzero(used), np.flatnonzero(~used)]))
    return dataclasses.replace(without, **{
        name: getattr(without, name)[position]
        for name in ("coefficients", "offset", "covariance", "signal", "noise", "clipped")})
