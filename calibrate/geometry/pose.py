"""The camera's pose from known points of the scene: least squares of their reprojection errors.

Without a lens the focal length is estimated too; the principal point is then the photo's middle and
nothing is distorted.
"""
from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
from scipy.optimize import least_squares

from spectrabox.calibrate.geometry import projection
from spectrabox.calibrate.geometry.lens import Lens, Pose
from spectrabox.radiometry.errors import CheckError, InputError

MIN_POINTS = 6
ACCEPTED_SHARE = 0.005      # rms, of the photo's width: 2.5 mm in a box of half a metre
MAX_FOCAL_ERROR = 0.05
DIFFERENT = 3.0             # standard errors by which a second pose has to be worse
MIN_NOISE_PX = 0.05
STARTS = 3                  # of them refined
MAX_STEPS = 200
FAR_PX = 1e6                # stands for a point that cannot be projected
FOCAL_RANGE = (0.4, 10.0)   # of the photo's width, tried in 10 steps


def pose_from_points(positions: np.ndarray, points_px: np.ndarray, lens: Lens,
                     names: Sequence[str] = ()) -> Pose:
    """Pose of a camera of known lens, from points (n, 3) of the scene and their pixels (n, 2).

    The covariance is that of the residuals' scatter and of the lens' stated errors.

    Parameters
    ----------
    positions : (n, 3) array
        In the scene, any unit.
    points_px : (n, 2) array
        The same points in pixels of the whole photo.
    lens : Lens
    names : sequence of str
        Of the points, for errors; empty numbers them.

    Raises
    ------
    InputError
        If there are fewer than 6 points, they lie on one line or outside the photo.
    CheckError
        If no pose of the camera explains them, or two do.
    """
    _require_usable(positions, points_px, lens)
    fits = sorted((_refined(positions, points_px, lens, start, False)
                   for start in projection.likely_poses(positions, points_px, lens)),
                  key=lambda fit: fit[2])
    if not fits or not _explains(fits[0][2], len(positions), lens):
        _refuse(positions, points_px, lens, False, names)
    _require_one(fits, len(positions))
    return _pose(positions, points_px, fits[0][0], lens, False)


def pose_and_focal_length(positions: np.ndarray, points_px: np.ndarray, width: int, height: int,
                          names: Sequence[str] = ()) -> tuple[Pose, Lens]:
    """Pose and focal length of a camera of which nothing is known but its photo's size.

    Parameters
    ----------
    positions : (n, 3) array
        In the scene, any unit.
    points_px : (n, 2) array
        The same points in pixels of the whole photo.
    width, height : int
        Of the whole photo, pixels.
    names : sequence of str
        Of the points, for errors; empty numbers them.

    Raises
    ------
    InputError, CheckError
        As ``pose_from_points``; also if the points do not tell the focal length from the distance.
    """
    middle = lens_of_focal_length(float(width), width, height)
    _require_usable(positions, points_px, middle)
    fit = _with_focal(positions, points_px, middle)
    if fit is None or not _explains(fit[2], len(positions), middle):
        _refuse(positions, points_px, middle, True, names)
    lens = lens_of_focal_length(fit[1], width, height)
    jacobian = _jacobian(positions, fit[0], lens, True)
    relative = np.inf
    if np.linalg.cond(jacobian / np.linalg.norm(jacobian, axis=0)) < 1 / projection.FLAT**2:
        noise = max(fit[2] / (2 * len(positions) - 7), MIN_NOISE_PX**2)
        relative = float(np.sqrt(noise * np.linalg.inv(jacobian.T @ jacobian)[6, 6]))
    if not relative < MAX_FOCAL_ERROR:
        where = "they lie in one plane: " if projection.spread(
            positions)[2] < projection.FLAT else ""
        raise CheckError(f"the points leave the focal length open by {min(relative, 9.99):.0%} "
                         f"({MAX_FOCAL_ERROR:.0%} is the most), for it cannot be told from the "
                         f"distance; {where}give points at different depths, or the lens (--lens)")
    pose = _pose(positions, points_px, fit[0], lens, True)
    error = fit[1] * relative
    return pose, Lens(width, height, lens.matrix, lens.distortion, np.array([error, error, 0, 0]),
                      np.zeros(5), pose.rms_px, "focal length from the points of the pose; "
                      "principal point in the middle, no distortion: assumed")


def lens_of_focal_length(focal_px: float, width: int, height: int) -> Lens:
    """A pinhole without distortion that looks through the middle of the photo.

    Parameters
    ----------
    focal_px : float
    width, height : int
        Of the whole photo, pixels.
    """
    matrix = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]])
    return Lens(width, height, matrix, np.zeros(5), np.zeros(4), np.zeros(5), 0.0, "assumed")


def _require_usable(positions: np.ndarray, points_px: np.ndarray, lens: Lens) -> None:
    if len(positions) < MIN_POINTS:
        raise InputError(f"{len(positions)} points cannot determine a pose reliably; give "
                         f"{MIN_POINTS} or more")
    if projection.spread(positions)[1] < projection.FLAT:
        raise InputError(f"the {len(positions)} points lie on one line, about which the camera may "
                         "stand anywhere; give points of a surface, better of two")
    outside = np.flatnonzero(np.any((points_px < -0.5)
                                    | (points_px > [lens.width - 0.5, lens.height - 0.5]), axis=1))
    if outside.size:
        x, y = points_px[outside[0]]
        raise InputError(f"{outside.size} of the points lie outside the photo of {lens.width} x "
                         f"{lens.height} pixels, such as ({x:.0f}, {y:.0f}); give [x, y] in pixels "
                         "of the whole photo")


def _explains(squares: float, points: int, lens: Lens) -> bool:
    return bool(np.isfinite(squares) and np.sqrt(squares / points) <= ACCEPTED_SHARE * lens.width)


def _require_one(fits: list[tuple[np.ndarray, float, float]], points: int) -> None:
    """Refuse a second pose that explains the points as well (a small, distant plane turns over)."""
    noise = max(fits[0][2] / (2 * points - 6), MIN_NOISE_PX**2)
    for parameters, _, squares in fits[1:]:
        turned = projection.rotation_matrix(parameters[:3]) @ projection.rotation_matrix(
            fits[0][0][:3]).T
        if np.trace(turned) < 3 - projection.FLAT and squares - fits[0][2] < DIFFERENT**2 * noise:
            raise CheckError("two poses of the camera explain the points equally well, for they "
                             "lie in one plane that looks small or frontal; give points at "
                             "different depths")


def _refuse(positions: np.ndarray, points_px: np.ndarray, lens: Lens, free_focal: bool,
            names: Sequence[str]) -> NoReturn:
    """Say what is most likely wrong with points that no pose explains."""
    def squares(kept: np.ndarray, points: np.ndarray) -> float:
        if free_focal:
            fit = _with_focal(positions[kept], points[kept], lens)
            return np.inf if fit is None else fit[2]
        return min((_refined(positions[kept], points[kept], lens, start, False)[2]
                    for start in projection.likely_poses(positions[kept], points[kept], lens)),
                   default=np.inf)

    everyone = np.arange(len(positions))
    rms = np.sqrt(squares(everyone, points_px) / len(positions))
    refusal = "no pose of the camera explains the points"
    if np.isfinite(rms):    # else every pose has points behind the camera
        refusal += (f" (rms {rms:.1f} pixels, at most {ACCEPTED_SHARE * lens.width:.1f} is "
                    "accepted)")
    refusal += "; "
    if _explains(squares(everyone, np.abs([lens.width - 1, 0] - points_px)), len(positions), lens):
        raise CheckError(refusal + "with left and right exchanged they fit: the photo is mirrored, "
                         "or the points are matched as in a mirror")
    if len(positions) > MIN_POINTS:
        without = [squares(np.delete(everyone, index), points_px) for index in everyone]
        worst = int(np.argmin(without))
        if _explains(without[worst], len(positions) - 1, lens):
            name = repr(names[worst]) if names else f"number {worst + 1}"
            raise CheckError(refusal + f"without point {name} the others fit: correct it")
    raise CheckError(refusal + "check their order, and that all positions are in one unit")


def _with_focal(positions: np.ndarray, points_px: np.ndarray,
                middle: Lens) -> tuple[np.ndarray, float, float] | None:
    """The best fit from the likeliest of a range of focal lengths."""
    starts = []
    for focal in np.geomspace(*FOCAL_RANGE, 10) * middle.width:
        lens = lens_of_focal_length(focal, middle.width, middle.height)
        starts += [(float(np.sum(
            (projection.projected(positions, start, lens)[0] - points_px)**2)), lens, start)
                   for start in projection.likely_poses(positions, points_px, lens)]
    likeliest = sorted(starts, key=lambda one: one[0])[:STARTS]
    return min((_refined(positions, points_px, lens, start, True) for _, lens, start in likeliest),
               key=lambda fit: fit[2], default=None)


def _refined(positions: np.ndarray, points_px: np.ndarray, lens: Lens, start: np.ndarray,
             free_focal: bool) -> tuple[np.ndarray, float, float]:
    """Rotation vector and shift (6,), focal length, and the sum of squared residuals (px
    squared).
    """
    def at(parameters: np.ndarray) -> Lens:
        if not free_focal:
            return lens
        return lens_of_focal_length(lens.matrix[0, 0] * float(np.exp(parameters[6])), lens.width,
                                    lens.height)

    def misses(parameters: np.ndarray) -> np.ndarray:
        seen = projection.projected(positions, parameters[:6], at(parameters))[0] - points_px
        return np.where(np.isfinite(seen), seen, FAR_PX).ravel()

    def slope(parameters: np.ndarray) -> np.ndarray:
        derivative = projection.projected(positions, parameters[:6], at(parameters))[1]
        log_focal = derivative[:, 6:8] @ np.diag(at(parameters).matrix)[:2]
        return np.column_stack([derivative[:, :6], log_focal]) if free_focal else derivative[:, :6]

    solution = least_squares(misses, np.append(start, 0.0) if free_focal else start, slope,
                          x_scale="jac", method="lm", max_nfev=MAX_STEPS)
    behind = (positions @ projection.rotation_matrix(solution.x[:3]).T + solution.x[3:6])[:, 2] <= 0
    return (solution.x[:6], float(at(solution.x).matrix[0, 0]), np.inf if behind.any()
            else float(2 * solution.cost))


def _pose(positions: np.ndarray, points_px: np.ndarray, parameters: np.ndarray, lens: Lens,
          free_focal: bool) -> Pose:
    seen, derivative = projection.projected(positions, parameters, lens)
    residuals = points_px - seen
    jacobian = _jacobian(positions, parameters, lens, free_focal)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    noise = float(np.sum(residuals**2)) / (2 * len(positions) - jacobian.shape[1])
    follows = inverse @ jacobian.T @ derivative[:, 6:10]  # how the pose follows fx, fy, cx, cy
    covariance = noise * inverse + follows @ np.diag(lens.standard_error**2) @ follows.T
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3], world_to_camera[:3, 3] = projection.rotation_matrix(
        parameters[:3]), parameters[3:]
    return Pose(world_to_camera, covariance[:6, :6], residuals,
                float(np.sqrt(np.mean(np.sum(residuals**2, axis=1)))))


def _jacobian(positions: np.ndarray, parameters: np.ndarray, lens: Lens,
              free_focal: bool) -> np.ndarray:
    """Of the pixels (2 n) by a small turn in camera axes, the shift, and the focal length's log
    where it is free.
    """
    _, derivative = projection.projected(positions, parameters, lens)
    shift = derivative[:, 3:6]
    turned = np.repeat(positions @ projection.rotation_matrix(parameters[:3]).T, 2, axis=0)
    # shift . (turn x position) = turn . (position x shift)
    columns = [np.cross(turned, shift), shift]
    if free_focal:
        columns.append((derivative[:, 6:8] @ np.diag(lens.matrix)[:2])[:, None])
    return np.concatenate(columns, axis=1)
