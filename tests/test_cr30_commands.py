"""A CR30 at the command line: calibrated, held on a paint, on a chart's 24 patches."""
import csv
import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.capture.meter.measurement_files import _reserved, chart_and_patch, patch_names
from spectrabox.capture.transcripts.player import TranscriptPlayer, replay_transcript
from spectrabox.capture.transcripts.sniffed_traffic import read_recording
from spectrabox.capture.transcripts.transcript import Transcript
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.charts.layouts import LAYOUTS, chart_layout
from spectrabox.radiometry.charts.references import measured_chart, reference_reflectances
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.session.cli import app
from spectrabox.session.meters.readers import _usual, chart_picture, nearer_patch

from tests.cr30_player import FOLDER, measurements, playing, steps_of

ROOT = Path(__file__).resolve().parents[1]
PACE = {"SPECTRABOX_METER_PACE": "0.01"}
CALIBRATED = FOLDER / "Calibrate_White_and_Black_and_Test_Target.spm"
WHITE, BLACK, _ = steps_of(CALIBRATED)
GREEN, = measurements(FOLDER / "Test_Sample_36.61_-20.75_-2.86.spm")
PRESSED, = measurements(FOLDER / "button_presses_and_disconnected_presses.spm")
MANY = measurements(FOLDER / "param_change-and-measure.spm")
CHART = [*MANY, GREEN, *measurements(CALIBRATED)]


def run(*arguments, typed=""):
    result = CliRunner().invoke(app, ["meter", *map(str, arguments)], input=typed, env=PACE)
    return result.exit_code, result.stdout, result.stderr


def measure(folder, player, *more, typed=""):
    with player:
        return run("measure", folder, "--port", player.port, "--instrument", "cr30", *more,
                   typed=typed)


def table(path):
    lines = path.read_text().splitlines()
    rows = list(csv.reader(line for line in lines if not line.startswith("#")))
    return [line for line in lines if line.startswith("#")], rows[0], np.array(rows[1:], float)


def test_a_paint_is_calibrated_for_measured_and_written_with_its_calibration(tmp_path):
    player = playing([WHITE, BLACK, GREEN])
    code, out, err = measure(tmp_path, player, "--as", "paint", "--name", "vase", "--json",
                             typed="\n\n\n")
    assert code == 0, err
    assert not player.problems and player.finished
    assert err.index("white calibration of the CR30: put it on its white tile,\nthen press Enter") \
        < err.index("black calibration of the CR30") < err.index("vase: hold the instrument on it")
    assert "L*a*b* 36.61 -20.75 -2.86 on its display (D65, 10 degrees)" in err
    facts = json.loads(out)
    assert facts["taken"] == 1 and facts["series"][0]["flags"] == []
    head, names, values = table(tmp_path / "spectra" / "vase.csv")
    assert head[0] == "# quantity: reflectance" and names[1] == "value"
    assert "calibration of the instrument: white 2" in head[-1] and "black 2" in head[-1]
    stored = json.loads((tmp_path / "spectra" / "readings" / "vase" / "001.json").read_text())
    # nine digits are written
    np.testing.assert_allclose(values[:, 1], stored["values"], rtol=5e-9)
    np.testing.assert_allclose(stored["lab"], (36.61, -20.75, -2.86), atol=0.01)


def test_its_own_recording_plays_back_to_the_same_reading(tmp_path):
    measure(tmp_path, playing([WHITE, BLACK, GREEN]), "--as", "paint", "--name", "vase",
            typed="\n\n\n")
    recording, = (tmp_path / "spectra" / "readings").glob("*.transcript")
    (reading, *_), problems = replay_transcript(read_recording(recording))
    np.testing.assert_allclose(reading.lab, (36.61, -20.75, -2.86), atol=0.01)
    assert reading.serial_number == "CM443L0787" and not problems


@pytest.mark.parametrize("typed, options", [("s\ns\n\n", ()), ("", ("--no-calibrate",
                                                                  "--no-wait"))])
def test_a_calibration_that_was_left_out_is_stated(tmp_path, typed, options):
    code, out, err = measure(tmp_path, playing([GREEN]), "--as", "paint", "--name", "vase",
                             *options, typed=typed)
    assert code == 0, err
    assert "No white and black calibration was made before this reading" in out
    head, _, _ = table(tmp_path / "spectra" / "vase.csv")
    assert "calibration of the instrument: none before these readings" in head[-1]


def test_a_calibration_is_never_left_out_silently(tmp_path):
    code, _, err = measure(tmp_path, playing([GREEN]), "--as", "paint", "--name", "vase",
                           "--no-wait")
    assert code == 2 and "--no-calibrate" in err


def test_the_button_on_the_instrument_takes_the_reading(tmp_path):
    """The terminal stays open and silent, as while somebody holds the instrument."""
    player = playing([PRESSED])
    with player:
        process = subprocess.Popen(
            [sys.executable, "-m", "spectrabox", "meter", "measure", str(tmp_path), "--port",
             player.port, "--instrument", "cr30", "--as", "paint", "--name", "mat",
             "--no-calibrate"], cwd=ROOT, text=True, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env={**os.environ, **PACE, "PYTHONPATH": str(ROOT)})
        code = process.wait(60)             # its input stays open until then
        _, err = process.communicate()
    assert code == 0, err
    stored = json.loads((tmp_path / "spectra" / "readings" / "mat" / "001.json").read_text())
    np.testing.assert_allclose(stored["lab"], (38.68, -19.64, -7.89), atol=0.01)
    assert not player.problems


def test_a_chart_is_read_with_a_picture_an_undo_and_an_interruption(tmp_path):
    first = playing([WHITE, BLACK, *CHART[:4]])
    code, _, err = measure(tmp_path, first, "--as", "chart", typed="\n\n\n\n\nu\n\nq\n")
    assert code == 4 and "3 of 24 patches are measured and kept" in err
    assert " > 3 < " in err and " 1 ok " in err
    assert "chart-03-blue-sky: its readings are kept aside in chart-03-blue-sky.before-1" in err
    # patch 1 was held on something green
    assert "this looks like chart-" in err and "and not like chart-01-dark-skin" in err
    assert not (tmp_path / "spectra" / "chart.csv").exists()

    rest = playing(CHART[3:])
    code, out, err = measure(tmp_path, rest, "--as", "chart", "--no-calibrate",
                             typed="\n" * 21)
    assert code == 0, err
    assert not rest.problems and rest.finished and "--reference" in out
    assert "patch 4 of 24, chart-04-foliage" in err
    with pytest.raises(CheckError, match="another chart"):
        measured_chart(tmp_path / "spectra" / "chart.csv", FINE_GRID, CLASSIC)
    _, names, values = table(tmp_path / "spectra" / "chart.csv")
    assert len(names) == 25 and values.shape == (31, 25)
    assert names[1:3] == ["01-dark-skin", "02-light-skin"]
    # the third was read again: it is the fourth of the recording
    fourth = replay_transcript(Transcript({"instrument": "cr30"}, CHART[3], ""))[0][0]
    np.testing.assert_allclose(values[:, 3], fourth.spectrum.values, rtol=5e-9)


@pytest.mark.parametrize("layout, stem, one", [
    ("APT", "chart-artistpainttarget", "chart-artistpainttarget-05-E1"),
    ("SpyderCheckr 24", "chart-spydercheckr24", "chart-spydercheckr24-05-E2")])
def test_another_chart_is_read_patch_by_patch_too(tmp_path, layout, stem, one):
    asked = ("--as", "chart", "--chart-layout", layout, "--no-calibrate")
    code, _, err = measure(tmp_path, playing(CHART[:6]), *asked, typed="\n" * 5 + "u\n\nq\n")
    assert code == 4 and "5 of 24 patches are measured and kept" in err
    assert f"patch 5 of 24, {one}" in err and " > E1 < " in err
    assert f"{one}: its readings are kept aside" in err
    rest = playing(CHART[5:])
    code, _, err = measure(tmp_path, rest, *asked, typed="\n" * 19)
    assert code == 0 and rest.finished and "patch 6 of 24, " in err, err
    _, names, values = table(tmp_path / "spectra" / f"{stem}.csv")
    chart = chart_layout(layout)
    assert names[1:] == [f"{number:02d}-{patch}" for number, patch in enumerate(chart.names, 1)]
    fifth = replay_transcript(Transcript({"instrument": "cr30"}, CHART[5], ""))[0][0]
    np.testing.assert_allclose(values[:, 5], fifth.spectrum.values, rtol=5e-9)
    # a ColorChecker in the same folder has a file of its own
    code, _, err = measure(tmp_path, playing(CHART[:1]), "--as", "chart", "--no-calibrate",
                           typed="\nq\n")
    assert code == 4 and "1 of 24 patches" in err
    assert [path.name for path in (tmp_path / "spectra").glob("*.csv")] == [f"{stem}.csv"]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_chart_has_its_picture_on_a_terminal(layout):
    chart = LAYOUTS[layout]
    usual = _usual(chart)
    one = Spectrum(FINE_GRID, np.full(FINE_GRID.nm.size, 0.4) if usual is None else usual[1],
                   Quantity.REFLECTANCE, "one")
    plain = chart_picture(chart, {0: one, 1: None}, 2, colours=False).splitlines()
    assert len(plain) == chart.rows and max(map(len, plain)) <= 100
    assert len(re.findall(r">.*?<", "".join(plain))) == 1
    coloured = chart_picture(chart, {0: one}, 1, colours=True)
    cells = len(chart.names) * (2 if chart.rows <= 6 else 1)
    assert coloured.count("\x1b[48;2;") == cells
    # a reading of another patch is named, and that of this one is not
    assert nearer_patch(chart, 1, one) is None
    assert nearer_patch(chart, 0, one) is None if usual is None or np.allclose(
        usual[0], usual[1], atol=0.1) else nearer_patch(chart, 0, one) == 1
    names = patch_names(chart)
    assert len(set(names)) == len(names) and {chart_and_patch(name)[0] for name in names} == {
        chart_and_patch(names[0])[0]}
    assert all(_reserved(name) == "chart" for name in names)


def test_a_written_chart_is_a_reference_of_its_layout(tmp_path):
    chart = chart_layout("Digital SG")
    known = reference_reflectances(None, chart, FINE_GRID)
    nm = np.arange(400.0, 701, 10)
    columns = {chart_and_patch(name)[1]: np.interp(nm, FINE_GRID.nm, row)
               for name, row in zip(patch_names(chart), known, strict=True)}
    (tmp_path / "chart.csv").write_text(table_text(nm, columns, quantity=Quantity.REFLECTANCE,
                                                   source="CR30"), encoding="utf-8")
    again = measured_chart(tmp_path / "chart.csv", FINE_GRID, chart)
    # lines between tens of nanometres
    np.testing.assert_allclose(again, known, atol=0.02)


def test_a_layout_is_of_a_chart_alone(tmp_path):
    code, _, err = measure(tmp_path, playing([GREEN]), "--as", "paint", "--name", "vase",
                           "--chart-layout", "NGT")
    assert code == 2 and "measure it with --as chart" in err


def test_repeats_are_one_press_and_their_mean_has_a_standard_error(tmp_path):
    code, _, err = measure(tmp_path, playing([MANY[3], MANY[13], MANY[3]]), "--as", "paint",
                             "--name", "card", "--repeat", "3", "--no-calibrate", typed="\n")
    assert code == 0, err
    _, names, values = table(tmp_path / "spectra" / "card.csv")
    assert names[1:] == ["value", "standard_error"] and (values[:, 2] > 0).all()


def test_a_light_is_no_thing_for_it(tmp_path):
    code, _, err = measure(tmp_path, playing([GREEN]), "--as", "light")
    assert code == 3 and "measures reflectance, no light" in err


def test_a_series_interrupted_on_a_terminal_goes_on(tmp_path):
    """Ctrl-C on a terminal while it waits for the next thing: nothing that was read is lost."""
    master, slave = pty.openpty()
    player = playing([GREEN])
    with player:
        process = subprocess.Popen(
            [sys.executable, "-m", "spectrabox", "meter", "measure", str(tmp_path), "--port",
             player.port, "--instrument", "cr30", "--as", "chart", "--no-calibrate"],
            cwd=ROOT, stdin=slave, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env={**os.environ, **PACE, "PYTHONPATH": str(ROOT)},
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))
        os.write(master, b"\n")
        reading = tmp_path / "spectra" / "readings" / "chart-01-dark-skin" / "001.json"
        end = time.monotonic() + 60
        while not reading.exists() and time.monotonic() < end:
            time.sleep(0.02)
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)
    os.close(master)
    os.close(slave)
    assert process.returncode == 130 and reading.exists(), err
    code, _, err = measure(tmp_path, playing(CHART[1:]), "--as", "chart", "--no-calibrate",
                           "--no-wait")
    assert code == 0, err
    assert (tmp_path / "spectra" / "chart.csv").exists()


def test_an_unplugged_instrument_keeps_what_was_read(tmp_path):
    def unplugged(step, data, command):
        return [(0.0, data[:30]), (0.02, None)] if step > 30 else [(0.0, data)]
    clean = playing([GREEN, *MANY[:2]]).transcript
    player = TranscriptPlayer(clean, time_scale=0.0, distort=unplugged)
    code, _, err = measure(tmp_path, player, "--as", "chart", "--no-calibrate", "--no-wait")
    assert code == 6 and "the line broke" in err
    assert (tmp_path / "spectra" / "readings" / "chart-01-dark-skin" / "001.json").exists()
