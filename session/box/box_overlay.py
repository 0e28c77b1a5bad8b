"""The camera of a measured box, in words and as a drawing over its photos."""


from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.geometry.projection import points_overlay
from spectrabox.capture.develop.developed import open_any
from spectrabox.capture.photo import image_writers, preview
from spectrabox.measure.scene.box_camera import BoxCamera, box_camera, box_text, visible_corners
from spectrabox.measure.shoot import captures, shoot
from spectrabox.reconstruct.scene.box_scene import box_edges
from spectrabox.session.box.scenes import named_after
from spectrabox.session.config.session_file import SessionConfig


def camera_facts(camera: BoxCamera) -> dict[str, Any]:
    """For scripts: places in millimetres, angles in degrees, residuals in pixels.

    Parameters
    ----------
    camera : BoxCamera
    """
    facts: dict[str, Any] = {"how": camera.how, "at_mm": camera.at_mm, "direction":
                             camera.direction, "fov_deg": camera.fov_deg}
    if camera.how == "measured":
        return facts
    facts |= {"standard_error_mm": camera.standard_error_mm,
              "direction_standard_error_deg": camera.direction_error_deg,
              "residuals_px": camera.residuals_px}
    if (model := camera.model) is not None:
        by_picture: dict[str, dict[str, float]] = {}
        for (picture, corner), residual in model.residuals_px.items():
            by_picture.setdefault(picture, {})[corner] = residual
        facts["colmap"] = {
            "mm_per_unit": model.scale, "mm_per_unit_standard_error": model.scale_error,
            "rms_px": model.rms_px, "distances_mm": model.distances,
            "residuals_px": by_picture}
    return facts


def camera_text(name: str, camera: BoxCamera) -> list[str]:
    """Lines for a person.

    Parameters
    ----------
    name : str
        Of the view; empty where there is one.
    camera : BoxCamera
    """
    whose = f"{name}: " if name else ""
    if camera.how == "measured":
        return [f"{whose}the camera stands as measured: the edges drawn over the photo show how "
                "well"]
    position = ", ".join(f"{value:.1f} ({error:.1f})" for value, error in
                         zip(camera.at_mm, camera.standard_error_mm, strict=True))
    lines = [f"{whose}camera at {position} mm (standard errors in brackets), its direction known "
             f"to {camera.direction_error_deg:.2f} degrees, field of view {camera.fov_deg:.1f} "
             "degrees across"]
    if (model := camera.model) is None:
        worst = max(camera.residuals_px, key=lambda name: camera.residuals_px[name])
        return [*lines, f"{len(camera.residuals_px)} corners, largest residual "
                f"{camera.residuals_px[worst]:.2f} pixels at {worst}"]
    picture, corner = max(model.residuals_px, key=lambda mark: model.residuals_px[mark])
    far = max(model.distances, key=lambda point: model.distances[point])
    return [*lines, f"COLMAP model: {model.scale:.5g} ({model.scale_error:.2g}) mm to its unit; "
            f"{len(model.residuals_px)} marks of corners, rms {model.rms_px:.2f} pixels, largest "
            f"{model.residuals_px[picture, corner]:.2f} at {corner} in {picture}",
            f"{len(model.distances)} corners are seen by two pictures or more: furthest from where "
            f"the tape has it is {far}, by {model.distances[far]:.1f} mm"]


# ---- a measured box drawn over its photos, as its cameras see it ---------------------------------

OVERLAY_NAME = "box.png"


def box_views(config: SessionConfig) -> list[shoot.CompleteView]:
    """The first photo of a measured box, and those that another camera took or that show it
    turned.
    """
    first, *others = config.all_views
    return [first, *(view for view in others if view.scene is None
                     and (view.camera is not None or view.turn_deg))]


def box_texts(config: SessionConfig) -> dict[str, str]:
    """XML of the scenes that [scene.box] describes, by the first view of each.

    Raises
    ------
    InputError, CheckError
        As ``box_text``.
    """
    return {view.name: box_text(captures.box_photo(config, config.inputs, view))
            for view in box_views(config)}


def corners_in_photo(config: SessionConfig,
                     view: shoot.CompleteView | None = None) -> dict[str, tuple[float, float]]:
    """Pixels of the photo, by name, at which the camera sees corners of the box and of boxes in it.

    Parameters
    ----------
    config : SessionConfig
    view : CompleteView, optional
        The first by default.

    Raises
    ------
    InputError, CheckError
        As ``box_camera``.
    """
    stated = captures.box_photo(config, config.inputs, view)
    return visible_corners(box_camera(stated), stated.box.corner_positions())


def write_overlays(config: SessionConfig) -> list[Path]:
    """Write each photo with the box's edges as its camera would see them, and the marked corners.

    Returns
    -------
    list of Path
        One for each of ``box_views``.
    """
    paths = []
    for view in box_views(config):
        paths.append(named_after(config, OVERLAY_NAME, view.name))
        image_writers.write_png(paths[-1], overlay(config, view))
    return paths


def overlay(config: SessionConfig, view: shoot.CompleteView) -> np.ndarray:
    """A photo (H, W, 3) uint8 with the box's edges and the marked corners drawn over it.

    Edges are drawn straight, through ends that the lens bends.
    """
    assert config.box is not None
    seen, stated = corners_in_photo(config, view), captures.box_photo(config, config.inputs, view)
    # a turned view without its own camera has no marks: its camera is the first photo's
    marked = box_camera(stated).marks if stated.camera_view == view.name else {}
    image = open_any(config.path(view.photo_files[0]), not_linear=True)
    lines = np.array([[seen[start], seen[end]] for start, end in box_edges(config.box)])
    return points_overlay(preview.signal_rgb8(image.signal),
                          np.array([*marked.values()]).reshape(-1, 2),
                          np.array([seen[name] for name in marked]).reshape(-1, 2),
                          image.sensor_step, lines)
