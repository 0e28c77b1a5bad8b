"""How a simple lens darkens towards the corners: the gain field of a view that has no flat-field
photo.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.scene.scene_file import SceneFile


def cos4_gain(scene_file: SceneFile, size: tuple[int, int]) -> np.ndarray:
    """Relative response (H, W) of the camera by the cos^4 law of natural vignetting, 1 on its axis.

    A lens with a wide barrel does worse, a telecentric one better: a flat-field photo is always to
    be preferred.

    Parameters
    ----------
    size : (width, height) in pixels

    Raises
    ------
    InputError
        If the scene's camera states no field of view in degrees.
    """
    sensor = scene_file.root.find("sensor")
    assert sensor is not None
    fields = {node.get("name"): node.get("value", "") for node in sensor}
    try:
        angle = np.tan(np.radians(float(fields["fov"])) / 2)
    except (KeyError, ValueError):
        raise InputError(f"{scene_file.path.name}: the camera states no <float name=\"fov\"> in "
                         "degrees, which vignetting follows from") from None
    width, height = size
    axis = fields.get("fov_axis", "x")
    sides = {"x": width, "y": height, "smaller": min(size), "larger": max(size),
             "diagonal": np.hypot(*size)}
    if axis not in sides:
        raise InputError(f"{scene_file.path.name}: fov_axis is {axis!r}; use one of "
                         f"{', '.join(sides)}")
    half = sides[axis] / 2
    offset = [float(fields.get(f"principal_point_offset_{name}", 0.0)) for name in "xy"]
    x = (np.arange(width) + 0.5 - width / 2 + offset[0] * width) / half * angle
    y = (np.arange(height) + 0.5 - height / 2 + offset[1] * height) / half * angle
    gain: np.ndarray = (1 + x[None] ** 2 + y[:, None] ** 2) ** -2
    return gain
