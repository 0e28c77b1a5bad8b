"""Keys of kept records: digests of the parts of a capture that a step reads, of the files behind
them, and of the code that made the record.
"""
from __future__ import annotations

import dataclasses
import hashlib
import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from spectrabox.measure.captured import Capture, InputFile
from spectrabox.measure.steps.declared_steps import steps_of
from spectrabox.reconstruct.rendering.llvm import llvm_name
from spectrabox.reconstruct.scene.scene_file import SceneFile
from spectrabox.session.store.input_files import InputFiles
from spectrabox.session.store.program import DECISIVE, LIBRARY, room_digests, versions
from spectrabox.session.store.store import fingerprint

Key = dict[str, Any]


def step_keys(capture: Capture, inputs: InputFiles) -> dict[str, Key]:
    """What the record of each step of a capture is made from.

    Parameters
    ----------
    capture : Capture
    inputs : InputFiles
        Takes the state of every file that a key names.

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
        rendering = {**installed, "llvm": llvm_name()}
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
