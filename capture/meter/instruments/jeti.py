"""What all JETI instruments share: one-byte answers, error numbers, text answers to queries."""
from __future__ import annotations

import re

from spectrabox.capture.meter.instruments.instrument_errors import LineFaultError, NoReplyError
from spectrabox.capture.meter.instruments.interface import (
    NUMBER,
    RESTORE_S,
    Instrument,
    Measured,
    numbers,
    refused,
)
from spectrabox.capture.meter.serial_line import SerialLine, ascii_text, shown
from spectrabox.capture.meter.stated import Stated, printed
from spectrabox.radiometry.spectra.readings import ReadingOutcome

ACK, NAK, BEL, ESC, ENQ, STX, ETX = b"\x06", b"\x15", b"\x07", b"\x1b", b"\x05", b"\x02", b"\x03"
REPLY_S = 5.0
IDENTIFY_S = 0.5            # at each speed in turn
ERRORS = {
    4: "the command is unknown", 7: "a password is needed", 8: "a digit is wrong",
    10: "argument 1 is wrong", 11: "argument 2 is wrong", 12: "argument 3 is wrong",
    13: "argument 4 is wrong",
    20: "the parameter argument is wrong", 21: "the configuration argument is wrong",
    22: "the control argument is wrong",
    23: "the read argument is wrong", 24: "the fetch argument is wrong",
    25: "the measure argument is wrong",
    26: "the calculation argument is wrong", 27: "the calibration argument is wrong",
    101: "a checksum of its memory is wrong", 102: "a checksum of its memory is wrong",
    103: "a user file is wrong", 104: "a user file is wrong", 120: "the light is too strong",
    121: "the light is too weak",
    123: "the automatic exposure failed", 130: "it has no shutter", 131: "no dark result",
    132: "no reference result", 133: "no transmission result", 134: "no radiometric result",
    135: "no colour temperature",
    136: "no colour rendering",
    137: "no dark compensation", 138: "no light result", 139: "no peak result",
    140: "its calibration data are wrong", 141: "a wavelength is outside its calibration",
    147: "the scan was broken off", 160: "no flicker cycle was found", 161: "no trigger came",
    **dict.fromkeys((170, 171, 172, 225, 230, 231, 232), "its memory failed"),
    **dict.fromkeys(range(180, 188), "its calibration file is wrong"),
    **dict.fromkeys(range(190, 198), "its lamp file is wrong"),
    200: "its memory failed", 220: "its output failed", 251: "the wavelength range is wrong",
    280: "its battery is too low", 500: "the trigger failed", 501: "the trigger failed"}
OUTCOMES = {120: ReadingOutcome.TOO_BRIGHT, 121: ReadingOutcome.TOO_DARK,
            123: ReadingOutcome.UNSTEADY,
            160: ReadingOutcome.NO_SYNC, 161: ReadingOutcome.NO_SYNC}


def find_speed(line: SerialLine, speeds: tuple[int, ...]) -> str:
    """The answer to ``*idn?`` at the first speed that is understood, which the line keeps.

    Parameters
    ----------
    line : SerialLine
    speeds : tuple of int
        Baud, to try in turn.

    Raises
    ------
    NoReplyError
        If no speed brings an answer. The question changes nothing on an instrument.
    """
    for speed in speeds:
        line.set_baud(speed)
        line.drain(0.05)
        line.send(b"*idn?\r")
        try:
            reply = ascii_text(line.read_until((b"\r",), IDENTIFY_S), line.name).strip()
        except (NoReplyError, LineFaultError):
            continue
        if reply:
            line.drain(0.05)
            return reply
    raise NoReplyError(f"{line.name}: no answer at {', '.join(map(str, speeds))} baud; check that "
                       "the instrument is on and that this is its port")


def identified(instrument: Instrument, speeds: tuple[int, ...], models: str) -> str:
    """The model as the instrument names itself, after finding its speed where that is to do.

    Parameters
    ----------
    instrument : Instrument
    speeds : tuple of int
        Baud, to try in turn.
    models : str
        Pattern of the models that the driver knows, whatever the case.

    Raises
    ------
    WrongInstrumentError, NoReplyError, LineFaultError
    """
    if not instrument.entered:
        reply = find_speed(instrument.line, speeds)
        if not re.search(models, reply, re.IGNORECASE):
            raise instrument.wrong(reply)
        instrument.entered = True
    model = ask(instrument, "*idn?")
    if not re.search(models, model, re.IGNORECASE):
        raise instrument.wrong(model)
    return model


def ask(instrument: Instrument, command: str) -> str:
    """The text answer to a query, without its line end.

    Parameters
    ----------
    instrument : Instrument
    command : str

    Raises
    ------
    RefusedError, NoReplyError, LineFaultError
    """
    instrument.line.write(command.encode() + b"\r")
    reply = instrument.line.read_until((b"\r", NAK), REPLY_S).lstrip(ENQ + b"\n")
    if reply.endswith(NAK):
        raise refused(instrument, command, error_number(instrument), ERRORS)
    text = ascii_text(reply, instrument.line.name).strip()
    if text.lower().startswith(command.lower()):
        raise LineFaultError(f"{instrument.line.name}: the command {command!r} came back instead "
                             "of an answer; switch the instrument off and on, and check the "
                             "adapter")
    return text


def set_to(instrument: Instrument, command: str) -> None:
    """Send a command that is answered with one byte.

    Parameters
    ----------
    instrument : Instrument
    command : str

    Raises
    ------
    RefusedError, NoReplyError, LineFaultError
    """
    instrument.line.write(command.encode() + b"\r")
    if instrument.line.read_byte(ACK + NAK, REPLY_S, skip=ENQ) == NAK:
        raise refused(instrument, command, error_number(instrument), ERRORS)


def measure(instrument: Instrument, command: str, limit_s: float) -> Measured:
    """How a measurement ended, once it has.

    Parameters
    ----------
    instrument : Instrument
    command : str
        That starts it.
    limit_s : float
        Until the end is reported.

    Raises
    ------
    RefusedError, NoReplyError, LineFaultError
    """
    code = _ended(instrument, command, limit_s)
    if code and code not in OUTCOMES:
        raise refused(instrument, command, code, ERRORS)
    return Measured(OUTCOMES.get(code, ReadingOutcome.MEASURED))


def _ended(instrument: Instrument, command: str, limit_s: float) -> int:
    """0, or the number of the instrument's error."""
    with instrument.measuring(limit_s):
        instrument.line.write(command.encode() + b"\r")
    for wanted, limit in ((ACK, REPLY_S), (BEL, limit_s)):
        if instrument.line.read_byte(wanted + NAK, limit, skip=ENQ) == NAK:
            instrument.measured()
            return error_number(instrument)
    instrument.measured()
    return 0


def cancel(line: SerialLine) -> None:
    """Break off a measurement under way.

    Parameters
    ----------
    line : SerialLine
    """
    line.send(ESC)
    line.drain(0.5)


def obeyed(line: SerialLine, command: bytes) -> bool:
    """Send a command that puts a setting back; whether it is acknowledged.

    Parameters
    ----------
    line : SerialLine
    command : bytes

    Raises
    ------
    NoReplyError, LineFaultError
    """
    line.send(command)
    return line.read_byte(ACK + NAK, RESTORE_S, skip=ENQ) == ACK


def error_number(instrument: Instrument) -> int:
    """The number of the instrument's last error.

    Parameters
    ----------
    instrument : Instrument

    Raises
    ------
    LineFaultError
        If it states none.
    """
    instrument.line.write(b"*stat:err?\r")
    reply = ascii_text(instrument.line.read_until((b"\r",), REPLY_S).lstrip(ENQ),
                       instrument.line.name)
    match = re.fullmatch(r"\s*(?:Error Code:)?\s*(\d+)\b.*", reply.strip())
    if match is None:
        raise LineFaultError(f"{instrument.line.name}: {shown(reply.encode())} states no error "
                             "number; check the cable")
    return int(match[1])


def ask_labelled(instrument: Instrument, command: str, last: str) -> str:
    """The answer to a query that is given in several lines, of which the last holds ``last``.

    Parameters
    ----------
    instrument : Instrument
    command, last : str

    Raises
    ------
    RefusedError, NoReplyError, LineFaultError
    """
    text = ask(instrument, command)
    while last.upper() not in text.upper():
        text += " " + ascii_text(instrument.line.read_until((b"\r",), REPLY_S),
                                 instrument.line.name).strip()
        if len(text) > 200:
            raise LineFaultError(f"{instrument.line.name}: {text[:60]!r} holds no {last}; check "
                                 "the cable")
    return text


def stated(luminance: str, chromaticity: str, line_name: str) -> Stated:
    """Luminance and chromaticity from the answers to the queries for them.

    Parameters
    ----------
    luminance, chromaticity : str
    line_name : str
        For errors.

    Raises
    ------
    LineFaultError
    """
    number = luminance.rpartition(":")[2]
    numbers(number, 1, line_name)
    return Stated(printed(number),
                  printed(after(chromaticity, "Chrom_x", line_name)),
                  printed(after(chromaticity, "Chrom_y", line_name)))


def after(text: str, label: str, line_name: str) -> str:
    """The number after ``label`` in ``X: 1 Y: 2``, as it is printed.

    Parameters
    ----------
    text : str
    label : str
    line_name : str
        For errors.

    Raises
    ------
    LineFaultError
    """
    match = re.search(rf"{re.escape(label)}\s*:?\s*({NUMBER})(?=\s|$)", text, re.IGNORECASE)
    if match is None:
        raise LineFaultError(f"{line_name}: {shown(text.encode())} states no {label}; measure "
                             "again, and check the cable")
    return match[1]
