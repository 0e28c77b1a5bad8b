"""The bands of a stack of photos that each pixel is seen in: a photo may be clipped or dark there.

A photo whose bands are not all seen at a pixel is left out there. Pixels with the same photos have
one set of bands, and its own table of spectra; of rare sets the pixels take the largest common set
within theirs.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.measure.pictures import pixel_flags
from spectrabox.radiometry.records.photos import LinearImage

MAX_SETS = 4        # the most frequent; each costs a table of spectra


@dataclass(frozen=True)
class ShownBands:
    """Sets of bands, and which of them each pixel is seen in."""

    sets: np.ndarray        # (S, K) bool
    index: np.ndarray       # (H, W) of the set; 0 for pixels without a spectrum
    flags: np.ndarray       # (H, W) of pixel_flags.py


def shown_bands(photo: LinearImage, glare: np.ndarray, photo_of_band: np.ndarray,
                silent: np.ndarray) -> ShownBands | None:
    """The bands that each pixel of a stack is seen in; None where all of them are seen or none.

    Parameters
    ----------
    photo : LinearImage
        The stack, of K bands.
    glare : (K,) array
        Signal.
    photo_of_band : (K,) int array
        The photo that each band is of; the first is 0.
    silent : (K,) bool array
        Bands that say nothing anywhere, since their light is too dark.
    """
    photos = np.unique(photo_of_band)
    clipped = np.zeros(photo.saturated.shape[:2], bool)
    code = np.zeros(clipped.shape, np.int64)
    for bit, number in enumerate(photos):
        bands = np.flatnonzero((photo_of_band == number) & ~silent)
        saturated = photo.saturated[..., bands].any(axis=2)
        seen = ~saturated & (photo.signal[..., bands] > glare[bands]).all(axis=2)
        code |= seen.astype(np.int64) << bit
        clipped |= saturated
    codes, count = np.unique(code, return_counts=True)
    if not codes.any() or (not silent.any() and set(codes.tolist()) <= {0, (1 << len(photos)) - 1}):
        return None
    of_code = (codes[:, None] >> np.arange(len(photos))) & 1 == 1           # (C, photos)
    frequent = [each for each in np.argsort(-count, kind="stable") if codes[each]][:MAX_SETS]
    frequent.sort(key=lambda each: -int(of_code[each].sum()))
    index, known = np.zeros(codes.size, np.uint8), np.zeros(codes.size, bool)
    for each, own in enumerate(codes):
        within = [number for number, one in enumerate(frequent) if codes[one] & ~own == 0]
        if within and own:
            index[each], known[each] = within[0], True
    at = np.searchsorted(codes, code)
    flags = np.where(known[at], pixel_flags.SEEN,
                     np.where(clipped, pixel_flags.CLIPPED, pixel_flags.DARK)).astype(np.uint8)
    sets = of_code[frequent][:, np.searchsorted(photos, photo_of_band)] & ~silent
    return ShownBands(sets, index[at], flags)
