"""The demo session: written as a lab would have captured it, then run like any other."""
from __future__ import annotations

from pathlib import Path

from spectrabox.fixtures.demos import demo_session, flat_demo, painted_box
from spectrabox.session.config import session_file, template
from spectrabox.session.terminal.progress_display import progress_display


def make_demo(folder: Path, seed: int) -> None:
    """Write the synthetic capture session into ``folder``, unless it is there already."""
    if (folder / session_file.FILE_NAME).exists():
        return
    with progress_display() as progress:
        progress("capture", 0.0, "")
        demo_session.write_demo_session(
            folder, seed, lambda done, message: progress("capture", min(done, 0.99), message))
        template.write_schema(folder)
        progress("capture", 1.0, "synthetic photos, spectra and scenes written")


def make_flat_demo(folder: Path, seed: int) -> None:
    """Write the synthetic painting with its chart into ``folder``, unless it is there already."""
    if not (folder / session_file.FILE_NAME).exists():
        flat_demo.write_flat_demo(folder, seed)
        template.write_schema(folder)


def make_picture_demo(folder: Path, seed: int) -> None:
    """Write the synthetic box with painted patterns into ``folder``, unless it is there already."""
    if not (folder / session_file.FILE_NAME).exists():
        with progress_display() as progress:
            progress("capture", 0.0, "taking the photo of the painted box")
            painted_box.write_picture_demo(folder, seed)
            template.write_schema(folder)
            progress("capture", 1.0, "synthetic photos, spectra and scenes written")
