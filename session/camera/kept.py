"""Measured cameras of others, kept under their names (kept_cameras.py)."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from spectrabox.calibrate.prior.camera_database import SUFFIXES, cameras_of_file
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import default_band_names
from spectrabox.radiometry.spectra.kept_cameras import cameras_folder, keep_camera


def add_cameras(sources: Sequence[Path]) -> tuple[list[str], list[str], Path]:
    """Keep every camera of some files and folders.

    Parameters
    ----------
    sources : list of Path

    Returns
    -------
    kept : list of str
        Names, in the order of the files.
    skipped : list of str
        Sentences on what was not kept.
    folder : Path

    Raises
    ------
    InputError
        If one is missing, or nothing could be kept.
    """
    kept: list[str] = []
    skipped: list[str] = []
    for path in _files(sources):
        try:
            for name, (nm, curves) in cameras_of_file(path).items():
                bands = default_band_names(len(curves))
                keep_camera(name, nm, dict(zip(bands, curves, strict=True)),
                            f"{name}, from {path.name}")
                kept.append(name)
        except InputError as error:
            skipped.append(str(error))
    if not kept:
        raise InputError(skipped[0] if skipped else "there are no files of camera curves there; "
                         ".json (rawtoaces) or .csv are needed")
    return kept, skipped, cameras_folder()


def _files(sources: Sequence[Path]) -> Sequence[Path]:
    """The files, and those of the folders that end as camera files do."""
    files: list[Path] = []
    for source in sources:
        if not source.exists():
            raise InputError(f"{source} is missing; give a file or folder of camera curves")
        files += sorted(path for path in source.iterdir() if path.suffix.lower() in SUFFIXES) \
            if source.is_dir() else [source]
    return files
