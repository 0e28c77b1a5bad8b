"""The rectangle of a photo that a picture of spectra shows."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array, kron

from spectrabox.radiometry import errors, grid
from spectrabox.radiometry.records.photos import LinearImage


@dataclass(frozen=True)
class Crop:
    """A rectangle of a developed photo."""

    rows: slice
    columns: slice
    corners_px: tuple[float, float, float, float]   # left, top, right, bottom, of the photo
    step: float                                     # of those, to a developed one

    @property
    def x_px(self) -> np.ndarray:
        """Columns (W,) in the photo's pixels."""
        return (np.arange(self.columns.start, self.columns.stop) + 0.5) * self.step - 0.5

    @property
    def y_px(self) -> np.ndarray:
        """Rows (H,) in the photo's pixels."""
        return (np.arange(self.rows.start, self.rows.stop) + 0.5) * self.step - 0.5


def crop_of(photo: LinearImage, rect: Sequence[float] | None) -> Crop:
    """The rectangle between two opposite corners [x0, y0, x1, y1]; the whole photo by default.

    Parameters
    ----------
    photo : LinearImage
    rect : four floats, in pixels of the photo, or None

    Raises
    ------
    InputError
        If it leaves the photo, or holds fewer than 2 x 2 pixels.
    """
    step = photo.sensor_step
    rows, columns = photo.signal.shape[:2]
    size = columns * step, rows * step
    x0, y0, x1, y1 = rect or (-0.5, -0.5, size[0] - 0.5, size[1] - 0.5)
    left, right = sorted((x0, x1))
    top, bottom = sorted((y0, y1))
    if left < -0.5 or top < -0.5 or right > size[0] - 0.5 or bottom > size[1] - 0.5:
        raise errors.InputError(f"picture.rect leaves photo {photo.source} of {round(size[0])} x "
                         f"{round(size[1])} pixels; correct its corners")
    across, down = (slice(int(np.ceil((low + 0.5) / step - 0.5)),
                          int(np.floor((high + 0.5) / step - 0.5 - 1e-9)) + 1)
                    for low, high in ((left, right), (top, bottom)))
    if across.stop - across.start < 2 or down.stop - down.start < 2:
        raise errors.InputError("picture.rect holds fewer than 2 x 2 pixels; enlarge it")
    return Crop(down, across, (left, top, right, bottom), step)


def crop_photo(photo: LinearImage, crop: Crop) -> LinearImage:
    """The pixels of a crop, without a copy of them."""
    rows, columns = crop.rows, crop.columns
    return replace(photo, signal=photo.signal[rows, columns],
                   variance=photo.variance[rows, columns],
                   saturated=photo.saturated[rows, columns])


def node_grid(crop: Crop, columns: int) -> tuple[np.ndarray, Callable[[int, int], csr_array]]:
    """Nodes on a coarse grid over a crop, and how its pixels lie between them.

    Parameters
    ----------
    crop : Crop
    columns : int
        Of the nodes; rows are as far apart.

    Returns
    -------
    nodes_px : (N, 2) array
        x and y in the photo's pixels, row by row.
    between : function of (first row, last row)
        Weights (n, N) of the nodes at the pixels of rows of the crop: linear interpolation.
    """
    left, top, right, bottom = crop.corners_px
    x_px = np.linspace(left, right, columns)
    y_px = np.linspace(top, bottom, max(round(columns * (bottom - top) / (right - left)), 2))
    across, down = (csr_array(grid.interpolation_matrix(nodes, np.clip(at, nodes[0], nodes[-1])))
                    for nodes, at in ((x_px, crop.x_px), (y_px, crop.y_px)))
    return (np.stack(np.meshgrid(x_px, y_px), axis=-1).reshape(-1, 2),
            lambda first, last: kron(down[first:last], across, format="csr"))
