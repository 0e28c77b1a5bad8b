"""Faults of a serial line, laid over one reply of a clean recording."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum


class FaultKind(Enum):
    """What goes wrong, in words."""

    NOISE = "noise"
    ZERO_BYTE = "zero byte"
    TRUNCATE = "truncated"
    DROP = "no answer"
    DROP_BYTE = "lost byte"
    FLIP_BIT = "flipped bit"
    CHANGE_DIGIT = "changed digit"
    STALL = "short stall"
    LONG_STALL = "long stall"
    DRIBBLE = "dribble"
    DISCONNECT = "disconnect"
    ECHO_BEFORE = "echo before"
    ECHO_AFTER = "echo after"
    DUPLICATE = "duplicate"
    DUPLICATE_LINE = "duplicated line"
    EXTRA_LINE = "longer reply"


@dataclass(frozen=True)
class Fault:
    """A fault at the reply of ``step``, at ``position`` (0 to 1) within it; stalls last ``stall_s``
    seconds.

    With ``every``, all replies from ``step`` on have it.
    """

    kind: FaultKind
    step: int
    position: float = 0.5
    stall_s: float = 0.05
    every: bool = False


def overlaid(data: bytes, fault: Fault | None,
             command: bytes) -> Sequence[tuple[float, bytes | None]]:
    """Parts of a reply with the fault laid over, each after a pause in seconds; None closes the
    line.

    Parameters
    ----------
    data : bytes
        The clean reply.
    fault : Fault or None
    command : bytes
        What the computer last sent, for echoes.
    """
    if fault is None:
        return [(0.0, data)]
    kind = fault.kind
    at = min(int(fault.position * len(data)), len(data) - 1)
    if kind in (FaultKind.STALL, FaultKind.LONG_STALL):
        return [(0.0, data[:at]), (fault.stall_s, data[at:])]
    if kind is FaultKind.DRIBBLE:
        return [(0.001, data[i:i + 1]) for i in range(min(len(data), 60))] + [(0.001, data[60:])]
    if kind is FaultKind.DISCONNECT:
        return [(0.0, data[:at]), (0.02, None)]
    return [(0.0, _changed(data, kind, at, command))]


def _changed(data: bytes, kind: FaultKind, at: int, command: bytes) -> bytes:
    before, byte, after = data[:at], data[at:at + 1], data[at + 1:]
    line = data[at:].splitlines(keepends=True)[-1]
    digit = next((i for i in [*range(at, len(data)), *range(at)] if 0x30 <= data[i] <= 0x39), None)
    return {
        FaultKind.NOISE: before + b"\xff\x9f\x80" + byte + after,
        FaultKind.ZERO_BYTE: before + b"\x00" + byte + after,
        FaultKind.TRUNCATE: before,
        FaultKind.DROP: b"",
        FaultKind.DROP_BYTE: before + after,
        FaultKind.FLIP_BIT: before + bytes([byte[0] ^ 0x04]) + after,
        FaultKind.CHANGE_DIGIT: data if digit is None else
        data[:digit] + bytes([0x30 + (data[digit] - 0x30 + 1) % 10]) + data[digit + 1:],
        FaultKind.ECHO_BEFORE: command + data,
        FaultKind.ECHO_AFTER: data + command,
        FaultKind.DUPLICATE: data + data,
        FaultKind.DUPLICATE_LINE: data + line,
        FaultKind.EXTRA_LINE: data + line * 3,
    }[kind]
