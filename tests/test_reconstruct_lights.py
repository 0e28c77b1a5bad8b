"""Every kind of light in the traced transport, against Mitsuba's own path tracer and against closed
forms.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t as student

from spectrabox.fixtures.cornell_box import MATERIALS, cornell_box_xml
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.interreflection import response_matrix, signal
from spectrabox.reconstruct.rendering.renderer import load_scene, patch_irradiance, render
from spectrabox.reconstruct.scene.scene_file import (
    TABLE_DEG,
    read_profile,
    read_scene,
    relative_radiance,
)
from spectrabox.reconstruct.tracer.transport import trace_transport
from spectrabox.reconstruct.transport_engine import unit_scene

from tests.cornell_problem import GRID, TRUTH, WIDTH, scene, view_of

pytestmark = pytest.mark.usefixtures("mitsuba")

SIZE, RUNS = (WIDTH, WIDTH), 12
ALL = np.arange(WIDTH * WIDTH).reshape(WIDTH, WIDTH)
SPECTRA = np.array([TRUTH[name] for name in MATERIALS])
LAMP = cornell_box_xml(WIDTH, 4)[cornell_box_xml(WIDTH, 4).index('    <shape type="rectangle" '
                                                                 'id="lamp">'): cornell_box_xml(
                                     WIDTH, 4).index("    <bsdf")]
LIGHTS = {
    "area": LAMP,
    "point": '<emitter type="point" id="lamp"><point name="position" value="0.2, 0.7, '
    '0.3"/></emitter>',
    "spot": '<emitter type="spot" id="lamp"><transform name="to_world"><lookat origin="0.3, 0.9, '
    '0.6" target="-0.4, -1, -0.3" up="0, 0, 1"/></transform><float name="cutoff_angle" '
    'value="35"/></emitter>', "directional": '<emitter type="directional" id="lamp"><vector '
    'name="direction" value="0.3, -0.4, -1"/></emitter>',
    "constant": '<emitter type="constant" id="lamp"/>',
    "two": LAMP + '<emitter type="point" id="bulb"><point name="position" value="0.2, 0.7, '
    '0.3"/></emitter>',
    }


def view_with(folder, light):
    text = cornell_box_xml(WIDTH, 4).replace(LAMP, light)
    return view_of(scene(folder, text))


def traced(view, **options):
    unit = unit_scene(view, options.pop("bounces", 3), options.pop("separate_lights", False))
    return trace_transport(unit, ALL, **({"spp": 64, "seed": 1, "passes": 1} | options))


def blocks(image, side=8):
    return image.reshape(WIDTH // side, side, WIDTH // side, side, -1).mean(axis=(1, 3))


@pytest.mark.parametrize("light", LIGHTS)
def test_a_scene_in_any_light_is_the_picture_of_mitsuba_s_path_tracer(tmp_path, light):
    """Z-test of 16 blocks and three bands at the 1 % level, Sidak-corrected, with the scatter of 12
    runs of each.

    Of two lights each has its own spectrum: the point light's rises where the lamp's falls.
    """
    view = view_with(tmp_path, LIGHTS[light])
    groups = view.light_groups
    spectra = {name: view.light if number == 0 else view.light[::-1].copy()
               for number, (name,) in enumerate(groups)}
    response = np.array([response_matrix(GRID, view.sensitivities,
                                         spectrum) for spectrum in spectra.values()])
    film = load_scene(view.xml(dict(zip(MATERIALS, SPECTRA, strict=True)), light=spectra,
                                  integrator="path"))
    theirs = np.array([blocks(render(film, 32, 100 + run)[0]) for run in range(RUNS)])
    ours = []
    for run in range(RUNS):
        one = traced(view, seed=run, separate_lights=True)
        ours.append(blocks(signal(one.passes[0].astype(float), one.exponents, SPECTRA, response)))
    ours = np.array(ours)
    lit = theirs.mean(axis=0) > 1e-3 * theirs.mean()  # a spot leaves some blocks in the dark
    z = (ours.mean(axis=0) - theirs.mean(axis=0)) / np.sqrt((ours.var(axis=0, ddof=1)
                                                             + theirs.var(axis=0, ddof=1)) / RUNS
                                                            + 1e-30)
    # The lattice's scatter is the smaller one: its mean adds few degrees of freedom to the film's
    # eleven.
    level = 1 - (1 - 0.01) ** (1 / z.size)
    assert lit.mean() > 0.5 and np.abs(z[lit]).max() < student.isf(level / 2, RUNS - 1)


METAL = ('<bsdf type="twosided" id="red"><bsdf type="roughconductor"><float name="alpha" '
         'value="0.25"/><spectrum name="specular_reflectance" value="0.5"/></bsdf></bsdf>')


def test_a_rough_metal_is_the_picture_of_mitsuba_s_path_tracer(tmp_path):
    """Its spectrum is a factor on all that it mirrors: the traced products hold, highlights too."""
    plain = '<bsdf type="diffuse" id="red"><spectrum name="reflectance" value="0.5"/></bsdf>'
    text = cornell_box_xml(WIDTH, 4)
    assert plain in text
    view = view_of(scene(tmp_path, text.replace(plain, METAL)))
    film = load_scene(view.xml(dict(zip(MATERIALS, SPECTRA, strict=True)), integrator="path"))
    theirs = np.array([blocks(render(film, 32, 100 + run)[0]) for run in range(RUNS)])
    runs = [traced(view, seed=run) for run in range(RUNS)]
    ours = np.array([blocks(signal(run.coefficients, run.exponents, SPECTRA, view.response))
                     for run in runs])
    z = (ours.mean(axis=0) - theirs.mean(axis=0)) / np.sqrt((ours.var(axis=0, ddof=1)
                                                            + theirs.var(axis=0, ddof=1)) / RUNS)
    level = 1 - (1 - 0.01) ** (1 / z.size)
    assert np.abs(z).max() < student.isf(level / 2, RUNS - 1)


def test_a_map_of_the_sky_is_the_picture_of_mitsuba_s_path_tracer_under_its_own_daylight(tmp_path,
                                                                                         mitsuba):
    """Mitsuba gives a grey map the spectrum D65; the traced transport, under that light, must show
    the same picture.
    """
    import OpenImageIO as oiio

    sky = np.full((8, 16, 3), 0.2, dtype=np.float32)
    sky[1:5, 2:9] = 2.0
    file = oiio.ImageOutput.create(str(tmp_path / "sky.exr"))
    assert file.open(str(tmp_path / "sky.exr"),
                     oiio.ImageSpec(16, 8, 3, oiio.FLOAT)) and file.write_image(sky)
    file.close()
    node = '<emitter type="envmap" id="sky"><string name="filename" value="sky.exr"/></emitter>'
    view = view_with(tmp_path, node)
    assert [path.name for path in view.scene_file.files] == ["sky.exr"]
    film = load_scene(view.xml(dict(zip(MATERIALS, SPECTRA, strict=True)), light=np.ones(2),
                                  integrator="path"))
    theirs = np.array([blocks(render(film, 64, 300 + run)[0]) for run in range(RUNS)])
    texture, at = mitsuba.load_dict({"type": "d65"}), mitsuba.SurfaceInteraction3f()
    at.wavelengths = mitsuba.Spectrum(mitsuba.Float(GRID.nm.astype(np.float32)))
    daylight = np.array(texture.eval(at)[0], dtype=float)
    response = response_matrix(GRID, view.sensitivities, daylight)
    runs = [traced(view, seed=run) for run in range(RUNS)]
    ours = np.array([blocks(signal(run.coefficients, run.exponents, SPECTRA, response))
                     for run in runs])
    z = (ours.mean(axis=0) - theirs.mean(axis=0)) / np.sqrt((ours.var(axis=0, ddof=1)
                                                            + theirs.var(axis=0, ddof=1)) / RUNS)
    level = 1 - (1 - 0.01) ** (1 / z.size)
    assert np.abs(z).max() < student.isf(level / 2, RUNS - 1)
    with pytest.raises(InputError,
                       match="only the transport engine knows the map of the sky of 'sky'"):
        view.scene()


PROFILE = "angle_deg,radiance\n" + "".join(f"{angle},{np.cos(np.radians(angle)) ** 2:.6f}\n"
                                          for angle in range(0, 91, 2))


def with_profile(folder, text=PROFILE, light=None):
    (folder / "lamp.csv").write_text(text, encoding="utf-8")
    node = '<emitter type="area"><string name="profile" value="lamp.csv"/>'
    return view_with(folder, (LAMP if light is None else light).replace('<emitter type="area">',
                                                                           node))


def test_a_lamp_with_a_profile_lights_each_point_as_the_closed_form_says(tmp_path):
    """A small lamp lights a point under it by its radiance in that direction: cos^2 of the angle,
    times what it was.
    """
    tiny = LAMP.replace("0.23 0 0 0  0 0 -0.19 0.99  0 0.19 0 0.01",
                        "0.02 0 0 0  0 0 -0.02 0.99  0 0.02 0 0.01")
    shaped = with_profile(tmp_path, light=tiny)
    plain = view_with(tmp_path, tiny)
    floor = np.argwhere((shaped.surface == list(shaped.scene_file.surfaces).index("floor"))
                        & shaped.used)
    first, other = (traced(one, bounces=1, seed=3,
                           spp=256).coefficients[:, 1:].sum(axis=1).reshape(SIZE)
                    for one in (shaped, plain))
    lit = [(row, column) for row, column in floor if other[row, column] > 0.3 * other.max()]
    assert len(lit) > 5
    for row, column in lit:
        across = (column + 0.5) / WIDTH * 2 - 1
        down = (row + 0.5) / WIDTH * 2 - 1
        # Pixel to floor: the camera at z = 3.9 sees y = -1 at tan(39.3077 / 2 degrees) times its
        # distance.
        reach = np.tan(np.radians(39.3077 / 2))
        distance = 1 / (down * reach)
        x, z = -across * reach * distance, 3.9 - distance
        squared = 1.98**2 / ((abs(x)) ** 2 + (z - 0.01) ** 2 + 1.99**2)
        # The lamp's and the pixel's extent change the angle by at most 2 degrees.
        assert first[row, column] / other[row, column] == pytest.approx(squared, rel=0.06)


def test_a_chart_s_irradiance_knows_the_profile(tmp_path):
    text = """<scene version="3.0.0"><sensor type="perspective" id="camera"/>
    <bsdf type="diffuse" id="white"><spectrum name="reflectance" value="0.5"/></bsdf>
    <shape type="rectangle" id="chart"><ref id="white"/></shape>
    <shape type="rectangle" id="lamp"><transform name="to_world"><scale value="0.01"/>
    <rotate x="1" angle="180"/><translate z="2"/></transform>
    <emitter type="area">PROFILE<spectrum name="radiance" value="1"/></emitter></shape>
    </scene>"""
    (tmp_path / "lamp.csv").write_text(PROFILE, encoding="utf-8")
    (tmp_path / "a.xml").write_text(text.replace("PROFILE",
                                                 '<string name="profile" value="lamp.csv"/>'))
    (tmp_path / "b.xml").write_text(text.replace("PROFILE", ""))
    place = np.array([[0.5 + 0.09 * step, 0.5] for step in range(6)])
    size = np.full(2, 0.001)
    shaped, plain = (patch_irradiance(read_scene(tmp_path / name, tmp_path), place, size)
                     for name in ("a.xml", "b.xml"))
    offset = 2 * (place[:, 0] - 0.5)
    # Straight lines between angles 2 degrees apart are within 6e-4 of cos^2; the lamp is 0.01 wide,
    # 0.5 degrees.
    np.testing.assert_allclose(shaped / plain, 4 / (4 + offset**2), rtol=2e-3)


def test_a_profile_of_one_changes_nothing(tmp_path):
    flat = with_profile(tmp_path, "0,3\n90,3\n")
    assert np.allclose(flat.scene_file.profiles["lamp"], 1) and len(flat.scene_file.files) == 1
    plain = replace(flat, scene_file=replace(flat.scene_file, profiles={}))
    # The same paths; a factor that is 1 up to the rounding of an interpolation.
    np.testing.assert_allclose(traced(flat).coefficients, traced(plain).coefficients, rtol=1e-5,
                               atol=1e-9)


def test_only_the_transport_engine_takes_a_lamp_with_a_profile(tmp_path):
    view = with_profile(tmp_path)
    with pytest.raises(InputError, match=r"box\.xml: only the transport engine knows the measured "
                                         r"profile of 'lamp'"):
        view.scene()


def test_a_profile_belongs_to_an_area_light(tmp_path):
    (tmp_path / "lamp.csv").write_text(PROFILE, encoding="utf-8")
    light = LIGHTS["point"].replace("<point", '<string name="profile" value="lamp.csv"/><point')
    with pytest.raises(InputError, match="only an area light can have a measured profile, and "
                       "'lamp' is of"):
        view_with(tmp_path, light)


@pytest.mark.parametrize("text, message", [
                             ("angle,radiance\n0,1\n", "needs two rows or more"),
                             ("0,1\n30;2\n", "needs two rows or more"),
                             ("0,1\n40,1\n20,1\n", "must rise from 0"),
                             ("10,1\n20,1\n", "must rise from 0"),
                             ("0,1\n120,1\n", "to at most 90"), ("0,1\n30,-1\n", "not negative"),
                             ("0,0\n30,1\n", "positive straight ahead"),
                             ("0,1\n30,inf\n", "must be finite")])
def test_a_broken_profile_is_refused_in_a_sentence(tmp_path, text, message):
    path = tmp_path / "lamp.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_profile(path)


def test_a_profile_is_relative_to_straight_ahead_and_holds_its_last_value(tmp_path):
    path = tmp_path / "lamp.csv"
    path.write_text("0,4\n60,2\n", encoding="utf-8")
    table = read_profile(path)
    np.testing.assert_allclose(relative_radiance(table,
                                                 np.cos(np.radians([0.0, 30.0, 60.0, 80.0]))),
                               [1, 0.75, 0.5, 0.5], atol=1e-12)  # round-off of arccos
    assert table.size == TABLE_DEG.size
