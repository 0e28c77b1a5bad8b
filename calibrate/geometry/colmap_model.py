"""Cameras and poses of a COLMAP model in its text form: ``cameras.txt`` and ``images.txt``.

COLMAP's formats as its documentation states them (https://colmap.github.io/format.html, camera
models in ``src/colmap/sensor/models.h``). A pose takes the world to the camera, x to the right, y
down, z ahead, as OpenCV has it. The centre of COLMAP's first pixel is (0.5, 0.5), ours is (0, 0).
The world's place, direction and unit mean nothing: ``model_in_scene`` finds them.
"""
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spectrabox.calibrate.geometry.lens import Lens
from spectrabox.radiometry import files
from spectrabox.radiometry.errors import InputError

CAMERAS_NAME, IMAGES_NAME = "cameras.txt", "images.txt"
# indices of fx, fy, cx, cy, k1, k2, p1, p2 among a model's parameters; None: 0
MODELS: Mapping[str, tuple[int | None, ...]] = {
    "SIMPLE_PINHOLE": (0, 0, 1, 2, None, None, None, None),
    "PINHOLE": (0, 1, 2, 3, None, None, None, None),
    "SIMPLE_RADIAL": (0, 0, 1, 2, 3, None, None, None),
    "RADIAL": (0, 0, 1, 2, 3, 4, None, None),
    "OPENCV": (0, 1, 2, 3, 4, 5, 6, 7)}
HALF_PIXEL = 0.5
MAX_SHAPE_ERROR = 1e-3      # between the shapes of COLMAP's picture and of the photo
UNIT = 1e-3                 # how far a quaternion's length may be from 1
EXPORT = ("export the model as text with 'colmap model_converter --input_path sparse/0 "
          "--output_path colmap --output_type TXT'")


# a picture of a model: the lens in its own pixels, and world to camera (4, 4) in the model's unit
Picture = tuple[Lens, np.ndarray]


def read_colmap(folder: Path) -> dict[str, Picture]:
    """The pictures of a model by name.

    Parameters
    ----------
    folder : Path
        With ``cameras.txt`` and ``images.txt``.

    Raises
    ------
    InputError
        If a file is missing or not of that form, or a camera's model is not one of ``MODELS``.
    """
    cameras = _cameras(folder / CAMERAS_NAME)
    images: dict[str, Picture] = {}
    lines = iter(enumerate(_lines(folder / IMAGES_NAME), start=1))
    for number, line in lines:
        if not line or line.startswith("#"):
            continue
        next(lines, None)           # the picture's points, an empty line where it has none
        name, picture = _picture(line, f"{IMAGES_NAME}, line {number}", cameras)
        images[name] = picture
    if not images:
        raise InputError(f"{IMAGES_NAME} of {folder} holds no picture; {EXPORT}")
    return images


def for_photo(lens: Lens, width: int, height: int, name: str) -> Lens:
    """The same lens for a photo of another size, of which COLMAP saw a smaller or larger copy.

    Parameters
    ----------
    lens : Lens
        In the pixels of COLMAP's picture.
    width, height : int
        Of the whole photo, pixels.
    name : str
        Of the picture, for errors.

    Raises
    ------
    InputError
        If the two have different shapes.
    """
    scale = np.array([width / lens.width, height / lens.height])
    if abs(scale[0] / scale[1] - 1) > MAX_SHAPE_ERROR:
        raise InputError(f"COLMAP saw {name} with {lens.width} x {lens.height} pixels, and the "
                         f"photo has {width} x {height}, which is another shape: a crop has "
                         "another middle. Give COLMAP whole photos, developed without cropping")
    matrix = lens.matrix.copy()
    matrix[[0, 1], [0, 1]] *= scale
    matrix[:2, 2] = (matrix[:2, 2] + HALF_PIXEL) * scale - HALF_PIXEL
    return Lens(width, height, matrix, lens.distortion, lens.standard_error * np.tile(scale, 2),
                lens.distortion_error, lens.rms_px * float(scale.mean()), lens.source)


def _cameras(path: Path) -> dict[str, Lens]:
    cameras = {}
    for number, line in enumerate(_lines(path), start=1):
        if not line or line.startswith("#"):
            continue
        where = f"{CAMERAS_NAME}, line {number}"
        words = line.split()
        if len(words) < 4:
            raise InputError(f"{where}: a camera has an id, a model, width, height and "
                             f"parameters; {EXPORT}")
        identity, model, *rest = words
        if model not in MODELS:
            raise InputError(f"{where}: the camera model {model} is not known; known are "
                             f"{', '.join(MODELS)}: run COLMAP with --ImageReader.camera_model "
                             "OPENCV, or undistort its pictures")
        width, height, *parameters = _numbers(rest, where)
        needed = max(index for index in MODELS[model] if index is not None) + 1
        if len(parameters) != needed:
            raise InputError(f"{where}: {model} has {needed} parameters, not {len(parameters)}")
        cameras[identity] = _lens(model, int(width), int(height), parameters, where)
    return cameras


def _lens(model: str, width: int, height: int, parameters: list[float], where: str) -> Lens:
    fx, fy, cx, cy, *distortion = (0.0 if index is None else parameters[index]
                                   for index in MODELS[model])
    if min(width, height, fx, fy) <= 0:
        raise InputError(f"{where}: size and focal length of a camera must be positive")
    matrix = np.array([[fx, 0, cx - HALF_PIXEL], [0, fy, cy - HALF_PIXEL], [0, 0, 1]])
    return Lens(width, height, matrix, np.array([*distortion, 0.0]), np.zeros(4), np.zeros(5), 0.0,
                f"COLMAP, {model}")


def _picture(line: str, where: str, cameras: Mapping[str, Lens]) -> tuple[str, Picture]:
    """The name and picture of a line."""
    words = line.split(maxsplit=9)
    if len(words) < 10:
        raise InputError(f"{where}: a picture has an id, a quaternion of four numbers, three of a "
                         "shift, a camera and a name, and a line of points below; " + EXPORT)
    quaternion, shift = np.split(np.array(_numbers(words[1:8], where)), [4])
    if words[8] not in cameras:
        raise InputError(f"{where}: {CAMERAS_NAME} has no camera {words[8]}; give the two files "
                         "of one model")
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1) > UNIT:
        raise InputError(f"{where}: the quaternion's length is {length:.4f}, not 1; {EXPORT}")
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3], world_to_camera[:3, 3] = _rotation(quaternion / length), shift
    return words[9], (cameras[words[8]], world_to_camera)


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    """Of a unit quaternion w, x, y, z (Hamilton's, as Eigen and COLMAP have it)."""
    w, (x, y, z) = quaternion[0], quaternion[1:]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


def _lines(path: Path) -> list[str]:
    try:
        return [line.strip() for line in files.read_text(path).splitlines()]
    except FileNotFoundError:
        binary = path.with_suffix(".bin").is_file()
        raise InputError(f"{path} is missing{' and its binary form is there' if binary else ''}; "
                         f"{EXPORT}") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read ({error}); {EXPORT}") from None


def _numbers(words: list[str], where: str) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        raise InputError(f"{where}: {' '.join(words)!r} are not all numbers; {EXPORT}") from None
    if not np.all(np.isfinite(numbers)):
        raise InputError(f"{where}: {' '.join(words)!r} are not all finite; {EXPORT}")
    return numbers
