"""The spectra of pixels as textures of Mitsuba, in the texture coordinates of the surfaces.

``texture-NAME.exr`` holds the mean in the layout of ``mean.exr``, for the texture
``spectral_picture`` (reconstruct/rendering/spectral_texture.py), and
``texture-NAME-standard_deviation.exr`` its standard deviation. A texel is as large as the finest
pixels, and has the mean of the pixels that show it; holes between these are filled from the nearest
texel. Beyond, the mean is that of the surface, and the standard deviation NaN. Surfaces whose parts
share texture coordinates, as the faces of a cube do, have a texture only where one part is seen.
"""
from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_array

from spectrabox.capture.photo.image_rows import exr_rows
from spectrabox.measure.pictures.lit_photo import PhotoSpectra
from spectrabox.measure.pictures.pixel_flags import SEEN
from spectrabox.measure.pictures.pixel_spectra import KeptWavelengths, row_blocks
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra.spectral_layers import (
    STANDARD_DEVIATION,
    layer_names,
    layout_attributes,
)
from spectrabox.radiometry.system.names import file_stem
from spectrabox.reconstruct.rendering.spectral_texture import NAME
from spectrabox.reconstruct.scene.surfaces import hits_of
from spectrabox.session.pictures.spectra_files import DEVIATION, srgb_of_spectra
from spectrabox.session.pictures.traced_photo import TracedPhoto

MAX_TEXELS = 8192           # along a side
MIN_PIXELS = 16             # of a surface that gets a texture
APART = 8.0                 # pixels: texels whose pixels lie further apart show several parts
MAX_APART = 0.02            # share of the texels, at creases
FINEST = 10                 # percentile of the pixels' sizes, which is the size of texels
HOLE = 6.0                  # texels from one that is seen: filled from there
XML = "textures.xml"


@dataclass(frozen=True, eq=False)
class _Texture:
    """The texture of one surface."""

    surface: str
    bsdf: str
    texel: np.ndarray           # (t,) of those that pixels show, ascending
    shape: tuple[int, int]      # rows and columns
    first: int                  # of the t among those of all textures

    @property
    def stem(self) -> str:
        """Of its files."""
        return f"texture-{file_stem(self.surface)}"


class Textures:
    """Textures of the surfaces of unknown materials, to which the pixels' spectra are added.

    Parameters
    ----------
    scene : TracedPhoto
    flags : (H, W) array
        Of pixel_flags.py.
    kept : KeptWavelengths
    """

    def __init__(self, scene: TracedPhoto, flags: np.ndarray, kept: KeptWavelengths) -> None:
        part, view = scene.crop, scene.view
        self.kept = kept
        self.notes: tuple[str, ...] = ()
        surface = scene.traced.nodes.surface[part.rows, part.columns]
        unknown = [number for number, name in enumerate(view.surface_materials)
                   if name not in view.known]
        row, column = np.nonzero(np.isin(surface, unknown) & (flags == SEEN))
        hits = hits_of(scene.unit.scene, view.size, row + part.rows.start,
                       column + part.columns.start)
        of = surface[row, column]
        pairs = _beside(row, column, of, surface.shape)
        self._texel = np.full(surface.shape, -1, np.int32)      # of each pixel, among all shown
        self._textures: list[_Texture] = []
        shared, names, total = [], list(view.scene_file.surfaces.items()), 0
        for number in unknown:
            own, beside = np.flatnonzero(of == number), pairs[of[pairs[:, 0]] == number]
            uv = hits.uv[own]
            if own.size < MIN_PIXELS or not beside.size or np.ptp(uv, axis=0).min() == 0:
                continue
            apart = np.linalg.norm(hits.point[beside[:, 0]] - hits.point[beside[:, 1]], axis=1)
            rows, columns = (_texels(np.abs(np.diff(hits.uv[beside, axis])[:, 0]))
                             for axis in (1, 0))
            # v runs upwards, rows downwards
            texel = np.clip(((1 - uv[:, 1]) * rows).astype(int), 0, rows - 1) * columns \
                + np.clip((uv[:, 0] * columns).astype(int), 0, columns - 1)
            shown, inverse = np.unique(texel, return_inverse=True)
            if _several_parts(inverse, hits.point[own], float(np.median(apart))):
                shared.append(names[number][0])
                continue
            self._texel[row[own], column[own]] = total + inverse
            self._textures.append(_Texture(*names[number], shown, (rows, columns), total))
            total += shown.size
        self._count = np.zeros(total, np.int32)
        self._sums = tuple(np.zeros((total, nm.size), np.float32) for nm in kept.nm)
        if shared:
            self.notes = (f"no texture of {', '.join(shared)}: several of their parts in the "
                          "photo share texture coordinates",)

    def add(self, first: int, last: int, spectra: PhotoSpectra) -> None:
        """Add the spectra of rows ``first`` to ``last``."""
        texel = self._texel[first:last].ravel()
        some = np.flatnonzero((texel >= 0) & (spectra.flags == SEEN))
        texels, inverse, count = np.unique(texel[some], return_inverse=True, return_counts=True)
        of_texel = csr_array((np.ones(some.size, np.float32), (inverse, some)),
                             (texels.size, texel.size))
        self._count[texels] += count.astype(np.int32)
        for sums, values in zip(self._sums, (spectra.mean, spectra.standard_deviation),
                                strict=True):
            sums[texels] += of_texel @ values

    def write(self, folder: Path) -> tuple[str, ...]:
        """Write the textures, and the BSDFs that name them; the files' names."""
        files: list[str] = []
        root = ET.Element("scene", version="3.0.0")
        for texture in self._textures:
            own = slice(texture.first, texture.first + texture.texel.size)
            seen = self._count[own] > 0
            if not seen.any():
                continue
            count = self._count[own][seen, None].astype(np.float32)
            nearest, beyond = _filled(texture.texel[seen], texture.shape)
            names = f"{texture.stem}.exr", f"{texture.stem}-{DEVIATION}.exr"
            mean, spread = (sums[own][seen] / count for sums in self._sums)
            self._write(folder / names[0], mean, nearest, beyond, Quantity.REFLECTANCE)
            self._write(folder / names[1], spread, nearest, beyond, STANDARD_DEVIATION)
            files += names
            _add_bsdf(root, texture, names[0])
        if files:
            ET.indent(root)
            write_text_whole(folder / XML, ET.tostring(root, encoding="unicode") + "\n")
            files.append(XML)
        return tuple(files)

    def _write(self, path: Path, values: np.ndarray, nearest: np.ndarray, beyond: np.ndarray,
               what: Quantity | str) -> None:
        """Write a texture, some rows at a time: of each texel (h, w) the row of ``values`` that is
        nearest, and whether it is too far from what is seen.
        """
        height, width = nearest.shape
        nm = self.kept.nm[0 if what is Quantity.REFLECTANCE else 1]
        layers, elsewhere = layer_names(nm), np.full(nm.size, np.nan, np.float32)
        if what is Quantity.REFLECTANCE:
            to_srgb = srgb_of_spectra(nm)
            elsewhere = np.r_[values.mean(axis=0) @ to_srgb, values.mean(axis=0)]
            layers, values = [*"RGB", *layers], np.hstack([values @ to_srgb, values])
        with exr_rows(path, height, width, layers, not self.kept.full,
                      layout_attributes(what)) as write:
            for first, last in row_blocks(height, width):
                block = values[nearest[first:last]]
                block[beyond[first:last]] = elsewhere
                write(first, block)


def _filled(texel: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Index (h, w) of the nearest of some texels, and whether it is further than holes are wide."""
    index = np.full(shape, -1, np.int32)
    index.ravel()[texel] = np.arange(texel.size)
    away, nearest = distance_transform_edt(index < 0, return_indices=True)
    return index[tuple(nearest)], away > HOLE


def _add_bsdf(root: ET.Element, texture: _Texture, file: str) -> None:
    bsdf = ET.SubElement(root, "bsdf", type="diffuse", id=f"{texture.bsdf} of {texture.surface}")
    spectra = ET.SubElement(bsdf, "texture", name="reflectance", type=NAME)
    ET.SubElement(spectra, "string", name="filename", value=file)


def _beside(row: np.ndarray, column: np.ndarray, surface: np.ndarray,
            shape: tuple[int, ...]) -> np.ndarray:
    """Pairs (m, 2) of pixels (n,) that lie beside one another on one surface, by their numbers."""
    number = np.full(shape, -1, np.int32)
    number[row, column] = np.arange(row.size)
    every = np.vstack([np.column_stack([one.ravel(), other.ravel()]) for one, other in (
        (number[:, :-1], number[:, 1:]), (number[:-1], number[1:]))])
    every = every[(every >= 0).all(axis=1)]
    return np.asarray(every[surface[every[:, 0]] == surface[every[:, 1]]])


def _texels(steps: np.ndarray) -> int:
    """Texels along a side, of the steps (n,) between pixels across and down: as fine as the finest
    pixels, of those that do go along it.
    """
    along = steps[steps > steps.max() / 10]
    return int(np.clip(round(1 / max(float(np.percentile(along, FINEST)), 1e-9)), 1, MAX_TEXELS))


def _several_parts(texel: np.ndarray, point: np.ndarray, pixel: float) -> bool:
    """Whether some of the texels 0 to t - 1 are shown (n,) by points (n, 3) far from each other."""
    count = np.bincount(texel)
    middle = np.column_stack([np.bincount(texel, axis) for axis in point.T]) / count[:, None]
    off = np.linalg.norm(point - middle[texel], axis=1)
    worst = np.zeros(count.size)
    np.maximum.at(worst, texel, off)
    return bool(np.mean(worst > APART * pixel) > MAX_APART)
