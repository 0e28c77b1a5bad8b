"""Trilinear look-up of spectra for many pixels, compiled, over all cores."""
from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, parallel=True, fastmath=True)
def look_up(table, signals, darkest, bend, steepest):  # type: ignore[no-untyped-def]
    """Values (n, Q) of a table (S, S, S, Q) on the lattice of `tables.lattice` at signals
    (n, 3).
    """
    side, width = table.shape[0], table.shape[3]
    out = np.empty((signals.shape[0], width), np.float32)
    end = np.arcsinh(steepest / bend)
    for n in prange(signals.shape[0]):
        cell = np.empty(3, np.int64)
        share = np.empty(3, np.float32)
        middle = min(max(signals[n, 1], darkest**3), 1.0)
        for k in range(3):
            if k == 0:
                at = (middle ** (1 / 3) - darkest) / (1 - darkest)
            else:
                ratio = np.log(max(signals[n, 0 if k == 1 else 2], 1e-6) / middle)
                at = (np.arcsinh(min(max(ratio, -steepest), steepest) / bend) / end + 1) / 2
            at *= side - 1
            cell[k] = min(np.int64(at), side - 2)
            share[k] = at - cell[k]
        for q in range(width):
            out[n, q] = 0
        for corner in range(8):
            weight = np.float32(1)
            i = cell[0] + (corner & 1)
            j = cell[1] + ((corner >> 1) & 1)
            k = cell[2] + ((corner >> 2) & 1)
            weight *= share[0] if corner & 1 else 1 - share[0]
            weight *= share[1] if corner & 2 else 1 - share[1]
            weight *= share[2] if corner & 4 else 1 - share[2]
            row = table[i, j, k]
            for q in range(width):
                out[n, q] += weight * row[q]
    return out
