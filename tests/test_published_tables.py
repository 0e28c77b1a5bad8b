"""The tables that operators name are those of the installed colour-science."""
import colour
import numpy as np
import pytest

from spectrabox.radiometry.appearance import reflectance_to_srgb, tristimulus
from spectrabox.radiometry.chart import REFERENCES
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.published.make_tables import tables_of_colour_science
from spectrabox.radiometry.published.published_tables import (
    CHARTS,
    COLOURS,
    LIGHTS,
    OBSERVERS,
    published_curves,
    published_names,
)

THEIRS = tables_of_colour_science()


def test_every_name_of_colour_science_is_here():
    ours = [f"{kind}/{name}" for kind in (OBSERVERS, LIGHTS, CHARTS, COLOURS)
            for name in published_names(kind)]
    assert sorted(ours) == sorted(THEIRS)
    assert set(REFERENCES) <= set(published_names(CHARTS))


@pytest.mark.parametrize("table", THEIRS)
def test_every_table_is_theirs(table):
    nm, curves = published_curves(*table.split("/", 1))
    # colour-science calculates some tables (xyY to XYZ, CIE daylights): a processor with other
    # vector units rounds them otherwise, by a few eps; published tables have at most 10 digits.
    np.testing.assert_allclose(np.vstack([nm, curves]), THEIRS[table], rtol=1e-12, atol=1e-14)


def test_a_chart_has_its_24_patches_in_one_order():
    charts = colour.SDS_COLOURCHECKERS
    for name in REFERENCES:
        patches = list(charts[name])
        assert len(published_curves(CHARTS, name)[1]) == len(patches) == 24
        assert patches[0] == "dark skin"


def test_an_unknown_name_is_refused():
    with pytest.raises(InputError, match=r"'D66' is not among the published lights"):
        published_curves(LIGHTS, "D66")


def test_colours_under_d65_are_those_of_colour_science():
    nm = np.arange(360.0, 781.0)
    shape = colour.SpectralShape(360, 780, 1)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    light = colour.SDS_ILLUMINANTS["D65"].copy().align(shape)
    weights = observer.values.T * light.values
    for reflectance in (np.ones(nm.size), 0.05 + 0.6 / (1 + np.exp((580 - nm) / 10))):
        xyz = weights @ reflectance / weights[1].sum()
        # Both interpolate D65 by straight lines (CIE 15); their sums run in other orders.
        np.testing.assert_allclose(tristimulus(nm, reflectance), xyz, rtol=1e-12)
        # A colour adapted from D65 to D65 comes back within the rounding of that adaptation.
        np.testing.assert_allclose(reflectance_to_srgb(nm, reflectance),
                                   np.clip(colour.XYZ_to_sRGB(xyz), 0, 1), atol=1e-6)
