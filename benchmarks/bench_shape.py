"""Shapes of our own making recovered with ``sb.fit_shape``: a ball, a relief, and an object with
bumps, a dent and a bend, of one paint or several. Photos are Mitsuba's own renderings through a
measured camera, with a lamp beside it that moves along; the start is the sphere of the silhouettes.

    python -m benchmarks.bench_shape [--only ball] [--json]

Distances are those of the found mesh's vertices to the true surface and back, root mean square, in
percent of the true mesh's largest half side.
"""
from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import spectrabox as sb
from spectrabox.fixtures.object_views import cameras, object_mesh, view_xml, write_ply
from spectrabox.radiometry.chart import PATCH_NAMES, chart_reflectances
from spectrabox.radiometry.interreflection import response_matrix, white_signal
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.shape import paints
from spectrabox.reconstruct.shape.mesh import icosphere
from spectrabox.reconstruct.shape.start import light_on_card
from spectrabox.reconstruct.view import MaterialSpec, PhotoView

from benchmarks.paper.synthetic_photo import (
    BANDS,
    GRID,
    measured_camera,
    photograph,
    scene_of,
    spectrum_rmse,
)

CAMERA, PAINT, PHOTO_SPP = "Nikon 5100 (NPL)", "orange", 256
WIDTH, VIEWS = 40, 12
PAINTS, FINER = ["orange", "blue", "yellow"], 4
HALVES, STRIPES = "ball of two paints", "bumps, a dent and a bend, three paints"
PAINTED = {HALVES: "ball", STRIPES: "bumps, a dent and a bend"}
Mesh = tuple[np.ndarray, np.ndarray]


def ball() -> Mesh:
    """Of radius 0.7, a little beside the origin."""
    vertices, faces = icosphere(5)
    return np.array([0.1, -0.05, 0.08]) + 0.7 * vertices, faces


def relief() -> Mesh:
    """A slab with rounded edges, 1.6 wide and 0.7 thick, with eight waves on its front."""
    direction, faces = icosphere(5)
    sides = np.array([0.8, 0.8, 0.35])
    position = direction / np.sum(np.abs(direction / sides) ** 6, axis=1, keepdims=True) ** (1 / 6)
    x, y, z = position.T
    inside = np.clip(1 - np.maximum(np.abs(x), np.abs(y)) / 0.75, 0, 1)
    position[:, 2] += np.where(z > 0, 0.08 * inside * np.cos(12 * x) * np.cos(6 * y), 0.0)
    return position, faces


SHAPES: dict[str, Callable[[], Mesh]] = {
    "ball": ball, "relief": relief, "bumps, a dent and a bend": object_mesh}


def painted(name: str) -> tuple[Mesh, np.ndarray, list[str]]:
    """Mesh, paint (F,) of each face, and the paints."""
    mesh = SHAPES[PAINTED.get(name, name)]()
    middle = mesh[0][mesh[1]].mean(axis=1)
    paint = np.zeros(len(middle), dtype=int)
    if name == HALVES:
        paint[middle[:, 0] > 0.2] = 1
    if name == STRIPES:
        height = middle[:, 1] + 0.4 * middle[:, 0]
        paint[np.abs(height) < 0.22], paint[height >= 0.22] = 1, 2
    return mesh, paint, PAINTS[:paint.max() + 1]


def photos_of(mesh: Mesh, truth: np.ndarray, folder: Path, views: int = VIEWS, width: int = WIDTH,
              spp: int = PHOTO_SPP, paint: np.ndarray | None = None
              ) -> tuple[list[np.ndarray], list[Path], np.ndarray, list[np.ndarray]]:
    """Photos (H, W, 3) around a mesh, their scenes, what a white card in its middle reads in the
    first, and where the photos show its paints.

    Parameters
    ----------
    mesh : (vertices, faces)
    truth : (P,) or (M, P) array
        Its reflectance on ``GRID``, or those of its paints.
    folder : Path
        For the scenes.
    views, width, spp : int
        Photos, their pixels, and paths a pixel.
    paint : (F,) int array, optional
        Of each face.

    Returns
    -------
    photos, scenes : V each
    white : (3,) array
    labels : V of (H, W) int
        0 the ground, 1 the first paint.
    """
    camera, photos, scenes, labels = measured_camera(), [], [], []
    truths = np.atleast_2d(truth)
    names = [f"paint {number + 1}" for number in range(len(truths))]
    vertices, faces = mesh
    for number, name in enumerate(names):
        own = faces if paint is None else faces[paint == number]
        corners, own = np.unique(own, return_inverse=True)
        write_ply(folder / f"{name}.ply", vertices[corners], own.reshape(-1, 3))
    for number, place in enumerate(cameras(views)):
        path = folder / f"view_{number}.xml"
        path.write_text(view_xml(place, width), encoding="utf-8")
        scene = scene_of(view_xml(place, width))
        blank = photograph(scene, {"paint": truths[0]}, camera, 1)
        view = paints.mesh_of_each_paint(
            PhotoView("", scene, blank, camera, BANDS, (MaterialSpec("paint", "paint"),)), "object",
            [folder / f"{name}.ply" for name in names], names)
        photo = photograph(view.scene_file, {
            material.bsdf: own for material, own in zip(view.materials, truths, strict=True)
        } | {"paint": truths[0]}, camera, spp, number)
        photos.append(np.array(photo.signal))
        scenes.append(path)
        labels.append(labels_of(view))
    middle = (mesh[0].min(axis=0) + mesh[0].max(axis=0)) / 2
    white = white_signal(response_matrix(GRID, camera.sensitivity.curves, np.ones(GRID.nm.size)))
    return photos, scenes, white * light_on_card(scene_of(view_xml(cameras(views)[0], width)),
                                                 middle) / np.pi, labels


def labels_of(view: PhotoView) -> np.ndarray:
    """Number (H, W) of the shape in the middle of each pixel, from 1; 0 where there is none."""
    import mitsuba as mi

    scene, (width, height) = view.scene(), view.size
    column, row = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, mi.Point2f(column.ravel(), row.ravel()),
                                           mi.Point2f(0.5))
    hit = scene.ray_intersect_preliminary(mi.Ray3f(ray))
    shown = np.zeros(column.size, dtype=int)
    for number, name in enumerate(view.scene_file.surfaces, start=1):
        shape = next(shape for shape in scene.shapes() if shape.id() == name)
        shown[np.array(hit.is_valid() & (hit.shape == mi.ShapePtr(shape)))] = number
    return shown.reshape(height, width)


def distances(vertices: np.ndarray, other: Mesh) -> np.ndarray:
    """Of points (V, 3) from a mesh: from the tangent planes of its nearest vertices."""
    places, faces = other
    a, b, c = (places[faces[:, corner]] for corner in range(3))
    normals = np.zeros_like(places)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], np.cross(b - a, c - a))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    nearest = cKDTree(places).query(vertices)[1]
    return np.abs(np.sum((vertices - places[nearest]) * normals[nearest], axis=1))


def measured(name: str) -> list[dict[str, object]]:
    """Rows of the table: one for each paint."""
    mesh, paint, names = painted(name)
    chart = chart_reflectances("BabelColor Average", GRID)
    truths = chart[[PATCH_NAMES.index(each) for each in names]]
    several = {}
    with tempfile.TemporaryDirectory() as folder:
        if name in PAINTED:     # photos larger than what is compared, as an operator's labels are
            *shown, labels = photos_of(mesh, truths, Path(folder), width=FINER * WIDTH,
                                       spp=PHOTO_SPP // FINER**2, paint=paint)
            several = {"masks": labels, "materials": names}
        else:
            *shown, _ = photos_of(mesh, truths, Path(folder))
        photos, scenes, white = shown
        start = time.process_time()
        found = sb.fit_shape(photos, scenes, camera=CAMERA, light=(GRID.nm, np.ones(GRID.nm.size)),
                             white=white, progress=False, width=WIDTH, **several)
        seconds = time.process_time() - start
    size = np.ptp(mesh[0], axis=0).max() / 200
    there, back = (distances(found.vertices, mesh),
                   distances(mesh[0], (found.vertices, found.faces)))
    response = response_matrix(GRID, measured_camera().sensitivity.curves, np.ones(GRID.nm.size))
    rows: list[dict[str, object]] = []
    for (material, estimate), truth in zip(found.items(), truths, strict=True):
        lower, upper = (np.interp(GRID.nm, estimate.nm, edge) for edge in estimate.band())
        assert estimate.measurement is not None
        off = estimate.measurement.signal / (response @ truth / white_signal(response)) - 1
        apart = found.disagreement[material]
        rows.append({
            "shape": name, "material": PAINT if material == "object" else material,
            "found_to_true_percent": float(np.sqrt(np.mean(there**2)) / size),
            "true_to_found_percent": float(np.sqrt(np.mean(back**2)) / size),
            "rmse": spectrum_rmse(np.interp(GRID.nm, estimate.nm, estimate.mean), truth),
            "held": float(np.mean((truth >= lower) & (truth <= upper))),
            "signal_off_percent": (100 * off).tolist(),
            "scatter_percent": float(100 * apart.std(axis=0, ddof=1).mean()),
            "photos": len(apart), "converged": found.converged, "processor_s": seconds})
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=[*SHAPES, *PAINTED], help="one shape")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    start_mitsuba("cpu")
    shapes = [arguments.only] if arguments.only else [*SHAPES, *PAINTED]
    rows = [row for name in shapes for row in measured(name)]
    if arguments.json:
        print(json.dumps(rows))
        return
    print("| shape | material | found to true, % | true to found, % | RMSE of the spectrum | "
          "held | signal off by band, % | photos | their scatter, % | processor, s |\n"
          "|--|--|--|--|--|--|--|--|--|--|")
    for row in rows:
        off = " ".join(f"{each:+.2f}" for each in row["signal_off_percent"])
        print(f"| {row['shape']} | {row['material']} | {row['found_to_true_percent']:.2f} | "
              f"{row['true_to_found_percent']:.2f} | {row['rmse']:.4f} | {row['held']:.3f} | "
              f"{off} | {row['photos']} | {row['scatter_percent']:.2f} | "
              f"{row['processor_s']:.0f} |")


if __name__ == "__main__":
    main()
