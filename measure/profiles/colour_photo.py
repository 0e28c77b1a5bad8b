"""A photo of flat samples as a picture for colour management: even light, colours under D50."""
from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from spectrabox.calibrate.colour_profile import ColourTransform
from spectrabox.measure.pictures.crop import crop_of, node_grid
from spectrabox.measure.regions.white import FlatErrors, FlatPhoto, white_at_regions
from spectrabox.radiometry.profile_files import LabSpace, RgbSpace
from spectrabox.radiometry.records.photos import LinearImage

COLUMNS = 24                # of the nodes at which white is computed
ROWS = 128                  # that are converted at once


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


def colour_picture(signals: Iterator[np.ndarray], transform: ColourTransform,
                   space: RgbSpace | LabSpace) -> tuple[np.ndarray, float]:
    """Code values (H, W, 3) uint16 of a picture, and the share of its pixels that were clipped.

    Parameters
    ----------
    signals : iterator of (rows, W, 3) arrays
        Relative to white.
    transform : ColourTransform
    space : RgbSpace or LabSpace
    """
    parts = [space.code_values(transform.xyz(rows)) for rows in signals]
    picture, clipped = (np.concatenate(each) for each in zip(*parts, strict=True))
    return picture, float(clipped.mean())
