"""Colours and numbers that all plots share, drawn by Matplotlib or, in the report, without it."""
from __future__ import annotations

import itertools
from collections.abc import Sequence

INK, QUIET = "#22262b", "#6b7280"
MEAN, RENDERED, TRUTH = "#1f4e8c", "#d0661a", "#1a1a1a"
NATURAL = {"R": "#c2352b", "G": "#2c8a4b", "B": "#2b5fb8"}
# Matplotlib's "tab10", and those of it that are close to the natural ones
DISTINCT = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f",
            "#bcbd22", "#17becf")
LIKE_NATURAL = {"#1f77b4", "#2ca02c", "#d62728"}
DRAWS_SHOWN = 30


def band_colours(bands: Sequence[str]) -> list[str]:
    """One colour per camera band: red, green and blue where the band is named so, otherwise ten
    distinct ones.
    """
    taken = LIKE_NATURAL if NATURAL.keys() & set(bands) else set()
    spare = itertools.cycle([colour for colour in DISTINCT if colour not in taken])
    return [NATURAL[band] if band in NATURAL else next(spare) for band in bands]
