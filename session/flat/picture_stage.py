"""The stage that makes a picture of spectra: mean and standard deviation of every pixel."""
from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.capture.photo.image_files import write_png
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import LinearImage
from spectrabox.sampling.prior.mixture import GRID, LogitMixture, load_prior, of_families
from spectrabox.sampling.prior.tables import (
    MAX_SIGNAL,
    UpliftTable,
    build_tables,
    interpolation,
    points_around,
    uplift_signals,
)
from spectrabox.session.config.session_schema import PictureSection
from spectrabox.session.flat.errors_of_pixels import PixelErrors, White, errors_of_pixels
from spectrabox.session.flat.picture_maps import Map, Reduced, map_rows, maps_of, shown
from spectrabox.session.signals.spectra_rows import (
    Canvas,
    KeptWavelengths,
    Spectra,
    row_blocks,
    write_spectra,
)
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import calibrations_of

GREY = 0.3                  # signal by whose error the places of a photo are compared
LEAST_KNOWN, BEST_KNOWN = 95, 5     # percentiles of the places that the two tables are made for
SIDE = 17                   # of the tables: noise leaves no finer detail
NOISE_SAMPLES = 20_000      # pixels that tell how noise depends on the signal
DARKEST = 1e-4              # of white: signals are taken for at least as bright
SIGMAS = 4.0                # beyond white: what no reflectance gives
POINTS_IN_PIXELS = 2        # how many pixels a point of the table takes as long as, one by one
PIXELS_A_POINT = 500        # and looked up, for the progress


@dataclass(frozen=True)
class _Rows:
    """Some rows of the picture: n pixels."""

    signals: np.ndarray         # (n, K) relative to white, as measured
    seen: np.ndarray            # (n,) bool: not clipped, and not black in any band
    place: np.ndarray           # (n,) 0 where errors are least, 1 where they are largest
    own_error: np.ndarray       # (n,) relative, of a mid grey there
    white: White | None         # where pixels are computed one by one
    variance: np.ndarray | None     # (n, K) of the photo's noise, likewise

    @property
    def within(self) -> np.ndarray:
        """Signals (n, K) that a reflectance can give."""
        return np.clip(self.signals, DARKEST, MAX_SIGNAL)

    @property
    def in_table(self) -> np.ndarray:
        """The same, a mid grey where a pixel is not seen."""
        return np.where(self.seen[:, None], self.within, GREY)


@dataclass(frozen=True)
class _Job:
    """A part of a photo, and what to make of it."""

    photo: LinearImage          # the part alone
    x_px: np.ndarray            # (W,) of its columns, in pixels of the whole photo
    y_px: np.ndarray            # (H,)
    errors: PixelErrors
    prior: LogitMixture
    kept: KeptWavelengths
    at_nodes: np.ndarray        # (N,) relative variance of a mid grey at the nodes of `errors`
    noise: np.ndarray           # (2, K) variance of the photo: constant, and by its signal

    @property
    def ends(self) -> tuple[float, float]:
        """Relative variance where errors are least, and where largest."""
        low, high = np.percentile(self.at_nodes, [BEST_KNOWN, LEAST_KNOWN])
        return float(low), float(max(high, low * (1 + 1e-6)))

    def rows(self, first: int, last: int, *, singly: bool) -> _Rows:
        """Some rows; ``singly`` with all that errors of single pixels need."""
        y_px = self.y_px[first:last]
        bands = self.photo.signal.shape[2]
        logs = self.errors.over(np.log(self.errors.white.signal), y_px, self.x_px)
        white = np.exp(logs).reshape(-1, bands)
        measured = self.photo.signal[first:last].reshape(-1, bands) - self.errors.glare
        clipped = self.photo.saturated[first:last].reshape(-1, bands).any(axis=1)
        variance = self.errors.over(self.at_nodes, y_px, self.x_px).ravel()
        low, high = self.ends
        return _Rows(measured / white, ~clipped & (measured > 0).all(axis=1),
                     np.clip((variance - low) / (high - low), 0, 1), np.sqrt(variance),
                     self.errors.white_at(y_px, self.x_px) if singly else None,
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


def picture_of_spectra(task: StageTask) -> dict[str, Any]:
    """Every pixel of the first photo, or of a part of it, to its spectrum.

    Returns
    -------
    dict
        The "files" in the stage's folder; "titles" and "previews", reduced pictures, of the maps;
        the "shares" of pixels without a spectrum, beyond white, and unlike what the prior knows;
        the "mean spread"; and the "size" of the picture.

    Raises
    ------
    InputError
        If the picture's rectangle leaves the photo.
    """
    section = task.config.picture
    assert section is not None
    job = _job(task, section)
    height, width = job.photo.signal.shape[:2]
    maps = maps_of(job.kept.nm[0], section.bands_nm, section.light)
    reduced = Reduced(height, width, maps)
    tables, before = _tables(job, task)
    singly = tables is None
    canvas = Canvas(height, width, lambda first, last: job.rows(first, last, singly=singly),
                    lambda rows: _one_by_one(job, rows) if tables is None
                    else _looked_up(job, tables, rows))
    counts = np.zeros(4)        # without a spectrum, beyond white, unlike, and the sum of spreads

    with map_rows(task.folder, height, width, maps, reduced) as write:
        def also(first: int, last: int, made: Spectra) -> None:
            mean, spread, unlike, seen, beyond = made
            each = spread.mean(axis=1)
            write(first, mean, each, unlike, seen)
            counts[:] += [(~seen).sum(), (beyond & seen).sum(), (unlike[seen] > 1).sum(),
                          each[seen].sum()]

        write_spectra(canvas, task.folder, job.kept,
                      lambda share: task.progress(before + (1 - before) * share, ""), also)
    pixels = height * width
    shares = counts / pixels
    shares[3] = counts[3] / max(pixels - counts[0], 1)
    return {"notes": (), "files": (*job.kept.files(), *(each.file for each in maps)),
            "titles": tuple(each.title for each in maps), "shares": shares[:3],
            "mean spread": shares[3:], "size": np.array([width, height]),
            "previews": tuple(_preview(task.folder, each, reduced) for each in maps)}


def _preview(folder: Path, shown_map: Map, reduced: Reduced) -> str:
    """The name of a reduced picture, which is written."""
    name = f"preview-{shown_map.file}"
    write_png(folder / name, shown(reduced.mean(shown_map.file), shown_map.encoded))
    return name


def _job(task: StageTask, section: PictureSection) -> _Job:
    config = task.config
    view = config.all_views[0]
    task.progress(0.0, f"reading {view.photo_files[0]}")
    photo, _ = task.photos.developed(config, view.photo)
    step = photo.sensor_step
    rows, columns = photo.signal.shape[:2]
    size = columns * step, rows * step
    x0, y0, x1, y1 = section.rect or (-0.5, -0.5, size[0] - 0.5, size[1] - 0.5)
    left, right = sorted((x0, x1))
    top, bottom = sorted((y0, y1))
    if left < -0.5 or top < -0.5 or right > size[0] - 0.5 or bottom > size[1] - 0.5:
        raise InputError(f"picture.rect leaves photo {photo.source} of {round(size[0])} x "
                         f"{round(size[1])} pixels; correct its corners")
    across, down = (slice(int(np.ceil((low + 0.5) / step - 0.5)),
                          int(np.floor((high + 0.5) / step - 0.5 - 1e-9)) + 1)
                    for low, high in ((left, right), (top, bottom)))
    if across.stop - across.start < 2 or down.stop - down.start < 2:
        raise InputError("picture.rect holds fewer than 2 x 2 pixels; enlarge it")
    prior = of_families(load_prior(), section.families)
    errors = errors_of_pixels(task, view, calibrations_of(config, task.stored)[0],
                              (left, top, right, bottom), prior)
    part = _Part(photo.signal[down, across], photo.variance[down, across])
    noise = part.noise()
    signal = GREY * errors.white.signal
    variance = (noise[0] + noise[1] * (signal + errors.glare)) / signal**2
    at_nodes = np.mean(np.diagonal(errors.white.log, axis1=1, axis2=2) + variance, axis=1)
    own = _cut(photo, down, across)
    return _Job(own, (np.arange(across.start, across.stop) + 0.5) * step - 0.5,
                (np.arange(down.start, down.stop) + 0.5) * step - 0.5, errors, prior,
                KeptWavelengths(section.step_nm, form=section.format), at_nodes, noise)


def _cut(photo: LinearImage, rows: slice, columns: slice) -> LinearImage:
    """A part of a photo, without a copy of it."""
    return replace(photo, signal=photo.signal[rows, columns],
                   variance=photo.variance[rows, columns],
                   saturated=photo.saturated[rows, columns])


@dataclass(frozen=True)
class _Part:
    """Signal and variance (H, W, K) of a part of a photo."""

    signal: np.ndarray
    variance: np.ndarray

    def noise(self) -> np.ndarray:
        """Variance (2, K) as a constant and a slope by the signal, fitted to some pixels."""
        stride = max(1, int(np.sqrt(self.signal[..., 0].size / NOISE_SAMPLES)))
        signal, variance = (each[::stride, ::stride].reshape(-1, each.shape[2]).astype(float)
                            for each in (self.signal, self.variance))
        lines = [np.linalg.lstsq(np.column_stack([np.ones(len(x)), x]), y, rcond=None)[0]
                 for x, y in zip(signal.T, variance.T, strict=True)]
        return np.maximum(np.array(lines).T, 0)


@dataclass(frozen=True)
class _Tables:
    """What signals say where errors are least, and how that changes to where they are largest."""

    least: UpliftTable
    kept: np.ndarray            # (L, P + Q + 1) mean, standard deviation and unlikeness where least
    change: np.ndarray          # (L, P + Q + 1)


def _tables(job: _Job, task: StageTask) -> tuple[_Tables | None, float]:
    """Tables of what signals say, and their share of the stage's time; None where pixels are
    computed one by one.
    """
    height, width, bands = job.photo.signal.shape
    if bands != 3:
        return None, 0.0
    wanted = np.zeros((SIDE,) * 3, dtype=bool)
    for first, last in row_blocks(height, width):
        wanted |= points_around(job.rows(first, last, singly=False).in_table, SIDE)
    if height * width < POINTS_IN_PIXELS * wanted.sum():
        return None, 0.0
    in_pixels = PIXELS_A_POINT * wanted.sum()
    share = float(in_pixels / (in_pixels + height * width))

    def errors(signals: np.ndarray) -> list[np.ndarray]:
        by_curves = job.errors.by_curves(signals)
        return [job.errors_near(percentile, signals) + by_curves
                for percentile in (BEST_KNOWN, LEAST_KNOWN)]

    tables = build_tables(job.prior, job.errors.relative_response, errors, wanted,
                          lambda done: task.progress(share * done, ""))
    low, high = (np.column_stack([table.mean[:, job.kept.mean],
                                  table.standard_deviation[:, job.kept.spread],
                                  table.unlikeness]) for table in tables)
    return _Tables(tables[0], low, high - low), share


def _looked_up(job: _Job, tables: _Tables, rows: _Rows) -> Spectra:
    mean_bands = GRID.nm[job.kept.mean].size
    weights = interpolation(tables.least, rows.in_table)
    made = weights @ tables.kept
    made += rows.place.astype(np.float32)[:, None] * (weights @ tables.change)
    return _masked(rows, made[:, :mean_bands], made[:, mean_bands:-1], made[:, -1])


def _one_by_one(job: _Job, rows: _Rows) -> Spectra:
    assert rows.white is not None and rows.variance is not None
    covariance = job.errors.covariance(rows.within, rows.white, rows.variance)
    made = uplift_signals(job.prior, job.errors.relative_response, rows.within, covariance)
    return _masked(rows, made.mean[:, job.kept.mean], made.standard_deviation[:, job.kept.spread],
                   made.unlikeness)


def _masked(rows: _Rows, mean: np.ndarray, spread: np.ndarray, unlike: np.ndarray) -> Spectra:
    """Spectra without those of pixels that have none; a signal beyond white is unlike any."""
    beyond = np.max(rows.signals - MAX_SIGNAL, axis=1) / (SIGMAS * rows.own_error)
    unlike = np.maximum(unlike, beyond)
    mean[~rows.seen], spread[~rows.seen], unlike[~rows.seen] = np.nan, np.nan, np.nan
    return mean, spread, unlike, rows.seen, beyond > 1
