"""Lens and light scale of a session."""
from fractions import Fraction

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from spectrabox.calibrate.geometry.lens import Lens, write_lens
from spectrabox.capture.photo.raw import read_raw
from spectrabox.fixtures.demos.box_render import box_light
from spectrabox.fixtures.demos.demo_photos import camera_sensitivities, exposure_for, take_photo
from spectrabox.fixtures.demos.demo_session import PAINTS
from spectrabox.fixtures.dng import write_dng
from spectrabox.fixtures.lamp import radiance
from spectrabox.fixtures.paints import NM, paint
from spectrabox.measure.steps.inversion import scale_of_view
from spectrabox.radiometry.error_model import REPEATABILITY
from spectrabox.reconstruct import scene_estimate
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import load_finished
from spectrabox.session.pipeline import run_stages

pytestmark = pytest.mark.usefixtures("light_as_stated")

SIZE = (208, 312)
# of the box's white back wall and, in the chart photo, a patch


def run(config):
    return run_stages(config, device="cpu", only=None, force=False,
                      progress=lambda *_: None).records


def append(folder, text):
    with (folder / "session.toml").open("a", encoding="utf-8") as stream:
        stream.write(text)
    return read_session(folder)


def scene_lens(folder, k1):
    """The lens of the scene's own camera, with barrel distortion."""
    root = read_scene(folder / "scene" / "box.xml").root
    fov = float(root.find("sensor/float[@name='fov']").get("value"))
    focal = SIZE[1] / 2 / np.tan(np.radians(fov) / 2)
    matrix = np.array([[focal, 0, SIZE[1] / 2 - 0.5], [0, focal, SIZE[0] / 2 - 0.5], [0, 0, 1]])
    return Lens(SIZE[1], SIZE[0], matrix, np.array([k1, 0, 0, 0, 0]), np.zeros(4), np.zeros(5), 0.0,
                "as made")


def test_a_photo_through_a_distorting_lens_is_undistorted(captured, finished, monkeypatch):
    # of what a lens bends, an estimate of the camera's pose would make good two thirds
    monkeypatch.setattr(scene_estimate, "DISAGREEMENT", np.inf)
    lens = scene_lens(captured, -0.25)
    reflectances = {name: paint(of)[1] for name, of in PAINTS.items()}
    box = box_light(NM, reflectances, radiance(NM), camera_sensitivities(), size=SIZE, spp=4,
                    seed=3,
                    progress=lambda *_: None)
    columns_and_rows = np.meshgrid(np.arange(SIZE[1]), np.arange(SIZE[0]))
    pixels = np.stack(columns_and_rows, axis=-1).reshape(-1, 1, 2).astype(float)
    straight = cv2.undistortPoints(pixels, lens.matrix, lens.distortion,
                                   P=lens.matrix).reshape(*SIZE, 2)
    bent = np.stack([map_coordinates(box[..., k], [straight[..., 1], straight[..., 0]], order=1,
                                     mode="nearest")
                     for k in range(3)], axis=-1)
    (captured / "photos" / "box.dng").unlink()
    take_photo(captured / "photos" / "box.dng", bent, exposure_for(box, 0.7),
               np.random.default_rng(6))
    crooked = run(read_session(captured)).reconstruct.joint.views[0]
    write_lens(captured / "lens.json", lens)
    mended = run(append(captured, '\n[camera]\nlens = "lens.json"\n')).reconstruct.joint.views[0]
    whole = load_finished(read_session(finished)).records.reconstruct.joint.views[0]
    off = [np.abs(made.signal / whole.signal - 1).max() for made in (crooked, mended)]
    assert off[1] < off[0] / 2, off
    # the two photos differ in noise and in pixels near edges; one of twelve signals beyond three
    # standard errors would be seen in three of a hundred such pairs
    error = np.sqrt(np.einsum("mjj->mj", whole.signal_covariance + mended.signal_covariance))
    assert np.abs((mended.signal - whole.signal) / error).max() < 3
    # and one percent of white, which an undistorted photo is good for whatever its errors say
    assert np.abs(mended.signal - whole.signal).max() < 0.01


def dim(folder, factor):
    """The object photo as a lamp of that strength would have made it."""
    path = folder / "photos" / "box.dng"
    frame = read_raw(path)
    black = np.tile(frame.black_level, np.array(frame.mosaic.shape) // 2)
    mosaic = np.clip((frame.mosaic - black) * factor + black, 0, 15871).round().astype(np.uint16)
    path.unlink()
    write_dng(path, mosaic, black=tuple(frame.black_level[[0, 0, 1, 1], [0, 1, 0, 1]]),
              white=int(frame.white_level),
              exposure_s=Fraction(frame.exposure_s).limit_denominator(100000),
              f_number=frame.f_number, iso=int(frame.iso), make="Spectrabox",
              model="Synthetic 5100", serial="DEMO-1")


def test_light_and_shutter_are_taken_to_repeat_as_stated(finished):
    config = read_session(finished)
    scale = load_finished(config).records.reconstruct.joint.views[0].light_scale
    errors = scale.common_errors
    # Round-off: 1.2 % of the light and 0.9 % of the shutter.
    assert errors[REPEATABILITY] == pytest.approx(0.015, rel=1e-12)
    assert scale.standard_error / scale.value >= 0.015


def test_a_chart_in_the_object_photo_itself_has_seen_the_same_light(captured, finished):
    made = load_finished(read_session(finished))
    records = made.records
    calibration, = records.calibrations(made.capture.views)
    path = captured / "session.toml"
    path.write_text(path.read_text().replace("photos/box.dng", "photos/chart.dng"))
    capture = read_session(captured).capture()
    scale = scale_of_view(capture, capture.views[0], records.charts[""].thumbnail,
                          calibration, records)
    assert REPEATABILITY not in scale.common_errors
