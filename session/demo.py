"""The demo session: written as a lab would have captured it, then run like any other."""
from __future__ import annotations

from pathlib import Path

from spectrabox.fixtures.demos.demo_session import write_demo_session
from spectrabox.fixtures.demos.flat_demo import write_flat_demo
from spectrabox.fixtures.demos.painted_box import write_picture_demo
from spectrabox.session.config.session_file import FILE_NAME
from spectrabox.session.config.template import write_schema
from spectrabox.session.terminal.progress_display import progress_display


def make_demo(folder: Path, seed: int) -> None:
    """Write the synthetic capture session into ``folder``, unless it is there already."""
    if (folder / FILE_NAME).exists():
        return
    with progress_display() as progress:
        progress("capture", 0.0, "")
        write_demo_session(folder, seed, lambda done, message: progress("capture", min(done, 0.99),
                                                                        message))
        write_schema(folder)
        progress("capture", 1.0, "synthetic photos, spectra and scenes written")


def make_flat_demo(folder: Path, seed: int) -> None:
    """Write the synthetic painting with its chart into ``folder``, unless it is there already."""
    if not (folder / FILE_NAME).exists():
        write_flat_demo(folder, seed)
        write_schema(folder)


def make_picture_demo(folder: Path, seed: int) -> None:
    """Write the synthetic box with painted patterns into ``folder``, unless it is there already."""
    if not (folder / FILE_NAME).exists():
        with progress_display() as progress:
            progress("capture", 0.0, "taking the photo of the painted box")
            write_picture_demo(folder, seed)
            write_schema(folder)
            progress("capture", 1.0, "synthetic photos, spectra and scenes written")
