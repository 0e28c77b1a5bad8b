"""A surface of known texture as known materials of a scene."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats.delimited import table_text
from spectrabox.radiometry.spectra.given_spectra import KnownSpectrum, as_reflectance
from spectrabox.radiometry.system.words import file_stem
from spectrabox.reconstruct.rendering import renderer
from spectrabox.reconstruct.scene.split_texture import paints_of_picture, split_shape

MAX_PAINTS = 8


@renderer.threads_given_back()
def split_texture(scene: str | Path, shape: str,
                  picture: str | Path | tuple[ArrayLike, Sequence[KnownSpectrum]], *,
                  paints: int = MAX_PAINTS) -> tuple[Path, dict[str, Path], float]:
    """A scene in which a surface of known texture is cut along its texels into known materials.

    Parameters
    ----------
    scene : path
        Mitsuba XML. The surface's own texture or spectrum is a placeholder.
    shape : str
        Id of a rectangle, or of a mesh with texture coordinates.
    picture : path, or (map, reflectances)
        A spectral EXR of reflectances; or a map (h, w) of int, 0 for the first of the reflectances:
        files, numbers or (nm, values). Its first row is the top (v = 1).
    paints : int
        At most so many materials: a spectral EXR of more spectra is reduced to their means.

    Returns
    -------
    scene : Path
        The scene that was written, beside the other, with a PLY file for each material.
    materials : dict of paths by material
        Files of their reflectances, for `reconstruct_scene` or ``[materials.NAME] known``.
    error : float
        Root mean square, over texels and wavelengths, of the reflectance that the paints leave out.

    Raises
    ------
    InputError
        If the scene has no such shape, the shape no texture coordinates, or map and reflectances do
        not fit.
    EnvironmentProblem
        If a file cannot be written.

    References
    ----------
    Means of like spectra: Lloyd 1982 (k-means), started as by Arthur and Vassilvitskii 2007. Why a
    material has one spectrum: docs/explanation/reconstruction.md.

    Examples
    --------
    >>> scene, paints, error = sb.split_texture("mybox/scene/box.xml", "poster", "mybox/poster.exr")
    >>> result = sb.reconstruct_scene("mybox/photos/box.dng", scene=scene, camera=camera,
    ...     light="mybox/spectra/light.csv",
    ...     materials={"white": None, "cube": None} | paints)
    """
    source = Path(scene)
    renderer.start_mitsuba("auto")
    error = 0.0
    if isinstance(picture, str | Path):
        pixels, nm = renderer.read_spectral_picture(str(Path(picture).resolve()))
        paint, spectra, error = paints_of_picture(pixels, paints)
    else:
        nm, paint = FINE_GRID.nm, np.asarray(picture[0])
        spectra = np.array([as_reflectance(each, f"reflectance {number}")
                            for number, each in enumerate(picture[1])])
        if paint.ndim != 2 or not np.all(np.isin(np.unique(paint), np.arange(len(spectra)))):
            raise InputError(f"the map of the texture has the shape {paint.shape} and values from "
                             f"{paint.min()} to {paint.max()}, with {len(spectra)} reflectances; "
                             f"rows and columns of whole numbers from 0 to {len(spectra) - 1} are "
                             "needed")
    target = source.with_stem(f"{source.stem}-{shape}")
    names = split_shape(source, shape, paint.astype(int), target)
    files = {name: target.with_name(f"{target.stem}-{file_stem(name)}.csv")
             for name in names if name}
    for name, values in zip(names, spectra, strict=False):      # the last may have no texel
        if name:
            write_text_whole(files[name], table_text(
                nm, {"reflectance": values}, quantity=Quantity.REFLECTANCE,
                source=f"texture of {shape} in {source.name}"))
    return target, files, error
