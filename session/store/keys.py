"""Keys of kept records: digests of the parts of a capture that a step reads, of the files behind
them, and of the program.
"""


from __future__ import annotations

import dataclasses
import datetime
import functools
import hashlib
import importlib.metadata
import json
import os
import platform
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

import spectrabox
from spectrabox.calibrate.geometry.colmap_model import CAMERAS_NAME, IMAGES_NAME
from spectrabox.measure.captured import Capture, InputFile
from spectrabox.measure.shoot.inputs import chart_files
from spectrabox.measure.steps.declared_steps import steps_of
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import file_state
from spectrabox.radiometry.spectra.formats.delimited import envi_partner, metadata_path
from spectrabox.reconstruct.rendering.llvm import llvm_name
from spectrabox.reconstruct.scene.scene_file import SceneFile
from spectrabox.session.config.session_file import SessionConfig
from spectrabox.session.store.record_files import fingerprint

PACKAGE = Path(spectrabox.__file__).resolve().parent
LIBRARY = ("radiometry", "capture", "calibrate", "reconstruct", "sampling", "measure")

PACKAGES = ("spectrabox", "numpy", "scipy", "mitsuba", "drjit", "rawpy",
            "opencv-contrib-python-headless", "colour-science", "OpenImageIO", "exifread")
GPU = "cuda"            # of --device; "auto" and "cpu" are one
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


# ---- the files that a run reads, as they were when it first looked at them -----------------------

class InputFiles:
    """States of a session's files, each taken once.

    Parameters
    ----------
    config : SessionConfig
    """

    def __init__(self, config: SessionConfig) -> None:
        self._config = config
        self.folder = config.folder
        self._states: dict[str, tuple[str, tuple[int, ...]]] = {}      # as of ``file_state``

    def digests(self, *names: str | None) -> dict[str, str]:
        """SHA-256 of files by name, and of what lies beside them: the other half
        of a spectral library, the metadata of a table.

        Parameters
        ----------
        names : str or None
            As session.toml gives them; None is passed over.

        Raises
        ------
        InputError
            If a file is missing, cannot be read, or lies outside the session folder.
        """
        digests = {}
        for name in self._with_partners(names):
            if name not in self._states:
                self._states[name] = file_state(self._path(name))
            digests[name], _ = self._states[name]
        return digests

    def require_unchanged(self, names: Iterable[str]) -> None:
        """Refuse results of files that were written to or replaced since their digest was taken.

        Parameters
        ----------
        names : iterable of str
            Of files whose digests were taken.

        Raises
        ------
        InputError
            With the name of the first that is not as it was.
        """
        for name in names:
            if file_state(self._path(name)) != self._states[name]:
                raise InputError(f"{name} was changed or replaced while it was read; leave the "
                                 "files of a session alone while it runs, and run again")

    def _with_partners(self, names: tuple[str | None, ...]) -> Iterable[str]:
        for name in names:
            if name is not None:
                yield name
                path = self._path(name)
                for partner in (envi_partner(path), metadata_path(path)):
                    if partner is not None and partner.is_file():
                        yield str(Path(name).with_name(partner.name))

    def _path(self, name: str) -> Path:
        return self._config.path(name)


# ---- what each input file of a session is for ----------------------------------------------------

def input_files(config: SessionConfig, capture: Capture) -> list[str]:
    """Names of every file that a session measures with, as seen from its folder.

    Parameters
    ----------
    config : SessionConfig
    capture : Capture
        Of the session.
    """
    files = [*input_roles(config)]
    if config.views_with_chart:
        files += chart_files(config, config.inputs)
    files += [name for name in (config.camera.lens, config.sensitivity.prior) if name is not None]
    if config.box is not None and config.box.colmap is not None:
        folder = config.box.colmap.folder.rstrip("/")
        files += [f"{folder}/{name}" for name in (CAMERAS_NAME, IMAGES_NAME)]
    scenes = [*capture.scenes.values(), capture.chart_scene]
    files += [os.path.relpath(path, config.folder) for scene in scenes if scene is not None
              for path in scene.files]
    return [*dict.fromkeys(files)]


def input_roles(config: SessionConfig) -> dict[str, str]:
    """Every file that a session measures with, by name: its role, of a further photo with its
    name.

    Parameters
    ----------
    config : SessionConfig
    """
    roles: dict[str, str] = {}
    for view in config.all_views:
        for role, names in (("object photo", view.photo_files),
                            ("light spectrum", view.light_files),
                            ("scene", [view.scene] if view.scene else []),
                            ("chart photo", view.chart_files)):
            for name in names:
                roles.setdefault(name, f"{role}, {view.name}" if view.name else role)
    for role, others in (("dark frame", config.photos.dark_files),
                         ("flat-field photo", config.photos.flats.values()),
                         ("chart scene",
                          [name for name in [config.chart.scene] if name is not None])):
        for name in others:
            roles.setdefault(name, role)
    if not config.sensitivity.from_chart and config.sensitivity.source.file is not None:
        roles.setdefault(config.sensitivity.source.file, "sensitivities")
    for material, section in config.surfaces.items():
        if section.measured is not None:
            roles.setdefault(section.measured.file, f"known spectrum of {material}")
    return roles


# ---- keys of kept records ------------------------------------------------------------------------

Key = dict[str, Any]


def step_keys(capture: Capture, inputs: InputFiles, device: str = "auto") -> dict[str, Key]:
    """What the record of each step of a capture is made from.

    Parameters
    ----------
    capture : Capture
    inputs : InputFiles
        Takes the state of every file that a key names.
    device : {"auto", "cpu", "cuda"}
        That renders, where a step does: other bits come of a GPU.

    Returns
    -------
    dict
        From the name of each step, in order, to its key: "files" (name to SHA-256), "settings"
        (part of the capture to its digest), "stages" (fingerprints of those before), "versions" and
        "code".

    Raises
    ------
    InputError
        If an input file is missing.
    """
    steps, installed = steps_of(capture), versions(DECISIVE)
    rendering = installed
    if any(step.renders for step in steps):
        renders = {"device": GPU} if device == GPU else {"llvm": llvm_name()}
        rendering = {**installed, **renders}
    code = room_digests(LIBRARY)
    keys: dict[str, Key] = {}
    for step in steps:
        files: dict[str, str] = {}
        settings = {name: _digest(_plain(part, inputs, files))
                    for name, part in step.inputs(capture).items()}
        keys[step.name] = {"files": files, "settings": settings,
                           "stages": {before: fingerprint(keys[before]) for before in step.after
                                      if before in keys},
                           "versions": rendering if step.renders else installed, "code": code}
    return keys


def digest_of_parts(parts: Mapping[str, Any]) -> str:
    """Digest of parts of a capture; of files their names, not what is in them.

    Parameters
    ----------
    parts : mapping
    """
    return _digest(_plain(parts, None, {}))


def _digest(plain: Any) -> str:
    return fingerprint({"": plain})[:32]


def _plain(value: Any, inputs: InputFiles | None, files: dict[str, str]) -> Any:
    """What JSON can hold of a part of a capture: arrays as their digests, files as their names.

    Parameters
    ----------
    value : record, table, array, file or what they are made of
    inputs : InputFiles or None
        None: files are not looked into.
    files : dict
        Takes name and SHA-256 of every file that is met; the only argument that is changed.
    """
    def plain(part: Any) -> Any:
        return _plain(part, inputs, files)

    if isinstance(value, InputFile):
        if inputs is not None:
            files |= inputs.digests(value.name)
        return value.name
    if isinstance(value, SceneFile):
        if inputs is not None:
            files |= inputs.digests(*(os.path.relpath(path, inputs.folder) for path in value.files))
        return [ET.tostring(value.root, encoding="unicode"), plain(value.profiles)]
    if isinstance(value, np.ndarray):
        whole = np.ascontiguousarray(value)
        return f"{whole.dtype.str}{whole.shape}{hashlib.sha256(whole.tobytes()).hexdigest()}"
    if isinstance(value, BaseModel):
        return plain(dict(value))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name))
                for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(name): plain(part) for name, part in value.items()}
    if isinstance(value, tuple | list):
        return [plain(part) for part in value]
    if isinstance(value, Enum | Path):
        return value.name
    return value
