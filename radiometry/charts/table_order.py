"""In which order a table lists the patches of a chart: one of eight that mirrors and turns give."""
from __future__ import annotations

import numpy as np

AS_ASKED = "row by row"     # the order that every table should have
FLOOR = 1e-3                # of the brightest signal, below which darkness is not told apart


def table_orders(rows: int, columns: int) -> dict[str, np.ndarray]:
    """Of each way to read a table, in words, the index (I,) in it of every patch in chart order.

    Parameters
    ----------
    rows, columns : int
        Of the chart.
    """
    by_rows = np.arange(rows * columns).reshape(rows, columns)
    by_columns = np.arange(rows * columns).reshape(columns, rows).T
    orders: dict[str, np.ndarray] = {}
    for words, both, table in ((AS_ASKED, "", by_rows),
                               ("column by column", "column by column, ", by_columns)):
        orders |= {words: table,
                   f"{both}from the last patch to the first": table[::-1, ::-1],
                   f"{both}mirrored left to right": table[:, ::-1],
                   f"{both}mirrored top to bottom": table[::-1]}
    return {words: table.ravel() for words, table in orders.items()}


def order_correlations(signals: np.ndarray, chart_signals: np.ndarray,
                       rows: int) -> dict[str, float]:
    """Correlation of a table's signals with those of a chart, read in each of the eight orders.

    Of logarithms, each band less its mean, so that gains and the light do not count.

    Parameters
    ----------
    signals, chart_signals : (I, K) arrays
        Positive, in any unit.
    rows : int
        Of the chart.

    Returns
    -------
    dict of float
        From the order in words; the first, ``AS_ASKED``, is the one that is asked for.
    """
    one, other = (_centred(values) for values in (signals, chart_signals))
    norm = np.linalg.norm(one) * np.linalg.norm(other)
    return {words: float((one[order] * other).sum() / norm)
            for words, order in table_orders(rows, len(signals) // rows).items()}


def _centred(signals: np.ndarray) -> np.ndarray:
    logarithms = np.log(np.maximum(signals, FLOOR * signals.max()))
    return np.asarray(logarithms - logarithms.mean(axis=0))
