"""Files for programs of colour management: ICC profiles, CLF files, OpenColorIO configurations."""
from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from spectrabox.radiometry import appearance, files

FORMS = {".icc": "an ICC input profile", ".clf": "a Common LUT Format file to ACES2065-1",
         ".ocio": "an OpenColorIO configuration"}

SIDE = 33           # nodes a channel
ROOT = 3            # nodes lie evenly in the cube roots of the signals, and so do their colours


def write_profile(path: Path, camera: str, matrix: np.ndarray,
                  xyz: Callable[[np.ndarray], np.ndarray]) -> tuple[Path, ...]:
    """Write a profile in the form that the file's ending names.

    Parameters
    ----------
    path : Path
        Ends in one of ``FORMS``. The Common LUT Format file that a configuration names is written
        beside it under its name.
    camera : str
        As programs list it.
    matrix : (3, 3) array
        From signals relative to white to X, Y, Z under D50.
    xyz : function
        From signals (n, 3) relative to white to X, Y, Z (n, 3) under D50, for the table.

    Returns
    -------
    tuple of Path
        That were written.
    """
    table = colour_table(xyz, PCS_WHITE)
    if path.suffix.lower() == ".icc":
        with files.whole_file(path) as unfinished:
            unfinished.write_bytes(camera_profile_bytes(camera, matrix, table))
        return (path,)
    clf = path.with_suffix(".clf")
    files.write_text_whole(clf, clf_text(camera, table))
    if path.suffix.lower() == ".clf":
        return (clf,)
    files.write_text_whole(path, ocio_config_text(camera, clf.name, matrix))
    return path, clf


def colour_table(xyz: Callable[[np.ndarray], np.ndarray], white: np.ndarray) -> np.ndarray:
    """Cube roots (SIDE, SIDE, SIDE, 3) of X, Y, Z over those of white, by R, G and B.

    Where twice the light gives twice the colour, the roots lie on straight lines from black, and
    interpolation between nodes is exact on the line of neutral colours.

    Parameters
    ----------
    xyz : function of signals (n, 3), 0 to 1 of white, that gives X, Y, Z (n, 3)
    white : (3,) array
        X, Y, Z of white. What lies below 0 or above white is clipped.
    """
    node = np.linspace(0, 1, SIDE) ** ROOT
    signals = np.stack(np.meshgrid(node, node, node, indexing="ij"), axis=-1)
    relative = np.clip(xyz(signals.reshape(-1, 3)) / white, 0, 1)
    return np.asarray(np.cbrt(relative).reshape(signals.shape))


# ---- ICC -----------------------------------------------------------------------------------------
# ICC profiles of version 4 (ICC.1:2022): input profiles of a camera, and spaces of pictures.
#
# A camera's profile holds a matrix and a table of colours; programs that know tables take these
# (clause 8.3). It expects linear signals relative to white, white-balanced: 1, 1, 1 is white.

VERSION = 0x04400000
PCS_WHITE = np.array([0.9642, 1.0, 0.8249])     # D50, as every header states it
RELATIVE = 1                        # rendering intent: media-relative colorimetric
XYZ_ONE = 32768 / 65535             # how a table's output of 16 bits encodes X, Y or Z of 1
FULL_SCALE = 65535                  # of a picture's code values
AB_STEPS = 256                      # of a* and b* to a unit
LEAST_AB, LARGEST_AB = (-128.0, -128.0), (32767 / 256, 32767 / 256)
MADE = (2000, 1, 1, 0, 0, 0)        # no true date: the same profile is the same file
NO_RIGHTS = "No rights reserved."


# Spaces of pictures: ROMM RGB (ISO 22028-2), with the plain exponent that programs write as
# "ProPhoto RGB"; Display P3 (SMPTE EG 432-1 primaries, D65 adapted by Bradford), curve of
# IEC 61966-2-1; CIE 1976 L*, a*, b* under D50; and sRGB (IEC 61966-2-1), adapted likewise, of
# pictures for the screen
PRO_PHOTO, P3, LAB, SRGB = "prophoto", "p3", "lab", "srgb"
NAMES = {PRO_PHOTO: "ProPhoto RGB", P3: "Display P3", LAB: "CIE L*a*b* (D50)", SRGB: "sRGB"}
# (3, 3) linear R, G, B to X, Y, Z under D50
TO_XYZ = {
    PRO_PHOTO: np.array([
        [0.7976749, 0.1351917, 0.0313534], [0.2880402, 0.7118741, 0.0000857],
        [0.0000000, 0.0000000, 0.8252100]]) * (PCS_WHITE / [0.96422, 1.0, 0.82521])[:, None],
    P3: np.array([
        [0.515102, 0.291965, 0.157153], [0.241182, 0.692236, 0.066582],
        [-0.001050, 0.041882, 0.784378]]) * (PCS_WHITE / [0.964220, 1.0, 0.825210])[:, None],
    SRGB: appearance.adaptation(np.linalg.solve(appearance.TO_SRGB, np.ones(3)), PCS_WHITE)
    @ np.linalg.inv(appearance.TO_SRGB)}
# of ICC's parametric curve, from code values to linear
_SRGB_CURVE = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
CURVES: dict[str, tuple[float, ...]] = {PRO_PHOTO: (1.8,), P3: _SRGB_CURVE, SRGB: _SRGB_CURVE}


def encode(space: str, linear: np.ndarray) -> np.ndarray:
    """Code values, 0 to 1, of linear values in an RGB space, clipped to 0 to 1.

    Parameters
    ----------
    space : str
        One of ``CURVES``.
    linear : array of any shape
    """
    values = np.clip(linear, 0, 1)
    if len(CURVES[space]) == 1:
        return np.asarray(values ** (1 / CURVES[space][0]))
    gamma, a, b, slope, knee = CURVES[space]        # type 3: (a x + b)^gamma from the knee on
    return np.where(values < slope * knee, values / slope, (values ** (1 / gamma) - b) / a)


def code_values(space: str, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Code values (..., 3) uint16 of colours, and which (...) are clipped.

    CIELAB is encoded as by TIFF 6.0 in 16 bits (section 23): L* of 100 is full scale, a* and b* are
    signed, in steps of 1/256.

    Parameters
    ----------
    space : str
        One of ``NAMES``.
    xyz : (..., 3) array
        Under D50, Y = 1 for white.
    """
    if space == LAB:
        lab = appearance.lab_from_xyz(xyz, PCS_WHITE)
        kept = np.clip(lab, [0, *LEAST_AB], [100, *LARGEST_AB])
        lightness = np.round(kept[..., :1] / 100 * FULL_SCALE).astype(np.uint16)
        chroma = np.round(kept[..., 1:] * AB_STEPS).astype(np.int16).view(np.uint16)
        half_a_step = np.array([50 / FULL_SCALE, 0.5 / AB_STEPS, 0.5 / AB_STEPS])
        return (np.concatenate([lightness, chroma], axis=-1),
                np.asarray((np.abs(lab - kept) > half_a_step).any(axis=-1)))
    linear = xyz @ np.linalg.inv(TO_XYZ[space]).T
    outside = (linear < -0.5 / FULL_SCALE) | (linear > 1 + 0.5 / FULL_SCALE)
    return (np.round(encode(space, linear) * FULL_SCALE).astype(np.uint16),
            np.asarray(outside.any(axis=-1)))


def picture_profile(space: str) -> bytes:
    """ICC profile to embed in a picture of an RGB space, one of ``CURVES``."""
    return _profile(b"mntr", _matrix_tags(NAMES[space], TO_XYZ[space], CURVES[space]))


def camera_profile_bytes(name: str, matrix: np.ndarray, table: np.ndarray) -> bytes:
    """An input profile with a matrix and a table.

    Parameters
    ----------
    name : str
        As programs list it.
    matrix : (3, 3) array
        From signals relative to white to X, Y, Z under D50; its rows sum to D50.
    table : (SIDE, SIDE, SIDE, 3) array
        As of ``colour_table``, white ``PCS_WHITE``.
    """
    return _profile(b"scnr", {**_matrix_tags(name, matrix, (1.0,)), b"A2B0": _lut(table)})


def _matrix_tags(name: str, matrix: np.ndarray, curve: tuple[float, ...]) -> dict[bytes, bytes]:
    tags = {b"desc": _text(name), b"cprt": _text(NO_RIGHTS), b"wtpt": _xyz(PCS_WHITE)}
    for letter, column in zip((b"r", b"g", b"b"), np.transpose(matrix), strict=True):
        tags |= {letter + b"XYZ": _xyz(column), letter + b"TRC": _curve(*curve)}
    return tags


def _profile(kind: bytes, tags: dict[bytes, bytes]) -> bytes:
    """Header, table of tags and tags; equal tags are stored once (ICC.1:2022, 7.2 and 7.3)."""
    start = 128 + 4 + 12 * len(tags)
    where: dict[bytes, int] = {}
    body, entries = b"", b""
    for signature, content in tags.items():
        if content not in where:
            where[content] = start + len(body)
            body += content + bytes(-len(content) % 4)
        entries += struct.pack(">4sLL", signature, where[content], len(content))
    header = struct.pack(
        ">L4xL4s4s4s6H4s4xL8x8xL12s4x", start + len(body), VERSION, kind, b"RGB ", b"XYZ ", *MADE,
        b"acsp", 0, RELATIVE, _fixed(PCS_WHITE))
    rest = struct.pack(">L", len(tags)) + entries + body
    # the profile's own digest, by a header without flags and rendering intent (7.2.18)
    digest = hashlib.md5(header[:64] + bytes(4) + header[68:] + bytes(128 - len(header)) + rest,
                         usedforsecurity=False).digest()
    return header + digest + bytes(128 - len(header) - len(digest)) + rest


def _lut(table: np.ndarray) -> bytes:
    """lutAToBType: cube roots, table, cubes, white (ICC.1:2022, 10.12)."""
    root, cube, straight = (3 * _curve(exponent) for exponent in (1 / ROOT, float(ROOT), 1.0))
    to_pcs = _fixed((np.diag(PCS_WHITE) * XYZ_ONE).ravel()) + _fixed(np.zeros(3))
    nodes = struct.pack(">16sB3x", bytes([SIDE] * 3), 2) \
        + np.round(table * 65535).astype(">u2").tobytes()
    nodes += bytes(-len(nodes) % 4)
    at_matrix = 32 + len(straight)
    at_cube = at_matrix + len(to_pcs)
    at_table = at_cube + len(cube)
    return struct.pack(">4s4xBB2x5L", b"mAB ", 3, 3, 32, at_matrix, at_cube, at_table,
                       at_table + len(nodes)) + straight + to_pcs + cube + nodes + root


def _curve(*parameters: float) -> bytes:
    """parametricCurveType: an exponent alone, or the curve of type 3."""
    return struct.pack(">4s4xH2x", b"para", 0 if len(parameters) == 1 else 3) \
        + _fixed(np.array(parameters))


def _xyz(values: np.ndarray) -> bytes:
    return b"XYZ \0\0\0\0" + _fixed(values)


def _text(words: str) -> bytes:
    """multiLocalizedUnicodeType of one language."""
    content = words.encode("utf-16-be")
    return struct.pack(">4s4xLL2s2sLL", b"mluc", 1, 12, b"en", b"GB", len(content), 28) + content


def _fixed(values: np.ndarray) -> bytes:
    """s15Fixed16 numbers."""
    return np.round(np.asarray(values) * 65536).astype(">i4").tobytes()


# ---- OpenColorIO ---------------------------------------------------------------------------------
# A camera for OpenColorIO: a Common LUT Format file and a configuration that names it.
#
# Common LUT Format (CLF) is version 3 of S-2014-006 of the Academy; the configuration is of version
# 2. Its scene reference is ACES2065-1.

# X, Y, Z to ACES2065-1 (AP0), TB-2014-004, under its own white
TO_ACES = np.array([[1.0498110175, 0.0, -0.0000974845], [-0.4959030231, 1.3733130458, 0.0982400361],
                    [0.0, 0.0, 0.9912520182]])


def aces_from_d50() -> np.ndarray:
    """Matrix (3, 3) from X, Y, Z under D50 to ACES2065-1, adapted by Bradford: white is 1, 1, 1."""
    gains = (appearance.BRADFORD @ appearance.ACES_WHITE) / (appearance.BRADFORD @ PCS_WHITE)
    return np.asarray(TO_ACES
                      @ np.linalg.solve(appearance.BRADFORD, gains[:, None] * appearance.BRADFORD))


def clf_text(name: str, table: np.ndarray) -> str:
    """A CLF file from a camera's signals relative to white to ACES2065-1.

    Parameters
    ----------
    name : str
        Of the transform.
    table : (S, S, S, 3) array
        As of ``colour_table``.
    """
    side = len(table)
    depths = 'inBitDepth="32f" outBitDepth="32f"'

    def exponent(value: float) -> str:
        return (f'  <Exponent {depths} style="basicFwd">\n    <ExponentParams '
                f'exponent="{value:.10g}"/>\n  </Exponent>\n')

    rows = "\n".join(" ".join(f"{value:.6f}" for value in row) for row in table.reshape(-1, 3))
    matrix = "\n".join(" ".join(f"{value:.10f}" for value in row)
                       for row in aces_from_d50() * PCS_WHITE)
    return (f'<?xml version="1.0" encoding="UTF-8"?>\n<ProcessList id="spectrabox" '
            f'compCLFversion="3" name="{escape(name, {chr(34): "&quot;"})}">\n'
            "  <InputDescriptor>camera signals relative to white</InputDescriptor>\n"
            "  <OutputDescriptor>ACES2065-1</OutputDescriptor>\n"
            f"{exponent(1 / ROOT)}"
            f'  <LUT3D {depths} interpolation="tetrahedral">\n'
            f'    <Array dim="{side} {side} {side} 3">\n{rows}\n    </Array>\n  </LUT3D>\n'
            f"{exponent(ROOT)}"
            f'  <Matrix {depths}>\n    <Array dim="3 3">\n{matrix}\n    </Array>\n  </Matrix>\n'
            "</ProcessList>\n")


def ocio_config_text(camera: str, clf_name: str, matrix: np.ndarray) -> str:
    """An OpenColorIO configuration with the camera's signals as two colour spaces: by its table,
    and by its matrix, which goes beyond white too.

    Parameters
    ----------
    camera : str
        Name of the colour space.
    clf_name : str
        Of the file beside the configuration.
    matrix : (3, 3) array
        From signals relative to white to X, Y, Z under D50.
    """
    to_aces = np.eye(4)
    to_aces[:3, :3] = aces_from_d50() @ matrix
    numbers = ", ".join(f"{value:.10f}" for value in to_aces.ravel())
    name, file = _quoted(camera), _quoted(clf_name)
    by_matrix = _quoted(f"{camera} by matrix")
    return f"""ocio_profile_version: 2
search_path: "."
strictparsing: true
roles:
  default: ACES2065-1
  scene_linear: ACES2065-1
  aces_interchange: ACES2065-1
file_rules:
  - !<Rule> {{name: Default, colorspace: ACES2065-1}}
displays:
  sRGB:
    - !<View> {{name: Colorimetric, colorspace: sRGB}}
active_displays: [sRGB]
active_views: [Colorimetric]
colorspaces:
  - !<ColorSpace>
    name: ACES2065-1
    encoding: scene-linear
  - !<ColorSpace>
    name: {name}
    description: signals of the camera relative to white, under the light of its calibration
    encoding: scene-linear
    to_scene_reference: !<FileTransform> {{src: {file}, interpolation: tetrahedral}}
  - !<ColorSpace>
    name: {by_matrix}
    encoding: scene-linear
    to_scene_reference: !<MatrixTransform> {{matrix: [{numbers}]}}
  - !<ColorSpace>
    name: sRGB
    encoding: sdr-video
    from_scene_reference: !<GroupTransform>
      children:
        - !<BuiltinTransform> {{style: UTILITY - ACES-AP0_to_CIE-XYZ-D65_BFD}}
        - !<BuiltinTransform> {{style: DISPLAY - CIE-XYZ-D65_to_sRGB}}
"""


def _quoted(words: str) -> str:
    """A YAML string in double quotes."""
    return '"' + words.replace("\\", "\\\\").replace('"', '\\"') + '"'
