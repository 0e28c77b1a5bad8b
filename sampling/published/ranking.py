"""Ranking of draws as published, for comparison: by extra readings (Eq. 9) and by interreflection
(Eq. 10).

Ranking keeps the best of the draws however badly they fit; `conditioning` makes every draw fit.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.errors import InputError


def best_by_readings(spectra: np.ndarray, indices: np.ndarray, values: np.ndarray,
                     keep: int) -> np.ndarray:
    """Indices (keep,) of the draws (T, P) nearest to reflectances read at wavelength indices (Eq.
    9).
    """
    return _best(np.sum((spectra[:, indices] - values)**2, axis=1), keep)


def best_by_signals(signals: np.ndarray, measured: np.ndarray, keep: int) -> np.ndarray:
    """Indices (keep,) of the draws whose signals (T, ...) come nearest to the measured ones (Eq.
    10).
    """
    return _best(np.sum((signals - measured).reshape(len(signals), -1)**2, axis=1), keep)


def _best(loss: np.ndarray, keep: int) -> np.ndarray:
    if not 1 <= keep <= loss.size:
        raise InputError(f"the best {keep} of {loss.size} draws were asked for; ask for 1 to "
                         f"{loss.size}")
    return np.argsort(loss, kind="stable")[:keep]
