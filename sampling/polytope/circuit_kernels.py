"""Compiled inner loops of circuit hit-and-run. Import this module only for bulk draws: numba takes
0.3 s to load.

Layout (blocks, N, 256 chains) in single precision with unit stride over chains. All chains of a
block make the same move with their own random lengths, so each is a valid chain and, given the
schedule, independent of the others. Random numbers: xorshift32 with a Weyl sequence, one state per
chain. Loops over chains are kept apart by what they write, or LLVM gives up vectorising them (three
to four times slower).
"""
from __future__ import annotations

import numpy as np
from numba import njit, prange

CHAINS = 256


@njit(cache=True, fastmath=True)
def _three_bands(C, members, components, order, state, weyl):  # type: ignore[no-untyped-def]
    zero, one = np.float32(0.0), np.float32(1.0)
    length = np.empty(C.shape[1], np.float32)
    for q in range(order.shape[0]):
        s = order[q]
        ra, rb, rc, rd = C[members[s, 0]], C[members[s, 1]], C[members[s, 2]], C[members[s, 3]]
        d0, d1 = np.float32(components[s, 0]), np.float32(components[s, 1])
        d2, d3 = np.float32(components[s, 2]), np.float32(components[s, 3])
        i0, i1, i2, i3 = one / d0, one / d1, one / d2, one / d3
        a0 = zero if d0 > 0 else one
        a1 = zero if d1 > 0 else one
        a2 = zero if d2 > 0 else one
        a3 = zero if d3 > 0 else one
        b0, b1, b2, b3 = one - a0, one - a1, one - a2, one - a3
        weyl = np.uint32(weyl + np.uint32(362437))
        for k in range(C.shape[1]):
            x = state[k]
            x = np.uint32(x ^ np.uint32(x << np.uint32(13)))
            x = np.uint32(x ^ np.uint32(x >> np.uint32(17)))
            x = np.uint32(x ^ np.uint32(x << np.uint32(5)))
            state[k] = x
            length[k] = np.float32(np.int32(np.uint32(x + weyl) >> np.uint32(8))) * np.float32(
                5.9604645e-08)
        for k in range(C.shape[1]):
            l0, h0 = (a0 - ra[k]) * i0, (b0 - ra[k]) * i0
            l1, h1 = (a1 - rb[k]) * i1, (b1 - rb[k]) * i1
            l2, h2 = (a2 - rc[k]) * i2, (b2 - rc[k]) * i2
            l3, h3 = (a3 - rd[k]) * i3, (b3 - rd[k]) * i3
            l0 = l0 if l0 > l1 else l1
            l2 = l2 if l2 > l3 else l3
            l0 = l0 if l0 > l2 else l2
            h0 = h0 if h0 < h1 else h1
            h2 = h2 if h2 < h3 else h3
            h0 = h0 if h0 < h2 else h2
            length[k] = l0 + (h0 - l0) * length[k]
        for k in range(C.shape[1]):
            v = ra[k] + length[k] * d0
            v = v if v > zero else zero
            ra[k] = v if v < one else one
        for k in range(C.shape[1]):
            v = rb[k] + length[k] * d1
            v = v if v > zero else zero
            rb[k] = v if v < one else one
        for k in range(C.shape[1]):
            v = rc[k] + length[k] * d2
            v = v if v > zero else zero
            rc[k] = v if v < one else one
        for k in range(C.shape[1]):
            v = rd[k] + length[k] * d3
            v = v if v > zero else zero
            rd[k] = v if v < one else one


@njit(cache=True, fastmath=True)
def _any_bands(C, members, components, order, state, weyl):  # type: ignore[no-untyped-def]
    zero, one = np.float32(0.0), np.float32(1.0)
    low, high = np.empty(C.shape[1], np.float32), np.empty(C.shape[1], np.float32)
    for q in range(order.shape[0]):
        s = order[q]
        for j in range(members.shape[1]):
            row = C[members[s, j]]
            d = np.float32(components[s, j])
            inverse = one / d
            a = zero if d > 0 else one
            b = one - a
            if j == 0:
                for k in range(C.shape[1]):
                    low[k] = (a - row[k]) * inverse
                    high[k] = (b - row[k]) * inverse
            else:
                for k in range(C.shape[1]):
                    l0, h0 = (a - row[k]) * inverse, (b - row[k]) * inverse
                    low[k] = l0 if l0 > low[k] else low[k]
                    high[k] = h0 if h0 < high[k] else high[k]
        weyl = np.uint32(weyl + np.uint32(362437))
        for k in range(C.shape[1]):
            x = state[k]
            x = np.uint32(x ^ np.uint32(x << np.uint32(13)))
            x = np.uint32(x ^ np.uint32(x >> np.uint32(17)))
            x = np.uint32(x ^ np.uint32(x << np.uint32(5)))
            state[k] = x
            u = np.float32(np.int32(np.uint32(x + weyl) >> np.uint32(8))) * np.float32(
                5.9604645e-08)
            low[k] = low[k] + (high[k] - low[k]) * u
        for j in range(members.shape[1]):
            row = C[members[s, j]]
            d = np.float32(components[s, j])
            for k in range(C.shape[1]):
                v = row[k] + low[k] * d
                v = v if v > zero else zero
                row[k] = v if v < one else one


@njit(cache=True, parallel=True)
def run_parallel(starts, members, components, order, states, weyls, out):  # type: ignore
    """Every block of chains through the schedule, blocks over the cores; ``out`` (blocks, N, 256)
    is filled.
    """
    for b in prange(out.shape[0]):
        _block(starts, members, components, order, states[b], weyls[b], out[b], b)


@njit(cache=True)
def run_serial(starts, members, components, order, states, weyls, out):  # type: ignore
    """The same on one core."""
    for b in range(out.shape[0]):
        _block(starts, members, components, order, states[b], weyls[b], out[b], b)


@njit(cache=True)
def _block(starts, members, components, order, state, weyl, C, b):  # type: ignore[no-untyped-def]
    for j in range(C.shape[0]):
        for k in range(C.shape[1]):
            C[j, k] = starts[j, (b * C.shape[1] + k) % starts.shape[1]]
    if members.shape[1] == 4:
        _three_bands(C, members, components, order, state, weyl)
    else:
        _any_bands(C, members, components, order, state, weyl)


@njit(cache=True)
def chains_as_rows(out, draws):  # type: ignore[no-untyped-def]
    """The first ``draws`` chains as rows (T, N) in double precision."""
    rows = np.empty((draws, out.shape[1]))
    for b in range(out.shape[0]):
        for k in range(min(out.shape[2], draws - b * out.shape[2])):
            for j in range(out.shape[1]):
                rows[b * out.shape[2] + k, j] = out[b, j, k]
    return rows
