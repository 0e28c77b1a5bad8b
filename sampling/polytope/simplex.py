"""Largest values of many linear functions over many polytopes, by simplex methods in lockstep.

Bounded-variable primal simplex over {A x = y, 0 <= x <= upper}, K basic variables, from a first
phase with K artificial ones. Every polytope walks by itself, one pivot of each at a time, so that
a pivot of all of them is a handful of array operations. The optimum of one function is the start of
the next: 122 functions that change little from one to the next take 30 to 160 pivots. The last
axis of the arrays of the walk is the polytope.
"""
from __future__ import annotations

from dataclasses import dataclass, fields
from enum import Enum

import numpy as np

REDUCED_COST = 1e-10        # below this a variable brings no gain
MIN_PIVOT = 1e-11           # below this a variable does not move
TIE = 1e-12                 # of steps: among variables that end together the largest pivot leaves
MAX_PIVOTS = 200            # per function
REFACTOR = 10               # pivots after which the bases are inverted anew
REACHED = 1e-11             # sum of the artificial variables that is round-off
AT_ONCE = 1024              # walks: their arrays stay within the processor's cache
FEW = 64                    # walks cost hardly more than one: few polytopes get several each


class SolveStatus(Enum):
    """How the walk over a polytope ended."""

    DONE = 0
    EMPTY = 1               # nothing fits y
    STALLED = 2             # on a cycle, or where rounding leaves no vertex


def highest(A: np.ndarray, y: np.ndarray, upper: np.ndarray,
            functions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Highest values of functions over S polytopes, and how the walks ended.

    Parameters
    ----------
    A : (S, K, N) array
    y : (S, K) array
    upper : (S, N) array
        Not negative and finite; variables of no range stay at 0.
    functions : (F, N) array
        The same for all polytopes, neighbours alike.

    Returns
    -------
    values : (S, F) array
        NaN where the walk did not end well.
    ends : (S,) array of SolveStatus
    """
    values = np.empty((len(y), len(functions)))
    ends = np.empty(len(y), dtype=object)
    for start in range(0, len(y), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        values[part], ends[part] = _walks(A[part], y[part], upper[part], functions)
    return values, ends


@dataclass
class _State:
    """Of S walks; it changes with every pivot."""

    polytope: np.ndarray    # (S,) whose walk this is
    A: np.ndarray           # (K, N + K, S), rows turned so that y is not negative
    y: np.ndarray           # (K, S)
    upper: np.ndarray       # (N + K, S); 0 for artificial variables once the first phase is over
    x: np.ndarray           # (N + K, S)
    at_upper: np.ndarray    # (N + K, S) bool; False for basic variables
    basic: np.ndarray       # (K, S) indices
    inverse: np.ndarray     # (K, K, S) of the basic columns
    function: np.ndarray    # (S,) that is climbed; 0 is the first phase
    following: np.ndarray   # (S,) that is climbed next
    last: np.ndarray        # (S,) of this walk
    pivots: np.ndarray      # (S,) since it began


def _walks(A: np.ndarray, y: np.ndarray, upper: np.ndarray,
           functions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    (count, bands, variables), total = A.shape, len(functions)
    each = min(max(FEW // count, 1), total)      # walks over a polytope, each for some functions
    starts = np.linspace(1, total + 1, each + 1).astype(int)
    state = _first_phase(A.repeat(each, axis=0), y.repeat(each, axis=0),
                         upper.repeat(each, axis=0))
    state.polytope //= each
    state.following, state.last = np.tile(starts[:-1], count), np.tile(starts[1:] - 1, count)
    rows = np.zeros((variables + bands, total + 1))
    rows[:variables, 1:], rows[variables:, 0] = functions.T, -1.0
    values = np.full((total + 1, count), np.nan)
    ends = np.full(count, SolveStatus.DONE, dtype=object)
    steps = 0
    while state.polytope.size:
        function = rows[:, state.function]
        gains = _gains(state, function)
        entering = np.argmax(gains, axis=0)
        optimal = gains[entering, np.arange(entering.size)] <= REDUCED_COST
        best = np.einsum("ns,ns->s", function[:, optimal], state.x[:, optimal])
        values[state.function[optimal], state.polytope[optimal]] = best
        first_phase = optimal & (state.function == 0)
        empty = first_phase & (values[0, state.polytope] < -REACHED)
        state.upper[variables:, first_phase & ~empty] = 0.0
        _pivot(state, entering, ~optimal)
        done = optimal & (state.function == state.last)
        state.function = np.where(optimal, state.following, state.function)
        state.following = np.where(optimal, state.following + 1, state.following)
        state.pivots = np.where(optimal, 0, state.pivots + 1)
        steps += 1
        lost = _refactor(state) if steps % REFACTOR == 0 else np.zeros_like(done)
        lost |= state.pivots > MAX_PIVOTS
        ends[state.polytope[lost]] = SolveStatus.STALLED
        ends[state.polytope[empty]] = SolveStatus.EMPTY
        if (finished := done | empty | lost).any():
            state = _State(**{field.name: np.ascontiguousarray(
                getattr(state, field.name)[..., ~finished]) for field in fields(_State)})
    values[:, ends != SolveStatus.DONE] = np.nan
    return values[1:].T, ends


def _first_phase(A: np.ndarray, y: np.ndarray, upper: np.ndarray) -> _State:
    """All variables at 0, and artificial ones that make up for it in the basis."""
    count, bands, variables = A.shape
    sign = np.where(y < 0, -1.0, 1.0)
    identity = np.broadcast_to(np.eye(bands), (count, bands, bands))
    columns = np.ascontiguousarray(
        np.concatenate([A * sign[:, :, None], identity], axis=2).transpose(1, 2, 0))
    y = np.ascontiguousarray((y * sign).T)
    x = np.concatenate([np.zeros((variables, count)), y])
    return _State(
        polytope=np.arange(count), A=columns, y=y,
        # more than their sum, which only falls: none of them ends there
        upper=np.concatenate([upper.T, np.tile(1 + y.sum(axis=0), (bands, 1))]),
        x=x, at_upper=np.zeros(x.shape, dtype=bool),
        basic=np.tile(np.arange(variables, variables + bands)[:, None], count),
        inverse=identity.transpose(1, 2, 0).copy(),
        function=np.zeros(count, dtype=int), following=np.ones(count, dtype=int),
        last=np.zeros(count, dtype=int), pivots=np.zeros(count, dtype=int))


def _gains(state: _State, function: np.ndarray) -> np.ndarray:
    """What each function (N + K, S) gains by each variable's move off its end; 0 for basic ones."""
    price = (np.take_along_axis(function, state.basic, 0)[:, None] * state.inverse).sum(axis=0)
    gains = function - np.einsum("ks,kns->ns", price, state.A)
    np.negative(gains, out=gains, where=state.at_upper)
    gains *= state.upper > 0
    np.put_along_axis(gains, state.basic, 0.0, 0)
    return gains


def _pivot(state: _State, entering: np.ndarray, moving: np.ndarray) -> None:
    """Move the entering variables until one ends, of the walks that are moving."""
    every = np.arange(entering.size)
    rise = np.where(state.at_upper[entering, every], -1.0, 1.0)
    column = (state.inverse * state.A[:, entering, every]).sum(axis=1)
    change = -rise * column
    x_basic = np.take_along_axis(state.x, state.basic, 0)
    room = np.where(change > 0, np.take_along_axis(state.upper, state.basic, 0) - x_basic, x_basic)
    size = np.abs(change)
    reach = np.full(change.shape, np.inf)
    np.divide(np.maximum(room, 0.0), size, out=reach, where=size > MIN_PIVOT)
    least = reach.min(axis=0)
    leaving = np.argmax(np.where(reach <= least + TIE, size, -1.0), axis=0)
    length = np.where(moving, np.minimum(least, state.upper[entering, every]), 0.0)
    np.put_along_axis(state.x, state.basic, x_basic + change * length, 0)
    state.x[entering, every] += rise * length
    across = moving & (least >= state.upper[entering, every])
    state.at_upper[entering[across], every[across]] ^= True
    state.x[entering[across], every[across]] = np.where(
        rise[across] > 0, state.upper[entering[across], every[across]], 0.0)
    # entering variables take the leaving ones' positions in the bases
    rows = np.flatnonzero(moving & ~across)
    entering, leaving, column = entering[rows], leaving[rows], column[:, rows]
    ends_at_upper = change[leaving, rows] > 0
    out = state.basic[leaving, rows]
    state.at_upper[out, rows] = ends_at_upper
    state.x[out, rows] = np.where(ends_at_upper, state.upper[out, rows], 0.0)
    state.at_upper[entering, rows] = False
    state.basic[leaving, rows] = entering
    some = np.arange(rows.size)
    pivot_row = state.inverse[leaving, :, rows].T / column[leaving, some]
    inverse = state.inverse[:, :, rows] - column[:, None] * pivot_row
    inverse[leaving, :, some] = pivot_row.T
    state.inverse[:, :, rows] = inverse


def _refactor(state: _State) -> np.ndarray:
    """Inverses and basic variables without the round-off of the pivots; which walks lost theirs."""
    every = np.arange(state.polytope.size)
    columns = state.A[:, state.basic, every].transpose(2, 0, 1)
    lost = np.zeros(every.size, dtype=bool)
    try:
        inverse = np.linalg.inv(columns)
    except np.linalg.LinAlgError:
        lost = np.linalg.slogdet(columns)[0] == 0
        inverse = np.linalg.inv(np.where(lost[:, None, None], np.eye(len(state.y)), columns))
    state.inverse = np.ascontiguousarray(inverse.transpose(1, 2, 0))
    resting = np.where(state.at_upper, state.upper, 0.0)
    rest = state.y - np.einsum("kns,ns->ks", state.A, resting)
    x_basic = (state.inverse * rest).sum(axis=1)
    state.x = resting
    np.put_along_axis(state.x, state.basic, x_basic, 0)
    return lost
