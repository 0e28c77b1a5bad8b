"""The sessions of a batch, as the command line or a list names them."""
from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from spectrabox.radiometry.errors import InputError


def session_folders(named: Iterable[Path], listed: Path | None) -> list[Path]:
    """Folders of sessions, absolute, each once, in the order in which they are named.

    Parameters
    ----------
    named : iterable of Path
        On the command line.
    listed : Path or None
        A file with one folder a line, as seen from where it lies; empty lines and those that begin
        with # are passed over.

    Raises
    ------
    InputError
        If none is named, or the list cannot be read.
    """
    folders = [folder.resolve() for folder in named]
    if listed is not None:
        lines = [line.strip() for line in _text(listed).splitlines()]
        folders += [(listed.parent / line).resolve() for line in lines
                    if line and not line.startswith("#")]
    if not folders:
        raise InputError("no session is named; give session folders, or --list FILE with one a "
                         "line")
    return list(dict.fromkeys(folders))


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read as a list of sessions ({error}); give a text "
                         "file with one folder a line") from None
