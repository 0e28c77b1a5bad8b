"""Trilinear look-up of spectra for many pixels, compiled, over all cores."""
from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, parallel=True, fastmath=True)
def look_up(table, signals):  # type: ignore[no-untyped-def]
    """Values (n, Q) of a table (S, S, S, Q) on a cube-root lattice at signals (n, 3)."""
    side, width = table.shape[0], table.shape[3]
    out = np.empty((signals.shape[0], width), np.float32)
    for n in prange(signals.shape[0]):
        place = np.empty(3, np.int64)
        share = np.empty(3, np.float32)
        for k in range(3):
            value = min(max(signals[n, k], np.float32(0)), np.float32(1))
            at = value ** np.float32(1 / 3) * np.float32(side - 1)
            place[k] = min(np.int64(at), side - 2)
            share[k] = at - np.float32(place[k])
        for q in range(width):
            out[n, q] = 0
        for corner in range(8):
            weight = np.float32(1)
            i = place[0] + (corner & 1)
            j = place[1] + ((corner >> 1) & 1)
            k = place[2] + ((corner >> 2) & 1)
            weight *= share[0] if corner & 1 else 1 - share[0]
            weight *= share[1] if corner & 2 else 1 - share[1]
            weight *= share[2] if corner & 4 else 1 - share[2]
            row = table[i, j, k]
            for q in range(width):
                out[n, q] += weight * row[q]
    return out
