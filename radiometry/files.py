"""Files written whole or not at all, their fingerprints, and words that name files."""
from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from spectrabox.radiometry.errors import EnvironmentProblem, InputError


def names_a_file(word: str) -> bool:
    """Whether a word is the name of a file rather than of published data.

    It exists or ends like one; FL3.15 is a light: digits behind a dot are no suffix.

    Parameters
    ----------
    word : str
    """
    suffix = Path(word).suffix[1:]
    return Path(word).exists() or (suffix != "" and not suffix.isdigit())


@dataclass(frozen=True)
class FileState:
    """What a file is at one moment: equal only where nobody has written to it in between."""

    sha256: str
    stamp: tuple[int, ...]      # device, inode, bytes, times of the last change


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's content.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If the file is missing or cannot be read.
    """
    return file_state(path).sha256


def file_state(path: Path) -> FileState:
    """A file's content as SHA-256, with what changes when it is replaced or written to.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If the file is missing or cannot be read.
    """
    if path.exists() and not path.is_file():    # a pipe would be waited for
        raise InputError(f"{path} is not a file; give the file")
    try:
        with path.open("rb") as stream:
            # Taken first: what is written while the file is read shows in the next state.
            of = os.fstat(stream.fileno())
            return FileState(hashlib.file_digest(stream, "sha256").hexdigest(),
                             (of.st_dev, of.st_ino, of.st_size, of.st_mtime_ns, of.st_ctime_ns))
    except FileNotFoundError:
        raise InputError(
            f"{path} is missing: add the file or correct its name in session.toml") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None


def write_text_whole(path: Path, text: str) -> None:
    """Write a text file that is on disk, whole, when this returns; a crash leaves the old one.

    Parameters
    ----------
    path : Path
        Its folder is made where it is missing.
    text : str

    Raises
    ------
    EnvironmentProblem
        If the folder cannot be written.
    """
    with writable(path.parent):
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as stream:
                stream.write(text)
                stream.flush()
                os.fsync(stream.fileno())
            Path(temporary).chmod(0o644)
            Path(temporary).replace(path)
            sync_folder(path.parent)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise


def sync_folder(folder: Path) -> None:
    """Make a rename in a folder survive a power cut, where the system can."""
    if hasattr(os, "O_DIRECTORY"):
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextlib.contextmanager
def writable(folder: Path) -> Iterator[None]:
    """Turn a refused write below a folder into one sentence.

    Parameters
    ----------
    folder : Path
        Made where it is missing.

    Raises
    ------
    EnvironmentProblem
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise EnvironmentProblem(f"{folder} cannot be written ({error.strerror}): free space or "
                                 "change its permissions, then run again") from None
