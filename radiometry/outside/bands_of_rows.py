"""Rows of pictures that files hold in bands of so many rows: tiles and chunks."""
from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import numpy as np

ReadRows = Callable[[int, int], np.ndarray]     # (first, last) -> (last - first, W, C)
WriteRows = Callable[[int, np.ndarray], None]   # first row, pixels (n, W, C)


def read_by_bands(read: ReadRows, height: int, rows: int) -> ReadRows:
    """A function of any rows that reads whole bands, each once where rows are asked for in their
    order.

    Parameters
    ----------
    read : function of (first, last)
        Of one band: from a multiple of ``rows`` to the next, or to the end.
    height : int
    rows : int
        Of a band.
    """
    held: list[tuple[int, np.ndarray]] = []     # the last band, by its first row

    def band(first: int) -> np.ndarray:
        if not held or held[0][0] != first:
            held.clear()                        # its memory is wanted for the next
            held.append((first, read(first, min(first + rows, height))))
        return held[0][1]

    def read_rows(first: int, last: int) -> np.ndarray:
        parts = []
        for start in range(first // rows * rows, last, rows):
            parts.append(band(start)[max(first - start, 0):last - start].copy())
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    return read_rows


@contextlib.contextmanager
def written_by_bands(write: WriteRows, shape: tuple[int, int, int], rows: int,
                     kind: np.dtype[np.generic]) -> Iterator[WriteRows]:
    """A function that takes the next rows, as many as there are, and writes whole bands.

    Parameters
    ----------
    write : function of (first row, pixels)
        Of one band.
    shape : (H, W, C)
    rows : int
        Of a band.
    kind : dtype
        Of the values as they are kept until then.
    """
    height, width, channels = shape
    band = np.empty((min(rows, height), width, channels), kind)

    def take(first: int, pixels: np.ndarray) -> None:
        done = 0
        while done < len(pixels):
            at = (first + done) % rows
            count = min(rows - at, len(pixels) - done)
            band[at:at + count] = pixels[done:done + count]
            done += count
            end = first + done
            if end % rows == 0 or end == height:
                write((end - 1) // rows * rows, band[:at + count])

    yield take
