"""The shape fit: the gradient at the outline, against differences."""
from __future__ import annotations

import numpy as np
import pytest

from spectrabox.fixtures.object_views import cameras, view_xml
from spectrabox.reconstruct.rendering.renderer import render
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.view import MaterialSpec, PhotoView

from benchmarks.paper.mesh import (
    add_outline_gradient,
    icosphere,
    write_mesh,
)
from benchmarks.paper.shape_fit import (
    with_mesh,
)
from tests.cornell_problem import BANDS, GRID, SCALE_ONE, camera, photo_of

pytestmark = pytest.mark.usefixtures("mitsuba")

WIDTH = 24
PAINT = 0.1 + 0.6 / (1 + np.exp((570 - GRID.nm) / 12))
MATERIALS = (MaterialSpec("paint", "paint"),)


def blank_views(folder, count, height=WIDTH):
    views = []
    for number, position in enumerate(cameras(count)):
        path = folder / f"view_{number}.xml"
        text = view_xml(position, WIDTH).replace(f'"height" value="{WIDTH}"',
                                                 f'"height" value="{height}"')
        path.write_text(text, encoding="utf-8")
        photo = photo_of(np.ones((height, WIDTH, 3)))
        views.append(PhotoView(f"view {number}", read_scene(path), photo, camera(), BANDS,
                               MATERIALS, SCALE_ONE))
    return views


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
