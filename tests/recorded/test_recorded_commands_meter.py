"""Commands on instruments: recordings played, and series of readings as they are kept and told."""
import contextlib

import numpy as np
import pytest
from said_by_commands import content_of, said

from spectrabox.fixtures.meter_transcripts import FOLDER
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import Quantity, Spectrum
from spectrabox.radiometry.spectra.readings import ReadingOutcome, SpectralReading
from spectrabox.session.commands import meter

PACE = {"SPECTRABOX_METER_PACE": "0.01"}
GRID = visible_grid(10.0)
TRANSCRIPTS = sorted(path.stem for path in FOLDER.glob("*.transcript"))


@pytest.mark.parametrize("name", TRANSCRIPTS)
def test_a_recording_is_played(name, recorded):
    words = ("meter", "replay", str(FOLDER / f"{name}.transcript"))
    answer = said(FOLDER, *words, "--json", env=PACE)
    recorded(answer)
    if name == "cs2000":
        recorded(said(FOLDER, *words, "--plot", env=PACE), case="text")


def a_reading(at, level, serial="A1"):
    """A reading whose spectrum drifts and scatters with its number; the third is in low light."""
    rng = np.random.default_rng(at)
    shape = 1 + 0.4 * np.sin(GRID.nm / (50 + 2 * at)) + 0.1 * at / 24
    values = level * shape * (1 + 0.01 * at + rng.normal(0, 0.004, GRID.nm.size))
    outcome = ReadingOutcome.LOW_LIGHT if at == 2 else ReadingOutcome.MEASURED
    return SpectralReading(Spectrum(GRID, values, Quantity.RADIANCE, "a meter", None), outcome,
                           Quantity.RADIANCE, "CR-250", serial, "1.2", 40.0 + at,
                           12.5 * level + at, "2026-01-01T00:00:00+00:00", "x.transcript",
                           ("beware",) * (at == 1))


@pytest.fixture
def readings(monkeypatch):
    """A function that says which readings the next command takes, and what it asked for."""
    def use(level=1.0, **more):
        taken = []

        @contextlib.contextmanager
        def source(folder):
            def take(check):
                check(("CR-250", more.get("serial", "A1")))
                taken.append(a_reading(len(taken), level, **more))
                return taken[-1]
            yield take
        monkeypatch.setattr(meter, "_source", lambda *words: source)
        return taken
    return use


def measured(folder, *words, typed=None):
    return said(folder, "meter", "measure", "DIR", *words, typed=typed)


def kept(folder, name):
    return content_of(folder / "spectra" / f"{name}.csv", [folder])


def test_a_series_from_its_first_reading_to_a_reflectance(tmp_path, readings, recorded):
    readings(2.0)
    found = [measured(tmp_path, "--json"), measured(tmp_path, "--repeat", "4", "--json"),
             measured(tmp_path, "--repeat", "3", "--json")]
    recorded([found, kept(tmp_path, "light")], case="light")
    readings(5.0)
    found = [measured(tmp_path, "--as", "white", "--repeat", "2", "--plot")]
    readings(1.3)
    found += [measured(tmp_path, "--as", "paint", "--name", "red", "--white-reflectance", "0.97",
                       "--repeat", "3", "--json"),
              measured(tmp_path, "--as", "paint", "--name", "red", "--repeat", "3")]
    recorded([found, kept(tmp_path, "white"), kept(tmp_path, "red")], case="white and paint")
    readings(3.0)
    recorded([measured(tmp_path, "--again", "--json"), kept(tmp_path, "light"),
              sorted(path.relative_to(tmp_path).as_posix().translate(str.maketrans(
                  "123456789", "000000000")) for path in tmp_path.rglob("*.json"))], case="again")


def test_a_chart_patch_by_patch(tmp_path, readings, recorded):
    readings(5.0)
    found = [measured(tmp_path, "--as", "white", "--json")]
    readings(1.1)
    found += [measured(tmp_path, "--as", "chart", typed="\n\nq\n"),
              measured(tmp_path, "--as", "chart", "--no-wait", "--white-reflectance", "0.9",
                       "--json")]
    recorded([found, kept(tmp_path, "chart")])


def test_two_instruments_and_their_calibrations(tmp_path, readings, recorded):
    for serial, first, last in (("A1", 1.0, 1.1), ("B2", 0.9, 0.8)):
        (tmp_path / f"{serial}.csv").write_text(
            f"# quantity: relative\nnm,value,standard_error\n380,{first},0.01\n780,{last},0.02\n",
            encoding="utf-8")
    both = [word for serial in ("A1", "B2")
            for word in ("--calibration", f"{serial}=DIR/{serial}.csv")]
    readings(2.0)
    found = [measured(tmp_path, "--json")]
    readings(2.1, serial="B2")
    found += [measured(tmp_path, "--repeat", "2", "--json"),
              measured(tmp_path, "--repeat", "3", *both[:2], "--json"),
              measured(tmp_path, "--repeat", "3", *both, "--json")]
    recorded([found, kept(tmp_path, "light")])


WRONG = [(), ("--port", "x"), ("--instrument", "cr250"),
         ("--port", "x", "--instrument", "cr250", "--ambient"), ("--with", "other"),
         ("--with", "spotread", "--instrument", "cr250"), ("--with", "spotread", "--averages", "2"),
         ("--with", "spotread", "--port", "x"), ("--as", "moon"), ("--as", "paint"),
         ("--port", "x", "--instrument", "cr250", "--as", "paint", "--name", "a/b"),
         ("--repeat", "0"), ("--repeat", "1000"), ("--averages", "100"), ("--sync-hz", "9.9"),
         ("--integration-ms", "0.09"), ("--white-reflectance", "1.11"), ("--png", "x.jpg"),
         ("--port", "/dev/none", "--instrument", "cr250"),
         ("--port", "/dev/none", "--instrument", "cr25"),
         ("--port", "x", "--instrument", "cr250", "--calibration", "A1")]


def test_what_measure_refuses(tmp_path, recorded):
    recorded([measured(tmp_path, *words) for words in WRONG])
    recorded([said(tmp_path, "meter", *words, env={"SPECTRABOX_METER_PACE": "x"}) for words in (
        ("identify", "--port", "/dev/none", "--instrument", "cr250", "--json"),
        ("replay", "DIR/none.transcript"), ("replay", "DIR/none.transcript", "--speed", "-1"))],
        case="others")


def test_the_ports_of_a_computer(tmp_path, recorded, monkeypatch):
    for ports in ([], [{"port": "/dev/ttyACM0", "usb": "0403:6001", "manufacturer": "Maker",
                        "description": "a meter"},
                       {"port": "/dev/ttyS0", "usb": None, "manufacturer": None,
                        "description": None}]):
        monkeypatch.setattr("spectrabox.capture.meter.serial_line.list_ports",
                            lambda ports=ports: ports)
        recorded([said(tmp_path, "meter", "list"), said(tmp_path, "meter", "list", "--json")],
                 case=f"{len(ports)} ports")


def test_how_fast_an_instrument_is_spoken_to(monkeypatch, recorded):
    found = []
    for text in (None, "1", "0.5", "0"):
        if text is None:
            monkeypatch.delenv("SPECTRABOX_METER_PACE", raising=False)
        else:
            monkeypatch.setenv("SPECTRABOX_METER_PACE", text)
        pace = meter._pace()
        found.append({name: value for name, value in vars(pace).items()
                      if isinstance(value, int | float)})
    recorded(found)
