"""Readings of spectroradiometers: series, reflectance, what is stated of a spectrum, calibrations,
files, names, spotread, ports and transcripts: recorded.
"""
import contextlib
import errno
import json

import numpy as np
import serial
from capture_pictures import changed, outcome
from serial.tools.list_ports_common import ListPortInfo
from simulated_instruments import light

from spectrabox.capture.meter import (
    calibration,
    measurement,
    measurement_files,
    measurement_plot,
    measurement_series,
    measurement_targets,
    serial_line,
    spotread,
    stated,
)
from spectrabox.capture.meter.instruments.errors import InstrumentError
from spectrabox.capture.meter.instruments.interface import HeldResult
from spectrabox.capture.meter.serial_line import LineSettings, Pace, SerialLine
from spectrabox.capture.transcripts import faults, transcript
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records import Quantity, Spectrum
from spectrabox.radiometry.spectra.luminous import tristimulus_of
from spectrabox.radiometry.spectra.readings import ReadingOutcome, SpectralReading

NM = np.array([390.0, 402.0, 415.0, 433.0, 470.0, 505.0, 560.0, 610.0, 655.0, 690.0, 712.0])


def reading(level=1.0, serial_number="A1", outcome=ReadingOutcome.MEASURED, nm=NM,
            quantity=Quantity.RADIANCE, flags=(), bend=0.0):
    spectrum = Spectrum(grid_from_nm(nm), level * light(nm) * (1 + bend * (nm - 550) / 150),
                        quantity, "a source") if outcome.has_spectrum else None
    return SpectralReading(spectrum, outcome, quantity if spectrum else None, "PR-655",
                           serial_number, "3.1", 12.5, 101.5, "2026-01-02T03:04:05+00:00",
                           "a.transcript", flags)


def calibrated(serial_number, base, error=True):
    nm = np.array([380.0, 450.0, 600.0, 780.0])
    factor = base * np.array([1.02, 0.99, 1.01, 1.05])
    return calibration.Calibration(serial_number, Spectrum(
        grid_from_nm(nm), factor, Quantity.RELATIVE, "factors",
        np.array([0.01, 0.004, 0.006, 0.02]) * base if error else None))


def test_series_of_readings(recorded):
    levels = [1.0, 1.013, 0.995, 1.021, 1.017]
    series = measurement_series.series_of
    cases = {
        "five": series([reading(level, bend=0.01 * number) for number, level
                        in enumerate(levels)], "wall"),
        "one": series([reading(1.1)], "wall"), "two": series([reading(1), reading(1.04)], "wall"),
        "two instruments": series(
            [reading(level, "A1" if number % 2 else "B2") for number, level in enumerate(levels)],
            "wall", [calibrated("A1", 1.03), calibrated("B2", 0.96)]),
        "one calibration": series([reading(level) for level in levels], "wall",
                                  [calibrated("A1", 1.03, False), calibrated("B2", 0.96)][:1]),
        "flags": series([reading(1.0, flags=("a", "b")),
                         reading(1.1, outcome=ReadingOutcome.LOW_LIGHT, flags=("b", "c")),
                         reading(outcome=ReadingOutcome.TOO_DARK),
                         reading(outcome=ReadingOutcome.UNSTEADY),
                         reading(outcome=ReadingOutcome.TOO_DARK)], "wall")}
    for case, result in cases.items():
        recorded({"series": result, "spectrum": measurement_series.series_spectrum(result, "s")},
                 case=case)
    values = np.array([level * light(NM) * (1 + 0.01 * number * (NM - 550) / 150)
                       for number, level in enumerate(levels)])
    np.testing.assert_allclose(cases["five"].mean, values.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(cases["five"].spread, values.std(axis=0, ddof=1), rtol=1e-10)
    slope = np.polyfit(np.arange(5), values, 1)[0]
    np.testing.assert_allclose(cases["five"].drift_per_reading, slope, rtol=1e-8, atol=1e-12)


def test_series_that_drift_or_do_not_belong_together(recorded):
    series, table = measurement_series.series_of, {}
    wiggle = np.array([0.3, -0.2, 0.1, -0.35, 0.15])
    for drift in (0.0046, 0.0049, 0.0051, 0.0055, 0.02):
        for noise in (1e-5, 0.0022, 0.0045, 0.005, 0.0055, 0.008):
            levels = 1 + drift * np.linspace(-0.5, 0.5, 5) + noise * wiggle
            table[f"{drift} {noise}"] = series([reading(level) for level in levels], "wall").flags
    for case, others in (("quantity", [reading(quantity=Quantity.IRRADIANCE)]),
                         ("wavelengths", [reading(nm=NM + 1)]), ("maker", [reading(1, "B2")])):
        table[case] = outcome(lambda others=others: series([reading(), *others], "wall"))
    table["empty"] = [outcome(lambda: series([], "wall")), outcome(
        lambda: series([reading(outcome=ReadingOutcome.TOO_BRIGHT)], "wall"))]
    one, two = calibrated("A1", 1.0), calibrated("B2", 1.0)
    for case, makers, known in (("none", [("a", "A1"), ("b", "B2")], []),
                                ("half", [("a", "A1"), ("b", "B2")], [one]),
                                ("both", [("a", "A1"), ("b", "B2")], [two, one]),
                                ("foreign", [("a", "A1")], [one, two]),
                                ("same serial", [("a", "A1"), ("b", "A1")], [one]),
                                ("twice", [("a", "A1")], [one, one]),
                                ("single", [("a", "A1")], [])):
        table[f"comparable {case}"] = outcome(lambda makers=makers, known=known:
                                              calibration.require_comparable(makers, known, "w"))
    table["makers"] = calibration.makers_of([reading(), reading(1, "B2"), reading(), reading(
        outcome=ReadingOutcome.TOO_DARK, serial_number="C3")])
    for low, high in ((380.0, 780.0), (379.0, 700.0), (390.0, 781.0)):
        table[f"factors {low:g} {high:g}"] = outcome(lambda low=low, high=high: dict(
            calibration.factors_at(np.array([low, 500.0, high]), [one, calibrated("B", 2, False)])))
    recorded(table)


def test_files_of_calibrations(recorded, tmp_path):
    table = {}
    for factor in (0.19, 0.21, 1.0, 4.9, 5.1):
        file = tmp_path / "factor.csv"
        file.write_text("# quantity: relative\nwavelength_nm,value\n"
                        + "".join(f"{nm},{factor if nm == 500 else 1.0}\n"
                                  for nm in range(400, 710, 10)))
        table[f"{factor}"] = outcome(lambda file=file: calibration.read_calibration(
            f" 65 = {file}"))
    for text in ("65", "=a.csv", "65=", "65=none.csv"):
        table[text] = outcome(lambda text=text: calibration.read_calibration(text))
    recorded({key: value.replace(str(tmp_path), "") if isinstance(value, str) else value
              for key, value in table.items()})


def test_reflectance_over_a_white(recorded):
    nm = np.arange(380.0, 781.0, 10.0)
    grid = grid_from_nm(nm)
    white = 0.01 * (0.05 + np.exp(-((nm - 560) / 110) ** 2))
    target = white * (0.2 + 0.5 * (nm - 380) / 400)
    errors = 1e-5 * (1 + np.sin(nm / 40) ** 2), 2e-5 * (1 + np.cos(nm / 30) ** 2)

    def ratio(target_values=target, white_values=white, with_error=True, quantity=Quantity.RADIANCE,
              at=grid):
        surface = Spectrum(grid, target_values, Quantity.RADIANCE, "t", errors[0])
        standard = Spectrum(at, white_values, quantity, "w", errors[1] if with_error else None)
        return measurement_series.reflectance_from(surface, standard, 0.985, "t / w")
    result = ratio()
    part = np.isin(nm, result.grid.nm)
    np.testing.assert_allclose(result.values, 0.985 * (target / white)[part], rtol=1e-12)
    relative = np.hypot(errors[0] / target, errors[1] / white)[part]
    np.testing.assert_allclose(result.standard_error, result.values * relative, rtol=1e-12)
    recorded({"ratio": result, "without": ratio(with_error=False)}, case="ratio")
    table = {}
    for dark in (0.0195, 0.0205):
        for place in (385, 395, 400, 500, 700, 705, 780):
            lower = np.where(np.abs(nm - place) < 6, dark * white.max(), np.maximum(
                white, 0.03 * white.max()))
            table[f"{dark} {place}"] = outcome(lambda lower=lower: ratio(
                white_values=lower).grid.nm[[0, -1]])
    table["quantity"] = outcome(lambda: ratio(quantity=Quantity.IRRADIANCE))
    table["grid"] = outcome(lambda: ratio(at=grid_from_nm(nm + 1)))
    recorded(table)


def test_figures_that_instruments_state(recorded):
    table = {text: [stated.printed(text).value, stated.printed(text).rounding] for text in
             ("1.83e+00", "183", "0.4012", "-3.1E-02", " 5.e3", ".25")}
    table["xyz"] = stated.stated_by_xyz(["3.1e1", "2.75e1", "1.2e+01"], stated.printed("4.4e-1"))
    table["dark"] = stated.stated_by_xyz(["0.0", "0.00", "-1e-9"])
    for power, photons in (("1.0", "2.5e18"), ("1.0", "4.9e17"), ("1.0", "5.1e17"),
                           ("1.0", "1.5e19"), ("1.0", "1.52e19"), ("0.0", "1e18"), ("1", "-1e18")):
        table[f"{power} {photons}"] = stated.mean_wavelength(stated.printed(power),
                                                             stated.printed(photons))
    recorded(table)


def _checked(nm, values, **figures):
    return outcome(lambda: stated.check_stated(nm, values, stated.Stated(**figures), "line"))


def test_how_far_a_spectrum_may_be_from_its_figures(recorded):
    table = {}
    for step in (1.0, 4.0, 10.0):
        nm = np.arange(380.0, 781.0, step)
        values = light(nm)
        x, y, z = tristimulus_of(nm, values)
        total = x + y + z

        def exact(value):
            return stated.Number(float(value), 1e-12)
        relative = max(0.01, 0.003 * step if step > 4 else 0)
        for times in (-1.03, -0.97, 0.97, 1.03):
            table[f"{step:g} luminance {times}"] = _checked(nm, values, luminance=exact(
                y / (1 + times * relative)))
            table[f"{step:g} x {times}"] = _checked(nm, values, x=exact(
                x / total + times * 0.0005 * step))
            table[f"{step:g} y {times}"] = _checked(nm, values, y=exact(
                y / total + times * 0.0005 * step))
        sums = sorted((float(np.trapezoid(values, nm)), float(step * values.sum())))
        for case, power in (("low", sums[0] / 1.0103), ("within", sums[0] / 1.0097),
                            ("above", sums[1] / 0.9903), ("high", sums[1] / 0.9897)):
            table[f"{step:g} power {case}"] = _checked(nm, values, power=exact(power))
        means = sorted((float(np.trapezoid(values * nm, nm) / np.trapezoid(values, nm)),
                        float(values @ nm / values.sum())))
        for case, mean in (("low", means[0] - 0.52 * step), ("within", means[0] - 0.48 * step),
                           ("above", means[1] + 0.48 * step), ("high", means[1] + 0.52 * step)):
            table[f"{step:g} mean {case}"] = _checked(nm, values, mean_nm=exact(mean))
        table[f"{step:g} rounding"] = [_checked(nm, values, luminance=stated.Number(
            float(y * 1.02), float(rounding * y))) for rounding in (0.009, 0.0094, 0.03)]
    nm = np.arange(380.0, 781.0)
    for length in (11, 12, 13):
        for level in (0.0098, 0.0102, 0.5):
            values = light(nm)
            values[200:200 + length] = level * values.max()
            table[f"stuck {length} {level}"] = _checked(nm, values)
    recorded(table)


def test_flags_and_darkness_of_a_reading(recorded):
    nm = np.arange(380.0, 781.0, 10.0)
    table = {}
    for case, values, luminance in (
            ("plain", light(nm), 12.0), ("no luminance", light(nm), None),
            ("negative", np.where(np.isin(nm, (380, 390, 400, 550, 700, 710)), -1e-4, light(nm)),
             1.0),
            ("dark", np.zeros(nm.size), 1.0), ("below", -light(nm), 1.0),
            ("stated dark", light(nm) * np.where(nm > 700, 1, -1), 0.0),
            ("stated dark, but lit", light(nm), 0.0)):
        number = None if luminance is None else stated.Number(luminance, 0.01)
        held = HeldResult(nm, values, Quantity.RADIANCE, stated.Stated(number), 1.0, ("a",))
        table[case] = [measurement._is_dark(held), measurement._value_flags(held)]
    recorded(table)


def test_readings_in_files(recorded, tmp_path):
    folder = measurement_files.readings_folder(tmp_path, "wall 1")
    for number, each in enumerate((reading(1.5, flags=("a",)), reading(
            outcome=ReadingOutcome.NO_SYNC), reading(quantity=Quantity.IRRADIANCE))):
        path = measurement_files.store_reading(folder, each)
        recorded({"name": path.name, "file": json.loads(path.read_text()),
                  "read": measurement_files.read_reading(path)}, case=f"{number}")
    (folder / "007.json").write_text((folder / "001.json").read_text())
    (folder / "x8.json").write_text("{}")
    (folder / "12.json").write_text("{}")
    table = {"next": measurement_files.store_reading(folder, reading()).name,
             "count": len(measurement_files.stored_readings(folder)),
             "aside": [measurement_files.set_aside(folder).name]}
    measurement_files.store_reading(folder, reading())
    table["aside"].append(measurement_files.set_aside(folder).name)
    table["gone"] = measurement_files.stored_readings(folder)
    bad = folder.parent / "wall 1.before-1" / "001.json"
    facts = json.loads(bad.read_text())
    for case, text in (("not json", "{"), ("list", "[]"), ("outcome", json.dumps(
            facts | {"outcome": "nice"})), ("short", json.dumps(facts | {"values": [1.0]})),
                       ("no flags", json.dumps({key: value for key, value in facts.items()
                                                if key != "flags"}))):
        bad.write_text(text)
        table[case] = outcome(lambda: measurement_files.read_reading(bad))
    table["missing"] = outcome(lambda: measurement_files.read_reading(folder / "001.json"))
    for name in ("a/b", "", "nul", "é", "x" * 300, "wall: 1", ".hidden"):
        table[f"name {name[:20]}"] = outcome(lambda name=name: measurement_files.readings_folder(
            tmp_path, name).name)
    recorded({key: str(value).replace(str(tmp_path), "") for key, value in table.items()},
             case="table")


def test_names_that_a_measurement_may_take(recorded, tmp_path):
    targets, table = measurement_targets, {}
    for role, name in (("paint", "red"), ("white", "white"), ("chart", "chart-01-dark skin")):
        measurement_files.store_reading(measurement_files.readings_folder(tmp_path, name),
                                        reading())
        targets.note_role(tmp_path, role, name)
    for file, text in (("blue.csv", "x"), ("green-radiance.csv", "# quantity: radiance\n"),
                       ("light.csv", "# quantity: irradiance\n"), ("chart.csv", "1,2")):
        (tmp_path / file).write_text(text)
    for role in targets.ROLES:
        for name in ("red", "white", "light", "Light", "chart", "chart-07-red", "chart-7", "blue",
                     "green", "new", "chart-radiance"):
            table[f"{role} {name}"] = outcome(lambda role=role, name=name: targets.claim(
                tmp_path, role, [name]))
        for quantity in (Quantity.RADIANCE, Quantity.IRRADIANCE, Quantity.REFLECTANCE):
            table[f"{role} {quantity.name}"] = [outcome(
                lambda role=role, name=name, quantity=quantity: targets.result_file(
                    tmp_path, role, name, quantity).name) for name in ("light", "green", "new")]
    recorded({key: str(value).replace(str(tmp_path), "") for key, value in table.items()})


SAID = """Instrument Type: JETI specbos 1211
Serial Number: 2010417
Firmware version: 1.82
Place instrument
Spectrum from 400.000000 to 700.000000 nm in 4 steps
{values}
 Result is XYZ: {xyz}, Yxy: {yxy}
"""


def test_what_spotread_prints_and_saves(recorded, tmp_path):
    nm = np.linspace(400, 700, 4)
    values = np.array([0.02, 0.051, 0.043, 0.0313])
    xyz = tristimulus_of(nm, values)
    x, y = xyz[:2] / xyz.sum()

    def saved(scale=1.0):
        file = tmp_path / "a.sp"
        file.write_text("SPECT\n\nSPECTRAL_BANDS \"4\"\nSPECTRAL_START_NM \"400\"\n"
                        "SPECTRAL_END_NM \"700\"\nSPECTRAL_NORM \"1.000000\"\n"
                        "MEAS_TYPE \"EMISSION\"\n"
                        "NUMBER_OF_FIELDS 4\nBEGIN_DATA_FORMAT\n"
                        "SPEC_400 SPEC_500 SPEC_600 SPEC_700\nEND_DATA_FORMAT\n\nNUMBER_OF_SETS 1\n"
                        "BEGIN_DATA\n" + " ".join(str(1000 * scale * value) for value in values)
                        + "\nEND_DATA\n")
        return file

    def said(luminance=1.0, printed=values):
        return SAID.format(values=", ".join(f"{1000 * value:.4f}" for value in printed),
                           xyz=" ".join(f"{value:.4f}" for value in xyz),
                           yxy=f"{luminance * xyz[1]:.4f} {x:.6f} {y:.6f}")
    table = {}
    for case, text, scale in (
            ("plain", said(), 1.0), ("other luminance", said(1.4), 1.0),
            ("no result", said().partition("Result")[0], 1.0),
            ("unnamed", said().partition("Place")[2], 1.0),
            ("printed 0.9 per mille off", said(printed=values * 1.0009), 1.0),
            ("printed 1.1 per mille off", said(printed=values * 1.0011), 1.0),
            ("cut", said(printed=values[:3]), 1.0),
            ("not numbers", said().replace("51.0000", "x"), 1.0), ("dark", said(
                0.0, 0 * values), 0.0)):
        def read(text=text, scale=scale):
            got = spotread._reading(text, saved(scale), Quantity.RADIANCE, "2026", "a.transcript")
            return changed(got, taken_at="")
        table[case] = outcome(read)
    table["complaints"] = [spotread._complaint(text) for text in (
        "a\nspotread: Error - No instrument at port 1\n", "Diagnostic: usage\nx", "one\n\n two \n",
        "")]
    recorded(table)


def test_ports_and_lines(recorded, tmp_path, monkeypatch):
    table = {}
    monkeypatch.setattr(serial_line, "list_ports", lambda: [{"port": "/dev/ttyX"}])
    monkeypatch.setattr(serial_line, "_group_advice", lambda port: "ask")
    for name in ("EACCES", "EPERM", "EBUSY", "EAGAIN", "ENOENT", "ENODEV", "ENXIO", "EIO"):
        error = OSError(getattr(errno, name), "words")
        table[name] = str(serial_line._port_error("/dev/ttyQ", error))
    table["lock"] = str(serial_line._port_error("/dev/ttyQ", serial.SerialException("lock it")))
    table["value"] = str(serial_line._port_error("/dev/ttyQ", ValueError("no such baud")))
    entries = [ListPortInfo("/dev/ttyB"), ListPortInfo("/dev/ttyA")]
    entries[0].description, entries[1].description = "d", "e"
    for key, value in {"manufacturer": "m", "vid": 0x403, "pid": 0x6001,
                       "serial_number": "7"}.items():
        setattr(entries[1], key, value)
    monkeypatch.undo()
    from serial.tools import list_ports
    monkeypatch.setattr(list_ports, "comports", lambda: entries)
    table["ports"] = serial_line.list_ports()
    table["shown"] = [serial_line.shown(b"a" * size) for size in (59, 60, 61)]
    for data in (b"a\t\r\n~ ", b"\x7f", b"\x1f", b"\x08", b"\x80", b"\x00"):
        table[f"{data!r}"] = outcome(lambda data=data: serial_line.ascii_text(data, "line"))
    opened = []
    monkeypatch.setattr(serial_line.serial, "serial_for_url", lambda url, **options: opened.append(
        [url, dict(sorted(options.items()))]))
    for port in ("/dev/ttyX", "socket://127.0.0.1:2101"):
        serial_line.open_line(port, LineSettings(38400, True, 0.01), lambda *_: None)
    table["opened"] = opened
    pace = Pace(0.5, 2.0)
    table["pace"] = [pace.limit_s(3.0), pace.limit_s(5.0), Pace().limit_s(5.0)]
    recorded(table)


def test_a_line_that_breaks_or_takes_nothing(recorded):
    table = {}
    for error in (OSError(5, "I/O"), serial.SerialException("gone"),
                  serial.SerialTimeoutException("slow")):
        class Port:
            def __init__(self, said):
                self.said = said

            @property
            def in_waiting(self):
                raise self.said

            def write(self, data):
                raise self.said

            def close(self):
                raise OSError(5, "again")
        line = SerialLine(Port(error), "line", LineSettings(9600), lambda *_: None, Pace(0.001),
                          contextlib.nullcontext)
        said = []
        for act in (lambda line=line: line.write(b"a"), lambda line=line: line.send(b"a"),
                    lambda line=line: line.read_until((b"\n",), 1.0), line.close):
            try:
                act()
                said.append("nothing")
            except InstrumentError as found:
                said.append(f"{type(found).__name__} {found}")
        table[str(error)] = said
    recorded(table)


def test_plots_of_spectra(recorded, tmp_path):
    nm = np.arange(400.0, 701.0, 10.0)
    spectrum = Spectrum(grid_from_nm(nm), light(nm) - 5e-4, Quantity.RADIANCE, "a source")
    recorded({"default": measurement_plot.text_plot(spectrum).split("\n"),
              "small": measurement_plot.text_plot(spectrum, 30, 5).split("\n"),
              "dark": measurement_plot.text_plot(changed(spectrum, values=-light(nm)),
                                                 20, 3).split("\n")})


def test_texts_of_transcripts_and_faults(recorded, tmp_path):
    data = b'380,1.5e-3\r\n384,9.75e-3\r\n\t"\\\x00\xfe'
    table = {"line": transcript.event_line(transcript.Event("<", 0.12345, data))}
    assert transcript.unescaped(transcript.escaped(data)) == data
    for kind in faults.FaultKind:
        for position in (0.0, 0.4, 1.0):
            fault = faults.Fault(kind, 3, position, 0.07)
            table[f"{kind.value} {position}"] = [
                [pause, None if part is None else transcript.escaped(part)]
                for pause, part in faults.overlaid(data, fault, b"D5\r")]
    table["defaults"] = faults.Fault(faults.FaultKind.STALL, 1)
    head = "# spectrabox transcript: 1\n"
    file = tmp_path / "a.transcript"
    for case, text in (("plain", head + '# line: 9600 rtscts\n> 0.5 "a\\r"\n< 1 "\\x06"\n'),
                       ("cut", head + '> 0.5 "a"\n< 1 "\\x0'), ("no events", head),
                       ("bad escape", head + '> 0 "\\q"\n\n'), ("version", "# spectrabox "
                        "transcript: 2\n"), ("not ascii", head + "> 0 \"é\"\n"),
                       ("no event", head + 'x\n> 0 "a"\n'), ("no line", head + '> 0 "a"\n')):
        file.write_text(text, encoding="utf-8")
        table[case] = outcome(lambda: _read(file))
    table["missing"] = outcome(lambda: _read(tmp_path / "none"))
    recorded({key: value.replace(str(tmp_path), "") if isinstance(value, str) else value
              for key, value in table.items()})


def _read(file):
    read = transcript.read_transcript(file)
    return [read.facts, [[event.direction, event.delay_s, transcript.escaped(event.data)]
                         for event in read.events], outcome(lambda: read.baud)]
