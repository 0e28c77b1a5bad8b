"""Copies of the ColorChecker Classic: what a copy of either edition is like, and copies drawn."""
import numpy as np
import pytest

from spectrabox.fixtures.paints import COPIES, NM, chart_copy
from spectrabox.radiometry.chart import (
    AFTER_2014,
    COPIES_BEFORE_2014,
    COPIES_SINCE_2014,
    GREYS,
    GREYS_FROM_NM,
    chart_reflectances,
    table_of_classic,
)
from spectrabox.radiometry.grid import FINE_GRID, grid_from_nm
from spectrabox.radiometry.published.published_tables import COPIES as COPIES_KIND
from spectrabox.radiometry.published.published_tables import published_names

FROM_430 = FINE_GRID.nm >= GREYS_FROM_NM


def test_the_mean_of_copies_lies_among_them_at_the_level_of_its_edition():
    mean, later = (chart_reflectances(name, FINE_GRID) for name in (COPIES_SINCE_2014, AFTER_2014))
    level = [np.log(chart[GREYS][:, FROM_430]).mean() for chart in (mean, later)]
    assert level[0] == pytest.approx(level[1], abs=1e-9)
    copies = np.array([table_of_classic(name, FINE_GRID) for name in COPIES])
    copies *= np.exp(level[0] - np.log(copies[:, GREYS][..., FROM_430]).mean(axis=(1, 2)))[
        :, None, None]
    off = np.sqrt(((copies - mean)**2).mean(axis=(1, 2)))
    apart = np.sqrt(((copies[:, None] - copies)**2).mean(axis=(2, 3)))
    assert off.max() < 0.02 and off.mean() < apart[apart > 0].mean()


def test_whites_in_use_are_darker_than_the_average_of_charts_before_2014():
    white = {name: chart_reflectances(name, FINE_GRID)[18, FROM_430].mean()
             for name in ("BabelColor Average", COPIES_BEFORE_2014, COPIES_SINCE_2014)}
    average, before, since = white.values()
    assert 0.93 * average < since < before < average


def test_copies_drawn_depart_from_their_mean_as_measured_copies_do():
    rng, grid = np.random.default_rng(1), grid_from_nm(NM)
    drawn = np.log([chart_copy(rng) for _ in range(200)])
    measured = np.log([table_of_classic(name, grid) for name in COPIES])
    for logs in (drawn, measured):
        logs -= logs[:, GREYS, NM >= GREYS_FROM_NM].mean(axis=(1, 2))[:, None, None]
    ours, theirs = (logs.var(axis=0, ddof=1) for logs in (drawn, measured))
    # taking the level of the greys away again takes little of the variance
    assert np.sqrt(ours.mean()) == pytest.approx(np.sqrt(theirs.mean()), rel=0.08)
    np.testing.assert_allclose(
        drawn.mean(axis=0)[:18],
        np.log(chart_reflectances(COPIES_SINCE_2014, grid))[:18]
        - np.log(chart_reflectances(COPIES_SINCE_2014, grid))[
            GREYS, NM >= GREYS_FROM_NM].mean(), atol=5 * np.sqrt(theirs[:18] / 200).max())


def test_measured_copies_ship_with_all_their_patches():
    assert published_names(COPIES_KIND) == ["copy of August 2016", "used copy"]
    for name in published_names(COPIES_KIND):
        chart = table_of_classic(name, grid_from_nm(NM))
        assert chart.shape == (24, NM.size) and chart.min() > 0.02 and chart.max() < 1.1
