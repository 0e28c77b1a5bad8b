"""Spectra behind pixels as a few coefficients each, and once a basis of spectra.

What a camera's signal says of a reflectance, mean and standard deviation together, changes with the
signal along few directions. They are the principal components of what the signals of surfaces say
that are drawn from the prior: the basis depends on prior, response and noise, not on any picture,
and so not on how one is cut. Colours that no surface of the prior has are fitted worse.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.prior.mixture import LogitMixture, drawn_reflectances
from spectrabox.sampling.prior.uplift_table import uplift_directly

SURFACES = 1500             # drawn: with 3000 the error of 16 coefficients is the same to 3 %
MIN_COEFFICIENTS = 3        # as a signal of three bands has


@dataclass(frozen=True)
class LowRank:
    """Mean and standard deviation side by side: basis[0] + coefficients (n, N) @ basis[1:]."""

    basis: np.ndarray       # (1 + N, P + Q) single precision

    def coefficients(self, spectra: np.ndarray) -> np.ndarray:
        """Coefficients (n, N) of spectra (n, P + Q)."""
        return np.asarray((spectra - self.basis[0]) @ self.basis[1:].T)

    def spectra(self, coefficients: np.ndarray) -> np.ndarray:
        """Spectra (n, P + Q), single precision, of coefficients (n, N)."""
        return np.asarray(self.basis[0] + coefficients.astype(np.float32) @ self.basis[1:])

    def rounded(self, coefficients: np.ndarray, relative: float) -> np.ndarray:
        """Largest change (n, P + Q) of the spectra where coefficients are rounded by a share."""
        return np.asarray(relative * np.abs(coefficients) @ np.abs(self.basis[1:]))


def low_rank(prior: LogitMixture, relative_response: np.ndarray, noise: float, coefficients: int,
             mean: slice, spread: slice) -> LowRank:
    """The basis in which spectra behind the signals of surfaces are nearest to their own.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (K, 61) array
        Rows summing to 1.
    noise : float
        Relative standard error of the signals.
    coefficients : int
        N.
    mean, spread : slice
        Wavelengths of mean and standard deviation, of the 61.

    Raises
    ------
    InputError
        For fewer than 3 coefficients, or more than there are numbers.
    """
    with threadpool_limits(1, "blas"):      # its sums depend on how many threads share them
        signals = drawn_reflectances(prior, SURFACES) @ relative_response.T
        mean_curves, deviations = uplift_directly(prior, relative_response, signals, noise)
        spectra = np.hstack([mean_curves[:, mean], deviations[:, spread]])
        if not MIN_COEFFICIENTS <= coefficients < spectra.shape[1]:
            raise InputError(f"{coefficients} coefficients a pixel are not between "
                             f"{MIN_COEFFICIENTS} and the {spectra.shape[1]} numbers of its "
                             "spectra; 16 are usual")
        centre = spectra.mean(axis=0)
        _, vectors = np.linalg.eigh(np.cov(spectra, rowvar=False))
        axes = vectors[:, ::-1][:, :coefficients].T
    signs = np.sign(axes[np.arange(len(axes)), np.abs(axes).argmax(axis=1)])
    return LowRank(np.vstack([centre, axes * signs[:, None]]).astype(np.float32))


def stated_errors(low: LowRank, spectra: np.ndarray, stored: np.ndarray, bands: int,
                  bound: np.ndarray | None) -> dict[str, object]:
    """What a low rank and the rounding of its coefficients cost, as files state it.

    Parameters
    ----------
    low : LowRank
    spectra : (n, P + Q) array
        Of some pixels, as they would be without it.
    stored : (n, N) array
        Their coefficients as they are kept.
    bands : int
        P, of the mean.
    bound : (P + Q,) array or None
        That no pixel's error exceeds, where it is known.
    """
    off = np.abs(low.spectra(stored).astype(float) - spectra)
    parts = {"mean": slice(bands), "standard_deviation": slice(bands, None)}
    return {"pixels": len(spectra), **{
        name: {"rms": _rounded_up(np.sqrt(np.mean(off[:, part]**2))),
               "largest": _rounded_up(off[:, part].max()),
               **({} if bound is None else {"bound": _rounded_up(bound[part].max())})}
        for name, part in parts.items()}}


def _rounded_up(error: float) -> float:
    """To three digits: what is stated is not less than what it is."""
    if error == 0:
        return 0.0
    unit = 10.0**(np.floor(np.log10(error)) - 2)
    return float(f"{np.ceil(error / unit) * unit:.3g}")
