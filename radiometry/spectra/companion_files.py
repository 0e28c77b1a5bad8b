"""Files that are read with another that lies beside them. Imports nothing heavy."""
from __future__ import annotations

from pathlib import Path

METADATA = "-metadata.json"     # of a plain CSV (formats/csvw.py)


def metadata_path(path: Path) -> Path:
    """Where the metadata of a CSV lie, if there are some."""
    return path.with_name(path.name + METADATA)


def envi_header_of(path: Path) -> Path | None:
    """The header that belongs to a binary library, if it is beside it."""
    return next((candidate for candidate in (path.with_suffix(".hdr"),
                                             path.with_name(path.name + ".hdr"))
                 if candidate != path and candidate.is_file()), None)


def envi_values_of(header: Path) -> Path | None:
    """The binary library that belongs to a header, if it is beside it."""
    return next((values for suffix in (".sli", ".slb", ".lib", "")
                 if (values := header.with_suffix(suffix)) != header and values.is_file()), None)


def envi_partner(path: Path) -> Path | None:
    """The other file that is read with a header or a binary library, if it is beside it."""
    return envi_values_of(path) if path.suffix.lower() == ".hdr" else envi_header_of(path)
