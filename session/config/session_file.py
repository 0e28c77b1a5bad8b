"""session.toml, read and checked: every fault at once, in sentences."""
from __future__ import annotations

import hashlib
import io
import tomllib
from pathlib import Path
from typing import Any

from spectrabox.measure.captured import FlatCapture, SceneCapture
from spectrabox.measure.shoot import captures, rules, shoot
from spectrabox.measure.shoot.inputs import Inputs
from spectrabox.radiometry import checked_tables, errors, files

FILE_NAME = shoot.FILE_NAME


class SessionConfig(shoot.Shoot):
    """One session as its operator described it; file names are relative to ``folder``."""

    folder: Path
    allow_outside: bool
    toml_sha256: str = ""       # of the file as it was read

    @property
    def inputs(self) -> Inputs:
        """Its files."""
        return Inputs(self.folder, self.allow_outside)

    def capture(self) -> FlatCapture | SceneCapture:
        """What it measures, with everything read but its photos; raises as ``capture_of``."""
        return captures.capture_of(self, self.inputs)

    @property
    def results_folder(self) -> Path:
        """Where the stages keep their results."""
        return self.folder / "results"

    def path(self, name: str) -> Path:
        """Where a file of the session lies, as of ``Inputs``."""
        return self.inputs.path(name)


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
        raise errors.InputError(*problems)
    return config


def try_read_session(folder: Path,
                     allow_outside: bool = False) -> tuple[SessionConfig | None, list[str]]:
    """The session, or None with every fault of its file in a sentence each."""
    try:
        content = session_content(folder)
        text = text_of(content)
    except errors.InputError as error:
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
        raise errors.InputError(f"{folder} is a file; give the session folder, {folder.parent}")
    if not path.is_file():
        raise errors.InputError(f"{path} is missing: write one with 'spectrabox new {folder}'")
    try:
        return files.read_bytes_of_text(path, checked_tables.MAX_TOML_BYTES)
    except OSError as error:
        raise errors.InputError(f"{path} cannot be read ({error.strerror}): change its "
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
        raise errors.InputError(f"{FILE_NAME} is not valid TOML: {error}") from None
    checked_tables.require_plain_toml(text, FILE_NAME)
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
        raise errors.InputError(f"{FILE_NAME} is not valid TOML: {error}") from None


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


def inconsistencies(config: SessionConfig) -> list[str]:
    """A sentence for every pair of keys that do not go together."""
    return [f"{FILE_NAME}: {fault}" for fault in rules.faults_of(config, config.inputs)]


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
        shoot.Shoot.from_toml(written)
    except errors.InputError as error:
        return None, list(error.faults)
    return SessionConfig(folder=folder, allow_outside=allow_outside, **written), []
