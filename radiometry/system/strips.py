"""Pictures whose files hold strips of so many rows (rows of tiles or chunks), read and written by
any rows.
"""
from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import numpy as np

ReadRows = Callable[[int, int], np.ndarray]     # (first, last) -> (last - first, W, C)
WriteRows = Callable[[int, np.ndarray], None]   # first row, pixels (n, W, C)


def read_by_strips(read: ReadRows, height: int, rows: int) -> ReadRows:
    """Make a function that reads any rows from one that reads whole strips.

    Parameters
    ----------
    read : function of (first, last)
        Reads one strip: from a multiple of ``rows`` to the next, or to the end.
    height : int
        Of the picture.
    rows : int
        Of a strip.

    Returns
    -------
    function of (first, last)
        Each strip is read once where rows are asked for in their order.
    """
    last_strip: list[tuple[int, np.ndarray]] = []     # by its first row

    def strip(first: int) -> np.ndarray:
        if not last_strip or last_strip[0][0] != first:
            last_strip.clear()                        # its memory is needed for the next
            last_strip.append((first, read(first, min(first + rows, height))))
        return last_strip[0][1]

    def read_rows(first: int, last: int) -> np.ndarray:
        parts = [strip(start)[max(first - start, 0):last - start].copy()
                 for start in range(first // rows * rows, last, rows)]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    return read_rows


@contextlib.contextmanager
def written_by_strips(write: WriteRows, shape: tuple[int, int, int], rows: int,
                      dtype: np.dtype[np.generic]) -> Iterator[WriteRows]:
    """Make a function that takes the next rows, as many as there are, and writes whole strips.

    Parameters
    ----------
    write : function of (first row, pixels)
        Writes one strip.
    shape : (H, W, C)
    rows : int
        Of a strip.
    dtype : dtype
        Of the values as they are kept until their strip is complete.
    """
    height, width, channels = shape
    strip = np.empty((min(rows, height), width, channels), dtype)

    def take(first: int, pixels: np.ndarray) -> None:
        done = 0
        while done < len(pixels):
            at = (first + done) % rows
            count = min(rows - at, len(pixels) - done)
            strip[at:at + count] = pixels[done:done + count]
            done += count
            end = first + done
            if end % rows == 0 or end == height:
                write((end - 1) // rows * rows, strip[:at + count])

    yield take
