"""Where a photogrammetric model lies in the scene: a similarity, from points marked in pictures.

Structure from motion leaves the world's place, direction and unit open. Points of the scene that
are marked in two pictures or more are triangulated [Hartley and Zisserman 2004, 12.2, by the
shortest distances to their rays]; the similarity between them and the scene [Umeyama 1991] is then
refined by the marks' reprojection errors, whose scatter gives its covariance. The pictures' poses
are taken as the model has them.
"""
from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from spectrabox.calibrate.geometry import colmap_model, lens, projection
from spectrabox.radiometry import errors, shaped

MIN_POINTS = 3              # in two pictures each: a similarity has 7 parameters
ACCEPTED_SHARE = 0.005      # rms, of the pictures' width, as of a pose
MIN_NOISE_PX = 0.05
MIN_PARALLAX_DEG = 1.0      # between two rays to a point
STEP = 1e-6                 # for derivatives: of turns in radians, of lengths as a share

Marks = Mapping[str, Mapping[str, tuple[float, float]]]     # picture -> point -> pixels


@dataclass(frozen=True, eq=False)
class ModelInScene(shaped.Record):
    """scene = scale * rotation @ model + shift, and how well the marks agree."""

    scale: float                                    # the scene's unit for one of the model
    scale_error: float
    rotation: Annotated[np.ndarray, "3 3"]
    shift: Annotated[np.ndarray, "3"]
    covariance: Annotated[np.ndarray, "7 7"]        # log scale, small turn (rad), shift
    residuals_px: dict[tuple[str, str], float]      # of each mark, by picture and point
    distances: dict[str, float]     # triangulated from where the scene has it, the scene's unit
    rms_px: float


def model_in_scene(images: Mapping[str, colmap_model.Picture], marks: Marks,
                   positions: Mapping[str, tuple[float, float, float]]) -> ModelInScene:
    """The similarity from a model to the scene.

    Parameters
    ----------
    images : mapping of name to Picture
        Those with marks at least.
    marks : mapping of picture to (mapping of point to [x, y])
        In pixels of the model's picture.
    positions : mapping of point to [x, y, z]
        In the scene.

    Raises
    ------
    InputError
        If fewer than three points are marked in two pictures each, or they lie on a line.
    CheckError
        If two pictures see a point from nearly the same place, or no similarity explains the marks.
    """
    seen: defaultdict[str, list[str]] = defaultdict(list)
    for picture, points in marks.items():
        for point in points:
            seen[point].append(picture)
    twice = [point for point, pictures in seen.items() if len(pictures) > 1]
    if len(twice) < MIN_POINTS:
        raise errors.InputError(
            f"{len(twice)} points are marked in two pictures or more; {MIN_POINTS} "
            "are needed to tie the model to the scene, better six")
    _require_inside(images, marks)
    there = np.array([positions[point] for point in twice], dtype=float)
    if projection.spread(there)[1] < projection.FLAT:
        raise errors.InputError(
            "the points marked in two pictures lie on one line, about which the model "
            "may turn; mark others")
    triangulated = np.array([_triangulated(point, {name: marks[name][point]
                                                   for name in seen[point]}, images)
                             for point in twice])
    start = _umeyama(triangulated, there)
    known = _known(images, marks, positions)
    fit = _refined(start, known)
    names = [(picture, point) for picture, points in marks.items() for point in points]
    _require_explained(fit, start, known, {
        point: _known(images, marks, positions, without=point)
        for point in (twice if len(twice) > MIN_POINTS else ())})
    scale, rotation, shift = _parts(start, fit)
    misses = _misses(start, fit, known)
    jacobian = _slope(start, fit, known)
    noise = max(float(np.sum(misses**2)) / (misses.size - 7), MIN_NOISE_PX**2)
    covariance = noise * np.linalg.inv(jacobian.T @ jacobian)
    lengths = np.linalg.norm(misses, axis=1)
    in_scene = scale * triangulated @ rotation.T + shift
    return ModelInScene(
        scale, scale * float(np.sqrt(covariance[0, 0])), rotation, shift, covariance,
        dict(zip(names, lengths.tolist(), strict=True)),
        dict(zip(twice, np.linalg.norm(in_scene - there, axis=1).tolist(), strict=True)),
        float(np.sqrt(np.mean(lengths**2))))


def pose_in_scene(from_model: np.ndarray, model: ModelInScene) -> lens.Pose:
    """The pose of one of the model's pictures in the scene, with the similarity's errors.

    Parameters
    ----------
    from_model : (4, 4) array
        From the model's world to the picture's camera.
    model : ModelInScene
    """
    def moved(step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        scale = model.scale * np.exp(step[0])
        rotation = Rotation.from_rotvec(step[1:4]).as_matrix() @ model.rotation
        turn = from_model[:3, :3] @ rotation.T
        return turn, scale * from_model[:3, 3] - turn @ (model.shift + step[4:])

    turn, shift = moved(np.zeros(7))
    sizes = _sizes(model.shift, float(np.linalg.norm(shift)))
    columns = []
    for step, size in zip(np.diag(sizes), sizes, strict=True):
        (ahead, there), (behind, here) = moved(step), moved(-step)
        columns.append(np.concatenate([Rotation.from_matrix(ahead @ behind.T).as_rotvec(),
                                       there - here]) / (2 * size))
    jacobian = np.stack(columns, axis=1)
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3], world_to_camera[:3, 3] = turn, shift
    return lens.Pose(world_to_camera, jacobian @ model.covariance @ jacobian.T, np.zeros((0, 2)),
                model.rms_px)


def _require_inside(images: Mapping[str, colmap_model.Picture], marks: Marks) -> None:
    for picture, points in marks.items():
        seen_by, _ = images[picture]
        width, height = seen_by.width, seen_by.height
        for point, (x, y) in points.items():
            if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
                raise errors.InputError(
                    f"{point!r} lies at ({x:.0f}, {y:.0f}), outside {picture} of "
                    f"{width} x {height} pixels as COLMAP saw it; give pixels of that "
                    "picture")


def _triangulated(point: str, marks: Mapping[str, tuple[float, float]],
                  images: Mapping[str, colmap_model.Picture]) -> np.ndarray:
    """The place (3,) in the model that lies nearest to the rays of one point."""
    normal, wanted, rays = np.zeros((3, 3)), np.zeros(3), []
    for name, px in marks.items():
        seen_by, pose = images[name]
        ray = pose[:3, :3].T @ projection.image_rays(np.array([px], dtype=float), seen_by)[0]
        across = np.eye(3) - np.outer(ray, ray)
        normal += across
        wanted += across @ (-pose[:3, :3].T @ pose[:3, 3])
        rays.append(ray)
    parallax = np.degrees(np.arccos(np.clip(np.min(np.array(rays) @ np.array(rays).T), -1, 1)))
    if parallax < MIN_PARALLAX_DEG:
        raise errors.CheckError(
            f"{point!r} is seen from nearly the same place in {' and '.join(marks)} "
            f"(rays {parallax:.1f} degrees apart, {MIN_PARALLAX_DEG:g} are needed); "
            "mark it in pictures taken further from each other")
    return np.asarray(np.linalg.solve(normal, wanted))


def _umeyama(model: np.ndarray, scene: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale, rotation and shift of least squares, Eqs. 40 to 43 of Umeyama 1991."""
    middle, target = model.mean(axis=0), scene.mean(axis=0)
    left, size, right = np.linalg.svd((scene - target).T @ (model - middle))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = left @ np.diag(sign) @ right
    scale = float(size @ sign / np.sum((model - middle) ** 2))
    return scale, rotation, target - scale * rotation @ middle


Similarity = tuple[float, np.ndarray, np.ndarray]


# every picture, and places (n, 3) in the scene with the pixels (n, 2) they lie at
Known = list[tuple[colmap_model.Picture, np.ndarray, np.ndarray]]


def _known(images: Mapping[str, colmap_model.Picture], marks: Marks,
           positions: Mapping[str, tuple[float, float, float]],
           without: str | None = None) -> Known:
    """What the pictures show, all but one point where it is named."""
    shown = {picture: [point for point in points if point != without]
             for picture, points in marks.items()}
    return [(images[picture], np.array([positions[point] for point in points], dtype=float),
             np.array([marks[picture][point] for point in points], dtype=float))
            for picture, points in shown.items() if points]


def _parts(start: Similarity, step: np.ndarray) -> Similarity:
    scale, rotation, shift = start
    turn = Rotation.from_rotvec(step[1:4]).as_matrix()
    return scale * float(np.exp(step[0])), turn @ rotation, shift + step[4:]


def _misses(start: Similarity, step: np.ndarray, known: Known) -> np.ndarray:
    """Pixels (n, 2) by which the marks are missed."""
    scale, rotation, shift = _parts(start, step)
    missed = []
    for (seen_by, from_model), places, points_px in known:
        turn = from_model[:3, :3] @ rotation.T
        there = scale * from_model[:3, 3] - turn @ shift
        pose = np.concatenate([Rotation.from_matrix(turn).as_rotvec(), there])
        missed.append(projection.projected(places, pose, seen_by)[0] - points_px)
    return np.concatenate(missed)


def _sizes(shift: np.ndarray, distance: float) -> np.ndarray:
    """Steps (7,) of derivatives."""
    length = max(float(np.linalg.norm(shift)), float(distance), STEP)
    return STEP * np.array([1, 1, 1, 1, length, length, length])


def _slope(start: Similarity, step: np.ndarray, known: Known) -> np.ndarray:
    """Derivative (2 n, 7) of the misses."""
    sizes = _sizes(start[2], start[0])
    return np.stack([(_misses(start, step + each, known) - _misses(start, step - each, known)
                      ).ravel() / (2 * size)
                     for each, size in zip(np.diag(sizes), sizes, strict=True)], axis=1)


def _refined(start: Similarity, known: Known) -> np.ndarray:
    """The step (7,) from the start that explains the marks best."""
    solution = least_squares(lambda step: _misses(start, step, known).ravel(), np.zeros(7),
                             jac=lambda step: _slope(start, step, known), x_scale="jac",
                             method="lm")
    return np.asarray(solution.x)


def _require_explained(fit: np.ndarray, start: Similarity, known: Known,
                       without: Mapping[str, Known]) -> None:
    """Refuse marks that no similarity explains, with the point ``without`` which it would."""
    allowed = ACCEPTED_SHARE * float(np.mean([seen_by.width for (seen_by, _), _, _ in known]))

    def rms(step: np.ndarray, marks: Known) -> float:
        return float(np.sqrt(np.mean(np.sum(_misses(start, step, marks) ** 2, axis=1))))

    fitted_rms = rms(fit, known)
    if fitted_rms <= allowed:
        return
    refusal = (f"the model does not fit the marked points (rms {fitted_rms:.1f} pixels, at most "
               f"{allowed:.1f} is accepted); ")
    for point, others in without.items():
        if rms(_refined(start, others), others) <= allowed:
            raise errors.CheckError(refusal + f"without {point!r} the others fit: correct it")
    raise errors.CheckError(refusal
                            + "check that left and right are not exchanged and that the measures "
                            "are in one unit")
