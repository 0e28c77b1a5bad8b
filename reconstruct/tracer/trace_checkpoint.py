"""The sums of a long trace so far, in a file: a stopped trace goes on with the same bits."""
from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.files import whole_file
from spectrabox.radiometry.system.archives import DamagedArchiveError, opened_npz

WRITE_EVERY_S = 20.0    # and when the trace is stopped


@dataclass(frozen=True)
class PassSums:
    """Sums over the parts that are done, of A passes in turn: (R, L, E) float32 each."""

    done: int
    passes: tuple[np.ndarray, ...]

    def with_one_more(self, part: np.ndarray) -> PassSums:
        """The sums with the next part added; these stay as they are, whole for an interrupt.

        Parameters
        ----------
        part : (R, L, E) float32
        """
        turn = self.done % len(self.passes)
        return PassSums(self.done + 1, (*self.passes[:turn], self.passes[turn] + part,
                                        *self.passes[turn + 1:]))


class TraceCheckpoint:
    """The file of one trace. Its content counts only for a trace with the same fingerprint.

    Parameters
    ----------
    path : Path
        In a folder that can be written.
    fingerprint : str
        As of ``trace_fingerprint``.
    """

    def __init__(self, path: Path, fingerprint: str) -> None:
        self.path, self.fingerprint = path, fingerprint
        self.written = time.monotonic()

    def read(self) -> PassSums | None:
        """What an interrupted trace left; None without a file of this very trace that is whole."""
        try:
            with opened_npz(self.path) as stored:
                if str(stored["fingerprint"]) != self.fingerprint:
                    return None
                return PassSums(int(stored["done"]), tuple(stored["passes"]))
        except (FileNotFoundError, DamagedArchiveError):
            return None

    def write_now_and_then(self, sums: PassSums) -> None:
        """Write if the last time is long ago."""
        if time.monotonic() - self.written > WRITE_EVERY_S:
            self.write(sums)

    def write(self, sums: PassSums) -> None:
        """Write the file whole, in place of the last.

        Raises
        ------
        EnvironmentProblem
            If the folder cannot be written.
        """
        if not sums.done:
            return
        with whole_file(self.path) as unfinished, unfinished.open("wb") as stream:
            np.savez(stream, fingerprint=self.fingerprint, done=sums.done,
                     passes=np.array(sums.passes))
        self.written = time.monotonic()

    def remove(self) -> None:
        """The trace is done."""
        self.path.unlink(missing_ok=True)


def trace_fingerprint(scene: Any, facts: tuple[Any, ...], arrays: tuple[np.ndarray, ...]) -> str:
    """SHA-256 of all that decides a trace's bits: the scene's parameters, and the request.

    Parameters
    ----------
    scene : mi.Scene
    facts : tuple
        Whose ``repr`` counts.
    arrays : tuple of arrays
        Whose values count.
    """
    import mitsuba as mi

    bsdfs = [(shape.id(), shape.bsdf().id() if shape.bsdf() is not None else "")
             for shape in scene.shapes()]
    digest = hashlib.sha256(repr((facts, bsdfs)).encode())
    for name, value in mi.traverse(scene):
        digest.update(name.encode())
        digest.update(np.array(getattr(value, "matrix", value), dtype=np.float64).tobytes())
    for array in arrays:
        digest.update(np.ascontiguousarray(array, dtype=np.float64).tobytes())
    return digest.hexdigest()
