"""Cameras of a box's photos out of a COLMAP model that marked corners tie to the box."""
from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.session.config.session_schema import FILE_NAME, SessionConfig

if TYPE_CHECKING:
    import numpy as np

    from spectrabox.calibrate.geometry.lens import Lens, Pose
    from spectrabox.calibrate.geometry.model_in_scene import ModelInScene

PLACE = f"{FILE_NAME}: scene.box.colmap"
SHOWN = 12              # names of pictures in an error


@dataclass(frozen=True)
class ColmapCamera:
    """A camera of the model in the box's coordinates, millimetres."""

    lens: Lens                                      # in pixels of the whole photo
    pose: Pose
    marks: dict[str, tuple[float, float]]           # corners marked in it, pixels of the photo
    residuals_px: dict[str, float]                  # of these, in the model's pictures' pixels
    model: ModelInScene


def colmap_files(config: SessionConfig) -> list[str]:
    """Names of the files of the model; none where the session has no model."""
    if config.box is None or config.box.colmap is None:
        return []
    from spectrabox.calibrate.geometry.colmap_model import CAMERAS_NAME, IMAGES_NAME
    folder = config.box.colmap.folder.rstrip("/")
    return [f"{folder}/{name}" for name in (CAMERAS_NAME, IMAGES_NAME)]


def colmap_camera(config: SessionConfig, image: str, size: tuple[int, int]) -> ColmapCamera:
    """The camera of one picture of the model.

    Parameters
    ----------
    image : str
        Its name in the model.
    size : (width, height)
        Of the whole photo in pixels; COLMAP may have seen a smaller copy.

    Raises
    ------
    InputError
        If the model cannot be read, lacks a picture, or too few corners are marked.
    CheckError
        If model and marked corners do not fit.
    """
    import numpy as np

    from spectrabox.calibrate.geometry.colmap_model import for_photo, read_colmap
    from spectrabox.calibrate.geometry.model_in_scene import model_in_scene, pose_in_scene
    assert config.box is not None and config.box.colmap is not None
    table = config.box.colmap
    images = read_colmap(config.path(table.folder))
    for name in (image, *table.corners_px):
        if name not in images:
            some = ", ".join([*images][:SHOWN]) + (", ..." if len(images) > SHOWN else "")
            raise InputError(f"{PLACE}: the model has no picture {name!r}; it has {some}")
    marks = {name: {corner: (x, y) for corner, (x, y) in corners.items()}
             for name, corners in table.corners_px.items()}
    try:
        model = model_in_scene(images, marks, config.box.corner_positions())
    except SpectraboxError as fault:
        raise type(fault)(f"{PLACE}: {fault}") from None
    lens = for_photo(images[image].lens, *size, image)
    scale = np.array(size) / (images[image].lens.width, images[image].lens.height)
    here = {corner: _scaled(px, scale) for corner, px in marks.get(image, {}).items()}
    return ColmapCamera(lens, pose_in_scene(images[image], model), here,
                        {corner: model.residuals_px[image, corner] for corner in here}, model)


def _scaled(px: tuple[float, float], scale: np.ndarray) -> tuple[float, float]:
    x, y = ((along + 0.5) * by - 0.5 for along, by in zip(px, scale, strict=True))
    return float(x), float(y)
