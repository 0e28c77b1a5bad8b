"""What a scene states is honoured, refused or named: lights beside each other, fog, lenses, crops,
textures, and BSDFs wherever they are written.
"""
from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import spectrabox as sb
from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.fixtures.cornell_box import cornell_box_xml
from spectrabox.measure.steps import measurement
from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.gradient_engine import fit_by_gradient
from spectrabox.reconstruct.inverse_rendering import forecast, reconstruct, settings_for
from spectrabox.reconstruct.rendering.renderer import load_scene, render
from spectrabox.reconstruct.scene import stated
from spectrabox.reconstruct.view import MaterialSpec

from tests.cornell_problem import (
    GRID,
    SCALE_ONE,
    TRUTH,
    WIDTH,
    photo_of,
    plain_settings,
    scene,
    specs,
    view_of,
)
from tests.session_runs import silent

ROOT = Path(__file__).resolve().parent.parent
BOX = cornell_box_xml(WIDTH, 4)
SECOND = ('<shape type="sphere" id="second"><float name="radius" value="0.1"/>'
          '<point name="center" value="-0.6, -0.2, 0.7"/><emitter type="area">{}</emitter></shape>')
LAMP = '<spectrum name="radiance" value="1.0"/>'


def box(*lights):
    """The box with its lamp and further parts."""
    first, *others = lights
    return BOX.replace(LAMP, first).replace("</scene>", "".join(others) + "</scene>")


def photographed(view, lights):
    """The view with stock Mitsuba's picture of the true paints under lights of these spectra."""
    picture, _ = render(load_scene(view.xml(TRUTH, light=lights, integrator="path")), 256, 5)
    return replace(view, photo=photo_of(picture))


# ---- lights --------------------------------------------------------------------------------------

@pytest.mark.parametrize("strong, weak, ratio", [
    ('<rgb name="radiance" value="10, 10, 10"/>', '<rgb name="radiance" value="4, 4, 4"/>', 0.4),
    ('<spectrum name="radiance" value="2.5"/>', '<rgb name="radiance" value="0.5"/>', 0.2),
    ('<float name="radiance" value="3"/>', '<spectrum name="radiance" type="uniform">'
     '<float name="value" value="0.3"/></spectrum>', 0.1),
    ('<rgb name="radiance" value="2"/>', "", 0.5),
    ('<spectrum name="radiance" type="regular"><float name="wavelength_min" value="360"/><float '
     'name="wavelength_max" value="830"/><string name="values" value="2, 8"/></spectrum>',
     '<spectrum name="radiance" value="360:1, 830:4"/>', 0.5)])
def test_strengths_of_lights_stand_to_each_other_as_the_scene_says(mitsuba, tmp_path, strong, weak,
                                                                   ratio):
    view = view_of(scene(tmp_path, box(strong, SECOND.format(weak))))
    assert {name: light[0] for name, light in view.unit_lights.items()} == pytest.approx(
        {"lamp": 1.0, "second": ratio}, rel=1e-4)
    assert not view.own_lights


def test_paints_under_two_lamps_are_right_whatever_the_lamps_strengths_are(mitsuba, tmp_path):
    """The photo is stock Mitsuba's under lamps of 1 : 6; the file says 2 : 12."""
    view = view_of(scene(tmp_path, box(LAMP.replace("1.0", "2.0"), SECOND.format(
        LAMP.replace("1.0", "12.0")))))
    view = photographed(view, {"lamp": view.light / 6, "second": view.light})
    found = reconstruct(view, plain_settings(9), silent)
    wanted = found.spectra.copy()
    for index, name in enumerate(found.materials):
        wanted[index] = TRUTH[name]
    signals = wanted @ (view.response / found.white_signal[:, None]).T
    # 256 paths a pixel leave 0.3 % on a surface, dark ones see the others by half of their light;
    # lamps taken for equal are off by 30 % and more
    np.testing.assert_allclose(found.signal, signals, rtol=0.02, atol=0.01)
    assert {one.code for one in view.findings} == {"scene.lights"}


def test_a_lamp_s_own_colour_is_that_of_the_file_beside_the_strongest(mitsuba, tmp_path):
    red = '<spectrum name="radiance" value="360:0.1, 830:0.9"/>'
    view = view_of(scene(tmp_path, box(LAMP, SECOND.format(red))))
    expected = view.light * np.interp(GRID.nm, [360, 830], [0.1, 0.9])
    np.testing.assert_allclose(view.own_lights["second"], expected, rtol=1e-4)
    shown = photographed(view, {"lamp": view.light, "second": expected})
    found = reconstruct(shown, plain_settings(9), silent)
    signals = np.array([TRUTH[name] for name in found.materials]) @ (
        view.response / found.white_signal[:, None]).T
    np.testing.assert_allclose(found.signal, signals, rtol=0.02, atol=0.01)
    (lights,) = view.findings
    assert lights.values["coloured"] == ["second"] and lights.values["given"] == []


def test_both_engines_get_the_same_lights(mitsuba, tmp_path):
    view = view_of(scene(tmp_path, box(LAMP, SECOND.format(LAMP.replace("1.0", "0.25")))))
    theirs = view_of(scene(tmp_path, box(LAMP)))
    xml = view.xml(TRUTH)
    both = render(load_scene(xml), 64, 1)[0]
    dark = render(load_scene(view.xml(TRUTH, light={"lamp": view.light, "second": np.full(
        GRID.nm.size, 1e-9)})), 64, 1)[0]
    strong = render(load_scene(view.xml(TRUTH, light={"lamp": view.light,
                                                      "second": view.light})), 64, 1)[0]
    assert theirs.unit_lights.keys() == {"lamp"}
    # the second lamp adds a quarter of what it adds at full strength; noise of 64 paths
    assert (both - dark).mean() == pytest.approx(0.25 * (strong - dark).mean(), rel=0.03)


def test_a_light_that_is_off_adds_nothing_and_a_scene_needs_one_that_is_on(mitsuba, tmp_path):
    off = LAMP.replace("1.0", "0")
    view = view_of(scene(tmp_path, box(LAMP, SECOND.format(off))))
    alone = view_of(scene(tmp_path, box(LAMP)))
    first, second = (render(load_scene(one.xml(TRUTH)), 16, 1)[0] for one in (view, alone))
    # other random numbers, of 16 paths a pixel over all pixels
    assert first.mean() == pytest.approx(second.mean(), rel=0.05)
    with pytest.raises(InputError, match="none of its lights emits"):
        view_of(scene(tmp_path, box(off, SECOND.format(off)))).unit_lights  # noqa: B018


def test_lights_given_to_the_library_replace_what_the_file_states(tmp_path, monkeypatch):
    noise = np.random.default_rng(1).normal(0.3, 0.01, (96, 96, 3)).astype(np.float32)
    write_exr(tmp_path / "box.exr", noise, ["R", "G", "B"])
    (tmp_path / "box.xml").write_text(box(LAMP, SECOND.format(LAMP)), encoding="utf-8")
    captures = []

    def measure(capture, keeper, **options):
        captures.append(capture)
        raise InterruptedError

    monkeypatch.setattr(measurement, "measure", measure)
    nm = np.arange(380.0, 731.0, 10.0)
    curves = np.exp(-0.5 * ((nm - np.array([[600.0], [540.0], [460.0]])) / 30) ** 2)
    with pytest.raises(InterruptedError):
        sb.reconstruct_scene(tmp_path / "box.exr", scene=tmp_path / "box.xml",
                             materials=["white", "green", "red"], camera=(nm, curves),
                             light=(nm, nm / 500), progress=False,
                             lights={"second": 0.25, "lamp": (nm, np.full(nm.size, 2.0))})
    given = captures[0].views[0].lights_by_id
    np.testing.assert_allclose(given["second"].values, 0.25 * given["second"].grid.nm / 500)
    np.testing.assert_allclose(given["lamp"].values, 2.0)


# ---- refused and named ---------------------------------------------------------------------------

FOG = '<medium type="homogeneous" id="fog"><float name="scale" value="0.2"/></medium>'
MASK = ('<texture type="checkerboard" name="{}"><rgb name="color0" value="0.1"/></texture>')
REFUSED = {
    "fog in a shape": (box(LAMP, FOG + SECOND.format(LAMP).replace(
        "</shape>", '<ref name="interior" id="fog"/></shape>')), "in a medium"),
    "fog at the camera": (BOX.replace("<film", FOG + "<film", 1), "in a medium"),
    "a textured area light": (box(MASK.format("radiance")), "has a texture"),
    "a textured spot": (box(LAMP, '<emitter type="spot">' + MASK.format("texture") + "</emitter>"),
                        "has a texture"),
    "a projector": (box(LAMP, '<emitter type="projector">' + MASK.format("irradiance")
                        + "</emitter>"), "has a texture"),
    "a lens": (BOX.replace('sensor type="perspective"', 'sensor type="thinlens"'), "thinlens"),
    "a camera without a picture": (BOX.replace('sensor type="perspective"',
                                               'sensor type="irradiancemeter"'), "no picture"),
    "a crop": (BOX.replace('type="hdrfilm">', 'type="hdrfilm"><integer name="crop_width" '
                           'value="8"/><integer name="crop_offset_x" value="4"/>'), "cropped"),
    "light through a principled BSDF": (BOX.replace(
        '<bsdf type="diffuse" id="red"><spectrum name="reflectance" value="0.5"/>',
        '<bsdf type="principled" id="red"><float name="spec_trans" value="0.6"/>'), "spec_trans"),
    "light through a BSDF of another program": (BOX.replace(
        '<bsdf type="diffuse" id="red">', '<bsdf type="leaf" id="red"><float name="transmittance" '
        'value="0.4"/>'), "transmittance")}


@pytest.mark.parametrize("case", REFUSED)
def test_what_would_change_the_picture_and_is_not_kept_is_refused_by_name(case, tmp_path):
    text, word = REFUSED[case]
    with pytest.raises(InputError, match=word):
        scene(tmp_path, text)


HARMLESS = {
    "a medium of nothing": BOX.replace("</scene>", FOG + "</scene>"),
    "a crop of everything": BOX.replace('type="hdrfilm">', 'type="hdrfilm"><integer '
                                        f'name="crop_width" value="{WIDTH}"/><integer '
                                        'name="crop_offset_x" value="0"/>'),
    "metal and nothing through it": BOX.replace(
        '<bsdf type="diffuse" id="red"><spectrum name="reflectance" value="0.5"/>',
        '<bsdf type="principled" id="red"><float name="spec_trans" value="0"/><float '
        'name="metallic" value="1"/>')}


@pytest.mark.parametrize("case", HARMLESS)
def test_what_changes_nothing_is_taken(case, tmp_path):
    assert scene(tmp_path, HARMLESS[case]).left_out == ()


NAMED = {
    "alpha": BOX.replace('<bsdf type="diffuse" id="red">',
                         '<bsdf type="lambertplus" id="red"><float name="alpha" value="0.4"/>'),
    "another camera": BOX.replace("</scene>", '<sensor type="perspective" id="side"/></scene>'),
    "hide_emitters": BOX.replace('<integrator type="path">', '<integrator type="path"><boolean '
                                 'name="hide_emitters" value="true"/>')}


@pytest.mark.parametrize("parameter", NAMED)
def test_what_is_not_kept_is_named(parameter, tmp_path):
    (found,) = scene(tmp_path, NAMED[parameter]).left_out
    assert found.code == "scene.left-out" and found.values["parameters"] == [parameter]


def test_a_texture_of_roughness_is_what_the_renderer_gets(mitsuba, tmp_path):
    rough = ('<bsdf type="roughconductor" id="red"><texture type="checkerboard" name="alpha"><rgb '
             'name="color0" value="0.05"/><rgb name="color1" value="0.6"/></texture><spectrum '
             'name="specular_reflectance" value="0.5"/>')
    text = BOX.replace('<bsdf type="diffuse" id="red"><spectrum name="reflectance" value="0.5"/>',
                       rough)
    view = view_of(scene(tmp_path, text))
    parameters = mitsuba.traverse(load_scene(view.xml(TRUTH)))
    assert any(key.startswith("red.alpha.color") for key in parameters.keys())  # noqa: SIM118


def test_the_page_has_the_list():
    page = (ROOT / "docs/reference/scenes.md").read_text(encoding="utf-8")
    assert stated.reference_table() in page


# ---- BSDFs inside shapes -------------------------------------------------------------------------

def test_a_bsdf_inside_its_shape_is_found_by_descent_beside_a_glossy_one(mitsuba, tmp_path):
    text = BOX.replace('id="back"><ref id="white"/>', 'id="back"><bsdf type="diffuse"><spectrum '
                       'name="reflectance" value="0.5"/></bsdf>')
    text = text.replace('<bsdf type="diffuse" id="red"><spectrum name="reflectance" value="0.5"/>',
                        '<bsdf type="roughplastic" id="red"><spectrum name="diffuse_reflectance" '
                        'value="0.5"/><spectrum name="specular_reflectance" value="400:1, 700:1"/>')
    paints = (*specs(), MaterialSpec("back", "back_bsdf"))
    view = view_of(scene(tmp_path, text), materials=paints)
    spectra = TRUTH | {"back_bsdf": TRUTH["green"]}
    picture, _ = render(load_scene(view.xml(spectra)), 128, 3)
    tail, scale, _, _ = fit_by_gradient(replace(view, photo=photo_of(picture)), plain_settings(
        9, engine="gradient", steps=80, spp=8), silent)
    response = view.response / view.response.sum(axis=1, keepdims=True)
    signals = tail.mean(axis=0) @ (response @ view.basis(9)).T
    expected = np.array([spectra[material.bsdf] for material in view.unknown]) @ response.T
    # after 80 steps of a noisy descent; the back taken for another wall would be off by .3
    np.testing.assert_allclose(signals, expected, atol=0.06)
    assert scale == SCALE_ONE.value


# ---- forecast ------------------------------------------------------------------------------------

def test_a_forecast_builds_what_the_inversion_uses_and_names_its_engine(mitsuba, tmp_path):
    view = view_of(scene(tmp_path, BOX))
    engine, seconds, tracing_bytes = forecast([view], plain_settings(9))
    assert engine == "transport" and tracing_bytes > 1e5 and seconds > 0
    coat = BOX.replace('<bsdf type="diffuse" id="red"><spectrum name="reflectance" value="0.5"/>',
                       '<bsdf type="roughplastic" id="red">')
    coated = view_of(scene(tmp_path, coat))
    few, many = (forecast([coated], plain_settings(5, engine="auto", steps=steps, spp=2))
                 for steps in (20, 2000))
    (engine, of_few, tracing_bytes), (_, of_many, _) = few, many
    assert engine == "gradient" and tracing_bytes is None
    # a hundred times as many steps: which timing is noisy enough not to be compared further
    assert of_many > 5 * of_few > 0


def test_a_metal_of_one_spectrum_is_traced_and_one_of_a_named_metal_is_not(mitsuba, tmp_path):
    metal = BOX.replace('<bsdf type="diffuse" id="red"><spectrum name="reflectance" value="0.5"/>',
                        '<bsdf type="roughconductor" id="red">{}')
    for inner, engine in (("", "transport"), ('<string name="material" value="Au"/>', "gradient")):
        view = view_of(scene(tmp_path, metal.format(inner)))
        settings, _ = settings_for([view], plain_settings(5, engine="auto"))
        assert settings.engine == engine
