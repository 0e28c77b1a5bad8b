"""Pictures for the eye of the spectra of every pixel: colours, bands, uncertainty, novelty.

Written some rows at a time as PNG, and reduced for the report on the way. A pixel without a
spectrum is shown in magenta; where there are more reasons than clipping, a map says which.
"""
from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np

from spectrabox.capture.photo.image_rows import png_rows
from spectrabox.capture.photo.preview import encode_srgb8
from spectrabox.radiometry.appearance import TO_SRGB, adapted_tristimulus
from spectrabox.radiometry.system.names import file_stem
from spectrabox.session.picture.unseen import COLOURS, SEEN

MASKED = (255, 0, 255)
MAX_SPREAD = 0.1        # mean standard deviation at the end of its colours
MAX_UNLIKE = 2.0        # novelty at the end of its colours; 1 is the limit of what is explained
SPREAD_COLOURS, UNLIKE_COLOURS = "viridis", "RdBu_r"
REDUCED_PX = 800        # longer side of what the report shows
CODES = 256
UNCERTAINTY, UNFAMILIARITY = "uncertainty.png", "unfamiliarity.png"
MASK = "mask.png"
DAYLIGHT = "D65"
Encode = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Map:
    """One map: how it is made of mean (n, P), mean spread (n,) and novelty (n,), and shown; None
    where it is the code of why there is no spectrum.
    """

    title: str
    file: str
    channels: int                                       # as kept: 1 value or 3 of linear sRGB
    values: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray] | None   # to (n, channels)
    encoded: Encode                                     # (n, channels) to (n, 3) uint8


def maps_of(nm: np.ndarray, bands_nm: Sequence[float], light: str | None,
            reasons: bool) -> list[Map]:
    """The maps of a picture.

    Parameters
    ----------
    nm : (P,) array
        Wavelengths of the mean.
    bands_nm : sequence of float
        Wavelengths of which maps are made.
    light : str or None
        CIE name of a light beside D65.
    reasons : bool
        Whether one map shows why pixels have no spectrum.
    """
    made = [_colour(nm, name) for name in dict.fromkeys((DAYLIGHT, *([light] if light else [])))]
    made += [_band(nm, wavelength) for wavelength in bands_nm]
    return [*made,
            Map("Uncertainty", UNCERTAINTY, 1, lambda mean, spread, unlike: spread[:, None],
                _coloured(SPREAD_COLOURS, MAX_SPREAD)),
            Map("Unlike what is known", UNFAMILIARITY, 1,
                lambda mean, spread, unlike: unlike[:, None],
                _coloured(UNLIKE_COLOURS, MAX_UNLIKE)),
            *([Map("Without a spectrum", MASK, 1, None, _reasons)] if reasons else [])]


class Reduced:
    """Means of maps over square blocks of pixels, of rows that come from the top to the bottom; of
    codes the first pixel's.
    """

    def __init__(self, height: int, width: int, maps: Sequence[Map]) -> None:
        self.factor = -(-max(height, width) // REDUCED_PX)
        self._shape = -(-height // self.factor), -(-width // self.factor)
        self._pixels, self._count = np.zeros(self._shape), np.zeros(self._shape)
        self._sums = {each.file: np.zeros((*self._shape, each.channels)) for each in maps}
        self._codes = {each.file for each in maps if each.values is None}

    def add(self, first: int, seen: np.ndarray, values: dict[str, np.ndarray]) -> None:
        """Add rows: which of their pixels (n, W) have spectra, and the values (n, W, C) of maps."""
        rows = np.arange(first, first + len(seen)) // self.factor
        columns = np.arange(0, seen.shape[1], self.factor)
        for total, of in ((self._pixels, np.ones_like(seen)), (self._count, seen)):
            np.add.at(total, rows, np.add.reduceat(of, columns, axis=1, dtype=float))
        for file, value in values.items():
            if file in self._codes:
                first_ones = np.flatnonzero((first + np.arange(len(value))) % self.factor == 0)
                self._sums[file][rows[first_ones]] = value[first_ones][:, ::self.factor]
                continue
            kept = np.where(seen[..., None], value, 0)
            np.add.at(self._sums[file], rows, np.add.reduceat(kept, columns, axis=1, dtype=float))

    def mean(self, file: str) -> np.ndarray:
        """Mean (h, w, C) of a map where at least half of a block has spectra, else not a number."""
        total = self._sums[file]
        if file in self._codes:
            return total.astype(np.float32)
        enough = self._count >= 0.5 * self._pixels      # blocks at the end are smaller
        share = np.where(enough, self._count, np.nan)[..., None]
        return np.asarray(total / share, dtype=np.float32)


@contextlib.contextmanager
def map_rows(folder: Path, height: int, width: int, maps: Sequence[Map], reduced: Reduced
             ) -> Iterator[Callable[[int, np.ndarray, np.ndarray, np.ndarray, np.ndarray], None]]:
    """A function of (first row, mean, mean spread, novelty, code of why there is no spectrum)
    that writes rows of all maps.
    """
    with contextlib.ExitStack() as files:
        writers = {each.file: files.enter_context(png_rows(folder / each.file, height, width, 3))
                   for each in maps}

        def write(first: int, mean: np.ndarray, spread: np.ndarray, unlike: np.ndarray,
                  unseen: np.ndarray) -> None:
            shape, seen = (-1, width), unseen == SEEN
            values = {}
            for each in maps:
                made = unseen[:, None] if each.values is None \
                    else each.values(mean, spread, unlike)
                coded = each.encoded(np.nan_to_num(made))
                if each.values is not None:
                    coded[~seen] = MASKED
                writers[each.file](first, coded.reshape(*shape, 3))
                values[each.file] = made.reshape(*shape, each.channels)
            reduced.add(first, seen.reshape(shape), values)

        yield write


def shown(values: np.ndarray, encoded: Encode) -> np.ndarray:
    """A reduced map (h, w, C) as a picture (h, w, 3) uint8."""
    flat = values.reshape(-1, values.shape[2])
    picture = encoded(np.nan_to_num(flat))
    picture[np.isnan(flat).any(axis=1)] = MASKED
    return picture.reshape(*values.shape[:2], 3)


def _colour(nm: np.ndarray, light: str) -> Map:
    to_srgb = (TO_SRGB @ adapted_tristimulus(nm, light)).T.astype(np.float32)
    return Map(f"Colour under {light}", f"colour-{file_stem(light)}.png", 3,
               lambda mean, spread, unlike: mean @ to_srgb, _srgb8)


def _band(nm: np.ndarray, wavelength: float) -> Map:
    at = np.array([np.interp(wavelength, nm, unit) for unit in np.eye(nm.size)], dtype=np.float32)
    return Map(f"Reflectance at {wavelength:g} nm", f"{wavelength:g}nm.png", 1,
               lambda mean, spread, unlike: (mean @ at)[:, None],
               lambda values: np.repeat(_srgb8(values), 3, axis=1))


def _reasons(codes: np.ndarray) -> np.ndarray:
    return COLOURS[codes[:, 0].astype(np.uint8)]


def _srgb8(linear: np.ndarray) -> np.ndarray:
    """sRGB codes by a table, off by less than one of them."""
    table = _srgb_table()
    return table[(np.clip(linear, 0, 1) * (table.size - 1) + 0.5).astype(np.int32)]


@functools.cache
def _srgb_table() -> np.ndarray:
    return encode_srgb8(np.linspace(0, 1, CODES**2))


def _coloured(name: str, end: float) -> Encode:
    table = (255 * matplotlib.colormaps[name](np.arange(CODES))[:, :3] + 0.5).astype(np.uint8)
    return lambda values: table[(np.clip(values[:, 0] / end, 0, 1) * (CODES - 1)).astype(np.int32)]
