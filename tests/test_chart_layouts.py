"""Layouts of charts, shipped and written, and measured references in whatever order."""
import numpy as np
import pytest

from spectrabox.radiometry.chart import (
    AS_ASKED,
    CLASSIC,
    chart_reflectances,
    excluded_patches,
    order_correlations,
    table_orders,
    typical_camera_signals,
)
from spectrabox.radiometry.charts.layouts import LAYOUT_NAMES, LAYOUTS, chart_layout
from spectrabox.radiometry.charts.references import measured_chart, reference_reflectances
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.published.published_tables import published_colours
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats.cgats import sp_text
from spectrabox.radiometry.spectra.spectrum_files import table_text

GRID = visible_grid(10.0)
COUNTS = {"ColorChecker Classic": 24, "ColorChecker Passport": 24, "ColorChecker Nano": 24,
          "ColorChecker Digital SG": 140, "SpyderCheckr 24": 24, "SpyderCheckr 48": 48,
          "Next Generation Target": 130, "Artist Paint Target": 24}


@pytest.mark.parametrize("name", COUNTS)
def test_a_layout_has_every_patch_once_inside_its_card(name):
    chart = LAYOUTS[name]
    assert len(set(chart.names)) == len(chart.names) == chart.rows * chart.columns == COUNTS[name]
    low, high = chart.centres_uv - chart.sizes_uv / 2, chart.centres_uv + chart.sizes_uv / 2
    # Outermost patches may end at the card's edge: round-off of one division.
    assert low.min() > -1e-12 and high.max() < 1 + 1e-12
    grid = chart.centres.reshape(chart.rows, chart.columns, 2)
    # Patches of a row and of a column do not overlap.
    assert np.diff(grid[..., 0], axis=1).min() > chart.sizes[0, 0]
    assert np.diff(grid[..., 1], axis=0).min() > chart.sizes[0, 1]


def test_the_classic_is_the_printed_card():
    # 290 x 203 mm, patches of 40 mm at 43.5 mm: the first centre is 16.25 + 20 mm from each edge.
    np.testing.assert_allclose(CLASSIC.centres_uv[0] * [290, 203], [36.25, 36.25], rtol=1e-12)
    np.testing.assert_allclose(CLASSIC.centres_uv[23] * [290, 203], [253.75, 166.75], rtol=1e-12)
    np.testing.assert_allclose(CLASSIC.sizes_uv[0] * [290, 203], [40, 40], rtol=1e-12)


def test_patches_have_the_names_that_are_printed_beside_them():
    sg, spyder = LAYOUTS["ColorChecker Digital SG"], LAYOUTS["SpyderCheckr 48"]
    assert [sg.names[index] for index in (0, 13, 14, 139)] == ["A1", "N1", "A2", "N10"]
    assert sg.fiducial_names == ("A1", "N1", "N10", "A10")
    # The hinge lies between the columns D and E.
    x = dict(zip(spyder.names, spyder.centres[:, 0], strict=True))
    assert x["E1"] - x["D1"] > 2 * (x["D1"] - x["C1"])


def test_neutrals_of_the_sg_are_grey_and_fall_from_white_to_black():
    sg = LAYOUTS["ColorChecker Digital SG"]
    colours = published_colours(sg.colours)[list(sg.neutrals)]
    assert np.all(np.diff(colours[:, 1]) < 0) and colours[0, 1] > 0.9 and colours[-1, 1] < 0.03
    white = np.array([0.9642, 1.0, 0.8249])             # D50
    # Greys of a chart are neutral within a few per cent; its colours differ by ten times as much.
    assert np.ptp(colours / white / colours[:, 1:2], axis=1).max() < 0.1


@pytest.mark.parametrize("written, name", [
    ("ColorChecker Classic", "ColorChecker Classic"), ("digital sg", "ColorChecker Digital SG"),
    ("colorchecker nano", "ColorChecker Nano"), ("SpyderCheckr24", "SpyderCheckr 24")])
def test_a_chart_is_known_however_its_name_is_spaced(written, name):
    assert chart_layout(written) is LAYOUTS[name]


def test_an_unknown_chart_is_answered_with_the_known():
    with pytest.raises(InputError, match=r"'QPcard' is not known; known are ColorChecker Classic,"
                                         r".*Artist Paint Target, or a layout of your own"):
        chart_layout("QPcard")


# ---- written layouts -----------------------------------------------------------------------------

GOOD = 'name = "ours"\nrows = 2\ncolumns = 3\npatch = [10.0, 8.0]\n'


def written(folder, text):
    (folder / "ours.toml").write_text(text, encoding="utf-8")
    return chart_layout(str(folder / "ours.toml"))


def test_a_written_layout_lies_where_it_says(tmp_path):
    chart = written(tmp_path, GOOD + "pitch = [12.0, 9.0]\nborder = [1.0, 2.0]\n"
                    'neutrals = ["B1", "A2"]\nreference = "ours.csv"\n')
    assert chart.names == ("A1", "B1", "C1", "A2", "B2", "C2") and chart.neutrals == (1, 3)
    # The patches end at 24 + 10 by 9 + 8; the card at 1 and 2 beyond them on either side.
    np.testing.assert_allclose(chart.card, [36, 21])
    np.testing.assert_allclose(chart.centres_uv * chart.card,
                               [[6, 6], [18, 6], [30, 6], [6, 15], [18, 15], [30, 15]])
    np.testing.assert_allclose(np.ptp(chart.fiducials, axis=0), [34, 17])
    assert chart.reference_file == tmp_path / "ours.csv"


def test_a_layout_by_centres_is_that_by_pitch(tmp_path):
    by_pitch = written(tmp_path, GOOD + "pitch = [12.0, 9.0]\n")
    by_centres = written(tmp_path, GOOD + "centres = [[100.0, 50.0], [112.0, 50.0], [124.0, 50.0], "
                         "[100.0, 59.0], [112.0, 59.0], [124.0, 59.0]]\n")
    np.testing.assert_allclose(by_centres.centres, by_pitch.centres, atol=1e-12)
    np.testing.assert_allclose(by_centres.fiducials, by_pitch.fiducials, atol=1e-12)
    marks = 'fiducial_names = ["cross 1", "cross 2", "cross 3", "cross 4"]\nfiducials = '
    from_corner = written(tmp_path, GOOD + "pitch = [12.0, 9.0]\n" + marks
                          + "[[-3.0, -3.0], [37.0, -3.0], [37.0, 20.0], [-3.0, 20.0]]\n")
    # The middle of the patches is 17 and 8.5 from the outer corner of the first.
    np.testing.assert_allclose(from_corner.fiducials, [[-20, -11.5], [20, -11.5], [20, 11.5],
                                                       [-20, 11.5]])
    assert from_corner.corner_words == "cross 1, cross 2, cross 3 and cross 4"


@pytest.mark.parametrize("text, sentence", [
    (GOOD, "give either pitch or centres"),
    (GOOD + "pitch = [9.0, 9.0]\n", r"patches of \[10.0, 8.0\] at a pitch of \[9.0, 9.0\] overlap"),
    (GOOD + "pitch = [12.0]\n", "pitch has 1 numbers; two are needed"),
    (GOOD + 'pitch = [12.0, 9.0]\nnames = ["a", "b"]\n', "lists 2 different names; 2 rows of 3"),
    (GOOD + 'pitch = [12.0, 9.0]\nneutrals = ["A9"]\n', "'A9', which is no patch; did you mean"),
    (GOOD + "pitch = [12.0, 9.0]\nfiducials = [[0.0, 0.0]]\n", "fiducials and fiducial_names go"),
    (GOOD + "centres = [[1.0, 1.0]]\n", r"centres needs 6 points \[x, y\]; it has 1"),
    (GOOD + "pich = [12.0, 9.0]\n", "pich.*pitch"),
    (GOOD + "rows = 3\n", "is not valid TOML"),
])
def test_a_fault_of_a_layout_is_a_sentence(tmp_path, text, sentence):
    with pytest.raises(InputError, match=f"ours.toml.*{sentence}"):
        written(tmp_path, text)


# ---- references ----------------------------------------------------------------------------------

@pytest.fixture(scope="module")
def classic():
    return chart_reflectances("BabelColor Average", GRID)


def csv(folder, reflectances, names=None):
    path = folder / "measured.csv"
    columns = dict(zip(names or [f"patch {i}" for i in range(len(reflectances))], reflectances,
                       strict=True))
    path.write_text(table_text(GRID.nm, columns, quantity=Quantity.REFLECTANCE, source="ours"),
                    encoding="utf-8")
    return path


def test_the_eight_orders_differ_and_each_holds_every_patch():
    orders = list(table_orders(4, 6).values())
    assert len({tuple(order) for order in orders}) == 8
    assert all(sorted(order) == list(range(24)) for order in orders)


@pytest.mark.parametrize("words", table_orders(4, 6))
def test_the_order_of_a_table_is_found_out(tmp_path, classic, words):
    order = table_orders(4, 6)[words]
    table = np.empty_like(classic)
    table[order] = classic                  # patch p of the chart stands at order[p] of the table
    signals = typical_camera_signals(classic, GRID)
    estimate = order_correlations(typical_camera_signals(table, GRID), signals, 4)
    assert max(estimate, key=estimate.get) == words and estimate[words] > 1 - 1e-12
    path = csv(tmp_path, table)
    if words == AS_ASKED:
        # Nine significant digits are written.
        np.testing.assert_allclose(measured_chart(path, GRID, CLASSIC), classic, rtol=1e-8)
    else:
        with pytest.raises(CheckError, match=rf"measured.csv lists the patches of a ColorChecker "
                                             rf"Classic {words}: .* by 1.00, as listed"):
            measured_chart(path, GRID, CLASSIC)


def test_the_reflectances_of_another_chart_are_named_so(tmp_path):
    other = chart_reflectances("BeyondRGB APT", GRID, chart_layout("Artist Paint Target"))
    with pytest.raises(CheckError, match=r"measured.csv holds the reflectances of another chart "
                                         r"than a ColorChecker Classic: its 24 patches correlate"):
        measured_chart(csv(tmp_path, other), GRID, CLASSIC)


@pytest.mark.parametrize("reference", ["ISO 17321-1", "ColorChecker N Ohta"])
def test_other_charts_of_the_same_colours_are_in_order(tmp_path, reference):
    theirs = chart_reflectances(reference, GRID)
    measured = measured_chart(csv(tmp_path, theirs), GRID, CLASSIC)
    np.testing.assert_allclose(measured, theirs, rtol=1e-8)


@pytest.mark.parametrize("names", [CLASSIC.names, *CLASSIC.other_names,
                                   [f"{name[0]}0{name[1]}" for name in CLASSIC.other_names[0]]])
def test_samples_named_after_patches_may_come_in_any_order(tmp_path, classic, names):
    order = np.random.default_rng(2).permutation(24)
    path = csv(tmp_path, classic[order], [names[index] for index in order])
    np.testing.assert_allclose(measured_chart(path, GRID, CLASSIC), classic, rtol=1e-8)


def test_a_ti3_says_by_its_locations_which_patch_is_which(tmp_path):
    chart = LAYOUTS["SpyderCheckr 24"]
    truth = np.linspace(0.05, 0.9, 24)[:, None] * np.ones(GRID.nm.size)
    order = np.random.default_rng(3).permutation(24)
    text = sp_text(GRID.nm, {str(number): truth[index] for number, index in enumerate(order, 1)},
                   quantity=Quantity.REFLECTANCE, source="chartread")
    lines = text.replace("SAMPLE_NAME", "SAMPLE_ID SAMPLE_LOC").replace(
        f"FIELDS {GRID.nm.size + 1}", f"FIELDS {GRID.nm.size + 2}").splitlines()
    start = lines.index("BEGIN_DATA") + 1
    for row, index in enumerate(order):
        label, _, values = lines[start + row].partition(" ")
        lines[start + row] = f"{label} {chart.names[index]} {values}"
    path = tmp_path / "chart.ti3"
    path.write_text("\n".join(lines), encoding="utf-8")
    np.testing.assert_allclose(measured_chart(path, GRID, chart), truth, rtol=1e-8)


def test_a_chart_without_published_spectra_asks_for_a_file():
    with pytest.raises(InputError, match=r"no reflectances of a SpyderCheckr 48 are published that "
                                         r"may ship with spectrabox; measure its 48 patches, or"):
        reference_reflectances(None, LAYOUTS["SpyderCheckr 48"], GRID)
    with pytest.raises(InputError, match=r"'BabelColor Average' is of another chart than the "
                                         r"SpyderCheckr 48; give a file of its 48"):
        reference_reflectances("BabelColor Average", LAYOUTS["SpyderCheckr 48"], GRID)
    with pytest.raises(InputError, match=r"'BabelColor Average' is not known; known are BeyondRGB "
                                         r"Digital SG, or a CSV"):
        reference_reflectances("BabelColor Average", LAYOUTS["ColorChecker Digital SG"], GRID)


def test_the_order_of_a_digital_sg_is_known_from_its_published_colours(tmp_path):
    sg = LAYOUTS["ColorChecker Digital SG"]
    # Spectra of about these colours: X, Y and Z spread over red, green and blue.
    xyz = published_colours(sg.colours) / [0.9642, 1.0, 0.8249]
    bumps = np.exp(-0.5 * ((GRID.nm - np.array([[610.0], [545.0], [450.0]])) / 45) ** 2)
    spectra = np.clip(xyz @ (bumps / bumps.sum(axis=0)), 0.005, 1)
    np.testing.assert_allclose(measured_chart(csv(tmp_path, spectra), GRID, sg), spectra, rtol=1e-8)
    by_columns = spectra[np.arange(140).reshape(10, 14).T.ravel()]
    with pytest.raises(CheckError, match="Digital SG column by column: in that order"):
        measured_chart(csv(tmp_path, by_columns), GRID, sg)


@pytest.mark.parametrize("numbers", [[1], [24], [3, 7, 24], []])
def test_patches_are_kept_out_by_their_numbers_from_one(numbers):
    excluded = excluded_patches(numbers, LAYOUTS["ColorChecker Classic"], "--leave-out")
    assert excluded.shape == (24,) and (np.flatnonzero(excluded) + 1).tolist() == numbers
    for wrong in (0, 25, -1):
        with pytest.raises(InputError, match=f"--leave-out {wrong} is no patch; those of"):
            excluded_patches([wrong], LAYOUTS["ColorChecker Classic"], "--leave-out")


def test_every_layout_has_its_name():
    assert tuple(LAYOUTS) == LAYOUT_NAMES
