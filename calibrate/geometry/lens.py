"""A camera's lens and pose as records, and as the numbers of Mitsuba's ``perspective`` sensor.

OpenCV's camera looks along +z with x to the right and y down; (0, 0) is the centre of the top-left
pixel. Mitsuba's ``perspective`` sensor looks along +z with x to the left and y up, has square
pixels and no distortion: photos are undistorted to that pinhole before they are compared with a
rendering. Pixels are those of the whole photo (``LinearImage.sensor_step`` of them to one pixel of
a linear image).
"""
from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from spectrabox.radiometry import checked_tables, errors, files, shaped

OPENCV_TO_MITSUBA = np.diag([-1.0, -1.0, 1.0, 1.0])
STEP = 1e-6             # of rotations in radians, and of shifts as a share of their length


@dataclass(frozen=True, eq=False)
class Lens(shaped.Record):
    """Pinhole and distortion of a camera at a zoom and focus; standard errors of 0: assumed."""

    width: int                                          # pixels of the whole photo
    height: int
    matrix: Annotated[np.ndarray, "3 3"]                # pixels
    distortion: Annotated[np.ndarray, "D"]              # k1 k2 p1 p2 k3 of OpenCV
    standard_error: Annotated[np.ndarray, "4"]          # of fx, fy, cx, cy in pixels
    distortion_error: Annotated[np.ndarray, "D"]
    rms_px: float                                       # of the points' reprojection errors
    source: str


@dataclass(frozen=True, eq=False)
class Pose(shaped.Record):
    """The camera's pose: world (the scene's unit) to OpenCV camera coordinates."""

    world_to_camera: Annotated[np.ndarray, "4 4"]
    covariance: Annotated[np.ndarray, "6 6"]            # small turn (rad, camera axes), shift
    residuals_px: Annotated[np.ndarray, "n 2"]          # photo - reprojection
    rms_px: float

    @property
    def position(self) -> np.ndarray:
        """Where (3,) the camera is in the scene, in its unit."""
        return self._view(np.zeros(6))[:3]

    @property
    def position_standard_error(self) -> np.ndarray:
        """Of the position (3,)."""
        return np.sqrt(np.diag(self._view_covariance)[:3])

    @property
    def direction(self) -> np.ndarray:
        """Unit vector (3,) along which the camera looks."""
        return self._view(np.zeros(6))[3:]

    @property
    def direction_standard_error_deg(self) -> float:
        """Of the direction."""
        return float(np.degrees(np.sqrt(np.trace(self._view_covariance[3:, 3:]))))

    def _view(self, step: np.ndarray) -> np.ndarray:
        """Position and direction (6,) of the camera moved by a step (6,), as of the covariance."""
        rotation = _turn(step[:3]) @ self.world_to_camera[:3, :3]
        return np.concatenate([-rotation.T @ (self.world_to_camera[:3, 3] + step[3:]), rotation[2]])

    @property
    def _view_covariance(self) -> np.ndarray:
        """Covariance (6, 6) of position and direction."""
        sizes = np.repeat([STEP, STEP * max(float(np.linalg.norm(self.world_to_camera[:3, 3])),
                                            STEP)], 3)
        jacobian = np.stack([(self._view(step) - self._view(-step)) / (2 * size)
                             for step, size in zip(np.diag(sizes), sizes, strict=True)], axis=1)
        return np.asarray(jacobian @ self.covariance @ jacobian.T)


def pinhole(lens: Lens) -> np.ndarray:
    """Camera matrix (3, 3) of the undistorted photo: square pixels, the same principal point.

    Parameters
    ----------
    lens : Lens
    """
    matrix = lens.matrix.copy()
    matrix[1, 1] = matrix[0, 0]
    return matrix


def mitsuba_sensor(lens: Lens, pose: Pose) -> dict[str, Any]:
    """Parameters of a ``perspective`` sensor.

    ``to_world`` (4, 4), ``fov`` in degrees along x, principal point offsets.

    Parameters
    ----------
    lens : Lens
    pose : Pose
    """
    matrix = pinhole(lens)
    return {"to_world": np.linalg.inv(pose.world_to_camera) @ OPENCV_TO_MITSUBA,
            "fov": float(np.degrees(2 * np.arctan(lens.width / (2 * matrix[0, 0])))),
            "fov_axis": "x",
            "principal_point_offset_x": float(0.5 - (matrix[0, 2] + 0.5) / lens.width),
            "principal_point_offset_y": float(0.5 - (matrix[1, 2] + 0.5) / lens.height)}


def _turn(angles: np.ndarray) -> np.ndarray:
    """Rotation by small angles: exact to their square."""
    x, y, z = angles
    return np.eye(3) + np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


# ---- files ---------------------------------------------------------------------------------------
# A lens as a small JSON file.

FORMAT = "spectrabox lens 1"
ARRAYS = ("matrix", "distortion", "standard_error", "distortion_error")
Row = Annotated[checked_tables.ListOf[float], Field(min_length=3, max_length=3)]
Distortion = Annotated[checked_tables.ListOf[float], Field(min_length=5, max_length=5)]


class LensTable(checked_tables.Table):
    """A lens file."""

    format: Literal["spectrabox lens 1"]
    width: int
    height: int
    matrix: Annotated[checked_tables.ListOf[Row], Field(min_length=3, max_length=3)]
    distortion: Distortion
    standard_error: Annotated[checked_tables.ListOf[float], Field(min_length=4, max_length=4)]
    distortion_error: Distortion
    rms_px: float
    source: str

    @model_validator(mode="after")
    def focal_length_is_positive(self) -> LensTable:
        """Refuse a lens that would turn pictures inside out."""
        if not (self.matrix[0][0] > 0 and self.matrix[1][1] > 0):
            raise ValueError("its focal length is not positive")
        return self


def lens_facts(lens: Lens) -> dict[str, object]:
    """What the file holds, in pixels of the whole photo.

    Parameters
    ----------
    lens : Lens
    """
    return {"format": FORMAT, "width": lens.width, "height": lens.height,
            **{name: getattr(lens, name).tolist() for name in ARRAYS}, "rms_px": lens.rms_px,
            "source": lens.source}


def write_lens(path: Path, lens: Lens) -> None:
    """Write the lens, whole or not at all.

    Parameters
    ----------
    path : Path
    lens : Lens
    """
    files.write_text_whole(path, json.dumps(lens_facts(lens), indent=1) + "\n")


def read_lens(path: Path) -> Lens:
    """A lens that ``write_lens`` wrote.

    Parameters
    ----------
    path : Path
        JSON.

    Raises
    ------
    InputError
        If the file is missing, or is not such a file.
    """
    try:
        written = LensTable.model_validate_json(path.read_bytes())
    except OSError as error:
        raise errors.InputError(f"{path} cannot be read ({error.strerror}); "
                         "write one with 'spectrabox geometry lens'") from None
    except ValidationError as error:
        reasons = "; ".join(checked_tables.fault_sentences(error, LensTable))
        raise errors.InputError(
            f"{path.name} is no lens file ({reasons}); write one with 'spectrabox "
            "geometry lens'") from None
    facts = dict(written) | {name: np.array(getattr(written, name)) for name in ARRAYS}
    del facts["format"]
    return Lens(**facts)
