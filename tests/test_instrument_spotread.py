"""ArgyllCMS's spotread, as a stand-in that prints and saves what the real program (2.3.1) did.

It was talking to an emulated specbos 1211 then, so that every digit is known.
"""
import json
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.capture.meter.instruments.instrument_errors import (
    InstrumentError,
    NoReplyError,
    UntrustedReadingError,
)
from spectrabox.capture.meter.spotread import spotread_reading
from spectrabox.fixtures.meter_transcripts import lamp
from spectrabox.radiometry.appearance import luminance_of
from spectrabox.radiometry.errors import EnvironmentProblem
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.session.cli import app

RECORDED = Path(__file__).resolve().parent.parent / "fixtures" / "spotread"
NM = np.arange(380.0, 781.0)
NO_INSTRUMENT = "spotread: Error - No instrument at port 1"      # the real program's words
STAND_IN = """#!/bin/sh
echo "$@ interactive:$ARGYLL_NOT_INTERACTIVE" >> {folder}/asked
kind=emission
while [ $# -gt 1 ]; do
  case "$1" in -a) kind=ambient;; -N) told=yes;; esac
  shift
done
{before}
cat {folder}/$kind.txt
cp {folder}/$kind.sp "$1"
"""
pytestmark = pytest.mark.skipif(os.name != "posix", reason="the stand-in is a shell script")


@pytest.fixture
def spotread(tmp_path, monkeypatch):
    """A function that installs the stand-in, with lines of shell before it answers."""
    folder = tmp_path / "bin"
    shutil.copytree(RECORDED, folder)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")

    def install(before="", **changed):
        for name, change in changed.items():
            file = folder / name.replace("_", ".")
            file.write_text(change(file.read_text()))
        program = folder / "spotread"
        program.write_text(STAND_IN.format(folder=folder, before=before))
        program.chmod(0o755)
        return folder
    return install


def reading(quantity=Quantity.RADIANCE, said=None, **options):
    shown = [] if said is None else said
    return spotread_reading(quantity, 1, lambda direction, data: None, shown.append, **options)


@pytest.mark.parametrize("quantity, option", [(Quantity.RADIANCE, "-e"),
                                              (Quantity.IRRADIANCE, "-a")])
def test_the_real_programs_words_and_file_are_read_as_the_true_spectrum(spotread, quantity,
                                                                        option):
    folder, shown = spotread(), []
    taken = reading(quantity, shown)
    # The instrument sent five digits.
    np.testing.assert_allclose(taken.spectrum.values, lamp(NM), rtol=5.1e-5)
    np.testing.assert_array_equal(taken.spectrum.grid.nm, NM)
    assert taken.quantity is taken.spectrum.quantity is quantity
    assert (taken.instrument, taken.serial_number, taken.firmware) == ("JETI_SB1211", "2012345",
                                                                       "V3.10")
    assert taken.luminance == pytest.approx(luminance_of(NM, lamp(NM)), rel=1e-4)
    assert f"-v {option} -x -s -c 1 -O " in (folder / "asked").read_text()
    assert "interactive:yes" in (folder / "asked").read_text()
    assert "Place instrument on spot" in "".join(shown)


def test_without_the_program_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(EnvironmentProblem, match=r"spotread is not installed.*apt install argyll"):
        reading()


def test_no_instrument_is_said_in_the_programs_words(spotread):
    spotread(f"echo '{NO_INSTRUMENT}' >&2; exit 1")
    with pytest.raises(InstrumentError, match="No instrument at port 1'; plug the instrument in"):
        reading()


def test_a_usage_text_is_not_repeated(spotread):
    spotread("echo 'Diagnostic: Unknown, inappropriate or no instrument detected' >&2; "
             "for i in 1 2 3 4 5 6; do echo ' -v  Verbose mode'; done; exit 1")
    with pytest.raises(InstrumentError, match="Unknown, inappropriate or no instrument") as error:
        reading()
    assert "Verbose" not in str(error.value)


def test_a_first_run_that_only_calibrates_is_followed_by_one_that_measures(spotread):
    folder = spotread('[ -z "$told" ] && { echo "Spot read needs a calibration before continuing";'
                      ' exit 0; }')
    assert reading().spectrum is not None
    first, second = (folder / "asked").read_text().splitlines()
    assert " -N " not in first and " -N " in second


def test_a_run_without_a_reading_is_an_error_with_its_last_words(spotread):
    spotread("echo 'Got fatal error (USB lost)'; exit 0")
    with pytest.raises(InstrumentError, match="took no reading: 'Got fatal error"):
        reading()


def test_a_program_that_waits_for_somebody_who_is_not_there_is_ended(spotread, tmp_path):
    spotread(f"echo $$ > {tmp_path}/pid; echo 'Place instrument on its white reference'; "
             "exec sleep 60")
    with pytest.raises(NoReplyError, match=r"did not end within 0\.5 s \('Place instrument on"):
        reading(limit_s=0.5)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


@pytest.mark.parametrize("file, change, message", [
    ("emission_txt", lambda text: text.replace("17.105", "17.905", 1), "another spectrum than it"),
    ("emission_sp", lambda text: text.replace("17.105", "27.105", 1), "another spectrum than it"),
    ("emission_txt", lambda text: text.replace("Yxy: 756.11", "Yxy: 856.11")
     .replace("XYZ: 696.240000 756.11", "XYZ: 696.240000 856.11"), "luminance is 756"),
    ("emission_txt", lambda text: text.replace("0.408361", "0.428361"), "chromaticity x"),
    ("emission_txt", lambda text: text.replace("Result is", "Result was"), "printed no result"),
    ("emission_sp", lambda text: text.replace("EMISSION", "REFLECTIVE"), "saved no radiance")])
def test_what_the_program_prints_must_be_what_it_saves(spotread, file, change, message):
    spotread(**{file: change})
    with pytest.raises(UntrustedReadingError, match=message):
        reading()


def measure(*arguments):
    result = CliRunner().invoke(app, ["meter", "measure", *map(str, arguments)])
    return result.exit_code, result.stdout, result.stderr


def test_a_session_is_measured_with_spotread(spotread, tmp_path):
    folder = spotread()
    session = tmp_path / "session"
    code, out, err = measure(session, "--with", "spotread", "--repeat", "2", "--json")
    assert code == 0, err
    assert json.loads(out)["taken"] == 2 and "Place instrument on spot" in err
    lines = (session / "spectra" / "light.csv").read_text().splitlines()
    assert lines[0] == "# quantity: radiance" and "JETI_SB1211 2012345" in lines[2]
    assert [" -N " in line for line in (folder / "asked").read_text().splitlines()] == [False, True]
    transcripts = list((session / "spectra" / "readings").glob("*.transcript"))
    assert len(transcripts) == 1 and "Result is XYZ" in transcripts[0].read_text()
    code, _, err = measure(tmp_path / "room", "--with", "spotread", "--ambient")
    assert code == 0, err
    light = (tmp_path / "room" / "spectra" / "light.csv").read_text()
    assert light.startswith("# quantity: irradiance\n")
    # another instrument of the same kind is not averaged in
    for name in ("emission.txt",):
        file = folder / name
        file.write_text(file.read_text().replace("2012345", "2012399"))
    code, _, err = measure(session, "--with", "spotread", "--repeat", "3")
    assert code == 3 and "JETI_SB1211 2012345 and JETI_SB1211 2012399" in err
    assert not (session / "spectra" / "readings" / "light" / "003.json").exists()


@pytest.mark.parametrize("arguments", [
    ("--with", "chartread"), ("--with", "spotread", "--instrument", "cr250"),
    ("--with", "spotread", "--averages", "2"), ("--with", "spotread", "--port", "COM3"),
    ("--port", "COM3"), ("--instrument", "cr250"),
    ("--port", "COM3", "--instrument", "cr250", "--ambient")])
def test_options_that_do_not_go_together_are_usage_errors(tmp_path, arguments):
    assert measure(tmp_path, *arguments)[0] == 2


@pytest.mark.skipif(shutil.which("spotread") is None, reason="ArgyllCMS is not installed")
def test_the_installed_spotread_knows_the_options_that_are_used():
    program = Path(shutil.which("spotread")).read_bytes()
    for option in (b" -v   ", b" -e   ", b" -a   ", b" -x   ", b" -N   ", b" -O [fname.sp]",
                   b" -c listno", b"ARGYLL_NOT_INTERACTIVE", b" Result is XYZ: %f %f %f, Yxy:",
                   b"Spectrum from %.3f to %.3f nm in %d steps"):
        assert option in program, (option, sys.platform)
