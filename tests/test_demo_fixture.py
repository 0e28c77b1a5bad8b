"""The demo session against physics written down a second time: inverse square, integrals,
geometry.
"""
from __future__ import annotations

import numpy as np
import pytest
import rawpy
from scipy.interpolate import BSpline

from spectrabox.fixtures import lamp
from spectrabox.fixtures.chart_scene import homography
from spectrabox.fixtures.demos import box_render
from spectrabox.fixtures.demos.box_render import box_light
from spectrabox.fixtures.demos.demo_photos import (
    BLACK,
    FULL_WELL_ELECTRONS,
    GAIN,
    READ_NOISE_DN,
    WHITE,
    camera_sensitivities,
    chart_corners,
    light_factor,
    vignetting,
)
from spectrabox.fixtures.demos.demo_scenes import (
    BOX_LIGHT_CM,
    CHART_CM,
    LIGHT_RADIUS_CM,
    chart_scene_xml,
)
from spectrabox.fixtures.demos.demo_session import PAINTS, write_demo_session
from spectrabox.fixtures.paints import FORMULAS, NM, chart_copy, paint
from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.rendering.llvm import ensure_llvm

SIZE = (208, 312)               # rows, columns of the small photos
FILES = ["session.toml", "photos/box.dng", "photos/chart.dng", "photos/flat.dng", "scene/box.xml",
         "scene/chart.xml", "spectra/light.csv", "spectra/truth_sensitivity.csv",
         *(f"spectra/truth_{name}.csv" for name in ("white", "green", "red", "cube"))]


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo") / "session"
    write_demo_session(folder, seed=3, size=SIZE, spp=16)
    return folder


def bands(folder, name):
    """Signal (H/2, W/2, 3) without vignetting, and the exposure in s."""
    with rawpy.imread(str(folder / "photos" / f"{name}.dng")) as raw:
        # LibRaw lists black by colour R, G, B, second G; the file by place R, G, G, B.
        assert list(raw.black_level_per_channel) == [BLACK[0], BLACK[1], BLACK[3], BLACK[2]]
        assert raw.white_level == WHITE
        counts, exposure_s = raw.raw_image_visible.astype(float), raw.other.shutter_speed
    tiles = [(slice(place // 2, None, 2), slice(place % 2, None, 2)) for place in range(4)]
    red, green1, green2, blue = [(counts[tile] - black) / (WHITE - black) / vignetting(SIZE)[tile]
                                 for tile, black in zip(tiles, BLACK, strict=True)]
    return np.stack([red, (green1 + green2) / 2, blue], axis=-1), exposure_s


def seen(spectrum):
    """Integrals (3,) of a radiance (P,) at ``NM`` by Simpson's rule: not the fixture's
    trapezoid.
    """
    weights = np.r_[1, np.tile([4, 2], NM.size // 2 - 1), 4, 1] / 3
    return camera_sensitivities() @ (weights * spectrum)


def pixel_noise(signal):
    """Standard deviation of the signal of one pixel."""
    return np.sqrt(signal / FULL_WELL_ELECTRONS + (READ_NOISE_DN / (WHITE - max(BLACK))) ** 2)


@pytest.mark.parametrize("name", FORMULAS)
def test_paints_are_reflectances_that_no_spline_of_the_inversion_is(name):
    nm, reflectance = paint(name)
    assert 0.03 < reflectance.min() < reflectance.max() < 0.9
    inside = (nm >= 400) & (nm <= 700)
    knots = np.r_[[400.0] * 3, np.linspace(400, 700, 19), [700.0] * 3]
    basis = BSpline.design_matrix(nm[inside], knots, 3).toarray()
    fit = basis @ np.linalg.lstsq(basis, reflectance[inside], rcond=None)[0]
    # One-sided: a spectrum made in the basis would leave round-off, about 1e-15.
    assert np.max(np.abs(fit - reflectance[inside])) > 1e-4


def test_the_same_seed_gives_the_same_bytes(session, tmp_path):
    write_demo_session(tmp_path / "again", seed=3, size=SIZE, spp=16)
    for name in FILES:
        assert (tmp_path / "again" / name).read_bytes() == (session / name).read_bytes(), name


def test_a_folder_with_a_session_is_left_alone(session):
    before = (session / "session.toml").read_bytes()
    with pytest.raises(InputError,
                       match=r"already holds session\.toml; give a new or empty folder"):
        write_demo_session(session, seed=4)
    assert (session / "session.toml").read_bytes() == before


@pytest.mark.parametrize("there", [(), ("notes.txt",)])
def test_a_demo_that_is_interrupted_leaves_nothing_that_the_next_would_refuse(tmp_path, there):
    folder = tmp_path / "demo"
    for name in there:
        folder.mkdir()
        (folder / name).write_text("mine", encoding="utf-8")

    def interrupt(done, _):
        if done > 0.05:
            raise KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt):
        write_demo_session(folder, size=(52, 78), spp=4, progress=interrupt)
    assert [path.name for path in tmp_path.rglob("*") if path != folder] == list(there)
    assert folder.exists() == bool(there)
    write_demo_session(folder, size=(52, 78), spp=4)


def test_progress_ends_at_one(tmp_path):
    fractions = []
    write_demo_session(tmp_path, progress=lambda fraction, phrase: fractions.append(fraction),
                       size=(52, 78), spp=4)
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1


@pytest.mark.parametrize("patch", range(24))
def test_a_patch_reads_what_lamp_paint_and_distance_say(session, patch):
    signal, exposure_s = bands(session, "chart")
    row, column = divmod(patch, 6)
    centre_cm = np.array([[4.35 * (column - 2.5), -4.35 * (row - 1.5)]])
    corners_cm, corners_px = chart_corners(SIZE)
    x, y, w = homography(corners_cm, corners_px) @ np.append(centre_cm[0], 1)
    i, j = round(y / w / 2 - 0.25), round(x / w / 2 - 0.25)
    measured = signal[i - 2:i + 3, j - 2:j + 3].mean(axis=(0, 1))
    chart = chart_copy(np.random.default_rng(3).spawn(5)[0])
    expected = GAIN * exposure_s * light_factor(centre_cm)[0] * seen(chart[patch]
                                                                     * lamp.radiance(NM))
    # Noise of 25 pixels, 4.5 sigma (72 comparisons), and 0.1 % for the patch's own gradient within
    # the 5 x 5 window.
    assert np.all(np.abs(measured - expected) < 4.5 * pixel_noise(expected) / 5 + 1e-3 * expected)


def test_the_scene_file_sees_the_chart_where_the_photo_shows_it():
    ensure_llvm()
    import mitsuba as mi
    mi.set_variant("llvm_ad_spectral")
    scene = mi.load_string(chart_scene_xml(SIZE))
    corners_cm, corners_px = chart_corners(SIZE)
    film_point = mi.Point2f(*((corners_px.T + 0.5) / [[SIZE[1]], [SIZE[0]]]))
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, film_point, mi.Point2f(0.5))
    uv = np.array(scene.ray_intersect(ray).uv).T
    # Single precision over a distance of 90 cm: about 1e-5 of the chart.
    np.testing.assert_allclose(uv, 0.5 + corners_cm / CHART_CM, atol=1e-4)


@pytest.mark.parametrize("x_cm, tinted_band", [(20.0, 0), (-20.0, 1)])
def test_the_floor_gets_direct_light_and_some_from_the_wall_beside_it(session, x_cm, tinted_band):
    signal, exposure_s = bands(session, "box")
    point = np.array([x_cm, 0.0, -8.0])       # 4 cm from the red wall or the green one
    # the scene's camera stands at (0, 16.5, 69)
    focal_px = SIZE[1] / 2 / np.tan(np.radians(37.3 / 2))
    x = SIZE[1] / 2 + focal_px * point[0] / (69 - point[2])
    y = SIZE[0] / 2 + focal_px * 16.5 / (69 - point[2])
    i, j = int(y / 2), int(x / 2)
    measured = signal[i - 1:i + 2, j - 2:j + 3].mean(axis=(0, 1))
    to_light = BOX_LIGHT_CM - point
    factor = LIGHT_RADIUS_CM**2 * to_light[1] / np.linalg.norm(to_light) ** 3
    direct = GAIN * exposure_s * factor * seen(paint("white_wall")[1] * lamp.radiance(NM))
    assert np.all(measured > direct)
    assert np.all(measured < 1.5 * direct)
    assert np.argmax(measured / direct) == tinted_band


def test_a_number_of_paths_that_cannot_be_repeated_is_refused():
    with pytest.raises(ValueError, match="48 paths per pixel were asked for; give one of 4, 16, "
                       "64, 256"):
        box_light(NM, {}, NM, camera_sensitivities(), size=SIZE, spp=48, seed=1, progress=print)


def test_interreflections_at_a_quarter_of_the_resolution_are_those_at_the_full_one(monkeypatch):
    reflectances = {name: paint(of)[1] for name, of in PAINTS.items()}
    size, photos = (416, 624), []
    for width, step in ((156, 4), (624, 1)):
        monkeypatch.setattr(box_render, "COARSE_WIDTH", width)
        assert box_render.coarse_step(size) == step
        photos.append(box_light(NM, reflectances, lamp.radiance(NM), camera_sensitivities(),
                                size=size, spp=16, seed=step))
    coarse, fine = photos
    whole = coarse.mean(axis=(0, 1)) / fine.mean(axis=(0, 1))
    # Noise of 4 million paths, each 25 % of the signal: 4.5 sigma are 0.06 %; as much for the
    # curvature of the light within the window, which is twice that of the demo's photo.
    np.testing.assert_allclose(whole, 1, atol=1.2e-3)
    blocks = [box_render.block_means(photo, 52) for photo in photos]
    off = np.sqrt(np.mean((blocks[0] / blocks[1] - 1) ** 2))
    assert off < 8e-3   # one-sided: the noise of two times 43 000 paths is 0.4 %


@pytest.mark.parametrize("step", [1, 4])
def test_smoothing_keeps_a_gradient_and_mixes_no_two_faces(step):
    faces = np.zeros((64, 96), int)
    faces[:, 41:] = 1
    rows, columns = np.mgrid[:64, :96]
    light = np.where(faces == 0, 3 + 0.02 * rows, 8 - 0.03 * columns)[..., None]
    coarse = box_render.block_means(light, step)
    smooth = box_render.smooth_within_faces(coarse, np.ones(coarse.shape[:2]), faces, step)
    inside = np.s_[4 * step:-4 * step, 4 * step:-4 * step]      # the whole window in the frame
    # At the border of the faces the fit leans to a constant: a fifth of the change over a window.
    edge = 0.2 * 0.03 * box_render.WINDOW_PX * step
    np.testing.assert_allclose(smooth[inside], light[inside], atol=edge)
    far = inside[0], np.r_[4 * step:41 - 5 * step, 41 + 5 * step:96 - 4 * step]
    # 1e-12: round-off of sums of 49 values of about 5
    np.testing.assert_allclose(smooth[far], light[far], atol=1e-12)
