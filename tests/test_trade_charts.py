"""Charts of the trade whose measured spectra ship: photographed, and calibrated without a file."""
import json
import os
from pathlib import Path

import numpy as np
import pytest
from chart_photos import GRID, PRINTED, Printed, photograph

from spectrabox.capture.chart.detection import find_chart
from spectrabox.capture.photo.image_writers import write_linear_exr
from spectrabox.fixtures.paints import paint
from spectrabox.radiometry.chart import (
    AS_ASKED,
    chart_reflectances,
    order_correlations,
    typical_camera_signals,
)
from spectrabox.radiometry.charts.layouts import chart_layout
from spectrabox.radiometry.charts.references import published_signals
from spectrabox.radiometry.errors import ChartNotFoundError, CheckError
from spectrabox.radiometry.published.make_tables import tables_of_beyondrgb
from spectrabox.radiometry.published.published_tables import TRADE, all_published
from spectrabox.radiometry.spectra.named_spectra import light, sensitivities

from tests.session_runs import call

CURVES, POWER = sensitivities("Nikon 5100 (NPL)", GRID), light("A", GRID)
LAID = {"Digital SG": PRINTED["ColorChecker Digital SG"],
        "NGT": Printed(7.0 * np.arange(13), 7.0 * np.arange(10), (6.0, 6.0)),
        "APT": Printed(7.0 * np.arange(6), 7.0 * np.arange(4), (6.0, 6.0))}
LEVELS = 0.032          # by which copies of a ColorChecker Classic differ, of the logarithm
TABLE = paint("green_wall")


def camera_signals(reflectances):
    """What the camera reads under illuminant A, a perfect white at 0.8 in its brightest band."""
    response = CURVES * POWER * GRID.weights_nm
    return 0.8 * reflectances @ response.T / response.sum(axis=1).max()


def table():
    """Reflectance (P,) of the table that the chart lies on."""
    return np.interp(GRID.nm, *TABLE)


def another_copy(reflectances):
    """Patches (I, P) of another copy: their levels and slopes differ."""
    rng = np.random.default_rng(3)
    level, slope = (error * rng.standard_normal((len(reflectances), 1))
                    for error in (LEVELS, LEVELS / 4))
    return reflectances * np.exp(level + slope * (GRID.nm - 550) / 150)


@pytest.fixture(scope="module", params=LAID)
def shot(request, tmp_path_factory):
    """Name of the chart, its layout, file of a photo of another copy, and corners as written."""
    chart, laid = chart_layout(request.param), LAID[request.param]
    corners = laid.corners(4, height=400)
    copy = another_copy(chart_reflectances(chart.references[0], GRID, chart))
    photo = photograph(laid, camera_signals(copy), corners, background=camera_signals(table()))
    file = tmp_path_factory.mktemp("shot") / "chart.exr"
    write_linear_exr(file, photo)
    return request.param, chart, file, " ".join(f"{x:.2f},{y:.2f}" for x, y in corners)


@pytest.mark.parametrize("shot", ["APT"], indirect=True)    # of more patches the next test fits
def test_a_camera_is_fitted_without_a_file(shot):
    name, chart, file, corners = shot
    ran = call("camera", "fit", "--chart", file, "--light", "A", "--chart-layout", name,
               "--corners", corners, "--json")
    assert ran.exit_code == 0, ran.stdout
    facts = json.loads(ran.stdout)
    assert len(facts["chart_delta_e00_patches"]) == len(chart.names)
    assert facts["held_out_delta_e00"] < 1.5        # copies differ by 3 % in the level of a patch


@pytest.mark.usefixtures("light_as_stated", "no_advice")
def test_a_sample_beside_the_chart_is_measured_without_a_file(shot):
    name, _, file, corners = shot
    ran = call("flat", file, "--light", "A", "--chart-layout", name, "--corners", corners,
               "--region", "table=20,20,90,90", "--json", "--session", file.parent / "session")
    assert ran.exit_code == 0, ran.stdout
    region, = json.loads(ran.stdout)["regions"]
    truth = np.interp(region["wavelengths_nm"], GRID.nm, table())
    held = (truth >= region["lower"]) & (truth <= region["upper"])
    assert held.mean() > 0.9


def test_no_corners_no_target():
    chart, laid = chart_layout("NGT"), LAID["NGT"]
    photo = photograph(laid, camera_signals(chart_reflectances("BeyondRGB NGT", GRID, chart)),
                       laid.corners())
    with pytest.raises(ChartNotFoundError, match=r"a Next Generation Target cannot be found in "
                                                 r"photo chart\.exr by itself; give --corners"):
        find_chart(photo, published_signals(chart, GRID), None, chart)


@pytest.mark.parametrize("name", LAID)
def test_a_chart_turned_by_half_at_its_corners_is_read_right_or_refused(name):
    """The reference tells the patches apart, whichever corner was given first."""
    chart, laid = chart_layout(name), LAID[name]
    signals = camera_signals(chart_reflectances(chart.references[0], GRID, chart))
    photo = photograph(laid, signals, laid.corners())
    reference = typical_camera_signals(chart_reflectances(chart.references[0], GRID, chart), GRID,
                                       POWER)
    right = find_chart(photo, reference, laid.corners(), chart)
    try:
        turned = find_chart(photo, reference, laid.corners()[[2, 3, 0, 1]], chart)
    except CheckError:
        return
    np.testing.assert_allclose(turned.corners_px.mean(axis=1), right.corners_px.mean(axis=1),
                               atol=1.0)


def test_the_copy_of_the_sg_has_the_colours_that_its_maker_publishes():
    chart = chart_layout("Digital SG")
    copy = typical_camera_signals(chart_reflectances("BeyondRGB Digital SG", GRID, chart), GRID)
    correlations = order_correlations(copy, published_signals(chart, GRID), chart.rows)
    assert max(correlations, key=correlations.get) == AS_ASKED and correlations[AS_ASKED] > 0.98


@pytest.mark.parametrize("name", LAID)
def test_neutrals_fall_from_white_to_black(name):
    chart = chart_layout(name)
    greys = chart_reflectances(chart.references[0], GRID, chart)[list(chart.neutrals)]
    beyond_430 = greys[:, GRID.nm >= 430]
    assert np.all(np.diff(greys.mean(axis=1)) < 0)
    assert np.all(beyond_430.std(axis=1) < 0.09 * beyond_430.mean(axis=1) + 0.004)


def test_the_tables_are_those_of_their_source():
    folder = Path(os.environ.get("SPECTRABOX_DATA", "missing")) / "chart_copies"
    if not folder.is_dir():
        pytest.skip("SPECTRABOX_DATA names no folder with the reference data of BeyondRGB")
    shipped = all_published(TRADE)
    for name, source in tables_of_beyondrgb(folder).items():
        nm, patches = shipped[name.removeprefix(f"{TRADE}/")]
        np.testing.assert_array_equal(np.vstack([nm, patches]), source)
