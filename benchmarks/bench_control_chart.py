"""How often ``compare`` finds a drift in simulated labs, and how often it claims one that is not.

    python benchmarks/bench_control_chart.py [--labs 400]

Labs of twelve sessions whose light and shutter repeat to 1.2 and to 1.5 % (as [repeatability]
states by default). The lamp is off in one session, from a session on, or weakens from session to
session.
"""
from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from spectrabox.session.compare.control_chart import control_chart
from spectrabox.session.compare.lasting_shift import lasting_shifts
from spectrabox.session.compare.quantities import BRIGHTNESS, Quantity, SessionQuantities

SESSIONS, AT, STATED = 12, 7, 0.015
PER_CENT = (0, 2, 3, 4, 5, 6, 7, 8)
BOTH = CHART, SHIFT = "chart alone", "shift alone"      # "..." is the last five
OF_BANDS = 0.002            # scatter of each band by itself


def main() -> None:
    """Print a table for each kind of drift."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--labs", type=int, default=400)
    labs = parser.parse_args().labs
    kinds = {"one session": lambda k: float(k == AT),
             **{f"the last {n}": lambda k, n=n: float(k >= SESSIONS - n) for n in (2, 3, 5)},
             "evenly over all": lambda k: k / (SESSIONS - 1)}
    for repeats in (0.012, 0.015):
        print(f"\nlight and shutter repeat to {repeats:.1%}; {labs} labs: share in which the lamp "
              "is named, by its drift in %")
        print(f"{'off in':<16}" + "".join(f"{drift:>7}" for drift in PER_CENT))
        for kind, part in kinds.items():
            _row(kind, repeats, part, labs, BOTH)
        for rule in BOTH:
            _row(f"... {rule}", repeats, kinds["the last 5"], labs, (rule,))


def _row(name: str, repeats: float, part: Callable[[int], float], labs: int,
         rules: tuple[str, ...]) -> None:
    shares = [_found(repeats, [-np.log1p(-drift / 100) * part(k) for k in range(SESSIONS)], labs,
                     rules) for drift in PER_CENT]
    print(f"{name:<16}" + "".join(f"{share:>7.3f}" for share in shares), flush=True)


def _found(repeats: float, drift: list[float], labs: int, rules: tuple[str, ...]) -> float:
    rng, hits = np.random.default_rng(1), 0
    for _ in range(labs):
        sessions = [_session(repeats, off, rng) for off in drift]
        hits += any(one.quantity == BRIGHTNESS for one in [
            *([one for one in control_chart(sessions) if one.out] if CHART in rules else []),
            *(lasting_shifts(sessions) if SHIFT in rules else [])])
    return hits / labs


def _session(repeats: float, off: float, rng: np.random.Generator) -> SessionQuantities:
    bands = rng.normal(0, repeats) - off + rng.normal(0, OF_BANDS, 3)
    found = {BRIGHTNESS: Quantity(float(bands.mean()), 0.0005, STATED)}
    found |= {f"band {k + 1} against the others": Quantity(float(value - bands.mean()), 0.0005,
                                                           STATED / 3)
              for k, value in enumerate(bands)}
    return SessionQuantities(Path("s"), "s", "camera", "lamp", "", found, {})


if __name__ == "__main__":
    main()
