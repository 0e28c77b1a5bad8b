"""Replies that contradict themselves or each other, the same in both readings; spotread as it is
called; and what else of readings is refused: recorded.
"""
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from capture_pictures import changed, outcome
from simulated_instruments import BAUD, SIMULATED, one, session

from spectrabox.capture.meter import calibration, measurement_plot, serial_line, spotread
from spectrabox.capture.meter.instruments.interface import MeterSettings
from spectrabox.capture.meter.serial_line import LineSettings
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records import Quantity, Spectrum

RECORDED = Path(__file__).resolve().parents[2] / "fixtures" / "spotread"


def _swapped(old, new, count=1):
    return lambda said: said.replace(old, new, count)


def _dark(separator):
    """Rows of a wavelength and a value, every value below 0."""
    def change(said):
        lines = said.split(b"\r")
        return b"\r".join(line.replace(separator, separator + b"-") if line.strip()[:3].isdigit()
                          and separator in line and len(line) < 20 else line for line in lines)
    return change


DOUBTS = {
    "cs2000": [("IDDR\n", _swapped(b"CS-2000", b"CS-1000")), ("IDDR\n", _swapped(b",2,7", b",1,7")),
               ("IDDR\n", lambda said: b"OK00,CS-2000\n"), ("MSWE,0\n", lambda said: b"ER00\n"),
               ("RMTS,2\n", lambda said: b"ER02\n"),
               ("MEDR,0,0,1\n", _swapped(b"000087654", b"-")),
               ("MEDR,0,0,1\n", lambda said: b"OK00,3,1\n"),
               ("MEDR,1,0,2\n", lambda said: said[:-10] + b"-9.9999e9\n"),
               ("MEDR,1,0,4\n", lambda said: said.rpartition(b",")[0] + b"\n"),
               ("MEDR,2,0,00\n", lambda said: said.rpartition(b",")[0] + b"\n"),
               ("MEDR,2,0,00\n", lambda said: b"OK00,-9.9999e9," + said.split(b",", 2)[2])],
    "cr250": [("RC Model\r", _swapped(b"CR-250", b"XR-250")),
              ("RC InstrumentType\r", _swapped(b":2\r", b":1\r")),
              ("RM Radiometric\r", _swapped(b":0,", b":2,")),
              ("RM Radiometric\r", lambda said: b"OK:0:RM Radiometric:0,1.0\r\n"),
              ("RM Exposure\r", _swapped(b"87.125 msec", b"fast")),
              ("RM Spectrum\r", _swapped(b"380.0,780.0,2.0,201", b"0.0,0.0,0.0,0")),
              ("RM XYZ\r", _swapped(b"RM XYZ", b"RM xy")),
              ("RM XYZ\r", _swapped(b"OK:0", b"OK:-1")),
              ("M\r", _swapped(b"OK:0", b"ER:0")), ("M\r", _swapped(b"OK:0", b"ER:102"))],
    "pr655": [("D111\r", _swapped(b"PR-655", b"XY-655")), ("D5\r", _swapped(b"\n384,", b"\n385,")),
              ("D5\r", _swapped(b"00000,0,", b"00000,1,")), ("D5\r", _swapped(b"00000,0,",
                                                                            b"00000,2,")),
              ("D2\r", _swapped(b"00000,0,", b"00000,1,")), ("D13\r", _swapped(b"0217 msec", b"")),
              ("D120\r", _swapped(b"780,4", b"784,4")), ("D5\r", _dark(b",")),
              ("PHOTO", lambda said: b"REMOTE  MODE\r\n")],
    "pr650": [("d120\n", lambda said: b"0081,008.0,0380.,0700.,004.\r\n"),
              ("d5\n", _swapped(b"00,0", b"18,0")), ("d5\n", _swapped(b"00,0", b"10,0")),
              ("d5\n", _swapped(b"00,0", b"00,2")), ("d5\n", _swapped(b"0384.", b"0385.")),
              ("d2\n", _swapped(b"00,0", b"00,1")), ("d2\n", _swapped(b"00,0", b"18,0")),
              ("d110\n", lambda said: b"\r\n" * 25), ("d110\n", lambda said: b"#?\r\n"),
              ("m0\n", lambda said: b"00\r\n"), ("d5\n", _dark(b","))],
    "specbos1211": [("*CONTR:MHEAD?\r", _swapped(b"0", b"1")),
                    ("*CONTR:MHEAD?\r", lambda said: b"no head\r"),
                    ("*FETCH:SPRAD\r", _swapped(b"Radiance", b"Irradiance")),
                    ("*FETCH:SPRAD\r", _swapped(b"\r384\t", b"\r385\t")),
                    ("*FETCH:SPRAD\r", lambda said: b"a\r\r" * 7),
                    ("*FETCH:XYZ\r", _swapped(b"Y:", b"W:")),
                    ("*FETCH:XYZ\r", lambda said: b"\x15"),
                    ("*FETCH:XYZ\r", lambda said: b" X: 1\r" * 50),
                    ("*para:spnum?\r", lambda said: b"*para:spnum?\r"), ("*FETCH:SPRAD\r",
                                                                         _dark(b"\t"))],
    "specbos2501": [("*para:wran?\r", lambda said: b"380 780 0\r"),
                    ("*para:wran?\r", lambda said: b"780 380 1\r"),
                    ("*para:wran?\r", lambda said: b"99 780 1\r"),
                    ("*para:wran?\r", lambda said: b"380 3001 1\r"),
                    ("*para:wran?\r", lambda said: b"380 780 0.05\r"),
                    ("*CALC:SPRAD\r", lambda said: said[1:]),
                    ("*CALC:SPRAD\r", _swapped(b"\r384\t", b"\r385\t")),
                    ("*calc:PHOTOmetric\r", _swapped(b":\t", b": none")),
                    ("*calc:CHROMXY\r", _swapped(b"Chrom_y", b"Chrom_Y")),
                    ("*calc:CHROMXY\r", _swapped(b":\t0.", b":\t0.1")),
                    ("*CALC:SPRAD\r", _dark(b"\t"))]}


@pytest.mark.parametrize("name", DOUBTS)
def test_replies_that_contradict_themselves_in_both_readings(monkeypatch, recorded, name):
    table = {}
    for number, (command, change) in enumerate(DOUBTS[name]):
        replies = SIMULATED[name]()
        parts = replies[command.encode()][0]
        replies[command.encode()] = [[(parts[0][0], change(b"".join(data for _, data in parts)))]]
        result = session(monkeypatch, name, replies, MeterSettings(), BAUD[name])
        table[f"{number} {command.strip()}"] = result.get("error") or [
            {key: reading[key] for key in ("outcome", "quantity", "integration_ms", "luminance",
                                           "flags", "serial_number")}
            for reading in result["readings"]]
    recorded(table)


def test_durations_that_a_cs2000_announces(monkeypatch, recorded):
    table = {}
    for announced in (0, 2, 99, 100, 101, 242, 300, 301, 999):
        for end in ("OK00\n", "ER10\n", "ER71\n", "ER83\n", "OK00,005\n", ""):
            replies = SIMULATED["cs2000"]()
            replies[b"MEAS,1\n"] = [[(9.0, b"OK00,%03d\n" % announced),
                                     (announced + 14.0, end.encode())]]
            replies[b"MEAS,0\n"] = one("OK00\n")
            result = session(monkeypatch, "cs2000", replies, MeterSettings(), BAUD["cs2000"])
            table[f"{announced} {end.strip()}"] = [
                *(result.get("error") or [result["readings"][0]["outcome"]]), *result["heard"][-3:]]
    recorded(table)


@pytest.mark.skipif(os.name != "posix", reason="the stand-in is a shell script")
def test_how_spotread_is_called(monkeypatch, recorded, tmp_path):
    folder = tmp_path / "bin"
    shutil.copytree(RECORDED, folder)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    table = {}
    for case, before, quantity, options in (
            ("emission", "", Quantity.RADIANCE, {}), ("ambient", "", Quantity.IRRADIANCE, {}),
            ("calibrated", "", Quantity.RADIANCE, {"calibrated": True, "transcript": "a.t"}),
            ("fails", "echo 'spotread: Error - No instrument at port 7'; exit 1",
             Quantity.RADIANCE, {}),
            ("calibrates", '[ -e {folder}/once ] || {{ touch {folder}/once; echo calibration; '
             'exit 0; }}', Quantity.RADIANCE, {}),
            ("asks", "echo 'place it'; echo calibration needed; exit 0", Quantity.RADIANCE, {}),
            ("nothing", "echo 'place it'; exit 0", Quantity.RADIANCE, {})):
        kind = "emission" if quantity is Quantity.RADIANCE else "ambient"
        (folder / "asked").unlink(missing_ok=True)
        program = folder / "spotread"
        program.write_text(f'#!/bin/sh\necho "$@ $ARGYLL_NOT_INTERACTIVE $LC_ALL" >> '
                           f'{folder}/asked\nwhile [ $# -gt 1 ]; do shift; done\n'
                           f'{before.format(folder=folder)}\ncat {folder}/{kind}.txt\n'
                           f'cp {folder}/{kind}.sp "$1"\n')
        program.chmod(0o755)
        passed, said = [], []

        def read(quantity=quantity, options=options, passed=passed, said=said):
            found = spotread.spotread_reading(quantity, 7, lambda *event: passed.append(event),
                                              said.append, **options)
            spectrum = changed(found.spectrum, source=found.spectrum.source.partition(",")[0])
            return changed(found, taken_at="", spectrum=spectrum)
        result = outcome(read)
        asked = (folder / "asked").read_text().split("\n")
        table[case] = [result, [" ".join(word for word in line.split() if "/" not in word)
                                for line in asked], passed[0][0],
                       sum(len(data) for way, data in passed if way == "<") == len("".join(said))]
    monkeypatch.setenv("PATH", str(tmp_path))
    table["missing"] = outcome(lambda: spotread.spotread_reading(Quantity.RADIANCE, 1, print,
                                                                 print))
    recorded(table)


def test_ports_that_do_not_open(monkeypatch, recorded, tmp_path):
    table = {}
    for error in (FileNotFoundError(2, "none"), PermissionError(13, "no"), ValueError("a speed")):
        def refuse(url, error=error, **options):
            raise error
        monkeypatch.setattr(serial_line.serial, "serial_for_url", refuse)
        monkeypatch.setattr(serial_line, "list_ports", list)
        table[str(error)] = outcome(lambda: serial_line.open_line(
            "/dev/ttyNONE", LineSettings(9600), lambda *_: None))
    file = tmp_path / "factor.csv"
    file.write_text("# quantity: reflectance\nwavelength_nm,value\n"
                    + "".join(f"{nm},0.5\n" for nm in range(400, 710, 10)))
    table["calibration"] = outcome(lambda: calibration.read_calibration(f"7={file}"))
    recorded({key: value.replace(str(tmp_path), "") for key, value in table.items()})


def test_a_picture_of_a_spectrum(monkeypatch, recorded, tmp_path):
    from matplotlib.figure import Figure
    nm = np.arange(400.0, 701.0, 25.0)
    figures = []
    monkeypatch.setattr(Figure, "savefig", lambda self, path, **options: (
        figures.append((self, options)), Path(path).write_bytes(b"x")))
    for error in (None, 0.01 + nm / 1e5):
        measurement_plot.png_plot(Spectrum(grid_from_nm(nm), np.sin(nm / 60), Quantity.IRRADIANCE,
                                           "a source", error), tmp_path / "a.png")
    found = []
    for figure, options in figures:
        axes = figure.axes[0]
        found.append([axes.get_xlabel(), axes.get_ylabel(), axes.get_title(), options,
                      list(figure.get_size_inches()), axes.lines[0].get_xydata(),
                      [each.get_paths()[0].vertices for each in axes.collections],
                      [text.get_text() for text in axes.get_legend().get_texts()]
                      if axes.get_legend() else None])
    recorded(found)
