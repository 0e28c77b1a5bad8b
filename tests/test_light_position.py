"""A light that stands elsewhere than the scene says is found, with errors that hold, and refused
where it cannot be.
"""
import json

import numpy as np
import pytest
from cornell_problem import GRID, camera, photo_of
from typer.testing import CliRunner

from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.fixtures.demos.demo_scenes import box_scene
from spectrabox.radiometry.errors import CalibrationError, InputError
from spectrabox.radiometry.interreflection import response_matrix, signal
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.reconstruct.rendering.renderer import load_scene, render
from spectrabox.reconstruct.scene.edit_scene import light_number, move_light, with_light_moved
from spectrabox.reconstruct.scene.light_position import refine_light_position
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.scene.scene_xml import scene_xml
from spectrabox.reconstruct.tracer.transport import trace_transport
from spectrabox.reconstruct.tracer.unit_scene import UnitScene
from spectrabox.session.cli import app

pytestmark = pytest.mark.usefixtures("mitsuba")

SIZE = (36, 24)
TRUE_OFFSET_CM = np.array([-2.0, 1.5, 1.6])  # 3 cm from where the scene has the light
PAINTS = {"white": 0.8 + 0 * GRID.nm, "green": 0.15 + 0.25 * np.exp(-((GRID.nm - 530) / 40) ** 2),
          "red": 0.1 + 0.4 / (1 + np.exp((600 - GRID.nm) / 15)), "cube": 0.3 + 0 * GRID.nm}
TRUE_SCALE = 80.0
POINT = '<emitter type="point" id="bulb"><point name="position" x="5" y="27" z="38"/></emitter>'


def box(folder, change=lambda text: text, depth=3):
    path = folder / "box.xml"
    path.write_text(change(box_scene((SIZE[1], SIZE[0]), max_depth=depth)), encoding="utf-8")
    return read_scene(path)


def as_point(text):
    start, end = text.index('<shape type="sphere" id="light">'), text.index("</shape>") + len(
        "</shape>")
    return text[:start] + POINT + text[end:]


def response():
    return response_matrix(GRID, camera().sensitivity.curves, camera().light.values)


def photo(scene, offset):
    """By Mitsuba's own path integrator and spectral film: neither the traced transport nor its
    algebra.
    """
    moved = with_light_moved(scene, 0, np.asarray(offset))
    bands = dict(zip("RGB", camera().sensitivity.curves, strict=True))
    image, variance = render(load_scene(scene_xml(moved, reflectances=PAINTS,
                                                  light=camera().light.values, bands=bands,
                                                  range_nm=(400.0, 700.0), size=SIZE,
                                                  integrator="path")), 256, 4, 4)
    # The bands of this photo share their paths' noise, unlike a camera's: as three readings it
    # would count thrice.
    noise = 3 * np.tile(variance.mean(axis=2, keepdims=True), 3) + 1e-9 * image.max() ** 2
    return photo_of(TRUE_SCALE * image, TRUE_SCALE**2 * noise)


@pytest.mark.parametrize("change", [lambda text: text, as_point], ids=["sphere", "point"])
def test_a_light_three_centimetres_off_is_found_within_its_standard_error(tmp_path, change):
    light = refine_light_position(box(tmp_path, change), PAINTS, response(),
                                  photo(box(tmp_path, change), TRUE_OFFSET_CM),
                                  spp=32)
    assert light.outcome is Outcome.CONVERGED and light.chi_square < min(
        light.chi_square_before / 3, 1.5)
    # Three normal numbers: all within 3.5 standard errors at a significance of 1.4e-3.
    assert np.all(np.abs(light.offset - TRUE_OFFSET_CM) < 3.5 * light.standard_error)
    assert np.all(light.standard_error < 0.5)  # the errors say something: a sixth of the way
    assert abs(light.light_scale - TRUE_SCALE) < 3.5 * light.light_scale_standard_error
    # Gauss and Newton: with right slopes one step leaves the bend of the squared distance alone.
    left = np.linalg.norm(light.offsets[1] - light.offset) / np.linalg.norm(light.offset)
    assert left < 0.3, left


def light_centre(scene):
    """As Mitsuba loads it."""
    import mitsuba as mi
    loaded = load_scene(scene_xml(scene, reflectances=dict.fromkeys(PAINTS, np.ones(2)),
                                  light=np.ones(2), bands={"one": np.ones(2)},
                                  range_nm=(400.0, 700.0), size=(4, 4)))
    parameters = mi.traverse(loaded)
    name = next(key for key in parameters.keys()  # noqa: SIM118  Mitsuba's own kind of mapping
                if key.endswith(("light.to_world", "bulb.position")))
    place = parameters[name]
    return np.array(place.translation() if name.endswith("to_world") else place).ravel()


@pytest.mark.parametrize("change", [
                             lambda text: text, as_point,
                             lambda text: as_point(text).replace('x="5" y="27" z="38"',
                                                                 'value="5, 27 38"')])
def test_a_light_is_moved_wherever_its_position_is_written(tmp_path, change):
    scene = box(tmp_path, change)
    # single precision of 38 cm
    np.testing.assert_allclose(light_centre(scene), [5, 27, 38], atol=1e-5)
    np.testing.assert_allclose(light_centre(with_light_moved(scene, 0, np.array([1, 2, 3.0]))),
                               [6, 29, 41], atol=1e-5)


def test_what_cannot_be_refined_is_refused(tmp_path):
    scene, shown = box(tmp_path), photo_of(np.full((SIZE[1], SIZE[0], 3), 0.5))
    with pytest.raises(InputError, match="has no light 'lamp'; it has light"):
        refine_light_position(scene, PAINTS, response(), shown, light_id="lamp")
    with pytest.raises(InputError, match=r"the reflectance of cube in box\.xml is not given"):
        refine_light_position(scene, {name: PAINTS[name] for name in ("white", "green", "red")},
                              response(), shown)
    dark = photo_of(np.full((SIZE[1], SIZE[0], 3), 0.5), saturated=np.ones((SIZE[1], SIZE[0], 3),
                                                                           bool))
    with pytest.raises(InputError, match="0 blocks of single surfaces can be compared"):
        refine_light_position(scene, PAINTS, response(), dark)
    both = box(tmp_path, lambda text: text.replace("</scene>", POINT + "</scene>"))
    with pytest.raises(InputError, match="has 2 lights; say which: light, bulb"):
        light_number(both, None)
    assert light_number(both, "bulb") == 1
    sky = box(tmp_path, lambda text: as_point(text).replace(POINT,
                                                            '<emitter type="constant" id="sky"/>'))
    with pytest.raises(InputError,
                       match="the light 'sky' is of type 'constant', which has no position"):
        light_number(sky, None)
    behind = box(tmp_path, lambda text: as_point(text).replace('z="38"', 'z="-500"'))
    with pytest.raises(InputError, match="the light reaches"):
        refine_light_position(behind, PAINTS, response(), shown, spp=4)
    words = box(tmp_path, lambda text: as_point(text).replace('x="5"', 'x="$x"'))
    with pytest.raises(InputError, match="is not three numbers"):
        move_light(words.root, 0, np.zeros(3))


def test_a_distant_light_has_no_position(tmp_path):
    far = box(tmp_path, lambda text: as_point(text).replace('x="5" y="27" z="38"',
                                                            'x="5000" y="27000" z="380000"'))
    with pytest.raises(CalibrationError, match="does not tell where the light is"):
        refine_light_position(far, PAINTS, response(), photo(far, np.zeros(3)),
                              spp=4)


def test_the_command_writes_the_scene_with_the_light_where_it_was(tmp_path):
    depth_two = box(tmp_path, depth=2)
    shown = photo(depth_two, TRUE_OFFSET_CM)
    write_exr(tmp_path / "photo.exr", shown.signal, ["R", "G", "B"], 0.1)
    for name, columns in (("paints.csv", PAINTS), ("light.csv", {"lamp": camera().light.values}),
                          ("camera.csv", dict(zip("RGB", camera().sensitivity.curves,
                                                  strict=True)))):
        rows = [["wavelength_nm", *columns], *zip(GRID.nm, *columns.values(), strict=True)]
        (tmp_path / name).write_text("\n".join(",".join(map(str, row)) for row in rows),
                                     encoding="utf-8")
    arguments = ["geometry", "light", tmp_path / "photo.exr", "--scene", tmp_path / "box.xml",
                 "--light",
                 tmp_path / "light.csv", "--sensitivity", tmp_path / "camera.csv", "--reflectances",
                 tmp_path / "paints.csv", "--out", tmp_path / "moved.xml", "--width", 36, "--spp",
                 32, "--device", "cpu"]
    outcome = CliRunner().invoke(app, [*map(str, arguments), "--json"], catch_exceptions=False)
    assert outcome.exit_code == 0, outcome.output
    facts = json.loads(outcome.stdout)
    np.testing.assert_allclose(light_centre(read_scene(tmp_path / "moved.xml")) - facts["offset"],
                               [5, 27, 38], atol=1e-5)  # single precision of 38 cm
    # As above; the file's noise is judged from its pixels, which are few: twice as far.
    assert np.all(np.abs(facts["offset"] - TRUE_OFFSET_CM) < 7 * np.array(facts["standard_error"]))
    assert facts["chi_square"] < facts["chi_square_before"] / 3
    again = CliRunner().invoke(app, [*map(str, arguments)])
    assert again.exit_code == 3 and "exists already" in again.stderr
    lines = (tmp_path / "paints.csv").read_text(encoding="utf-8").splitlines()
    percent = [lines[0]] + [",".join([row[0], *(str(100 * float(value)) for value in row[1:])])
                            for row in (line.split(",") for line in lines[1:])]
    (tmp_path / "paints.csv").write_text("\n".join(percent), encoding="utf-8")
    percent_given = CliRunner().invoke(app, [*map(str, arguments), "--force"])
    assert percent_given.exit_code == 3 and "looks like percent" in percent_given.stderr


def test_the_beam_of_a_lamp_is_part_of_what_its_place_explains(tmp_path):
    """A spot of which the fit knew no beam would be looked for where its light is wider."""
    (tmp_path / "beam.csv").write_text("".join(
        f"{angle},{np.exp(-((angle / 25) ** 2) / 2):.6f}\n" for angle in range(0, 91, 3)),
        encoding="utf-8")
    spot = ('<shape type="rectangle" id="light"><transform name="to_world"><scale value="1.5"/>'
            '<lookat origin="5, 27, 38" target="-3, 8, -25" up="0, 1, 0"/></transform>'
            '<emitter type="area"><spectrum name="radiance" value="1"/>'
            '<string name="profile" value="beam.csv"/></emitter></shape>')

    def as_spot(text):
        start, end = text.index('<shape type="sphere" id="light">'), text.index("</shape>") + len(
            "</shape>")
        return text[:start] + spot + text[end:]

    scene = box(tmp_path, as_spot)
    assert set(scene.profiles) == {"light"}
    moved = with_light_moved(scene, 0, TRUE_OFFSET_CM)
    ones = np.ones(2)
    bsdfs = tuple(dict.fromkeys(scene.surfaces.values()))
    # other paths than the fit's, and the profile given by hand
    unit = UnitScene(load_scene(scene_xml(moved, reflectances=dict.fromkeys(bsdfs, ones),
                                          light=ones, bands={"one": ones}, range_nm=(400.0, 700.0),
                                          size=SIZE)),
                     {bsdf: bsdf for bsdf in bsdfs}, SIZE, 2, profiles=scene.profiles)
    traced = trace_transport(unit, np.arange(SIZE[0] * SIZE[1]).reshape(SIZE[1], SIZE[0]), spp=256,
                             seed=77)
    image = signal(traced.coefficients, traced.exponents, np.array([PAINTS[one] for one in bsdfs]),
                   response()).reshape(SIZE[1], SIZE[0], 3)
    noise = 3 * np.maximum(traced.relative_variance.reshape(SIZE[1], SIZE[0], 1) * image**2,
                           1e-9 * image.max() ** 2)
    light = refine_light_position(scene, PAINTS, response(),
                                  photo_of(TRUE_SCALE * image, TRUE_SCALE**2 * noise),
                                  spp=64)
    assert light.chi_square < 1.5
    assert np.all(np.abs(light.offset - TRUE_OFFSET_CM) < 3.5 * light.standard_error)
