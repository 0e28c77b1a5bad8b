"""Traffic of a serial line as a program that watched it wrote it: Eltima's Serial Port Monitor.

Its files (.spm) hold two messages of every request, on its way down to the driver and on its way up
again, and so does its text. A write counts once, a read with the bytes that it brought up. Files of
version 3, as they were read in genuine ones::

    "Eltima Software Serial mon.v_3\\n", the port's name (u32 length, UTF-16), 13 bytes of counts,
    messages; a message: 13 numbers, the bytes that passed, the port's name again
"""
from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

from spectrabox.capture.meter.instruments import cr30
from spectrabox.capture.transcripts import transcript
from spectrabox.radiometry.errors import InputError

MAKER = b"Eltima Software Serial mon.v_"
VERSION = b"3"
READ, WRITE = 3, 4                      # major functions of the driver's requests
TICKS_PER_S = 10_000_000
# Number, function, code, -, way (1 up), status, bytes, letters of the port's name, time, bytes
# again, request, session, -.
MESSAGE = struct.Struct("<8IQ4I")
COUNTS = struct.Struct("<B3I")
MAX_BYTES = 1 << 20                     # of one message
MAX_FILE_BYTES = 200_000_000
HEAD_BYTES = 5000                       # of a file, by which its kind is told
TEXT = re.compile(r"IRP_MJ_(READ|WRITE) +(UP|DOWN) +(?:STATUS_\w+ +)?"
                  r"((?:[0-9A-Fa-f]{2} )*[0-9A-Fa-f]{2}) {2}")


# whether it is a write, whether it is on its way up, seconds, the bytes that passed
_Message = tuple[bool, bool, float, bytes]


def read_recording(path: Path) -> transcript.Transcript:
    """What passed on a line: a transcript of ours, or what another program wrote while it watched.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If the file is missing, of no known kind, of an unknown version or damaged.
    """
    try:
        with path.open("rb") as stream:
            content = stream.read(HEAD_BYTES)
            sniffed = content.startswith(MAKER) or b"IRP_MJ_" in content
            content += stream.read(MAX_FILE_BYTES) if sniffed else b""
    except OSError:
        sniffed = False                 # the reader of transcripts says what is wrong
    if not sniffed:
        return transcript.read_transcript(path)
    # which of all instruments is the one that such recordings are read of
    return transcript.Transcript({"instrument": cr30.Cr30.name},
                                 sniffed_events(content, path.name), path.name)


def sniffed_events(content: bytes, name: str) -> tuple[transcript.Event, ...]:
    """What passed on the line, in order.

    Parameters
    ----------
    content : bytes
        Of a file that a watching program wrote.
    name : str
        Of the file, for errors.

    Raises
    ------
    InputError
        If the file is of another version, or damaged.
    """
    return tuple(_events(list(_binary_messages(content, name) if content.startswith(MAKER)
                              else _text_messages(content))))


def _binary_messages(content: bytes, name: str) -> Iterator[_Message]:
    title, _, _ = content.partition(b"\n")
    if title != MAKER + VERSION:
        version = title[len(MAKER):].decode("ascii", "replace")
        raise InputError(f"{name} is of version {version!r} of Eltima's Serial Port Monitor, and "
                         "version 3 is known: export it as text")
    at = len(title) + 1
    try:
        letters, = struct.unpack_from("<I", content, at)
        at += 4 + 2 * letters + COUNTS.size
        while at < len(content):
            _, function, _, _, up, _, count, letters, ticks, *_ = MESSAGE.unpack_from(content, at)
            at += MESSAGE.size
            if count > MAX_BYTES or letters > MAX_BYTES:
                raise InputError(f"{name} is damaged at byte {at}: a message of {count} bytes; "
                                 "copy the file again")
            if at + count > len(content):
                break                   # the last message was cut: what came before is whole
            if function in (READ, WRITE):
                yield function == WRITE, bool(up), ticks / TICKS_PER_S, content[at:at + count]
            at += count + 2 * letters
    except struct.error:
        return


def _text_messages(content: bytes) -> Iterator[_Message]:
    for line in content.decode("utf-8", "replace").splitlines():
        if match := TEXT.search(line):
            yield match[1] == "WRITE", match[2] == "UP", 0.0, bytes.fromhex(match[3])


def _events(messages: Sequence[_Message]) -> Iterator[transcript.Event]:
    """Each request once: a write that comes up again as it went down is the same write."""
    down: bytes | None = None           # the write that has not come up yet
    before_s = messages[0][2] if messages else 0.0
    for write, up, time_s, passed in messages:
        echoed = write and up and passed == down
        if write:
            down = None if up else passed
        if not passed or echoed:
            continue
        yield transcript.Event(">" if write else "<", max(time_s - before_s, 0.0), passed)
        before_s = time_s
