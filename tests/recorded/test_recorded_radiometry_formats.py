"""Recorded: spectral files of every format as they are read and written, and what is refused."""
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from recorded_refusals import said

from spectrabox.fixtures.mutations import mutated
from spectrabox.fixtures.spectral_files import (
    NM,
    asd_bytes,
    rawtoaces_text,
    sed_text,
    spectral_exr_bytes,
    svc_text,
    ti3_text,
    write_examples,
)
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra.formats.cgats import sp_text
from spectrabox.radiometry.spectra.formats.csvw import metadata_text, plain_text
from spectrabox.radiometry.spectra.formats.envi import envi_files
from spectrabox.radiometry.spectra.formats.envi_cube import envi_rows
from spectrabox.radiometry.spectra.formats.tm27 import spdx_text
from spectrabox.radiometry.spectra.spectrum_files import read_table, table_text

UNEVEN = np.array([398.5, 411.25, 433.0, 470.0, 555.5, 601.0, 702.0])
EVEN = np.linspace(380.0, 430.0, 6)
RNG = np.random.default_rng(21)
COUNTS = np.linspace(900, 2400, NM.size) * RNG.uniform(0.9, 1.1, NM.size)
PANEL = np.linspace(3000, 2000, NM.size) * RNG.uniform(0.9, 1.1, NM.size)


def _texts(*texts):
    return b"".join(struct.pack("<H", len(text)) + text for text in texts)


def _calibrations(kinds=(1, 2, 3), fibre_gains=(90, 70)):
    """Base, lamp and fibre, each with its own time and gains."""
    entries = b"".join(struct.pack("<b20siHH", kind, b"lamp", 60 + 8 * kind,
                                   *(np.array(fibre_gains) + (0 if kind == 3 else kind)))
                       for kind in kinds)
    values = {1: np.linspace(0.9, 1.0, NM.size), 2: np.linspace(0.1, 2.0, NM.size),
              3: np.linspace(700, 1500, NM.size)}
    return bytes([len(kinds)]) + entries + b"".join(values[kind].tobytes() for kind in kinds)


def _asd(kind, fore_optic=8, version="as7", calibrations=None, filled=False, **options):
    content = asd_bytes(version, kind, spectrum=COUNTS, reference=PANEL, fore_optic=fore_optic,
                        **options)
    if calibrations is None:
        return content
    content = content[:-1 if version == "as7" else -11]
    if filled:      # classifier with two constituents, three dependent variables
        content = content[:-54] + bytes(2) + _texts(*[b"abc"[:n % 4] for n in range(20)]) \
            + struct.pack("<H", 2) + bytes(10) + 2 * (_texts(b"x", b"yz") + bytes(92)) \
            + bytes(2) + struct.pack("<H", 3) + bytes(10) + _texts(b"a", b"", b"bcd") + bytes(22)
    return content + calibrations + (bytes(10) if version == "as8" else b"")


def _changed(content, at, packed):
    return content[:at] + packed + content[at + len(packed):]


ASD = {
    "reflectance": _asd(1), "raw": _asd(0), "transmittance": _asd(6), "index": _asd(5),
    "old": asd_bytes("ASD", 1, spectrum=COUNTS), "old radiance": asd_bytes("ASD", 2,
                                                                           spectrum=COUNTS),
    "int16": asd_bytes("as6", 0, "<i2", spectrum=COUNTS, reference=PANEL),
    "float32": asd_bytes("as5", 1, "<f4", spectrum=COUNTS, reference=PANEL),
    "alone": _asd(1, with_reference=False), "raw alone": _asd(0, with_reference=False),
    "dark panel": asd_bytes(spectrum=COUNTS, reference=np.where(NM < 500, 0, PANEL)),
    "no panel": asd_bytes(spectrum=COUNTS, reference=0 * PANEL),
    "another panel": _changed(_asd(1), 484 + 8 * NM.size, b"\0\0"),
    "radiance": _asd(2, calibrations=_calibrations()),
    "filled": _asd(2, calibrations=_calibrations(), filled=True),
    "version 8": _asd(2, version="as8", calibrations=_calibrations()),
    "irradiance": _asd(4, 180, calibrations=_calibrations((2, 3))),
    "below a cosine": _asd(4, 179, calibrations=_calibrations()),
    "no base": _asd(2, calibrations=_calibrations((2, 3))),
    "no gains": _asd(2, calibrations=_calibrations(fibre_gains=(0, 70))),
    "not full range": _changed(_asd(2, calibrations=_calibrations()), 431, b"\x01"),
    "no time": _changed(_asd(2, calibrations=_calibrations()), 390, bytes(4)),
    "cut calibration": _asd(2, calibrations=_calibrations()[:-5]),
    "saturated": _changed(_asd(1), 422, b"\x03"),
    "cut": _asd(1)[:480], "cut spectrum": _asd(1)[:600],
    "cut panel": _asd(1)[:484 + 8 * NM.size + 19], "type": _changed(_asd(1), 186, b"\x09"),
    "format": _changed(_asd(1), 199, b"\x03"),
    "not a number": _changed(_asd(1), 500, struct.pack("<d", np.nan)),
    **{f"first {first:g}": _changed(_asd(1), 191, struct.pack("<f", first))
       for first in (99.0, 100.0, 3000.0, 3001.0)},
    **{f"step {step:g}": _changed(_asd(1), 195, struct.pack("<f", step))
       for step in (0.0, 0.5, 100.0, 101.0)},
    **{f"channels {count}": _changed(_asd(1, with_reference=False), 204, struct.pack("<H", count))[
        :484 + 8 * count] for count in (1, 2)}}


def test_asd_files(recorded, tmp_path):
    path = tmp_path / "a.asd"
    found = {}
    for name, content in ASD.items():
        path.write_bytes(content)
        found[name] = said(lambda: read_table(path))
    recorded(found)
    # by hand: lamp x counts / fibre x times or gains, and pi for the panel's radiance
    radiance = found["radiance"].values[0]
    factor = np.where(NM > 650, 100 / 70, np.where(NM > 500, 200 / 90, 84 / 136))
    np.testing.assert_allclose(
        radiance, np.linspace(0.1, 2, NM.size) * COUNTS / np.linspace(700, 1500, NM.size) * factor
        * np.linspace(0.9, 1, NM.size) / np.pi, rtol=1e-12)
    np.testing.assert_array_equal(radiance, found["filled"].values[0])


CGATS = {
    "ti3": ti3_text(), "no data": "BEGIN_DATA_FORMAT\nSAMPLE_ID\nEND_DATA_FORMAT\nBEGIN_DATA\n1\n",
    "two tables": "A 1\nBEGIN_DATA_FORMAT\nSAMPLE_ID X Y\nEND_DATA_FORMAT\nBEGIN_DATA\n1 2 3\n"
                  "END_DATA\nSPECTRAL_NORM 50\nBEGIN_DATA_FORMAT\nSAMPLE_LOC NM410 nm_400\n"
                  "SPECTRAL_NM420 SAMPLE_NAME\nEND_DATA_FORMAT\nREFLECTIVE\nBEGIN_DATA\n"
                  "A1 2 1 x \"a b\"\nB7 20 10 30 c\nC3 21 11 31 c\n# said\nEND_DATA\n",
    "no spectra": "BEGIN_DATA_FORMAT\nA B C D E F G\nEND_DATA_FORMAT\nBEGIN_DATA\n1 2 3 4 5 6 7\n"
                  "END_DATA\n",
    **{name: f"{head}\nNUMBER_OF_SETS {sets}\nBEGIN_DATA_FORMAT\n{labels}\nEND_DATA_FORMAT\n"
       f"BEGIN_DATA\n{rows}\nEND_DATA\n" for name, head, sets, labels, rows in (
           ("ambient", "MEAS_TYPE ambient\nDESCRIPTOR \"one lamp\"", 1, "R400 R_420.5", "3 4"),
           ("emission", "EMISSION", 2, "SPEC_400 SPEC_410", "3 4\n5 6"),
           ("input", "DEVICE_CLASS input", 1, "SPEC_400 SPEC_410", "3 4"),
           ("relative", "QUANTITY relative", 1, "SPEC_400 SPEC_410", "3 4"),
           ("transmissive", "MEAS_TYPE TRANSMISSIVE", 1, "400 410", "3 4"),
           ("norm", "SPECTRAL_NORM 0", 1, "SPEC_400 SPEC_410", "3 4"),
           ("small norm", "SPECTRAL_NORM 1e-3", 1, "SPEC_400 SPEC_410", "3 4"),
           ("sets", "X 1", 3, "SPEC_400 SPEC_410", "3 4"),
           ("cells", "X 1", 1, "SPEC_400 SPEC_410", "3 4 5"),
           ("quote", "X 1", 1, "SPEC_400 SPEC_410", "3 \"4"),
           ("one band", "X 1", 1, "SPEC_400 SPEC_4x", "3 4"),
           *((f"label {off}", "SPECTRAL_BANDS 2\nSPECTRAL_START_NM 400\n"
              f"SPECTRAL_END_NM {410 + off}", 1, "SPEC_400 SPEC_410", "3 4")
             for off in (0.4, 0.99, 1.01)),
           ("bands", "SPECTRAL_BANDS 3\nSPECTRAL_START_NM 400\nSPECTRAL_END_NM 410", 1,
            "SPEC_400 SPEC_410", "3 4"))}}


def test_cgats_files(recorded, tmp_path):
    path = tmp_path / "a.sp"
    found = {}
    for name, text in CGATS.items():
        path.write_text(text, encoding="utf-8")
        found[name] = said(lambda: read_table(path))
    recorded(found)


HEADER = {"samples": "3", "lines": "2", "data type": "5", "wavelength units": "nm",
          "wavelength": "{400, 410.5, 431}", "spectra names": "{a, b}"}
ENVI = {
    "plain": {}, "named alike": {"spectra names": "{a, a}"}, "unnamed": {"spectra names": "{a}"},
    "described": {"description": "{two\n words}", "quantity": "radiance",
                  "data units": "mW m-2 sr-1 nm-1"},
    "scale": {"reflectance scale factor": "100", "data ignore value": "30"},
    "no scale": {"reflectance scale factor": "0"}, "offset": {"header offset": "8", "lines": "1"},
    "short": {"lines": "3"}, "none": {"lines": "0"}, "type": {"data type": "6"},
    "word": {"samples": "three"}, "unit": {"wavelength units": "inch"},
    "no unit": {"wavelength units": ""}, "um": {"wavelength units": "Micrometers",
                                                "wavelength": "{0.4, 0.41, 0.5}"},
    "wavelengths": {"wavelength": "{400, 410}"}, "letters": {"wavelength": "{400, x, 420}"},
    "big": {"byte order": "1"},
    **{f"type {kind}": {"data type": str(kind), "lines": "1", "samples": "3"}
       for kind in (1, 2, 3, 4, 12, 13, 14, 15)}}


def test_envi_libraries(recorded, tmp_path):
    values = np.array([[10.0, 20, 30], [11, 22, 33]])
    (tmp_path / "a.sli").write_bytes(values.tobytes())
    found = {}
    for name, changes in ENVI.items():
        lines = [f"{key} = {value}" for key, value in (HEADER | changes).items()]
        (tmp_path / "a.hdr").write_text("\n".join(["ENVI", *lines]) + "\n", encoding="utf-8")
        found[name] = said(lambda: read_table(tmp_path / "a.hdr"))
    found["binary"] = said(lambda: read_table(tmp_path / "a.sli"))
    (tmp_path / "b.sli").write_bytes(values.tobytes())
    (tmp_path / "c.hdr").write_text("ENVI\nx = 1\n", encoding="utf-8")
    found |= {name: said(lambda name=name: read_table(tmp_path / name))
              for name in ("b.sli", "c.hdr")}
    recorded(found)


DELIMITED = {
    "comma": "nm,a,b\n400,1,2\n410,3,\n420,x,6\n", "semicolon": "nm;a\n400,5;1,25\n410;2,5\n",
    "tab": "nm\ta\n400\t1\n410\t2.5\n", "blanks": "400 1\n410 2\n",
    "no header": "400,1,3\n410,2,4\n",
    "facts": "# quantity: reflectance\n# Unit: percent\n#no colon\nnm,a\n400,50\n410,60\n",
    "quoted": 'nm,"a, b","\'=x"\n400,1,2\n410,3,4\n', "late word": "nm,a\n400,1\nend,\n410,2\n",
    "late blank": "nm,a\n400,1\n,\n410,2\n", "empty": "\n\n", "one row": "nm,a\n400,1\n",
    "down": "nm,a\n410,1\n400,2\n", "same": "nm,a\n400,1\n400,2\n",
    "few nm": "nm,a\n99,1\n200,2\n", "many nm": "nm,a\n400,1\n100001,2\n",
    "alike": "nm,a,a\n400,1,2\n410,3,4\n", "narrow": "nm\n400\n410\n",
    "across": "name;R_400;R_410;R_420;R_430;R_440\nred;1;2;3;4;5\nblue;2;3;;5\n",
    "across four": "name,400,410,420,430\nred,1,2,3,4\nblue,2,3,4,5\n",
    "numbered": "no,400,410,420,430,440\n1,1,2,3,4,5\n2,2,3,4,5,6\n",
    "rows of nm": "nm,400,410,420,430,440\n100,1,2,3,4,5\n101,2,3,4,5,6\n",
    "rows below": "nm,400,410,420,430,440\n99,1,2,3,4,5\n101,2,3,4,5,6\n",
    "falling": "name,400,410,405,430,440\nred,1,2,3,4,5\nblue,2,3,4,5,6\n",
    "gaps": "nm,a\n" + "".join(f"{nm},{nm / 100}\n" for nm in (
        400, 401, 402, 405, 406, 410, 411, 420, 421, 440, 441, 470, 471, 472, 473)),
    "gap of three": "nm,a\n400,1\n401,1\n402,1\n405,1\n", "more": "nm,a\n400,1\n401,1\n402,1\n"
                    "405.1,1\n", "infinite": "nm,a\n400,inf\n410,1e999\n420,3\n",
    "many empty": "nm," + ",".join("abcdefghijk") + "\n400" + 11 * "," + "\n410" + 11 * ",1" + "\n"}


def test_delimited_files(recorded, tmp_path):
    path = tmp_path / "a.csv"
    found = {}
    for name, text in DELIMITED.items():
        path.write_text(text, encoding="utf-8")
        found[name] = said(lambda: read_table(path))
    path.write_text("a,nm\n1,400\n2,410\n", encoding="utf-8")
    found["second"] = said(lambda: read_table(path, 2))
    found["third"] = said(lambda: read_table(path, 3))
    path.write_bytes("nm,\xe9t\xe9\n400,1\n410,2\n".encode("latin-1"))
    found["latin"] = said(lambda: read_table(path))
    path.write_bytes(b"nm,\x81\x02\n400,1\n410,2\n")
    found["control"] = said(lambda: read_table(path))
    for columns in (20_001, 20_002):
        path.write_text("nm" + ",a" * (columns - 1) + "\n" + 2 * ("400" + ",1" * (columns - 1)
                                                                  + "\n"), encoding="utf-8")
        found[f"{columns}"] = said(lambda: read_table(path))
    recorded(found)


def test_text_files_of_field_spectrometers(recorded, tmp_path):
    texts = {"svc": (svc_text(), "a.sig"), "sed": (sed_text(), "a.sed"),
             "sed csv": (sed_text().replace("\t", ",").replace("Reflect. %", "Reflect. [1.0]"),
                         "b.sed"),
             "sed lights": ("Instrument: X\nData:\nChan.#,Wvl,Rad. (Target),Irrad. (Ref.),,Own\n"
                            "1,400,2,3,4,5\n2,410,3,4,5,6\n", "c.sed"),
             "one column": ("Data:\n\"Wvl\",Own\n400,2\n410,3\n", "d.sed"),
             "no column": ("Data:\n\"Wvl\",Chan 2\n400,2\n410,3\n", "d.sed"),
             "no wvl": ("Data:\nWavelength,a\nWvl,1\n410,3\n", "d.sed"),
             "ragged": ("Data:\nWvl,a\n400,1\n410,2,3\n", "e.sed"),
             "one row": ("Data:\nWvl,a\n400,1\n", "e.sed"),
             "svc counts": (svc_text().replace("Radiance, Radiance", "Counts, Radiance"), "b.sig"),
             "svc plain": (svc_text().replace("units= Radiance, Radiance\n", "").replace(
                 "instrument", "other"), "b.sig"),
             "svc ragged": (svc_text() + "790 1 2\n", "c.sig"),
             "channels": (_numbered(sed_text()), "f.sed")}
    found = {}
    for name, (text, file) in texts.items():
        (tmp_path / file).write_text(text, encoding="utf-8")
        found[name] = said(lambda file=file: read_table(tmp_path / file))
    recorded(found)
    # some of these instruments number their channels
    np.testing.assert_array_equal(found["channels"].values, found["sed"].values)
    assert found["channels"].names == found["sed"].names


def _numbered(sed):
    """A .sed text with a first column of channel numbers."""
    head, _, table = sed.partition("Data:\n")
    header, *rows = table.splitlines()
    return "\n".join([head + "Data:", f"Chan.#\t{header}",
                      *(f"{number}\t{row}" for number, row in enumerate(rows, 1)), ""])


CXF = """<?xml version="1.0"?><cc:CxF xmlns:cc="http://colorexchangeformat.com/CxF3-core">
<cc:FileInformation><cc:Description> own chart </cc:Description></cc:FileInformation>
<cc:Object Name="one"><cc:ReflectanceSpectrum ColorSpecification="s" StartWL="400">0.1 0.2 0.4
</cc:ReflectanceSpectrum></cc:Object>
<cc:Object Id="two"><cc:ReflectanceSpectrum ColorSpecification="t">0.3 0.5 x
</cc:ReflectanceSpectrum></cc:Object><cc:Object/>
<cc:Object><cc:ReflectanceSpectrum ColorSpecification="s" StartWL="400">0.9 0.8 0.7
</cc:ReflectanceSpectrum></cc:Object>
<cc:ColorSpecification Id="s"><cc:WavelengthRange StartWL="390" Increment="15"/>
</cc:ColorSpecification><cc:ColorSpecification Id="t"><cc:WavelengthRange StartWL="400"
Increment="15"/></cc:ColorSpecification></cc:CxF>"""
TM27 = """<IESTM2714 xmlns="http://www.ies.org/iestm2714"><Header><Description>lamp</Description>
<Manufacturer>M</Manufacturer><ReportDate/></Header><SpectralDistribution>
<SpectralQuantity> Radiance </SpectralQuantity><SpectralData wavelength="400">1.5</SpectralData>
<SpectralData wavelength="411">-</SpectralData><SpectralData wavelength="420">2.5</SpectralData>
</SpectralDistribution>{more}</IESTM2714>"""


def test_documents(recorded, tmp_path):
    aces = json.loads(rawtoaces_text())
    aces["header"] |= {"model": "m 1", "description": "  curves "}
    aces["spectral_data"] |= {"units": "Irradiance", "index": {"main": ["R", "R", "B"]},
                              "data": {"main": {"410": [4, 5, 6], "400": [1, 2.5, 3]}}}
    short = json.loads(json.dumps(aces))
    short["spectral_data"]["data"]["main"]["410"] = [4, 5]
    second = TM27.format(more="<SpectralDistribution><SpectralData wavelength=\"400\">9"
                         "</SpectralData></SpectralDistribution>")
    texts = {"cxf": CXF, "cxf apart": CXF.replace('StartWL="400"', 'StartWL="405"', 1),
             "cxf none": CXF.replace("Reflectance", "Emission"),
             "cxf entities": CXF.replace("<cc:CxF", "<!ENTITY x 'y'><cc:CxF", 1),
             "tm27": TM27.format(more=""), "tm27 other": TM27.format(more="").replace(
                 "Radiance", "other"), "tm27 own": TM27.format(more="").replace("Radiance", "Own"),
             "tm27 twice": TM27.format(more=second), "tm27 two": second,
             "tm27 alike": TM27.format(more=TM27.format(more="").partition("</Header>")[2]
                                       .removesuffix("</IESTM2714>")),
             "tm27 no nm": TM27.format(more="").replace('wavelength="411"', ""),
             "tm27 entities": TM27.format(more="<!DOCTYPE x>"),
             "aces": json.dumps(aces), "aces plain": rawtoaces_text(),
             "aces relative": rawtoaces_text().replace('"reflectance"', '"relative"'),
             "aces unknown": rawtoaces_text().replace('"reflectance"', '"lux"'),
             "aces short": json.dumps(short),
             "aces kind": json.dumps(aces).replace('"index"', '"indices"'),
             "aces words": json.dumps(aces).replace("2.5", '"x"')}
    found = {}
    for name, text in texts.items():
        (tmp_path / "a.txt").write_text(text, encoding="utf-8")
        found[name] = said(lambda: read_table(tmp_path / "a.txt"))
    recorded(found)


def test_spectral_pictures(recorded, tmp_path):
    image = np.random.default_rng(3).uniform(0.1, 0.9, (3, 4, 3)).astype(np.float32)
    nm = np.array([450.0, 500.0, 610.0])
    holed = image.copy()
    holed[1, 2, 0] = np.nan
    cases = {"reflectance": spectral_exr_bytes(image, nm), "holes": spectral_exr_bytes(holed, nm),
             "light": spectral_exr_bytes(image, nm, emissive=True, compression=0),
             "irradiance": spectral_exr_bytes(image, nm, emissive=True, units="W.m^-2"),
             "words": spectral_exr_bytes(image, nm, emissive=True, units="W m-2 sr-1 nm-1"),
             "own unit": spectral_exr_bytes(image, nm, emissive=True, units="lux"),
             "one pixel": spectral_exr_bytes(image[:1, :1], nm),
             "none": spectral_exr_bytes(0 * image + np.float32(np.nan), nm)}
    found = {}
    for name, content in cases.items():
        (tmp_path / "a.exr").write_bytes(content)
        found[name] = said(lambda: read_table(tmp_path / "a.exr"))
    recorded(found)
    np.testing.assert_allclose(found["reflectance"].values[1],
                               image.reshape(-1, 3).std(axis=0, ddof=1) / np.sqrt(12), rtol=1e-6)


@pytest.mark.parametrize("quantity", list(Quantity))
def test_what_is_written(recorded, quantity):
    columns = {"one, \"x\"": np.array([0.1234567891, 0.2, -0.3, 4e-7, 5.5, 6.25, 71.0])[:6],
               "=two {y}": np.arange(6) / 7}
    source = ' a "lamp" {of}\n<ours> & others '
    recorded({"csv": table_text(UNEVEN[:6], columns, quantity=quantity, source=source),
              "plain": plain_text(UNEVEN[:6], columns),
              "beside": metadata_text("a.csv", columns, quantity=quantity, source=source),
              "sp": sp_text(EVEN, columns, quantity=quantity, source=source),
              "spdx": spdx_text(UNEVEN[:6], columns, quantity=quantity, source=source),
              "envi": envi_files(UNEVEN[:6], columns, quantity=quantity, source=source)[0],
              "values": np.frombuffer(envi_files(UNEVEN[:6], columns, quantity=quantity,
                                                 source=source)[1]),
              "uneven": [said(lambda off=off: sp_text(EVEN + off * np.eye(6)[3], columns,
                                                      quantity=quantity, source="")[:5])
                         for off in (4e-6, 6e-6)]})


def test_a_plain_table_is_read_with_what_lies_beside_it(recorded, tmp_path):
    columns = {"a": np.arange(7) / 9, "b": np.arange(7) / 11}
    path, beside = tmp_path / "x.csv", tmp_path / "x.csv-metadata.json"
    path.write_text(plain_text(UNEVEN, columns), encoding="utf-8")
    text = metadata_text("x.csv", columns, quantity=Quantity.IRRADIANCE, source="ours")
    found = {}
    for name, written in (("whole", text), ("no table", "{}"), ("no json", "["),
                          ("numbers", text.replace('"irradiance"', "3"))):
        beside.write_text(written, encoding="utf-8")
        found[name] = read_table(path)
    recorded(found)


def test_damaged_files(recorded, tmp_path):
    examples = write_examples(tmp_path)
    found = {}
    for kind in ("CSV", "ASD", "CGATS", "ENVI", "SVC", "Spectral Evolution"):
        path = examples[kind]
        content = path.read_bytes()
        for seed in range(28):
            path.write_bytes(mutated(content, seed))
            found[f"{kind} {seed}"] = said(lambda path=path: _summary(read_table(path)), tmp_path)
    recorded(found)


def _summary(table):
    return (f"{len(table.names)} {table.nm.size} {np.nansum(table.nm):.6g} "
            f"{np.nansum(table.values):.6g} {sorted(table.facts.items())} {table.notes}")


def test_a_cube_of_rows(recorded, tmp_path):
    pixels = np.random.default_rng(4).uniform(size=(5, 3, 2))
    with envi_rows(tmp_path / "a.hdr", 5, 3, np.array([450.0, 551.5]), "reflectance",
                   "a {wall}\n lit") as write:
        write(0, pixels[:2])
        write(2, pixels[2:])
    recorded({"header": (tmp_path / "a.hdr").read_text(encoding="utf-8"),
              "files": sorted(path.name for path in Path(tmp_path).iterdir())})
    np.testing.assert_allclose(np.fromfile(tmp_path / "a.img", "<f4").reshape(5, 3, 2), pixels,
                               rtol=1e-6)
