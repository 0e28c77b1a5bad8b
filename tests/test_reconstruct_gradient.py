"""The descent by differentiable rendering: when it stops, what memory it takes, and BSDFs that are
no plain product.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.reconstruct import gradient_engine as gradient
from spectrabox.reconstruct import transport_engine
from spectrabox.reconstruct.gradient_engine import (
    fit_by_gradient,
    invert_by_gradient,
    reflectance_key,
    stalled,
)
from spectrabox.reconstruct.inverse_rendering import reconstruct
from spectrabox.reconstruct.rendering.renderer import load_scene, render
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.view import MaterialSpec

from tests.cornell_problem import GRID, photo_of, plain_settings, view_of
from tests.session_runs import silent

pytestmark = pytest.mark.usefixtures("mitsuba")

WIDTH = 16
PAINT = 0.15 + 0.5 / (1 + np.exp((560 - GRID.nm) / 20))
FLOOR = np.full(GRID.nm.size, 0.5)
BSDFS = {"diffuse": '<bsdf type="diffuse" id="paint"><spectrum name="reflectance" '
         'value="0.5"/></bsdf>',
         "roughplastic": '<bsdf type="roughplastic" id="paint"><float name="alpha" '
         'value="0.2"/><spectrum name="diffuse_reflectance" value="0.5"/></bsdf>',
         "roughconductor": '<bsdf type="roughconductor" id="paint"><string name="material" '
         'value="none"/><float name="alpha" value="0.4"/></bsdf>',
         "principled": '<bsdf type="principled" id="paint"><float name="roughness" '
         'value="0.3"/><float name="metallic" value="0.7"/><spectrum name="base_color" '
         'value="0.5"/></bsdf>'}
SCENE = """<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="3"/>
</integrator>
<sensor type="perspective"><float name="fov" value="40"/><transform name="to_world">
<lookat origin="0,1,4" target="0,0,0" up="0,1,0"/></transform><film type="hdrfilm"/></sensor>
<emitter type="constant"><spectrum name="radiance" value="1"/></emitter>
<bsdf type="diffuse" id="floor"><spectrum name="reflectance" value="0.5"/></bsdf>PAINT
<shape type="sphere" id="ball"><float name="radius" value="0.9"/><ref id="paint"/></shape>
<shape type="rectangle" id="ground">
<transform name="to_world"><scale value="4"/><rotate x="1" angle="-90"/>
<translate y="-0.9"/></transform><ref id="floor"/></shape></scene>"""


def ball(folder, kind="diffuse"):
    """A painted ball on a known floor under an even sky, and its photo with the true paint."""
    path = folder / f"{kind}.xml"
    path.write_text(SCENE.replace("PAINT", BSDFS[kind]), encoding="utf-8")
    materials = (MaterialSpec("paint", "paint"), MaterialSpec("floor", "floor", FLOOR))

    def view(photo):
        return view_of(read_scene(path), photo_of(photo), materials=materials)

    blank = view(np.ones((WIDTH, WIDTH, 3)))
    true = load_scene(blank.xml({"paint": PAINT, "floor": FLOOR}, integrator="path"))
    return view(render(true, 2048, seed=901)[0])


def descend(view, steps, spp=4, seed=1, progress=silent):
    return fit_by_gradient(view, plain_settings(5, steps=steps, spp=spp, seed=seed), progress)


def test_a_loss_that_only_scatters_has_stalled_and_one_that_falls_has_not():
    rng = np.random.default_rng(3)
    scatter = rng.normal(size=(400, 2 * gradient.WINDOW))
    # One standard error, one-sided: noise alone passes for a fall in 16 % of cases, 63 of 400; 100
    # is 5 sigma more.
    assert sum(not stalled(list(10 + row)) for row in scatter) < 100
    # Falling by 3 over the window with a scatter of 1.3: 9 standard errors.
    assert not any(stalled(list(10 - 0.1 * np.arange(row.size) + row)) for row in scatter)
    assert not stalled([1.0] * (2 * gradient.WINDOW - 1))


def test_the_descent_stops_by_itself_and_says_so(tmp_path):
    view = ball(tmp_path)
    tail, _, losses, outcome = descend(view, 200, spp=2)
    assert outcome is Outcome.CONVERGED and 2 * gradient.WINDOW < len(losses) < 200
    # The last quarter of the steps brings the step size down; half of these are averaged. Rounded
    # down twice.
    assert abs(len(tail) - len(losses) / 8) < 1.5
    _, _, losses, outcome = descend(view, 8)
    assert outcome is Outcome.STEP_LIMIT and len(losses) == 8


def test_memory_does_not_grow_with_the_steps(tmp_path, monkeypatch):
    monkeypatch.setattr(gradient, "stalled", lambda losses: False)
    resident = []
    descend(ball(tmp_path), 160, spp=1, progress=lambda done, what: resident.append(resident_mib()))
    assert len(resident) == 160
    # Measured: below 1 MiB. An image or a graph kept from each of the 100 steps would be 10 MiB or
    # more.
    assert resident[-1] - resident[60] < 5


def resident_mib():
    if not Path("/proc/self/status").exists():
        pytest.skip("resident memory is read from /proc, which this system lacks")
    line = next(line for line in Path("/proc/self/status").read_text().splitlines()
                if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


@pytest.mark.parametrize("kind", BSDFS)
def test_the_gradient_agrees_with_finite_differences_for_any_bsdf(tmp_path, kind):
    import drjit as dr
    import mitsuba as mi

    view = ball(tmp_path, kind)
    start = np.full((1, 5), 0.4)
    weight = np.random.default_rng(0).uniform(size=view.measured.shape)

    def difference(number, seed):
        ends = [np.sum(weight * render(view.scene(start + sign * 0.02 * np.eye(5)[number]), 128,
                                       seed)[0])
                for sign in (1, -1)]
        return (ends[0] - ends[1]) / 0.04

    def derivative(seed):
        scene = view.scene(start)
        parameters = mi.traverse(scene)
        key = reflectance_key(parameters, "paint", view.scene_file)
        values = mi.Float(np.array(parameters[key]))
        dr.enable_grad(values)
        parameters[key] = values
        parameters.update()
        image = mi.render(scene, parameters, spp=128, seed=seed, seed_grad=seed + 50)
        dr.backward(dr.sum(image * mi.TensorXf(weight.astype(np.float32)), axis=None))
        return view.basis(5).T @ np.array(dr.grad(values), dtype=float)

    gradients = np.array([derivative(seed) for seed in range(4)])
    differences = [difference(3, seed) for seed in range(4)]
    error = np.hypot(np.std(differences, ddof=1), np.std(gradients[:, 3], ddof=1)) / 2
    # Four standard errors of the difference of two means of four; 0.2 % for the curvature over the
    # step.
    assert gradients[:, 3].mean() == pytest.approx(np.mean(differences),
                                                   abs=4 * error + 0.002
                                                   * abs(np.mean(differences)))


@pytest.mark.parametrize("kind", ["roughplastic", "principled", "roughconductor"])
def test_a_coated_or_metallic_paint_is_found(tmp_path, kind):
    view = ball(tmp_path, kind)
    answer = invert_by_gradient(view, plain_settings(7, steps=80, spp=8, engine="gradient"),
                                silent)
    response = view.response / view.response.sum(axis=1, keepdims=True)
    # Eight paths a step: 2 % of white in the strongest bands.
    np.testing.assert_allclose(answer.signals[0], response @ PAINT, atol=0.02)


@pytest.mark.parametrize("kind, engine",
                         [("diffuse", "light transport"), ("roughplastic", "gradient descent")])
def test_the_engine_is_chosen_by_the_materials_and_the_choice_is_said(tmp_path, monkeypatch, kind,
                                                                      engine):
    monkeypatch.setattr(transport_engine, "MAX_SPP", 64)
    view = ball(tmp_path, kind)
    fit = reconstruct(view, plain_settings(5, steps=4, spp=2, engine="auto"), silent)
    assert engine in fit.engine
    chosen = [one.values["names"] for one in fit.findings if one.code == "fit.gradient-engine"]
    assert chosen == ([["paint"]] if kind != "diffuse" else [])
