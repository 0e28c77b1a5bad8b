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
    path = folder / FILE_NAME
    if folder.is_file():
        return None, [f"{folder} is a file; give the session folder, {folder.parent}"]
    if not path.is_file():
        return None, [f"{path} is missing: write one with 'spectrabox new {folder}'"]
    try:
        content = read_bytes_of_text(path)
        text = io.StringIO(content.decode("utf-8-sig"), newline=None).read()
    except ValueError as error:
        return None, [f"{FILE_NAME} is not valid TOML: {error}"]
    except InputError as error:
        return None, [str(error)]
    except OSError as error:
        return None, [f"{path} cannot be read ({error.strerror}): change its permissions"]
    config, problems = session_of_text(text, folder, allow_outside)
    if config is not None:
        config = config.model_copy(update={"toml_sha256": hashlib.sha256(content).hexdigest()})
    return config, problems


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
    try:
        written = tomllib.loads(text)
        SessionTables.model_validate(written)
    except ValidationError as error:
        return None, [f"{FILE_NAME}: {sentence}"
                      for sentence in fault_sentences(error, SessionTables)]
    except (ValueError, RecursionError) as error:    # also numbers of 5000 digits, deep nesting
        return None, [f"{FILE_NAME} is not valid TOML: {error}"]
    config = SessionConfig(folder=folder, allow_outside=allow_outside, **written)
    problems = inconsistencies(config)
    return (None, problems) if problems else (config, [])
