"""A lamp's beam from a photo of a white wall: what was put in comes out, within its errors."""
import dataclasses
import functools
import json

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.calibrate.lamp_beam import (
    WallTable,
    _mean_over_bands,
    fit_beam,
    read_wall,
    wall_cells,
)
from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind
from spectrabox.reconstruct.scene.scene_file import TABLE_DEG, read_profile
from spectrabox.session.cli import app

SIZE_MM = (1400.0, 900.0)
PHOTO = (210, 310)
CORNERS_PX = ((30.0, 25.0), (280.0, 15.0), (290.0, 195.0), (20.0, 185.0))
LAMP_MM, AIM_MM = (700.0, 450.0, 800.0), (740.0, 430.0)     # aimed 3.2 degrees aside
BEAMS = {"reflector": lambda angle: 0.9 * np.exp(-((angle / 22) ** 2) / 2)
         + 0.1 * np.cos(np.radians(angle)),
         "even": lambda angle: np.ones_like(angle),
         "cut off": lambda angle: 1 / (1 + np.exp((angle - 30) / 2.0)),
         "ring": lambda angle: 0.6 + 0.4 * np.sin(np.radians(4 * angle)) ** 2}


def table(**changes):
    return {"corners_px": [list(corner) for corner in CORNERS_PX], "size_mm": list(SIZE_MM),
            "lamp_at_mm": list(LAMP_MM), "lamp_size_mm": [60.0, 60.0]} | changes


def wall(**changes):
    return WallTable.model_validate(table(**changes))


def places_of(size):
    """Places (n, 2) on the wall that the pixels of a photo show."""
    corners = np.array([[0, SIZE_MM[1]], SIZE_MM, [SIZE_MM[0], 0], [0, 0]])
    to_wall = cv2.getPerspectiveTransform(np.array(CORNERS_PX, np.float32),
                                          corners.astype(np.float32)).astype(float)
    y, x = np.mgrid[0:size[0], 0:size[1]].astype(float)
    there = np.stack([x.ravel(), y.ravel(), np.ones(x.size)]).T @ to_wall.T
    return there[:, :2] / there[:, 2:]


@functools.cache
def irradiance(size, beam, stretch=1.0):
    """Of the places of a photo's pixels, summed over 8 x 8 points of the lamp."""
    places = places_of(size)
    lamp, aim = np.array(LAMP_MM), np.append(AIM_MM, 0.0)
    normal = (aim - lamp) / np.linalg.norm(aim - lamp)
    across = np.cross((0.0, 1.0, 0.0), normal)
    across /= np.linalg.norm(across)
    up = np.cross(normal, across)
    total = np.zeros(len(places))
    steps = (np.arange(8) + 0.5) / 8 - 0.5
    for u in 60 * steps:
        for v in 60 * steps:
            ray = np.column_stack([places, np.zeros(len(places))]) - (lamp + u * across + v * up)
            far = np.linalg.norm(ray, axis=1)
            cosine = np.clip(ray @ normal / far, 0, 1)
            # a beam that is wider across than up, where stretch is not 1
            tilt = np.hypot(ray @ across / stretch, ray @ up * stretch) / (ray @ normal)
            total += beam(np.degrees(np.arctan(tilt))) * cosine * -ray[:, 2] / far**3
    return total


def photo(beam, seed=0, noise=0.01, uneven=0.0, stretch=1.0, tint=None, size=PHOTO):
    """The wall as a camera that stands aside shows it, brightest 0.9."""
    rng = np.random.default_rng(seed)
    places = places_of(size)
    bands = [irradiance(size, each, stretch) for each in (tint or (beam,))]
    level = np.stack((bands * 3)[:3], axis=-1) / bands[0].max() * [0.9, 0.8, 0.5]
    # patches of paint 80 mm wide
    patches = rng.standard_normal((24, 40))[(places[:, 1] // 80).astype(int) % 24,
                                            (places[:, 0] // 80).astype(int) % 40]
    level *= (1 + uneven * patches)[:, None]
    variance = np.maximum((noise * level) ** 2, 1e-10)
    signal = level + np.sqrt(variance) * rng.standard_normal(level.shape)
    shape = (*size, 3)
    absent = {field.name: None for field in dataclasses.fields(LinearImage)}
    return LinearImage(**absent | {
        "signal": signal.reshape(shape).astype(np.float32),
        "variance": variance.reshape(shape).astype(np.float32),
        "saturated": np.zeros(shape, bool), "sensor_step": 1.0, "kind": PhotoKind.RAW,
        "camera": "a camera", "source": "wall", "sha256": ""})


def true_profile(beam, angles):
    return beam(angles) / beam(np.zeros(1))


@pytest.mark.parametrize("name", BEAMS)
def test_the_beam_that_lit_the_wall_is_found(name):
    beam = BEAMS[name]
    fit = fit_beam(*wall_cells(photo(beam), wall()), wall())
    truth = true_profile(beam, fit.angle_deg)
    # 1.3 mm in 800 of the lamp's size are not resolved, and 2 degrees of knots round an edge off
    np.testing.assert_allclose(fit.radiance, truth, atol=0.025 if name == "cut off" else 0.006)
    np.testing.assert_allclose(fit.axis_mm, AIM_MM, atol=3.0)
    assert fit.off_axis_deg == pytest.approx(3.2, abs=0.25)
    assert fit.angle_deg[-1] > 40 and fit.asymmetry < 0.01 and fit.band_difference < 0.02


def test_the_stated_errors_hold_on_an_uneven_wall_with_the_lamp_misplaced():
    """The lamp stands up to 8 mm from where it was said to, on paint uneven by 2 %."""
    rng, inside, counted = np.random.default_rng(11), 0, 0
    for seed in range(8):
        shift = 5.0 * rng.standard_normal(3)
        stated = wall(lamp_at_mm=(np.array(LAMP_MM) + shift).tolist(), lamp_error_mm=5.0)
        fit = fit_beam(*wall_cells(photo(BEAMS["reflector"], seed, uneven=0.02), stated), stated)
        truth = true_profile(BEAMS["reflector"], fit.angle_deg)
        at = np.array([10, 20, 30, 40])
        misses = np.abs(fit.radiance - truth)[at] / fit.standard_error[at]
        inside, counted = inside + np.count_nonzero(misses < 2), counted + len(at)
        assert np.all(misses < 5)
    # angles of one photo share their errors: of 8 photos that hold 95 % each, fewer than 6 at 0.6 %
    assert inside / counted >= 0.75


def test_a_beam_that_is_not_round_is_noticed():
    round_beam = fit_beam(*wall_cells(photo(BEAMS["reflector"]), wall()), wall())
    wide = fit_beam(*wall_cells(photo(BEAMS["reflector"], stretch=1.25), wall()), wall())
    assert round_beam.asymmetry < 0.02 < 0.1 < wide.asymmetry
    assert wide.standard_error[20] > 5 * round_beam.standard_error[20]


def test_a_beam_that_changes_colour_is_noticed():
    blue = [BEAMS["reflector"], BEAMS["reflector"], lambda angle: np.exp(-((angle / 18) ** 2) / 2)]
    fit = fit_beam(*wall_cells(photo(None, tint=blue), wall()), wall())
    assert fit.band_difference > 0.1


def test_readings_of_a_wall_err_by_the_noise_of_their_pixels():
    (_, first, first_variance), (_, second, second_variance) = (
        wall_cells(photo(BEAMS["reflector"], seed, noise=0.05), wall()) for seed in (1, 2))
    off = (first - second) ** 2 / (first_variance + second_variance)
    # some 2600 readings of three bands know a variance to 1.6 %
    assert off.size > 6000 and off.mean() == pytest.approx(1, abs=0.065)


@pytest.mark.parametrize("bands", [1, 3, 6])
def test_the_mean_over_bands_errs_as_draws_of_it_do(bands):
    rng = np.random.default_rng(12)
    level = rng.uniform(0.1, 1, bands)
    sigma = 0.05 * rng.uniform(0.5, 2, bands)
    signal = level + sigma * rng.standard_normal((8000, bands))
    estimate, variance = _mean_over_bands(
        signal, np.broadcast_to(sigma**2, signal.shape), level)
    # 8000 draws know a variance to 1.6 %
    assert estimate.var() / variance[0] == pytest.approx(1, abs=0.065)
    assert estimate.mean() == pytest.approx(1, abs=0.01)


def test_a_traced_wall_gives_the_profile_that_the_tracer_was_given(tmp_path):
    """The path tracer shares neither the sum over the lamp nor the geometry with the fit."""
    from spectrabox.radiometry.interreflection import signal
    from spectrabox.reconstruct.rendering.renderer import load_scene, start_mitsuba
    from spectrabox.reconstruct.scene.scene_file import read_scene
    from spectrabox.reconstruct.scene.scene_xml import scene_xml
    from spectrabox.reconstruct.tracer.transport import trace_transport
    from spectrabox.reconstruct.tracer.unit_scene import UnitScene
    start_mitsuba("cpu")
    given = BEAMS["reflector"](TABLE_DEG) / BEAMS["reflector"](np.zeros(1))
    (tmp_path / "beam.csv").write_text("".join(f"{angle},{value:.6f}\n" for angle, value in
                                               zip(TABLE_DEG, given, strict=True)))
    width, height = 60, 40
    (tmp_path / "wall.xml").write_text(f"""<scene version="3.0.0">
      <integrator type="path"><integer name="max_depth" value="2"/></integrator>
      <sensor type="perspective" id="camera"><float name="fov" value="60"/>
        <string name="fov_axis" value="x"/><transform name="to_world">
        <lookat origin="-500, 450, 1000" target="600, 450, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="{width}"/>
          <integer name="height" value="{height}"/></film></sensor>
      <bsdf type="diffuse" id="white"><spectrum name="reflectance" value="0.8"/></bsdf>
      <shape type="rectangle" id="wall"><ref id="white"/><transform name="to_world">
        <scale x="1500" y="1000"/><translate x="700" y="450"/></transform></shape>
      <shape type="rectangle" id="lamp"><transform name="to_world"><scale x="30" y="30"/>
        <lookat origin="700, 450, 800" target="740, 430, 0" up="0, 1, 0"/></transform>
        <emitter type="area"><string name="profile" value="beam.csv"/>
          <spectrum name="radiance" value="1"/></emitter></shape>
    </scene>""", encoding="utf-8")
    scene = read_scene(tmp_path / "wall.xml", tmp_path)
    ones = np.ones(2)
    loaded = load_scene(scene_xml(scene, reflectances={"white": ones}, light=ones,
                                  bands={"one": ones}, range_nm=(400.0, 700.0),
                                  size=(width, height)))
    traced = trace_transport(UnitScene(loaded, {"white": "white"}, (width, height), 1, None,
                                       scene.profiles),
                             np.arange(width * height).reshape(height, width), spp=1024, seed=4)
    light = signal(traced.coefficients, traced.exponents, np.full((1, 2), 0.8),
                   np.full((1, 2), 0.5))[:, 0]
    import mitsuba as mi
    across, down = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    ray, _ = loaded.sensors()[0].sample_ray(0.0, 0.5, mi.Point2f(across.ravel(), down.ravel()),
                                            mi.Point2f(0.5, 0.5))
    places = np.array(loaded.ray_intersect(ray).p)[:2].T.astype(float)
    inside = np.all((places > 0) & (places < SIZE_MM), axis=1)
    noise = traced.relative_variance[inside] * light[inside] ** 2
    fit = fit_beam(places[inside], light[inside, None], noise[:, None], wall())
    # pixels are up to 60 mm wide, 4 degrees, and paths have their noise
    np.testing.assert_allclose(fit.radiance, np.interp(fit.angle_deg, TABLE_DEG, given),
                               atol=0.02)
    np.testing.assert_allclose(fit.axis_mm, AIM_MM, atol=8.0)


# ---- the command ---------------------------------------------------------------------------------

def written(folder, image=None, **changes):
    image = photo(BEAMS["reflector"]) if image is None else image
    write_exr(folder / "wall.exr", image.signal, ["R", "G", "B"], 0.1)
    lines = [f"{key} = {json.dumps(value)}" for key, value in table(**changes).items()]
    (folder / "wall.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def call(folder, *words):
    return CliRunner().invoke(app, ["geometry", "beam", str(folder / "wall.exr"), "--wall",
                                    str(folder / "wall.toml"), "-o", str(folder / "beam.csv"),
                                    *words])


def test_the_file_that_is_written_is_a_lamp_s_profile(tmp_path):
    answer = call(written(tmp_path), "--json")
    assert answer.exit_code == 0, answer.output
    facts = json.loads(answer.output)
    profile = read_profile(tmp_path / "beam.csv")
    inside = facts["angle_deg"][-1] >= TABLE_DEG
    np.testing.assert_allclose(profile[inside], true_profile(BEAMS["reflector"], TABLE_DEG[inside]),
                               atol=0.006)
    np.testing.assert_allclose(profile[~inside], facts["radiance"][-1], rtol=1e-5)
    again = call(tmp_path)
    assert again.exit_code == 3 and "exists already" in again.output
    plain = " ".join(call(tmp_path, "--force").output.split())
    assert "without --flat-field the lens's own fall-off" in plain and "let look_at_mm" in plain


def test_a_flat_takes_the_fall_off_of_the_lens_out(tmp_path):
    image = photo(BEAMS["reflector"])
    y, x = np.mgrid[0:210, 0:310]
    fall_off = 1 / (1 + (np.hypot(x - 155, y - 105) / 250) ** 2) ** 2
    dimmed = dataclasses.replace(image, signal=(image.signal * fall_off[..., None]
                                                ).astype(np.float32))
    written(tmp_path, dimmed)
    rng = np.random.default_rng(3)
    card = 0.7 * fall_off[..., None] * (1 + 0.002 * rng.standard_normal((210, 310, 3)))
    write_exr(tmp_path / "flat.exr", card.astype(np.float32), ["R", "G", "B"], 0.1)
    truth = true_profile(BEAMS["reflector"], np.array([40.0]))
    values = []
    for words in ((), ("--flat-field", str(tmp_path / "flat.exr"), "--force")):
        answer = call(tmp_path, *words, "--json")
        assert answer.exit_code == 0, answer.output
        values.append(json.loads(answer.output)["radiance"][40])
    assert abs(values[0] - truth) > 0.04
    assert abs(values[1] - truth) < 0.01


def test_a_scene_of_a_box_takes_the_profile(tmp_path):
    from test_box_scene import template_box

    from spectrabox.reconstruct.scene.box_scene import box_xml
    from spectrabox.reconstruct.scene.scene_file import scene_of_text
    assert call(written(tmp_path)).exit_code == 0
    box = template_box(lamp={"at_mm": [50, 270, 380], "size_mm": [60, 60],
                             "look_at_mm": [0, 100, -200], "beam": "beam.csv"})
    scene = scene_of_text(box_xml(box, (312, 208)), tmp_path / "scene.xml", tmp_path)
    np.testing.assert_array_equal(scene.profiles["lamp"], read_profile(tmp_path / "beam.csv"))


@pytest.mark.parametrize(("change", "message"), [
    ({"lamp_at_mm": [700.0, 450.0, 40.0]}, "40 mm out of the wall"),
    ({"corners_px": [[30, 25], [290, 195], [280, 15], [20, 185]]}, "do not go round"),
    ({"corners_px": [[30, 25], [20, 185], [290, 195], [280, 15]]}, "counter-clockwise"),
    ({"corners_px": [[30, 25], [430, 15], [440, 195], [20, 185]]}, "lie outside the photo of 310"),
    ({"lamp_at_mm": [-900.0, 450.0, 800.0], "lamp_look_at_mm": [-900.0, 450.0]},
     "must hold the place that the lamp faces"),
    ({"size": [3.0, 4.0]}, "size"),
])
def test_a_wall_that_cannot_be_is_refused(tmp_path, change, message):
    image = photo(BEAMS["reflector"])
    if "lamp_look_at_mm" in change:     # the beam comes in from the side
        level = np.linspace(0.9, 0.1, 310)[None, :, None] * np.ones((210, 310, 3))
        image = dataclasses.replace(image, signal=level.astype(np.float32))
    refused = call(written(tmp_path, image, **change))
    assert refused.exit_code != 0 and "Traceback" not in refused.output
    assert message in " ".join(refused.output.split())
    assert not (tmp_path / "beam.csv").exists()


def test_a_photo_that_shows_no_beam_is_refused():
    image = photo(BEAMS["reflector"])
    clipped = dataclasses.replace(image, saturated=image.signal > 0.5)
    with pytest.raises(CheckError, match=r"of the rectangle is saturated; halve the exposure"):
        wall_cells(clipped, wall())
    dark = dataclasses.replace(image, signal=0 * image.signal)
    with pytest.raises(CheckError, match="the rectangle is dark"):
        fit_beam(*wall_cells(dark, wall()), wall())
    few = dataclasses.replace(image, **{name: getattr(image, name)[::20, ::20]
                                        for name in ("signal", "variance", "saturated")},
                              sensor_step=20.0)
    with pytest.raises(CheckError, match="photograph it larger"):
        wall_cells(few, wall())


def test_a_bent_photo_and_its_lens_give_the_same_places(tmp_path):
    from geometry_views import TRUE

    from spectrabox.calibrate.geometry.projection import undistorted
    image = photo(BEAMS["reflector"], size=(480, 640))
    straight, *_ = wall_cells(undistorted(image, TRUE), wall(), TRUE)
    # corners are of the bent photo: inside the rectangle lies what lay inside it there
    plain, *_ = wall_cells(image, wall())
    assert abs(len(straight) - len(plain)) < 30
    np.testing.assert_allclose(straight.mean(axis=0), plain.mean(axis=0), atol=3)


def test_a_file_that_is_no_wall_is_said(tmp_path):
    (tmp_path / "wall.toml").write_text("size_mm = [1, 2]\nlamp = 3\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"corners_px.*is missing"):
        read_wall(tmp_path / "wall.toml")
