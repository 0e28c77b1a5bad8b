"""What a call says where it refuses, for records of where a guard begins."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.outside.archives import DamagedArchiveError

REFUSALS = (SpectraboxError, DamagedArchiveError, ValueError, FileNotFoundError)


def said(call: Callable[[], Any], folder: Path | None = None) -> Any:
    """What a call gives, or its refusal as text; the folder of a test is left out of texts."""
    try:
        found = call()
    except REFUSALS as error:
        code = f" ({error.exit_code})" if isinstance(error, SpectraboxError) else ""
        found = f"{type(error).__name__}{code}: {error}"
    return placeless(found, folder) if folder is not None and isinstance(found, str) else found


def placeless(text: str, folder: Path) -> str:
    """Text without the folder of a test."""
    for name in (str(folder.resolve()), str(folder)):
        text = text.replace(name, "FOLDER")
    return text

