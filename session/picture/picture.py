"""Mean and standard deviation of every pixel's spectrum, some rows at a time, and maps of them.

Signals are relative to white under the light of each pixel, whatever told white and light: a chart
beside a flat sample, or the light traced in a scene.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.capture.photo.image_files import write_png
from spectrabox.radiometry.records import LinearImage
from spectrabox.sampling.prior.mixture import GRID
from spectrabox.sampling.prior.posterior import STILL
from spectrabox.sampling.prior.tables import (
    MAX_SIGNAL,
    build_tables,
    interpolation,
    points_around,
    uplift_signals,
)
from spectrabox.session.config.session_schema import PictureSection
from spectrabox.session.picture.picture_maps import Map, Reduced, map_rows, maps_of, shown
from spectrabox.session.picture.pixel_errors import GUESSED_STILL, PixelErrors, White
from spectrabox.session.picture.unseen import CLIPPED, DARK, HIGHLIGHT, SEEN
from spectrabox.session.signals.spectra_rows import (
    Canvas,
    KeptWavelengths,
    Spectra,
    row_blocks,
    write_spectra,
)

GREY = 0.3                  # signal by whose error the places of a photo are compared
LEAST_KNOWN, BEST_KNOWN = 95, 5     # percentiles of the places that the two tables are made for
SIDE = 17                   # of the tables: noise leaves no finer detail
NOISE_SAMPLES = 20_000      # pixels that tell how noise depends on the signal
DARKEST = 1e-4              # of white: signals are taken for at least as bright
SIGMAS = 4.0                # beyond white: what no reflectance gives
POINTS_IN_PIXELS = 2        # how many pixels a point of the table takes as long as, one by one
PIXELS_A_POINT = 500        # and looked up, for the progress


@dataclass(frozen=True)
class Rows:
    """Some rows of a picture: n pixels."""

    signals: np.ndarray         # (n, K) relative to white, as measured, under the typical lights
    kind: np.ndarray            # (n,) which of these
    unseen: np.ndarray          # (n,) code of unseen.py
    place: np.ndarray           # (n,) 0 where errors are least, 1 where they are largest
    own_error: np.ndarray       # (n,) relative, of a mid grey there
    white: White | None         # where pixels are computed one by one
    variance: np.ndarray | None     # (n, K) of the photo's noise, likewise

    @property
    def seen(self) -> np.ndarray:
        """Whether a pixel (n,) has a spectrum."""
        return np.asarray(self.unseen == SEEN)

    @property
    def within(self) -> np.ndarray:
        """Signals (n, K) that a reflectance can give."""
        return np.clip(self.signals, DARKEST, MAX_SIGNAL)

    @property
    def in_table(self) -> np.ndarray:
        """The same, a mid grey where a pixel is not seen."""
        return np.where(self.seen[:, None], self.within, GREY)


@dataclass(frozen=True, eq=False)
class LitPixels:
    """A part of a photo, and the light on it."""

    photo: LinearImage          # the part alone
    errors: PixelErrors
    unseen: np.ndarray | None = None    # (H, W) code of unseen.py, for reasons beside the photo's
    highlights: bool = False    # whether what is brighter than white is a highlight: no spectrum

    @cached_property
    def noise(self) -> np.ndarray:
        """Variance (2, K) of the photo as a constant and a slope by the signal, fitted to some
        pixels.
        """
        stride = max(1, int(np.sqrt(self.photo.signal[..., 0].size / NOISE_SAMPLES)))
        signal, variance = (each[::stride, ::stride].reshape(-1, each.shape[2]).astype(float)
                            for each in (self.photo.signal, self.photo.variance))
        lines = [np.linalg.lstsq(np.column_stack([np.ones(len(x)), x]), y, rcond=None)[0]
                 for x, y in zip(signal.T, variance.T, strict=True)]
        return np.maximum(np.array(lines).T, 0)

    @cached_property
    def at_nodes(self) -> np.ndarray:
        """Relative variance (N,) of a mid grey at the nodes of ``errors``."""
        white = self.errors.white
        signal = GREY * white.signal
        variance = (self.noise[0] + self.noise[1] * (signal + self.errors.glare)) / signal**2
        return np.asarray(np.mean(np.diagonal(white.log, axis1=1, axis2=2) + variance, axis=1))

    @property
    def ends(self) -> tuple[float, float]:
        """Relative variance where errors are least, and where largest."""
        low, high = np.percentile(self.at_nodes, [BEST_KNOWN, LEAST_KNOWN])
        return float(low), float(max(high, low * (1 + 1e-6)))

    def rows(self, first: int, last: int, *, singly: bool) -> Rows:
        """Some rows; ``singly`` with all that errors of single pixels need."""
        errors, bands = self.errors, self.photo.signal.shape[2]
        weights = errors.between(first, last)
        white = np.exp(weights @ np.log(errors.white.signal))
        measured = self.photo.signal[first:last].reshape(-1, bands) - errors.glare
        variance = weights @ self.at_nodes
        low, high = self.ends
        kind = errors.light.kind[_heaviest(weights)] if len(errors.responses) > 1 \
            else np.zeros(len(measured), np.int32)
        signals = errors.brought.signals(measured / white, weights @ errors.light.maps, kind)
        # without a node there is no light to be known
        own_error = np.sqrt(np.where(variance > 0, variance, 1.0))
        unseen = np.zeros(len(measured), np.uint8) if self.unseen is None \
            else self.unseen[first:last].ravel().copy()
        clipped = self.photo.saturated[first:last].reshape(-1, bands).any(axis=1)
        unseen[(unseen == SEEN) & clipped] = CLIPPED
        unseen[(unseen == SEEN) & (measured <= 0).any(axis=1)] = DARK
        if self.highlights:
            brighter = np.max(signals - MAX_SIGNAL, axis=1) > SIGMAS * own_error
            unseen[(unseen == SEEN) & brighter] = HIGHLIGHT
        return Rows(signals, kind, unseen, np.clip((variance - low) / (high - low), 0, 1),
                    own_error, errors.white_at(weights) if singly else None,
                    self.photo.variance[first:last].reshape(-1, bands) if singly else None)

    def errors_near(self, percentile: float, signals: np.ndarray) -> np.ndarray:
        """Covariance (n, K, K) of signals at a place with more errors than a share of all."""
        order = np.argsort(self.at_nodes)
        node = order[round(percentile / 100 * (order.size - 1))]
        white = self.errors.white
        there = White(white.signal[[node]], white.log[[node]],
                      white.log_and_glare[[node]]).repeated(len(signals))
        constant, slope = self.noise
        variance = constant + slope * (signals * there.signal + self.errors.glare)
        return self.errors.at_white(signals, there, variance)

    def one_by_one(self, rows: Rows, *,
                   roughly: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mean and standard deviation (n, 61), and novelty (n,), each pixel by itself.

        Parameters
        ----------
        rows : Rows
            With all that errors of single pixels need.
        roughly : bool
            As means of many pixels need it: without the errors of sensitivities and light, and no
            nearer to modes than those need it.
        """
        assert rows.white is not None and rows.variance is not None
        count = len(rows.signals)
        found = np.empty((count, GRID.nm.size)), np.empty((count, GRID.nm.size)), np.empty(count)
        for kind in np.unique(rows.kind):
            some = np.flatnonzero(rows.kind == kind)
            white = rows.white
            there = White(white.signal[some], white.log[some], white.log_and_glare[some])
            signals = rows.within[some]
            covariance = self.errors.at_white(signals, there, rows.variance[some])
            if not roughly:
                covariance += self.errors.by_curves(signals, kind)
            made = uplift_signals(self.errors.prior, self.errors.responses[kind], signals,
                                  covariance, still=GUESSED_STILL if roughly else STILL)
            for whole, part in zip(found, (made.mean, made.standard_deviation, made.novelty),
                                   strict=True):
                whole[some] = part
        return found


def _heaviest(weights: Any) -> np.ndarray:
    """The node (n,) of most weight in each row of a sparse matrix that stores as many a row."""
    per_row = weights.nnz // weights.shape[0]
    at = np.argmax(weights.data.reshape(-1, per_row), axis=1)
    return np.asarray(weights.indices.reshape(-1, per_row)[np.arange(at.size), at])


def kept_wavelengths(section: PictureSection) -> KeptWavelengths:
    """Wavelengths and format of a picture's files."""
    return KeptWavelengths(section.step_nm, form=section.format)


def write_picture(pixels: LitPixels, section: PictureSection, folder: Path,
                  progress: Callable[[float], None],
                  besides: Callable[[int, int, Spectra], None] = lambda first, last, made: None
                  ) -> dict[str, Any]:
    """Write the spectra of all pixels and maps of them.

    Parameters
    ----------
    pixels : LitPixels
    section : PictureSection
    folder : Path
    progress : function of the share that is done
    besides : function of (first, last, made), optional
        Takes what is made of some rows: mean (n, P), spread (n, Q), novelty (n,), code of
        unseen.py (n,), and whether they are beyond white.

    Returns
    -------
    dict
        The "files" in the folder; "titles" and "previews", reduced pictures, of the maps; the
        "shares" of pixels without a spectrum, beyond white, and unlike what the prior knows; those
        of each reason for having none as "unseen"; the "mean spread"; the "size" of the picture.
    """
    kept = kept_wavelengths(section)
    height, width = pixels.photo.signal.shape[:2]
    maps = maps_of(kept.nm[0], section.bands_nm, section.light, reasons=pixels.unseen is not None)
    reduced = Reduced(height, width, maps)
    tables, before = _tables(pixels, kept, progress)
    canvas = Canvas(height, width,
                    lambda first, last: pixels.rows(first, last, singly=tables is None),
                    lambda rows: _one_by_one(pixels, kept, rows) if tables is None
                    else _looked_up(kept, tables, rows))
    counts = np.zeros(3)        # beyond white, unlike, and the sum of spreads
    reasons = np.zeros(HIGHLIGHT + 1)

    with map_rows(folder, height, width, maps, reduced) as write:
        def also(first: int, last: int, made: Spectra) -> None:
            mean, spread, unlike, unseen, beyond = made
            each, seen = spread.mean(axis=1), unseen == SEEN
            write(first, mean, each, unlike, unseen)
            besides(first, last, made)
            counts[:] += [(beyond & seen).sum(), (unlike[seen] > 1).sum(), each[seen].sum()]
            reasons[:] += np.bincount(unseen, minlength=reasons.size)

        write_spectra(canvas, folder, kept,
                      lambda share: progress(before + (1 - before) * share), also)
    total = height * width
    return {"files": (*kept.files(), *(each.file for each in maps)),
            "titles": tuple(each.title for each in maps),
            "shares": np.array([total - reasons[SEEN], *counts[:2]]) / total,
            "unseen": reasons / total,
            "mean spread": counts[2:] / max(reasons[SEEN], 1), "size": np.array([width, height]),
            "previews": tuple(_preview(folder, each, reduced) for each in maps)}


def _preview(folder: Path, shown_map: Map, reduced: Reduced) -> str:
    """The name of a reduced picture, which is written."""
    name = f"preview-{shown_map.file}"
    write_png(folder / name, shown(reduced.mean(shown_map.file), shown_map.encoded))
    return name


@dataclass(frozen=True)
class _Tables:
    """What signals say where errors are least, and how that changes to where they are largest."""

    row: np.ndarray             # (side, side, side) of each point of the lattice
    kept: np.ndarray            # (L, P + Q + 1) mean, standard deviation and novelty where least
    change: np.ndarray          # (L, P + Q + 1)


def _tables(pixels: LitPixels, kept: KeptWavelengths, progress: Callable[[float], None]
            ) -> tuple[list[_Tables] | None, float]:
    """Tables of what signals say under each typical light, and their share of the whole time; None
    where pixels are computed one by one.
    """
    height, width, bands = pixels.photo.signal.shape
    if bands != 3:
        return None, 0.0
    responses = pixels.errors.responses
    wanted = np.zeros((len(responses), *(SIDE,) * 3), dtype=bool)
    for first, last in row_blocks(height, width):
        rows = pixels.rows(first, last, singly=False)
        signals, kinds = rows.in_table, np.where(rows.seen, rows.kind, 0)
        for kind in np.unique(kinds):
            wanted[kind] |= points_around(signals[kinds == kind], SIDE)
    if height * width < POINTS_IN_PIXELS * wanted.sum():
        return None, 0.0
    in_pixels = PIXELS_A_POINT * wanted.sum()
    share = float(in_pixels / (in_pixels + height * width))
    made, points = [], 0
    for kind in range(len(responses)):
        def so_far(done: float, kind: int = kind, points: int = points) -> None:
            progress(share * float(points + done * wanted[kind].sum()) / float(wanted.sum()))
        made.append(_tables_of(pixels, kept, wanted[kind], kind, so_far))
        points += int(wanted[kind].sum())
    return made, share


def _tables_of(pixels: LitPixels, kept: KeptWavelengths, wanted: np.ndarray, kind: int,
               progress: Callable[[float], None]) -> _Tables:
    def errors(signals: np.ndarray) -> list[np.ndarray]:
        by_curves = pixels.errors.by_curves(signals, kind)
        return [pixels.errors_near(percentile, signals) + by_curves
                for percentile in (BEST_KNOWN, LEAST_KNOWN)]

    tables = build_tables(pixels.errors.prior, pixels.errors.responses[kind], errors, wanted,
                          progress)
    low, high = (np.column_stack([table.mean[:, kept.mean],
                                  table.standard_deviation[:, kept.spread],
                                  table.novelty]) for table in tables)
    return _Tables(tables[0].row, low, high - low)


def _looked_up(kept: KeptWavelengths, tables: Sequence[_Tables], rows: Rows) -> Spectra:
    mean_bands = GRID.nm[kept.mean].size
    signals, kinds = rows.in_table, np.where(rows.seen, rows.kind, 0)
    made = np.empty((len(signals), tables[0].kept.shape[1]), np.float32)
    for kind in np.unique(kinds):
        some = np.flatnonzero(kinds == kind)
        weights = interpolation(tables[kind].row, len(tables[kind].kept), signals[some])
        found = weights @ tables[kind].kept
        found += rows.place[some].astype(np.float32)[:, None] * (weights @ tables[kind].change)
        made[some] = found
    return _masked(rows, made[:, :mean_bands], made[:, mean_bands:-1], made[:, -1])


def _one_by_one(pixels: LitPixels, kept: KeptWavelengths, rows: Rows) -> Spectra:
    mean, spread, unlike = pixels.one_by_one(rows)
    return _masked(rows, mean[:, kept.mean], spread[:, kept.spread], unlike)


def _masked(rows: Rows, mean: np.ndarray, spread: np.ndarray, unlike: np.ndarray) -> Spectra:
    """Spectra without those of pixels that have none; a signal beyond white is unlike any."""
    beyond = np.max(rows.signals - MAX_SIGNAL, axis=1) / (SIGMAS * rows.own_error)
    unlike = np.maximum(unlike, beyond)
    for part in (mean, spread, unlike):
        part[~rows.seen] = np.nan
    return mean, spread, unlike, rows.unseen, beyond > 1
