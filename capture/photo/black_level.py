"""Colour and black level at each position of the repeating tile of a sensor.

LibRaw lists black levels by colour (R, G1, B, G2), drops their fractions, and mixes them up where
the active area begins at an odd row or column, and reports 0 for a camera that it does not know.
The DNG tag lists them by position from the first active pixel and is exact; pixels that no light
reaches are better still, because they were read out with this very photo: those that a DNG names,
else the margins about the visible pixels, where they prove to be dark.
"""
from __future__ import annotations

import math
from typing import Any

import numpy as np

from spectrabox.capture.photo.metadata import PhotoMetadata
from spectrabox.radiometry.errors import InputError

COLOUR_INDEX = {"R": 0, "G": 1, "B": 2}
MIN_MASKED = 256             # samples of each position: an error of 0.06 of the read noise
OUTLIER_SIGMA = 4.0          # of masked pixels: hot pixels and light that leaks in at the edge
SIGMA_PER_MAD = 1.4826       # of a normal distribution
NEXT_TO_LIGHT = 4            # pixels of a margin beside the visible ones: light leaks in
MIN_MARGIN = 8               # pixels, of what is left: some cameras pad their rows by a few
DARKEST = 0.1                # per cent of the visible pixels
MARGIN_SIGMA = 4.0           # of read noise: a margin above the darkest pixels or off what is known
SHARE_OF_WHITE = 0.002       # by which black drifts between what a camera states and what it read


def departures(raw: Any, metadata: PhotoMetadata,
               name: str) -> tuple[np.ndarray, np.ndarray] | None:
    """DN by which black departs from its mean in each row (H,) and column (W,) of the whole mosaic,
    as a DNG states it (BlackLevelDelta), 0 where it states nothing; None if it states none at all.

    Parameters
    ----------
    raw : rawpy.RawPy
        Opened.
    metadata : PhotoMetadata
        Of the same file.
    name : str
        Of the file, for errors.

    Raises
    ------
    InputError
        If their number is not that of the visible rows or columns.
    """
    if not any(metadata.black_rows) and not any(metadata.black_columns):
        return None
    sizes = raw.sizes
    sides = []
    for stated, first, visible, whole, start, which in (
            (metadata.black_rows, metadata.active_origin[0], sizes.height, sizes.raw_height,
             sizes.top_margin, "rows"),
            (metadata.black_columns, metadata.active_origin[1], sizes.width, sizes.raw_width,
             sizes.left_margin, "columns")):
        side = np.zeros(whole)
        if stated:
            if not (first <= start and start + visible <= first + len(stated) <= whole):
                raise InputError(f"raw photo {name} states black levels of {len(stated)} {which} "
                                 f"and has {visible}; it is damaged: copy it from the camera card "
                                 "again")
            levels = np.array([float(level) for level in stated])
            side[first:first + len(stated)] = levels - levels.mean()
        sides.append(side)
    return sides[0], sides[1]


def mean_departure(metadata: PhotoMetadata) -> float:
    """What the stated departures add to the black level on average, DN."""
    return float(sum(float(sum(stated)) / len(stated) for stated in
                     (metadata.black_rows, metadata.black_columns) if stated))


def tile_of(raw: Any, metadata: PhotoMetadata,
            departing: tuple[np.ndarray, np.ndarray] | None = None
            ) -> tuple[np.ndarray, np.ndarray]:
    """Colour (a, b) and black level (a, b), DN, of the tile that starts at the first visible pixel.

    Parameters
    ----------
    raw : rawpy.RawPy
        Opened.
    metadata : PhotoMetadata
        Of the same file.
    departing : tuple of (H,) and (W,) array, optional
        As of ``departures``.
    """
    origin = (raw.sizes.top_margin, raw.sizes.left_margin)
    pattern = (1, 1) if raw.num_colors == 1 else raw.raw_pattern.shape
    repeat = metadata.black_repeat if metadata.black_level is not None else (1, 1)
    shape = (math.lcm(pattern[0], repeat[0]), math.lcm(pattern[1], repeat[1]))
    colour = np.array([[raw.raw_color(origin[0] + y % pattern[0], origin[1] + x % pattern[1])
                        for x in range(shape[1])] for y in range(shape[0])])
    by_libraw = np.asarray(raw.black_level_per_channel, dtype=float)
    letters = raw.color_desc.decode()
    if raw.num_colors == 1:
        cfa, by_libraw = np.zeros(shape, int), np.full(shape, by_libraw[0])
    else:
        cfa = np.array([[COLOUR_INDEX[letters[index]] for index in row] for row in colour])
        by_libraw = by_libraw[colour]
    whole = raw.raw_image if departing is None else \
        raw.raw_image - departing[0][:, None].astype(np.float32) - departing[1].astype(np.float32)
    masked = masked_black(whole, metadata.masked_areas, origin, shape)
    if masked is not None:
        return cfa, masked
    stated = _stated_black(metadata, origin, shape)
    # The tag may belong to another picture in the file: LibRaw must give the same levels, but for
    # the fraction.
    same = stated is not None and np.all(np.abs(np.sort(stated, axis=None)
                                                - np.sort(by_libraw, axis=None)) < 1)
    known = stated if stated is not None and (same or metadata.masked_areas) else by_libraw
    margins = dark_margins(whole, (*origin, raw.sizes.height, raw.sizes.width), shape,
                           known, float(raw.white_level))
    return cfa, known if margins is None else margins


def full_colour_black(raw: Any, metadata: PhotoMetadata) -> np.ndarray:
    """Black level (3,), DN, of the pixels of a linear DNG: the tag's, with its fractions.

    Parameters
    ----------
    raw : rawpy.RawPy
        Opened.
    metadata : PhotoMetadata
        Of the same file.
    """
    by_libraw = np.asarray(raw.black_level_per_channel, dtype=float)[:3]
    if metadata.black_level is None or len(metadata.black_level) not in (1, 3):
        return by_libraw
    stated = mean_departure(metadata) + np.broadcast_to(
        [float(level) for level in metadata.black_level], 3)
    return np.array(stated) if np.all(np.abs(stated - by_libraw) < 1) else by_libraw


def masked_black(whole: np.ndarray, areas: tuple[tuple[int, ...], ...], origin: tuple[int, int],
                 shape: tuple[int, ...]) -> np.ndarray | None:
    """Mean (a, b) of the masked pixels at each position of the tile; None where they are too few.

    Parameters
    ----------
    whole : (H, W) array
        DN, the whole mosaic with its margins.
    areas : tuple of (top, left, bottom, right)
        Of each masked area.
    origin : (row, column)
        Of the first visible pixel, where the tile starts.
    shape : (a, b)
        Of the tile.
    """
    samples: list[list[np.ndarray]] = [[] for _ in range(shape[0] * shape[1])]
    for top, left, bottom, right in areas:
        for position, (y, x) in enumerate(np.ndindex(*shape)):
            first_row, first_column = (top + (origin[0] + y - top) % shape[0],
                                       left + (origin[1] + x - left) % shape[1])
            samples[position].append(whole[first_row:bottom:shape[0],
                                           first_column:right:shape[1]].ravel())
    if not areas or min(sum(part.size for part in parts) for parts in samples) < MIN_MASKED:
        return None
    means = []
    for parts in samples:
        values = np.concatenate(parts).astype(float)
        deviation = np.abs(values - np.median(values))
        # half a DN: quiet sensors repeat one value
        sigma = max(SIGMA_PER_MAD * float(np.median(deviation)), 0.5)
        means.append(values[deviation <= OUTLIER_SIGMA * sigma].mean())
    return np.array(means).reshape(shape)


def dark_margins(whole: np.ndarray, visible: tuple[int, int, int, int], shape: tuple[int, ...],
                 known: np.ndarray, white: float) -> np.ndarray | None:
    """Mean (a, b) of the margins about the visible pixels at each position of the tile, of those
    margins that are dark; None where none is.

    Some cameras light their margins, pad them with zeros or keep other numbers there: a margin
    counts where it lies no higher than the darkest visible pixels and agrees with the level that
    is known otherwise. A level of 0 is what LibRaw says of a camera that it does not know: nothing
    has to agree with it, and a margin that reads 0 as well says nothing.

    Parameters
    ----------
    whole : (H, W) array
        DN, the whole mosaic with its margins.
    visible : (top, left, height, width)
        Of the visible pixels.
    shape : (a, b)
        Of the tile, which starts at the first of them.
    known : (a, b) array
        DN, black level as the file or LibRaw states it.
    white : float
        DN.
    """
    top, left, height, width = visible
    rows, columns = whole.shape
    strips = [(0, 0, top - NEXT_TO_LIGHT, columns),
              (top + height + NEXT_TO_LIGHT, 0, rows, columns),
              (top, 0, top + height, left - NEXT_TO_LIGHT),
              (top, left + width + NEXT_TO_LIGHT, top + height, columns)]
    strips = [strip for strip in strips
              if min(strip[2] - strip[0], strip[3] - strip[1]) >= MIN_MARGIN]
    if not strips:
        return None
    darkest = np.array([np.percentile(whole[top + y:top + height:shape[0],
                                            left + x:left + width:shape[1]], DARKEST)
                        for y, x in np.ndindex(*shape)]).reshape(shape)
    dark: list[tuple[int, ...]] = []
    for strip in strips:
        level = masked_black(whole, (strip,), (top, left), shape)
        if level is None:
            continue
        values = whole[strip[0]:strip[2], strip[1]:strip[3]]
        noise = SIGMA_PER_MAD * float(np.median(np.abs(values - np.median(values))))
        near = max(MARGIN_SIGMA * noise, SHARE_OF_WHITE * white)
        agrees = np.abs(level - known) <= near if known.any() else level > near
        if np.all(level <= darkest + near) and np.all(agrees):
            dark.append(strip)
    return masked_black(whole, tuple(dark), (top, left), shape) if dark else None


def _stated_black(metadata: PhotoMetadata, origin: tuple[int, int],
                  shape: tuple[int, ...]) -> np.ndarray | None:
    if metadata.black_level is None:
        return None
    levels = mean_departure(metadata) + np.array([float(level) for level in metadata.black_level])
    rows, columns = metadata.black_repeat
    if levels.size == 1:
        return np.full(shape, levels[0])
    if levels.size != rows * columns:
        return None
    y, x = (np.arange(size) + start - active
            for size, start, active in zip(shape, origin, metadata.active_origin, strict=True))
    return levels.reshape(rows, columns)[np.ix_(y % rows, x % columns)]
