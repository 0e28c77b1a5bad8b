"""Which of our files a result was made by, read from the imports, and what is in them.

A module depends on every module that it imports, at its top or inside a function, on the
``__init__`` of the packages around those, and on the model files that lie beside it. Imports under
``if TYPE_CHECKING`` are never run. The statements are read by a pattern, since parsing 250 files
takes half a second; a test compares them with what Python's own parser reads.
"""
from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath

import spectrabox

PACKAGE = Path(spectrabox.__file__).resolve().parent
MODULE, MODEL = ".py", ".npz"
FOR_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:(?:[ \t]+.*)?\n)+", re.MULTILINE)
# The name comes first, and what stands before it last: a pattern that begins with letters is fast.
IMPORT = re.compile(r"spectrabox(?<=(?:rom|ort) spectrabox)([\w.]*)"
                    r"(?: import (\([^)]*\)|[^\n]*))?")


def stage_code(entries: Mapping[str, str], package: Path = PACKAGE) -> dict[str, dict[str, str]]:
    """Digests of the code and models that each stage depends on, by room.

    Parameters
    ----------
    entries : mapping
        From each stage's name to the module of its function, ``spectrabox.session.stages...``.
    package : Path
        Folder of the package.
    """
    contents, digests = PackageFiles(package), {}
    graph, hashes = ImportGraph(contents), dict[str, bytes]()
    for stage, entry in entries.items():
        rooms: dict[str, hashlib._Hash] = {}
        for file in sorted(files_behind(entry, graph)):
            if file not in hashes:
                hashes[file] = hashlib.sha256(contents[file]).digest()
            room = rooms.setdefault(file.split("/")[0], hashlib.sha256())
            room.update(file.encode() + hashes[file])
        digests[stage] = {room: digest.hexdigest() for room, digest in rooms.items()}
    return digests


class PackageFiles(Mapping[str, bytes]):
    """Every module and model file by its path from the package's folder, read where it is asked
    for: a stage needs half of them.

    Parameters
    ----------
    package : Path
        Folder of the package.
    """

    def __init__(self, package: Path) -> None:
        self._package, self._read = package, dict[str, bytes]()
        # Room by room: a search through the whole package would not follow the links to its rooms.
        rooms = list(package.iterdir())
        paths = [str(room) for room in rooms]
        for room in rooms:
            paths += [f"{folder}/{name}" for folder, _, names in os.walk(room) for name in names]
        self._names = frozenset(path[len(str(package)) + 1:] for path in paths
                                if path.endswith((MODULE, MODEL)))

    def __contains__(self, file: object) -> bool:
        return file in self._names      # without reading it

    def __getitem__(self, file: str) -> bytes:
        if file not in self:
            raise KeyError(file)
        if file not in self._read:
            self._read[file] = (self._package / file).read_bytes()
        return self._read[file]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class ImportGraph(dict[str, frozenset[str]]):
    """What each file depends on directly, found out where it is asked for.

    Parameters
    ----------
    contents : mapping
        Of the files of a package, by name.
    """

    def __init__(self, contents: Mapping[str, bytes]) -> None:
        super().__init__()
        self._contents = contents
        self._models: dict[str, set[str]] = {}
        for file in contents:
            if file.endswith(MODEL):
                # a model lies beside the module that reads it, or in a folder of models there
                for folder in list(PurePosixPath(file).parents)[:2]:
                    self._models.setdefault(str(folder), set()).add(file)

    def __missing__(self, file: str) -> frozenset[str]:
        if file.endswith(MODULE):
            imported = imported_files(self._contents[file].decode(), self._contents)
            self[file] = frozenset({*imported, *self._models.get(file.rpartition("/")[0] or ".",
                                                                 ())})
        else:
            self[file] = frozenset()
        return self[file]


def imported_files(source: str, contents: Mapping[str, bytes]) -> Iterator[str]:
    """The modules of ours that a source imports, and the packages around them.

    Parameters
    ----------
    source : str
        Of a module.
    contents : mapping
        Whose names are the files of the package.
    """
    if "TYPE_CHECKING" in source:
        source = FOR_TYPES.sub("", source)
    for module, names in IMPORT.findall(source):
        around = module.split(".")[1:]
        words = re.findall(r"\w+", re.sub(r"#.*", "", names))
        paths = [around[:end] for end in range(len(around) + 1)]
        paths += [[*around, word] for word in words]
        for path in paths:
            for file in ("/".join(path) + MODULE, "/".join([*path, "__init__.py"])):
                if file in contents:
                    yield file


def files_behind(entry: str, graph: Mapping[str, frozenset[str]]) -> set[str]:
    """Every file that the module ``entry`` depends on, itself among them.

    Parameters
    ----------
    entry : str
        Name of a module, with its package.
    graph : mapping
        As ``ImportGraph``.
    """
    waiting, reached = ["/".join(entry.split(".")[1:]) + MODULE], set()
    while waiting:
        file = waiting.pop()
        if file not in reached:
            reached.add(file)
            waiting += graph[file]
    return reached
