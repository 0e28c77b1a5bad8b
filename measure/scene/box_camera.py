"""The camera of a measured box's photo: measured with a tape, estimated from corners that were
marked in the photo, or taken from a COLMAP model that marked corners tie to the box.
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from spectrabox.calibrate.geometry import colmap_model, model_in_scene, projection
from spectrabox.calibrate.geometry import pose as poses
from spectrabox.calibrate.geometry.lens import Lens, Pose, mitsuba_sensor, pinhole
from spectrabox.capture.photo.linear import photo_size
from spectrabox.measure.captured import BoxPhoto, SceneView
from spectrabox.radiometry.errors import CheckError, SpectraboxError
from spectrabox.reconstruct.scene import box_scene, box_tables, scene_file

How = Literal["measured", "corners", "COLMAP"]
Points = Mapping[str, tuple[float, float]]          # pixels of the whole photo, by name of a corner
Positions = Mapping[str, tuple[float, float, float]]    # millimetres, by name of a corner


@dataclass(frozen=True)
class BoxCamera:
    """Lens and pose of a photo's camera in the box's coordinates, and how they are known.

    Lengths are in millimetres. The errors of a measured camera are not known: they are 0, and it
    has no residuals.
    """

    how: How
    lens: Lens                          # in pixels of the whole photo
    pose: Pose
    marks: Points                       # corners that were marked in the photo
    residuals_px: dict[str, float]      # of every mark
    model: model_in_scene.ModelInScene | None = None  # of COLMAP

    @property
    def sensor(self) -> Mapping[str, Any]:
        """Parameters of Mitsuba's ``perspective`` sensor, as ``box_xml`` takes them."""
        return mitsuba_sensor(self.lens, self.pose)

    @property
    def fov_deg(self) -> float:
        """Field of view across the photo's width."""
        return float(self.sensor["fov"])

    @property
    def at_mm(self) -> tuple[float, ...]:
        """Position (3,) of the lens."""
        return tuple(self.pose.position.tolist())

    @property
    def standard_error_mm(self) -> tuple[float, ...]:
        """Standard error (3,) of the position."""
        return tuple(self.pose.position_standard_error.tolist())

    @property
    def direction(self) -> tuple[float, ...]:
        """Unit vector (3,) along which the camera looks."""
        return tuple(self.pose.direction.tolist())

    @property
    def direction_error_deg(self) -> float:
        """Standard error of the direction."""
        return self.pose.direction_standard_error_deg


def scene_of(stated: scene_file.SceneFile | BoxPhoto) -> scene_file.SceneFile:
    """The scene of a photo: that of its file, or the box as its camera sees it.

    Parameters
    ----------
    stated : SceneFile or BoxPhoto

    Raises
    ------
    InputError, CheckError
        As ``box_text``.
    """
    if isinstance(stated, scene_file.SceneFile):
        return stated
    return scene_file.scene_of_text(box_text(stated), stated.path)


def lens_of(view: SceneView) -> Lens | None:
    """The lens by which a photo is undistorted, where one is known: of a file or a COLMAP model.

    Parameters
    ----------
    view : SceneView

    Raises
    ------
    InputError
        If the photo's size cannot be read, or is not that of the picture.
    """
    stated = view.scene
    if view.lens is not None or isinstance(stated,
                                           scene_file.SceneFile) or stated.camera.image is None:
        return view.lens
    image = stated.camera.image
    lens, _ = stated.model[image]
    return colmap_model.for_photo(lens, *photo_size(stated.taken.path), image)


def box_text(stated: BoxPhoto) -> str:
    """XML of the scene of a measured box.

    Parameters
    ----------
    stated : BoxPhoto

    Raises
    ------
    InputError
        If the photo's size cannot be read, or the marked corners are not of a box of these sizes.
    CheckError
        If no position of the camera explains the corners, or two do.
    """
    sensor = None if stated.camera.measured else box_camera(stated).sensor
    return box_scene.box_xml(stated.box, photo_size(stated.taken.path), sensor, stated.camera)


def box_camera(stated: BoxPhoto) -> BoxCamera:
    """The camera of a photo of a measured box.

    Parameters
    ----------
    stated : BoxPhoto

    Raises
    ------
    InputError
        As ``box_text``.
    CheckError
        As ``box_text``; or if the COLMAP model and the marked corners do not fit.
    """
    size = photo_size(stated.taken.path)
    place = stated.camera_place
    if stated.camera.image is not None:
        camera = _camera_of_model(stated, stated.camera.image, size)
    elif stated.camera.corners_px is None:
        camera = measured_camera(stated.camera, stated.lens, size)
    else:
        try:
            camera = camera_from_corners(stated.camera, stated.marked.corner_positions(),
                                         stated.lens, size)
        except SpectraboxError as fault:
            raise type(fault)(f"{place}.corners_px: {fault}") from None
    try:
        require_in_front(stated.box, camera)
    except SpectraboxError as fault:
        raise type(fault)(f"{place}: {fault}") from None
    return camera


def _camera_of_model(stated: BoxPhoto, image: str, size: tuple[int, int]) -> BoxCamera:
    """The camera of one picture of a box's COLMAP model."""
    assert stated.box.colmap is not None
    ties = stated.box.colmap.corners_px
    marks = {name: {corner: (x, y) for corner, (x, y) in corners.items()}
             for name, corners in ties.items()}
    try:
        # what stands still ties the model to the box, turned or not
        return camera_from_model(stated.model, image, marks, stated.box.corner_positions(), size)
    except SpectraboxError as fault:
        raise type(fault)(f"{stated.model_place}: {fault}") from None


def measured_camera(camera: box_tables.CameraTable, lens: Lens | None,
                    size: tuple[int, int]) -> BoxCamera:
    """A camera whose position and direction were measured.

    Parameters
    ----------
    camera : CameraTable
        With ``at_mm`` and ``look_at_mm``, and ``fov_deg`` where no lens is given.
    lens : Lens or None
    size : (width, height)
        Of the photo in pixels.
    """
    at, target = np.array(camera.at_mm, dtype=float), np.array(camera.look_at_mm, dtype=float)
    ahead = (target - at) / np.linalg.norm(target - at)
    right = np.cross(ahead, np.array(camera.up, dtype=float))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])     # x right, y down, z ahead
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3], world_to_camera[:3, 3] = rotation, -rotation @ at
    pose = Pose(world_to_camera, np.zeros((6, 6)), np.zeros((0, 2)), 0.0)
    lens = lens or stated_lens(camera, size)
    assert lens is not None
    return BoxCamera("measured", lens, pose, {}, {})


def camera_from_corners(camera: box_tables.CameraTable, positions: Positions, lens: Lens | None,
                        size: tuple[int, int]) -> BoxCamera:
    """The camera whose pose explains marked corners.

    Its focal length is that of the lens, or of ``fov_deg``; without either it is estimated with the
    pose, and the principal point is the photo's middle.

    Parameters
    ----------
    camera : CameraTable
        With ``corners_px``.
    positions : mapping of corner name to (x, y, z)
    lens : Lens or None
    size : (width, height)
        Of the photo in pixels.

    Raises
    ------
    InputError
        If the marked corners are not of a box of these sizes.
    CheckError
        If no position of the camera explains the corners, or two do.
    """
    assert camera.corners_px is not None
    names = tuple(camera.corners_px)
    places = np.array([positions[name] for name in names])
    points = np.array([camera.corners_px[name] for name in names], dtype=float)
    if (lens := lens or stated_lens(camera, size)) is None:
        pose, lens = poses.pose_and_focal_length(places, points, *size, names)
    else:
        pose = poses.pose_from_points(places, points, lens, names)
    residuals = np.linalg.norm(pose.residuals_px, axis=1).tolist()
    return BoxCamera("corners", lens, pose, {name: (float(x), float(y)) for name, (x, y) in
                                             zip(names, points, strict=True)},
                     dict(zip(names, residuals, strict=True)))


def camera_from_model(images: Mapping[str, colmap_model.Picture], image: str,
                      marks: Mapping[str, Points], positions: Positions,
                      size: tuple[int, int]) -> BoxCamera:
    """The camera of one picture of a COLMAP model.

    Parameters
    ----------
    images : mapping of picture name to its lens and pose in the model
    image : str
        Of the photo.
    marks : mapping of picture name to marked corners, in pixels of the model's pictures
    positions : mapping of corner name to (x, y, z)
    size : (width, height)
        Of the whole photo in pixels; COLMAP may have used a smaller copy.

    Raises
    ------
    InputError
        If too few corners are marked.
    CheckError
        If model and marked corners do not fit.
    """
    model = model_in_scene.model_in_scene(images, marks, positions)
    own_lens, from_model = images[image]
    lens = colmap_model.for_photo(own_lens, *size, image)
    scale = np.array(size) / (own_lens.width, own_lens.height)
    own: dict[str, tuple[float, float]] = {}
    for corner, point in marks.get(image, {}).items():
        x, y = (np.array(point) + 0.5) * scale - 0.5        # a pixel's middle is a whole number
        own[corner] = (float(x), float(y))
    return BoxCamera("COLMAP", lens, model_in_scene.pose_in_scene(from_model, model), own,
                     {corner: model.residuals_px[image, corner] for corner in own}, model)


def stated_lens(camera: box_tables.CameraTable, size: tuple[int, int]) -> Lens | None:
    """The lens without distortion of a stated field of view; None where none is stated."""
    if camera.fov_deg is None:
        return None
    return poses.lens_of_focal_length(size[0] / (2 * float(np.tan(np.radians(camera.fov_deg) / 2))),
                                      *size)


def require_in_front(box: box_tables.BoxTable, camera: BoxCamera) -> None:
    """Refuse a camera that would look through the back wall: marks in one plane fit from both
    sides.

    Raises
    ------
    CheckError
    """
    if camera.how != "measured" and box.walls.back is not None and camera.at_mm[2] <= -box.depth_mm:
        raise CheckError("the marked corners put the camera behind the back wall (at "
                         f"z = {camera.at_mm[2]:.0f} mm): left and right are exchanged, name them "
                         "as seen from the opening")


def visible_corners(camera: BoxCamera, positions: Positions) -> dict[str, tuple[float, float]]:
    """Pixels of the photo, by name, at which the camera sees corners.

    Parameters
    ----------
    camera : BoxCamera
    positions : mapping of corner name to (x, y, z)
    """
    turn = Rotation.from_matrix(camera.pose.world_to_camera[:3, :3]).as_rotvec()
    pixels, _ = projection.projected(np.array(list(positions.values())),
                          np.concatenate([turn, camera.pose.world_to_camera[:3, 3]]), camera.lens)
    return {name: (float(x), float(y)) for name, (x, y) in zip(positions, pixels, strict=True)}


def undistorted_shares(camera: BoxCamera, points: Points) -> dict[str, np.ndarray]:
    """Points of the photo as they lie without distortion, in shares (2,) of its width and height.

    Parameters
    ----------
    camera : BoxCamera
    points : mapping of name to pixels; there may be none
    """
    if not points:
        return {}
    rays = projection.image_rays(np.array([*points.values()]).reshape(-1, 2), camera.lens)
    rays = rays @ pinhole(camera.lens).T
    size = np.array([camera.lens.width, camera.lens.height])
    return dict(zip(points, (rays[:, :2] / rays[:, 2:] + 0.5) / size, strict=True))
