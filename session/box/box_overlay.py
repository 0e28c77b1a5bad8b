"""A measured box drawn over its photos, as its cameras see it."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.calibrate.geometry.projection import points_overlay
from spectrabox.capture.develop.developed import open_any
from spectrabox.capture.photo.image_writers import write_png
from spectrabox.capture.photo.preview import signal_rgb8
from spectrabox.measure.scene.box_camera import box_camera, box_text, visible_corners
from spectrabox.measure.shoot.captures import box_photo
from spectrabox.measure.shoot.shoot import CompleteView
from spectrabox.reconstruct.scene.box_scene import box_edges
from spectrabox.session.box.scenes import named_after
from spectrabox.session.config.session_file import SessionConfig

OVERLAY_NAME = "box.png"


def box_views(config: SessionConfig) -> list[CompleteView]:
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
    return {view.name: box_text(box_photo(config, config.inputs, view))
            for view in box_views(config)}


def corners_in_photo(config: SessionConfig,
                     view: CompleteView | None = None) -> dict[str, tuple[float, float]]:
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
    stated = box_photo(config, config.inputs, view)
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
        write_png(paths[-1], overlay(config, view))
    return paths


def overlay(config: SessionConfig, view: CompleteView) -> np.ndarray:
    """A photo (H, W, 3) uint8 with the box's edges and the marked corners drawn over it.

    Edges are drawn straight, through ends that the lens bends.
    """
    assert config.box is not None
    seen, stated = corners_in_photo(config, view), box_photo(config, config.inputs, view)
    # a turned view without its own camera has no marks: its camera is the first photo's
    marked = box_camera(stated).marks if stated.camera_view == view.name else {}
    image = open_any(config.path(view.photo_files[0]), not_linear=True)
    lines = np.array([[seen[start], seen[end]] for start, end in box_edges(config.box)])
    return points_overlay(signal_rgb8(image.signal), np.array([*marked.values()]).reshape(-1, 2),
                          np.array([seen[name] for name in marked]).reshape(-1, 2),
                          image.sensor_step, lines)
