"""A surface of known texture cut along its texels into a mesh for each paint.

Light between surfaces is a sum over products of reflectances, one for each material, so that a
surface with a picture on it has as many materials as the picture has paints. Cut into meshes these
are known materials like others, and the scene stays one that a stock Mitsuba loads.
"""
from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from scipy.cluster.vq import kmeans2

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import read_text, write_text_whole
from spectrabox.radiometry.system.words import file_stem
from spectrabox.reconstruct.rendering.renderer import load_scene
from spectrabox.reconstruct.scene import import_scene, scene_file
from spectrabox.reconstruct.shape import mesh as meshes

SAME_SPECTRUM = 4       # decimals to which spectra of one paint agree
MAX_FACES = 1_000_000


def paints_of_picture(pixels: np.ndarray, most: int,
                      seed: int = 0) -> tuple[np.ndarray, np.ndarray, float]:
    """A picture of spectra as a map of a few paints.

    Parameters
    ----------
    pixels : (h, w, P) array
        Reflectances.
    most : int
        Paints; fewer where the picture has fewer spectra.
    seed : int
        Of the start of their means (k-means).

    Returns
    -------
    paint : (h, w) int
        0 to Q - 1.
    spectra : (Q, P) array
        Mean of each paint's pixels, so that no light is lost.
    error : float
        Root mean square of what the paints leave out.
    """
    flat = pixels.reshape(-1, pixels.shape[2]).astype(float)
    distinct, paint = np.unique(flat.round(SAME_SPECTRUM), axis=0, return_inverse=True)
    if len(distinct) > most:
        paint = kmeans2(flat, most, minit="++", rng=seed)[1]
    used, paint = np.unique(paint, return_inverse=True)
    spectra = np.array([flat[paint.ravel() == number].mean(axis=0) for number in range(used.size)])
    paint = paint.reshape(pixels.shape[:2])
    return paint, spectra, float(np.sqrt(np.mean((spectra[paint] - pixels) ** 2)))


def split_shape(scene: Path, shape_id: str, paint: np.ndarray, target: Path) -> list[str]:
    """Write a scene in which a shape is a mesh for each paint, and the meshes beside it.

    Parameters
    ----------
    scene : Path
        Mitsuba XML.
    shape_id : str
        Of a rectangle, or of a mesh with texture coordinates.
    paint : (h, w) int
        Of each texel, its first row at the top (v = 1).
    target : Path
        Of the new scene, in the folder of the other.

    Returns
    -------
    Q of str
        Ids of the paints' BSDFs; "" of a paint that no part of the shape has.

    Raises
    ------
    InputError
        If the scene has no such shape, or the shape no texture coordinates.
    """
    if not scene.is_file():
        raise InputError(f"{scene} is missing: give the scene file")
    root = scene_file.parse_scene(read_text(scene), scene, comments=True)
    shape = next((node for node in root.findall("shape") if node.get("id") == shape_id), None)
    if shape is None:
        ids = ", ".join(repr(node.get("id", "")) for node in root.findall("shape"))
        raise InputError(f"{scene.name} has no shape {shape_id!r} directly in <scene>; it has "
                         f"{ids or 'none'}: give the surface that has the texture an id")
    kept = [node for node in shape if node.tag in ("transform", "boolean")]
    if shape.get("type") == "rectangle":
        vertices, faces, uv = _rectangle(*paint.shape)
    else:
        vertices, faces, uv = _mesh_with_texels(shape, scene, paint.shape)
        kept = []       # its vertices are in place
    middle = np.clip(uv[faces].mean(axis=1), 0, 1 - 1e-9)
    height, width = paint.shape
    own = paint[height - 1 - (middle[:, 1] * height).astype(int),
                (middle[:, 0] * width).astype(int)]
    normals, two_sided = meshes.smooth_normals(vertices, faces), _is_two_sided(root, shape)
    at = list(root).index(shape)
    root.remove(shape)
    names = []
    for number in range(paint.max() + 1):
        corners, part = np.unique(faces[own == number], return_inverse=True)
        names.append(f"{shape_id} {number + 1}" if corners.size else "")
        if corners.size:
            file = target.with_name(f"{target.stem}-{file_stem(names[-1])}.ply")
            meshes.write_mesh(file, vertices[corners], part.reshape(-1, 3), normals[corners])
            root[at:at] = [_bsdf(names[-1], two_sided), _part(names[-1], file.name, kept)]
    ET.indent(root)
    write_text_whole(target, ET.tostring(root, encoding="unicode") + "\n")
    return names


def _rectangle(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (V, 3), faces (F, 3) and texture coordinates (V, 2) of Mitsuba's rectangle, cut into
    texels.
    """
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    uv = np.column_stack([u.ravel(), v.ravel()])
    row, column = (each.ravel() for each in np.mgrid[:rows, :columns])
    first = row * (columns + 1) + column
    after, above = first + 1, first + columns + 1
    faces = np.concatenate([np.stack([first, after, above + 1], axis=1),
                            np.stack([first, above + 1, above], axis=1)])
    return np.column_stack([2 * uv - 1, np.zeros(len(uv))]), faces, uv


def _mesh_with_texels(shape: ET.Element, scene: Path, texels: tuple[int, ...]
                      ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same of a mesh in place, its triangles cut until none is larger than a texel."""
    single = ET.Element("scene", version=import_scene.CURRENT)
    single.append(copy.deepcopy(shape))
    for node in [node for node in single[0] if node.tag in ("bsdf", "ref")]:
        single[0].remove(node)
    for node in single.iter("string"):
        if node.get("name") == "filename":
            node.set("value", str((scene.parent / node.get("value", "")).resolve()))
    mesh = load_scene(ET.tostring(single, encoding="unicode")).shapes()[0]
    if not mesh.is_mesh() or not mesh.has_vertex_texcoords():
        raise InputError(f"{scene.name}: the shape {shape.get('id')!r} of type "
                         f"{shape.get('type')!r} has no texture coordinates that a mesh can be cut "
                         "along; make it a rectangle, or a mesh that is exported with them")
    vertices = np.column_stack([
        np.array(mesh.vertex_positions_buffer(), dtype=float).reshape(-1, 3),
        np.array(mesh.vertex_texcoords_buffer(), dtype=float).reshape(-1, 2)])
    faces = np.array(mesh.faces_buffer(), dtype=int).reshape(-1, 3)

    def largest() -> float:
        """Of all edges, in texels."""
        corners = vertices[faces][:, :, 3:] * texels[::-1]
        return float(np.abs(corners - np.roll(corners, 1, axis=1)).max())
    while largest() > 1 and 4 * len(faces) <= MAX_FACES:
        vertices, faces = meshes.subdivided(vertices, faces)
    return vertices[:, :3], faces, vertices[:, 3:]


def _is_two_sided(root: ET.Element, shape: ET.Element) -> bool:
    named = {node.get("id") for node in shape.findall("ref")}
    return any(bsdf.get("type") == "twosided" for bsdf in (
        *shape.findall("bsdf"), *(node for node in root.findall("bsdf")
                                  if node.get("id") in named)))


def _bsdf(name: str, two_sided: bool) -> ET.Element:
    bsdf = outer = ET.Element("bsdf", type="twosided" if two_sided else "diffuse", id=name)
    if two_sided:
        bsdf = ET.SubElement(outer, "bsdf", type="diffuse")
    ET.SubElement(bsdf, "spectrum", name="reflectance", value="0.5")
    return outer


def _part(name: str, file: str, kept: list[ET.Element]) -> ET.Element:
    shape = ET.Element("shape", type="ply", id=f"surface of {name}")
    ET.SubElement(shape, "string", name="filename", value=file)
    ET.SubElement(shape, "ref", id=name)
    shape.extend(copy.deepcopy(node) for node in kept)
    return shape
