"""Stored results of a session: one folder per stage, replaced whole; any frozen record as a pair of
files.

Stored results of a session: one folder per stage, replaced whole, with the key of what it was
made from.

A stage's key is a plain dictionary (settings, files with their hashes, the keys of the stages
before, versions), kept beside the results, so that a stale stage can say why it is stale.
"""


from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import json
import shutil
import types
import typing
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from spectrabox.radiometry import errors, files, shaped
from spectrabox.radiometry.system.archives import DamagedArchiveError, opened_npz


class StoredByName(dict[str, Any]):
    """Records by the names of photos or surfaces, as an earlier session.toml may have had them."""

    def __missing__(self, name: str) -> Any:
        raise errors.InputError(
            "the stored results are of other photos or surfaces than session.toml "
            f"names, and hold nothing of {name!r}: 'spectrabox run' makes them again")


def pack(value: Any, name: str, arrays: dict[str, np.ndarray]) -> Any:
    """JSON-able form of a record; its arrays are put into ``arrays`` under dotted names.

    Parameters
    ----------
    value : record, array, enumeration, tuple or dictionary of these, or what JSON holds
    name : str
        Of the value, empty of the whole; parts of a record add theirs after a dot.
    arrays : dict
        Takes the arrays; the only argument that is changed.
    """
    if isinstance(value, shaped.Record):
        value = {f.name: getattr(value, f.name)
                 for f in dataclasses.fields(value)}  # type: ignore[arg-type]
    if isinstance(value, dict):
        return {key: pack(item, f"{name}.{key}" if name else key, arrays)
                for key, item in value.items()}
    if isinstance(value, np.ndarray):
        arrays[name] = value
        return {"array": name}
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, tuple):
        return [pack(item, f"{name}.{index}", arrays) for index, item in enumerate(value)]
    return value


def unpack(kind: Any, node: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    """The value of type ``kind`` that ``pack`` wrote.

    Parameters
    ----------
    kind : type
        Of a record's field, or of the record.
    node : what ``pack`` returned, after JSON
    arrays : mapping
        From dotted names to arrays.
    """
    if node is None:
        return None
    if isinstance(kind, types.UnionType) or typing.get_origin(kind) is typing.Union:
        kind = next(option for option in typing.get_args(kind) if option is not types.NoneType)
    if typing.get_origin(kind) is dict:
        return StoredByName({key: unpack(typing.get_args(kind)[1], item, arrays)
                             for key, item in node.items()})
    if isinstance(node, dict) and set(node) == {"array"}:
        return arrays[node["array"]]
    if isinstance(kind, type) and issubclass(kind, shaped.Record):
        return kind(**{name: unpack(hint, node[name], arrays)
                       for name, hint in _field_types(typing.cast(Any, kind)).items()})
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind[node]
    if typing.get_origin(kind) is tuple:
        return tuple(unpack(typing.get_args(kind)[0], item, arrays) for item in node)
    return node


@functools.cache
def _field_types(record: Any) -> dict[str, Any]:
    """Types of the fields of a record, by name."""
    hints = typing.get_type_hints(record)
    return {field.name: hints[field.name]
            for field in dataclasses.fields(record)}


def save_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Arrays under their names into one .npz, as they are: draws and covariances hardly shrink, and
    packing them would take longer than drawing them.
    """
    np.savez(path, **arrays)  # type: ignore[arg-type]


@contextlib.contextmanager
def opened_arrays(path: Path) -> Iterator[Mapping[str, np.ndarray]]:
    """Arrays of one .npz by name, each read from disk when it is asked for.

    Raises
    ------
    InputError
        If the file is damaged, or holds anything but plain arrays.
    """
    try:
        with opened_npz(path) as stored:
            yield stored
    except (OSError, DamagedArchiveError) as error:
        raise errors.InputError(f"the stored result {path.name} is damaged ({error}): remove "
                         f"{path.parent} and run again") from None


# ---- stored results of a session -----------------------------------------------------------------

FACTS, ARRAYS = "facts.json", "arrays.npz"
FORMAT = 7      # of the stored records; a stage of another is made again
T = TypeVar("T")


@dataclass(frozen=True)
class StoredStage:
    """One finished stage as it lies on disk."""

    folder: Path
    facts: dict[str, Any]
    damage: str | None = None       # the file that cannot be read

    @property
    def key(self) -> dict[str, Any]:
        return dict(self.facts["key"])

    @property
    def seconds(self) -> float:
        return float(self.facts["seconds"])

    @property
    def fault(self) -> str | None:
        """Why its results cannot be used, to end a sentence on them; None where they can."""
        if self.damage is not None:
            return f"are damaged ({self.damage})"
        return None if self.facts.get("format") == FORMAT \
            else "are of another version of spectrabox"

    def read(self, kind: type[T], *path: str) -> T:
        """The stage's record, or a part of it.

        Parameters
        ----------
        kind : type
            Of the result.
        path : str
            Names that lead to the part.

        Raises
        ------
        InputError
            If the stored files are damaged.
        """
        try:
            node = self.facts["records"]
            for name in path:
                node = node[name]
            with opened_arrays(self.folder / ARRAYS) as arrays:
                record: T = unpack(kind, node, arrays)
                return record
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise errors.InputError(f"the stored results of stage {self.folder.name} are damaged "
                             f"({error!r}): remove {self.folder} and run again") from None


def fingerprint(key: dict[str, Any]) -> str:
    """Hash of a key."""
    return hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()


def load_stage(results: Path, stage: str) -> StoredStage | None:
    """A stage's stored results, with a word for what in them is damaged; None where there are none.

    Nothing is mended here: another process may be at work.
    """
    folder = next((folder for folder in (results / stage, results / f".{stage}.old",
                                         results / stage) if folder.is_dir()), None)
    if folder is None:
        return None
    damage = None if zipfile.is_zipfile(folder / ARRAYS) else ARRAYS
    try:
        facts = json.loads((folder / FACTS).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        facts = None
    if not (isinstance(facts, dict) and isinstance(facts.get("key"), dict)
            and isinstance(facts.get("seconds"), int | float)):
        return StoredStage(folder, {"key": {}, "seconds": 0.0}, FACTS)
    return StoredStage(folder, facts, damage)


@contextlib.contextmanager
def stage_folder(results: Path, stage: str) -> Iterator[Path]:
    """An empty folder that takes the stage's place when the block ends well, is then on disk, and
    vanishes otherwise, also where Ctrl-C or a signal ends the block.
    """
    new, old, final = results / f".{stage}.new", results / f".{stage}.old", results / stage
    files.require_no_link(results)
    try:
        with files.writable(results):
            sweep_stage(results, stage)
            new.mkdir(parents=True)
        yield new
        with files.writable(results):
            for path in (*new.rglob("*"), new):
                files.sync(path)
            if final.exists():
                final.replace(old)
            new.replace(final)
            files.sync(results)
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(new, ignore_errors=True)


def sweep_stage(results: Path, stage: str) -> None:
    """Finish a replacement that was cut short, and remove what it left."""
    new, old, final = results / f".{stage}.new", results / f".{stage}.old", results / stage
    if old.exists() and not final.exists():
        old.replace(final)
    for left in (new, old):
        shutil.rmtree(left, ignore_errors=True)


def save_stage(folder: Path, key: dict[str, Any], records: Any, seconds: float,
               more: dict[str, Any]) -> None:
    """Write a stage's records and facts into its (temporary) folder.

    Parameters
    ----------
    folder : Path
        From ``stage_folder``.
    key : dict
        What the results are made from, as JSON gives it back.
    records : record or dict
        As ``record_files.pack`` takes it.
    more : dict
        Further facts to keep beside them.
    """
    arrays: dict[str, Any] = {}
    facts = {"format": FORMAT, "key": key, "seconds": round(seconds, 3), **more,
             "records": pack(records, "records", arrays)}
    with files.writable(folder.parent):
        save_arrays(folder / ARRAYS, arrays)
        (folder / FACTS).write_text(json.dumps(facts, indent=1), encoding="utf-8")


def copy_stage(stored: StoredStage, folder: Path) -> None:
    """Copy a stage's files into the (temporary) folder of another place.

    Parameters
    ----------
    stored : StoredStage
        Undamaged.
    folder : Path
        From ``stage_folder``.
    """
    with files.writable(folder.parent):
        shutil.copytree(stored.folder, folder, symlinks=True, dirs_exist_ok=True)


def why_stale(stored: dict[str, Any], current: dict[str, Any]) -> list[str]:
    """What differs between two keys, in words.

    Parameters
    ----------
    stored, current : dict
        Keys of a stage: parts by name, each a dictionary.
    """
    reasons = []
    for part in sorted(stored.keys() | current.keys()):
        before, now = stored.get(part, {}), current.get(part, {})
        if not (isinstance(before, dict) and isinstance(now, dict)):
            reasons += [f"{part} changed"] if before != now else []
            continue
        for name in sorted(before.keys() | now.keys()):
            if name not in now:
                reasons.append(f"{part}: {name} is no longer used")
            elif name not in before:
                reasons.append(f"{part}: {name} is new")
            elif before[name] != now[name]:
                reasons.append(f"{part}: {name} changed")
    return reasons
