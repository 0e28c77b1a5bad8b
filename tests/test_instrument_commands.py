"""The meter commands end to end: a killed series goes on, an interrupted instrument is given
back.
"""
import csv
import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.capture.transcripts.player import TranscriptPlayer
from spectrabox.capture.transcripts.transcript import read_transcript
from spectrabox.fixtures.meter_transcripts import FOLDER, clean_meters
from spectrabox.session.cli import app

ROOT = Path(__file__).resolve().parent.parent
CR250 = next(meter for meter in clean_meters() if meter.name == "cr250")
PACE = {"SPECTRABOX_METER_PACE": "0.01"}


def hear_interrupts():
    """A shell's background job ignores SIGINT, and its children would too."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(*arguments, **options):
    return subprocess.Popen([sys.executable, "-m", "spectrabox", "meter", *map(str, arguments)],
                            cwd=ROOT, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE,
                            env={**os.environ, **PACE, "PYTHONPATH": str(ROOT)},
                            preexec_fn=hear_interrupts, **options)


def run(*arguments, typed=""):
    result = CliRunner().invoke(app, ["meter", *map(str, arguments)], input=typed, env=PACE)
    return result.exit_code, result.stdout, result.stderr


def play(time_scale=0.0):
    return TranscriptPlayer(read_transcript(FOLDER / "cr250.transcript"), time_scale=time_scale,
                            strict=False)


def options(player, *more):
    return ("--port", player.port, "--instrument", "cr250", "--averages", "2", *more)


def wait_for(condition, seconds=30):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.01)


def test_a_series_killed_in_the_middle_loses_nothing_and_goes_on(tmp_path):
    readings = tmp_path / "spectra" / "readings" / "light"
    with play(time_scale=0.05) as player:
        process = start("measure", tmp_path, *options(player, "--repeat", "12"))
        wait_for(lambda: len(list(readings.glob("0*.json"))) >= 2)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        kept = {path.name: path.read_bytes() for path in readings.glob("0*.json")}
        assert 2 <= len(kept) < 12
        # the instrument ends the reading that it was told to take, and says so to nobody
        time.sleep(2.0)
        code, out, err = run("measure", tmp_path, *options(player, "--repeat", "12", "--json"))
    assert code == 0, err
    facts = json.loads(out)
    assert facts["taken"] == 12 - len(kept) and facts["series"][0]["readings"] == 12
    assert all((readings / name).read_bytes() == data for name, data in kept.items())
    with (tmp_path / "spectra" / "light.csv").open() as stream:
        rows = list(csv.reader(line for line in stream if not line.startswith("#")))[1:]
    # nine digits are written
    np.testing.assert_allclose([float(row[1]) for row in rows], CR250.values, rtol=5e-9)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupted_measurement_gives_the_instrument_back(tmp_path, number):
    with play(time_scale=0.25) as player:  # M takes 1 s
        process = start("measure", tmp_path, *options(player))
        wait_for(lambda: b"SM ExposureX 2\r" in player.heard and player.heard.endswith(b"M\r"))
        process.send_signal(number)
        _, err = process.communicate(timeout=30)
        wait_for(lambda: player.heard.endswith(b"SM ExposureX 1\r"))
    assert process.returncode == 130 and "interrupted" in err


def test_a_chart_is_walked_through_and_goes_on_with_the_patch_that_is_next(tmp_path):
    with play() as player:
        code, _, err = run("measure", tmp_path, *options(player, "--as", "white"))
        assert code == 0, err
        code, _, err = run("measure", tmp_path, *options(player, "--as", "chart"), typed="\n\nq\n")
        assert code == 4 and "chart-01-dark-skin" in err
        assert "2 of 24 patches are measured and kept" in err
        code, out, err = run("measure", tmp_path,
                             *options(player, "--as", "chart", "--no-wait", "--json",
                                      "--white-reflectance", "0.5"))
    assert code == 0, err
    assert json.loads(out)["taken"] == 22
    with (tmp_path / "spectra" / "chart.csv").open() as stream:
        lines = stream.readlines()
    assert lines[0] == "# quantity: reflectance\n"
    rows = list(csv.reader(line for line in lines if not line.startswith("#")))
    assert len(rows[0]) == 25 and rows[0][1] == "01-dark-skin"
    # Patch and white are the same recording here: a ratio of 1 times 0.5.
    assert {cell for row in rows[1:] for cell in row[1:]} == {"0.5"}


def test_a_dark_reading_ends_with_the_instruments_reason_and_no_file(tmp_path):
    dark = read_transcript(FOLDER / "cr250-too-dark.transcript")
    with TranscriptPlayer(dark, time_scale=0.0, strict=False) as player:
        code, out, _ = run("measure", tmp_path, *options(player, "--json"))
    assert code == 4 and "the light is too weak" in json.loads(out)["error"]
    assert not (tmp_path / "spectra" / "light.csv").exists()
    assert (tmp_path / "spectra" / "readings" / "light" / "001.json").exists()


def test_a_recording_that_was_cut_says_where_it_ends(tmp_path):
    lines = (FOLDER / "pr655.transcript").read_text().splitlines(keepends=True)
    for count in (6, 20, len(lines) - 8):
        cut = tmp_path / "cut.transcript"
        cut.write_text("".join(lines[:count]))
        code, _, err = run("replay", cut)
        assert code == 6 and "the recording ends" in err and "cut" in err
    code, out, _ = run("replay", FOLDER / "pr655.transcript")
    assert code == 0 and "nm" in out and "█" in out


def test_identify_says_who_answers():
    with play() as player:
        code, out, _ = run("identify", "--port", player.port, "--instrument", "CR-250", "--json")
    assert code == 0
    assert json.loads(out) | {"port": ""} == {"instrument": "CR-250", "serial_number": "A00102",
                                              "firmware": "1.36", "port": ""}


def test_a_missing_port_ends_with_the_instruments_exit_code(tmp_path):
    code, out, _ = run("identify", "--port", "/dev/ttyNONE", "--instrument", "cr250", "--json")
    assert code == 6 and "there is no port /dev/ttyNONE" in json.loads(out)["error"]


def test_replay_shows_a_recording_and_that_it_is_synthetic(tmp_path):
    code, out, _ = run("replay", FOLDER / "cs2000.transcript", "--draw", "--plot",
                       tmp_path / "a.png")
    assert code == 0 and "synthetic" in out and "█" in out and (tmp_path / "a.png").exists()


def test_wrong_options_are_usage_errors(tmp_path):
    for word, option in (("moon", "--as"), ("paint", "--name")):
        code, _, err = run("measure", tmp_path, "--port", "x", "--instrument", "cr250", "--as",
                           word)
        assert code == 2 and option in err, err


def play_with_serial(number):
    """The same instrument with another serial number."""
    transcript = read_transcript(FOLDER / "cr250.transcript")
    events = tuple(dataclasses.replace(event, data=event.data.replace(b"A00102", number))
                   for event in transcript.events)
    return TranscriptPlayer(dataclasses.replace(transcript, events=events), time_scale=0.0,
                            strict=False)


def test_two_instruments_give_no_mean_and_no_reflectance_without_their_calibrations(tmp_path):
    with play() as player:
        assert run("measure", tmp_path, *options(player))[0] == 0
        assert run("measure", tmp_path, *options(player, "--as", "white"))[0] == 0
    light = (tmp_path / "spectra" / "light.csv").read_bytes()
    factors = {}
    for serial, factor in (("A00102", 1.0), ("B7", 1.1)):
        factors[serial] = tmp_path / f"{serial}.csv"
        factors[serial].write_text(f"# quantity: relative\nnm,value\n380,{factor}\n780,{factor}\n")
    with play_with_serial(b"B7") as player:
        for more in (("--repeat", "2"), ("--as", "paint", "--name", "red")):
            code, _, err = run("measure", tmp_path, *options(player, *more))
            assert code == 3 and "CR-250 A00102 and CR-250 B7" in err and "--calibration" in err
            assert not any(command == b"M\r" for command in player.obeyed)
        assert (tmp_path / "spectra" / "light.csv").read_bytes() == light
        both = [word for serial, file in factors.items()
                for word in ("--calibration", f"{serial}={file}")]
        code, _, err = run("measure", tmp_path, *options(player, "--as", "paint", "--name", "red",
                                                         *both))
    assert code == 0, err
    lines = (tmp_path / "spectra" / "red.csv").read_text().splitlines()
    assert "each by its calibration" in lines[2]
    values = [float(line.split(",")[1]) for line in lines if line[0].isdigit()]
    # both read the same, and the second instrument's factor is 1.1; nine digits are written
    np.testing.assert_allclose(values, 0.99 * 1.1, rtol=5e-9)


def test_a_paint_does_not_take_the_lamps_file(tmp_path):
    with play() as player:
        assert run("measure", tmp_path, *options(player))[0] == 0
        assert run("measure", tmp_path, *options(player, "--as", "white"))[0] == 0
        light = (tmp_path / "spectra" / "light.csv").read_bytes()
        code, _, err = run("measure", tmp_path, *options(player, "--as", "paint", "--name",
                                                         "light"))
    assert code == 3 and "something measured as light" in err
    assert (tmp_path / "spectra" / "light.csv").read_bytes() == light
