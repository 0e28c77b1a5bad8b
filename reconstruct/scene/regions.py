"""Blocks of pixels of one surface: what the fit compares instead of single pixels.

The mean over a block is as linear in the transport as a pixel is, but its Monte Carlo noise is far
smaller. That noise matters: it enters the fit as an error of the model, which pulls every spectrum
down by its relative variance.
"""
from __future__ import annotations

import numpy as np

# above, wider blocks: nothing in a diffuse scene varies faster than such a block
MAX_REGIONS = 1024
MIN_BLOCK = 4           # pixels


def block_regions(surface: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Region (H, W) of each usable pixel, -1 elsewhere, and the surface (R,) of each region.

    Surface after surface, in the order in which they are met in the picture: paths are drawn region
    after region, and how a scene numbers its surfaces must not change them.

    Parameters
    ----------
    surface : (H, W) int        one surface's index, -1 none or mixed
    used : (H, W) bool          pixels that may be compared
    """
    row, column = np.nonzero(used & (surface >= 0))
    block = max(MIN_BLOCK, round(np.sqrt(row.size / MAX_REGIONS)))
    known, first, number = np.unique(surface[row, column], return_index=True, return_inverse=True)
    met = np.argsort(first)
    rank = np.argsort(met)      # of each known surface
    key = np.stack([rank[number.ravel()], row // block, column // block])
    names, member = np.unique(key, axis=1, return_inverse=True)
    region = np.full(surface.shape, -1)
    region[row, column] = member.ravel()
    return region, known[met][names[0]]


def region_means(image: np.ndarray, region: np.ndarray) -> np.ndarray:
    """Mean (R, ...) over the pixels of each region.

    Parameters
    ----------
    image : (H, W, ...) array
    region : (H, W) int
        Region 0 to R-1 of each pixel, each with one pixel or more; -1 where it is not wanted.
    """
    mask = region >= 0
    count = np.bincount(region[mask])
    flat = image[mask].reshape(len(region[mask]), -1)
    sums = np.stack([np.bincount(region[mask], flat[:, column]) for column in range(flat.shape[1])],
                    axis=1)
    return (sums / count[:, None]).reshape(count.size, *image.shape[2:])
