"""Cameras, corners and scenes of a measured box, recorded: as a tape, marks or a COLMAP model has
them.
"""
import tomllib

import numpy as np
import pytest
import test_recorded_sessions_box as box
from colmap_views import PLACES, pixels, write_model
from whole_sessions import compact, shoot, text_and_numbers

from spectrabox.calibrate.geometry.lens import Lens
from spectrabox.calibrate.geometry.lens_files import write_lens
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.session.box.box_camera import (
    corners_in_photo,
    found_camera,
    lens_of_view,
    marked_corners,
    size_of_photo,
    straight_corners,
)
from spectrabox.session.box.camera_facts import camera_facts, camera_text
from spectrabox.session.box.scene_files import box_views, overlay, write_overlays, write_scene_files
from spectrabox.session.box.scene_geometry import scene_geometry
from spectrabox.session.config.session_schema import SessionConfig

SAID = tomllib.loads(box.TOML.format(corners="{ }"))
MARKS = box.marks(np.random.default_rng(4))


@pytest.fixture
def described(tmp_path):
    """A function of the first camera, and more of [scene.box], that gives a session."""
    rng = np.random.default_rng(2)
    for number, name in enumerate(("box", "side", "turned")):
        grey = np.full((208, 312, 3), 0.1 + 0.1 * number) * np.linspace(0.5, 1.5, 312)[:, None]
        shoot(tmp_path / "photos" / f"{name}.dng", grey, 1, rng)

    def made(camera, lens=None, side=None, **more):
        said = SAID | {"scene": {"box": SAID["scene"]["box"] | {"camera": camera} | more}}
        if lens is not None:
            write_lens(tmp_path / "lens.json", lens)
            said |= {"camera": {"lens": "lens.json"}}
        if side is not None:
            said |= {"views": SAID["views"] | {"side": {"photo": "photos/side.dng", "turn_deg": 35,
                                                        "camera": side}}}
        return SessionConfig(folder=tmp_path, allow_outside=False, **said)
    return made


def lens():
    focal = box.SIZE[1] / 2 / np.tan(np.radians(37.5) / 2)
    return Lens(312, 208, np.array([[focal, 0, 154.6], [0, 1.002 * focal, 104.2], [0, 0, 1]]),
                np.array([-0.02, 0.01, 0.0005, -0.0004, 0.002]), np.array([1.0, 1.1, 0.4, 0.3]),
                np.full(5, 1e-3), 0.2, "measured")


MEASURED = {"at_mm": [5, 170, 700], "look_at_mm": [8, 160, -10], "up": [0.02, 1, 0.01],
            "fov_deg": 38}
CAMERAS = {"measured": (MEASURED, None), "marks": ({"corners_px": MARKS}, None),
           "marks and field": ({"corners_px": MARKS, "fov_deg": 37.3}, None),
           "marks and lens": ({"corners_px": MARKS}, lens())}


def said_of(config, view):
    camera = found_camera(config, view)
    straight, marked = straight_corners(config, view)
    assert set(marked) == set(marked_corners(config, view))
    return {"facts": compact(camera_facts(camera)), "text": camera_text(view.name, camera),
            "sensor": {name: np.asarray(value) if isinstance(value, list | tuple | np.ndarray)
                       else str(value) for name, value in camera.sensor.items()},
            "corners": corners_in_photo(config, view), "marked": marked_corners(config, view),
            "straight": straight, "marks": marked, "size": size_of_photo(config, view),
            "lens": None if lens_of_view(config, view) is None else "one"}


@pytest.mark.parametrize("name", list(CAMERAS))
def test_where_cameras_of_a_box_stood(recorded, described, name):
    config = described(*CAMERAS[name])
    for view in config.all_views:
        found = said_of(config, view)
        for corner, px in found["marked"].items():      # a hand of 0.2 pixels marked them
            if name != "marks and lens":
                assert np.hypot(*np.subtract(px, found["corners"][corner])) < 1 or view.name
        # searched for: of some pixels, to the last digit of a solver
        recorded(found, 1e-5, case=view.name or "first")
    recorded({"geometry": scene_geometry(config),
              "views": [view.name for view in box_views(config)]}, 1e-5, case="geometry")


def test_scenes_and_pictures_of_a_box(recorded, described, tmp_path):
    config = described({"corners_px": MARKS})
    written = write_scene_files(config)
    drawn = write_overlays(config)
    recorded({path.name: text_and_numbers(path.read_text(encoding="utf-8")) for path in written},
             1e-5)
    recorded({"names": [path.name for path in drawn], "pixels": [
        overlay(config, view).astype(float) for view in box_views(config)]}, 1e-2, case="drawn")


def test_cameras_of_a_model(recorded, described, tmp_path):
    write_model(tmp_path / "colmap")
    corners = {name: at for name, at in described(MEASURED).box.corner_positions().items()
               if name.startswith("back")}
    rng = np.random.default_rng(3)
    marks = {picture: {name: (px + 0.1 * rng.standard_normal(2)).tolist() for name, px in zip(
        corners, pixels("OPENCV", picture, list(corners.values())), strict=True)}
        for picture in list(PLACES)[:2]}
    config = described({"image": "box.jpg"}, side={"image": "left.jpg"},
                       colmap={"folder": "colmap", "corners_px": marks})
    for view in config.all_views[:2]:
        found = said_of(config, view)
        stood = PLACES["left.jpg" if view.name else "box.jpg"][0]
        assert np.linalg.norm(np.subtract(found["facts"][".at_mm[]"], stood)) < 10
        recorded(found, 1e-4, case=view.name or "first")
    recorded(scene_geometry(config), 1e-4, case="geometry")
    # a picture in which nobody marked a corner is placed by those of the others
    unmarked = described({"image": "right side.jpg"},
                         colmap={"folder": "colmap", "corners_px": marks})
    recorded(scene_geometry(unmarked), 1e-4, case="unmarked")


def test_what_is_wrong_with_marks_is_said(recorded, described, tmp_path):
    write_model(tmp_path / "colmap")

    def said(camera, **more):
        try:
            return str(found_camera(described(camera, **more)).at_mm)
        except SpectraboxError as error:
            return f"{type(error).__name__}: {error}"

    mirrored = {name.replace("left", "x").replace("right", "left").replace("x", "right"): px
                for name, px in MARKS.items() if name.startswith("back")}
    moved = MARKS | {"back top left": [MARKS["back top left"][0] + 12, 40.0]}
    far = {"colmap": {"folder": "colmap", "corners_px": {"box.jpg": {"back top left": [1, 2]},
                                                        "other.jpg": {"back top left": [1, 2]}}}}
    few = {"colmap": {"folder": "colmap", "corners_px": {"box.jpg": {"back top left": [1, 2]},
                                                        "left.jpg": {"back top left": [1, 2]}}}}
    recorded({"moved": said({"corners_px": moved}).partition("(rms")[0],
              "mirrored": said({"corners_px": mirrored | {
                  name: px for name, px in MARKS.items() if name.startswith("block")}}
                  ).partition("(rms")[0],
              "no such picture": said({"image": "none.jpg"}, **far),
              "another picture": said({"image": "box.jpg"}, **far),
              "too few": said({"image": "box.jpg"}, **few)})
