"""What was run, with what: enough to run it again."""
from __future__ import annotations

import datetime
import hashlib
import importlib.metadata
import platform
from pathlib import Path
from typing import Any

import spectrabox

PACKAGES = ("spectrabox", "numpy", "scipy", "mitsuba", "drjit", "rawpy",
            "opencv-contrib-python-headless", "colour-science", "OpenImageIO", "exifread")
CODE_SUFFIXES = (".py", ".npz")
DECISIVE = ("spectrabox", "mitsuba", "drjit", "rawpy", "scipy", "opencv-contrib-python-headless")


def versions(names: tuple[str, ...] = PACKAGES) -> dict[str, str]:
    """Installed versions of the packages that results depend on."""
    return {name: _version(name) for name in names}


def provenance(command: list[str], seed: int, device: str) -> dict[str, Any]:
    """Versions, command, seed, time and kind of machine; no paths and no names of machines."""
    return {"versions": versions() | {"python": platform.python_version()}, "command": command,
            "seed": seed,
            "device": device, "machine": platform.machine(), "system": platform.system(),
            "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")}


def code_digest(package: str) -> str:
    """Hash of the source and models of one of our packages: results of other code are not the same
    results.
    """
    root = Path(spectrabox.__file__).resolve().parent / package
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*")):
        if path.is_file() and path.suffix in CODE_SUFFIXES:
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
