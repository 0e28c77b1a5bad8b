"""How tables and measured copies of the ColorChecker Classic differ from the mean of copies.

The mean is made where it is asked for (``radiometry/chart.py``), from tables that
``radiometry/published/make_tables.py`` makes of their sources; its spread is stated in
``radiometry/charts/references.py``. Printed are, of every table and of further copies that are
named, the level of the greys beside the mean's, of white, greys and black beside their own greys,
of the coloured patches together, and the scatter of these; then standard deviations over the tables
that ship, and over copies as they are drawn. All are logarithms, from 430 nm on.

    python -m benchmarks.bench_chart_copies [--copies FILE ...]
"""
from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from spectrabox.radiometry.chart import (
    CLASSIC,
    COPIES_BEFORE_2014,
    COPIES_SINCE_2014,
    GREY_SCALE_OF,
    LEVELLED,
    chart_reflectances,
    levels_of_classic,
    table_of_classic,
)
from spectrabox.radiometry.charts.references import editions, measured_chart
from spectrabox.radiometry.grid import FINE_GRID

COLOURED, DRAWN, SEED = slice(18), 500, 1


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--copies", type=Path, nargs="*", default=[],
                        help="measured reflectances of further copies, of any format")
    names = GREY_SCALE_OF[COPIES_SINCE_2014]
    tables = {name: table_of_classic(name, FINE_GRID) for name in names}
    tables |= {path.name: measured_chart(path, FINE_GRID, CLASSIC)
               for path in parser.parse_args().copies}
    levels, greys = levels_of_classic(np.log(list(tables.values())), FINE_GRID)
    for mean in (COPIES_SINCE_2014, COPIES_BEFORE_2014):
        (mine,), (level,) = levels_of_classic(
            np.log(chart_reflectances(mean, FINE_GRID))[None], FINE_GRID)
        print(f"beside {mean}:")
        for name, each, grey in zip(tables, levels - mine, greys - level, strict=True):
            print(f"  {name:34s} greys {grey:+.3f}; white to black "
                  f"{' '.join(f'{one:+.3f}' for one in each[18:])}; coloured "
                  f"{each[COLOURED].mean():+.3f} +- {each[COLOURED].std(ddof=1):.3f}")
    rng = np.random.default_rng(SEED)
    drawn = levels_of_classic(np.log([editions(CLASSIC)[0].drawn(rng) for _ in range(DRAWN)]),
                              FINE_GRID)
    levelled = [names.index(name) for name in LEVELLED]
    print("standard deviations over the tables that ship, and of copies as the fit takes them:")
    for what, table, copy in zip(("greys", "coloured together", "a coloured patch", "white",
                                  "a grey", "black"),
                                 spread(levels[:len(names)], greys[levelled]), spread(*drawn),
                                 strict=True):
        print(f"  {what:18s} {table:.3f}   {copy:.3f}")


def spread(levels: np.ndarray, greys: np.ndarray) -> list[float]:
    """Standard deviations of copies: of the greys' level, of the coloured patches together, of one
    of them, of white, of a grey, and of black, all but the first beside the greys.

    Parameters
    ----------
    levels : (N, 24) array
    greys : (M,) array
    """
    together = levels[:, COLOURED].mean(axis=1)
    own = (levels[:, COLOURED] - together[:, None]).var(axis=0, ddof=1)
    neutral = levels[:, 18:].var(axis=0, ddof=1)
    return [float(one) for one in (greys.std(ddof=1), together.std(ddof=1), np.sqrt(own.mean()),
                                   *np.sqrt([neutral[0], neutral[1:5].mean(), neutral[5]]))]


if __name__ == "__main__":
    main()
