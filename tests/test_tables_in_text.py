"""A table is found inside a text: generated files of known truth, and small files of the kinds that
instruments and archives write (SPECTRABOX_DATA names the folder that holds field5/).
"""
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectrum_files import read_curves, read_spectrum, read_table

C_NM_THZ, HC_EV_NM = 299_792.458, 1_239.841984
# unit as a file may write it, and the axis of a wavelength in nm
AXES = {"nm": lambda nm: nm, "Nanometers": lambda nm: nm, "um": lambda nm: nm / 1e3,
        "micrometers": lambda nm: nm / 1e3, "µm": lambda nm: nm / 1e3,
        "Angstrom": lambda nm: 10 * nm, "Å": lambda nm: 10 * nm, "cm-1": lambda nm: 1e7 / nm,
        "1/cm": lambda nm: 1e7 / nm, "THz": lambda nm: C_NM_THZ / nm,
        "eV": lambda nm: HC_EV_NM / nm}
PERCENTS = ("%", "percent", "% reflectance")
PREAMBLES = (
    ["SpectraSuite Data File", "++++++++++++++++", "Integration Time (usec): 20000 (USB4A00428)",
     "Number of Pixels in Processed Spectrum: 31", ">>>>>Begin Processed Spectral Data<<<<<"],
    ["/*** Some SIG Data ***/", "scan coadds= 28, 170, 205, 10, 61, 205", "temp= 33.1, -5.0, -9.7",
     "external data set1= 0,0,0,0,0,0,0,0", "longitude= , ", "data="],
    ["name; of the sample; 17", "", "Averaging Nr. [scans]: 20", "12;30;45"],
    ["Graph Title:", "two words", "1 2 3", "2822"], [])
TRAILERS = ([], [">>>>>End Processed Spectral Data<<<<<"], ["", "##END"], ["Mean, 0.31", "ok"])


@st.composite
def texts(draw):
    """A text, its wavelengths (P,) in nm and fractions (C, P), and the names of its columns."""
    delimiter, decimal = draw(st.sampled_from([
        ("\t", "."), (";", "."), (",", "."), ("  ", "."), ("\t", ","), (";", ","), ("  ", ","),
        (", ", ".")]))
    count = draw(st.integers(8, 40))
    start, step = draw(st.sampled_from([380.0, 400.0, 350.5])), draw(st.sampled_from([1, 5, 10]))
    nm = start + step * np.arange(count)
    seed = draw(st.integers(0, 2**20))
    columns = draw(st.integers(1, 4))
    values = np.random.default_rng(seed).uniform(0.01, 1, (columns, count)).round(5)
    unit = draw(st.sampled_from(sorted(AXES)))
    percent = draw(st.booleans())
    style = draw(st.sampled_from(["header", "unit row", "lines"]))
    names = [f"patch{index}" for index in range(columns)]
    axis = AXES[unit](nm)
    shown = values * (100 if percent else 1)
    word = draw(st.sampled_from(PERCENTS))
    value_units = [word if percent else "1"] * columns
    head: list[str] = []
    between = delimiter
    if style == "header":
        head = [between.join([f"Wavelength ({unit})", *(
            f"{name} ({word})" if percent else name for name in names)])]
        names = [f"{name} ({word})" if percent else name for name in names]
    elif style == "unit row":
        head = [between.join(["Wave", *names]),
                between.join([f"[{unit}]", *(f"[{each}]" for each in value_units)])]
    preamble = list(draw(st.sampled_from(PREAMBLES)))
    if style == "lines":
        preamble = ["Name: paint, green", f"X Units: Wavelength ({unit})",
                    f"Y Units: Reflectance ({'percent' if percent else 'fraction'})", *preamble]
        names = [f"column {index + 2}" for index in range(columns)]
    order = slice(None, None, -1 if draw(st.booleans()) else 1)
    rows = [between.join([f"{x:.6f}", *(f"{y:.5f}" for y in row)]).replace(".", decimal)
            for x, row in zip(axis[order], shown.T[order], strict=True)]
    text = "\n".join([*preamble, *head, *rows, *draw(st.sampled_from(TRAILERS))]) + "\n"
    if draw(st.booleans()):
        text = text.replace("\n", "\r\n")
    content = text.encode("utf-8")
    if preamble and draw(st.booleans()):        # a name filled up with zeros
        first, rest = content.split(b"\n", 1)
        content = first.rstrip(b"\r") + b"\x00" * 40 + b"\r\n" + rest
    if draw(st.integers(0, 5)) == 0:
        content = text.encode("utf-16")
    return content, nm, values, names


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture,
                                                   HealthCheck.too_slow],
          deadline=None, derandomize=True)
@given(texts())
def test_a_table_is_read_whatever_stands_around_it(tmp_path, case):
    content, nm, values, names = case
    path = tmp_path / "table.txt"
    path.write_bytes(content)
    table = read_table(path)
    assert list(table.names) == names
    # the axis has six decimals: 5e-7 of 0.35 um is 5e-4 nm of 350
    np.testing.assert_allclose(table.nm, nm, rtol=2e-6)
    for index, row in enumerate(values):
        spectrum = read_spectrum(path, role=Quantity.REFLECTANCE, column=index + 2)
        # per cent have five decimals, so fractions seven
        np.testing.assert_allclose(spectrum.values, row, atol=1e-7)


@pytest.mark.parametrize("header, unit", [
    ("Wavelength (furlong),Reflectance", "furlong"), ("Raman shift (cm-1),Intensity", "Raman"),
    ("Time (s),Signal", "s"), ("Pixel,Counts", "Pixel"), ("2theta [deg],I", "deg"),
    ("Frequency,R", "Frequency")])
def test_an_axis_in_another_unit_is_refused_by_its_name(tmp_path, header, unit):
    path = tmp_path / "a.csv"
    path.write_text(f"{header}\n400,0.2\n500,0.3\n600,0.4\n")
    with pytest.raises(InputError, match=unit):
        read_table(path)


def test_all_units_that_are_not_understood_are_named_at_once(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("X Units: furlong\nY Units: mood\n400 0.2\n500 0.3\n600 0.4\n")
    with pytest.raises(InputError, match=r"(?=.*furlong)(?=.*mood)"):
        read_table(path)


@pytest.mark.parametrize("unit, factor", [
    ("uW/cm2/nm", 0.01), ("µWatt/cm²/nm", 0.01), ("mW/m^2/nm", 1e-3), ("W m-2 nm-1", 1),
    ("W/m2/um", 1e-3), ("W cm-2 sr-1 nm-1", 1e4)])
def test_a_unit_of_light_in_a_header_is_brought_to_si(tmp_path, unit, factor):
    path = tmp_path / "a.csv"
    path.write_text(f"Wavelength [nm],light [{unit}]\n400,2\n500,3\n", encoding="utf-8")
    # one product of doubles
    np.testing.assert_allclose(read_spectrum(path, role=Quantity.RELATIVE).values,
                               np.array([2, 3]) * factor, rtol=1e-14)
    with pytest.raises(InputError, match="of light"):
        read_spectrum(path, role=Quantity.REFLECTANCE)


def test_one_dark_column_of_a_table_in_per_cent_is_not_a_fraction(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("nm,white,black\n400,88,0.9\n500,90,0.9\n600,91,0.9\n")
    with pytest.raises(InputError, match="looks like percent"):
        read_spectrum(path, role=Quantity.REFLECTANCE, column="black")
    path.write_text("# unit: percent\n" + path.read_text())
    # round-off of a product
    np.testing.assert_allclose(read_spectrum(path, role=Quantity.REFLECTANCE,
                                             column="black").values, 0.009, rtol=1e-14)


def test_cells_may_carry_their_sign_of_per_cent(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("nm;a\n400;20,5 %\n500;30 %\n")
    np.testing.assert_allclose(read_spectrum(path, role=Quantity.REFLECTANCE).values,
                               [0.205, 0.3], rtol=1e-14)
    np.testing.assert_allclose(read_curves(path)[2][0], [0.205, 0.3], rtol=1e-14)


def test_counts_are_no_reflectance_and_the_column_that_is_none_is_meant(tmp_path):
    path = tmp_path / "a.ttt"
    path.write_bytes(b"Data measured with spectrometer name: 08040\x00\x00\x00\r\n"
                     b"Wave   ;Dark     ;Ref      ;Reflectance\r\n[nm]   ;[counts] ;[counts] ;[%]\r"
                     b"\n400,00;3,4050;6429,1;20,5\r\n401,00;3,4;6430,2;21,5\r\n\r\n")
    assert read_table(path).main == "Reflectance"
    np.testing.assert_allclose(read_spectrum(path, role=Quantity.REFLECTANCE).values,
                               [0.205, 0.215], rtol=1e-14)
    with pytest.raises(InputError, match="'counts'"):
        read_spectrum(path, role=Quantity.RELATIVE, column="Ref")


def test_a_damaged_line_within_a_table_is_named(tmp_path):
    path = tmp_path / "a.csv"
    rows = [f"{nm},0.5" for nm in range(400, 701, 10)]
    rows[11] = "5l0,0.5"
    path.write_text("nm,v\n" + "\n".join(rows))
    with pytest.raises(InputError, match=r"'5l0' stands where a wavelength is needed .line 13"):
        read_table(path)


def test_decimal_commas_between_commas_are_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("".join(f"{nm},0,0{nm}\n" for nm in range(400, 701, 10)))
    with pytest.raises(InputError, match="decimal comma"):
        read_table(path)


def test_wavelengths_may_stand_in_another_column(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("no;Wavelength (um);R\n1;0,40;0,2\n2;0,41;0,3\n3;0,42;0,4\n")
    table = read_table(path)
    np.testing.assert_allclose(table.nm, [400, 410, 420])
    np.testing.assert_array_equal(table.values[table.names.index("R")], [0.2, 0.3, 0.4])


def test_detectors_that_overlap_are_joined_and_said(tmp_path):
    nm = [*range(400, 560, 10), *range(530, 710, 10)]
    path = tmp_path / "a.csv"
    path.write_text("nm,v\n" + "".join(f"{x},{0.2 if i < 16 else 0.25}\n"
                                       for i, x in enumerate(nm)))
    table = read_table(path)
    np.testing.assert_array_equal(table.nm, np.arange(400, 701, 10))
    np.testing.assert_array_equal(table.values[0], np.where(table.nm <= 540, 0.2, 0.25))
    assert any("overlap between 530 and 550" in note and "0.05" in note for note in table.notes)


def field(*names):
    path = Path(os.environ.get("SPECTRABOX_DATA", "no-data")).joinpath("field5", *names)
    if not path.exists():
        pytest.skip("SPECTRABOX_DATA names no folder that holds field5")
    return path


def green(nm):
    """The paint of which the files of field5 are made: 0.2 and a bell of 0.3 at 550 nm."""
    return 0.2 + 0.3 * np.exp(-((np.asarray(nm) - 550) / 60)**2)


@pytest.mark.parametrize("name", [
    "axis-unit-in-header/angstrom.csv", "axis-unit-in-header/frequency_thz.csv",
    "axis-unit-in-header/wavenumber.csv", "decimal-comma-blanks/blanks_decimal_comma.txt",
    "decimal-comma-blanks/blanks_decimal_comma_intnm.txt",
    "micrometres-and-percent-stated/ascending.spectrum.txt",
    "micrometres-and-percent-stated/descending.spectrum.txt"])
def test_files_of_the_field_have_their_right_values(name):
    spectrum = read_spectrum(field(*name.split("/")), role=Quantity.REFLECTANCE)
    visible = spectrum.grid.nm < 701
    assert visible.sum() == 31
    # axes of four digits are 0.05 nm off, where the paint changes by 0.004 a nm
    np.testing.assert_allclose(spectrum.values[visible], green(spectrum.grid.nm[visible]),
                               atol=3e-4)


def test_a_spectrasuite_file_ends_at_its_marker_and_states_no_unit():
    path = field("table-under-a-preamble", "end_marker.txt")
    np.testing.assert_allclose(read_table(path).values[0], 100 * green(np.arange(400, 701, 10)),
                               atol=1e-4)      # five decimals are written
    with pytest.raises(InputError, match="looks like percent"):
        read_spectrum(path, role=Quantity.REFLECTANCE)


def test_a_tail_of_wider_steps_belongs_to_the_table(tmp_path):
    nm = np.r_[np.arange(400, 700, 1), 740, 780, 830, 900.0]
    path = tmp_path / "a.csv"
    path.write_text("nm,v\n" + "".join(f"{x:g},0.5\n" for x in nm))
    np.testing.assert_array_equal(read_table(path).nm, nm)


def envi(tmp_path, extra, nm, values, kind):
    """An ENVI library of one spectrum with more lines in its header."""
    numbers = {"f4": 4, "i2": 2}[kind]
    (tmp_path / "a.hdr").write_text(
        f"ENVI\nsamples = {len(nm)}\nlines = 1\nbands = 1\nheader offset = 0\n"
        f"data type = {numbers}\n"
        "interleave = bsq\nbyte order = 0\nwavelength units = Nanometers\n"
        f"wavelength = {{{', '.join(map(str, nm))}}}\n{extra}")
    (tmp_path / "a.sli").write_bytes(np.asarray(values).astype(f"<{kind}").tobytes())
    return tmp_path / "a.sli"


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture,
                                                   HealthCheck.too_slow],
          deadline=None, derandomize=True)
@given(bad=st.lists(st.booleans(), min_size=12, max_size=12).filter(lambda bad: bad.count(0) > 1),
       gain=st.sampled_from([1e-4, 2e-4]), offset=st.sampled_from([0.0, 0.05]))
def test_gains_offsets_and_bad_bands_of_a_library_are_applied(tmp_path, bad, gain, offset):
    nm, counts = list(range(400, 520, 10)), 1000 + 100 * np.arange(12)
    lists = {"bbl": [int(not each) for each in bad], "data gain values": [gain] * 12,
             "data offset values": [offset] * 12}
    path = envi(tmp_path, "".join(f"{key} = {{{', '.join(map(str, row))}}}\n"
                                  for key, row in lists.items()), nm, counts, "i2")
    table = read_table(path)
    expected = np.where(bad, np.nan, counts * gain + offset)
    # a product and a sum of doubles
    np.testing.assert_allclose(table.values[0], expected, rtol=1e-14)
    assert any("gains" in note for note in table.notes)
    assert any("bbl" in note for note in table.notes) == any(bad)


def test_a_list_of_another_length_is_refused(tmp_path):
    path = envi(tmp_path, "bbl = {1, 0}\n", [400, 500, 600], [0.1, 0.2, 0.3], "f4")
    with pytest.raises(InputError, match="2 numbers as 'bbl' for 3 bands"):
        read_table(path)


@pytest.mark.parametrize("name, missing, note", [
    ("bbl", [500, 510, 520], "bbl"), ("gain", [], "gains"), ("overlap", [], "overlap"),
    ("usgs_deleted", [450, 460], "deleted")])
def test_envi_libraries_of_the_field_are_applied_and_said(name, missing, note):
    table = read_table(field("envi-overlap-and-flags", f"{name}.sli"))
    assert any(note in each for each in table.notes)
    gone = ~np.isfinite(table.values[0])
    np.testing.assert_array_equal(table.nm[gone], missing)
    # integers of 1e-4, else single precision
    np.testing.assert_allclose(table.values[0][~gone], green(table.nm[~gone]), atol=6e-5)


# ---- tables with several axes, or other marks ----------------------------------------------------

NM_OF = np.arange(380.0, 1021.0, 20.0)
OF = 0.08 + 0.7 / (1 + np.exp(-(NM_OF - 580) / 17))


def table_file(folder, header, rows):
    path = folder / "table.csv"
    path.write_text(header + "\n" + "".join(f"{row}\n" for row in rows), encoding="utf-8")
    return path


def test_wavelengths_beside_every_spectrum_are_no_spectrum(tmp_path):
    header = "white,,brick,,\nWavelength (nm),%R,Wavelength (nm),%R,"
    path = table_file(tmp_path, header, [f"{nm:.2f},95.000,{nm:.2f},{100 * one:.4f},"
                                         for nm, one in zip(NM_OF[::-1], OF[::-1], strict=True)])
    table = read_table(path)
    assert table.names == ("%R", "%R (2)")
    np.testing.assert_allclose(table.values[1], 100 * OF, atol=1e-4)     # as written
    other = table_file(tmp_path, header, [f"{nm:.2f},95.000,{nm + 5:.2f},{100 * one:.4f},"
                                          for nm, one in zip(NM_OF, OF, strict=True)])
    with pytest.raises(InputError, match="wavelengths of its own"):
        read_table(other)


@pytest.mark.parametrize("decimals, read", [(1, True), (0, False)])
def test_no_row_is_lost_behind_a_mark_of_thousands(tmp_path, decimals, read):
    path = table_file(tmp_path, "wavelength,reflectance", [
        f'"{nm:,.{decimals}f}",{one:.5f}' for nm, one in zip(NM_OF, OF, strict=True)])
    if read:
        table = read_table(path)
        np.testing.assert_allclose(table.nm, NM_OF)
        np.testing.assert_allclose(table.values[0], OF, atol=1e-5)      # as written
    else:
        with pytest.raises(InputError, match="1,000"):
            read_table(path)


def test_an_axis_is_found_beside_pixels_and_wavenumbers(tmp_path):
    path = table_file(tmp_path, "Pixel;Wavelength;Wavenumber;Raman Shift;%R", [
        f"{pixel};{nm:.2f};{1e7 / nm:.2f};;{100 * one:.4f}".replace(".", ",")
        for pixel, (nm, one) in enumerate(zip(NM_OF, OF, strict=True))])
    table = read_table(path)
    np.testing.assert_allclose(table.nm, NM_OF)
    np.testing.assert_allclose(table.values[table.names.index("%R")], 100 * OF, atol=1e-4)


@pytest.mark.parametrize("unit, factor", [("0-100", 0.01), ("‰", None)])
def test_other_scales_of_reflectance_are_read_or_refused_by_name(tmp_path, unit, factor):
    path = table_file(tmp_path, f"wavelength (nm),reflectance ({unit})", [
        f"{nm:.0f},{one:.5f}" for nm, one in zip(NM_OF, OF, strict=True)])
    if factor is None:
        with pytest.raises(InputError, match=unit):
            read_spectrum(path, role=Quantity.REFLECTANCE)
    else:
        found = read_spectrum(path, role=Quantity.REFLECTANCE)
        np.testing.assert_allclose(found.values, factor * OF, atol=1e-6)    # five digits
