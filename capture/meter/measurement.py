"""A trusted reading: measured once, read twice, compared with the instrument's own figures.

No instrument's text protocol has a checksum. A changed digit is caught by reading the held result
twice and comparing byte for byte, and by what the instrument computed from the same spectrum
(stated.py). Where packets have a check byte, they are read once.
"""
from __future__ import annotations

import contextlib
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import numpy as np

from spectrabox.capture.meter import serial_line, stated
from spectrabox.capture.meter.instruments import drivers, instrument_errors, interface
from spectrabox.radiometry import appearance, grid
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.readings import ReadingOutcome, SpectralReading

READS = 4                   # of one held result, until two in a row agree
VISIBLE_NM = (400.0, 700.0)


@contextlib.contextmanager
def open_instrument(
        name: str, port: str, log: serial_line.Log, pace: serial_line.Pace | None = None,
        held: serial_line.Hold = contextlib.nullcontext) -> Iterator[interface.Instrument]:
    """A driver on an open line; the instrument is left as it was, however the block ends.

    Where ``held`` keeps interrupts back, a command under way is finished, the instrument's answer
    or the end of its measurement is waited for, then settings are put back. What could not be put
    back stays in ``restore`` of the driver.

    Parameters
    ----------
    name : str
        As ``driver_named`` takes it.
    port : str
        As ``open_line`` takes it.
    log : function of (direction, bytes)
        Called with everything that passes.
    pace : Pace or None
        None for real time.
    held : function that gives a context, optional
        Nothing interrupts a block that is run in it, at most one interrupt any other. By default
        nothing is kept back.

    Raises
    ------
    InputError, InstrumentError
    """
    driver = drivers.driver_named(name)
    instrument = driver(serial_line.open_line(
        port, driver.baud, log, pace, held, rtscts=driver.rtscts,
        character_pause_s=driver.character_pause_s))
    with contextlib.ExitStack() as closing:
        try:
            try:
                yield instrument
            finally:
                closing.enter_context(held())
        finally:  # of its own: an interrupt may fall before the hold, and no second one is raised
            instrument.close()


def trusted_identity(instrument: interface.Instrument) -> interface.Identity:
    """Who answers, asked twice unless replies have a check byte: a changed digit in a serial number
    would otherwise go unseen.

    Parameters
    ----------
    instrument : Instrument

    Raises
    ------
    InstrumentError
    """
    first = instrument.identify()
    second = first if instrument.checks_bytes else instrument.identify()
    if first != second:
        raise instrument_errors.UntrustedReadingError(
            f"{instrument.line.name}: asked twice, the instrument named "
            f"itself {first} and {second}; check the cable")
    return first


def take_reading(instrument: interface.Instrument, identity: interface.Identity, *,
                 transcript: str = "") -> SpectralReading:
    """Measure once and read the result until two readings in a row agree, or one whose bytes the
    instrument lets us check.

    Parameters
    ----------
    instrument : Instrument
        Identified and set.
    identity : Identity
    transcript : str
        Name of the file in which the exchange is kept, for the record.

    Raises
    ------
    InstrumentError
        If the instrument fails, or its replies do not agree with each other.
    """
    taken_at = datetime.now(UTC).astimezone().isoformat(timespec="seconds")
    outcome, warnings = instrument.measure()
    facts: dict[str, Any] = {
        "outcome": outcome, "instrument": identity.model,
        "serial_number": identity.serial_number,
        "firmware": identity.firmware, "taken_at": taken_at, "transcript": transcript}
    if not outcome.has_spectrum:
        return SpectralReading(spectrum=None, quantity=None, integration_ms=None, luminance=None,
                               findings=warnings, **facts)
    held = _trusted_result(instrument)
    luminance = None if held.stated.luminance is None else held.stated.luminance[0]
    if _is_dark(held):
        facts["outcome"] = ReadingOutcome.TOO_DARK
        return SpectralReading(spectrum=None, quantity=None, integration_ms=held.integration_ms,
                               luminance=luminance, findings=warnings, **facts)
    if held.quantity in (Quantity.RADIANCE, Quantity.IRRADIANCE):
        stated.check_stated(held.nm, held.values, held.stated, instrument.line.name)
    source = f"{identity.model} {identity.serial_number}, {taken_at}"
    spectrum = Spectrum(grid.grid_from_nm(held.nm), held.values, held.quantity, source)
    return SpectralReading(spectrum=spectrum, quantity=held.quantity,
                           integration_ms=held.integration_ms, luminance=luminance,
                           findings=(*warnings, *negative_values(held),
                                     *not_checked(held), *not_calibrated(instrument)),
                           lab=held.lab, calibration=_calibration(instrument), **facts)


def _trusted_result(instrument: interface.Instrument) -> interface.HeldResult:
    before: interface.HeldResult | None = None
    last: instrument_errors.InstrumentError | None = None
    silent = 0
    for _ in range(READS):
        try:
            held = instrument.read()
            if instrument.checks_bytes:
                return held
            if before is not None and held.raw == before.raw:
                instrument.line.drain(0.05)
                return held
            before = held
        except instrument_errors.NoReplyError as error:
            silent += 1
            if silent > 1:
                raise
            before, last = None, error
        except (instrument_errors.LineFaultError, instrument_errors.UntrustedReadingError,
                instrument_errors.RefusedError) as error:
            before, last = None, error
        instrument.line.drain(0.1)
    raise last or instrument_errors.UntrustedReadingError(
        f"{instrument.line.name}: {READS} readings of the same "
        "result all differ; check the cable, then measure again")


def _is_dark(held: interface.HeldResult) -> bool:
    stated = held.stated.luminance
    return not np.any(held.values > 0) or (stated is not None and stated[0] <= 0
                                           and appearance.luminance_of(held.nm, held.values) <= 0)


def negative_values(held: interface.HeldResult) -> list[Finding]:
    """Values in the visible range that are negative: the light is near the instrument's noise."""
    inside = (held.nm >= VISIBLE_NM[0]) & (held.nm <= VISIBLE_NM[1])
    negative = int(np.sum(held.values[inside] < 0))
    return [Finding("meter.negative-values", Severity.NOTE, values={
        "negative": negative, "values": int(inside.sum())})] if negative else []


def not_checked(held: interface.HeldResult) -> list[Finding]:
    """A spectrum of light without a luminance to check it against."""
    stated = held.stated.luminance is not None or held.quantity is Quantity.REFLECTANCE
    return [] if stated else [Finding("meter.no-luminance", Severity.NOTE)]


def not_calibrated(instrument: interface.Instrument) -> list[Finding]:
    """Calibrations that the instrument wants and did not get since it was opened."""
    missing = [which for which in instrument.calibrations if which not in instrument.calibrated]
    return [Finding("meter.not-calibrated", Severity.NOTE, values={"missing": missing})] \
        if missing else []


def _calibration(instrument: interface.Instrument) -> str | None:
    """What the instrument was calibrated with and when; None of one that needs no calibration."""
    if not instrument.calibrations:
        return None
    return ", ".join(f"{which} {when}" for which, when in instrument.calibrated.items()) \
        or "none before these readings"
