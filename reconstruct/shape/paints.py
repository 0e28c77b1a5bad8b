"""Which paint each face of a mesh has, by label images of the photos, and meshes of several paints.

While a mesh moves it stays one mesh, whose normals are smooth across the borders of paints too: its
BSDF blends the paints by weights of its vertices. On the found mesh each paint becomes a shape of
its own, whose light the transport engine traces.
"""
from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.words import file_stem
from spectrabox.reconstruct.scene.scene_xml import materials_xml
from spectrabox.reconstruct.shape import mesh as meshes
from spectrabox.reconstruct.view import MIN_PIXELS, MaterialSpec, PhotoView

RAYS_ACROSS = 256       # of a photo: by which it says what paint the faces have that it shows
PURE = 0.99             # share of a pixel that has one paint
LEAST_SHARE = 0.25      # of a paint's pixels in the photo that shows most: fewer tell nothing
LEAST_PHOTOS = 2        # that tell of a paint: their scatter is the error of the shape


@dataclass(frozen=True, eq=False)
class PaintLabels:
    """Paints of an object by name, and where each of V photos shows them."""

    names: tuple[str, ...]              # M
    # V of (h, w, M): share of each pixel of the compared picture; 1 of a single paint
    shares: tuple[np.ndarray, ...]
    # V of (H, W) int at the photo's own size: 0 the ground, 1 the first paint; none of a single one
    labels: tuple[np.ndarray, ...] = ()


def label_image(mask: np.ndarray, names: Sequence[str], name: str) -> np.ndarray:
    """A photo's mask as labels (H, W) of int.

    Parameters
    ----------
    mask : (H, W) array
        0 the ground, 1 the first of ``names``.
    names : sequence of str
        Of the paints.
    name : str
        Of the photo, for errors.

    Raises
    ------
    InputError
        If it has other values.
    """
    found = np.unique(mask)
    if not np.all(np.isin(found, np.arange(len(names) + 1))):
        meant = ", ".join(f"{number} for {paint!r}" for number, paint in enumerate(names, 1))
        raise InputError(f"the mask of {name} has the values "
                         f"{', '.join(f'{value:g}' for value in found[:8])}"
                         f"{' ...' if found.size > 8 else ''}; with materials= it is a label image:"
                         f" 0 for the ground, {meant}. Relabel it, or name all materials")
    return np.asarray(mask, dtype=np.int64)


def telling_photos(pixels: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Which photos tell of which paint: (V, M) bool.

    A photo that shows a sliver of a paint, at the object's rim, tells more of the shape's faults
    than of the paint.

    Parameters
    ----------
    pixels : (V, M) array
        Pixels of the compared picture that one paint fills.
    names : M of str

    Raises
    ------
    InputError
        If fewer than two photos tell of a paint, or a photo of none.
    """
    telling = pixels >= np.maximum(MIN_PIXELS, LEAST_SHARE * pixels.max(axis=0))
    for paint, photos in enumerate(telling.sum(axis=0)):
        if photos < LEAST_PHOTOS:
            raise InputError(
                f"material {names[paint]!r} (label {paint + 1}) fills {MIN_PIXELS} pixels or "
                f"more of the compared picture in {photos} of {len(pixels)} photos, at most "
                f"{pixels[:, paint].max():.0f} pixels; {LEAST_PHOTOS} photos are needed: give a "
                "larger width= or photos that show more of it, or label it as another material")
    if nothing := [number for number, own in enumerate(telling, start=1) if not own.any()]:
        raise InputError(f"photo {nothing[0]} shows no material in {MIN_PIXELS} pixels or more of "
                         f"the compared picture that one of them fills, at most "
                         f"{pixels[nothing[0] - 1].max():.0f}: give a larger width=, or leave the "
                         "photo out")
    return telling


# ---- paints of faces -----------------------------------------------------------------------------

def votes(scene: Any, shape_id: str, faces: int, labels: np.ndarray, paints: int) -> np.ndarray:
    """How many rays of a photo find each paint on each face: (F, M).

    Parameters
    ----------
    scene : mi.Scene
        Of the photo, with the mesh in place.
    shape_id : str
        Of the mesh.
    faces : int
        F.
    labels : (H, W) int
        Of the photo.
    paints : int
        M.
    """
    import mitsuba as mi

    height, width = labels.shape
    rays = RAYS_ACROSS, max(round(RAYS_ACROSS * height / width), 1)
    across, down = np.meshgrid(*((np.arange(count) + 0.5) / count for count in rays))
    label = labels[(down * height).astype(int), (across * width).astype(int)].ravel()
    ray, _ = scene.sensors()[0].sample_ray(
        0.0, 0.5, mi.Point2f(across.ravel().astype(np.float32), down.ravel().astype(np.float32)),
        mi.Point2f(0.5))
    hit = scene.ray_intersect_preliminary(mi.Ray3f(ray))
    shape = next(shape for shape in scene.shapes() if shape.id() == shape_id)
    seen = np.array(hit.is_valid() & (hit.shape == mi.ShapePtr(shape))) & (label > 0)
    return np.bincount(np.array(hit.prim_index)[seen].astype(int) * paints + label[seen] - 1,
                       minlength=faces * paints).reshape(faces, paints)


def paint_of_faces(counts: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Paint (F,) of each face by most votes (F, M); of faces that none shows, that of the nearest.
    """
    nearest = _nearest(vertices[faces].mean(axis=1), counts.sum(axis=1) > 0)
    return np.asarray(counts.argmax(axis=1)[nearest])


def vertex_weights(counts: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Weights (M - 1, V) at the vertices by which a BSDF of ``painted_mesh`` blends: of each paint
    after the first, against those before it. By the votes (F, M) of the faces around.
    """
    around = np.zeros((len(vertices), counts.shape[1]))
    for corner in range(3):
        np.add.at(around, faces[:, corner], counts)
    around = around[_nearest(vertices, around.sum(axis=1) > 0)]
    return np.asarray((around[:, 1:] / np.maximum(np.cumsum(around, axis=1)[:, 1:], 1e-9)).T)


def _nearest(places: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """Index of the nearest of the places (n, 3) that are shown (n,), of each."""
    if not shown.any():
        raise InputError("no photo shows the mesh where its label image shows the object: check "
                         "that labels, poses and start= belong together")
    return np.asarray(np.flatnonzero(shown)[cKDTree(places[shown]).query(places)[1]])


# ---- meshes of several paints --------------------------------------------------------------------

def painted_mesh(view: PhotoView, shape_id: str, names: Sequence[str]) -> PhotoView:
    """The view with one mesh of several paints, blended by the attributes ``weight_key`` of its
    vertices.

    Parameters
    ----------
    view : PhotoView
        Its scene has the mesh as the shape ``shape_id``.
    shape_id : str
    names : M of str
        Of the paints; with one the view stays as it is.
    """
    if len(names) == 1:
        return view
    root = copy.deepcopy(view.scene_file.root)
    blend = _bsdf_id(0)
    for paint in range(1, len(names)):
        bsdf = ET.SubElement(root, "bsdf", type="blendbsdf", id=f"paints up to {paint + 1}")
        weight = ET.SubElement(bsdf, "texture", name="weight", type="mesh_attribute")
        ET.SubElement(weight, "string", name="name", value=weight_name(paint))
        ET.SubElement(bsdf, "ref", id=blend)
        ET.SubElement(bsdf, "ref", id=_bsdf_id(paint))
        blend = bsdf.get("id", "")
    shape = next(node for node in root.iter("shape") if node.get("id") == shape_id)
    for node in shape.findall("ref"):
        node.set("id", blend)
    return _of_paints(view, root, {f"{shape_id} {name}": _bsdf_id(paint) for paint, name
                                   in enumerate(names)}, names)


def weight_name(paint: int) -> str:
    """Name of the vertices' attribute that holds the weight of a paint after the first."""
    return f"vertex_paint_{paint}"


def mesh_of_each_paint(view: PhotoView, shape_id: str, files: Sequence[Path | None],
                       names: Sequence[str]) -> PhotoView:
    """The view with a shape for each paint in place of one shape.

    Parameters
    ----------
    view : PhotoView
    shape_id : str
        Of the shape that is replaced.
    files : M of Path or None
        PLY files, in the scene's coordinates; None of a paint that no face has.
    names : M of str
        Of the paints.
    """
    root = copy.deepcopy(view.scene_file.root)
    root.remove(next(node for node in root.findall("shape") if node.get("id") == shape_id))
    surfaces = {}
    for paint, file in enumerate(files):
        if file is not None:
            surfaces[f"{shape_id} {names[paint]}"] = _bsdf_id(paint)
            root.append(_shape(f"{shape_id} {names[paint]}", str(file.resolve()), _bsdf_id(paint)))
    return _of_paints(view, root, surfaces, names)


def write_mesh_of_each_paint(stem: Path, vertices: np.ndarray, faces: np.ndarray,
                             paint_of_face: np.ndarray,
                             names: Sequence[str]) -> list[Path | None]:
    """Write a PLY file for each paint, with the normals of the whole; None of one without faces.

    Parameters
    ----------
    stem : Path
        Folder and beginning of the files' names.
    vertices : (V, 3) array
    faces : (F, 3) int
    paint_of_face : (F,) int
    names : M of str
        Ends of the files' names.

    Raises
    ------
    EnvironmentProblem
        If the folder cannot be written.
    """
    normals, files = meshes.smooth_normals(vertices, faces), []
    for paint, name in enumerate(names):
        corners, own = np.unique(faces[paint_of_face == paint], return_inverse=True)
        file = stem.with_name(f"{stem.name}-{file_stem(name)}.ply")
        if corners.size:
            meshes.write_mesh(file, vertices[corners], own.reshape(-1, 3), normals[corners])
        files.append(file if corners.size else None)
    return files


def object_xml(files: Sequence[Path | None], names: Sequence[str], reflectances: np.ndarray,
               range_nm: tuple[float, float], folder: Path) -> str:
    """Shapes and their BSDFs as XML text of a scene to ``<include>``, which a stock Mitsuba loads.

    Parameters
    ----------
    files : M of Path or None
        As ``write_mesh_of_each_paint`` gives them.
    names : M of str
        Of the paints, by which BSDFs and shapes are named.
    reflectances : (M, P) array
        Evenly spaced over ``range_nm``.
    range_nm : (float, float)
    folder : Path
        Where the text will lie: files are named as they are seen from there.
    """
    root = ET.fromstring(materials_xml(dict(zip(names, reflectances, strict=True)), range_nm))
    bsdfs = [bsdf.get("id", "") for bsdf in root.findall("bsdf")]
    root.extend(_shape(f"shape of {bsdf}", file.relative_to(folder).as_posix(), bsdf)
                for bsdf, file in zip(bsdfs, files, strict=True) if file is not None)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _shape(identity: str, file: str, bsdf: str) -> ET.Element:
    shape = ET.Element("shape", type="ply", id=identity)
    ET.SubElement(shape, "string", name="filename", value=file)
    ET.SubElement(shape, "ref", id=bsdf)
    return shape


def _of_paints(view: PhotoView, root: ET.Element, surfaces: dict[str, str],
               names: Sequence[str]) -> PhotoView:
    """The view with a scene that has a diffuse BSDF for each paint."""
    bsdfs = [ET.Element("bsdf", type="diffuse", id=_bsdf_id(paint)) for paint in range(len(names))]
    for bsdf in bsdfs:
        ET.SubElement(bsdf, "spectrum", name="reflectance", value="0.5")
    root[:0] = bsdfs
    scene = replace(view.scene_file, root=root, surfaces=surfaces,
                    bsdf_ids=tuple(node.get("id", "") for node in root.findall("bsdf")))
    return replace(view, scene_file=scene, materials=tuple(
        MaterialSpec(name, _bsdf_id(paint)) for paint, name in enumerate(names)))


def _bsdf_id(paint: int) -> str:
    return f"paint {paint + 1} of the object"
