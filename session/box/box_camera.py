"""The camera of a box's photo: measured with a tape, found from corners marked in it, or out of a
COLMAP model.
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from spectrabox.radiometry.errors import CheckError, SpectraboxError
from spectrabox.reconstruct.scene.box_scene import box_xml
from spectrabox.reconstruct.scene.box_tables import BoxTable, CameraTable
from spectrabox.session.box.colmap_cameras import colmap_camera
from spectrabox.session.config.session_schema import FILE_NAME, SessionConfig, ViewInputs

if TYPE_CHECKING:
    from spectrabox.calibrate.geometry.lens import Lens, Pose
    from spectrabox.calibrate.geometry.model_in_scene import ModelInScene

How = Literal["measured", "corners", "COLMAP"]


@dataclass(frozen=True)
class FoundCamera:
    """Where a photo's camera stood and how that is known; lengths in millimetres.

    Errors and residuals of a measured camera are not known: 0 and empty.
    """

    how: How
    sensor: Mapping[str, Any]           # as ``box_xml`` takes it
    fov_deg: float                      # across the photo's width
    residuals_px: dict[str, float]      # of every marked corner
    at_mm: tuple[float, ...]
    standard_error_mm: tuple[float, ...]
    direction: tuple[float, ...]
    direction_error_deg: float
    model: ModelInScene | None = None   # of COLMAP


@dataclass(frozen=True)
class _Placed:
    how: How
    lens: Lens
    pose: Pose
    marks: dict[str, tuple[float, float]]   # corners in pixels of the photo
    residuals_px: dict[str, float]
    model: ModelInScene | None = None


def box_text(config: SessionConfig, view: ViewInputs | None = None) -> str:
    """XML of the scene that [scene.box] describes.

    Parameters
    ----------
    view : ViewInputs, optional
        Of the photo; the first by default.

    Raises
    ------
    InputError
        If the photo's size cannot be read, or the marked corners are not of a box of these sizes.
    CheckError
        If no place of the camera explains the corners, or two do.
    """
    view = view or config.all_views[0]
    sensor = None if _camera(config, view).measured else found_camera(config, view).sensor
    return box_xml(_box(config).turned(view.turn_deg), size_of_photo(config, view), sensor,
                   _camera(config, view))


def found_camera(config: SessionConfig, view: ViewInputs | None = None) -> FoundCamera:
    """The camera of a photo, the first by default.

    From marked corners: with a lens file its focal length is known; with ``fov_deg`` too; else it
    is found with the camera's place, and the principal point is the photo's middle.

    Raises
    ------
    InputError, CheckError
        As ``box_text``.
    """
    from spectrabox.calibrate.geometry.lens import camera_position, mitsuba_sensor
    placed = _placed(config, view or config.all_views[0])
    at, error, direction, angle = camera_position(placed.pose)
    _require_in_front(_box(config), at, placed.how)
    sensor = mitsuba_sensor(placed.lens, placed.pose)
    return FoundCamera(placed.how, sensor, sensor["fov"], placed.residuals_px, tuple(at.tolist()),
                       tuple(error.tolist()), tuple(direction.tolist()), angle, placed.model)


def corners_in_photo(config: SessionConfig,
                     view: ViewInputs | None = None) -> dict[str, tuple[float, float]]:
    """Where the camera sees the corners of the box and of boxes in it: pixels of the photo by
    name.
    """
    from spectrabox.calibrate.geometry.projection import projected
    view = view or config.all_views[0]
    placed = _placed(config, view)
    corners = _box(config).turned(view.turn_deg).corner_positions()
    turn = _rotation_vector(placed.pose.world_to_camera[:3, :3])
    seen, _ = projected(np.array(list(corners.values())),
                        np.concatenate([turn, placed.pose.world_to_camera[:3, 3]]), placed.lens)
    return {name: (float(x), float(y)) for name, (x, y) in zip(corners, seen, strict=True)}


def marked_corners(config: SessionConfig,
                   view: ViewInputs | None = None) -> dict[str, tuple[float, float]]:
    """Corners that the operator marked in a photo, by name: pixels of the whole photo."""
    return _placed(config, view or config.all_views[0]).marks


def straight_corners(config: SessionConfig, view: ViewInputs
                     ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Corners as the camera sees them, and as they were marked, in the photo without distortion:
    shares of its width and height by name.
    """
    from spectrabox.calibrate.geometry.lens import pinhole
    from spectrabox.calibrate.geometry.projection import image_rays
    placed = _placed(config, view)
    size = np.array([placed.lens.width, placed.lens.height])

    def straight(points: Mapping[str, tuple[float, float]]) -> dict[str, np.ndarray]:
        if not points:          # a picture of a model in which nobody marked a corner
            return {}
        seen = image_rays(np.array([*points.values()]).reshape(-1, 2), placed.lens)
        seen = seen @ pinhole(placed.lens).T
        return dict(zip(points, (seen[:, :2] / seen[:, 2:] + 0.5) / size, strict=True))

    return straight(corners_in_photo(config, view)), straight(placed.marks)


def lens_of_view(config: SessionConfig, view: ViewInputs) -> Lens | None:
    """The lens by which a photo is undistorted, where one is known.

    Raises
    ------
    InputError, CheckError
        If its file or the COLMAP model cannot be read, or does not fit.
    """
    if config.camera.lens is not None:
        from spectrabox.calibrate.geometry.lens_files import read_lens
        return read_lens(config.path(config.camera.lens))
    if config.box is None or view.scene is not None:
        return None
    camera = _camera(config, view)
    if camera.image is None:
        return None
    return colmap_camera(config, camera.image, size_of_photo(config, view)).lens


def size_of_photo(config: SessionConfig, view: ViewInputs | None = None) -> tuple[int, int]:
    """Width and height of the photo that a camera took, in pixels; the first by default.

    A view without a camera of its own is as large as the first photo, whose camera it shares.
    """
    # a scene in a file needs none of its readers
    from spectrabox.capture.photo.linear import photo_size
    own = view is not None and view.camera is not None
    taken = view if own and view is not None else config.all_views[0]
    return photo_size(config.path(taken.photo_files[0]))


def _placed(config: SessionConfig, view: ViewInputs) -> _Placed:
    # OpenCV and SciPy are not needed where nobody asks for them
    from spectrabox.calibrate.geometry.lens_files import read_lens
    from spectrabox.calibrate.geometry.pose import (
        lens_of_focal_length,
        pose_and_focal_length,
        pose_from_points,
    )
    camera, (width, height) = _camera(config, view), size_of_photo(config, view)
    if camera.image is not None:
        found = colmap_camera(config, camera.image, (width, height))
        return _Placed("COLMAP", found.lens, found.pose, found.marks, found.residuals_px,
                       found.model)
    lens: Lens | None = None
    if config.camera.lens is not None:
        lens = read_lens(config.path(config.camera.lens))
    elif camera.fov_deg is not None:
        focal_px = width / (2 * float(np.tan(np.radians(camera.fov_deg) / 2)))
        lens = lens_of_focal_length(focal_px, width, height)
    if camera.corners_px is None:
        assert lens is not None
        return _Placed("measured", lens, _measured_pose(camera), {}, {})
    # a view without a camera of its own was taken by the first photo's, which marked its corners
    turn_deg = view.turn_deg if view.camera is not None else 0.0
    corners, names = _box(config).turned(turn_deg).corner_positions(), tuple(camera.corners_px)
    positions = np.array([corners[name] for name in names])
    points = np.array([camera.corners_px[name] for name in names], dtype=float)
    place = f"views.{view.name}.camera" if view.camera is not None else "scene.box.camera"
    try:
        if lens is None:
            pose, lens = pose_and_focal_length(positions, points, width, height, names)
        else:
            pose = pose_from_points(positions, points, lens, names)
    except SpectraboxError as fault:
        raise type(fault)(f"{FILE_NAME}: {place}.corners_px: {fault}") from None
    misses = np.linalg.norm(pose.residuals_px, axis=1).tolist()
    return _Placed("corners", lens, pose, {name: (float(x), float(y)) for name, (x, y) in
                                           zip(names, points, strict=True)},
                   dict(zip(names, misses, strict=True)))


def _require_in_front(box: BoxTable, at_mm: np.ndarray, how: How) -> None:
    """Refuse a camera that would look through the back wall: marks in one plane fit from both
    sides.
    """
    if how != "measured" and box.walls.back is not None and at_mm[2] <= -box.depth_mm:
        raise CheckError(f"{FILE_NAME}: the marked corners put the camera behind the back wall (at "
                         f"z = {at_mm[2]:.0f} mm): left and right are exchanged, name them as seen "
                         "from the opening")


def _camera(config: SessionConfig, view: ViewInputs) -> CameraTable:
    return view.camera or _box(config).camera


def _measured_pose(camera: CameraTable) -> Pose:
    """The pose of a camera that stands and looks as measured; its errors are not known."""
    from spectrabox.calibrate.geometry.lens import Pose
    at, target = np.array(camera.at_mm, dtype=float), np.array(camera.look_at_mm, dtype=float)
    ahead = (target - at) / np.linalg.norm(target - at)
    right = np.cross(ahead, np.array(camera.up, dtype=float))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])     # x right, y down, z ahead
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3], world_to_camera[:3, 3] = rotation, -rotation @ at
    return Pose(world_to_camera, np.zeros((6, 6)), np.zeros((0, 2)), 0.0)


def _box(config: SessionConfig) -> BoxTable:
    assert config.box is not None
    return config.box


def _rotation_vector(matrix: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation
    return np.asarray(Rotation.from_matrix(matrix).as_rotvec())
