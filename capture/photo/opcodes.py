"""Corrections that a DNG states for its own pixels: the lists of opcodes (Adobe DNG 1.4, ch. 7).

A phone or a drone leaves the shading of its lens in the pixels and states a map of gains beside
them. Gains are applied to the signal, between the points of a map by bilinear interpolation, held
constant beyond them; the falling-off of a lens that is stated as a polynomial of the radius becomes
such a map. Everything else is named: geometry stays as the lens drew it.
"""
from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.photos import GainMap

VIGNETTE, GAIN_MAP = 3, 9
NAMES = {1: "WarpRectilinear", 2: "WarpFisheye", VIGNETTE: "FixVignetteRadial",
         4: "FixBadPixelsConstant", 5: "FixBadPixelsList", 6: "TrimBounds", 7: "MapTable",
         8: "MapPolynomial", GAIN_MAP: "GainMap", 10: "DeltaPerRow", 11: "DeltaPerColumn",
         12: "ScalePerRow", 13: "ScalePerColumn", 14: "WarpRectilinear2"}
GEOMETRY, BAD_PIXELS = (1, 2, 6, 14), (4, 5)
OPTIONAL = 1                # flag: a reader may leave the opcode out
BEFORE_BLACK = 0            # index of the list that applies to the file's values themselves
AFTER_DEMOSAICING = 2       # of the one whose planes are colours, in a mosaic too
MAX_OPCODES = 1000
# Points along each side of the map that a polynomial becomes: between them it is within 1e-4 of a
# gain of up to 3.
VIGNETTE_POINTS = 129
ALL_BANDS = 1 << 16         # planes of a map that applies to every band


class _Opcode(NamedTuple):
    kind: int
    flags: int
    content: bytes

    @property
    def name(self) -> str:
        return NAMES.get(self.kind, f"opcode {self.kind}")


def stated_corrections(lists: Sequence[bytes], size: tuple[int, int], mosaic: bool,
                       file: str) -> tuple[tuple[GainMap, ...], tuple[Finding, ...]]:
    """Maps of gains to apply, and what the lists state, applied and not.

    Parameters
    ----------
    lists : sequence of 3 bytes
        OpcodeList1 to 3 as the file holds them.
    size : (height, width)
        Of the active pixels.
    mosaic : bool
        Whether they are a mosaic, which has one plane until it is demosaiced.
    file : str
        For errors.

    Raises
    ------
    InputError
        If a list is damaged.
    """
    maps: list[GainMap] = []
    applied: dict[str, list[float]] = {}
    left: dict[str, list[str]] = {}
    forced = False
    for index, content in enumerate(lists):
        try:
            for opcode in _opcodes(content):
                if opcode.kind not in (GAIN_MAP, VIGNETTE) or index == BEFORE_BLACK:
                    code = ("file.geometry-left" if opcode.kind in GEOMETRY else
                            "file.bad-pixels-left" if opcode.kind in BAD_PIXELS else
                            "file.values-left")
                    left.setdefault(code, []).append(opcode.name)
                    forced |= code == "file.values-left" and not opcode.flags & OPTIONAL
                    continue
                one = (_gain_map(opcode.content, mosaic and index != AFTER_DEMOSAICING)
                       if opcode.kind == GAIN_MAP else _vignette(opcode.content, size))
                maps.append(one)
                applied.setdefault(opcode.name, []).extend(
                    [float(one.gains.min()), float(one.gains.max())])
        except (struct.error, ValueError) as error:
            raise InputError(f"raw photo {file} has a damaged list of corrections (OpcodeList"
                             f"{index + 1}: {error}); copy it from the camera card again") from None
    findings = [Finding("file.gains-applied", Severity.INFO, values={
        "opcode": name, "smallest": min(gains), "largest": max(gains)})
        for name, gains in applied.items()]
    for code, names in left.items():
        wrong = code == "file.values-left" and forced
        findings.append(Finding(code, Severity.WARN if wrong else Severity.NOTE,
                                values={"names": list(dict.fromkeys(names))}))
    return tuple(maps), tuple(findings)


def gains_at(maps: Sequence[GainMap], size: tuple[int, int], rows: np.ndarray, columns: np.ndarray,
             band: int) -> np.ndarray:
    """Product (n, m) of all gains at some rows (n,) and columns (m,), float32.

    Parameters
    ----------
    maps : sequence of GainMap
    size : (height, width)
        Of the active pixels, over which the positions of a map's points are relative.
    rows, columns : int arrays
        Of active pixels.
    band : int
    """
    product = np.ones((rows.size, columns.size), np.float32)
    for one in maps:
        if not one.plane <= band < one.plane + one.planes:
            continue
        top, left, bottom, right = one.area
        within = [(where >= first) & (where < last) & ((where - first) % pitch == 0)
                  for where, first, last, pitch in zip((rows, columns), (top, left),
                                                       (bottom, right), one.pitch, strict=True)]
        if not (within[0].any() and within[1].any()):
            continue
        plane = one.gains[..., min(band, one.gains.shape[2] - 1)]
        (above, down), (before, across) = (
            _between((where + 0.5) / side, origin, spacing, points)
            for where, side, origin, spacing, points in zip(
                (rows, columns), size, one.origin, one.spacing, plane.shape, strict=True))
        along = plane[above]
        along += down[:, None] * (plane[np.minimum(above + 1, len(plane) - 1)] - along)
        # no fancy index: half of the time
        gains = np.take(along, before, axis=1)
        if along.shape[1] > 1:
            gains += np.take(np.diff(along, axis=1), before, axis=1) * across
        if not (within[0].all() and within[1].all()):
            gains = np.where(within[0][:, None] & within[1], gains, np.float32(1))
        product *= gains
    return product


def _between(position: np.ndarray, origin: float, spacing: float,
             points: int) -> tuple[np.ndarray, np.ndarray]:
    """The points of a map before relative positions, and the way from there to the next."""
    index = np.clip((position - origin) / spacing if points > 1 else 0 * position, 0, points - 1)
    before = np.minimum(index.astype(int), max(points - 2, 0))
    return before, (index - before).astype(np.float32)


def _opcodes(content: bytes) -> Iterator[_Opcode]:
    """Opcodes of a list; big-endian whatever the byte order of the file."""
    if not content:
        return
    count, at = struct.unpack_from(">L", content)[0], 4
    if count > MAX_OPCODES:
        raise ValueError(f"{count} opcodes")
    for _ in range(count):
        kind, _, flags, size = struct.unpack_from(">4L", content, at)
        at += 16
        if at + size > len(content):
            raise ValueError("it is cut short")
        yield _Opcode(kind, flags, content[at:at + size])
        at += size


def _gain_map(content: bytes, one_plane: bool) -> GainMap:
    head = struct.Struct(">10L4dL")
    (top, left, bottom, right, plane, planes, row_pitch, column_pitch, points_y, points_x,
     spacing_y, spacing_x, origin_y, origin_x, map_planes) = head.unpack_from(content)
    count = points_y * points_x * map_planes
    if not count or not row_pitch or not column_pitch or len(content) < head.size + 4 * count:
        raise ValueError("a gain map without points")
    gains = np.frombuffer(content, ">f4", count, head.size).astype(np.float32).reshape(
        points_y, points_x, map_planes)
    if not np.all(np.isfinite(gains) & (gains > 0)) \
            or (points_y > 1 and not spacing_y > 0) or (points_x > 1 and not spacing_x > 0):
        raise ValueError("a gain map with gains or distances that are not positive")
    if one_plane:       # of a mosaic, whose plane holds every colour
        gains, plane, planes = gains[..., min(plane, map_planes - 1), None], 0, ALL_BANDS
    return GainMap(gains, (top, left, bottom, right), (row_pitch, column_pitch),
                   (origin_y, origin_x), (spacing_y, spacing_x), plane, planes)


def _vignette(content: bytes, size: tuple[int, int]) -> GainMap:
    """Gain 1 + k0 r^2 + k1 r^4 + ... + k4 r^10, r from the optical axis, 1 at the farthest corner.
    """
    *terms, centre_x, centre_y = struct.unpack_from(">7d", content)
    height, width = size
    y, x = ((np.linspace(0, 1, VIGNETTE_POINTS) - centre) * side
            for centre, side in ((centre_y, height), (centre_x, width)))
    squared = np.add.outer(y**2, x**2)
    squared /= np.max(squared[[0, 0, -1, -1], [0, -1, 0, -1]])
    gains = np.polynomial.polynomial.polyval(squared, [1.0, *terms])
    if not np.all(np.isfinite(gains) & (gains > 0)):
        raise ValueError("a falling-off with gains that are not positive")
    step = 1 / (VIGNETTE_POINTS - 1)
    return GainMap(gains[..., None].astype(np.float32), (0, 0, height, width), (1, 1), (0.0, 0.0),
                   (step, step), 0, ALL_BANDS)
