"""The program that made a result: versions of its packages, digests of its own code and models."""
from __future__ import annotations

import datetime
import functools
import hashlib
import importlib.metadata
import json
import os
import platform
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import spectrabox
from spectrabox.reconstruct.rendering.llvm import llvm_name

PACKAGE = Path(spectrabox.__file__).resolve().parent
LIBRARY = ("radiometry", "capture", "calibrate", "reconstruct", "sampling", "measure")

PACKAGES = ("spectrabox", "numpy", "scipy", "mitsuba", "drjit", "rawpy",
            "opencv-contrib-python-headless", "colour-science", "OpenImageIO", "exifread")
DECISIVE = ("spectrabox", "mitsuba", "drjit", "rawpy", "scipy", "opencv-contrib-python-headless")


def versions(names: tuple[str, ...] = PACKAGES) -> dict[str, str]:
    """Installed versions of the packages that results depend on."""
    return {name: _version(name) for name in names}


def room_digests(rooms: Iterable[str]) -> dict[str, str]:
    """Digests of the files of rooms: modules, models, tables, templates.

    Parameters
    ----------
    rooms : iterable of str
        Folders, such as "sampling".
    """
    return {room: _room_digest(PACKAGE / room) for room in rooms}


@functools.cache        # of the code that runs: what is edited meanwhile is not loaded again
def _room_digest(folder: Path) -> str:
    digest = hashlib.sha256()
    for inside, _, names in sorted(os.walk(folder)):
        for name in sorted(names) if not inside.endswith("__pycache__") else ():
            digest.update(os.fsencode(f"{inside[len(str(folder)):]}/{name}") + b"\0")
            digest.update(hashlib.sha256(Path(inside, name).read_bytes()).digest())
    return digest.hexdigest()


@functools.cache
def program_digest() -> str:
    """Digest of the whole program and of the packages that results depend on."""
    program = {"code": room_digests((*LIBRARY, "session")), "versions": versions()}
    return hashlib.sha256(json.dumps(program, sort_keys=True).encode()).hexdigest()


def provenance(command: list[str], seed: int, device: str) -> dict[str, Any]:
    """Versions, command, seed, time and kind of machine; no paths and no names of machines.

    Parameters
    ----------
    command : list of str
        As the operator could type it again, without paths.
    device : str
        Where Mitsuba rendered.
    """
    more = {"python": platform.python_version(), "llvm": llvm_name()}
    return {"versions": versions() | more, "command": command, "seed": seed,
            "device": device, "machine": platform.machine(), "system": platform.system(),
            "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")}


def _version(name: str) -> str:
    try:
        text = importlib.metadata.distribution(name).read_text("METADATA") or ""
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
    # as importlib.metadata.version, which also parses the description, of many pages
    stated = re.search(r"^Version: *(\S+)", text, re.MULTILINE)
    return stated[1] if stated else importlib.metadata.version(name)
