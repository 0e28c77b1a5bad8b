"""Photos that a camera processed, whose values are not proportional to light, refused in words."""
from __future__ import annotations

from pathlib import Path

from spectrabox.radiometry.errors import InputError

# By the first bytes, and those from the ninth on where the kind of a container stands there.
PROCESSED_STARTS = {b"GIF8": "a GIF", b"8BPS": "a Photoshop document", b"%PDF": "a PDF",
                    b"BM": "a BMP"}
PROCESSED_CONTAINERS = {b"WEBP": "a WebP", b"avif": "an AVIF", b"avis": "an AVIF",
                        **dict.fromkeys((b"heic", b"heix", b"hevc", b"mif1", b"msf1"), "a HEIC")}
RAW_INSTEAD = ("give the camera's raw file, or a linear EXR or 16-bit TIFF; on a phone use the RAW "
               "or ProRAW setting (iPhone: Settings > Camera > Formats > Apple ProRAW, then RAW "
               "in the camera; Android: RAW in the Pro or Expert mode of the camera app)")
NOT_LINEAR_GIVES = ("--not-linear of flat and develop, and not_linear of a session, decode it as "
                    "sRGB all the same: good for a first look, but what is measured on it has "
                    "errors that nobody states")


class NotLinearError(InputError):
    """A photo's values are not proportional to light."""


def processed_error(name: str, what: str, decoded: bool) -> NotLinearError:
    """The refusal of a photo that the camera processed.

    Parameters
    ----------
    name : str
        Of its file.
    what : str
        It is: "a JPEG", say.
    decoded : bool
        Whether it can be taken all the same.
    """
    sentence = (f"photo {name} is {what}, processed by the camera: its values are not "
                f"proportional to light; {RAW_INSTEAD}")
    if decoded:
        sentence += f". {NOT_LINEAR_GIVES}"
    return NotLinearError(sentence)


def require_no_processed_file(path: Path) -> None:
    """Refuse pictures of formats that hold no linear values and that are not decoded.

    Parameters
    ----------
    path : Path

    Raises
    ------
    NotLinearError
        Of a HEIC, say.
    """
    if not path.is_file():
        return
    with path.open("rb") as file:
        start = file.read(12)
    kinds, begins = PROCESSED_STARTS, start
    if start.startswith(b"RIFF") or start[4:8] == b"ftyp":
        kinds, begins = PROCESSED_CONTAINERS, start[8:]
    for begin, what in kinds.items():
        if begins.startswith(begin):
            raise processed_error(path.name, what, decoded=False)
