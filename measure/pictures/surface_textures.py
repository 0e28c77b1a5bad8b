"""Spectra of pixels collected in the texture coordinates of the surfaces that they show.

A texel is as large as the finest pixels, and has the mean of the pixels that show it; holes between
these are filled from the nearest texel. Beyond, the mean is that of the surface, and the standard
deviation that of a texel drawn from those that are seen: their spread and their own, together.
Surfaces whose parts share texture coordinates, as the faces of a cube do, have a
texture only where one part is seen.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_array

from spectrabox.measure.pictures import (
    pixel_flags,
    pixel_spectra,
    spectra_files,
    traced_photo,
)
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.reconstruct.scene.surfaces import hits_of

MAX_TEXELS = 8192           # along a side
MIN_PIXELS = 16             # of a surface that gets a texture
APART = 8.0                 # pixels: texels whose pixels lie further apart show several parts
MAX_APART = 0.02            # share of the texels, at creases
FINEST = 10                 # percentile of the pixels' sizes, which is the size of texels
HOLE = 6.0                  # texels from one that is seen: filled from there

RowsOfTexture = Callable[[int, int], np.ndarray]    # of (first, last) to (last - first, w, P)


class TextureSums:
    """Sums over the pixels of each texel, of all surfaces of unknown materials.

    Parameters
    ----------
    scene : TracedPhoto
    flags : (H, W) array
        Of pixel_flags.py.
    layout : PictureLayout
    """

    def __init__(self, scene: traced_photo.TracedPhoto, flags: np.ndarray,
                 layout: pixel_spectra.PictureLayout) -> None:
        crop, view = scene.crop, scene.view
        self.findings: tuple[Finding, ...] = ()
        surface = scene.nodes.surface[crop.rows, crop.columns]
        unknown = [number for number, name in enumerate(view.surface_materials)
                   if name not in view.known]
        row, column = np.nonzero(np.isin(surface, unknown) & (flags == pixel_flags.SEEN))
        point, _, coordinates = hits_of(scene.unit.scene, view.size, row + crop.rows.start,
                                        column + crop.columns.start)
        surface_of = surface[row, column]
        pairs = _neighbours(row, column, surface_of, surface.shape)
        self._texel = np.full(surface.shape, -1, np.int32)      # of each pixel, among all shown
        # by surface and its BSDF: texels (t,) that pixels show, ascending, and the texture's shape
        self._shown: dict[tuple[str, str], tuple[np.ndarray, tuple[int, int]]] = {}
        shared, names, total = [], list(view.scene_file.surfaces.items()), 0
        for number in unknown:
            own = np.flatnonzero(surface_of == number)
            neighbours = pairs[surface_of[pairs[:, 0]] == number]
            uv = coordinates[own]
            if own.size < MIN_PIXELS or not neighbours.size or np.ptp(uv, axis=0).min() == 0:
                continue
            apart = np.linalg.norm(point[neighbours[:, 0]] - point[neighbours[:, 1]], axis=1)
            rows, columns = (_texels_along(np.abs(np.diff(coordinates[neighbours, axis])[:, 0]))
                             for axis in (1, 0))
            # v runs upwards, rows downwards
            texel = np.clip(((1 - uv[:, 1]) * rows).astype(int), 0, rows - 1) * columns \
                + np.clip((uv[:, 0] * columns).astype(int), 0, columns - 1)
            shown, inverse = np.unique(texel, return_inverse=True)
            if _shows_several_parts(inverse, point[own], float(np.median(apart))):
                shared.append(names[number][0])
                continue
            self._texel[row[own], column[own]] = total + inverse
            self._shown[names[number]] = shown, (rows, columns)
            total += shown.size
        self._count = np.zeros(total, np.int32)
        self._sums = tuple(np.zeros((total, nm.size), np.float32) for nm in layout.nm)
        if shared:
            self.findings = (Finding("picture.no-texture", Severity.NOTE,
                                     values={"names": shared}),)

    def add(self, first: int, last: int, flags: np.ndarray, mean: np.ndarray,
            deviation: np.ndarray) -> None:
        """Add the spectra of rows ``first`` to ``last``."""
        texel = self._texel[first:last].ravel()
        some = np.flatnonzero((texel >= 0) & (flags == pixel_flags.SEEN))
        texels, inverse, count = np.unique(texel[some], return_inverse=True, return_counts=True)
        of_texel = csr_array((np.ones(some.size, np.float32), (inverse, some)),
                             (texels.size, texel.size))
        self._count[texels] += count.astype(np.int32)
        for sums, values in zip(self._sums, (mean, deviation), strict=True):
            sums[texels] += of_texel @ values

    def textures(self) -> Iterator[tuple[str, str, tuple[int, int], dict[str, RowsOfTexture]]]:
        """Surface, BSDF, shape (h, w) and rows of the layers of each texture, of the surfaces that
        the pixels showed.
        """
        start = 0
        for (surface, bsdf), (texel, shape) in self._shown.items():
            own = slice(start, start + texel.size)
            start += texel.size
            seen = self._count[own] > 0
            if not seen.any():
                continue
            count = self._count[own][seen, None].astype(np.float32)
            mean, deviation = (sums[own][seen] / count for sums in self._sums)
            index = np.full(shape, -1, np.int32)
            index.ravel()[texel[seen]] = np.arange(len(count))
            away, at = distance_transform_edt(index < 0, return_indices=True)
            nearest, beyond = index[tuple(at)], away > HOLE

            def rows_of(values: np.ndarray, filler: np.ndarray | float,
                        nearest: np.ndarray = nearest, beyond: np.ndarray = beyond
                        ) -> RowsOfTexture:
                def rows(first: int, last: int) -> np.ndarray:
                    block = values[nearest[first:last]]
                    block[beyond[first:last]] = filler
                    return block
                return rows

            yield surface, bsdf, shape, {
                spectra_files.MEAN: rows_of(mean, mean.mean(axis=0)),
                spectra_files.DEVIATION: rows_of(deviation, _spread(mean, deviation))}


def _spread(mean: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """Standard deviation (Q,) of a texel that nobody saw, of those (t, P) and (t, Q) that are seen:
    their scatter, at the wavelengths of the deviations, and what each is known to.
    """
    at = np.linspace(0, 1, deviation.shape[1])
    scatter = np.interp(at, np.linspace(0, 1, mean.shape[1]), mean.std(axis=0))
    return np.asarray(np.sqrt(scatter**2 + (deviation**2).mean(axis=0)), dtype=np.float32)


def _neighbours(row: np.ndarray, column: np.ndarray, surface: np.ndarray,
                shape: tuple[int, ...]) -> np.ndarray:
    """Pairs (m, 2) of neighbouring pixels (n,) of one surface, by their numbers."""
    number = np.full(shape, -1, np.int32)
    number[row, column] = np.arange(row.size)
    pairs = np.vstack([np.column_stack([one.ravel(), other.ravel()]) for one, other in (
        (number[:, :-1], number[:, 1:]), (number[:-1], number[1:]))])
    pairs = pairs[(pairs >= 0).all(axis=1)]
    return np.asarray(pairs[surface[pairs[:, 0]] == surface[pairs[:, 1]]])


def _texels_along(steps: np.ndarray) -> int:
    """Texels along a side, of the steps (n,) between pixels across and down: as fine as the finest
    pixels, of those that do go along it.
    """
    along = steps[steps > steps.max() / 10]
    return int(np.clip(round(1 / max(float(np.percentile(along, FINEST)), 1e-9)), 1, MAX_TEXELS))


def _shows_several_parts(texel: np.ndarray, point: np.ndarray, pixel: float) -> bool:
    """Whether some of the texels 0 to t - 1 are shown (n,) by points (n, 3) far from each other."""
    count = np.bincount(texel)
    middle = np.column_stack([np.bincount(texel, axis) for axis in point.T]) / count[:, None]
    off = np.linalg.norm(point - middle[texel], axis=1)
    worst = np.zeros(count.size)
    np.maximum.at(worst, texel, off)
    return bool(np.mean(worst > APART * pixel) > MAX_APART)
