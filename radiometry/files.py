"""Files written whole or not at all, their fingerprints, and words that name files."""
from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.system.words import is_whole_number, plain

MAX_TEXT_BYTES = 200_000_000      # a table of two million signals
UNFINISHED = ".spectrabox-"      # begins the name of a file that is being written


def names_a_file(word: str) -> bool:
    """Whether a word is the name of a file rather than of published data.

    It exists or ends like one; FL3.15 is a light: digits behind a dot are no suffix.

    Parameters
    ----------
    word : str
    """
    suffix = Path(word).suffix[1:]
    return is_there(Path(word)) or (suffix != "" and not suffix.isdigit())


def is_there(path: Path) -> bool:
    """Whether there is such a file or folder; a name too long for any is none."""
    try:
        return path.exists()
    except OSError:
        return False


def in_folder(path: str | Path) -> Path:
    """A path whose folder is there.

    Parameters
    ----------
    path : str or Path
        Of a file to be written.

    Raises
    ------
    InputError
        If there is no such folder.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise InputError(f"{target} cannot be written: there is no folder {target.parent}; make "
                         "it, or correct the path")
    return target


def require_utf8_name(path: Path) -> None:
    """Refuse a path that libraries which take UTF-8 alone cannot open.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
    """
    try:
        os.fspath(path).encode()
    except UnicodeEncodeError:
        raise InputError(f"{plain(str(path))} has a name that is not UTF-8, by which no picture "
                         "can be opened or written; rename it") from None


def read_text(path: Path, encoding: str = "utf-8-sig",
              limit_bytes: int = MAX_TEXT_BYTES) -> str:
    """The text of a file, its lines ended by a line feed each.

    Parameters
    ----------
    path : Path
    encoding : str
    limit_bytes : int

    Raises
    ------
    InputError, OSError
        As ``read_bytes_of_text``.
    UnicodeDecodeError
        If it is in another encoding.
    """
    content = read_bytes_of_text(path, limit_bytes)
    return io.StringIO(content.decode(encoding), newline=None).read()


def csv_rows(path: Path, what: str) -> list[list[str]]:
    """The rows of a CSV that hold anything.

    Raises
    ------
    InputError
        If the file cannot be read as text; ``what`` says what it should hold.
    """
    try:
        lines = read_text(path).splitlines()
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror}); give a CSV of {what}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path.name} is not a text file; give a CSV of {what}") from None
    return [row for row in csv.reader(lines) if any(map(str.strip, row))]


def read_bytes_of_text(path: Path, limit_bytes: int = MAX_TEXT_BYTES) -> bytes:
    """What a text file holds, whose size is one that texts have.

    Not ``Path.read_bytes``, which reads whatever there is: a disk image, or /dev/zero for ever.

    Parameters
    ----------
    path : Path
        A file, a pipe or a device.
    limit_bytes : int
        That such a text has at most.

    Raises
    ------
    InputError
        If it holds zero bytes, as no text does, or more than its limit.
    OSError
        If it cannot be read.
    """
    content = bytearray()
    with path.open("rb") as file:
        while part := file.read(1_000_000):
            content += part
            if 0 in part:
                raise InputError(f"{path.name} is not a text file: it holds zero bytes; give a "
                                 "text file")
            if len(content) > limit_bytes:
                raise InputError(too_large(path.name, limit_bytes))
    return bytes(content)


def too_large(name: str, limit_bytes: int) -> str:
    """What is said of a text file beyond its limit."""
    return (f"{name} is larger than {limit_bytes // 1_000_000} MB, the limit of such a file: take "
            "out what does not belong into it")


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
    return file_state(path)[0]


def file_state(path: Path) -> tuple[str, tuple[int, ...]]:
    """A file's content as SHA-256, and what changes when it is replaced or written to: device,
    inode, bytes, times of the last change.

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
            return hashlib.file_digest(stream, "sha256").hexdigest(), (
                of.st_dev, of.st_ino, of.st_size, of.st_mtime_ns, of.st_ctime_ns)
    except FileNotFoundError:
        raise InputError(
            f"{path} is missing: add the file or correct its name") from None
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
        As ``whole_file``.
    """
    with whole_file(path) as unfinished:
        unfinished.write_bytes(text.encode())


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """An empty file that takes the place of ``path`` when the block ends well, and is then on disk;
    it vanishes otherwise, also where Ctrl-C ends the block.

    Parameters
    ----------
    path : Path
        Its folder is made where it is missing.

    Raises
    ------
    EnvironmentProblem
        If the folder cannot be written, or the path is a link or a folder.
    """
    with writable(path.parent):
        require_no_link(path)
        if path.is_dir():
            raise EnvironmentProblem(f"{path} cannot be written: it is a folder; move it away, or "
                                     "name another file")
        # The name of its process: what a killed one leaves is swept, what one at work has is not.
        unfinished = path.with_name(f"{UNFINISHED}{os.getpid()}-{secrets.token_hex(6)}"
                                    f"{path.suffix}")
        try:
            # exclusive: it follows no link, and gets the permissions that the umask leaves
            os.close(os.open(unfinished, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            yield unfinished
            sync(unfinished)
            unfinished.replace(path)
            sync(path.parent)
        finally:
            unfinished.unlink(missing_ok=True)


@contextlib.contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """The name of a folder to be made that takes the place of ``path`` when the block ends well; it
    vanishes otherwise, also where Ctrl-C ends the block.

    Parameters
    ----------
    path : Path
        Its folder is made where it is missing.

    Raises
    ------
    EnvironmentProblem
        If it cannot be written, or the path is a link or a file.
    """
    with writable(path.parent):
        require_no_link(path)
        if path.is_file():
            raise EnvironmentProblem(f"{path} cannot be written: it is a file; move it away, or "
                                     "name another folder")
        stem = path.with_name(f"{UNFINISHED}{os.getpid()}-{secrets.token_hex(6)}")
        unfinished, before = (stem.with_suffix(suffix) for suffix in (path.suffix, ".old"))
        try:
            yield unfinished
            for file in unfinished.rglob("*"):
                if file.is_file():
                    sync(file)
            if path.exists():
                path.replace(before)
            unfinished.replace(path)
            sync(path.parent)
        finally:
            for left in (unfinished, before):
                shutil.rmtree(left, ignore_errors=True)


def require_no_link(path: Path) -> None:
    """Refuse to write through, or in place of, a symbolic link: it may lead anywhere.

    Raises
    ------
    EnvironmentProblem
    """
    if path.is_symlink():
        raise EnvironmentProblem(f"{path} is a symbolic link, and outputs follow none: remove it, "
                                 "or name what it leads to")


def sweep_unfinished(folder: Path) -> None:
    """Remove what killed processes left unfinished in a folder."""
    for left in folder.glob(f"{UNFINISHED}*"):
        number = left.name.removeprefix(UNFINISHED).partition("-")[0]
        if is_whole_number(number) and not _is_running(int(number)):
            if left.is_dir() and not left.is_symlink():
                shutil.rmtree(left, ignore_errors=True)
            else:
                left.unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def sync(path: Path) -> None:
    """Bring a file's content, or the names in a folder where the system can, onto the disk.

    Parameters
    ----------
    path : Path
        Of a folder after a rename in it, so that the rename survives a power cut.
    """
    folder = path.is_dir()
    if folder and not hasattr(os, "O_DIRECTORY"):
        return
    handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY if folder else os.O_RDWR)
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
        raise EnvironmentProblem(f"{folder} cannot be written ({error.strerror or error}): free "
                                 "space or change its permissions, then run again") from None
