import numpy as np
import pytest

from spectrabox.radiometry.chart import AFTER_2014, CLASSIC, chart_reflectances
from spectrabox.radiometry.charts.references import measured_chart
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import grid_from_nm, visible_grid
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.spectrum_files import (
    on_grid,
    read_curves,
    read_spectrum,
    read_table,
    spectrum_on_grid,
    table_text,
)

CANONICAL = ("# quantity: reflectance\n# unit: 1\n# source: lab\n"
             "wavelength_nm,value,standard_error\n")


def write(tmp_path, text, name="s.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_canonical_file_comes_back_as_written(tmp_path):
    nm, values = np.arange(380.0, 731.0), np.random.default_rng(1).uniform(size=351)
    path = write(tmp_path, table_text(nm, {"value": values}, quantity=Quantity.REFLECTANCE,
                                      source="lab 7"))
    spectrum = read_spectrum(path, role=Quantity.REFLECTANCE)
    assert spectrum.source == "lab 7" and spectrum.quantity is Quantity.REFLECTANCE
    # Nine significant digits are written: half a unit of the ninth.
    np.testing.assert_allclose(spectrum.values, values, rtol=5e-9)


def test_the_standard_error_travels_with_the_values(tmp_path):
    spectrum = read_spectrum(write(tmp_path, CANONICAL + "400,0.5,0.01\n500,0.6,0.02\n"),
                             role=Quantity.REFLECTANCE)
    np.testing.assert_array_equal(spectrum.standard_error, [0.01, 0.02])


@pytest.mark.parametrize("text", [
    "nm;R\n400;0,25\n500;0,5\n", "nm\tR\n400\t0.25\n500\t0.5\n", "400,0.25\n500,0.5\n",
    "﻿nm,R\n400,0.25\n500,0.5\n\n"])
def test_loose_files_are_read(tmp_path, text):
    spectrum = read_spectrum(write(tmp_path, text), role=Quantity.REFLECTANCE)
    np.testing.assert_array_equal(spectrum.values, [0.25, 0.5])


def test_a_column_is_chosen_by_name_or_number(tmp_path):
    path = write(tmp_path, "nm,red,green,red\n400,1,2,3\n500,4,5,6\n")
    np.testing.assert_array_equal(read_spectrum(path, role=Quantity.RELATIVE,
                                                column="green").values, [2, 5])
    np.testing.assert_array_equal(read_spectrum(path, role=Quantity.RELATIVE, column=4).values,
                                  [3, 6])


def test_units_are_converted_to_si(tmp_path):
    path = write(tmp_path, "# quantity: radiance\n# unit: uW cm-2 sr-1 "
                 "nm-1\nnm,v\n400,100\n500,200\n")
    spectrum = read_spectrum(path, role=Quantity.RELATIVE)
    assert spectrum.quantity is Quantity.RADIANCE
    np.testing.assert_allclose(spectrum.values, [1, 2])


@pytest.mark.parametrize("text, options, message", [
    ("", {}, "is empty"),
    ("hello\nworld\n", {}, "holds no table of wavelengths"),
    ("nm,v\n400,1\n390,1\n420,1\n", {}, "must ascend; they turn back at 390 nm"),
    ("x,v\n0.4,1\n0.5,2\n", {}, "cannot be in nm"),
    ("nm,a,b\n400,1,1\n500,1,1\n", {}, "holds 2 columns .'a', 'b'.; say which"),
    ("nm,a,b\n400,1,1\n500,1,1\n", {"column": "c"}, "no column named 'c'; it holds 'a', 'b'"),
    ("nm,a,a\n400,1,1\n500,1,1\n", {"column": "a"}, "2 columns named 'a'"),
    ("nm,a\n400,1\n500,1\n", {"column": 7}, "has no column 7"),
    ("nm,a\n400,40\n500,80\n", {}, "looks like percent"),
    ("nm,a\n400,-0.4\n500,0.5\n", {}, "cannot be negative"),
    ("# quantity: radiance\nnm,a\n400,0.1\n500,0.1\n", {}, "holds radiance; reflectance is needed"),
    ("# quantity: mood\nnm,a\n400,0.1\n500,0.1\n", {}, "states the quantity 'mood'"),
    ("# unit: furlong\nnm,a\n400,0.1\n500,0.1\n", {}, "states the unit 'furlong'"),
    ("nm,a\n400,x\n500,y\n", {}, "holds no numbers"),
    ("nm,a\n400,1\n", {}, "holds no table"),
    ("nm,a\n400,1\n410,1\nend,1\n420,1\n430,1\n", {}, "'end' stands where a wavelength is needed")])
def test_a_bad_file_gets_one_sentence(tmp_path, text, options, message):
    with pytest.raises(InputError, match=message):
        read_spectrum(write(tmp_path, text), role=Quantity.REFLECTANCE, **options)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.csv is missing"):
        read_table(tmp_path / "nothing.csv")


def test_a_binary_file_is_not_a_spectrum(tmp_path):
    path = tmp_path / "b.csv"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="not a text file"):
        read_table(path)


def test_resampling_reproduces_a_line_and_never_extrapolates():
    grid = visible_grid()
    for step in (1.0, 10.0):
        nm = np.arange(400.0, 701.0, step)
        # Both rules are exact for lines up to round-off.
        np.testing.assert_allclose(on_grid(nm, 0.001 * nm, grid, "line"), 0.001 * grid.nm,
                                   rtol=1e-12)
    with pytest.raises(InputError, match="covers 420-700 nm; 400-700 nm is needed"):
        on_grid(np.arange(420.0, 701.0), np.ones(281), grid, "lamp.csv")


def test_curves_come_with_their_names(tmp_path):
    nm, names, values = read_curves(write(tmp_path, "nm,R,G,B\n400,1,2,3\n410,4,5,6\n"))
    assert names == ("R", "G", "B")
    np.testing.assert_array_equal(values, [[1, 4], [2, 5], [3, 6]])
    np.testing.assert_array_equal(nm, [400, 410])


def test_a_spectrum_keeps_its_own_grid():
    from spectrabox.radiometry.records.spectra import Spectrum
    spectrum = Spectrum(grid_from_nm(np.array([380.0, 800.0])), np.array([0.0, 0.42]),
                        Quantity.RELATIVE, "ramp")
    # Coarser than 2.5 nm: the cubic through two points is their line.
    line = 0.001 * (visible_grid().nm - 380)
    np.testing.assert_allclose(spectrum_on_grid(spectrum, visible_grid()), line, atol=1e-12)


def test_a_hole_in_a_spectrum_is_not_bridged(tmp_path):
    rows = [f"{nm},{'' if 500 < nm < 560 else 1}" for nm in range(380, 781, 5)]
    spectrum = read_spectrum(write(tmp_path, "nm,value\n" + "\n".join(rows), "light.csv"),
                             role=Quantity.RELATIVE)
    with pytest.raises(
            InputError,
            match=r"light.csv, column value has no values between 500 and 560 nm: measure or"):
        spectrum_on_grid(spectrum, visible_grid())


@pytest.mark.parametrize("nm",
                         [[400, 450, 500, 600, 700], [*range(380, 716, 5), 900],
                          [300, *range(390, 711, 10)]])
def test_a_coarse_grid_and_steps_outside_the_visible_are_no_holes(nm):
    spectrum = Spectrum(grid_from_nm(np.array(nm)), np.ones(len(nm)), Quantity.RELATIVE,
                        "light.csv")
    # Ones interpolate to ones within round-off.
    np.testing.assert_allclose(spectrum_on_grid(spectrum, visible_grid()), 1, rtol=1e-14)


@pytest.mark.parametrize("unit, factor", [("1", 1.0), ("percent", 100.0)])
def test_a_chart_of_one_s_own_is_read_in_the_unit_that_its_file_states(tmp_path, unit, factor):
    nm = np.arange(400.0, 701.0, 5.0)
    reflectances = 0.9 * chart_reflectances(AFTER_2014, grid_from_nm(nm))   # a copy that is darker
    text = table_text(nm, {f"patch {i}": factor * row for i, row in enumerate(reflectances)},
                      quantity=Quantity.REFLECTANCE, source="chart")
    found = measured_chart(write(tmp_path, text.replace("# unit: 1", f"# unit: {unit}")),
                           visible_grid(), CLASSIC)
    # Nine significant digits are written.
    np.testing.assert_allclose(found[:, ::5], reflectances, rtol=1e-8)


def test_a_chart_in_percent_that_does_not_say_so_is_refused(tmp_path):
    nm = np.arange(400.0, 701.0, 5.0)
    text = table_text(nm, {f"patch {i}": np.full(nm.size, 30.0) for i in range(24)},
                      quantity=Quantity.REFLECTANCE, source="chart")
    with pytest.raises(InputError, match="a reflectance of 30 looks like percent"):
        measured_chart(write(tmp_path, text), visible_grid(), CLASSIC)
    with pytest.raises(InputError, match="holds 1 columns; 24 are needed, one per patch"):
        measured_chart(write(tmp_path, "nm,a\n400,0.1\n700,0.2\n"), visible_grid(), CLASSIC)
