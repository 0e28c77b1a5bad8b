"""Tilted rejection against rejection from a bounding box: acceptance and time per 1000 draws, in
one process.

Both draw uniformly from {A c = y, 0 <= c <= 1} of a synthetic three-band camera. The box is the
exact bounding box of the null coordinates, from linear programmes; its time leaves those out. The
figures are medians over the signals.
"""
from __future__ import annotations

import argparse
import json
import time
from typing import Any

import numpy as np
from scipy.optimize import linprog

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.response import relative_operator, response_matrix
from spectrabox.sampling.measurement import MeasurementOperator
from spectrabox.sampling.polytope.null_space import null_space
from spectrabox.sampling.polytope.tilt import max_entropy_tilt
from spectrabox.sampling.polytope.tilted_rejection import sample_polytope

BOX_BLOCK = 4096  # as large as the other sampler's


def camera(coefficients: int) -> np.ndarray:
    """A (3, N) of Gaussian bands under a smooth light, relative to white."""
    grid = visible_grid(5)
    sensitivities = np.exp(-0.5 * ((grid.nm - np.array([[450], [530], [610]])) / 35)**2)
    light = 1 + 0.3 * np.sin(grid.nm / 40)
    return relative_operator(response_matrix(grid, sensitivities, light),
                             basis_matrix(grid.nm, coefficients))


def box_rejection(operator: MeasurementOperator, draws: int, most_proposals: int,
                  rng: np.random.Generator) -> tuple[int, int, float]:
    """Accepted draws, proposals and seconds of the bounding box, stopping at ``draws`` or
    ``most_proposals``.
    """
    space = null_space(operator, max_entropy_tilt(operator).c)
    Z = space.directions
    low, high = ([sign * linprog(sign * z, A_eq=operator.A, b_eq=operator.y, bounds=(0, 1)).fun
                  - z @ space.c0
                  for z in Z.T] for sign in (1, -1))
    accepted, proposals, start = 0, 0, time.perf_counter()
    while accepted < draws and proposals < most_proposals:
        c = space.c0 + rng.uniform(low, high, (BOX_BLOCK, Z.shape[1])) @ Z.T
        accepted += int(np.count_nonzero(np.all((c >= 0) & (c <= 1), axis=1)))
        proposals += BOX_BLOCK
    return accepted, proposals, time.perf_counter() - start


def measure(coefficients: int, signals: int, draws: int, most_proposals: int) -> dict[str, Any]:
    """One row of the table; the box's entries are None where no signal gave it a single draw."""
    A = camera(coefficients)
    rng = np.random.default_rng(coefficients)
    ours, boxes = [], []
    for _ in range(signals):
        operator = MeasurementOperator(A, A @ rng.uniform(size=coefficients), np.zeros((3, 3)))
        start = time.perf_counter()
        samples = sample_polytope(operator, draws, seed=1)
        ours.append((samples.acceptance, time.perf_counter() - start))
        boxes.append(box_rejection(operator, draws, most_proposals, rng))
    acceptance, seconds = np.median(ours, axis=0)
    accepted, proposals, box_seconds = np.sum(boxes, axis=0)
    milliseconds = 1000 * seconds * 1000 / draws
    box_milliseconds = 1000 * box_seconds * 1000 / accepted if accepted else None
    return {"coefficients": coefficients, "acceptance": acceptance, "ms_per_1000": milliseconds,
            "box_acceptance": float(accepted / proposals) if accepted else None,
            "box_ms_per_1000": box_milliseconds, "ratio": box_milliseconds / milliseconds
            if box_milliseconds else None,
            "ratio_at_least": 1000 * box_seconds * 1000 / max(accepted, 1) / milliseconds}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--coefficients", type=int, nargs="+", default=[5, 7, 9, 11, 13, 15, 21])
    parser.add_argument("--signals", type=int, default=7, help="signals per size")
    parser.add_argument("--draws", type=int, default=5000, help="draws per signal")
    parser.add_argument("--most-proposals", type=int, default=1_000_000,
                        help="where the box gives up")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    rows = [measure(coefficients, arguments.signals, arguments.draws, arguments.most_proposals)
            for coefficients in arguments.coefficients]
    if arguments.json:
        print(json.dumps({"draws": arguments.draws, "signals": arguments.signals, "rows": rows}))
        return
    print(f"{'N':>3} {'acceptance':>11} {'ms / 1000':>10} {'box acceptance':>15} "
          f"{'box ms / 1000':>14} {'ratio':>9}")
    for row in rows:
        at_least = f"> {row['ratio_at_least']:.2g}"
        box = (f"{row['box_acceptance']:15.2g} {row['box_ms_per_1000']:14.3g} {row['ratio']:9.3g}"
               if row["ratio"] is not None else f"{'none':>15} {'none':>14} {at_least:>9}")
        print(
            f"{row['coefficients']:3d} {row['acceptance']:11.3f} {row['ms_per_1000']:10.2f} {box}")


if __name__ == "__main__":
    main()
