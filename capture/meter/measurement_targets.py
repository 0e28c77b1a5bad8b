"""What a measurement may write: a file of another quantity or role is never replaced."""
from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from spectrabox.capture.meter.measurement_files import readings_folder
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.system.words import shortened

ROLES = ("light", "white", "paint", "chart")
ROLE_FILE = "role.txt"          # in a folder of readings
OF_CHART = r"chart(-\d\d-.*|-radiance|-irradiance)?"


def claim(spectra: Path, role: str, names: Sequence[str]) -> None:
    """Take names for a role, before anything is measured.

    Parameters
    ----------
    spectra : Path
        The session's folder of spectra.
    role : {"light", "white", "paint", "chart"}
    names : sequence of str
        Of the things to be measured.

    Raises
    ------
    InputError
        If a name is another role's, or its file was not written from readings under that name.
    """
    for name in names:
        folder = readings_folder(spectra, name)
        other = _role_of(folder) or _reserved(name)
        if other not in (None, role):
            raise InputError(f"{shortened(name)} is the name of something measured as {other}; "
                             f"as {role}, give it another with --name")
    if any(folder.is_dir() or any(folder.parent.glob(f"{folder.name}.before-*"))
           for folder in (readings_folder(spectra, name) for name in names)):
        return
    by_white = role in ("paint", "chart") and readings_folder(spectra, "white").is_dir()
    for quantity in ([Quantity.REFLECTANCE] if by_white
                     else [Quantity.RADIANCE, Quantity.IRRADIANCE]):
        if (file := _file(spectra, role, names[0], quantity)).exists():
            raise InputError(f"{file} was not measured here and would be replaced: rename it"
                             + ("" if role == "chart" else ", or choose another --name"))


def note_role(spectra: Path, role: str, name: str) -> None:
    """Store the role with the readings of a name.

    Parameters
    ----------
    spectra : Path
    role, name : str
    """
    folder = readings_folder(spectra, name)
    if _role_of(folder) != role:
        write_text_whole(folder / ROLE_FILE, f"{role}\n")


def result_file(spectra: Path, role: str, name: str, quantity: Quantity) -> Path:
    """The file of a result; a surface without a white standard has its quantity in the name.

    Parameters
    ----------
    spectra : Path
    role : {"light", "white", "paint", "chart"}
    name : str
        Of the thing; a chart's is not asked.
    quantity : Quantity

    Raises
    ------
    InputError
        If that file holds another quantity.
    """
    path = _file(spectra, role, name, quantity)
    held = _quantity_in(path)
    if held not in (None, quantity.name.lower()):
        raise InputError(f"{path} holds {held}, which {quantity.name.lower()} must not replace: "
                         "rename it, or choose another --name; the readings are kept")
    return path


def _file(spectra: Path, role: str, name: str, quantity: Quantity) -> Path:
    stem = "chart" if role == "chart" else name
    bare = role in ("light", "white") or quantity is Quantity.REFLECTANCE
    return spectra / (f"{stem}.csv" if bare else f"{stem}-{quantity.name.lower()}.csv")


def _reserved(name: str) -> str | None:
    plain = name.casefold()
    if plain in ("light", "white"):
        return plain
    return "chart" if re.fullmatch(OF_CHART, plain) else None


def _role_of(folder: Path) -> str | None:
    try:
        role = (folder / ROLE_FILE).read_text(encoding="utf-8").strip()
    except (OSError, ValueError):
        return None
    return role if role in ROLES else None


def _quantity_in(path: Path) -> str | None:
    """What a file says that it holds; None where there is no file."""
    try:
        with path.open(encoding="utf-8", errors="replace") as stream:
            head = stream.read(2000)
    except FileNotFoundError:
        return None
    stated = re.search(r"^# quantity: *(\w+)", head, re.MULTILINE)
    return stated[1] if stated else "something that was not measured here"
