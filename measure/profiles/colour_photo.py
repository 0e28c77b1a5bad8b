"""A photo of flat samples as a picture for colour management: even light, colours under D50."""
from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from spectrabox.calibrate.colour_profile import ColourTransform
from spectrabox.measure.pictures.crop import crop_of, node_grid
from spectrabox.measure.white import FlatErrors, FlatPhoto, white_at_regions
from spectrabox.radiometry.profiles.icc_profile import RgbSpace
from spectrabox.radiometry.records import LinearImage

COLUMNS = 24                # of the nodes at which white is computed
ROWS = 128                  # that are converted at once
FULL_SCALE = 65535


def relative_signals(photo: LinearImage, lit: FlatPhoto, known: Mapping[str, np.ndarray],
                     errors: FlatErrors) -> Iterator[np.ndarray]:
    """Signals (rows, W, K) relative to white at each pixel, some rows at a time.

    Parameters
    ----------
    photo : LinearImage
        At its full size.
    lit : FlatPhoto
        The same with its chart and its light.
    known : mapping
        From names of regions to their known reflectances (P,).
    errors : FlatErrors
    """
    crop = crop_of(photo, None)
    nodes_px, between = node_grid(crop, COLUMNS)
    white = white_at_regions(lit, known, errors, nodes_px)
    assert white is not None, "the first photo shows regions"
    log_white = np.log(white.white[-len(nodes_px):])        # the nodes stand after the regions
    glare = white.glare + white.mean[white.glare_part]
    for first in range(0, len(photo.signal), ROWS):
        rows = photo.signal[first:first + ROWS]
        there = np.exp(between(first, first + len(rows)) @ log_white)
        yield (rows - glare) / there.reshape(rows.shape)


def colour_picture(signals: Iterator[np.ndarray], transform: ColourTransform, space: RgbSpace
                   ) -> tuple[np.ndarray, float]:
    """Code values (H, W, 3) uint16 of a picture, and the share of its pixels that were clipped.

    Parameters
    ----------
    signals : iterator of (rows, W, 3) arrays
        Relative to white.
    transform : ColourTransform
    space : RgbSpace
    """
    to_rgb = np.linalg.inv(space.to_xyz)
    parts, clipped = [], 0
    for rows in signals:
        linear = transform.xyz(rows) @ to_rgb.T
        outside = (linear < -0.5 / FULL_SCALE) | (linear > 1 + 0.5 / FULL_SCALE)
        clipped += int(np.count_nonzero(outside.any(axis=2)))
        parts.append(np.round(space.encode(linear) * FULL_SCALE).astype(np.uint16))
    picture = np.concatenate(parts)
    return picture, clipped / picture[..., 0].size
