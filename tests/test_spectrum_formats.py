"""Every spectral format: what is written comes back, what is read is what the file states, bad
files get one sentence.
"""
import os
import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from spectrabox.fixtures.spectral_files import (
    NM,
    REFLECTANCE,
    asd_bytes,
    rawtoaces_text,
    spectral_exr_bytes,
    ti3_text,
    write_examples,
)
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats.cgats import sp_text
from spectrabox.radiometry.spectra.formats.envi import envi_files
from spectrabox.radiometry.spectra.formats.tm27 import spdx_text
from spectrabox.radiometry.spectra.spectrum_files import (
    read_curves,
    read_spectrum,
    read_table,
    table_text,
)

WRITERS = {".csv": table_text, ".sp": sp_text, ".spdx": spdx_text}
FORMATS = ("CSV", "ASD", "CGATS", "TM-27", "ENVI", "rawtoaces", "spectral EXR", "JCAMP-DX",
           "CxF")
# Relative rounding: nine significant digits, single or double precision.
PRECISION = {"CSV": 5e-9, "ASD": 1e-15, "CGATS": 5e-9, "TM-27": 5e-9, "ENVI": 0,
             "rawtoaces": 0, "spectral EXR": 6e-8, "JCAMP-DX": 0, "CxF": 0}


def write(tmp_path, content, name):
    path = tmp_path / name
    path.write_bytes(content) if isinstance(content,
                                            bytes) else path.write_text(content, encoding="utf-8")
    return path


def write_library(tmp_path, nm, columns, **facts):
    header, binary = envi_files(nm, columns, **facts)
    write(tmp_path, header, "s.hdr")
    return write(tmp_path, binary, "s.sli")


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_read_as_the_reflectance_it_holds(tmp_path, name):
    path = write_examples(tmp_path)[name]
    assert read_table(path).facts["format"] == name
    spectrum = read_spectrum(path, role=Quantity.REFLECTANCE)
    assert spectrum.quantity is Quantity.REFLECTANCE
    # wavelengths are written with nine digits or more
    np.testing.assert_allclose(spectrum.grid.nm, NM, rtol=1e-9)
    np.testing.assert_allclose(spectrum.values, REFLECTANCE, rtol=PRECISION[name])


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("suffix", [".csv", ".dat"])
def test_a_file_is_known_by_its_content_and_not_by_its_name(tmp_path, name, suffix):
    if name in ("ENVI",):
        pytest.skip("an ENVI library is two files that know each other by name")
    original = write_examples(tmp_path)[name]
    renamed = write(tmp_path, original.read_bytes(), f"renamed{suffix}")
    table = read_table(renamed)
    assert table.facts["format"] == name
    assert any("in spite of its name" in note
               for note in table.notes) == (suffix == ".csv" and name != "CSV")


@pytest.mark.parametrize("suffix", [*WRITERS, ".sli"])
@pytest.mark.parametrize("quantity", list(Quantity))
def test_what_is_written_comes_back(tmp_path, suffix, quantity):
    rng = np.random.default_rng(11)
    columns = {"first": rng.lognormal(-4, 2, NM.size).clip(max=1),
               "the second": rng.lognormal(-4, 2, NM.size).clip(max=1)}
    facts = {"quantity": quantity, "source": 'lab "7", bay <3> & {x}'}
    if suffix == ".sli":
        path = write_library(tmp_path, NM, columns, **facts)
    else:
        path = write(tmp_path, WRITERS[suffix](NM, columns, **facts), f"s{suffix}")
    table = read_table(path)
    # nine significant digits; the library is double precision
    rtol = 0 if suffix == ".sli" else 5e-9
    for index, values in enumerate(columns.values()):
        spectrum = read_spectrum(path, role=quantity, column=table.names[index])
        assert spectrum.quantity is quantity
        np.testing.assert_allclose(spectrum.values, values, rtol=rtol)
        np.testing.assert_allclose(spectrum.grid.nm, NM, rtol=rtol)


@pytest.mark.parametrize("suffix", WRITERS)
def test_writing_what_was_read_gives_the_same_file(tmp_path, suffix):
    first = WRITERS[suffix](NM, {"value": REFLECTANCE}, quantity=Quantity.REFLECTANCE, source="lab")
    spectrum = read_spectrum(write(tmp_path, first, f"s{suffix}"), role=Quantity.REFLECTANCE)
    assert WRITERS[suffix](spectrum.grid.nm, {"value": spectrum.values}, quantity=spectrum.quantity,
                           source=spectrum.source) == first


@pytest.mark.parametrize("version", ["ASD", "as2", "as5", "as6", "as7", "as8"])
@pytest.mark.parametrize("sample", ["<f4", "<f8", "<i2"])
def test_every_asd_version_and_sample_format_is_read(tmp_path, version, sample):
    counts = np.linspace(2000, 8000, NM.size)
    spectrum = np.round(REFLECTANCE * counts) if sample == "<i2" else REFLECTANCE * counts
    reference = np.round(counts) if sample == "<i2" else counts
    if version == "ASD":  # the old files hold reflectance itself
        spectrum = REFLECTANCE if sample != "<i2" else np.ones(NM.size)
    path = write(tmp_path, asd_bytes(version, 1, sample, spectrum=spectrum, reference=reference),
                 "s.asd")
    expected = spectrum if version == "ASD" else spectrum / reference
    # Single precision of spectrum and of reference, then a ratio: three roundings of 6e-8.
    np.testing.assert_allclose(read_spectrum(path, role=Quantity.REFLECTANCE).values, expected,
                               rtol=2e-7 if sample == "<f4" else 1e-15)


def test_raw_asd_counts_are_not_called_reflectance(tmp_path):
    path = write(tmp_path, asd_bytes(kind=0), "raw.asd")
    with pytest.raises(InputError, match="states the quantity 'raw'"):
        read_spectrum(path, role=Quantity.REFLECTANCE)
    np.testing.assert_allclose(read_spectrum(path, role=Quantity.REFLECTANCE,
                                             column="reflectance").values, REFLECTANCE)


def test_asd_radiance_is_derived_from_the_calibration_in_the_file(tmp_path):
    counts = np.full(NM.size, 3000.0)
    path = write(tmp_path, asd_bytes("as7", 2, spectrum=counts, calibration=True), "rad.asd")
    spectrum = read_spectrum(path, role=Quantity.RELATIVE)
    assert spectrum.quantity is Quantity.RADIANCE
    # lamp 2 x counts 3000 / fibre 1000, times 68 ms / 136 ms (or gains 200 / 100, 100 / 100), times
    # base 0.5 / pi.
    factor = np.where(NM <= 500, 0.5, np.where(NM <= 650, 2.0, 1.0))
    np.testing.assert_allclose(spectrum.values, 6 * factor * 0.5 / np.pi, rtol=1e-14)


def test_asd_irradiance_has_no_panel_factor(tmp_path):
    path = write(tmp_path, asd_bytes("as8", 4, spectrum=np.full(NM.size, 1000.0), calibration=True,
                                     fore_optic=180), "e.asd")
    spectrum = read_spectrum(path, role=Quantity.IRRADIANCE)
    assert spectrum.quantity is Quantity.IRRADIANCE
    assert spectrum.values[0] == pytest.approx(1.0, rel=1e-14)  # 2 x 1000 / 1000 x 68 / 136


def test_asd_radiance_without_its_calibration_is_only_counts(tmp_path):
    table = read_table(write(tmp_path, asd_bytes("as7", 2), "rad.asd"))
    assert table.main == "target" and any("cannot be derived" in note for note in table.notes)
    with pytest.raises(InputError, match="states the quantity 'raw'"):
        read_spectrum(tmp_path / "rad.asd", role=Quantity.RADIANCE)


@pytest.mark.parametrize("content, message", [
                             (asd_bytes()[:300], "is cut|not a text file"),
                             (asd_bytes()[:700], "is cut: .* bytes are stated"),
                             (asd_bytes().replace(struct.pack("<ff", 380.0, 10.0),
                                                  struct.pack("<ff", 380.0, -1.0)),
                              "cannot be; the header is"),
                             (asd_bytes(spectrum=np.full(NM.size, np.nan)),
                              "samples are not numbers")])
def test_a_damaged_asd_file_gets_one_sentence(tmp_path, content, message):
    with pytest.raises(InputError, match=message):
        read_table(write(tmp_path, content, "s.asd"))


def test_rounded_cgats_labels_do_not_become_wavelengths(tmp_path):
    path = write(tmp_path, ti3_text(), "s.ti3")
    table = read_table(path)
    # evenly spaced up to round-off
    np.testing.assert_allclose(np.diff(table.nm), 350 / 105, rtol=1e-12)
    spectrum = read_spectrum(path, role=Quantity.REFLECTANCE, column="A2")
    # divided by the norm
    np.testing.assert_allclose(spectrum.values, (40 + 0.01 * np.arange(106)) / 100, rtol=1e-12)


def test_argylls_emission_is_milliwatts(tmp_path):
    text = sp_text(NM, {"value": REFLECTANCE}, quantity=Quantity.RADIANCE, source="x")
    first = text.split("BEGIN_DATA\n")[1].split()[1]
    assert float(first) == pytest.approx(1000 * REFLECTANCE[0], rel=5e-9)  # nine digits
    spectrum = read_spectrum(write(tmp_path, text, "s.sp"), role=Quantity.RADIANCE)
    np.testing.assert_allclose(spectrum.values, REFLECTANCE, rtol=5e-9)


def test_a_foreign_tm27_document_is_read_with_its_holes(tmp_path):
    values = {nm: "Unknown" if nm == 420 else nm / 100 for nm in range(400, 500, 10)}
    rows = "".join(f'<s:SpectralData wavelength="{nm}">{value}</s:SpectralData>'
                   for nm, value in values.items())
    text = ('<?xml version="1.0"?><s:IESTM2714 xmlns:s="http://elsewhere/x" version="1.0">'
            "<s:Header><s:Description>lamp</s:Description></s:Header><s:SpectralDistribution>"
            f"<s:SpectralQuantity>irradiance</s:SpectralQuantity>{rows}"
            "</s:SpectralDistribution></s:IESTM2714>")
    path = write(tmp_path, text, "lamp.spdx")
    assert any("has no number at 1 of 10 wavelengths (420-420 nm)" in note
               for note in read_table(path).notes)
    spectrum = read_spectrum(path, role=Quantity.IRRADIANCE)
    assert spectrum.grid.nm.size == 9 and 420 not in spectrum.grid.nm and spectrum.source == "lamp"


def test_an_xml_bomb_is_not_opened(tmp_path):
    bomb = '<!DOCTYPE x [<!ENTITY a "aaaa">]><IESTM2714>&a;<SpectralDistribution/></IESTM2714>'
    with pytest.raises(InputError, match="declares XML entities"):
        read_table(write(tmp_path, bomb, "s.spdx"))


@pytest.mark.parametrize("kind, order", [(1, 0), (2, 0), (2, 1), (4, 1), (5, 0), (12, 1)])
def test_every_number_type_and_byte_order_of_a_library_is_read(tmp_path, kind, order):
    types = {1: "u1", 2: "i2", 4: "f4", 5: "f8", 12: "u2"}
    values = np.arange(1, 7).reshape(2, 3) * 10
    write(tmp_path, f"ENVI\nsamples = 3\nlines = 2\nbands = 1\ndata type = {kind}\nbyte order = "
          f"{order}\nheader offset = 4\nwavelength units = Micrometers\nreflectance scale factor = "
          "100\nspectra names = {a, b}\nwavelength = {0.4,\n 0.5, 0.6}\n", "s.hdr")
    path = write(tmp_path, b"skip" + values.astype((">" if order else "<") + types[kind]).tobytes(),
                 "s.sli")
    table = read_table(path)
    np.testing.assert_array_equal(table.nm, [400, 500, 600])
    np.testing.assert_array_equal(read_spectrum(path, role=Quantity.REFLECTANCE, column="b").values,
                                  values[1] / 100)
    assert read_table(tmp_path / "s.hdr").names == table.names


def test_a_library_without_its_other_half_says_which_is_missing(tmp_path):
    path = write_library(tmp_path, NM, {"a": REFLECTANCE}, quantity=Quantity.REFLECTANCE,
                         source="x")
    path.with_suffix(".hdr").unlink()
    with pytest.raises(InputError, match=r"put its header s\.hdr beside it"):
        read_table(path)


def test_a_spectral_picture_is_its_mean_with_a_standard_error(tmp_path):
    rng = np.random.default_rng(4)
    image = rng.uniform(0.2, 0.4, (40, 30, NM.size)).astype(np.float32)
    for compression in (0, 2, 3):
        path = write(tmp_path, spectral_exr_bytes(image, NM, compression=compression), "s.exr")
        spectrum = read_spectrum(path, role=Quantity.REFLECTANCE)
        # Mean of 1200 exactly representable floats in double precision: round-off.
        np.testing.assert_allclose(spectrum.values, image.astype(float).mean(axis=(0, 1)),
                                   rtol=1e-12)
        expected = image.astype(float).std(axis=(0, 1), ddof=1) / np.sqrt(1200)
        np.testing.assert_allclose(spectrum.standard_error, expected, rtol=1e-9)


def test_a_spectral_picture_of_light_states_its_unit(tmp_path):
    content = spectral_exr_bytes(np.ones((1, 1, NM.size)), NM, emissive=True)
    assert read_spectrum(write(tmp_path, content, "s.exr"),
                         role=Quantity.RELATIVE).quantity is Quantity.RADIANCE


def test_an_ordinary_picture_is_not_a_spectrum(tmp_path):
    content = spectral_exr_bytes(np.ones((1, 1, NM.size)), NM).replace(b"T.", b"U.")
    with pytest.raises(InputError, match="is an ordinary EXR picture"):
        read_table(write(tmp_path, content, "s.exr"))


def test_camera_curves_are_read_from_rawtoaces(tmp_path):
    text = rawtoaces_text().replace('"reflectance"', '"relative"')
    nm, names, values = read_curves(write(tmp_path, text, "camera.json"))
    assert names == ("value",)
    np.testing.assert_array_equal(values[0], REFLECTANCE)
    np.testing.assert_array_equal(nm, NM)


@pytest.mark.parametrize("content, name, message", [
                             (b"PK\x03\x04rest", "s.csv",
                              "spreadsheet or zip archive: export the sheet as CSV"),
                             (b"%PDF-1.4", "s.csv", "a PDF"),
                             (b"\x89PNG\r\n\x1a\n", "s.csv", "a picture"),
                             (ti3_text().replace("END_DATA\n", ""), "s.ti3",
                              "ends before END_DATA|do not fill"),
                             (ti3_text().replace("NUMBER_OF_SETS 2", "NUMBER_OF_SETS 3"), "s.ti3",
                              "states 3 samples and holds 2"),
                             (ti3_text().replace('NORM "100', 'NORM "-1'), "s.ti3",
                              "SPECTRAL_NORM is"),
                             (rawtoaces_text()[:-30], "s.json", "damaged JSON"),
                             (rawtoaces_text().replace('"index"', '"x"'), "s.json",
                              "has no 'index'"),
                             ("<IESTM2714><SpectralDistribution>", "s.spdx", "damaged XML")])
def test_a_file_that_cannot_be_read_gets_one_sentence(tmp_path, content, name, message):
    with pytest.raises(InputError, match=message):
        read_table(write(tmp_path, content, name))


def test_gaps_in_the_wavelengths_are_said(tmp_path):
    text = "nm,v\n" + "".join(f"{nm},0.5\n" for nm in [*range(400, 500, 5), *range(560, 700, 5)])
    assert read_table(write(tmp_path, text,
                            "s.csv")).notes == ("no wavelengths between 495 and 560 nm",)


@pytest.mark.skipif("SPECTRABOX_DATA" not in os.environ,
                    reason="SPECTRABOX_DATA names no folder of real ASD files")
def test_real_asd_files_read_as_pyasdreader_reads_them():
    module = pytest.importorskip("pyASDReader",
                                 reason="pyASDReader is not installed; it is a cross-check only")
    files = sorted((Path(os.environ["SPECTRABOX_DATA"]) / "asd").glob("*.asd"))
    assert files and sys.byteorder
    for path in files:
        other, table = module.ASDFile(str(path)), read_table(path)
        columns = dict(zip(table.names, table.values, strict=True))
        np.testing.assert_array_equal(columns["target"], other.spectrumData.spectra)
        np.testing.assert_array_equal(columns["reference"], other.referenceData.spectra)
        if "radiance" in columns:
            # another order of products
            np.testing.assert_allclose(columns["radiance"], other.radiance, rtol=1e-12)
