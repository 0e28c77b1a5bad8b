"""From a mosaic to linear camera signal: each tile of colour filters becomes a pixel.

Nothing is demosaiced. A tile is 2 x 2 samples of a Bayer sensor, 3 x 3 of an X-Trans sensor (2 red,
5 green, 2 blue), 1 of a monochrome one.
"""
from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from spectrabox.capture.photo import clipping, image_files, processed_photos, raw
from spectrabox.capture.photo.noise import photon_transfer, variance_of
from spectrabox.capture.photo.opcodes import gains_at
from spectrabox.capture.photo.stored_images import is_image_file, read_header
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import photos

CLIP_FRACTION = 0.98    # of the clip point: above it sensors are no longer linear
MIN_SIGNAL = -0.03      # of the darkest hundredth of the picture: below, the black level is wrong
CHECKED_SAMPLES = 200_000
DARKEST = 0.1           # per cent of the pixels of a band
MIN_UNKNOWN_BLACK = 0.02    # of the white level, in all of them, with black stated as 0: chart and
# camera hold something darker, and cameras put black at 3 % or more
ROWS_AT_ONCE = 32       # of tiles
# Rows of two gains: of one colour, pairs of neighbours that step up and down by turns, by more than
# a logarithm, in this share more of the pairs than not; rows whose mean is above a share of white.
ROWS_IN_TURN, MIN_ROW_STEP, MIN_ROW_SIGNAL, MIN_ROW_PAIRS = 0.9, 0.15, 0.002, 16
MAX_COLUMNS = 500       # of tiles, that a row's mean is taken of


def open_photo(path: str | os.PathLike[str]) -> photos.LinearImage:
    """Linear signal of a camera raw or of a linear EXR or TIFF.

    Parameters
    ----------
    path : path
        Told apart by suffix, else by content.

    Raises
    ------
    InputError
        If the file cannot be read as either, or does not hold linear signal.
    """
    if is_image_file(Path(path)):
        return image_files.read_linear_file(path)
    processed_photos.require_no_processed_file(Path(path))
    frames = raw.decode(path)
    return linear_image(frames[0]) if len(frames) == 1 else full_colour_image(frames)


def photo_size(path: str | os.PathLike[str]) -> tuple[int, int]:
    """Width and height of a photo in pixels, as the sensor gives it, without decoding it.

    Parameters
    ----------
    path : path
        As of ``open_photo``.

    Raises
    ------
    InputError
        If it is missing or no photo.
    """
    if not Path(path).is_file():
        raise InputError(f"photo {path} does not exist; correct its name")
    if is_image_file(Path(path)):
        return read_header(Path(path)).size
    return raw.visible_size(path)


def linear_image(frame: photos.RawFrame, noise: tuple[np.ndarray, np.ndarray] | None = None,
                 dark: np.ndarray | None = None,
                 dark_variance: np.ndarray | None = None) -> photos.LinearImage:
    """Signal (DN - black level) / (white level - black level) of each tile of colour filters.

    The mean of its samples of each colour.

    Negative signals stay, so that means over dark areas are unbiased. A pixel is saturated where
    any contributing sample reaches 0.98 of the clip point: the white level, or where the histogram
    piles up below it (capture/photo/linear.py).

    Parameters
    ----------
    frame : RawFrame
    noise : two (K,) arrays or None
        Read noise and gain of each band; None to take them from the photo itself
        (capture/photo/noise.py).
    dark : (H, W) array or None
        DN, mean dark frame to subtract in place of the black level (capture/develop/dark.py).
    dark_variance : (H, W) array or None
        Its variance, DN squared, which is added to a given noise: noise taken from the photo is
        measured after the subtraction and holds it already.

    Raises
    ------
    InputError
        If the sensor's tile does not hold every colour, or the black level lies above the picture,
        or is stated as 0 and far below it.
    """
    _require_one_gain(frame)
    step = tile_step(frame.cfa, frame.file)
    bands = int(frame.cfa.max()) + 1
    positions = _positions(frame, step)
    signal, dark_part = _developed(frame, positions, dark,
                                   None if noise is None else dark_variance)
    variance_of_rounding = np.zeros(bands)
    for position in positions:
        variance_of_rounding[position.band] += position.per_dn**2
    _require_above_black(frame, signal)
    tiles = (frame.cfa.shape[0] // step) * (frame.cfa.shape[1] // step)
    quantum = np.sqrt(variance_of_rounding / tiles)
    samples = np.bincount([position.band for position in positions]) // tiles
    clips = clip_points(frame, signal, quantum, samples)
    saturated = _saturated(frame, positions, signal.shape, clips)
    read, gain = noise or photon_transfer(signal, saturated, quantum, frame.file, samples)
    if dark is None and not frame.black_level.any():
        _require_black_at_zero(frame, signal, saturated, quantum, samples)
    variance = variance_of(signal, read, gain)
    if dark_part is not None:
        variance += dark_part
    if frame.gain_maps:
        mean_of_squares = _with_gains(frame, positions, dark, signal)
        variance *= mean_of_squares
    return _image(frame, signal, variance, saturated, float(step), photos.PhotoKind.RAW)


def signal_alone(frame: photos.RawFrame) -> np.ndarray:
    """The signal (H, W, K) of ``linear_image``, float32, without its noise and what is clipped.

    Parameters
    ----------
    frame : RawFrame

    Raises
    ------
    InputError
        As ``linear_image``.
    """
    positions = _positions(frame, tile_step(frame.cfa, frame.file))
    signal, _ = _developed(frame, positions, None, None)
    _require_above_black(frame, signal)
    if frame.gain_maps:
        _with_gains(frame, positions, None, signal)
    return signal


def _developed(frame: photos.RawFrame, positions: list[_Position], dark: np.ndarray | None,
               dark_variance: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
    """Signal (H, W, K), and the variance that the dark frame adds, where it is given."""
    step = positions[0].step
    height, width = (side // step for side in frame.mosaic.shape)
    signal = np.empty((height, width, int(frame.cfa.max()) + 1), np.float32)
    dark_part = None if dark_variance is None else np.zeros_like(signal)
    for rows in _blocks_of_rows(height, positions):
        signal[rows] = 0
        for position in positions:
            samples, pixels = position.within(rows, height, width)
            signal[pixels] += _sample_signal(frame, position, samples, dark)
            if dark_part is not None and dark_variance is not None:
                dark_part[pixels] += dark_variance[samples] * np.float32(position.per_dn**2)
    return signal, dark_part


def _sample_signal(frame: photos.RawFrame, position: _Position, samples: tuple[slice, slice],
                   dark: np.ndarray | None) -> np.ndarray:
    """What samples of one position add to the signal of their pixels."""
    level = np.float32(position.black) if dark is None else dark[samples]
    plane = np.subtract(frame.mosaic[samples], level, dtype=np.float32)
    if dark is None and frame.black_rows is not None:
        plane -= frame.black_rows[samples[0]].astype(np.float32)[:, None]
    if dark is None and frame.black_columns is not None:
        plane -= frame.black_columns[samples[1]].astype(np.float32)
    plane *= np.float32(position.per_dn)
    return plane


def _with_gains(frame: photos.RawFrame, positions: list[_Position], dark: np.ndarray | None,
                signal: np.ndarray) -> np.ndarray:
    """Put the signal (H, W, K) with the gains of every sample into ``signal``: the mean square of
    a pixel's gains.
    """
    height, width = signal.shape[:2]
    squares = np.zeros_like(signal)
    alike = np.bincount([position.band for position in positions]) * (
        positions[0].step**2 / frame.cfa.size)
    for rows in _blocks_of_rows(height, positions):
        signal[rows] = 0
        for position in positions:
            samples, pixels = position.within(rows, height, width)
            y, x = (np.arange(*one.indices(side))
                    for one, side in zip(samples, frame.mosaic.shape, strict=True))
            gains = gains_at(frame.gain_maps, (frame.mosaic.shape[0], frame.mosaic.shape[1]), y, x,
                             position.band)
            signal[pixels] += gains * _sample_signal(frame, position, samples, dark)
            squares[pixels] += np.square(gains) / np.float32(alike[position.band])
    return squares


def full_colour_image(planes: Sequence[photos.RawFrame]) -> photos.LinearImage:
    """Signal of a linear DNG, every pixel its own.

    Marked as an image file taken as linear: whoever wrote it has interpolated, and perhaps
    denoised, so that its noise looks smaller than it is.

    Parameters
    ----------
    planes : sequence of K RawFrame
        Of each colour.
    """
    frame = planes[0]
    white = np.array([plane.white_level for plane in planes])
    scale = white - [float(plane.black_level[0, 0]) for plane in planes]
    limits = np.minimum(np.ceil(CLIP_FRACTION * white), 65535).astype(np.uint16)
    signal = np.empty((*frame.mosaic.shape, len(planes)), np.float32)
    saturated = np.empty(signal.shape, bool)
    for band, plane in enumerate(planes):
        signal[..., band] = plane.mosaic - plane.black_level.astype(np.float32)
        saturated[..., band] = plane.mosaic >= limits[band]
    if frame.black_rows is not None:
        signal -= frame.black_rows.astype(np.float32)[:, None, None]
    if frame.black_columns is not None:
        signal -= frame.black_columns.astype(np.float32)[:, None]
    signal /= scale.astype(np.float32)
    if frame.linear_limit < 1:
        saturated |= signal >= frame.linear_limit
    clips = clipping.clip_levels(signal, 1 / scale, frame.file, saturated)
    for band, clip in enumerate(clips):
        if clip is not None:
            saturated[..., band] |= signal[..., band] >= CLIP_FRACTION * clip.level
    variance = variance_of(signal, *photon_transfer(signal, saturated, 1 / scale, frame.file))
    if frame.gain_maps:
        height, width, bands = signal.shape
        for start, band in itertools.product(range(0, height, ROWS_AT_ONCE), range(bands)):
            rows = slice(start, min(start + ROWS_AT_ONCE, height))
            gains = gains_at(frame.gain_maps, (height, width), np.arange(rows.start, rows.stop),
                             np.arange(width), band)
            signal[rows, :, band] *= gains
            variance[rows, :, band] *= np.square(gains)
    frame = replace(frame, findings=(*frame.findings, *clipping.rolled_off(clips)))
    return _image(frame, signal, variance, saturated, 1.0, photos.PhotoKind.LINEAR_FILE)


def tile_step(cfa: np.ndarray, source: str = "") -> int:
    """Side of the smallest square of samples that holds every colour, anywhere on its own grid.

    Parameters
    ----------
    cfa : (a, b) int array
        Index of the colour at each position of the tile.
    source : str
        Of the photo, for errors.

    Raises
    ------
    InputError
        If even the whole tile lacks a colour.
    """
    colours = set(range(int(cfa.max()) + 1))
    rows, columns = cfa.shape
    for step in range(1, max(rows, columns) + 1):
        if rows % step or columns % step:
            continue
        blocks = (cfa[y:y + step, x:x + step] for y in range(0, rows, step)
                  for x in range(0, columns, step))
        if all(set(block.ravel().tolist()) == colours for block in blocks):
            return step
    raise InputError(f"photo {source}: the colour filter tile {cfa.tolist()} lacks one of the "
                     f"colours 0 to {max(colours)} (red, green, blue); the file is damaged: copy "
                     "it from the camera card again")


class _Position(NamedTuple):
    """A position of the tile: which samples go to which pixels of the picture, and their weight."""

    y: int
    x: int
    band: int
    black: float    # DN
    per_dn: float   # signal of a pixel per DN of this sample
    tile: tuple[int, int]
    step: int

    def within(self, rows: slice, height: int,
               width: int) -> tuple[tuple[slice, slice], tuple[slice, slice, int]]:
        """Slices of the mosaic and of the picture for rows that begin with a whole tile."""
        samples = (slice(rows.start * self.step + self.y, min(rows.stop, height) * self.step,
                         self.tile[0]), slice(self.x, width * self.step, self.tile[1]))
        pixels = (slice(rows.start + self.y // self.step, min(rows.stop, height),
                        self.tile[0] // self.step),
                  slice(self.x // self.step, width, self.tile[1] // self.step), self.band)
        return samples, pixels


def _positions(frame: photos.RawFrame, step: int) -> list[_Position]:
    positions = []
    for (y, x), band in np.ndenumerate(frame.cfa):
        top, left = y // step * step, x // step * step
        alike = np.count_nonzero(frame.cfa[top:top + step, left:left + step] == band)
        black = float(frame.black_level[y, x])
        positions.append(_Position(y, x, int(band), black, 1 / alike / (frame.white_level - black),
                                   (frame.cfa.shape[0], frame.cfa.shape[1]), step))
    return positions


def _blocks_of_rows(height: int, positions: list[_Position]) -> list[slice]:
    """Blocks of rows that fit in the cache, each of whole tiles."""
    block = ROWS_AT_ONCE * positions[0].tile[0] // positions[0].step
    return [slice(start, start + block) for start in range(0, height, block)]


def _saturated(frame: photos.RawFrame, positions: list[_Position], shape: tuple[int, ...],
               clips: np.ndarray) -> np.ndarray:
    saturated = np.zeros(shape, bool)
    for rows in _blocks_of_rows(shape[0], positions):
        for position in positions:
            limit = CLIP_FRACTION * clips[position.band]
            if frame.linear_limit < 1:
                limit = min(limit, position.black + frame.linear_limit * (frame.white_level
                                                                          - position.black))
            samples, pixels = position.within(rows, shape[0], shape[1])
            saturated[pixels] |= frame.mosaic[samples] >= np.uint16(min(np.ceil(limit), 65535))
    return saturated


def _require_above_black(frame: photos.RawFrame, signal: np.ndarray) -> None:
    stride = max(1, int(np.sqrt(signal.size / CHECKED_SAMPLES)))
    low = float(np.percentile(signal[::stride, ::stride], 1))
    if low < MIN_SIGNAL:
        raise InputError(f"raw photo {frame.file}: the darkest hundredth of the picture lies "
                         f"{-low:.1%} of full scale below its black level "
                         f"({frame.black_level.max():g} DN); the level or the dark frame is wrong, "
                         "or the file is damaged: copy it from the camera card again")


def _require_black_at_zero(frame: photos.RawFrame, signal: np.ndarray, saturated: np.ndarray,
                           quantum: np.ndarray, samples: np.ndarray) -> None:
    """Refuse a black level of 0 where the darkest pixels lie far above it, unless their noise is
    that of so much light.

    The line of the noise, variance = read + gain x (signal - black), ends where the variance is 0,
    at or below black. Where that lies above half of the darkest signal, light cannot be what the
    darkest pixels hold.
    """
    darkest = np.percentile(signal, DARKEST, axis=(0, 1)).astype(np.float32)
    if darkest.min() < MIN_UNKNOWN_BLACK:
        return
    read, gain = photon_transfer(signal - darkest, saturated, quantum, frame.file, samples)
    if np.any((gain > 0) & (read > gain * darkest / 2)):
        return
    raise InputError(f"raw photo {frame.file}: black lies at 0 DN by the file or LibRaw "
                     f"{raw.LIBRAW_VERSION}, but the darkest pixels read "
                     f"{darkest.min() * frame.white_level:.0f} of {frame.white_level:.0f} DN, with "
                     "less noise than so much light has: this LibRaw does not know the camera. "
                     "Subtract a dark frame (lens cap on, same exposure and ISO: photos.dark, or "
                     "develop --dark), or install a rawpy with a newer LibRaw")


def _image(frame: photos.RawFrame, signal: np.ndarray, variance: np.ndarray, saturated: np.ndarray,
           sensor_step: float, kind: photos.PhotoKind) -> photos.LinearImage:
    for array in (signal, saturated, variance):
        array.flags.writeable = False  # the record then keeps them without a copy
    return photos.LinearImage(signal=signal, variance=variance, saturated=saturated,
                       sensor_step=sensor_step, exposure_s=frame.exposure_s, iso=frame.iso,
                       f_number=frame.f_number, kind=kind, camera=frame.camera, source=frame.file,
                       sha256=frame.sha256, camera_from_xyz=frame.camera_from_xyz,
                       matrix_of_file=frame.matrix_of_file, taken_at=frame.taken_at,
                       findings=frame.findings)


# ---- clip point ----------------------------------------------------------------------------------

def clip_points(frame: photos.RawFrame, signal: np.ndarray, quantum: np.ndarray,
                samples: np.ndarray) -> np.ndarray:
    """DN (K,) at which each colour clips: the white level, or where samples pile up below it: a
    stated white level may be wrong for this ISO.

    Parameters
    ----------
    frame : RawFrame
    signal : (H, W, K) array
        Of the frame, without its gains.
    quantum, samples : (K,) arrays
        As of ``photon_transfer``.
    """
    clips = []
    rows, columns = frame.cfa.shape
    for band in range(signal.shape[2]):
        line = clipping.dark_noise(signal[..., band], quantum[band], frame.file,
                                   samples=int(samples[band]))
        positions = np.argwhere(frame.cfa == band)
        black = float(frame.black_level[frame.cfa == band].mean())
        scale = frame.white_level - black
        # about SAMPLES samples, from whole rows of tiles spread over the picture
        stride = max(1, int(frame.mosaic.size * len(positions) / frame.cfa.size / clipping.SAMPLES))
        values = np.concatenate([frame.mosaic[y::rows * stride, x::columns].ravel()
                                 for y, x in positions])
        pile = None if line is None else clipping.pile_of(values.astype(np.float32), _sigma_in_dn(
            line, int(samples[band]), black, scale))
        clips.append(frame.white_level if pile is None else min(pile, frame.white_level))
    return np.array(clips)


def _sigma_in_dn(line: tuple[float, float], samples: int, black: float,
                 scale: float) -> Callable[[np.ndarray], np.ndarray]:
    """Noise of single samples about values in DN, of a line of means of several."""
    def sigma(level: np.ndarray) -> np.ndarray:
        signal = np.maximum((level - black) / scale, 0)
        return np.asarray(scale * np.sqrt(samples * (line[0] + line[1] * signal)))
    return sigma


# ---- rows of two gains ---------------------------------------------------------------------------

def _require_one_gain(frame: photos.RawFrame) -> None:
    """Refuse a mosaic whose rows were read out with two gains in turn (dual ISO): rows of one
    colour are brighter and darker by turns then, all over the picture.

    Pictures have no such stripes: the colour of each row of the tile steps up and down from tile to
    tile in nearly all of its rows.
    """
    tile = frame.cfa.shape[0]
    every = max(1, frame.mosaic.shape[1] // frame.cfa.shape[1] // MAX_COLUMNS) * frame.cfa.shape[1]
    steps, alternate = list[np.ndarray](), list[float]()
    for y in range(tile):
        level = np.array([float(frame.black_level[y, x]) for x in range(frame.cfa.shape[1])])
        means = sum(frame.mosaic[y::tile, x::every].mean(axis=1) - level[x]
                    for x in range(frame.cfa.shape[1]))
        bright = means > MIN_ROW_SIGNAL * frame.white_level
        pairs = (bright[1:] | bright[:-1]) & (means[1:] > 0) & (means[:-1] > 0)
        if np.count_nonzero(pairs) < MIN_ROW_PAIRS:
            return
        signs = np.where(np.arange(pairs.size) % 2, -1, 1)[pairs]
        step = np.log(means[1:][pairs] / means[:-1][pairs]) * signs
        steps.append(np.abs(step))
        alternate.append(abs(float(np.mean(np.sign(step) * (np.abs(step) > MIN_ROW_STEP)))))
    if min(alternate) < ROWS_IN_TURN:
        return
    ratio = float(np.exp(np.median(np.concatenate(steps))))
    raise InputError(f"raw photo {frame.file}: its rows were read out with two gains in turn (dual "
                     f"ISO), brighter and darker by a factor of {ratio:.1f} from one pair of rows "
                     "to the next; switch dual ISO off and photograph again, or make one exposure "
                     "of it with the camera software's own converter (cr2hdr of Magic Lantern) and "
                     "give that DNG")
