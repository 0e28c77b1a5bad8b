"""Lens and place of the camera from a ChArUco board or known points, in the renderer's terms.

OpenCV's camera looks along +z with x to the right and y down; (0, 0) is the centre of the top-left pixel. Mitsuba's
``perspective`` sensor looks along +z with x to the left and y up, has square pixels and no distortion: photos are
undistorted to that pinhole before they are compared with a rendering.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import cv2
import numpy as np

from radiometry.errors import CheckError, InputError
from radiometry.shaped import Record

FEWEST_VIEWS = 3
FEWEST_POINTS = 6
DICTIONARY = cv2.aruco.DICT_5X5_100
ACCEPTED_RMS_PX = 2.0
OPENCV_TO_MITSUBA = np.diag([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Lens(Record):
    """Pinhole and distortion of one camera and focus setting."""

    width: int
    height: int
    matrix: Annotated[np.ndarray, "3 3"]            # pixels
    distortion: Annotated[np.ndarray, "D"]          # k1 k2 p1 p2 k3
    standard_error: Annotated[np.ndarray, "4"]      # of fx, fy, cx, cy in pixels
    rms_px: float                                   # distance of the points from where the lens puts them


@dataclass(frozen=True, eq=False)
class Pose(Record):
    """Where the camera stands: world (the scene's unit) to OpenCV camera coordinates."""

    world_to_camera: Annotated[np.ndarray, "4 4"]
    rms_px: float


def charuco_board(columns: int, rows: int, square_m: float, marker_m: float) -> Any:
    """A ChArUco board as OpenCV object; its corners lie in the plane z = 0, in metres."""
    return cv2.aruco.CharucoBoard((columns, rows), square_m, marker_m, cv2.aruco.getPredefinedDictionary(DICTIONARY))


def find_board(board: Any, grey: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of the board that a picture shows: (n, 3) in metres and (n, 2) in pixels.

    Parameters
    ----------
    grey : (H, W) uint8 array

    Raises
    ------
    CheckError
        If fewer than 6 corners are seen.
    """
    corners, identities, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
    seen = 0 if corners is None else len(corners)
    if seen < FEWEST_POINTS:
        raise CheckError(f"{seen} corners of the ChArUco board are seen; {FEWEST_POINTS} are needed: bring the board "
                         "nearer, light it evenly, and check that its size and dictionary are the stated ones")
    places, points = board.matchImagePoints(corners, identities)
    return places.reshape(-1, 3).astype(float), points.reshape(-1, 2).astype(float)


def lens_from_views(views: list[tuple[np.ndarray, np.ndarray]], width: int, height: int) -> Lens:
    """Lens from several views of a board, each (n, 3) in metres and (n, 2) in pixels [Zhang 2000].

    Raises
    ------
    InputError
        If there are fewer than 3 views.
    CheckError
        If no lens explains the views.
    """
    if len(views) < FEWEST_VIEWS:
        raise InputError(f"{len(views)} views of the board cannot determine a lens; take {FEWEST_VIEWS} or more, "
                         "tilted in different ways")
    places = [view[0].astype(np.float32) for view in views]
    points = [view[1].astype(np.float32) for view in views]
    rms, matrix, distortion, _, _, errors, *_ = cv2.calibrateCameraExtended(places, points, (width, height), None, None)
    if rms > ACCEPTED_RMS_PX:
        raise CheckError(f"no lens explains the views of the board (rms {rms:.1f} pixels); check the size of its "
                         "squares and that zoom and focus were not touched")
    return Lens(width, height, np.asarray(matrix), np.asarray(distortion).ravel()[:5], np.asarray(errors).ravel()[:4],
                float(rms))


def pose_from_points(places: np.ndarray, points_px: np.ndarray, lens: Lens) -> Pose:
    """Where the camera stands, from known points (n, 3) of the scene and their pixels (n, 2).

    Raises
    ------
    InputError
        If there are fewer than 6 points.
    CheckError
        If no place of the camera explains them.
    """
    if len(places) < FEWEST_POINTS:
        raise InputError(f"{len(places)} points cannot determine a pose reliably; give {FEWEST_POINTS} or more")
    found, rotation, shift = cv2.solvePnP(places.astype(float), points_px.astype(float), lens.matrix, lens.distortion,
                                          flags=cv2.SOLVEPNP_SQPNP)
    rotation, shift = cv2.solvePnPRefineLM(places.astype(float), points_px.astype(float), lens.matrix, lens.distortion,
                                           rotation, shift)
    seen, _ = cv2.projectPoints(places.astype(float), rotation, shift, lens.matrix, lens.distortion)
    rms = float(np.sqrt(np.mean(np.sum((seen.reshape(-1, 2) - points_px) ** 2, axis=1))))
    if not found or not np.isfinite(rms) or rms > ACCEPTED_RMS_PX:
        raise CheckError(f"no place of the camera explains the points (rms {rms:.1f} pixels); "
                         "check their order and unit")
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3] = cv2.Rodrigues(rotation)[0]
    world_to_camera[:3, 3] = np.ravel(shift)
    return Pose(world_to_camera, rms)


def undistorted(signal: np.ndarray, lens: Lens) -> np.ndarray:
    """The photo (H, W, K) as the renderer's pinhole sees it; pixels from outside the photo are NaN.

    Linear interpolation: radiance is averaged over less than a pixel, and no value leaves the range of its neighbours.
    """
    if signal.shape[:2] != (lens.height, lens.width):
        raise InputError(f"the photo has {signal.shape[1]} x {signal.shape[0]} pixels, the lens was found at "
                         f"{lens.width} x {lens.height}; use photos of one size")
    across, down = cv2.initUndistortRectifyMap(lens.matrix, lens.distortion, np.eye(3), pinhole(lens),
                                               (lens.width, lens.height), cv2.CV_32FC1)
    planes = [cv2.remap(np.ascontiguousarray(signal[..., band], dtype=np.float32), across, down, cv2.INTER_LINEAR,
                        borderMode=cv2.BORDER_CONSTANT, borderValue=float("nan")) for band in range(signal.shape[2])]
    return np.stack(planes, axis=-1)


def pinhole(lens: Lens) -> np.ndarray:
    """Camera matrix (3, 3) of the undistorted photo: square pixels, the principal point where it was."""
    matrix = lens.matrix.copy()
    matrix[1, 1] = matrix[0, 0]
    return matrix


def mitsuba_sensor(lens: Lens, pose: Pose) -> dict[str, Any]:
    """What a ``perspective`` sensor needs: ``to_world`` (4, 4), ``fov`` in degrees along x, principal point offsets."""
    matrix = pinhole(lens)
    return {"to_world": np.linalg.inv(pose.world_to_camera) @ OPENCV_TO_MITSUBA,
            "fov": float(np.degrees(2 * np.arctan(lens.width / (2 * matrix[0, 0])))), "fov_axis": "x",
            "principal_point_offset_x": float(0.5 - (matrix[0, 2] + 0.5) / lens.width),
            "principal_point_offset_y": float(0.5 - (matrix[1, 2] + 0.5) / lens.height)}
