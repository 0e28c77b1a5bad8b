"""Spectral OpenEXR (Fichet et al. 2021, "An OpenEXR Layout for Spectral Images"): the mean over the
picture as a spectrum.

Scan lines uncompressed or with ZIP, ZIPS or RLE compression; single part. Channels are named
``S0.560,000000nm`` (light) or ``T.560,000000nm`` (reflectance). Other compressions are refused with
what to do.
"""
from __future__ import annotations

import re
import struct
import zlib
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats.table import MAX_VALUES, SpectralTable

MAGIC = b"\x76\x2f\x31\x01"
CHANNEL = re.compile(r"(?:.*\.)?(S0|T)\.(\d+[,.]?\d*)(nm|um|m)")
METRES = {"nm": 1.0, "um": 1e3, "m": 1e9}
LINES_PER_BLOCK = {0: 1, 1: 1, 2: 1, 3: 16}
COMPRESSIONS = ("none", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
PIXEL_TYPES = {0: "<u4", 1: "<f2", 2: "<f4"}
RADIANCE_UNITS = ("w.m^-2.sr^-1", "w.m^-2.sr^-1.nm^-1", "w m-2 sr-1 nm-1")


def read_spectral_exr(content: bytes, path: Path) -> SpectralTable:
    """Mean over all pixels of each wavelength, with its standard error where there are several
    pixels.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.

    Raises
    ------
    InputError
    """
    try:
        attributes, at = _attributes(content)
        channels = _channels(attributes["channels"])
        window = struct.unpack("<4i", attributes["dataWindow"])
        compression = attributes["compression"][0]
    except (struct.error, KeyError, IndexError, ValueError, OverflowError):
        raise InputError(
            f"{path.name} is cut or damaged in its header; copy the file again") from None
    width, height = window[2] - window[0] + 1, window[3] - window[1] + 1
    spectral = {name: match for name, _, _ in channels if (match := CHANNEL.fullmatch(name))}
    if not spectral:
        raise InputError(f"{path.name} is an ordinary EXR picture "
                         f"({', '.join(name for name, _, _ in channels[:4])}), not a "
                         "spectral one; a spectral one has channels such as S0.560nm or T.560nm")
    _check_layout(content, attributes, channels, compression, width, height, path.name)
    try:
        planes = _planes(content, at, channels, width, height, compression, window[1])
    except (struct.error, zlib.error, ValueError, IndexError, OverflowError):
        raise InputError(
            f"{path.name} is cut or damaged in its pixels; copy the file again") from None
    kinds = {match[1] for match in spectral.values()}
    kind = "S0" if "S0" in kinds else "T"
    chosen = sorted((float(match[2].replace(",", ".")) * METRES[match[3]], name)
                    for name, match in spectral.items() if match[1] == kind)
    return _table(chosen, planes, kind, attributes, width * height, path.name)


def _table(chosen: list[tuple[float, str]], planes: dict[str, np.ndarray], kind: str,
           attributes: dict[str, bytes], pixels: int, name: str) -> SpectralTable:
    values = np.array([planes[channel] for _, channel in chosen], dtype=float)
    if not np.all(np.isfinite(values)):
        raise InputError(f"{name}: {int(np.sum(~np.isfinite(values)))} pixel values are not "
                         "numbers; render or copy it again")
    rows, names = [values.mean(axis=1)], ["mean"]
    if pixels > 1:
        rows.append(values.std(axis=1, ddof=1) / np.sqrt(pixels))
        names.append("standard_error")
    facts = {"source": f"{name}, mean of {pixels} pixels"}
    notes = [
        f"the spectrum is the mean over all {pixels} pixels of the picture"] if pixels > 1 else []
    units = _string(attributes.get("emissiveUnits", b"")).lower()
    if kind == "T":
        facts.update(quantity="reflectance", unit="1")
    elif units in RADIANCE_UNITS:
        facts.update(quantity="radiance", unit="W m-2 sr-1 nm-1")
        notes += [
            "the unit is taken per nm, as the layout's authors write it"] if not units.endswith(
            "nm^-1") else []
    elif units:
        facts["unit"] = units
    return SpectralTable(np.array([wavelength for wavelength, _ in chosen]), tuple(names),
                         np.array(rows), facts, name, "mean", {}, tuple(notes))


def _string(data: bytes) -> str:
    return data.decode("latin-1").strip("\x00 ")


def _attributes(content: bytes) -> tuple[dict[str, bytes], int]:
    at = 8
    attributes: dict[str, bytes] = {}
    while content[at] != 0:
        end = content.index(b"\x00", at)
        name = content[at:end].decode("latin-1")
        at = content.index(b"\x00", end + 1) + 1
        size, = struct.unpack_from("<i", content, at)
        if size < 0 or at + 4 + size > len(content):
            raise ValueError("size of an attribute")
        attributes[name] = content[at + 4:at + 4 + size]
        at += 4 + size
    return attributes, at + 1


def _channels(data: bytes) -> list[tuple[str, int, tuple[int, int]]]:
    channels, at = [], 0
    while data[at] != 0:
        end = data.index(b"\x00", at)
        kind, _, x_step, y_step = struct.unpack_from("<iIii", data, end + 1)
        channels.append((data[at:end].decode("latin-1"), kind, (x_step, y_step)))
        at = end + 17
    return channels


def _check_layout(content: bytes, attributes: dict[str, bytes],
                  channels: list[tuple[str, int, tuple[int, int]]], compression: int, width: int,
                  height: int, name: str) -> None:
    flags, = struct.unpack_from("<I", content, 4)
    if flags & 0x1A00 or "tiles" in attributes:
        raise InputError(f"{name} is tiled, deep or in several parts; save it as one part of scan "
                         "lines")
    if compression not in LINES_PER_BLOCK:
        known = COMPRESSIONS[compression] if compression < len(COMPRESSIONS) else "an unknown one"
        raise InputError(f"{name} is compressed with {known}; save it with ZIP or without "
                         "compression")
    if any(kind not in PIXEL_TYPES or step != (1, 1) for _, kind, step in channels):
        raise InputError(f"{name} has subsampled channels or unknown pixel types; save it at full "
                         "resolution as float")
    if not (0 < width <= 65536 and 0 < height
            <= 65536) or width * height * len(channels) > MAX_VALUES:
        raise InputError(f"{name}: {width} x {height} pixels in {len(channels)} channels are more "
                         "than is read here; crop it")


def _planes(content: bytes, at: int, channels: list[tuple[str, int, tuple[int, int]]], width: int,
            height: int, compression: int, top: int) -> dict[str, np.ndarray]:
    lines = LINES_PER_BLOCK[compression]
    blocks = -(-height // lines)
    offsets = struct.unpack_from(f"<{blocks}Q", content, at)
    row_bytes = width * sum(np.dtype(PIXEL_TYPES[kind]).itemsize for _, kind, _ in channels)
    planes = {name: np.full((height, width), np.nan) for name, _, _ in channels}
    for offset in offsets:
        y, size = struct.unpack_from("<ii", content, offset)
        first = y - top
        count = min(lines, height - first)
        if not 0 <= first < height or size < 0 or offset + 8 + size > len(content):
            raise ValueError("block outside the picture")
        data = _unpacked(content[offset + 8:offset + 8 + size], compression, row_bytes * count)
        start = 0
        for row in range(first, first + count):
            for name, kind, _ in channels:
                planes[name][row] = np.frombuffer(data, PIXEL_TYPES[kind], width, start)
                start += width * np.dtype(PIXEL_TYPES[kind]).itemsize
    return {name: plane.ravel() for name, plane in planes.items()}


def _unpacked(data: bytes, compression: int, size: int) -> bytes:
    if compression == 0 or len(data) == size:  # a block that would grow is stored as it is
        return data
    if compression == 1:
        plain = _run_lengths(data, size)
    else:
        inflater = zlib.decompressobj()
        plain = inflater.decompress(data, size)
    if len(plain) != size:
        raise ValueError("block size")
    steps = np.frombuffer(plain, np.uint8).astype(np.int64)
    steps[1:] -= 128
    ordered = np.cumsum(steps).astype(np.uint8)
    result = np.empty(size, np.uint8)
    result[0::2], result[1::2] = ordered[:(size + 1) // 2], ordered[(size + 1) // 2:]
    return result.tobytes()


def _run_lengths(data: bytes, size: int) -> bytes:
    plain, at = bytearray(), 0
    while at < len(data) and len(plain) <= size:
        count = data[at] - 256 if data[at] > 127 else data[at]
        if count < 0:
            plain += data[at + 1:at + 1 - count]
            at += 1 - count
        else:
            plain += data[at + 1:at + 2] * (count + 1)
            at += 2
    return bytes(plain)
