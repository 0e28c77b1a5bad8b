"""What is said of an edge inside a region."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.measure.words import percent
from spectrabox.radiometry.records.photos import EdgeKind, RegionEdge

CAUSES = {
    EdgeKind.SHADOW: "in all bands alike: a shadow's edge or a fold, or two greys",
    EdgeKind.PAINTS: "in each band by its own ratio: two paints",
    EdgeKind.ONE_BAND: "a shadow's edge, a fold or two paints",
}


def edge_sentence(edge: RegionEdge) -> str:
    """Where an edge runs, what it can be, and what to outline instead.

    Parameters
    ----------
    edge : RegionEdge
    """
    (x0, y0), (x1, y1) = edge.line_px
    steps = edge.step[np.isfinite(edge.step)]
    low, high = (percent(abs(float(size)), 0) for size in (steps[np.argmin(np.abs(steps))],
                                                           steps[np.argmax(np.abs(steps))]))
    by = high if low == high else f"{low} to {high}"
    remedy = "outline one side of it"
    if edge.larger_part_px is not None:
        remedy = f"outline its larger part, rect {edge.larger_part_px.astype(int).tolist()}"
    return (f"an edge runs across it from ({x0:.0f}, {y0:.0f}) to ({x1:.0f}, {y1:.0f}), by "
            f"{by}, {CAUSES[edge.kind]}; {remedy}")


def edge_facts(edge: RegionEdge) -> dict[str, Any]:
    """For JSON.

    Parameters
    ----------
    edge : RegionEdge
    """
    part = edge.larger_part_px
    return {"kind": edge.kind.value,
            "step": [None if np.isnan(step) else float(step) for step in edge.step],
            "line_px": edge.line_px.tolist(),
            "larger_part_px": None if part is None else part.astype(int).tolist()}
