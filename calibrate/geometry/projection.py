"""The lens from views of a ChArUco board, projection of points, and photos without distortion.

The records and the renderer's terms are in ``lens.py``.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from spectrabox.calibrate.geometry.board import Board
from spectrabox.calibrate.geometry.lens import Lens, pinhole
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.records.photos import LinearImage

MIN_VIEWS = 3
MIN_CORNERS = 6
LENS_RMS_PX = 2.0
MIN_TILT_DEG = 10.0
MAX_FOCAL_ERROR = 0.02              # relative; a chart's irradiance would be off by twice that
FLAT = 1e-3                         # a spread of points below this share of the largest is none
OVERLAY_SIDE = 1600                 # px
MAX_LINE_PX = 30_000                # OpenCV draws to 16 bits
GREEN, RED, BLACK = (60, 220, 60), (255, 40, 40), (0, 0, 0)


def board_picture(board: Board, square_px: int) -> np.ndarray:
    """The board (H, W) uint8 for printing, half a square of white around it.

    Parameters
    ----------
    board : Board
    square_px : int
        Side of a square.
    """
    size = ((board.columns + 1) * square_px, (board.rows + 1) * square_px)
    return np.asarray(_charuco(board).generateImage(size, marginSize=square_px // 2))


def find_board(board: Board, grey: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the board in a picture: (n, 3) in the board's plane and (n, 2) in pixels.

    Parameters
    ----------
    board : Board
    grey : (H, W) uint8 array

    Raises
    ------
    CheckError
        If fewer than 6 corners are seen.
    """
    charuco = _charuco(board)
    corners, identities, _, markers = cv2.aruco.CharucoDetector(charuco).detectBoard(grey)
    seen = 0 if corners is None else len(corners)
    if seen < MIN_CORNERS:
        detected = 0 if markers is None else len(markers)
        raise CheckError(f"{seen} corners of the ChArUco board are seen, and {detected} of its "
                         f"markers; {MIN_CORNERS} corners are needed: bring the board nearer, "
                         "light it evenly, do not mirror the photo, and check that columns, rows "
                         "and dictionary are those of the print")
    positions, points = charuco.matchImagePoints(corners, identities)
    return positions.reshape(-1, 3).astype(float), points.reshape(-1, 2).astype(float)


def lens_from_views(views: Sequence[tuple[np.ndarray, np.ndarray]], width: int, height: int,
                    source: str = "views of a board") -> tuple[Lens, np.ndarray]:
    """Lens from several views of a board, and the rms (V,) of each in pixels [Zhang 2000].

    Parameters
    ----------
    views : sequence of pairs
        Corners (n, 3) in the board's plane and (n, 2) in pixels, of each photo.
    width, height : int
        Of the whole photo, pixels.
    source : str
        Stored with the lens.

    Raises
    ------
    InputError
        If there are fewer than 3 views.
    CheckError
        If no lens explains the views, or they leave the focal length open.
    """
    if len(views) < MIN_VIEWS:
        raise InputError(f"{len(views)} views of the board cannot determine a lens; take "
                         f"{MIN_VIEWS} or more, tilted in different ways")
    positions = [view[0].astype(np.float32) for view in views]
    points = [view[1].astype(np.float32) for view in views]
    rms, matrix, distortion, turns, _, errors, _, by_view = cv2.calibrateCameraExtended(
        positions, points, (width, height), None, None)
    by_view, errors = np.ravel(by_view), np.ravel(errors)
    if not np.isfinite(rms) or rms > LENS_RMS_PX:
        raise CheckError(f"no lens explains the views of the board (rms {rms:.1f} pixels, at most "
                         f"{LENS_RMS_PX:g} is accepted; worst is view "
                         f"{int(np.argmax(by_view)) + 1} with {by_view.max():.1f}); check that the "
                         "board is flat and that zoom and focus were not touched, or leave that "
                         "view out")
    normals = np.array([rotation_matrix(turn)[:, 2] for turn in turns])
    separation_deg = float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1).min())))
    relative = float(errors[0] / matrix[0, 0])
    # OpenCV states no error along what is singular
    if separation_deg < MIN_TILT_DEG or not relative < MAX_FOCAL_ERROR:
        raise CheckError(f"the views leave the focal length open (error {relative:.1%}, the "
                         f"board's directions are {separation_deg:.0f} degrees apart, "
                         f"{MIN_TILT_DEG:g} are needed); tilt the board by some 30 degrees, each "
                         "time to another side")
    return Lens(width, height, np.asarray(matrix), np.ravel(distortion)[:5], errors[:4],
                errors[4:9], float(rms), source), by_view


def undistorted(image: LinearImage, lens: Lens) -> LinearImage:
    """The photo as the renderer's pinhole sees it.

    Linear interpolation: no value leaves the range of its neighbours. What the photo does not show
    is marked as saturated, so that nothing uses it. The variance is the neighbours' over the area
    that a pixel covers in the photo, not the smaller one of the interpolated value: neighbours
    share their noise, and it is the mean over a block of pixels whose variance has to come out
    right.

    Parameters
    ----------
    image : LinearImage
        A whole photo, binned or not.
    lens : Lens

    Raises
    ------
    InputError
        If the photo's size is not that of the lens.
    """
    height, width = image.signal.shape[:2]
    step = image.sensor_step
    if abs(width * step - lens.width) >= step or abs(height * step - lens.height) >= step:
        raise InputError(f"photo {image.source} has {round(width * step)} x {round(height * step)} "
                         f"pixels, the lens was calibrated at {lens.width} x {lens.height}; use "
                         "whole photos of the same camera")
    across, down = cv2.initUndistortRectifyMap(_at_step(lens.matrix, step), lens.distortion,
                                               np.eye(3), _at_step(pinhole(lens), step),
                                               (width, height), cv2.CV_32FC1)
    area = np.abs(np.gradient(across, axis=1) * np.gradient(down, axis=0)
                  - np.gradient(across, axis=0) * np.gradient(down, axis=1))
    outside = (across < -0.5) | (across > width - 0.5) | (down < -0.5) | (down > height - 0.5)

    def moved(planes: np.ndarray) -> np.ndarray:
        return np.stack([cv2.remap(np.ascontiguousarray(planes[..., band], dtype=np.float32),
                                   across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
                         for band in range(planes.shape[2])], axis=-1)

    return dataclasses.replace(image, signal=moved(image.signal), variance=moved(image.variance)
                               / area[..., None], saturated=(moved(image.saturated) > 0)
                               | outside[..., None],
                               source=f"{image.source}, undistorted")


def likely_poses(positions: np.ndarray, points_px: np.ndarray, lens: Lens) -> list[np.ndarray]:
    """Rotation vectors and shifts (6,) to refine: all solutions of SQPnP, and of a plane IPPE's.

    Parameters
    ----------
    positions : (n, 3) array
    points_px : (n, 2) array
    lens : Lens
    """
    starts = []
    for method in (cv2.SOLVEPNP_SQPNP,
                   *((cv2.SOLVEPNP_IPPE,) if spread(positions)[2] < FLAT else ())):
        try:
            _, turns, shifts, *_ = cv2.solvePnPGeneric(positions, points_px, lens.matrix,
                                                       lens.distortion, flags=method)
        except cv2.error:  # points that no camera could see so
            continue
        starts += [np.concatenate([np.ravel(turn), np.ravel(shift)])
                   for turn, shift in zip(turns, shifts, strict=True)]
    return [start for start in starts if np.all(np.isfinite(start))]


def spread(positions: np.ndarray) -> np.ndarray:
    """Extent (3,) of points along their principal axes, relative to the largest.

    A plane ends in 0, a line in 0, 0.

    Parameters
    ----------
    positions : (n, 3) array
    """
    extent = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    return np.asarray(extent / max(float(extent[0]), np.finfo(float).tiny))


def projected(positions: np.ndarray, parameters: np.ndarray,
              lens: Lens) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) of positions, and their derivative (2 n, 10 + D).

    The derivative is by the six parameters, by fx, fy, cx, cy, and by the distortion.

    Parameters
    ----------
    positions : (n, 3) array
    parameters : (6,) array
        Rotation vector and shift, world to camera.
    lens : Lens
    """
    seen, derivative = cv2.projectPoints(positions, parameters[:3], parameters[3:6], lens.matrix,
                                         lens.distortion)
    return seen.reshape(-1, 2), np.asarray(derivative)


def image_rays(points_px: np.ndarray, lens: Lens) -> np.ndarray:
    """Unit directions (n, 3) in camera coordinates in which a lens sees pixels (n, 2).

    Parameters
    ----------
    points_px : (n, 2) array
        Pixels of the whole photo.
    lens : Lens
    """
    across = cv2.undistortPoints(np.asarray(points_px, dtype=float).reshape(-1, 1, 2), lens.matrix,
                                 lens.distortion).reshape(-1, 2)
    rays = np.column_stack([across, np.ones(len(across))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def rotation_matrix(vector: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) of a rotation vector.

    Parameters
    ----------
    vector : (3,) array
        Axis times angle in radians.
    """
    return np.asarray(cv2.Rodrigues(vector)[0])


def points_overlay(rgb8: np.ndarray, given_px: np.ndarray, seen_px: np.ndarray,
                   step: float, lines_px: np.ndarray | None = None) -> np.ndarray:
    """Picture (H, W, 3) uint8 with points as detected (green rings) and reprojected (red crosses).

    Parameters
    ----------
    rgb8 : (H, W, 3) uint8 array
    given_px, seen_px : (n, 2) arrays
        In pixels of the whole photo: detected, and reprojected.
    step : float
        Pixels of the photo per pixel of ``rgb8``.
    lines_px : (m, 2, 2) array, optional
        Both ends of lines to draw, such as a box's edges.
    """
    scale = min(1.0, OVERLAY_SIDE / max(rgb8.shape[:2]))
    picture = np.ascontiguousarray(cv2.resize(rgb8, None, fx=scale, fy=scale,
                                              interpolation=cv2.INTER_AREA))
    size = max(4, max(picture.shape[:2]) // 160)
    for ends in () if lines_px is None else lines_px:
        (x0, y0), (x1, y1) = np.rint(np.clip((ends + 0.5) / step * scale - 0.5, -MAX_LINE_PX,
                                             MAX_LINE_PX)).astype(int).tolist()
        for ink, thickness in ((BLACK, 3), (RED, 1)):
            cv2.line(picture, (x0, y0), (x1, y1), ink, thickness, cv2.LINE_AA)
    for points, colour, cross in ((given_px, GREEN, False), (seen_px, RED, True)):
        for x, y in np.rint((points + 0.5) / step * scale - 0.5).astype(int).tolist():
            for ink, thickness in ((BLACK, 3), (colour, 1)):
                if cross:
                    cv2.drawMarker(picture, (x, y), ink, cv2.MARKER_TILTED_CROSS, 2 * size,
                                   thickness, cv2.LINE_AA)
                else:
                    cv2.circle(picture, (x, y), size, ink, thickness, cv2.LINE_AA)
    return picture


def _charuco(board: Board) -> Any:
    dictionary = getattr(cv2.aruco, board.dictionary, None)
    if not board.dictionary.startswith("DICT_") or dictionary is None:
        raise InputError(f"{board.dictionary!r} is no ArUco dictionary; write one such as "
                         "DICT_5X5_100")
    markers = cv2.aruco.getPredefinedDictionary(dictionary)
    needed = board.columns * board.rows // 2
    if needed > len(markers.bytesList):
        raise InputError(f"a board of {board.columns} x {board.rows} squares needs {needed} "
                         f"markers and {board.dictionary} holds {len(markers.bytesList)}; take "
                         "fewer squares or a larger dictionary")
    charuco = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square, board.marker,
                                     markers)
    charuco.setLegacyPattern(board.legacy)
    return charuco


def _at_step(matrix: np.ndarray, step: float) -> np.ndarray:
    """Camera matrix for an image of which one pixel covers ``step`` pixels of the photo."""
    smaller = matrix / step
    smaller[:2, 2] = (matrix[:2, 2] + 0.5) / step - 0.5
    smaller[2, 2] = 1
    return smaller
