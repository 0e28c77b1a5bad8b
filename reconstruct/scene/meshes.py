"""Files of meshes and curves, read before Mitsuba reads them.

Mitsuba trusts the numbers of a mesh: a face that names a vertex which is not there ends the process
without a word (SIGSEGV), and a count that a file does not hold takes that much memory. The formats
are those of Mitsuba 3.9 [src/shapes/ply.h, obj.cpp, serialized.cpp, linearcurve.cpp]; what its
readers would take for something else than this file does is refused.
"""
from __future__ import annotations

import functools
import mmap
import os
import re
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from spectrabox.radiometry.errors import InputError

MAX_MESH_BYTES = 1 << 30        # about 10 million triangles; of a compressed mesh, when inflated
MAX_TEXT_BYTES = 100_000_000    # of a mesh as text
MAX_HEADER_BYTES = 100_000
BLOCK = 1 << 16                 # bytes, or faces, at a time
# numpy's codes of the types of PLY; the right-hand names are other programs'
PLY_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
             "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2",
             "uint16": "u2", "int32": "i4", "uint32": "u4", "long": "i8", "ulong": "u8",
             "half": "f2", "float16": "f2", "float32": "f4", "float64": "f8"}
# a number of a text that no reader ends before its last character
NUMBER = rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
OTHER_THAN_NUMBERS = re.compile(rb"(?<!\S)(?!" + NUMBER + rb"(?!\S))\S+")
OBJ_FACE = re.compile(rb"(?:[ \t]+\d+(?:/\d*){0,2})+[ \t\r]*")
# of a serialized mesh
MAGIC, VERSIONS = 0x041C, (3, 4)
NORMALS, UVS, COLOURS, SINGLE, DOUBLE = 0x1, 0x2, 0x8, 0x1000, 0x2000
MAX_NAME_BYTES = 10_000


def require_sound_meshes(root: ET.Element) -> None:
    """Refuse a scene one of whose meshes would end the process, before Mitsuba is given it.

    Parameters
    ----------
    root : Element
        A <scene> whose files are named in full.

    Raises
    ------
    InputError
        Naming the file, the face, its vertex and how many there are.
    """
    for shape in root.iter("shape"):
        kind = shape.get("type", "")
        if kind not in READERS:
            continue
        parts = [node.get("value", "") for node in shape.findall("integer")
                 if node.get("name") == "shape_index"] or ["0"]
        for node in shape.findall("string"):
            if node.get("name") != "filename":
                continue
            path = Path(node.get("value", ""))
            for part in parts:
                if not re.fullmatch(r"[0-9]{1,9}", part):
                    _refuse(path, f"is asked for the mesh shape_index = {part!r}",
                            "write a whole number")
                require_sound_mesh(path, kind, int(part))


def require_sound_mesh(path: Path, kind: str, part: int = 0) -> None:
    """Refuse a file of a mesh or of curves that would end the process, or take absurd memory.

    Parameters
    ----------
    path : Path
    kind : {"ply", "obj", "serialized", "linearcurve", "bsplinecurve"}
        The shape that names it.
    part : int
        Which of the meshes of a serialized file.

    Raises
    ------
    InputError
    """
    try:
        state = path.stat()
        if not path.is_file():
            _refuse(path, "is no file", "give the file of the mesh")
        _sound(path, kind, part, (state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns,
                                  state.st_ctime_ns))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); give the file of the "
                         "mesh") from None


@functools.lru_cache(maxsize=10_000)
def _sound(path: Path, kind: str, part: int, state: tuple[int, ...]) -> None:
    """Read a file once for as long as it stays as it is: a scene is loaded many times."""
    limit = MAX_MESH_BYTES if kind in ("ply", "serialized") else MAX_TEXT_BYTES
    if state[2] > limit:
        _refuse(path, f"has {state[2]} bytes, of which {limit} is the limit", "give a coarser mesh")
    READERS[kind](path, part)


def _refuse(path: Path, found: str, advice: str) -> NoReturn:
    raise InputError(f"{path.name} {found}; {advice}")


def _require_faces(path: Path, faces: int) -> None:
    """Refuse a mesh without a face, of which Mitsuba says nothing that helps."""
    if faces == 0:
        _refuse(path, "has no face", "give a mesh with triangles, or take its shape out")


def _require_vertices(path: Path, indices: np.ndarray, vertices: int, first: int = 0) -> None:
    """Refuse faces (F, 3) that name vertices which are not there, the first being 0."""
    wrong = np.argwhere((indices < 0) | (indices >= vertices))
    if wrong.size:
        face, corner = wrong[0]
        _refuse_vertex(path, first + int(face), int(indices[face, corner]), vertices)


def _refuse_vertex(path: Path, face: int, index: int, vertices: int) -> NoReturn:
    _refuse(path, f"is damaged: face {face} names the vertex {index}, and there are {vertices}, "
            f"numbered from 0", "export the mesh again")


# ---- PLY -----------------------------------------------------------------------------------------

def _check_ply(path: Path, part: int) -> None:
    del part        # a PLY holds one mesh
    with path.open("rb") as file:
        order, elements = _ply_header(path, file.readline)
        start, size = file.tell(), os.fstat(file.fileno()).st_size
        names = [name for name, _, _ in elements]
        if sorted(name for name in names if name in ("vertex", "face")) != ["face", "vertex"]:
            _refuse(path, f"has the elements {', '.join(names) or 'none'}, and a mesh has one "
                    "vertex and one face", "export the mesh again")
        vertices = next(count for name, count, _ in elements if name == "vertex")
        _require_faces(path, next(count for name, count, _ in elements if name == "face"))
        if order == "":
            if size > MAX_TEXT_BYTES:
                _refuse(path, f"has {size} bytes of text, of which {MAX_TEXT_BYTES} is the limit",
                        "export it as binary PLY")
            _check_ply_text(path, file.read(), elements, vertices)
            return
        records = [np.dtype([(f"{number}", order + code)
                             for number, (_, code) in enumerate(properties)])
                   for _, _, properties in elements]
        needed = sum(count * record.itemsize
                     for (_, count, _), record in zip(elements, records, strict=True))
        if needed != size - start:
            _refuse(path, f"is damaged: its header says {needed} bytes of triangles and vertices, "
                    f"and {size - start} follow", "export the mesh again, with triangles alone")
        for (name, count, properties), record in zip(elements, records, strict=True):
            if name != "face":
                file.seek(count * record.itemsize, os.SEEK_CUR)
                continue
            columns = _corner_columns(properties)
            for first in range(0, count, BLOCK):
                rows = np.fromfile(file, record, min(BLOCK, count - first))
                lengths = rows[str(columns[0] - 1)]
                _require_triangles(path, lengths, first)
                indices = np.column_stack([rows[str(column)] for column in columns])
                _require_vertices(path, indices, vertices, first)


def _check_ply_text(path: Path, body: bytes,
                    elements: Sequence[tuple[str, int, list[tuple[str, str]]]],
                    vertices: int) -> None:
    if wrong := OTHER_THAN_NUMBERS.search(body):
        _refuse(path, f"is damaged: {wrong[0][:40]!r} is no number", "export the mesh again")
    words = body.split()
    needed = sum(count * len(properties) for _, count, properties in elements)
    if needed != len(words):
        _refuse(path, f"is damaged: its header says {needed} numbers of triangles and vertices, "
                f"and {len(words)} follow", "export the mesh again, with triangles alone")
    start = 0
    for name, count, properties in elements:
        end = start + count * len(properties)
        for column, (_, code) in enumerate(properties):
            column_words = words[start + column:end:len(properties)]
            # a reader of whole numbers takes 1.5 for two of them
            if code[0] in "iu" and not all(word.lstrip(b"-").isdigit() for word in column_words):
                _refuse(path, f"is damaged: of {name}, {properties[column][0]} is no whole number",
                        "export the mesh again")
        if name == "face" and count:
            columns = _corner_columns(properties)
            numbers = [np.array(words[start + column:end:len(properties)]).astype(float)
                       for column in (columns[0] - 1, *columns)]
            _require_triangles(path, numbers[0], 0)
            _require_vertices(path, np.column_stack(numbers[1:]), vertices)
        start = end


def _ply_header(path: Path, readline: object) -> tuple[str, list[tuple[str, int, list[
        tuple[str, str]]]]]:
    """Order of bytes (empty of text), and of each element its name, count and properties with their
    codes of numpy; a list is one of three.
    """
    assert callable(readline)
    order: str | None = None
    elements: list[tuple[str, int, list[tuple[str, str]]]] = []
    seen = 0
    orders = {b"ascii": "", b"binary_little_endian": "<", b"binary_big_endian": ">"}
    while True:
        line: bytes = readline(MAX_HEADER_BYTES)
        words, seen = line.split(), seen + len(line)
        if not line or seen > MAX_HEADER_BYTES or not (seen > len(line) or words == [b"ply"]):
            _refuse(path, "has no header of a PLY", "give a mesh as PLY")
        if words == [b"end_header"]:
            break
        match words:
            case [] | [b"ply"] | [b"comment", *_]:
                pass
            case [b"format", kind, b"1.0"] if kind in orders and order is None:
                order = orders[kind]
            case [b"element", name, count] if re.fullmatch(rb"[0-9]{1,12}", count):
                elements.append((name.decode("latin-1"), int(count), []))
            case [b"property", b"list", length, index, b"vertex_index" | b"vertex_indices"] if (
                    elements and elements[-1][0] == "face"
                    and not _corner_columns(elements[-1][2])
                    and _code(length)[:1] in ("i", "u") and _code(index)[:1] in ("i", "u")):
                elements[-1][2].extend([("count", _code(length)),
                                        *((f"corner {corner}", _code(index))
                                          for corner in range(3))])
            case [b"property", kind, name] if elements and _code(kind):
                elements[-1][2].append((name.decode("latin-1"), _code(kind)))
            case _:
                _refuse(path, f"has the line {line.strip()[:60]!r} in its header, which no mesh "
                        "for Mitsuba has", "export it with positions, normals, texture "
                        "coordinates and triangles alone")
    if order is None:
        _refuse(path, "does not say in its header how it is stored", "export the mesh again")
    for element, number, properties in elements:
        if number and not properties:
            _refuse(path, f"has {number} of {element!r} without a property",
                    "export the mesh again")
        if element == "face" and not _corner_columns(properties):
            _refuse(path, "has faces without a list vertex_indices", "export the mesh again")
    return order, elements


def _code(kind: bytes) -> str:
    return PLY_TYPES.get(kind.decode("latin-1"), "")


def _corner_columns(properties: Sequence[tuple[str, str]]) -> tuple[int, ...]:
    return tuple(number for number, (name, _) in enumerate(properties)
                 if name.startswith("corner "))


def _require_triangles(path: Path, lengths: np.ndarray, first: int) -> None:
    other = np.flatnonzero(lengths != 3)
    if other.size:
        _refuse(path, f"has a face of {int(lengths[other[0]])} vertices (face "
                f"{first + int(other[0])}), and Mitsuba knows triangles alone",
                "export it with triangles")


# ---- text ----------------------------------------------------------------------------------------

def _lines(path: Path) -> Iterator[bytes]:
    """Lines of a text without the spaces around them, as Mitsuba finds them in memory."""
    with path.open("rb") as file:
        last = b"\n"
        for line in file:
            if b"\0" in line:
                _refuse(path, "is no text: it holds zero bytes", "give the mesh as PLY")
            if len(line) > 1000:
                _refuse(path, "has a line of more than 1000 characters", "give the mesh as PLY")
            last = line
            yield line.strip(b" \t\r\n")
        # its reader looks one byte beyond the text for the last line's end: there is none
        if file.tell() % mmap.PAGESIZE == 0 and not last.endswith(b"\n"):
            _refuse(path, "has no line break at its end", "add one")


def _check_obj(path: Path, part: int) -> None:
    del part        # an OBJ is one mesh
    counts, face = {b"v": 0, b"vt": 0, b"vn": 0}, 0
    for line in _lines(path):
        word, rest = line[:2].rstrip(b" \t"), line[1:]
        if word in counts and line[len(word):len(word) + 1] in (b" ", b"\t"):
            counts[word] += 1
        if line[:2] not in (b"f ", b"f\t"):
            continue
        rest = rest.partition(b"#")[0]
        corners = [corner.split(b"/") for corner in rest.split()]
        if not OBJ_FACE.fullmatch(rest) or len(corners) < 3:
            _refuse(path, f"is damaged: its face {face} reads {line[:60]!r}", "export the mesh "
                    "again, its faces as 'f 1 2 3', 'f 1/1 2/2 3/3' or 'f 1//1 2//2 3//3'")
        for corner in corners:
            for kind, number in zip((b"v", b"vt", b"vn"), corner, strict=False):
                # 0 stands for none, but of vertices
                if number and not (kind != b"v" and int(number) == 0) \
                        and not 1 <= int(number) <= counts[kind]:
                    what = {b"v": "vertex", b"vt": "texture coordinate", b"vn": "normal"}[kind]
                    _refuse(path, f"is damaged: face {face} names the {what} {int(number)}, and "
                            f"there are {counts[kind]} before it, numbered from 1",
                            "export the mesh again")
        face += 1
    _require_faces(path, face)


def _check_curves(path: Path, part: int) -> None:
    del part        # all curves of a file belong to one shape
    points = 0
    for number, line in enumerate(_lines(path), start=1):
        points += bool(line)
        if line and (len(line.split()) != 4 or OTHER_THAN_NUMBERS.search(line)):
            _refuse(path, f"has in line {number} {line[:60]!r}", "write x, y, z and the radius of "
                    "a point of a curve, and an empty line between curves")
    if points == 0:
        _refuse(path, "has no point of a curve", "give one, or take its shape out")


# ---- serialized meshes ---------------------------------------------------------------------------

class _Inflated:
    """What a compressed stream of a file holds, a part at a time."""

    def __init__(self, path: Path, start: int) -> None:
        self.path, self.file = path, path.open("rb")
        self.file.seek(start)
        self.stream, self.rest, self.seen = zlib.decompressobj(), b"", 0

    def read(self, length: int) -> bytes:
        """The next bytes, as many as asked for."""
        parts: list[bytes] = []
        while length > 0:
            self.rest = self.rest or self.file.read(BLOCK)
            if not self.rest:
                _refuse(self.path, f"is damaged: it ends after {self.seen} bytes of a mesh",
                        "export the mesh again")
            if self.stream.eof:
                _refuse(self.path, f"is damaged: a mesh ends after {self.seen} bytes",
                        "export the mesh again")
            try:
                part = self.stream.decompress(self.rest, length)
            except zlib.error as error:
                _refuse(self.path, f"is damaged: {error}", "export the mesh again")
            self.rest = self.stream.unconsumed_tail
            length -= len(part)
            self.seen += len(part)
            parts.append(part)
        return b"".join(parts)

    def number(self, length: int) -> int:
        """The next whole number of so many bytes."""
        return int.from_bytes(self.read(length), "little")


def _check_serialized(path: Path, part: int) -> None:
    start, version = _serialized_start(path, part)
    stream = _Inflated(path, start + 4)
    try:
        flags = stream.number(4)
        if version == 4:
            for _ in range(MAX_NAME_BYTES):
                if stream.read(1) == b"\0":
                    break
            else:
                _refuse(path, f"has a mesh whose name is longer than {MAX_NAME_BYTES} characters",
                        "export the mesh again")
        vertices, faces = stream.number(8), stream.number(8)
        _require_faces(path, faces)
        size = 8 if flags & DOUBLE else 4
        columns = 3 + 3 * bool(flags & NORMALS) + 2 * bool(flags & UVS) + 3 * bool(flags & COLOURS)
        needed = vertices * columns * size + faces * 12
        if needed > MAX_MESH_BYTES:
            _refuse(path, f"says that it has {vertices} vertices and {faces} faces, which take "
                    f"{needed} bytes; {MAX_MESH_BYTES} is the limit", "give a coarser mesh")
        left = vertices * columns * size
        positions = vertices * 3 * size
        while left > 0:
            block = min(left, BLOCK * 24, positions or left)
            values = np.frombuffer(stream.read(block), "<f8" if flags & DOUBLE else "<f4")
            # beyond what single precision holds, or not a number
            if positions and not np.all(np.abs(values) < 1e38):
                _refuse(path, "has vertices whose positions are not numbers",
                        "export the mesh again")
            left, positions = left - block, max(positions - block, 0)
        for first in range(0, faces, BLOCK):
            rows = min(BLOCK, faces - first)
            indices = np.frombuffer(stream.read(rows * 12), "<u4").reshape(rows, 3)
            _require_vertices(path, indices, vertices, first)
    finally:
        stream.file.close()


def _serialized_start(path: Path, part: int) -> tuple[int, int]:
    """Where a mesh of a file begins, and the version of the format."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(4)
        magic, version = (int.from_bytes(head[at:at + 2], "little") for at in (0, 2))
        if magic != MAGIC or version not in VERSIONS:
            _refuse(path, f"is no serialized mesh of version {' or '.join(map(str, VERSIONS))}",
                    "give the mesh as PLY")
        if part == 0:
            return 0, version
        # at the end: the starts of all meshes, and how many there are
        width = 8 if version == 4 else 4
        file.seek(max(size - 4, 0))
        count = int.from_bytes(file.read(4), "little")
        table = size - 4 - width * count
        if part >= count or table < 4:
            _refuse(path, f"has {count} meshes, and shape_index = {part} is asked for",
                    "write the number of one of them, from 0")
        file.seek(table + width * part)
        start = int.from_bytes(file.read(width), "little")
        if start > table - 4:
            _refuse(path, f"is damaged: its mesh {part} begins at byte {start} of {size}",
                    "export the mesh again")
        return start, version


READERS = {"ply": _check_ply, "obj": _check_obj, "serialized": _check_serialized,
           "linearcurve": _check_curves, "bsplinecurve": _check_curves}
