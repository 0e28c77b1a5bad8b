"""Names under which files that a browser sends are kept."""
from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.words import shortened

UNSAFE = re.compile(r"[^\w .()+-]+")
MAX_NAME = 100          # characters of a file's


def unused_path(wanted: Path, taken: Collection[Path] = ()) -> Path:
    """A path that is not there yet, of a name or the same with a number."""
    number, path = 1, wanted
    while path.exists() or path.is_symlink() or path in taken:
        number += 1
        path = wanted.with_name(f"{wanted.stem}-{number}{wanted.suffix}")
    return path


def safe_name(name: str) -> str:
    """The name of a file as a browser gives it, without what may not stand in one.

    Raises
    ------
    InputError
        If nothing is left of it.
    """
    safe = UNSAFE.sub("_", name)[-MAX_NAME:].lstrip("._ ")
    if not Path(safe).stem:
        raise InputError(f"{shortened(name)} is no name of a file; rename it")
    return safe
