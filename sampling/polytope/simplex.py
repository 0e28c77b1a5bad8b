"""Extremes of many linear functions over one polytope: a simplex method that walks between them.

Bounded-variable primal simplex over {A x = y, 0 <= x <= upper}, K basic variables. The optimum of
one function is the start of the next, and every vertex is tried on all functions that are left:
122 of them take 30 to 160 pivots. The basis is inverted anew at each pivot (K is small), so that
round-off does not add up. The first vertex is HiGHS's.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr
from scipy.optimize import linprog

REDUCED_COST = 1e-10        # below this a variable brings no gain
MIN_PIVOT = 1e-11           # below this a variable does not move
MAX_PIVOTS = 400            # per function
TIGHT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}    # of HiGHS
INSIDE = 1e-9               # of a variable's range: nearer to its ends it is taken to be there


@dataclass(frozen=True)
class Polytope:
    """{A x = y, 0 <= x <= upper}."""

    A: np.ndarray               # (K, N), of full rank
    y: np.ndarray               # (K,)
    upper: np.ndarray           # (N,) positive


@dataclass(frozen=True)
class _Vertex:
    """A basis, and where the other variables are."""

    basic: np.ndarray           # (K,) indices
    at_upper: np.ndarray        # (N,) bool, False for basic ones and those at 0
    inverse: np.ndarray         # (K, K) of the basic columns
    x_basic: np.ndarray         # (K,)


def extremes(polytope: Polytope, functions: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Lowest and highest value (P,) of functions (P, N) of x, or None where the walk stalls.

    It stalls where rounding leaves no vertex (sets thinner than 1e-9), or on a cycle.
    """
    vertex = _first_vertex(polytope, functions[0])
    highest, vertex = _highest(polytope, functions, vertex)
    lowest, _ = _highest(polytope, -functions, vertex)
    # Not -lowest: a bound of 0 must not read -0.
    return None if highest is None or lowest is None else (0.0 - lowest, highest)


def _highest(polytope: Polytope, functions: np.ndarray,
             vertex: _Vertex | None) -> tuple[np.ndarray | None, _Vertex | None]:
    values = np.empty(len(functions))
    left = np.arange(len(functions))
    while left.size:
        vertex = None if vertex is None else _climb(polytope, functions[left[0]], vertex)
        if vertex is None:
            return None, None
        x = np.where(vertex.at_upper, polytope.upper, 0.0)
        x[vertex.basic] = vertex.x_basic
        optimal = np.max(_gains(polytope, functions[left], vertex), axis=1) <= REDUCED_COST
        optimal[0] = True
        values[left[optimal]] = functions[left[optimal]] @ x
        left = left[~optimal]
    return values, vertex


def _climb(polytope: Polytope, function: np.ndarray, vertex: _Vertex) -> _Vertex | None:
    """The vertex of the highest value, from another one; None if it is not reached."""
    for _ in range(MAX_PIVOTS):
        gains = _gains(polytope, function[None], vertex)[0]
        entering = int(np.argmax(gains))
        if gains[entering] <= REDUCED_COST:
            return vertex
        rise = -1.0 if vertex.at_upper[entering] else 1.0
        change = -rise * (vertex.inverse @ polytope.A[:, entering])
        moves = np.abs(change) > MIN_PIVOT
        room = np.where(change > 0, polytope.upper[vertex.basic] - vertex.x_basic, vertex.x_basic)
        reach = np.full(change.size, np.inf)
        reach[moves] = np.maximum(room[moves] / np.abs(change[moves]), 0.0)
        leaving = int(np.argmin(reach))
        basic, at_upper = vertex.basic.copy(), vertex.at_upper.copy()
        if reach[leaving] >= polytope.upper[entering]:
            at_upper[entering] = not at_upper[entering]
        else:
            at_upper[basic[leaving]] = change[leaving] > 0
            at_upper[entering] = False
            basic[leaving] = entering
        try:
            vertex = _vertex(polytope, basic, at_upper)
        except np.linalg.LinAlgError:
            return None
    return None


def _gains(polytope: Polytope, functions: np.ndarray, vertex: _Vertex) -> np.ndarray:
    """What each function (P, N) gains by each variable's move off its end; 0 for basic ones."""
    gains = functions - (functions[:, vertex.basic] @ vertex.inverse) @ polytope.A
    gains[:, vertex.at_upper] *= -1
    gains[:, vertex.basic] = 0.0
    return gains


def _vertex(polytope: Polytope, basic: np.ndarray, at_upper: np.ndarray) -> _Vertex:
    inverse = np.linalg.inv(polytope.A[:, basic])
    rest = polytope.y - polytope.A @ np.where(at_upper, polytope.upper, 0.0)
    return _Vertex(basic, at_upper, inverse, inverse @ rest)


def _first_vertex(polytope: Polytope, function: np.ndarray) -> _Vertex | None:
    """HiGHS's optimum of one function as a basis, None where rounding leaves none."""
    solution = linprog(-function, A_eq=polytope.A, b_eq=polytope.y,
                       bounds=np.column_stack([np.zeros_like(polytope.upper), polytope.upper]),
                       method="highs-ds", options=TIGHT)
    if solution.status != 0:
        return None
    share = solution.x / polytope.upper
    free = np.flatnonzero((share > INSIDE) & (share < 1 - INSIDE))
    bands = len(polytope.y)
    if free.size > bands:
        return None
    # A vertex with fewer free variables than bands is degenerate: the basis is filled up with the
    # columns that are the least dependent on those in it.
    span = np.linalg.qr(polytope.A[:, free])[0]
    rest = polytope.A - span @ (span.T @ polytope.A)
    rest[:, free] = 0.0
    filling = qr(rest, mode="r", pivoting=True)[1][:bands - free.size]
    basic = np.concatenate([free, filling])
    at_upper = share > 0.5
    at_upper[basic] = False
    try:
        vertex = _vertex(polytope, basic, at_upper)
    except np.linalg.LinAlgError:
        return None
    room = INSIDE * polytope.upper[basic]
    inside = np.all((vertex.x_basic >= -room) & (vertex.x_basic <= polytope.upper[basic] + room))
    return vertex if inside else None
