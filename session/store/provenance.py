"""What was run, with what: enough to run it again."""
from __future__ import annotations

import datetime
import importlib.metadata
import platform
import re
from typing import Any

from spectrabox.reconstruct.rendering.llvm import llvm_name

PACKAGES = ("spectrabox", "numpy", "scipy", "mitsuba", "drjit", "rawpy",
            "opencv-contrib-python-headless", "colour-science", "OpenImageIO", "exifread")
DECISIVE = ("spectrabox", "mitsuba", "drjit", "rawpy", "scipy", "opencv-contrib-python-headless")


def versions(names: tuple[str, ...] = PACKAGES) -> dict[str, str]:
    """Installed versions of the packages that results depend on."""
    return {name: _version(name) for name in names}


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
