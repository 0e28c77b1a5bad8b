"""A plan kept as arrays, which every worker reads and a command that goes on finds again."""
from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from spectrabox.radiometry.files import whole_file
from spectrabox.sampling.prior.low_rank import LowRank
from spectrabox.session.signals.uplift_plan import Plan

PLAN = "plan.npz"


def store_plan(folder: Path, plan: Plan, beyond: int) -> None:
    """Keep a plan, and how many pixels are outside 0 to 1."""
    arrays = {"row": plan.row, "columns": plan.columns,
              "basis": None if plan.low_rank is None else plan.low_rank.basis}
    with whole_file(folder / PLAN) as unfinished, unfinished.open("wb") as file:
        np.savez(file, errors=np.array(json.dumps(plan.errors)), beyond=np.array(beyond),
                 **{name: array for name, array in arrays.items()  # type: ignore[arg-type]
                    if array is not None})


def load_plan(folder: Path) -> Plan:
    """The plan that ``store_plan`` kept."""
    with np.load(folder / PLAN, allow_pickle=False) as kept:
        basis = kept.get("basis")
        return Plan(kept.get("row"), kept.get("columns"),
                    None if basis is None else LowRank(basis), json.loads(str(kept["errors"])))


def pixels_beyond(folder: Path) -> int:
    """The pixels outside 0 to 1 that were kept with the plan."""
    with np.load(folder / PLAN, allow_pickle=False) as kept:
        return int(kept["beyond"])
