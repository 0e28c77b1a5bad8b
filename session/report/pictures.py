"""Pictures of a report as data URIs, and JSON that cannot end the <script> element that it stands
in.
"""


from __future__ import annotations

import base64
import hashlib
import json
import math
import struct
import zlib
from enum import Enum
from pathlib import Path, PurePath
from typing import Any

import numpy as np
from markupsafe import Markup

from spectrabox.capture.photo.image_rows import open_channels
from spectrabox.radiometry.errors import InputError


def plain_values(value: Any) -> Any:
    """``value`` as dicts, lists, strings, numbers and None; a number that is not finite becomes
    None.
    """
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, np.ndarray | np.generic):
        if value.dtype.kind in "biuf" and np.isfinite(value).all():
            return value.tolist()
        return plain_values(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): plain_values(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_values(item) for item in value]
    if isinstance(value, Enum):
        return value.name
    return value.name if isinstance(value, PurePath) else str(value)


def json_for_script(value: Any) -> Markup:
    """JSON text with ``<``, ``>`` and ``&`` written as escapes, so no name can close the element or
    open another.
    """
    text = json.dumps(plain_values(value), allow_nan=False, separators=(",", ":"))
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)


# ---- pictures of a report as data URIs, and colours of maps --------------------------------------

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
MAX_SIDE_PX = 1400  # pictures are reduced to this: the page shows no more
COMPRESSION = 6     # of zlib's 9
# Matplotlib's "cividis" and "RdBu_r", between these at equal distances
LEVELS = ("#00224e", "#083370", "#35456c", "#4f576c", "#666970", "#7d7c78", "#948e77", "#aea371",
          "#c8b866", "#e5cf52", "#fee838")
SIGNED = ("#053061", "#2166ac", "#4393c3", "#92c5de", "#d1e5f0", "#f7f7f7", "#fddbc7", "#f4a582",
          "#d6604d", "#b2182b", "#67001f")


def picture_data_uri(path: Path, max_side_px: int = MAX_SIDE_PX) -> str:
    """A PNG file as data URI, reduced by whole factors where it is larger than the page shows.

    Parameters
    ----------
    path : Path
    max_side_px : int
        Of the page.

    Raises
    ------
    InputError
        If the file is missing or not a PNG.
    """
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise InputError(f"picture {path.name} cannot be read ({problem.strerror}); run the stage "
                         "that makes it again") from problem
    if not content.startswith(PNG_SIGNATURE):
        raise InputError(
            f"picture {path.name} is not a PNG file; run the stage that makes it again")
    factor = -(-max(int.from_bytes(content[16:20]), int.from_bytes(content[20:24])) // max_side_px)
    return _data_uri(content) if factor == 1 else pixels_data_uri(_reduced(path, factor))


def pixels_data_uri(pixels: np.ndarray) -> str:
    """Pixels (H, W, 3) or, with opacity, (H, W, 4), 0 to 1 and encoded for the screen, as PNG.

    Parameters
    ----------
    pixels : (H, W, 3 or 4) array
    """
    values = np.round(255 * np.clip(pixels, 0, 1)).astype(np.uint8)
    height, width, channels = values.shape
    kind = {3: 2, 4: 6}[channels]       # the PNG specification's "colour types"
    # every row begins with its filter, 0: none
    rows = np.pad(values.reshape(height, -1), ((0, 0), (1, 0)))
    head = struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    return _data_uri(PNG_SIGNATURE + _chunk(b"IHDR", head)
                     + _chunk(b"sRGB", b"\0")
                     + _chunk(b"IDAT", zlib.compress(rows.tobytes(), COMPRESSION))
                     + _chunk(b"IEND", b""))


def picture_digest(uri: str) -> str:
    """SHA-256 of the picture in a data URI."""
    return hashlib.sha256(base64.b64decode(uri.partition(",")[2])).hexdigest()


def coloured(values: np.ndarray, colours: tuple[str, ...]) -> np.ndarray:
    """Colours (..., 3), 0 to 1, of values from 0 to 1; those beyond have the colour of the end.

    Parameters
    ----------
    values : array
        Of any shape.
    colours : tuple of str
        `LEVELS` or `SIGNED`.
    """
    table = np.array([rgb_of(colour) for colour in colours])
    at = np.linspace(0, 1, len(table))
    return np.stack([np.interp(values, at, table[:, channel]) for channel in range(3)], axis=-1)


def rgb_of(colour: str) -> tuple[float, ...]:
    """Red, green and blue, 0 to 1, of a colour as web pages write it, #rrggbb."""
    return tuple(int(colour[start:start + 2], 16) / 255 for start in (1, 3, 5))


def png_size(path: Path) -> tuple[int, int]:
    """Width and height of a PNG file in pixels."""
    with path.open("rb") as file:
        width, height = struct.unpack(">II", file.read(24)[16:])
    return width, height


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(
        ">I", zlib.crc32(kind + content))


def _data_uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _reduced(path: Path, factor: int) -> np.ndarray:
    """Means (h, w, 3 or 4) of blocks of pixels, 0 to 1 as they are stored."""
    _, height, _, rows = open_channels(path)
    pixels = rows(0, height)
    rows_, columns = (size // factor * factor for size in pixels.shape[:2])
    blocks = pixels[:rows_, :columns].reshape(rows_ // factor, factor, columns // factor, factor,
                                              -1).mean(axis=(1, 3))
    return np.repeat(blocks[..., :1], 3, axis=2) if blocks.shape[2] < 3 else blocks
