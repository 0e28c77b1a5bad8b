"""Textures of surfaces as files for Mitsuba.

``texture-NAME.exr`` holds the mean in the layout of ``mean.exr``, for the texture
``spectral_picture`` (reconstruct/rendering/renderer.py), and
``texture-NAME-standard_deviation.exr`` its standard deviation; ``textures.xml`` has BSDFs that name
them.
"""
from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable
from dataclasses import replace
from pathlib import Path

from spectrabox.measure.pictures import pixel_spectra, spectra_files, surface_textures
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.system.words import file_stem
from spectrabox.reconstruct.scene.plugins import SPECTRAL_PICTURE

XML = "textures.xml"


def write_textures(sums: surface_textures.TextureSums, layout: pixel_spectra.PictureLayout,
                   folder: Path) -> tuple[str, ...]:
    """Write textures, and the BSDFs that name them.

    Parameters
    ----------
    sums : TextureSums
        Of all pixels.
    layout : PictureLayout
        Of the picture; textures are EXR whatever its format.
    folder : Path

    Returns
    -------
    tuple of str
        Names of the files.
    """
    files: list[str] = []
    root = ET.Element("scene", version="3.0.0")
    layout = replace(layout, form="exr")
    for surface, bsdf, shape, layers in sums.textures():
        stem = _stem(surface)
        for name, rows in layers.items():
            file = f"{stem}.exr" if name == spectra_files.MEAN else f"{stem}-{name}.exr"
            with spectra_files.layer_rows(name, folder / file, shape, layout) as write:
                for first, last in pixel_spectra.row_blocks(*shape):
                    write(first, rows(first, last))
            files.append(file)
        node = ET.SubElement(root, "bsdf", type="diffuse", id=f"{bsdf} of {surface}")
        spectra = ET.SubElement(node, "texture", name="reflectance", type=SPECTRAL_PICTURE)
        ET.SubElement(spectra, "string", name="filename", value=f"{stem}.exr")
    if files:
        ET.indent(root)
        write_text_whole(folder / XML, ET.tostring(root, encoding="unicode") + "\n")
        files.append(XML)
    return tuple(files)


def textures_of(files: Collection[str], surfaces: Iterable[str], folder: Path) -> dict[str, Path]:
    """The file of each surface that has a texture.

    Parameters
    ----------
    files : collection of str
        Names of the picture's files, as ``PictureRecords`` has them.
    surfaces : iterable of str
        Ids of shapes.
    folder : Path
        Of the files.
    """
    return {surface: folder / name for surface in surfaces
            if (name := f"{_stem(surface)}.exr") in files}


def _stem(surface: str) -> str:
    return f"texture-{file_stem(surface)}"
