"""The camera of a box's photo: measured with a tape, or found from corners marked in it."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.reconstruct.scene.box_scene import box_xml
from spectrabox.reconstruct.scene.box_tables import BoxTable, CameraTable
from spectrabox.session.config.session_schema import FILE_NAME, SessionConfig

if TYPE_CHECKING:
    from spectrabox.calibrate.geometry.lens import Lens, Pose


@dataclass(frozen=True)
class FoundCamera:
    """A camera found from marked corners; lengths in millimetres."""

    sensor: Mapping[str, Any]           # as ``box_xml`` takes it
    fov_deg: float                      # across the photo's width
    residuals_px: dict[str, float]      # of every marked corner
    at_mm: tuple[float, ...]
    standard_error_mm: tuple[float, ...]
    direction_error_deg: float


def box_text(config: SessionConfig, turn_deg: float = 0.0) -> str:
    """XML of the scene that [scene.box] describes.

    Parameters
    ----------
    turn_deg : float
        By which its turntable had turned.

    Raises
    ------
    InputError
        If the photo's size cannot be read, or the marked corners are not of a box of these sizes.
    CheckError
        If no place of the camera explains the corners, or two do.
    """
    assert config.box is not None
    camera = None if config.box.camera.corners_px is None else found_camera(config)
    return box_xml(config.box.turned(turn_deg), size_of_photo(config),
                   None if camera is None else camera.sensor)


def found_camera(config: SessionConfig) -> FoundCamera:
    """The camera of the first photo, from the corners that [scene.box.camera] marks in it.

    With a lens file its focal length is known; with ``fov_deg`` too; else it is found with the
    camera's place, and the principal point is the photo's middle.

    Raises
    ------
    InputError, CheckError
        As ``box_text``.
    """
    from spectrabox.calibrate.geometry.lens import camera_position, mitsuba_sensor
    lens, pose = _lens_and_pose(config)
    at, error, _, angle = camera_position(pose)
    sensor = mitsuba_sensor(lens, pose)
    misses = np.linalg.norm(pose.residuals_px, axis=1)
    return FoundCamera(sensor, sensor["fov"],
                       dict(zip(_box(config).camera.corners_px or {}, misses.tolist(),
                                strict=True)),
                       tuple(at.tolist()), tuple(error.tolist()), angle)


def corners_in_photo(config: SessionConfig) -> dict[str, tuple[float, float]]:
    """Where the camera sees the corners of the box and of boxes in it: pixels of the photo by
    name.
    """
    from spectrabox.calibrate.geometry.projection import projected
    lens, pose = _lens_and_pose(config)
    corners = _box(config).corner_positions()
    turn = _rotation_vector(pose.world_to_camera[:3, :3])
    seen, _ = projected(np.array(list(corners.values())),
                        np.concatenate([turn, pose.world_to_camera[:3, 3]]), lens)
    return {name: (float(x), float(y)) for name, (x, y) in zip(corners, seen, strict=True)}


def size_of_photo(config: SessionConfig) -> tuple[int, int]:
    """Width and height of the first photo in pixels."""
    # a scene in a file needs none of its readers
    from spectrabox.capture.photo.linear import photo_size
    return photo_size(config.path(config.all_views[0].photo_files[0]))


def _lens_and_pose(config: SessionConfig) -> tuple[Lens, Pose]:
    # OpenCV and SciPy are not needed where nobody asks for them
    from spectrabox.calibrate.geometry.lens_files import read_lens
    from spectrabox.calibrate.geometry.pose import (
        lens_of_focal_length,
        pose_and_focal_length,
        pose_from_points,
    )
    box, (width, height) = _box(config), size_of_photo(config)
    lens: Lens | None = None
    if config.camera.lens is not None:
        lens = read_lens(config.path(config.camera.lens))
    elif box.camera.fov_deg is not None:
        focal_px = width / (2 * float(np.tan(np.radians(box.camera.fov_deg) / 2)))
        lens = lens_of_focal_length(focal_px, width, height)
    if box.camera.corners_px is None:
        assert lens is not None
        return lens, _measured_pose(box.camera)
    corners, names = box.corner_positions(), tuple(box.camera.corners_px)
    positions = np.array([corners[name] for name in names])
    points = np.array([box.camera.corners_px[name] for name in names], dtype=float)
    try:
        if lens is None:
            pose, lens = pose_and_focal_length(positions, points, width, height, names)
            return lens, pose
        return lens, pose_from_points(positions, points, lens, names)
    except SpectraboxError as fault:
        raise type(fault)(f"{FILE_NAME}: scene.box.camera.corners_px: {fault}") from None


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
