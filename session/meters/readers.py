"""Who takes readings, lines that an operator types meanwhile, and a chart as characters of a
terminal.
"""


from __future__ import annotations

import contextlib
import functools
import io
import os
import select
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol, TypeAlias

import numpy as np

from spectrabox.capture.meter import measurement, measurement_series, serial_line, spotread
from spectrabox.capture.meter.instruments import interface
from spectrabox.capture.transcripts import player, transcript
from spectrabox.radiometry import appearance, errors, grid
from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.charts.references import reference_reflectances
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.readings import SpectralReading
from spectrabox.radiometry.system.words import plain
from spectrabox.session.terminal.progress_display import held

LOOK_S = 0.1
NO_MORE = "q"       # what an ended input says


class Keyboard:
    """Standard input, line by line, without waiting for a line longer than wanted.

    Not by a thread: one that waits for input keeps the process from ending.
    """

    def __init__(self) -> None:
        self._typed = b""
        self._ended = False

    def line(self, limit_s: float | None) -> str | None:
        """The next line, small letters without blanks around; "q" at the end of the input.

        Parameters
        ----------
        limit_s : float or None
            None where none was typed within it; without a limit it is waited for.
        """
        deadline = None if limit_s is None else time.monotonic() + limit_s
        while b"\n" not in self._typed and not self._ended:
            left = LOOK_S if deadline is None else max(deadline - time.monotonic(), 0.0)
            if not self._take(min(left, LOOK_S)) and deadline is not None \
                    and time.monotonic() >= deadline:
                return None
        line, _, self._typed = self._typed.partition(b"\n")
        if self._ended and not line:
            return NO_MORE
        return line.decode(errors="replace").strip().lower()

    def _take(self, limit_s: float) -> bool:
        """Whether something was typed within a time."""
        try:
            descriptor = sys.stdin.fileno()
        except (io.UnsupportedOperation, AttributeError, ValueError):    # not a real input
            line = sys.stdin.readline() if sys.stdin is not None else ""
            self._typed += line.encode()
            self._ended = not line
            return True
        if not _is_ready(descriptor, limit_s):
            return False
        typed = os.read(descriptor, 4096)
        self._typed += typed
        self._ended = not typed
        return True


def _is_ready(descriptor: int, limit_s: float) -> bool:
    if os.name != "nt":
        return bool(select.select([descriptor], [], [], limit_s)[0])
    if not os.isatty(descriptor):
        return True
    import msvcrt
    deadline = time.monotonic() + limit_s
    while not msvcrt.kbhit():  # type: ignore[attr-defined,unused-ignore]
        if time.monotonic() >= deadline:
            return False
        time.sleep(0.02)
    return True


# ---- who takes readings: an instrument on its own line, or the installed spotread ----------------

REPLAY_LIMIT_S = 2.0
Check: TypeAlias = Callable[[measurement_series.Maker],
                            None]  # objects to an instrument that may not measure here


class Reader(Protocol):
    """Takes readings, once ``begin`` has let it."""

    @property
    def meter(self) -> interface.Instrument | None:
        """The instrument; None of one that another program drives."""

    def begin(self, check: Check) -> None:
        """Say who it is to a check, and take its settings."""

    def take(self) -> SpectralReading:
        """The next reading."""


Source: TypeAlias = Callable[[Path], contextlib.AbstractContextManager[Reader]]


class LineReader:
    """An instrument on its own line, set as wanted once ``begin`` lets it measure."""

    def __init__(self, meter: interface.Instrument, wanted: interface.MeterSettings,
                 log: transcript.TranscriptWriter) -> None:
        self.meter: interface.Instrument = meter
        self._wanted = wanted
        self._log = log
        self._identity: interface.Identity | None = None
        self._count = 0

    def begin(self, check: Check) -> None:
        identity = measurement.trusted_identity(self.meter)
        check((identity.model, identity.serial_number))
        self.meter.settings(self._wanted)
        self._identity = identity

    def take(self) -> SpectralReading:
        assert self._identity is not None, "begin comes first"
        reading = measurement.take_reading(self.meter, self._identity,
                                           transcript=self._log.path.name)
        self._count += 1
        self._log.note("readings", str(self._count))
        return reading


class SpotreadReader:
    """The installed spotread, which says who it is with its first reading."""

    meter: interface.Instrument | None = None

    def __init__(self, number: int, quantity: Quantity, log: transcript.TranscriptWriter) -> None:
        self._number, self._quantity, self._log = number, quantity, log
        self._check: Check | None = None
        self._calibrated = False

    def begin(self, check: Check) -> None:
        self._check = check

    def take(self) -> SpectralReading:
        reading = spotread.spotread_reading(self._quantity, self._number, self._log,
                                   lambda text: print(plain(text), end="", file=sys.stderr,
                                                      flush=True),
                                   calibrated=self._calibrated, transcript=self._log.path.name)
        if self._check is not None:
            self._check((reading.instrument, reading.serial_number))
        self._calibrated = True
        return reading


@contextlib.contextmanager
def line_reader(folder: Path, instrument: str, port: str,
                wanted: interface.MeterSettings) -> Iterator[Reader]:
    """An instrument by its name and port; what passes is recorded in a folder.

    Parameters
    ----------
    folder : Path
    instrument, port : str
    wanted : MeterSettings
    """
    with player.record(folder, instrument, wanted) as log, \
            operated_instrument(instrument, port, log) as meter:
        yield LineReader(meter, wanted, log)


@contextlib.contextmanager
def spotread_reader(folder: Path, number: int, ambient: bool) -> Iterator[Reader]:
    """The installed spotread; what it prints is recorded in a folder.

    Parameters
    ----------
    folder : Path
    number : int
        Of the instrument in its list.
    ambient : bool
        Irradiance, through the diffuser.
    """
    now = datetime.now(UTC)
    log = transcript.TranscriptWriter(
        folder / f"{now:%Y%m%dT%H%M%S.%f}.transcript",
        {"instrument": spotread.NAME, "recorded": now.isoformat(timespec="seconds")})
    with contextlib.closing(log):
        yield SpotreadReader(number, Quantity.IRRADIANCE if ambient else Quantity.RADIANCE, log)


@contextlib.contextmanager
def operated_instrument(name: str, port: str,
                        log: serial_line.Log) -> Iterator[interface.Instrument]:
    """An open instrument that is left as it was found, or else the operator is told so.

    Parameters
    ----------
    name, port : str
    log : function of (direction, bytes)
    """
    opened: list[interface.Instrument] = []
    try:
        with measurement.open_instrument(name, port, log, meter_pace(), held) as meter:
            opened.append(meter)
            try:
                yield meter
            except KeyboardInterrupt:
                print("interrupted: the instrument ends what it was told to do and gets its "
                      "settings back; its measurement may have to end first", file=sys.stderr,
                      flush=True)
                raise
    finally:
        if opened and opened[0].restore:
            commands = ", ".join(serial_line.shown(command) for command in opened[0].restore)
            print(f"spectrabox: {port}: the {opened[0].family} did not confirm that its settings "
                  f"were put back ({commands}): look at its settings, or switch it off and on",
                  file=sys.stderr)


def meter_pace() -> serial_line.Pace:
    """Real time; a recording played for a test may run faster."""
    text = os.environ.get("SPECTRABOX_METER_PACE", "1")
    try:
        scale = float(text)
    except ValueError:
        raise errors.InputError(
            f"SPECTRABOX_METER_PACE is {text!r}; a number such as 0.01 is needed") from None
    return serial_line.Pace() if scale == 1 else serial_line.Pace(scale,
                                                                  shortest_limit_s=REPLAY_LIMIT_S)


# ---- a chart as characters of a terminal: what is measured, what comes next ----------------------

CELL, NARROW = 8, 5         # characters; of a chart that is too wide for a terminal
MANY_COLUMNS, MANY_ROWS = 8, 6
NEARER = 10.0               # by which another patch must be nearer in L*a*b* before it is named
UNMEASURED = 0.35           # of its colour, over the terminal's background
UNKNOWN = 0.5               # grey of a patch of which nothing is published


def chart_picture(chart: Chart, measured: Mapping[int, Spectrum | None], following: int, *,
                  colours: bool) -> str:
    """The patches row by row, each in the colour that was measured or else is usual.

    Parameters
    ----------
    chart : Chart
    measured : mapping
        From the index of a patch to its reflectance, or to None of one measured as a light.
    following : int
        Index of the patch that comes next.
    colours : bool
        The terminal shows colours; else names alone say what is done.
    """
    width = CELL if chart.columns <= MANY_COLUMNS else NARROW
    named = max(map(len, chart.names)) <= NARROW - 2        # as printed beside the patches
    rows = []
    for row in range(chart.rows):
        cells = range(row * chart.columns, (row + 1) * chart.columns)
        texts = [_mark(chart.names[index] if named else f"{index + 1}", index, measured, following,
                       width) for index in cells]
        for words in (texts, [""] * chart.columns) if colours and chart.rows <= MANY_ROWS \
                else (texts,):
            rows.append(" ".join(
                _cell(chart, index, f"{text:^{width}}", measured, following) if colours
                else f"{text:^{width}}" for index, text in zip(cells, words, strict=True)))
    return "\n".join(rows)


def nearer_patch(chart: Chart, index: int, reflectance: Spectrum) -> int | None:
    """Index of another patch, if a reading looks far more like it than like the one asked for; None
    also of a chart of which no reflectances are known.

    Parameters
    ----------
    chart : Chart
    index : int
    reflectance : Spectrum
    """
    known = _usual(chart)
    if known is None:
        return None
    usual = appearance.reflectance_to_lab(grid.FINE_GRID.nm, known)
    lab = appearance.reflectance_to_lab(reflectance.grid.nm, reflectance.values)
    distances = np.linalg.norm(usual - lab, axis=1)
    nearest = int(np.argmin(distances))
    return nearest if distances[index] > distances[nearest] + NEARER else None


@functools.cache
def _usual(chart: Chart) -> np.ndarray | None:
    known = chart.references or chart.reference_file is not None
    return reference_reflectances(None, chart, grid.FINE_GRID) if known else None


def _mark(name: str, index: int, measured: Collection[int], following: int, width: int) -> str:
    if index == following:
        return f"> {name} <" if width == CELL else f">{name}<"
    done = " ok" if width == CELL else "+"
    return f"{name}{done}" if index in measured else name


def _cell(chart: Chart, index: int, padded: str, measured: Mapping[int, Spectrum | None],
          following: int) -> str:
    own, usual = measured.get(index), _usual(chart)
    if own is not None:
        srgb = appearance.reflectance_to_srgb(own.grid.nm, own.values)
    elif usual is not None:
        srgb = appearance.reflectance_to_srgb(grid.FINE_GRID.nm, usual[index])
    else:
        srgb = np.full(3, UNKNOWN)
    if index not in measured and index != following:
        srgb = srgb * UNMEASURED
    red, green, blue = (round(255 * float(value)) for value in srgb)
    ink = "30" if srgb @ [0.2, 0.7, 0.1] > 0.5 else "97"
    return f"\x1b[48;2;{red};{green};{blue}m\x1b[{ink}m{padded}\x1b[0m"
