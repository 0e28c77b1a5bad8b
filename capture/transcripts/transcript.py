r"""Transcripts of what passed on a serial line: written while measuring, read back to be played.

A text file, one event a line; ``>`` is the computer, ``<`` the instrument, with seconds since the
event before::

    # spectrabox transcript: 1
    # instrument: pr655
    # line: 9600
    # recorded: 2026-01-02T10:11:12+00:00
    > 0.000 "D111\r"
    < 0.031 "00000,PR-655\r\n"

The text is ASCII; other bytes, quotes and backslashes are written as \xNN, \" and \\.
"""
from __future__ import annotations

import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.files import read_text, require_no_link
from spectrabox.radiometry.system.words import is_whole_number

TITLE = "spectrabox transcript"
VERSION = "1"
ESCAPES = {"\r": "\\r", "\n": "\\n", "\t": "\\t", "\\": "\\\\", '"': '\\"'}
UNESCAPES = {"r": b"\r", "n": b"\n", "t": b"\t", "\\": b"\\", '"': b'"'}
EVENT = re.compile(r'([<>]) (\d+\.?\d*) "((?:[^"\\]|\\.)*)"')


@dataclass(frozen=True)
class Event:
    """Bytes in one direction: ">" from the computer, "<" from the instrument."""

    direction: str
    delay_s: float
    data: bytes


@dataclass(frozen=True)
class Transcript:
    """What passed on a line, and the stated facts: instrument, line, recorded, synthetic."""

    facts: dict[str, str]
    events: tuple[Event, ...]
    file: str

    @property
    def baud(self) -> int:
        """Speed of the recorded line."""
        text = self.facts.get("line", "").split(" ")[0]
        if not is_whole_number(text):
            raise InputError(f"{self.file} states no line speed; a line '# line: 9600' is needed")
        return int(text)


class TranscriptWriter:
    """Appends every event to a file at once, so that a crash loses nothing that passed."""

    def __init__(self, path: Path, facts: dict[str, str]) -> None:
        require_no_link(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream: TextIO = path.open("w", encoding="ascii", newline="\n")
        except OSError as error:
            raise EnvironmentProblem(f"{path} cannot be written ({error.strerror}): free space or "
                                     "change its permissions, then measure again") from None
        self.path = path
        self._last = time.monotonic()
        for key, value in {TITLE: VERSION, **facts}.items():
            self._stream.write(f"# {key}: {value.encode('ascii', 'replace').decode()}\n")
        self._stream.flush()

    def __call__(self, direction: str, data: bytes) -> None:
        """Note bytes that passed."""
        now = time.monotonic()
        try:
            self._stream.write(f'{direction} {now - self._last:.3f} "{escaped(data)}"\n')
            self._stream.flush()
        except OSError as error:
            raise EnvironmentProblem(f"{self.path} cannot be written ({error.strerror}): free "
                                     "space, then measure again") from None
        self._last = now

    def note(self, key: str, value: str) -> None:
        """Add a fact that is known only now; the last of a name counts.

        Parameters
        ----------
        key, value : str
        """
        self._stream.write(f"# {key}: {value}\n")
        self._stream.flush()

    def close(self) -> None:
        """Close the file."""
        self._stream.close()


def escaped(data: bytes) -> str:
    """Bytes as ASCII text."""
    return "".join(ESCAPES.get(chr(byte), chr(byte) if 0x20 <= byte < 0x7F else f"\\x{byte:02x}")
                   for byte in data)


def unescaped(text: str) -> bytes:
    """Bytes of ASCII text; undoes ``escaped``.

    Parameters
    ----------
    text : str

    Raises
    ------
    ValueError
        At an escape that is not one of those written.
    """
    data = bytearray()
    at = 0
    while at < len(text):
        if text[at] != "\\":
            data += text[at].encode("ascii")
            at += 1
        elif text[at + 1] == "x":
            data.append(int(text[at + 2:at + 4], 16))
            at += 4
        elif text[at + 1] in UNESCAPES:
            data += UNESCAPES[text[at + 1]]
            at += 2
        else:
            raise ValueError(f"unknown escape \\{text[at + 1]}")
    return bytes(data)


def read_transcript(path: Path) -> Transcript:
    """A transcript from its file; a last line that was cut by a crash is left out.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If the file is missing, is no transcript, or a line of it cannot be read.
    """
    try:
        text = read_text(path, "ascii")
    except FileNotFoundError:
        raise InputError(f"{path} is missing: give the file of a transcript") from None
    except UnicodeDecodeError:
        raise InputError(f"{path.name} is no transcript: it must be plain ASCII") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    if not text.startswith(f"# {TITLE}: {VERSION}\n"):
        raise InputError(f"{path.name} is no transcript: its first line must be '# {TITLE}: "
                         f"{VERSION}'")
    return _parsed(text, path.name)


def _parsed(text: str, name: str) -> Transcript:
    facts: dict[str, str] = {}
    events: list[Event] = []
    lines = text.split("\n")
    for number, line in enumerate(lines, 1):
        if line.startswith("#"):
            key, _, value = line[1:].partition(":")
            facts[key.strip()] = value.strip()
        elif line.strip():
            match = EVENT.fullmatch(line)
            if match is None and number == len(lines):
                break
            try:
                if match is None:
                    raise ValueError("no event")
                events.append(Event(match[1], float(match[2]), unescaped(match[3])))
            except ValueError:
                raise InputError(f"{name} line {number}: {line[:40]!r} is no event; "
                                 'one looks like  > 0.000 "D111\\r"') from None
    if not events:
        raise InputError(f"{name} holds no events: nothing passed on the line when it was recorded")
    return Transcript(facts, tuple(events), name)
