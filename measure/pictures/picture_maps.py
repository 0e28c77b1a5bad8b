"""Maps of the spectra of every pixel as PNG: colours, bands, uncertainty, novelty, flags.

Written some rows at a time, and reduced for the report on the way. A pixel without a spectrum is
magenta; where there are more reasons than clipping, a map of the flags shows which.
"""
from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np

from spectrabox.capture.photo import image_rows, preview
from spectrabox.measure.pictures import pixel_flags, spectra_files
from spectrabox.radiometry.system.words import file_stem
from spectrabox.sampling.prior import uplift_table

BANDS_NM = (450, 500, 550, 600, 650)     # of which maps of their own are made
MASKED = (255, 0, 255)
MAX_DEVIATION = 0.1     # mean standard deviation at the end of its colours
MAX_NOVELTY = 2.0       # at the end of its colours; 1 is the limit of what the prior explains
DEVIATION_COLOURS, NOVELTY_COLOURS = "viridis", "RdBu_r"
REDUCED_PX = 800        # longer side of what the report shows
CODES = 256
UNCERTAINTY, UNFAMILIARITY = "uncertainty.png", "unfamiliarity.png"
MASK = "mask.png"


@dataclass(frozen=True)
class Map:
    """One map: its values, 1 or 3 (linear sRGB) for each pixel, and how they are shown."""

    title: str
    file: str
    channels: int
    # from mean (n, P), standard deviation (n, Q) and novelty (n,) to (n, channels); None: the flags
    values: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray] | None
    encoded: Callable[[np.ndarray], np.ndarray]         # (n, channels) to (n, 3) uint8


def maps_of(nm: np.ndarray, light: str | None, *, flags: bool) -> list[Map]:
    """The maps of a picture.

    Parameters
    ----------
    nm : (P,) array
        Wavelengths of the mean.
    light : str or None
        CIE name of a light, besides D65.
    flags : bool
        Whether one map shows why pixels have no spectrum.
    """
    maps = []
    for name in dict.fromkeys((spectra_files.DAYLIGHT, *([light] if light else []))):
        maps.append(Map(f"Colour under {name}", f"colour-{file_stem(name)}.png", 3,
                        partial(_weighted_mean, spectra_files.srgb_of_spectra(nm, name)), _srgb8))
    for wavelength in BANDS_NM:
        at = [[np.interp(wavelength, nm, unit)] for unit in np.eye(nm.size)]
        maps.append(Map(f"Reflectance at {wavelength:g} nm", f"{wavelength:g}nm.png", 1,
                        partial(_weighted_mean, np.array(at, np.float32)),
                        lambda values: np.repeat(_srgb8(values), 3, axis=1)))
    maps += [Map("Uncertainty", UNCERTAINTY, 1,
                 lambda mean, deviation, novelty: deviation.mean(axis=1)[:, None],
                 _coloured(DEVIATION_COLOURS, MAX_DEVIATION)),
             Map("Unlike what is known", UNFAMILIARITY, 1,
                 lambda mean, deviation, novelty: novelty[:, None],
                 _coloured(NOVELTY_COLOURS, MAX_NOVELTY))]
    if flags:
        maps.append(Map("Without a spectrum", MASK, 1, None,
                        lambda values: pixel_flags.COLOURS[values[:, 0].astype(np.uint8)]))
    return maps


class Reduced:
    """Means of maps over square blocks of pixels, of rows that come from the top to the bottom; of
    flags the first pixel's.
    """

    def __init__(self, height: int, width: int, maps: Sequence[Map]) -> None:
        self.factor = -(-max(height, width) // REDUCED_PX)
        self._shape = -(-height // self.factor), -(-width // self.factor)
        self._pixels, self._count = np.zeros(self._shape), np.zeros(self._shape)
        self._sums = {each.file: np.zeros((*self._shape, each.channels)) for each in maps}
        self._flags = {each.file for each in maps if each.values is None}

    def add(self, first: int, seen: np.ndarray, values: dict[str, np.ndarray]) -> None:
        """Add rows: which of their pixels (n, W) have spectra, and the values (n, W, C) of maps."""
        rows = np.arange(first, first + len(seen)) // self.factor
        columns = np.arange(0, seen.shape[1], self.factor)
        for total, of in ((self._pixels, np.ones_like(seen)), (self._count, seen)):
            np.add.at(total, rows, np.add.reduceat(of, columns, axis=1, dtype=float))
        for file, value in values.items():
            if file in self._flags:
                first_ones = np.flatnonzero((first + np.arange(len(value))) % self.factor == 0)
                self._sums[file][rows[first_ones]] = value[first_ones][:, ::self.factor]
                continue
            kept = np.where(seen[..., None], value, 0)
            np.add.at(self._sums[file], rows, np.add.reduceat(kept, columns, axis=1, dtype=float))

    def mean(self, file: str) -> np.ndarray:
        """Mean (h, w, C) of a map where at least half of a block has spectra, NaN elsewhere."""
        total = self._sums[file]
        if file in self._flags:
            return total.astype(np.float32)
        enough = self._count >= 0.5 * self._pixels      # blocks at the end are smaller
        share = np.where(enough, self._count, np.nan)[..., None]
        return np.asarray(total / share, dtype=np.float32)


@contextlib.contextmanager
def map_rows(folder: Path, height: int, width: int, maps: Sequence[Map], reduced: Reduced
             ) -> Iterator[Callable[[int, np.ndarray, uplift_table.Uplifted], None]]:
    """A function of (first row, flags of some rows, their spectra) that writes rows of all maps."""
    with contextlib.ExitStack() as files:
        writers = {each.file: files.enter_context(
            image_rows.png_rows(folder / each.file, height, width, 3)) for each in maps}

        def write(first: int, flags: np.ndarray, spectra: uplift_table.Uplifted) -> None:
            seen = flags == pixel_flags.SEEN
            of_maps = {}
            for each in maps:
                values = flags[:, None] if each.values is None else each.values(*spectra)
                coded = each.encoded(np.nan_to_num(values))
                if each.values is not None:
                    coded[~seen] = MASKED
                writers[each.file](first, coded.reshape(-1, width, 3))
                of_maps[each.file] = values.reshape(-1, width, each.channels)
            reduced.add(first, seen.reshape(-1, width), of_maps)

        yield write


def reduced_picture(reduced: Reduced, of_map: Map) -> np.ndarray:
    """A reduced map as a picture (h, w, 3) uint8."""
    values = reduced.mean(of_map.file)
    flat = values.reshape(-1, values.shape[2])
    picture = of_map.encoded(np.nan_to_num(flat))
    picture[np.isnan(flat).any(axis=1)] = MASKED
    return picture.reshape(*values.shape[:2], 3)


def _weighted_mean(weights: np.ndarray, mean: np.ndarray, deviation: np.ndarray,
                   novelty: np.ndarray) -> np.ndarray:
    """Mean spectra (n, P) times weights (P, channels)."""
    return np.asarray(mean @ weights)


def _srgb8(linear: np.ndarray) -> np.ndarray:
    """sRGB codes by a table, off by less than one of them."""
    table = _srgb_table()
    return table[(np.clip(linear, 0, 1) * (table.size - 1) + 0.5).astype(np.int32)]


@cache
def _srgb_table() -> np.ndarray:
    return preview.encode_srgb8(np.linspace(0, 1, CODES**2))


def _coloured(name: str, end: float) -> Callable[[np.ndarray], np.ndarray]:
    from matplotlib import colormaps  # a second, which a run without a picture does not need
    table = (255 * colormaps[name](np.arange(CODES))[:, :3] + 0.5).astype(np.uint8)
    return lambda values: table[(np.clip(values[:, 0] / end, 0, 1) * (CODES - 1)).astype(np.int32)]
