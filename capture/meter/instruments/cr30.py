"""CR30, a hand spectrophotometer with a lamp of its own: reflectance at 400 to 700 nm, step 10 nm.

Packets of 60 bytes go both ways. The first two bytes name the command, a third the part of it, and
the last is the sum of the others, modulo 256. Known from genuine traffic with the maker's program,
recorded in both directions, and the notes of who decoded it (github.com/itohio/color-science, MIT
licence). Not connected yet.
"""
from __future__ import annotations

import functools
import re
import struct
from datetime import UTC, datetime
from types import MappingProxyType

import numpy as np

from spectrabox.capture.meter import serial_line, stated
from spectrabox.capture.meter.instruments import instrument_errors, interface
from spectrabox.radiometry import appearance, errors
from spectrabox.radiometry.published import published_tables
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.readings import ReadingOutcome

PACKET_BYTES = 60
IDENTITY = tuple(f"aa0a{part:02x}" for part in range(4))
WHO = bytes.fromhex(IDENTITY[0])
START = ("bb17", "bb13")                # sent once after it said who it is, as its own program does
CHECK_TEXT = b"Check"
TRIGGER, HEADER = "bb0100", bytes.fromhex("bb0109")
PARTS = tuple(f"bb01{part:02x}" for part in range(0x10, 0x14))
PART_VALUES = (12, 12, 7)               # of a spectrum in the first three; the fourth repeats
REPEATED_BYTES, REPEATED_AT = 20, 34    # the first five values, in the fourth
VALUES_AT = 6
BANDS_NM = np.arange(400.0, 701.0, 10.0)
REPLY_S = 2.0                           # answers in 0.05 s
MEASURE_S = 10.0                        # answers in 0.3 s
CALIBRATE_S = 10.0                      # answers in 0.3 s
CALIBRATIONS = {"white": ("bb11", "put it on its white tile"),
                "black": ("bb10", "hold its opening into the air, away from any surface and light, "
                          "or on its black trap")}
POSSIBLE = (-0.05, 2.0)                 # reflectance; fluorescent paper reaches 1.3
# Under D65 for the 10 degree observer, as its display has it: with the sum over its 31 bands this
# gives the L*a*b* of 22 recorded measurements within 0.004 of its program's.
DISPLAY_WHITE = np.array([94.81, 100.0, 107.32])


class Cr30(interface.Instrument):
    """CR30 hand spectrophotometer."""

    name = "cr30"
    family = "CR30"
    baud = 9600
    errors = MappingProxyType({})
    quantities = (Quantity.REFLECTANCE,)
    checks_bytes = True
    calibrations = MappingProxyType({which: advice for which, (_, advice) in CALIBRATIONS.items()})
    has_button = True

    def settings(self, wanted: interface.MeterSettings) -> None:
        if wanted != interface.MeterSettings():
            raise errors.InputError("a CR30 has no exposure, averages or sync to set: leave out "
                                    "--integration-ms, --averages and --sync-hz, and use --repeat")

    def calibrate(self, which: str) -> None:
        command, _ = CALIBRATIONS[which]
        if self._exchange(command, CALIBRATE_S)[VALUES_AT] != 1:
            raise instrument_errors.RefusedError(
                f"the CR30 did not confirm its {which} calibration: look at its "
                f"display, then {CALIBRATIONS[which][1]} and try again")
        self.calibrated[which] = datetime.now(UTC).astimezone().isoformat(timespec="seconds")

    def pressed(self, limit_s: float) -> bool:
        return self.line.await_bytes(limit_s)

    def measure(self) -> interface.Ended:
        if self.by_button:
            header = self._packet(HEADER, MEASURE_S)
        else:
            with self.measuring(MEASURE_S):
                self._send(TRIGGER)
            header = self._packet(HEADER, MEASURE_S)
            self.measured()
        first, points, step = header[4] * 10.0, header[5], header[6]
        nm = self.grid(points, first, first + (points - 1) * step, step)
        if not np.array_equal(nm, BANDS_NM):
            raise instrument_errors.UntrustedReadingError(
                f"{self.line.name}: the instrument states {nm.size} bands from {nm[0]:g} to "
                f"{nm[-1]:g} nm; known are {BANDS_NM.size} from 400 to 700 nm")
        return ReadingOutcome.MEASURED, ()

    def read(self) -> interface.HeldResult:
        packets = [self._exchange(part, REPLY_S) for part in PARTS]
        values = [value for packet, count in zip(packets[:3], PART_VALUES, strict=True)
                  for value in struct.unpack_from(f"<{count}f", packet, VALUES_AT)]
        if packets[0][VALUES_AT:VALUES_AT + REPEATED_BYTES] != \
                packets[3][REPEATED_AT:REPEATED_AT + REPEATED_BYTES]:
            raise instrument_errors.UntrustedReadingError(
                f"{self.line.name}: the parts of the spectrum are not of "
                "one measurement; measure again")
        reflectance = np.array(values) / 100
        if not (np.isfinite(reflectance).all() and reflectance.min() > POSSIBLE[0]
                and reflectance.max() < POSSIBLE[1] and np.any(reflectance)):
            raise instrument_errors.UntrustedReadingError(
                f"{self.line.name}: reflectances from {reflectance.min():.3g} to "
                f"{reflectance.max():.3g} arrived, which cannot be; calibrate, then measure again")
        return interface.HeldResult(BANDS_NM, reflectance, Quantity.REFLECTANCE, stated.Stated(),
                                    None, tuple(packet.hex() for packet in packets),
                          lab=display_lab(reflectance))

    def _enter(self) -> None:
        self.entered = True

    def _identity(self) -> interface.Identity:
        model = self._ask(IDENTITY[0]).split(" ")
        if model[-1] != "CR30":
            raise self.wrong(" ".join(model))
        serial, firmware, _ = (self._ask(command).split(" ") for command in IDENTITY[1:])
        for command in START:
            self._exchange(command, REPLY_S)
        return interface.Identity(model[-1], serial[0], " ".join((*firmware[::-1], *serial[1:])))

    def _ask(self, command: str) -> str:
        """The words of the answer, by blanks."""
        self._send(command)
        packet = self._packet(bytes.fromhex(command), REPLY_S)
        return " ".join(text.decode() for text in re.findall(rb"[\x21-\x7e]{4,}", packet[2:58]))

    def _exchange(self, command: str, limit_s: float) -> bytes:
        self._send(command)
        return self._packet(bytes.fromhex(command), limit_s)

    def _send(self, command: str) -> None:
        """Ask; presses of the button that nobody waited for are dropped."""
        waiting = self.line.drain(0.0)
        if presses := [waiting[at:at + PACKET_BYTES] for at in range(0, len(waiting), PACKET_BYTES)
                       if not (is_packet(waiting[at:at + PACKET_BYTES])
                               and waiting[at:at + 3] == HEADER)]:
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: the instrument sent {serial_line.shown(presses[0])} "
                "unasked; check that no other program uses this port, then "
                "measure again")
        self.line.write(request(command))

    def _packet(self, start: bytes, limit_s: float) -> bytes:
        """The next packet, which must begin with some bytes."""
        if start == WHO and self.line.await_bytes(limit_s) and self.line.waiting[0] not in WHO:
            raise self.wrong(self.line.drain(0.1).decode("ascii", "replace"))
        packet = self.line.read_count(PACKET_BYTES, limit_s)
        if not is_packet(packet) or not packet.startswith(start):
            self.line.drain(0.1)
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: {serial_line.shown(packet.rstrip(bytes(1)))} is no answer "
                f"to {start.hex(' ')}: its check byte or its beginning is wrong; "
                "check the cable, then measure again")
        return packet


def request(command: str) -> bytes:
    """A request as the CR30 takes it: the command, zeros, 255 and the check byte.

    Parameters
    ----------
    command : str
        Two or three bytes in hexadecimal.
    """
    text = bytes(10) + CHECK_TEXT if command == START[1] else b""
    body = (bytes.fromhex(command).ljust(3, bytes(1)) + text).ljust(PACKET_BYTES - 2, bytes(1))
    return body + bytes([0xFF, (sum(body) + 0xFF) % 256])


def is_packet(data: bytes) -> bool:
    """Whether bytes are a whole packet with its check byte right.

    Parameters
    ----------
    data : bytes
    """
    return len(data) == PACKET_BYTES and data[0] in (0xAA, 0xBB) \
        and sum(data[:-1]) % 256 == data[-1]


def display_lab(reflectance: np.ndarray) -> tuple[float, float, float]:
    """L*, a*, b* as the instrument shows it: D65, 10 degree observer, summed over its bands.

    Parameters
    ----------
    reflectance : (31,) array
        At 400 to 700 nm in steps of 10 nm.
    """
    lightness, a, b = appearance.lab_from_xyz(_display_weights() @ reflectance, DISPLAY_WHITE)
    return float(lightness), float(a), float(b)


@functools.cache
def _display_weights() -> np.ndarray:
    """Weights (3, 31) of X, Y, Z, with Y = 100 for a reflectance of 1."""
    nm, observer = published_tables.published_curves(published_tables.OBSERVERS,
                                                     "CIE 1964 10 Degree Standard Observer")
    light_nm, (light,) = published_tables.published_curves(published_tables.LIGHTS, "D65")
    weights = np.array([np.interp(BANDS_NM, nm, curve) for curve in observer]) \
        * np.interp(BANDS_NM, light_nm, light)
    return np.asarray(100 * weights / weights[1].sum())
