"""Files of a camera for other programs: rawtoaces JSON, vkdt's curves, a DNG camera profile."""
from __future__ import annotations

import json
import struct
from fractions import Fraction
from pathlib import Path

import numpy as np

from spectrabox.calibrate.camera_profile import ILLUMINANTS, IlluminantMatrices
from spectrabox.radiometry.files import whole_file, write_text_whole

NM = np.arange(380, 781, 5)         # of rawtoaces and of vkdt
BEYOND = "0 outside the wavelengths that were measured or fitted"
ASCII, SHORT, LONG, SIGNED_RATIO = 2, 3, 4, 10      # types of TIFF fields
DENOMINATOR = 10_000                # of a DNG's matrices, as Adobe writes them
UNRESTRICTED = 3                    # ProfileEmbedPolicy: no restrictions


def write_rawtoaces(path: Path, maker: str, model: str, nm: np.ndarray, curves: np.ndarray,
                    errors: np.ndarray | None) -> None:
    """Curves (3, P) as rawtoaces-data stores a camera; standard errors as a second data set."""
    sets = {"main": curves} if errors is None else {"main": curves, "standard_error": errors}
    document = {
        "header": {"schema_version": "0.1.0", "manufacturer": maker, "model": model,
                   "description": "camera spectral sensitivity data",
                   "document_creator": "spectrabox", "document_creation_date": None,
                   "measurement_equipment": None, "comments": BEYOND, "license": None},
        "spectral_data": {"units": "relative", "index": {name: ["R", "G", "B"] for name in sets},
                          "data": {name: {str(point): [float(f"{value:.9g}") for value in row]
                                          for point, row in zip(NM, _on_table(nm, values).T,
                                                                strict=True)}
                                   for name, values in sets.items()}}}
    write_text_whole(path, json.dumps(document, indent=4) + "\n")


def write_vkdt(path: Path, nm: np.ndarray, curves: np.ndarray) -> None:
    """Curves (3, P) as ``vkdt-mkclut`` reads them: wavelength, red, green, blue; no header."""
    write_text_whole(path, "".join(
        f"{point} " + " ".join(f"{value:.13f}" for value in row) + "\n"
        for point, row in zip(NM, (_on_table(nm, curves) / curves.max()).T, strict=True)))


def write_dcp(path: Path, camera: str, name: str, matrices: dict[str, IlluminantMatrices]) -> None:
    """A DNG camera profile with the matrices of two illuminants (DNG specification 1.6).

    Parameters
    ----------
    camera : str
        UniqueCameraModel, as a DNG of the camera states it.
    name : str
        Of the profile, as a raw developer lists it.
    matrices : dict of IlluminantMatrices
        By the names of ``ILLUMINANTS``.
    """
    first, second = (matrices[illuminant] for illuminant in ILLUMINANTS)
    numbers = list(ILLUMINANTS.values())
    fields = {50708: _text(camera), 50721: _matrix(first.colour), 50722: _matrix(second.colour),
              50778: (SHORT, 1, struct.pack("<H", numbers[0])),
              50779: (SHORT, 1, struct.pack("<H", numbers[1])), 50936: _text(name),
              50941: (LONG, 1, struct.pack("<L", UNRESTRICTED)), 50942: _text("made by spectrabox"),
              50964: _matrix(first.forward), 50965: _matrix(second.forward)}
    with whole_file(path) as unfinished:
        unfinished.write_bytes(struct.pack("<4sL", b"IIRC", 8) + _directory(fields, 8))


def _on_table(nm: np.ndarray, curves: np.ndarray) -> np.ndarray:
    return np.array([np.interp(NM, nm, curve, left=0, right=0) for curve in curves])


def _text(words: str) -> tuple[int, int, bytes]:
    content = words.encode("utf-8") + b"\0"
    return ASCII, len(content), content


def _matrix(values: np.ndarray) -> tuple[int, int, bytes]:
    ratios = [Fraction(round(value * DENOMINATOR), DENOMINATOR) for value in values.ravel()]
    return SIGNED_RATIO, len(ratios), b"".join(
        struct.pack("<ll", ratio.numerator, ratio.denominator) for ratio in ratios)


def _directory(fields: dict[int, tuple[int, int, bytes]], offset: int) -> bytes:
    """One directory of a TIFF placed at ``offset``, its longer values after it."""
    behind = offset + 2 + 12 * len(fields) + 4
    entries, values = b"", b""
    for tag, (kind, count, content) in sorted(fields.items()):
        if len(content) > 4:
            pointer = struct.pack("<L", behind + len(values))
            values += content + bytes(len(content) % 2)
            content = pointer
        entries += struct.pack("<HHL", tag, kind, count) + content.ljust(4, b"\0")
    return struct.pack("<H", len(fields)) + entries + bytes(4) + values
