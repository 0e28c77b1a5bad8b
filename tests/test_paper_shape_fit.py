"""The shape fit: meshes, the gradient at the outline, and a small whole fit."""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spectrabox.fixtures.object_views import cameras, object_mesh, view_xml, write_ply
from spectrabox.reconstruct.rendering.renderer import load_scene, render
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.view import MaterialSpec, View

from benchmarks.paper.mesh import (
    add_outline_gradient,
    icosphere,
    silhouette,
    subdivided,
    write_mesh,
)
from benchmarks.paper.shape_fit import (
    ShapeSettings,
    Stage,
    reconstruct_shape,
    with_mesh,
)
from tests.cornell_problem import BANDS, GRID, SCALE_ONE, camera, photo_of
from tests.session_runs import silent

pytestmark = pytest.mark.usefixtures("mitsuba")

WIDTH = 24
PAINT = 0.1 + 0.6 / (1 + np.exp((570 - GRID.nm) / 12))
MATERIALS = (MaterialSpec("paint", "paint"),)


def volume(vertices, faces):
    """By the divergence theorem: negative where faces are turned inside out."""
    a, b, c = vertices[faces].swapaxes(0, 1)
    return np.einsum("fi,fi->", a, np.cross(b, c)) / 6


def blank_views(folder, count, height=WIDTH):
    views = []
    for number, position in enumerate(cameras(count)):
        path = folder / f"view_{number}.xml"
        text = view_xml(position, WIDTH).replace(f'"height" value="{WIDTH}"',
                                                 f'"height" value="{height}"')
        path.write_text(text, encoding="utf-8")
        views.append(View(f"view {number}", read_scene(path), photo_of(np.ones((height, WIDTH, 3))),
                          camera(), BANDS, MATERIALS, SCALE_ONE))
    return views


@pytest.mark.parametrize("level", [0, 1, 3])
def test_the_sphere_is_closed_and_turned_outwards(level):
    vertices, faces = icosphere(level)
    assert len(vertices) == 10 * 4**level + 2 and len(faces) == 20 * 4**level
    edges, times = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1),
                             axis=0, return_counts=True)
    assert np.all(times == 2) and len(vertices) - len(edges) + len(faces) == 2  # Euler
    # An inscribed body: smaller than the ball, by less than 40 % from the icosahedron on.
    assert 0.6 < volume(vertices, faces) / (4 / 3 * np.pi) < 1
    finer = subdivided(vertices, faces)
    # The same surface: only round-off.
    assert volume(*finer) == pytest.approx(volume(vertices, faces), rel=1e-12)
    assert volume(*object_mesh()) > 0


@pytest.mark.parametrize("motion, height", [("larger", 3 * WIDTH // 2), ("upwards", WIDTH)])
def test_the_gradient_by_a_motion_agrees_with_finite_differences(tmp_path, motion, height):
    import drjit as dr
    import mitsuba as mi

    vertices, faces = icosphere(3)
    write_mesh(tmp_path / "ball.ply", vertices, faces)
    scene = with_mesh(blank_views(tmp_path, 3, height)[1], "object", tmp_path / "ball.ply").scene()
    parameters = mi.traverse(scene)
    key = "object.vertex_positions"
    start = np.array(parameters[key], dtype=float).reshape(-1, 3)
    toward = start if motion == "larger" else np.tile([0.0, 1.0, 0.0], (len(start), 1))
    weight = np.random.default_rng(0).uniform(size=(height, WIDTH, 3))
    if height != WIDTH:         # the weight of a row tells where it is
        weight *= np.linspace(0, 2, height)[:, None, None]

    def put(place):
        parameters[key] = place
        parameters.update()

    def value(step, seed):
        put(mi.Float((start + step * toward).astype(np.float32).ravel()))
        return np.sum(weight * render(scene, 256, seed)[0])

    differences = [(value(0.01, seed) - value(-0.01, seed)) / 0.02 for seed in range(4)]
    inside, outline = [], []
    for seed in range(4):
        for parts in (inside, outline):
            step = mi.Float(0.0)
            dr.enable_grad(step)
            put(mi.Float(start.astype(np.float32).ravel())
                + step * mi.Float(toward.astype(np.float32).ravel()))
            if parts is inside:
                image = mi.render(scene, parameters, spp=64, seed=seed, seed_grad=seed + 50)
                dr.backward(dr.sum(image * mi.TensorXf(weight.astype(np.float32)), axis=None))
            else:
                add_outline_gradient(scene, weight, 16, seed)
            parts.append(float(dr.grad(step)[0]))
    found = np.mean(inside) + np.mean(outline)
    error = np.sqrt(np.var(differences, ddof=1) + np.var(inside, ddof=1)
                    + np.var(outline, ddof=1)) / 2
    # Four standard errors of means of four; and 3 % of the outline's part, where interpolated
    # normals make a facet's edge brighter or darker than the sampled radiance there.
    assert found == pytest.approx(np.mean(differences),
                                  abs=4 * error + 0.03 * abs(np.mean(outline)))
    # Without the outline it would be wrong by far more.
    assert abs(np.mean(inside) - np.mean(differences)) > 5 * abs(found - np.mean(differences))


def test_a_bumpy_object_is_found_from_a_sphere(tmp_path):
    write_ply(tmp_path / "true.ply", *object_mesh(32))
    views = []
    for number, view in enumerate(blank_views(tmp_path, 6)):
        true = with_mesh(view, "object", tmp_path / "true.ply")
        picture = render(load_scene(true.xml({"paint": PAINT}, integrator="path")), 128,
                         500 + number)[0]
        views.append(replace(view, photo=photo_of(picture)))
    settings = ShapeSettings(5, (Stage(2, 30, 0.05, 9.0, 8, views=2),))
    found = reconstruct_shape(views, "object", settings, silent)
    write_mesh(tmp_path / "found.ply", found.vertices, found.faces)

    def overlap(shown):
        pairs = [(silhouette(shown(view), "object"),
                  silhouette(with_mesh(view, "object", tmp_path / "true.ply"), "object"))
                 for view in views]
        return np.mean([np.minimum(a, b).sum() / np.maximum(a, b).sum() for a, b in pairs])

    # 30 steps on 162 vertices at 24 pixels: the full fit (benchmarks/paper/figure_6.py) reaches
    # 0.98.
    assert overlap(lambda view: view) < 0.65
    assert overlap(lambda view: with_mesh(view, "object", tmp_path / "found.ply")) > 0.75
    assert volume(found.vertices, found.faces) > 0
    assert found.loss_history[-5:].mean() < 0.4 * found.loss_history[:2].mean()
    assert np.all((found.coefficients >= 0)
                  & (found.coefficients <= 1)) and found.spectrum.shape == GRID.nm.shape
