"""What a session will take of memory, before it runs."""
from __future__ import annotations

import os
from pathlib import Path

from spectrabox.session.config.session_schema import SessionConfig

# Measured: 262 MB of flat samples, 290 MB of a box without what its tracing takes.
PROGRAM_BYTES = 400 * 2**20
# Measured while photos are opened: 18 bytes a pixel of a raw file, 36 of an EXR.
BYTES_A_PIXEL = 48
PEAK, STATUS = Path("/proc/self/clear_refs"), Path("/proc/self/status")


def needed_bytes(config: SessionConfig) -> int:
    """Bytes that a session takes before it traces light, with the program.

    Of the photos the largest counts, with the flat fields that go with it: they are opened one
    after the other.

    Raises
    ------
    InputError
        If a photo is missing or none.
    """
    from spectrabox.capture.photo.linear import photo_size

    def pixels(names: list[str]) -> int:
        sizes = [photo_size(config.path(name)) for name in names]
        return sum(width * height for width, height in sizes)

    correcting = pixels([*config.photos.flats.values(), *config.photos.dark_files[:1]])
    photos = [list(files) for view in config.all_views for files in (view.photo_files,
                                                                     view.chart_files)]
    return PROGRAM_BYTES + BYTES_A_PIXEL * (correcting + max(map(pixels, photos)))


class PeakMemory:
    """The most memory that this process has held since this was made."""

    def __init__(self) -> None:
        try:
            handle = os.open(PEAK, os.O_WRONLY)
        except OSError:
            self._own = False
            return
        try:
            os.write(handle, b"5")      # forget the peak until now (proc(5))
            self._own = True
        except OSError:
            self._own = False
        finally:
            os.close(handle)

    def peak(self) -> int | None:
        """Bytes; None where the system tells only of all that the process has ever done."""
        if not self._own:
            return None
        lines = dict(line.split(":", 1) for line in STATUS.read_text().splitlines())
        return int(lines["VmHWM"].split()[0]) * 1024
