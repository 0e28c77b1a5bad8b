"""Spectra of the instruments that ArgyllCMS drives, taken by its program spotread.

i1Pro, ColorMunki, Spyder, specbos and others speak no text over a serial line; ArgyllCMS knows
them. Its program measures once and leaves a file (``-O``); what it prints says who measured, and
the spectrum and its colour a second time. Calibration, where the instrument asks for it, is between
the program and the operator.
"""
from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from spectrabox.capture.meter.instruments import instrument_errors
from spectrabox.capture.meter.serial_line import Log
from spectrabox.capture.meter.stated import Stated, check_stated, printed
from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.readings import ReadingOutcome, SpectralReading
from spectrabox.radiometry.spectra.spectrum_files import read_spectrum
from spectrabox.radiometry.system.words import shortened

NAME = "spotread"
MODES = {Quantity.RADIANCE: "-e", Quantity.IRRADIANCE: "-a"}
LIMIT_S = 300.0             # without a terminal: nobody can answer what the program asks
END_S = 5.0
ATTEMPTS = 2                # the first may only calibrate: "-O" does that or measures
MAX_OUTPUT = 1_000_000
PRINTED_RTOL = 1e-3         # of the largest value: the file and the print are rounded differently
NUMBERS = r"(-?[\d.]+(?:e[+-]?\d+)?)"
RESULT = re.compile(rf"Result is XYZ: {NUMBERS} {NUMBERS} {NUMBERS}, Yxy: {NUMBERS} {NUMBERS} "
                    rf"{NUMBERS}")
SPECTRUM = re.compile(r"Spectrum from ([\d.]+) to ([\d.]+) nm in (\d+) steps\n(.+)")
IDENTITY = {"instrument": r"Instrument Type: +(.+)|Identificaton: +(.+)|Model: +(.+)",
            "serial_number": r"Serial (?:Number|No): *(\S+)|serial number: *(\S+)",
            "firmware": r"Firmware(?: version)?: +(\S+)"}
Say = Callable[[str], None]


def spotread_reading(quantity: Quantity, number: int, log: Log, say: Say, *,
                     calibrated: bool = False, transcript: str = "",
                     limit_s: float = LIMIT_S) -> SpectralReading:
    """One measurement by the installed spotread.

    Parameters
    ----------
    quantity : Quantity
        RADIANCE, or IRRADIANCE through the instrument's diffuser.
    number : int
        Of the instrument in spotread's list, from 1.
    log : function of (direction, bytes)
        Called with the command line and with what the program prints.
    say : function of str
        Shows the operator what the program prints, its questions among it.
    calibrated : bool
        Do not calibrate again, where the instrument allows that.
    transcript : str
        Name of the file that ``log`` writes, for the record.
    limit_s : float
        Wall clock, where standard input is no terminal.

    Raises
    ------
    EnvironmentProblem
        If spotread is not installed.
    InstrumentError
        If it finds no instrument, takes no reading, or prints another than it saves.
    """
    program = shutil.which(NAME)
    if program is None:
        raise EnvironmentProblem("spotread is not installed: it comes with ArgyllCMS ('sudo apt "
                                 "install argyll' on Debian and Ubuntu, argyllcms.com elsewhere)")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "reading.sp"
        for attempt in range(ATTEMPTS):
            options = ["-N"] if calibrated or attempt else []
            taken_at = datetime.now(UTC).astimezone().isoformat(timespec="seconds")
            text = _run([program, "-v", MODES[quantity], "-x", "-s", "-c", str(number), *options,
                         "-O", str(file)], log, say, limit_s)
            if file.exists():
                return _reading(text, file, quantity, taken_at, transcript)
            if "calibration" not in text:
                break
    raise instrument_errors.InstrumentError(
        f"spotread took no reading: {shortened(_last_words(text))}; run "
        "'spotread -v -e' by hand to see what the instrument asks for")


def _run(command: list[str], log: Log, say: Say, limit_s: float) -> str:
    """What the program prints; the operator answers it through the terminal."""
    log(">", (" ".join(command) + "\n").encode("ascii", "replace"))
    deadline = None if sys.stdin.isatty() else time.monotonic() + limit_s
    # lines in place of single keys: the program leaves the terminal as it is
    environment = {**os.environ, "ARGYLL_NOT_INTERACTIVE": "yes", "LC_ALL": "C"}
    output = bytearray()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          env=environment) as process:
        assert process.stdout is not None
        os.set_blocking(process.stdout.fileno(), False)
        try:
            while True:
                part = process.stdout.read(4096)
                if part:
                    log("<", part)
                    output += part
                    say(part.decode("ascii", "replace"))
                elif part is not None:
                    break
                elif deadline is not None and time.monotonic() > deadline:
                    raise instrument_errors.NoReplyError(
                        f"spotread did not end within {limit_s:g} s "
                        f"({shortened(_last_words(_text(output)))}); run it in a "
                        "terminal, where its questions can be answered")
                else:
                    time.sleep(0.02)
                if len(output) > MAX_OUTPUT:
                    raise instrument_errors.NoReplyError(
                        "spotread prints without end; unplug the instrument, plug "
                        "it in and retry")
        except BaseException:
            _end(process)
            raise
    text = _text(output)
    if process.returncode:
        raise instrument_errors.InstrumentError(
            f"spotread: {shortened(_complaint(text))}; plug the instrument in, "
            "close other programs that use it, and see 'spotread -?' for the "
            "numbers of the instruments (--port)")
    return text


def _reading(text: str, file: Path, quantity: Quantity, taken_at: str,
             transcript: str) -> SpectralReading:
    model, serial_number, firmware = (_stated(pattern, text) for pattern in IDENTITY.values())
    model, serial_number = model or NAME, serial_number or "not stated"
    try:
        saved = read_spectrum(file, role=quantity)
    except InputError as error:
        raise instrument_errors.UntrustedReadingError(
            f"spotread saved no {quantity.name.lower()} ({error}): "
            "measure again, with the adapter that this needs") from None
    result, values = RESULT.search(text), _printed_values(text)
    if result is None or values is None:
        raise instrument_errors.UntrustedReadingError(
            "spotread printed no result with the spectrum that it "
            "saved; measure again")
    if values.shape != saved.values.shape or not np.allclose(
            values, saved.values, rtol=0, atol=PRINTED_RTOL * np.abs(values).max()):
        raise instrument_errors.UntrustedReadingError(
            "spotread saved another spectrum than it printed; measure "
            "again")
    stated = Stated(printed(result[2]), printed(result[5]), printed(result[6]))
    dark = not np.any(saved.values > 0)
    if not dark:
        check_stated(saved.grid.nm, saved.values, stated, NAME)
    outcome = ReadingOutcome.TOO_DARK if dark else ReadingOutcome.MEASURED
    spectrum = None if dark else Spectrum(saved.grid, saved.values, quantity,
                                          f"{model} {serial_number}, {taken_at}")
    return SpectralReading(spectrum, outcome, None if dark else quantity, model, serial_number,
                           firmware, None, float(result[2]), taken_at, transcript, ())


def _printed_values(text: str) -> np.ndarray | None:
    """The printed spectrum in W; spotread prints mW."""
    match = SPECTRUM.search(text)
    if match is None:
        return None
    cells = match[4].split(",")
    if len(cells) != int(match[3]):
        return None
    try:
        return np.array([float(cell) for cell in cells]) / 1000
    except ValueError:
        return None


def _stated(pattern: str, text: str) -> str | None:
    match = re.search(pattern, text)
    return next((group.strip() for group in match.groups() if group), None) if match else None


def _complaint(text: str) -> str:
    """What the program says of its failure: a line of its own, or its last words."""
    match = re.search(r"(?:Error - |Diagnostic: )(.+)", text)
    return match[1].strip() if match else _last_words(text)


def _last_words(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return " ".join(lines[-2:]) if lines else "it printed nothing"


def _text(output: bytearray) -> str:
    return output.decode("ascii", "replace").replace("\r", "\n")


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    with suppress(subprocess.TimeoutExpired):
        process.wait(END_S)
        return
    process.kill()
