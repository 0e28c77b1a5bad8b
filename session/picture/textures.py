"""The spectra of pixels as textures of Mitsuba, in the texture coordinates of the surfaces.

``texture-NAME.exr`` holds the mean in the layout of ``mean.exr``, for the texture
``spectral_picture`` (reconstruct/rendering/spectral_texture.py), and
``texture-NAME-standard_deviation.exr`` what it is known to. A texel is as large as the finest
pixels, and has the mean of the pixels that show it; holes between these are filled from the nearest
one. Beyond, the mean spectrum of the surface stands in, and its standard deviation is no number.
Surfaces whose parts share texture coordinates, as the faces of a cube do, have a texture only where
one of them is seen.
"""
from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt

from spectrabox.capture.photo.image_rows import exr_rows
from spectrabox.radiometry.appearance import TO_SRGB, adapted_tristimulus
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.outside.names import file_stem
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra.spectral_layers import (
    STANDARD_DEVIATION,
    layer_names,
    layout_attributes,
)
from spectrabox.reconstruct.pixels.hits import hits_of
from spectrabox.reconstruct.rendering.spectral_texture import NAME
from spectrabox.session.picture.picture_maps import DAYLIGHT
from spectrabox.session.picture.scene_of_picture import SceneOfPicture
from spectrabox.session.picture.unseen import SEEN
from spectrabox.session.signals.spectra_rows import SPREAD, KeptWavelengths, Spectra

MOST_TEXELS = 8192          # along a side
FEWEST_PIXELS = 16          # of a surface that gets a texture
APART = 8.0                 # pixels: texels whose pixels lie further apart are of several parts
FEW = 0.02                  # of the texels, which may be so at creases
FINEST = 10                 # percentile of the pixels' sizes, which that of texels is
HOLE = 6.0                  # texels from one that is seen: filled from there
XML = "textures.xml"


@dataclass(frozen=True, eq=False)
class _Texture:
    """The texture of one surface while pixels are added."""

    surface: str
    bsdf: str
    texel: np.ndarray           # (n,) of the pixels
    shape: tuple[int, int]      # rows and columns
    count: np.ndarray           # (texels,)
    mean: np.ndarray            # (texels, P) sums
    spread: np.ndarray          # (texels, Q)

    @property
    def stem(self) -> str:
        """Of its files."""
        return f"texture-{file_stem(self.surface)}"


class Textures:
    """Textures of the surfaces of unknown materials, to which the pixels' spectra are added.

    Parameters
    ----------
    scene : SceneOfPicture
    unseen : (H, W) array
        Why pixels of the picture have no spectrum.
    kept : KeptWavelengths
    """

    def __init__(self, scene: SceneOfPicture, unseen: np.ndarray, kept: KeptWavelengths) -> None:
        part, view = scene.part, scene.view
        self.kept = kept
        self.notes: tuple[str, ...] = ()
        surface = scene.traced.nodes.surface[part.rows, part.columns]
        unknown = [number for number, name in enumerate(view.surface_materials)
                   if name not in view.known]
        wanted = np.isin(surface, unknown) & (unseen == SEEN)
        row, column = np.nonzero(wanted)
        hits = hits_of(scene.unit.scene, view.size, row + part.rows.start,
                       column + part.columns.start)
        self._number = np.full(surface.shape, -1, np.int32)     # of each pixel among those wanted
        self._number[row, column] = np.arange(row.size)
        self._of = surface[row, column]
        self._textures: dict[int, _Texture] = {}
        shared = []
        names = list(view.scene_file.surfaces.items())
        for number in unknown:
            own = np.flatnonzero(self._of == number)
            if own.size < FEWEST_PIXELS:
                continue
            uv, point = hits.uv[own], hits.point[own]
            beside = _beside(self._number, own)
            if not beside.size or np.ptp(uv, axis=0).min() == 0:
                continue
            apart = np.linalg.norm(hits.point[beside[:, 0]] - hits.point[beside[:, 1]], axis=1)
            rows, columns = (_texels(np.abs(np.diff(hits.uv[beside, axis])[:, 0]))
                             for axis in (1, 0))
            # v runs upwards, rows downwards
            texel = np.clip(((1 - uv[:, 1]) * rows).astype(int), 0, rows - 1) * columns \
                + np.clip((uv[:, 0] * columns).astype(int), 0, columns - 1)
            if _several_parts(texel, point, float(np.median(apart))):
                shared.append(names[number][0])
                continue
            whole = np.full(row.size, -1)
            whole[own] = texel
            total = rows * columns
            self._textures[number] = _Texture(
                *names[number], whole, (rows, columns), np.zeros(total, np.int32),
                np.zeros((total, kept.nm[0].size), np.float32),
                np.zeros((total, kept.nm[1].size), np.float32))
        if shared:
            self.notes = (f"no texture of {', '.join(shared)}: several of their parts in the "
                          "photo share texture coordinates",)

    def add(self, first: int, last: int, made: Spectra) -> None:
        """Add the spectra of some rows."""
        number = self._number[first:last].ravel()
        mean, spread, _, unseen, _ = made
        for texture in self._textures.values():
            some = np.flatnonzero((number >= 0) & (unseen == SEEN))
            texel = texture.texel[number[some]]
            some, texel = some[texel >= 0], texel[texel >= 0]
            np.add.at(texture.count, texel, 1)
            np.add.at(texture.mean, texel, mean[some])
            np.add.at(texture.spread, texel, spread[some])

    def write(self, folder: Path) -> tuple[str, ...]:
        """Write the textures, and the BSDFs that name them; the files' names."""
        files: list[str] = []
        root = ET.Element("scene", version="3.0.0")
        nm, spread_nm = self.kept.nm
        to_srgb = (TO_SRGB @ adapted_tristimulus(nm, DAYLIGHT)).T.astype(np.float32)
        for texture in self._textures.values():
            if not texture.count.any():
                continue
            shown, size = texture.count > 0, texture.shape
            count = np.maximum(texture.count, 1)[:, None].astype(np.float32)
            mean, spread = texture.mean / count, texture.spread / count
            whole = mean[shown].mean(axis=0)
            away, nearest = distance_transform_edt(~shown.reshape(size), return_indices=True)
            there = np.ravel_multi_index(tuple(nearest), size).ravel()
            mean, spread = mean[there], spread[there]
            beyond = away.ravel() > HOLE
            mean[beyond], spread[beyond] = whole, np.nan
            names = f"{texture.stem}.exr", f"{texture.stem}-{SPREAD}.exr"
            for name, values, layers, what in (
                    (names[0], np.hstack([mean @ to_srgb, mean]), [*"RGB", *layer_names(nm)],
                     Quantity.REFLECTANCE),
                    (names[1], spread, layer_names(spread_nm), STANDARD_DEVIATION)):
                with exr_rows(folder / name, *size, layers, not self.kept.full,
                              layout_attributes(what)) as write:
                    write(0, values.reshape(*size, -1))
            files += names
            _add_bsdf(root, texture, names[0])
        if files:
            ET.indent(root)
            write_text_whole(folder / XML, ET.tostring(root, encoding="unicode") + "\n")
            files.append(XML)
        return tuple(files)


def _add_bsdf(root: ET.Element, texture: _Texture, file: str) -> None:
    bsdf = ET.SubElement(root, "bsdf", type="diffuse", id=f"{texture.bsdf} of {texture.surface}")
    spectra = ET.SubElement(bsdf, "texture", name="reflectance", type=NAME)
    ET.SubElement(spectra, "string", name="filename", value=file)


def _beside(number: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Pairs (n, 2) of some pixels that lie beside one another, by their numbers."""
    mine = np.zeros(int(number.max()) + 2, bool)
    mine[own] = True        # the last stays False: of pixels without a number
    pairs = [np.column_stack([one.ravel(), other.ravel()]) for one, other in (
        (number[:, :-1], number[:, 1:]), (number[:-1], number[1:]))]
    every = np.vstack(pairs)
    return np.asarray(every[mine[every].all(axis=1)])


def _texels(steps: np.ndarray) -> int:
    """Texels along a side, of the steps (n,) between pixels across and down: as fine as the finest
    pixels, of those that do go along it.
    """
    along = steps[steps > steps.max() / 10]
    return int(np.clip(round(1 / max(float(np.percentile(along, FINEST)), 1e-9)), 1, MOST_TEXELS))


def _several_parts(texel: np.ndarray, point: np.ndarray, pixel: float) -> bool:
    """Whether texels (n,) are shown by points (n, 3) far from each other."""
    _, inverse, count = np.unique(texel, return_inverse=True, return_counts=True)
    middle = np.column_stack([np.bincount(inverse, axis) for axis in point.T]) / count[:, None]
    off = np.linalg.norm(point - middle[inverse], axis=1)
    worst = np.zeros(count.size)
    np.maximum.at(worst, inverse, off)
    return bool(np.mean(worst > APART * pixel) > FEW)

