"""session.toml, read and checked: every fault at once, in sentences."""
from __future__ import annotations

import hashlib
import io
import tomllib
from pathlib import Path

from pydantic import ValidationError

from spectrabox.radiometry.checked_tables import fault_sentences
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import read_bytes_of_text
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
        If there is none, or it cannot be read.
    """
    path = folder / FILE_NAME
    if folder.is_file():
        raise InputError(f"{folder} is a file; give the session folder, {folder.parent}")
    if not path.is_file():
        raise InputError(f"{path} is missing: write one with 'spectrabox new {folder}'")
    try:
        return read_bytes_of_text(path)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): change its "
                         "permissions") from None


def text_of(content: bytes) -> str:
    """What a session.toml says, whatever its byte order mark and ends of lines.

    Raises
    ------
    InputError
        If it is not UTF-8.
    """
    try:
        return io.StringIO(content.decode("utf-8-sig"), newline=None).read()
    except ValueError as error:
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
        written = tomllib.loads(text)
        SessionTables.model_validate(written)
    except ValidationError as error:
        return None, [f"{FILE_NAME}: {sentence}"
                      for sentence in fault_sentences(error, SessionTables)]
    except (ValueError, RecursionError) as error:    # also numbers of 5000 digits, deep nesting
        return None, [f"{FILE_NAME} is not valid TOML: {error}"]
    return SessionConfig(folder=folder, allow_outside=allow_outside, **written), []
