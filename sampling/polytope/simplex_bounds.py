"""Exact bounds of many pixels: a compiled simplex method that goes from wavelength to wavelength.

Bounded-variable primal simplex with K basic coefficients. The optimum of one wavelength is the
start of the next, all maxima first and all minima after them, so that 122 linear programmes take 30
to 160 pivots. Noise enters as K more variables in [0, 1], one per side of the box that stands for
the confidence set (see bounds.py).
"""
from __future__ import annotations

import numpy as np
from numba import njit

from spectrabox.radiometry.errors import ConvergenceError
from spectrabox.sampling.measurement import MeasurementOperator
from spectrabox.sampling.polytope.bounds import reflectance_bounds, signal_box
from spectrabox.sampling.polytope.tilt import max_entropy_tilt

REDUCED_COST = 1e-10        # below this a coefficient brings no gain
SMALL_PIVOT = 1e-11
SMALLEST_VOLUME = 1e-9      # of what a column adds to those before it, relative to the largest
MOST_PIVOTS = 400           # per wavelength
REFACTOR = 40               # pivots after which the inverse of the basis is computed anew
DONE, NO_VERTEX, STALLED = 0, 1, 2


def exact_bounds(operator: MeasurementOperator, basis: np.ndarray,
                 level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest B c over the coefficients that fit, as
    `sampling.bounds.reflectance_bounds` and much faster.

    Signals at the edge of what can be reached, or beyond it, are left to `reflectance_bounds`.
    """
    directions, centre, half_width = signal_box(operator, level)
    loose = half_width > 0
    columns = np.hstack([directions, -2 * np.diag(half_width)[:, loose]])
    target = centre - np.where(loose, half_width, 0.0)
    rows = np.hstack([basis, np.zeros((len(basis), int(loose.sum())))])
    try:
        start = max_entropy_tilt(MeasurementOperator(columns, target,
                                                     np.zeros((len(target),) * 2))).c
    except ConvergenceError:
        return reflectance_bounds(operator, basis, level)
    lower, upper, _, status = walk(np.ascontiguousarray(columns), target, start,
                                   np.ascontiguousarray(rows))
    return (lower, upper) if status == DONE else reflectance_bounds(operator, basis, level)


@njit(cache=True)
def walk(A, y, inside, rows):  # type: ignore[no-untyped-def]
    """Lowest and highest rows @ c over {A c = y, 0 <= c <= 1} from a point strictly inside; pivots
    and status too.
    """
    K, N = A.shape
    lower, upper = np.empty(len(rows)), np.empty(len(rows))
    x, place = inside.copy(), np.zeros(N, np.int64)  # place: 0 basic, -1 at 0, +1 at 1
    basic = np.empty(K, np.int64)
    if not _to_vertex(A, x, place, basic):
        return lower, upper, 0, NO_VERTEX
    inverse = np.linalg.inv(_columns(A, basic))
    pivots = 0
    for sense in range(2):
        sign = 1.0 if sense == 0 else -1.0
        for w in range(len(rows)):
            done, pivots = _optimise(A, y, sign * rows[w], x, place, basic, inverse, pivots)
            if not done:
                return lower, upper, pivots, STALLED
            value = 0.0
            for j in range(N):
                value += rows[w, j] * x[j]
            if sense == 0:
                upper[w] = value
            else:
                lower[w] = value
    return lower, upper, pivots, DONE


@njit(cache=True)
def _to_vertex(A, x, place, basic):  # type: ignore[no-untyped-def]
    """Slide along circuits until only K independent coefficients lie between 0 and 1; False if that
    fails.
    """
    K, N = A.shape
    for j in range(N):
        if x[j] <= 0.0 or x[j] >= 1.0:
            place[j] = -1 if x[j] <= 0.0 else 1
    members = np.empty(K + 1, np.int64)
    stale, following = True, 0
    while True:
        if stale:
            if not _spread_columns(A, place, members):
                return False
            stale, following = False, 0
        while following < N and (place[following] != 0 or np.any(members[:K] == following)):
            following += 1
        if following == N:
            basic[:] = members[:K]
            return True
        members[K] = following
        d = np.ones(K + 1)
        d[:K] = np.linalg.solve(_columns(A, members[:K]), -A[:, following])
        length, stop, end = 1e300, -1, 0
        for q in range(K + 1):
            j = members[q]
            if abs(d[q]) > SMALL_PIVOT:
                reach = (1 - x[j]) / d[q] if d[q] > 0 else -x[j] / d[q]
                if reach < length:
                    length, stop, end = reach, j, (1 if d[q] > 0 else -1)
        for q in range(K + 1):
            x[members[q]] += length * d[q]
        x[stop] = 1.0 if end == 1 else 0.0
        place[stop] = end
        stale = stop != following


@njit(cache=True)
def _spread_columns(A, place, members):  # type: ignore[no-untyped-def]
    """Into members the K free columns farthest from dependent that a greedy choice finds; False if
    there are none.

    Neighbouring splines look almost alike to the camera: the first K free ones would have no
    inverse to speak of.
    """
    K, N = A.shape
    rest = A.copy()
    largest = 0.0
    for k in range(K):
        best, size = -1, 0.0
        for j in range(N):
            if place[j] == 0:
                length = 0.0
                for r in range(K):
                    length += rest[r, j]**2
                if length > size:
                    best, size = j, length
        largest = max(largest, size)
        if best < 0 or size <= SMALLEST_VOLUME**2 * largest:
            return False
        members[k] = best
        along = rest[:, best] / np.sqrt(size)
        for j in range(N):
            share = 0.0
            for r in range(K):
                share += along[r] * rest[r, j]
            for r in range(K):
                rest[r, j] -= share * along[r]
    return True


@njit(cache=True)
def _columns(A, members):  # type: ignore[no-untyped-def]
    out = np.empty((A.shape[0], len(members)))
    for r in range(A.shape[0]):
        for q in range(len(members)):
            out[r, q] = A[r, members[q]]
    return out


@njit(cache=True)
def _optimise(A, y, cost, x, place, basic, inverse, pivots):  # type: ignore[no-untyped-def]
    """Pivot until no coefficient raises cost @ x; x, place, basic and inverse change in place."""
    K, N = A.shape
    prices, column = np.empty(K), np.empty(K)
    for _ in range(MOST_PIVOTS):
        for q in range(K):
            prices[q] = 0.0
            for r in range(K):
                prices[q] += cost[basic[r]] * inverse[r, q]
        best, entering = REDUCED_COST, -1
        for j in range(N):
            if place[j] != 0:
                gain = cost[j]
                for q in range(K):
                    gain -= prices[q] * A[q, j]
                gain = gain if place[j] == -1 else -gain
                if gain > best:
                    best, entering = gain, j
        if entering < 0:
            return True, pivots
        direction = 1.0 if place[entering] == -1 else -1.0
        length, leaving, end = 1.0, -1, 0
        for r in range(K):
            column[r] = 0.0
            for q in range(K):
                column[r] += inverse[r, q] * A[q, entering]
            change = -direction * column[r]
            if abs(change) > SMALL_PIVOT:
                reach = (1 - x[basic[r]]) / change if change > 0 else -x[basic[r]] / change
                reach = max(reach, 0.0)
                if reach < length:
                    length, leaving, end = reach, r, (1 if change > 0 else -1)
        for r in range(K):
            x[basic[r]] -= direction * length * column[r]
        pivots += 1
        if leaving < 0:
            place[entering] = -place[entering]
            x[entering] = 1.0 if place[entering] == 1 else 0.0
            continue
        out = basic[leaving]
        place[out] = end
        x[out] = 1.0 if end == 1 else 0.0
        x[entering] += direction * length
        place[entering] = 0
        basic[leaving] = entering
        if pivots % REFACTOR == 0:
            _refactor(A, y, x, place, basic, inverse)
        else:
            for q in range(K):
                inverse[leaving, q] /= column[leaving]
            for r in range(K):
                if r != leaving:
                    for q in range(K):
                        inverse[r, q] -= column[r] * inverse[leaving, q]
    return False, pivots


@njit(cache=True)
def _refactor(A, y, x, place, basic, inverse):  # type: ignore[no-untyped-def]
    inverse[:] = np.linalg.inv(_columns(A, basic))
    rest = y.copy()
    for j in range(A.shape[1]):
        if place[j] == 1:
            for r in range(A.shape[0]):
                rest[r] -= A[r, j]
    x_basic = inverse @ rest
    for r in range(len(basic)):
        x[basic[r]] = x_basic[r]
