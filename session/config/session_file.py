"""session.toml, read and checked: every fault at once, in sentences."""
from __future__ import annotations

import hashlib
import io
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from spectrabox.radiometry.checked_tables import (
    MAX_TOML_BYTES,
    fault_sentences,
    require_plain_toml,
)
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import read_bytes_of_text
from spectrabox.session.config.flat_session import FlatSession
from spectrabox.session.config.scene_session import SceneSession
from spectrabox.session.config.session_rules import inconsistencies
from spectrabox.session.config.session_schema import FILE_NAME, SessionConfig, SessionTables


def read_session(folder: Path, allow_outside: bool = False) -> SessionConfig:
    """The session described in ``folder``/session.toml.

    Raises
    ------
    InputError
        Naming every fault of the file at once: unknown keys with the nearest known one, wrong
        types, missing keys.
    """
    config, problems = try_read_session(folder, allow_outside)
    if config is None:
        raise InputError("\n".join(problems))
    return config


def try_read_session(folder: Path,
                     allow_outside: bool = False) -> tuple[SessionConfig | None, list[str]]:
    """The session, or None with every fault of its file in a sentence each."""
    try:
        content = session_content(folder)
        text = text_of(content)
    except InputError as error:
        return None, [str(error)]
    config, problems = session_of_text(text, folder, allow_outside)
    if config is not None:
        config = config.model_copy(update={"toml_sha256": hashlib.sha256(content).hexdigest()})
    return config, problems


def session_content(folder: Path) -> bytes:
    """What a folder's session.toml holds.

    Raises
    ------
    InputError
        If there is none, or it cannot be read or is larger than people write.
    """
    path = folder / FILE_NAME
    if folder.is_file():
        raise InputError(f"{folder} is a file; give the session folder, {folder.parent}")
    if not path.is_file():
        raise InputError(f"{path} is missing: write one with 'spectrabox new {folder}'")
    try:
        return read_bytes_of_text(path, MAX_TOML_BYTES)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): change its "
                         "permissions") from None


def text_of(content: bytes) -> str:
    """What a session.toml says, whatever its byte order mark and ends of lines.

    Raises
    ------
    InputError
        If it is not UTF-8, or larger or nested deeper than people write.
    """
    try:
        text = io.StringIO(content.decode("utf-8-sig"), newline=None).read()
    except ValueError as error:
        raise InputError(f"{FILE_NAME} is not valid TOML: {error}") from None
    require_plain_toml(text, FILE_NAME)
    return text


def toml_of(text: str) -> dict[str, Any]:
    """The tables of a session.toml as they are written.

    Raises
    ------
    InputError
        If it is no TOML: what the parser says, with line and column.
    """
    text = text_of(text.encode())
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:    # also numbers of 5000 digits, deep nesting
        raise InputError(f"{FILE_NAME} is not valid TOML: {error}") from None


def session_of_text(text: str, folder: Path,
                    allow_outside: bool = False) -> tuple[SessionConfig | None, list[str]]:
    """As ``try_read_session``, of a text that may not have been written yet.

    Parameters
    ----------
    text : str
        Of a session.toml.
    folder : Path
        Where it belongs.
    """
    config, problems = tables_of_text(text, folder, allow_outside)
    if config is not None:
        problems = inconsistencies(config)
    return (None, problems) if problems else (config, [])


def tables_of_text(text: str, folder: Path,
                   allow_outside: bool = False) -> tuple[SessionConfig | None, list[str]]:
    """As ``session_of_text``, where keys that are each well written need not go together.

    Parameters
    ----------
    text, folder, allow_outside
        As of ``session_of_text``.
    """
    try:
        written = toml_of(text)
        tables = SessionTables.model_validate(written)
    except InputError as error:
        return None, [str(error)]
    except ValidationError as error:
        return None, [f"{FILE_NAME}: {sentence}"
                      for sentence in fault_sentences(error, SessionTables)]
    kind = FlatSession if _of_flat_samples(tables) else SceneSession
    return kind(folder=folder, allow_outside=allow_outside, **written), []


def _of_flat_samples(tables: SessionTables) -> bool:
    """Whether regions of flat samples are measured; an empty [regions] says so before one is
    outlined.
    """
    scene_stated = tables.scene is not None or tables.materials
    return "regions" in tables.model_fields_set and (bool(tables.regions) or not scene_stated)
