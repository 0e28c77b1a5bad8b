"""Shapes of our own making recovered with ``sb.fit_shape``: a ball, a relief, and an object with
bumps, a dent and a bend. Photos are Mitsuba's own renderings through a measured camera, with a
lamp beside it that moves along; the start is the sphere of the silhouettes.

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
from spectrabox.reconstruct.shape.mesh import icosphere
from spectrabox.reconstruct.shape.shape_fit import with_mesh
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


def photos_of(mesh: Mesh, truth: np.ndarray, folder: Path, views: int = VIEWS, width: int = WIDTH,
              spp: int = PHOTO_SPP) -> tuple[list[np.ndarray], list[Path], np.ndarray]:
    """Photos (H, W, 3) around a mesh, their scenes, and what a white card in its middle reads in
    the first.

    Parameters
    ----------
    mesh : (vertices, faces)
    truth : (P,) array
        Its reflectance on ``GRID``.
    folder : Path
        For the scenes.
    views, width, spp : int
        Photos, their pixels, and paths a pixel.
    """
    camera, photos, scenes = measured_camera(), [], []
    write_ply(folder / "true.ply", *mesh)
    for number, place in enumerate(cameras(views)):
        path = folder / f"view_{number}.xml"
        path.write_text(view_xml(place, width), encoding="utf-8")
        scene = scene_of(view_xml(place, width))
        blank = photograph(scene, {"paint": truth}, camera, 1)
        view = PhotoView("", scene, blank, camera, BANDS, (MaterialSpec("paint", "paint"),))
        photo = photograph(with_mesh(view, "object", folder / "true.ply").scene_file,
                           {"paint": truth}, camera, spp, number)
        photos.append(np.array(photo.signal))
        scenes.append(path)
    middle = (mesh[0].min(axis=0) + mesh[0].max(axis=0)) / 2
    white = white_signal(response_matrix(GRID, camera.sensitivity.curves, np.ones(GRID.nm.size)))
    return photos, scenes, white * light_on_card(scene_of(view_xml(cameras(views)[0], width)),
                                                 middle) / np.pi


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


def measured(name: str) -> dict[str, object]:
    """One row of the table."""
    truth = chart_reflectances("BabelColor Average", GRID)[PATCH_NAMES.index(PAINT)]
    mesh = SHAPES[name]()
    with tempfile.TemporaryDirectory() as folder:
        photos, scenes, white = photos_of(mesh, truth, Path(folder))
        start = time.process_time()
        found = sb.fit_shape(photos, scenes, camera=CAMERA, light=(GRID.nm, np.ones(GRID.nm.size)),
                             white=white, progress=False, width=WIDTH)
        seconds = time.process_time() - start
    size = np.ptp(mesh[0], axis=0).max() / 200
    estimate = found["object"]
    lower, upper = (np.interp(GRID.nm, estimate.nm, edge) for edge in estimate.band())
    assert estimate.measurement is not None
    signal = response_matrix(GRID, measured_camera().sensitivity.curves, np.ones(GRID.nm.size))
    true_signal = signal @ truth / white_signal(signal)
    there, back = (distances(found.vertices, mesh),
                   distances(mesh[0], (found.vertices, found.faces)))
    return {"shape": name, "found_to_true_percent": float(np.sqrt(np.mean(there**2)) / size),
            "true_to_found_percent": float(np.sqrt(np.mean(back**2)) / size),
            "rmse": spectrum_rmse(np.interp(GRID.nm, estimate.nm, estimate.mean), truth),
            "held": float(np.mean((truth >= lower) & (truth <= upper))),
            "signal_off_percent": float(100 * np.mean(
                estimate.measurement.signal / true_signal - 1)),
            "scatter_percent": float(100 * found.disagreement.std(axis=0, ddof=1).mean()),
            "converged": found.converged, "processor_s": seconds}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=SHAPES, help="one shape")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    start_mitsuba("cpu")
    rows = [measured(name) for name in ([arguments.only] if arguments.only else SHAPES)]
    if arguments.json:
        print(json.dumps(rows))
        return
    print("| shape | found to true, % | true to found, % | RMSE of the spectrum | held | "
          "signal off, % | scatter of the photos, % | processor, s |\n|--|--|--|--|--|--|--|--|")
    for row in rows:
        print(f"| {row['shape']} | {row['found_to_true_percent']:.2f} | "
              f"{row['true_to_found_percent']:.2f} | {row['rmse']:.4f} | {row['held']:.3f} | "
              f"{row['signal_off_percent']:+.2f} | {row['scatter_percent']:.2f} | "
              f"{row['processor_s']:.0f} |")


if __name__ == "__main__":
    main()
