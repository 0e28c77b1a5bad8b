"""Recorded: what Mitsuba is asked and answers on tiny films with few paths.

Paths in single precision: another processor may round one to the other side of an edge, which moves
the sum of some hundred paths by less than what is allowed here.
"""
import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import views_by_hand as hand
from recorded_refusals import placeless, said
from test_recorded_reconstruct_box import BALL, CHART, LAMP
from test_recorded_reconstruct_box import box as measured_box

from spectrabox.capture.photo.image_files import write_exr
from spectrabox.fixtures.object_views import cameras, view_xml
from spectrabox.radiometry.chart import patch_centres_uv, patch_size_uv
from spectrabox.radiometry.interreflection import exponents_up_to
from spectrabox.reconstruct.engines import gradient, gradient_engine, transport_engine
from spectrabox.reconstruct.engines.gradient import fit_by_gradient
from spectrabox.reconstruct.inverse_rendering import reconstruct, reconstruct_views
from spectrabox.reconstruct.pixels import pixel_light
from spectrabox.reconstruct.pixels.hits import hits_of
from spectrabox.reconstruct.rendering import irradiance, llvm
from spectrabox.reconstruct.rendering.irradiance import lamp_position_error, patch_irradiance
from spectrabox.reconstruct.rendering.renderer import load_scene, render, start_mitsuba
from spectrabox.reconstruct.replay import set_stage
from spectrabox.reconstruct.scene import light_position, surfaces
from spectrabox.reconstruct.scene.box_scene import chart_xml
from spectrabox.reconstruct.scene.box_tables import ChartPlaceTable
from spectrabox.reconstruct.scene.light_position import PositionSettings, refine_light_position
from spectrabox.reconstruct.scene.regions import block_regions
from spectrabox.reconstruct.scene.scene_file import scene_of_text
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.shape.descent import Stage, _ViewLoss, descend, flat_start
from spectrabox.reconstruct.shape.mesh import icosphere, write_mesh
from spectrabox.reconstruct.shape.shape import (
    ShapeSettings,
    bounding_sphere,
    reconstruct_shape,
    with_mesh,
)
from spectrabox.reconstruct.tracer import transport
from spectrabox.reconstruct.tracer.tracer_tables import bsdf_table, light_table, profile_table
from spectrabox.reconstruct.tracer.transport import (
    images_of_signals,
    kept_products,
    shaded_images,
    trace_transport,
)
from spectrabox.reconstruct.view import MaterialSpec, View

TRACED = 1e-3
LEVEL = 0.07    # of photos of an object: of a grey one
PROFILE = "angle,radiance\n0,2\n40,1.2\n80,0.3\n"
BULB = '<emitter type="point" id="lamp"><point name="position" x="0.1" y="0.6" z="0.7"/></emitter>'
SKY = '<emitter type="envmap" id="sky"><string name="filename" value="sky.exr"/></emitter>'
SHAPED = '<string name="profile" value="lamp.csv"/></emitter>'


@pytest.fixture(scope="module", autouse=True)
def mitsuba():
    return start_mitsuba("cpu")


@pytest.fixture
def few_paths(monkeypatch):
    monkeypatch.setattr(transport_engine, "FIRST_SPP", 8)
    monkeypatch.setattr(transport_engine, "MAX_SPP", 32)
    monkeypatch.setattr(transport_engine, "IMAGE_SPP", 16)
    monkeypatch.setattr(gradient_engine, "FINAL_SPP", 16)


def box(folder, lights=2, profile=True, **chosen):
    """A view of the box whose surfaces Mitsuba finds; the photo is of a plain picture."""
    (folder / "lamp.csv").write_text(PROFILE, "utf-8")
    view, _ = hand.view(folder, lights=lights, **chosen)
    scene = hand.scene(folder, lights, lambda text: text.replace(
        "</emitter>", SHAPED, 1) if profile else text)
    return dataclasses.replace(view, scene_file=scene)


def photographed(view, seed=5, size=(44, 34)):
    """The view with a photo that Mitsuba renders of the truth."""
    rng = np.random.default_rng(seed)
    view = dataclasses.replace(view, photo=hand.photo_of(np.ones((*size[::-1], 3)), rng))
    image = render(load_scene(view.xml(hand.TRUTH)), 768, 9)[0]
    return dataclasses.replace(view, photo=hand.photo_of(1.7 * image, rng, 0.003))


def test_surfaces_and_hits(recorded, tmp_path, monkeypatch):
    view = box(tmp_path, profile=False)
    row, column = np.array([1, 5, 10, 18, 12]), np.array([2, 20, 14, 7, 10])
    scene = view.scene()
    recorded({"surface": view.surface, "hits": hits_of(scene, hand.SIZE, row, column)}, rtol=TRACED)
    monkeypatch.setattr(surfaces, "RAYS_AT_ONCE", 3 * 16 * hand.SIZE[0])
    names = tuple(view.scene_file.surfaces)
    np.testing.assert_array_equal(surfaces.surface_map(scene, names, hand.SIZE), view.surface)
    few = surfaces.surface_map(scene, names[3:5], hand.SIZE)
    np.testing.assert_array_equal(few, np.where(np.isin(view.surface, (3, 4)), view.surface - 3,
                                                -1))


def test_traced_transport(recorded, tmp_path, monkeypatch):
    view = box(tmp_path)
    region, group = block_regions(view.surface, view.surface >= 0)
    unit = transport_engine.unit_scene(view, 2, separate_lights=True)
    traced = trace_transport(unit, region, spp=24, seed=5, passes=3)
    one = trace_transport(transport_engine.unit_scene(view, 2), region, spp=24, seed=5)
    recorded({"group": group, "mean": traced.passes.mean(axis=0), "spp": (traced.spp, one.spp),
              "shape": traced.passes.shape, "one": one.coefficients,
              "exponents": traced.exponents}, rtol=TRACED)
    recorded({"noise": traced.relative_variance, "of one": one.relative_variance}, rtol=0.02,
             case="noise")
    signals = np.random.default_rng(1).uniform(size=(2 * len(traced.exponents), 3))
    images = shaded_images(unit, traced.exponents, signals, spp=8, seed=3, passes=2)
    kept = images_of_signals(unit, traced.exponents, spp=8, seed=3, passes=2)(signals)
    np.testing.assert_allclose(kept, images, rtol=1e-4, atol=1e-6)
    monkeypatch.setattr(transport, "MAX_IMAGE_COEFFICIENTS", 1)
    again = images_of_signals(unit, traced.exponents, spp=8, seed=3, passes=2)(signals)
    np.testing.assert_array_equal(again, images)
    recorded(images, rtol=TRACED, case="images")
    scene = unit.scene
    recorded({"bsdfs": said(lambda: bsdf_table(scene, {"white": "a"}, ("a",))),
              "lights": sorted(light_table(scene, (("second",), ("lamp",))).tolist()),
              "profiles": np.sort(profile_table(scene, view.scene_file.profiles))}, case="tables")


def test_a_trace_that_was_stopped(tmp_path):
    view = box(tmp_path)
    region = np.where(view.surface == 2, 0, np.where(view.surface == 4, 1, -1))
    unit, path = transport_engine.unit_scene(view, 2), tmp_path / "trace.npz"

    def trace(checkpoint, progress=None, seed=5):
        return trace_transport(unit, region, spp=16, seed=seed, checkpoint=checkpoint,
                               progress=progress).passes

    def stop(done):
        if done > 0.6:
            raise KeyboardInterrupt
    whole, shares = trace(None), []
    with pytest.raises(KeyboardInterrupt):
        trace(path, stop)
    assert path.exists()
    np.testing.assert_array_equal(trace(path, shares.append), whole)
    # of four passes the first three were done
    assert shares == [1.0] and not path.exists()
    with pytest.raises(KeyboardInterrupt):
        trace(path, stop)
    other = trace(path, shares.append, seed=6)
    assert len(shares) == 5 and not np.array_equal(other, whole)


def test_products_that_are_dropped(recorded, tmp_path, monkeypatch):
    view = box(tmp_path, profile=False)
    unit = transport_engine.unit_scene(view, 3)
    monkeypatch.setattr(transport, "PILOT_PATHS", 1 << 12)
    found = {}
    for above in (55, 56):
        monkeypatch.setattr(transport, "PRUNE_ABOVE", above)
        monkeypatch.setattr(transport, "DROPPED", 0.02)
        exponents, dropped = kept_products(unit, np.where(view.surface == 2, 0, -1), 3)
        found[f"{above}"] = {"kept": len(exponents), "dropped": dropped, "degrees": exponents.sum()}
    recorded(found, rtol=0.02)
    assert len(exponents_up_to(5, 3)) == 56


def test_light_of_pixels(recorded, tmp_path, monkeypatch):
    view = box(tmp_path)
    unit = transport_engine.unit_scene(view, 2, separate_lights=True)
    own = np.array([0, 0, 0, 1, 2, 3, 4])
    monkeypatch.setattr(pixel_light, "MOST_NODES", 30)
    shares = []
    light = pixel_light.trace_pixel_light(unit, view.surface, own, seed=2, progress=shares.append)
    spectra = np.array([hand.TRUTH[name] for name in hand.NAMES])
    recorded({"nodes": light.nodes.keys, "cell": light.nodes.cell, "own": light.own,
              "coefficients": light.coefficients, "lamp": light.lamp,
              "light": light.on_nodes(spectra, np.stack([hand.NM / 500, hand.NM / 900]))},
             rtol=TRACED)
    recorded({"noise": light.relative_variance, "shares": shares}, rtol=0.02, case="noise")


def test_light_on_a_chart(recorded, tmp_path, monkeypatch):
    monkeypatch.setattr(irradiance, "SAMPLES", 256)
    (tmp_path / "lamp.csv").write_text(PROFILE, "utf-8")
    chart = ChartPlaceTable.model_validate(CHART)
    scenes = {"panel": LAMP, "ball": BALL, "beam": LAMP | {"beam": "lamp.csv",
                                                           "look_at_mm": [60.0, 0.0, -100.0]}}
    found, centres, size = {}, patch_centres_uv()[::3], patch_size_uv()
    for name, lamp in scenes.items():
        scene = scene_of_text(chart_xml(measured_box(lamp=lamp), chart), tmp_path / "chart.xml")
        found[name] = [patch_irradiance(scene, centres, size, 4),
                       patch_irradiance(scene, centres, np.tile(size, (8, 1)))]
        found[f"{name} error"] = [lamp_position_error(scene, centres, size, error, 4)
                                  for error in (0.0, 0.01, 0.03)]
    recorded(found, rtol=TRACED)
    away = ChartPlaceTable.model_validate(CHART | {"look_at_mm": [10.0, -90.0, -120.0]})
    turned = scene_of_text(chart_xml(measured_box(), away), tmp_path / "chart.xml")
    recorded({"away": said(lambda: patch_irradiance(turned, centres, size)),
              "no chart": said(lambda: patch_irradiance(box(tmp_path).scene_file, centres, size))},
             case="refused")


def test_a_light_that_is_sought(recorded, tmp_path, monkeypatch):
    monkeypatch.setattr(light_position, "ITERATIONS", 2)
    monkeypatch.setattr(light_position, "NEW_SLOPES", 1)
    plain = box(tmp_path, lights=1, profile=False)
    # a point, since a lamp that is seen moves over the pixels beside it
    bulb = hand.scene(tmp_path, 1, lambda text: "".join((
        text[:text.index('<shape type="rectangle" id="lamp">')], BULB,
        text[text.index("</shape>") + len("</shape>"):])))
    view = photographed(dataclasses.replace(plain, scene_file=bulb))
    moved = light_position.with_light_moved(view.scene_file, 0, np.array([0.05, 0.0, -0.04]))
    found = refine_light_position(moved, hand.TRUTH, view.response, view.photo, "lamp",
                                  PositionSettings(0.02, 0.03, 0.01, 24, 3))
    # The derivative is a small difference of traced light.
    recorded(found, rtol=0.02)
    # of 24 paths a pixel and two steps: five standard errors
    assert np.all(np.abs(found.offset - [-0.05, 0, 0.04]) < 5 * found.standard_error)
    assert abs(found.scale.value - 1.7) < 5 * found.scale.standard_error
    photo = dataclasses.replace(view.photo, signal=0 * view.photo.signal + np.float32(1e-9))
    recorded({"at the ceiling": said(lambda: refine_light_position(
        plain.scene_file, hand.TRUTH, view.response, view.photo)),
        "dark": said(lambda: refine_light_position(
            moved, hand.TRUTH, view.response, dataclasses.replace(
                photo, saturated=photo.signal < 1))),
        "missing": said(lambda: refine_light_position(moved, {"white": hand.TRUTH["white"]},
                                                      view.response, view.photo))}, case="refused")


def test_a_reconstruction_from_a_traced_box(recorded, tmp_path, few_paths):
    view = photographed(box(tmp_path, profile=False))
    settings = InversionSettings(6, seed=2, engine="transport", learnt=hand.LEARNT,
                                 brightness_error=0.01)
    steps = []
    found = reconstruct_views((view,), settings, lambda done, what: steps.append((done, what)),
                              tmp_path / "trace.npz")
    record = found.views[0]
    recorded({"signal": found.signal, "spectra": found.spectra, "engine": record.engine,
              "spp": record.spp, "scale": record.light_scale.value, "steps": steps,
              "rendered": record.rendered, "surface": record.surface}, rtol=5 * TRACED)
    single = reconstruct(view, dataclasses.replace(settings, engine="single-bounce"),
                         lambda *_: None)
    recorded({"signal": single.signal, "engine": single.engine}, rtol=5 * TRACED, case="single")
    stage = set_stage((view,), settings, lambda *_: None)
    recorded({"region": stage.views[0].region, "scale": stage.views[0].nuisances.scale},
             rtol=5 * TRACED, case="stage")
    recorded(transport_engine.require_lit((view,), settings), case="memory")
    shut = hand.scene(tmp_path, 1, lambda text: text.replace("0.19 0.99", "0.19 5"))
    recorded(said(lambda: transport_engine.require_lit(
        (dataclasses.replace(view, scene_file=shut),), settings)), case="unlit")


def test_a_descent(recorded, tmp_path, few_paths):
    view = photographed(box(tmp_path, lights=1, profile=False))
    settings = InversionSettings(5, steps=8, spp=4, seed=3)
    steps = []
    fit = fit_by_gradient(view, settings, lambda done, what: steps.append((done, what)))
    recorded({"fit": fit, "steps": steps}, rtol=5 * TRACED)
    scaled = dataclasses.replace(view, light_scale=hand.stated_scale(1.7))
    answer = gradient_engine.invert_by_gradient(scaled, settings, lambda *_: None)
    recorded({"coefficients": answer.coefficients, "signals": answer.signals,
              "picture": answer.renderings, "loss": answer.loss_history, "notes": answer.notes,
              "engine": answer.engine, "spp": answer.spp, "outcome": answer.outcome},
             rtol=5 * TRACED, case="answer")
    recorded(answer.signal_covariance, rtol=0.05, case="covariance")


def test_a_descent_that_stalls(recorded, tmp_path, monkeypatch):
    monkeypatch.setattr(gradient, "WINDOW", 3)
    monkeypatch.setattr(gradient_engine, "FINAL_SPP", 8)
    view = photographed(box(tmp_path, lights=1, profile=False))
    # too bright a light for what is shown: everything is black soon, and nothing falls any more
    dim = dataclasses.replace(view, light_scale=hand.stated_scale(170.0))
    steps = []
    fit = fit_by_gradient(dim, InversionSettings(4, steps=60, spp=2, seed=7),
                          lambda done, what: steps.append(what))
    answer = gradient_engine.invert_by_gradient(dim, InversionSettings(4, steps=60, spp=2, seed=7),
                                                lambda *_: None)
    recorded({"steps": len(steps), "last": steps[-1], "losses": len(fit.loss_history),
              "averaged": len(fit.tail), "outcome": fit.outcome, "notes": answer.notes})
    assert len(steps) < 60


def test_a_sky_beside_a_lamp(recorded, tmp_path):
    rng = np.random.default_rng(3)
    sky = np.tile(rng.uniform(0.2, 2, (8, 16, 1)).astype(np.float32), 3)
    write_exr(tmp_path / "sky.exr", sky, ["R", "G", "B"])
    plain = box(tmp_path, lights=1, profile=False)
    scene = hand.scene(tmp_path, 1, lambda text: text.replace("</scene>", SKY + "</scene>"))
    unit = transport_engine.unit_scene(dataclasses.replace(plain, scene_file=scene), 2, True)
    region = np.where(hand.surface_picture() >= 0, hand.surface_picture(), -1)
    traced = trace_transport(unit, region, spp=32, seed=2)
    recorded(traced.passes.mean(axis=0), rtol=TRACED)
    # the lamp is as bright as without the sky
    alone = trace_transport(transport_engine.unit_scene(plain, 2), region, spp=32, seed=2)
    lamp, other = (each.passes.mean(axis=0)[:, 0].sum() for each in (traced, alone))
    # 32 paths of 500 pixels know a sum to some hundredths
    assert abs(lamp / other - 1) < 0.15


def test_a_descent_to_black_ends_there(tmp_path, few_paths):
    view = box(tmp_path, lights=1, profile=False, known=())
    dark = dataclasses.replace(view, light_scale=hand.stated_scale(1.7), photo=dataclasses.replace(
        view.photo, signal=np.full_like(view.photo.signal, 1e-5)))
    answer = gradient_engine.invert_by_gradient(dark, InversionSettings(5, steps=8, spp=4),
                                                lambda *_: None)
    # a hundredth of a white wall, where the photo shows a ten-thousandth
    seen = np.unique(view.surface[view.surface >= 0])
    assert seen.size > 4 and answer.coefficients.max() < 0.01


def test_renderings_and_their_noise(recorded, tmp_path):
    scene = load_scene(box(tmp_path, profile=False).xml(hand.TRUTH))
    picture, variance = render(scene, 8, 3, 4)
    recorded({"picture": picture, "alone": render(scene, 2, 5)[0]}, rtol=TRACED)
    recorded({"variance": variance, "none": render(scene, 2, 5)[1].size}, rtol=0.02, case="noise")
    recorded(said(lambda: load_scene("<scene version='3.0.0'><shape type='no'/></scene>"))[:60],
             case="damaged")


def objects(folder, count=3):
    views = []
    for number, position in enumerate(cameras(count)):
        photo = hand.photo_of(np.random.default_rng(number).uniform(0.5, 3, (16, 16, 3)) * LEVEL,
                              np.random.default_rng(9))
        views.append(View(f"view {number}", scene_of_text(view_xml(position, 16),
                                                          folder / "view.xml"), photo,
                          hand.calibration(), tuple("RGB"), (MaterialSpec("paint", "paint"),),
                          hand.stated_scale(0.8)))
    return views


def test_steps_of_a_shape(recorded, tmp_path):
    vertices, faces = icosphere(1)
    write_mesh(tmp_path / "ball.ply", vertices, faces)
    views = [with_mesh(view, "object", tmp_path / "ball.ply") for view in objects(tmp_path)]
    start = flat_start(views, 5, 8, 2)
    centre, radius = bounding_sphere(objects(tmp_path)[0], "object")
    by_vertex, by_spectrum, loss = _ViewLoss(views[1], start, "object").gradients(
        vertices, start, 8, 7)
    recorded({"start": start, "sphere": (centre, radius), "loss": loss, "spectrum": by_spectrum,
              "xml": placeless(views[0].xml({"paint": np.ones(2)}), tmp_path)}, rtol=TRACED)
    recorded(by_vertex, rtol=0.02, case="by vertex")
    ended = descend(views, "object", vertices, faces, start, Stage(1, 2, 0.02, 9.0, 4, 2), 5,
                    lambda step: None)
    recorded(ended, rtol=TRACED, case="descent")


def test_a_shape_in_a_few_steps(recorded, tmp_path):
    stages = (Stage(1, 2, 0.03, 9.0, 2, 2), Stage(2, 3, 0.02, 5.0, 2, 3))
    steps = []
    found = reconstruct_shape(objects(tmp_path), "object", ShapeSettings(4, stages, 3),
                              lambda done, what: steps.append((done, what)))
    recorded({"found": found, "steps": steps}, rtol=5 * TRACED)


def test_shapes_that_are_refused(recorded, tmp_path):
    views = objects(tmp_path)
    known = dataclasses.replace(views[0].materials[0], reflectance=hand.TRUTH["red"])
    other = MaterialSpec("other", "other")
    cases = {"two": (views[:2], "object"), "no shape": (views, "thing"),
             "no scale": ([*views[:2], dataclasses.replace(views[2], light_scale=None)], "object"),
             "others": ([dataclasses.replace(view, materials=(*view.materials, other))
                         for view in views], "object"),
             "known": ([dataclasses.replace(view, materials=(known,)) for view in views], "object")}
    recorded({name: said(lambda given=given: reconstruct_shape(*given, ShapeSettings(),
                                                               lambda *_: None))
              for name, given in cases.items()})


def test_commands_that_fetch_llvm(recorded, tmp_path, monkeypatch):
    commands, scratch = [], []
    monkeypatch.setattr(llvm.shutil, "which", lambda name: f"/usr/bin/{name}")

    def run(command, **options):
        if options.get("capture_output"):
            commands.append(command)
            return SimpleNamespace(stdout="libllvm18\n\nlibedit2\n  Depends: x\nlibc6\n<virtual>\n"
                                   "|libx\nlibtinfo6\n", returncode=0)
        scratch.append(options["cwd"])
        commands.append([placeless(word, Path(options["cwd"])) for word in command])
        if command[0] == "dpkg-deb":
            library = Path(options["cwd"], "unpacked", "usr", "lib", "x86_64-linux-gnu")
            library.mkdir(parents=True, exist_ok=True)
            (library / "libLLVM.so.18.1").write_text("llvm")
            (library / "note.txt").write_text("no library")
            (library.parent / "libother.so").write_text("elsewhere")
        if "download" in command:
            Path(options["cwd"], "one.deb").write_text("")
        return SimpleNamespace(returncode=int("libllvm19" in command))
    monkeypatch.setattr(llvm.subprocess, "run", run)
    llvm.fetch_llvm(tmp_path / "llvm")
    kept = [[placeless(word, Path(scratch[0])) for word in command] for command in commands]
    recorded({"commands": [" ".join(command) for command in kept],
              "files": sorted(path.name for path in (tmp_path / "llvm").iterdir())})
    monkeypatch.setattr(llvm.shutil, "which", lambda name: None)
    commands.clear()
    llvm.fetch_llvm(tmp_path / "none")
    assert not commands


def test_libraries_of_llvm(recorded, tmp_path, monkeypatch, capsys):
    for name in ("libLLVM-15.so.1", "libLLVM.so.19.1", "libLLVMother.so", "x.so"):
        (tmp_path / name).write_text(name)
    monkeypatch.delenv(llvm.VARIABLE, raising=False)
    monkeypatch.setattr(llvm, "PATTERNS", ((tmp_path, "libLLVM*"),))
    found = {"name": llvm.llvm_name(),
             "candidates": sorted(path.name for path in llvm._candidates()),
             "not loaded": [llvm.llvm_version(path) for path in sorted(tmp_path.iterdir())]}
    monkeypatch.setattr(llvm, "llvm_version", lambda path: 15 if "15" in path.name else
                        19 if "19" in path.name else None)
    for oldest in (15, 16, 19, 20):
        monkeypatch.setattr(llvm, "oldest_usable", lambda oldest=oldest: oldest)
        chosen = llvm.find_llvm()
        found[f"from {oldest}"] = chosen and (chosen[0].name, chosen[1])
    found["said"] = said(llvm.ensure_llvm)
    monkeypatch.setenv(llvm.VARIABLE, str(tmp_path / "x.so"))
    found["own"] = (llvm.llvm_name(), said(llvm.ensure_llvm, tmp_path))
    recorded(found)
    ended = {}
    for has, loads, gets in ((True, True, None), (True, False, None), (False, True, True),
                             (False, False, False)):
        state, fetched = [has], []
        monkeypatch.setattr(llvm, "find_llvm", lambda state=state: (
            (tmp_path / "l.so", 19) if state[0] else None))
        monkeypatch.setattr(llvm, "_load", lambda path, loads=loads: loads)
        monkeypatch.setattr(llvm, "fetch_llvm", lambda state=state, gets=gets, fetched=fetched: (
            fetched.append(1), state.append(state.pop() or gets)))
        code = llvm.main()
        written = capsys.readouterr()
        ended[f"{has} {loads} {gets}"] = (code, len(fetched), placeless(written.out, tmp_path),
                                          written.err)
    recorded(ended, case="set-up")
