"""Patches of a chart that an operator keeps out of every fit, by number."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.errors import InputError


def left_out(numbers: Sequence[int], chart: Chart, place: str) -> np.ndarray:
    """Whether each patch (I,) is kept out.

    Parameters
    ----------
    numbers : sequence of int
        From 1, in chart order.
    chart : Chart
    place : str
        Where the operator wrote them, for the message.

    Raises
    ------
    InputError
        If the chart has no patch of such a number.
    """
    patches = len(chart.names)
    for number in numbers:
        if not 1 <= number <= patches:
            raise InputError(f"{place} {number} is no patch; those of the {chart.name} are "
                             f"numbered 1 to {patches}, {chart.names[0]} first")
    return np.isin(np.arange(1, patches + 1), list(numbers))
