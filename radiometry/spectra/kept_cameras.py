"""Cameras by name: those that are published, and one's own, kept as CSV files in one folder.

The folder is ``$SPECTRABOX_CAMERAS``, else ``spectrabox/cameras`` under ``$XDG_DATA_HOME`` or
``~/.local/share``. A camera's file is called after it: ``Nikon D850.csv``.
"""
from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.published.published_tables import OBSERVERS, published_names
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra.formats.delimited import table_text
from spectrabox.radiometry.system.names import file_stem, name_fault

FOLDER, SUFFIX = "SPECTRABOX_CAMERAS", ".csv"


def cameras_folder() -> Path:
    """Where one's own cameras are kept; the folder need not exist.

    Raises
    ------
    EnvironmentProblem
        If nothing says where.
    """
    stated = os.environ.get(FOLDER)
    if stated:
        return Path(stated)
    try:
        data = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share")
    except RuntimeError:
        raise EnvironmentProblem(f"there is no home folder; name the folder of your own cameras "
                                 f"with the variable {FOLDER}") from None
    return data / "spectrabox" / "cameras"


def own_cameras() -> dict[str, Path]:
    """Files of one's own cameras by name; empty where none are kept."""
    try:
        folder = cameras_folder()
        files = sorted(folder.glob(f"*{SUFFIX}")) if folder.is_dir() else []
    except (EnvironmentProblem, OSError):
        return {}
    return {path.stem: path for path in files}


def keep_camera(name: str, nm: np.ndarray, columns: dict[str, np.ndarray], source: str) -> Path:
    """Keep a camera's curves under a name by which every command then knows it.

    Parameters
    ----------
    name : str
    nm : (P,) array
    columns : dict of (P,) arrays
        Curves by band, and their standard errors where they are known.
    source : str

    Returns
    -------
    Path
        Its file.

    Raises
    ------
    InputError
        If it cannot be a name, or is that of a published camera or observer.
    """
    require_new_name(name)
    path = cameras_folder() / f"{file_stem(name)}{SUFFIX}"
    write_text_whole(path, table_text(nm, columns, quantity=Quantity.RELATIVE, source=source))
    return path


def require_new_name(name: str) -> None:
    """Refuse what cannot name a camera of one's own.

    Raises
    ------
    InputError
    """
    if fault := name_fault(name):
        raise InputError(f"{name!r} cannot name a camera: {fault}")
    if name in published_names(OBSERVERS):
        raise InputError(f"{name!r} is already the name of a published camera or observer; give "
                         "your own another, such as the camera and a year")
