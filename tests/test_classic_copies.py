"""Copies of the ColorChecker Classic: what a copy of either edition is like, and copies drawn."""
import numpy as np
import pytest

from spectrabox.fixtures.paints import COPIES, NM, chart_copy
from spectrabox.radiometry.chart import (
    CLASSIC,
    COPIES_BEFORE_2014,
    COPIES_SINCE_2014,
    GREYS,
    GREYS_FROM_NM,
    chart_reflectances,
    table_of_classic,
)
from spectrabox.radiometry.charts.references import editions
from spectrabox.radiometry.grid import FINE_GRID, grid_from_nm
from spectrabox.radiometry.published.published_tables import COPIES as COPIES_KIND
from spectrabox.radiometry.published.published_tables import published_names

FROM_430 = FINE_GRID.nm >= GREYS_FROM_NM


def test_the_mean_of_copies_lies_among_them():
    mean = chart_reflectances(COPIES_SINCE_2014, FINE_GRID)
    level = np.log(mean[GREYS][:, FROM_430]).mean()
    copies = np.array([table_of_classic(name, FINE_GRID) for name in COPIES])
    copies *= np.exp(level - np.log(copies[:, GREYS][..., FROM_430]).mean(axis=(1, 2)))[
        :, None, None]
    off = np.sqrt(((copies - mean)**2).mean(axis=(1, 2)))
    apart = np.sqrt(((copies[:, None] - copies)**2).mean(axis=(2, 3)))
    assert off.max() < 0.02 and off.mean() < apart[apart > 0].mean()


def test_level_and_grey_scale_of_the_mean_are_centred_on_tables_and_copies():
    def levels(names):
        return np.log([table_of_classic(name, FINE_GRID)[:, FROM_430].mean(axis=1)
                       for name in names])

    mean = np.log(chart_reflectances(COPIES_SINCE_2014, FINE_GRID)[:, FROM_430].mean(axis=1))
    # the instrument of the copy of 2016 read a fifth too much
    of_greys = levels(name for name in COPIES if name != "copy of August 2016")[:, GREYS]
    # means over wavelength of flat spectra: their logarithm is that of the geometric mean
    assert mean[GREYS].mean() == pytest.approx(of_greys.mean(), abs=1e-3)
    beside = levels(COPIES)
    beside -= beside[:, GREYS].mean(axis=1, keepdims=True)
    np.testing.assert_allclose(mean[18:] - mean[GREYS].mean(), beside[:, 18:].mean(axis=0),
                               atol=1e-3)
    # of colours the two means over wavelength differ, and by copies not quite alike
    assert mean[:18].mean() - mean[GREYS].mean() == pytest.approx(beside[:, :18].mean(), abs=5e-3)


@pytest.mark.parametrize("edition", editions(CLASSIC))
def test_copies_differ_in_level_as_tables_and_measured_copies_do(edition):
    rng = np.random.default_rng(3)
    drawn = np.log([edition.drawn(rng)[:, FROM_430].mean(axis=1) for _ in range(1500)])
    tables = np.log([table_of_classic(name, FINE_GRID)[:, FROM_430].mean(axis=1)
                     for name in COPIES])
    for logs in (drawn, tables):
        logs -= logs[:, GREYS].mean(axis=1, keepdims=True)
    spread = []
    for logs in (drawn, tables):
        together = logs[:, :18].mean(axis=1)
        own = logs[:, :18] - together[:, None]
        spread.append([logs[:, 18].std(ddof=1), logs[:, 23].std(ddof=1), together.std(ddof=1),
                       np.sqrt(own.var(axis=0, ddof=1).mean())])
    # five tables know a standard deviation to a third; what shapes add is in the drawn ones too
    np.testing.assert_allclose(spread[0], spread[1], rtol=0.4)


def test_whites_in_use_are_darker_than_the_average_of_charts_before_2014():
    charts = [chart_reflectances(name, FINE_GRID)[:, FROM_430].mean(axis=1)
              for name in ("BabelColor Average", COPIES_BEFORE_2014, COPIES_SINCE_2014)]
    average, before, since = (chart[18] / chart[GREYS].mean() for chart in charts)
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
