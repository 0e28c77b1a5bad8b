"""The spectra of every pixel as report and command line show them."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from spectrabox.measure.pictures.pixel_flags import COLOURS, SEEN, WORDS
from spectrabox.measure.records import PictureRecords
from spectrabox.session.config.session_schema import SessionConfig


@dataclass(frozen=True)
class PictureOfSpectra:
    """The spectra of every pixel as they lie in the session folder."""

    files: tuple[str, ...]              # names, relative to the session folder
    maps: tuple[tuple[str, Path], ...]  # title of each map, and a reduced PNG of it
    size_px: tuple[int, int]            # width and height
    masked: float                       # share of pixels without a spectrum
    flag_shares: tuple[float, ...]      # of the pixels, by pixel_flags.py
    beyond_white: float                 # share of pixels brighter than white for certain
    novel: float                        # share of pixels that the prior does not explain
    standard_deviation: float           # mean over wavelengths and pixels
    notes: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """Where the files are."""
        folder = PurePosixPath(self.files[0]).parent.as_posix()
        return f"picture: {len(self.files)} files in {folder}"

    @property
    def reasons(self) -> list[tuple[str, str, float]]:
        """Words, colour on the map and share of every reason that some pixel has."""
        return [(words, f"#{bytes(colour).hex()}", share) for code, (words, colour, share)
                in enumerate(zip(WORDS, COLOURS.tolist(), self.flag_shares, strict=True))
                if code != SEEN and share > 0]


def picture_of(config: SessionConfig, picture: PictureRecords | None) -> PictureOfSpectra | None:
    """The picture of a finished session; None where it asks for none."""
    if picture is None:
        return None
    folder = config.results_folder / "picture"
    names = [(folder / file).relative_to(config.folder).as_posix() for file in picture.files]
    previews = [folder / file for file in picture.previews]
    width, height = picture.size_px
    return PictureOfSpectra(
        tuple(names), tuple(zip(picture.titles, previews, strict=True)), (width, height),
        picture.masked, tuple(picture.flag_shares.tolist()), picture.beyond_white, picture.novel,
        picture.standard_deviation, picture.notes)


def picture_facts(picture: PictureOfSpectra) -> dict[str, Any]:
    """The ``--json`` object of a picture."""
    return {"files": list(picture.files), "size_px": list(picture.size_px),
            "masked": picture.masked,
            "masked_because": {words: share for words, _, share in picture.reasons},
            "beyond_white": picture.beyond_white, "unlike": picture.novel,
            "standard_deviation": picture.standard_deviation, "notes": list(picture.notes)}
