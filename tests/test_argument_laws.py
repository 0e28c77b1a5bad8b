"""Arguments of the library: however a light, a camera or a region is given, it is the same."""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import spectrabox as sb
from spectrabox.api import arguments
from spectrabox.calibrate.chart_calibration import calibration_from_curves
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import spectra
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.sampling.prior.mixture import load_prior

NM = FINE_GRID.nm
CAMERA = "Nikon 5100 (NPL)"
A = named_spectra.light("A", FINE_GRID)
CURVES = named_spectra.sensitivities(CAMERA, FINE_GRID)


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """Files of a light, of curves and of a transmittance."""
    folder = tmp_path_factory.mktemp("files")
    for name, columns in {"light": [A], "curves": CURVES, "filter": [0.2 + NM / 1000]}.items():
        names = ",".join("RGB"[:len(columns)])
        rows = [",".join(f"{value:.9g}" for value in row)
                for row in np.column_stack([NM, *columns])]
        (folder / f"{name}.csv").write_text("\n".join([f"nm,{names}", *rows]) + "\n")
    return folder


def relative(values):
    return values / values.max()


# ---- lights, filters, cameras

def test_a_light_is_the_same_however_it_is_given(table):
    for given in ("A", str(table / "light.csv"), table / "light.csv", (NM, A),
                  (NM[::5], A[::5]), arguments.as_light("A")):
        found = arguments.as_light(given)
        np.testing.assert_allclose(relative(found.values), relative(A), rtol=2e-4)
        assert arguments.as_spectrum(given).values.tolist() == found.values.tolist()
    assert arguments.as_light((NM, A)).source == "given"
    record = arguments.as_light("A")
    assert arguments.as_light(record) is record


@pytest.mark.parametrize("stated", ["unknown", "halogen", "3200K"])
def test_a_light_without_a_spectrum_is_refused_where_one_is_needed(stated):
    assert isinstance(arguments.as_light(stated), spectra.UnknownLight)
    with pytest.raises(sb.InputError, match="its spectrum is needed here"):
        arguments.as_spectrum(stated)
    with pytest.raises(sb.InputError, match="below zero"):
        arguments.as_light(spectra.Spectrum(FINE_GRID, -A, spectra.Quantity.RELATIVE, "a record"))


def test_a_filter_is_the_same_however_it_is_given(table):
    passed = 0.2 + NM / 1000
    for given in (table / "filter.csv", str(table / "filter.csv"), (NM, passed)):
        np.testing.assert_allclose(arguments.as_filter(given).transmittance, passed, rtol=1e-4)
    known = arguments.as_filter((NM, passed))
    assert arguments.as_filter(known) is known
    unknown = arguments.as_filter("unknown")
    assert not np.allclose(unknown.transmittance, passed)


def test_curves_are_the_same_however_they_are_given(table):
    known = sb.camera(CAMERA)
    fitted = calibration_from_curves(FINE_GRID, CURVES, arguments.as_spectrum("A"), 0.01)
    for given in (CAMERA, table / "curves.csv", known, (NM, CURVES), fitted):
        np.testing.assert_allclose(relative(arguments.as_curves(given)), relative(CURVES),
                                   atol=2e-4)
    np.testing.assert_allclose(arguments.as_curves((NM, CURVES[1]))[0], CURVES[1])
    with pytest.raises(sb.InputError, match="int is no camera"):
        arguments.as_curves(5)
    with pytest.raises(sb.InputError, match="product"):
        arguments.as_curves(replace(fitted, products=True))


def test_names_of_bands_are_the_camera_s_where_it_has_any(table):
    assert arguments.band_names(table / "curves.csv", 3) == ("R", "G", "B")
    assert arguments.band_names(sb.camera(CAMERA), 3) == sb.camera(CAMERA).bands
    assert arguments.band_names((NM, CURVES), 3) == ("", "", "")


def test_curves_err_as_they_are_said_to():
    assert arguments.curve_error((NM, CURVES)) == (None, ())
    by_name = arguments.curve_error(CAMERA)
    assert by_name == arguments.curve_error(sb.camera(CAMERA))
    fitted = calibration_from_curves(FINE_GRID, CURVES, arguments.as_spectrum("A"), 0.01)
    assert arguments.curve_error(fitted) == (None, ())
    doubt = Finding("light.unlike", Severity.WARN)
    known = replace(fitted, findings=(doubt, Finding("light.known", Severity.INFO)),
                    sensitivity=replace(fitted.sensitivity, standard_error=0.02 * CURVES))
    error, doubts = arguments.curve_error(known)
    # of the highest peak, root mean square over wavelengths and bands
    assert error == pytest.approx(0.02 * np.sqrt(np.mean(CURVES**2)) / CURVES.max())
    assert doubts == (doubt,)


def test_a_response_to_reflectances_gives_white_one():
    response = arguments.relative_response(CAMERA, "A")
    np.testing.assert_allclose(response.sum(axis=1), 1)
    expected = CURVES * A * FINE_GRID.weights_nm
    np.testing.assert_allclose(response, expected / expected.sum(axis=1, keepdims=True), rtol=1e-6)


# ---- regions, charts, statements

def test_corners_are_four_points_or_none():
    assert arguments.as_corners(None) is None
    corners = [[1, 2], [3, 2], [3, 4], [1, 4]]
    found = arguments.as_corners(corners)
    assert found.dtype == float and found.tolist() == corners
    for wrong in (corners[:3], [[1, 2, 3]] * 4, [["a", "b"]] * 4, [[1, np.nan]] * 4, 5):
        with pytest.raises(sb.InputError, match="four points"):
            arguments.as_corners(wrong)


def test_an_outline_is_a_rectangle_or_a_polygon_going_round():
    assert set(arguments.as_outline((1, 2, 5, 6))) == {(1, 2), (5, 2), (5, 6), (1, 6)}
    triangle = [(0, 0), (4, 0), (4, 3)]
    assert arguments.as_outline(triangle) == tuple(triangle)
    assert arguments.region_points(triangle, "a region").shape == (3, 2)
    for wrong in ((1, 2, 3), [(0, 0), (1, 1)], [(0, 0), (1,), (2, 2)], "1,2,3,4",
                  (1, 2, np.inf, 4), [(0, 0, 0)] * 3):
        with pytest.raises(sb.InputError, match="my region is"):
            arguments.region_points(wrong, "my region")


def test_a_chart_is_known_by_its_name_and_the_classic_by_none():
    assert arguments.as_chart(None) is CLASSIC and arguments.as_chart(CLASSIC) is CLASSIC
    assert arguments.as_chart(CLASSIC.name).names == CLASSIC.names
    with pytest.raises(sb.InputError):
        arguments.as_chart("none such")


def test_what_is_stated_of_all_surfaces_is_stated_of_each():
    names = ("a", "b")
    assert arguments.surfaces_of(None, names, "region") == {}
    assert arguments.surfaces_of("matt", names, "region") == {"a": "matt", "b": "matt"}
    assert arguments.surfaces_of({"b": "glossy"}, names, "region") == {"b": "glossy"}
    with pytest.raises(sb.InputError, match="there is no region 'c'; there are a, b"):
        arguments.surfaces_of({"c": "matt"}, names, "region")
    with pytest.raises(sb.InputError, match="not 'shiny'"):
        arguments.surfaces_of("shiny", names, "region")


def test_families_are_one_or_several():
    assert arguments.families_of(None) == () and arguments.families_of("paint") == ("paint",)
    assert arguments.families_of(["paint", "skin"]) == ("paint", "skin")
    for wrong in (5, [5], {"paint": 1}):
        with pytest.raises(sb.InputError, match="no names of families"):
            arguments.families_of(wrong)


def test_a_prior_is_that_of_the_families_that_are_stated():
    assert arguments.as_prior(None).stated == ()
    stated = arguments.as_prior(load_prior(), ["paint"])
    assert stated.stated == ("paint",)
    assert stated.nm.tolist() == load_prior().nm.tolist()
    with pytest.raises(sb.InputError, match="int is no prior"):
        arguments.as_prior(5)
