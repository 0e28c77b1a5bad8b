"""What a box's measures become, to look at and to keep: scenes as XML, edges over the photo."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.radiometry.files import write_text_whole
from spectrabox.reconstruct.scene.box_scene import box_edges, chart_xml
from spectrabox.session.box.box_camera import box_text, corners_in_photo
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.stages.scenes import BOX_SCENE_NAME, CHART_SCENE_NAME

OVERLAY_NAME = "box.png"


def write_scene_files(config: SessionConfig) -> list[Path]:
    """Write the scenes that [scene.box] describes beside session.toml.

    Returns
    -------
    list of Path
        Of the scene, and of that of the chart photo where there is one; empty where the session's
        scene is a file.
    """
    if config.box is None:
        return []
    texts = {config.folder / BOX_SCENE_NAME: box_text(config)}
    if config.box.chart is not None:
        texts[config.folder / CHART_SCENE_NAME] = chart_xml(config.box, config.box.chart)
    for path, text in texts.items():
        write_text_whole(path, text)
    return [*texts]


def write_overlay(config: SessionConfig) -> Path:
    """Write the photo with the box's edges as the camera would see them, and the marked corners."""
    from spectrabox.calibrate.geometry.projection import points_overlay
    from spectrabox.capture.develop.developed import open_any
    from spectrabox.capture.photo.image_files import write_png
    from spectrabox.capture.photo.preview import preview_rgb8
    assert config.box is not None
    seen = corners_in_photo(config)
    marked = config.box.camera.corners_px or {}
    image = open_any(config.path(config.all_views[0].photo_files[0]), not_linear=True)
    lines = np.array([[seen[one], seen[other]] for one, other in box_edges(config.box)])
    path = config.folder / OVERLAY_NAME
    write_png(path, points_overlay(preview_rgb8(image), np.array([*marked.values()]).reshape(-1, 2),
                                   np.array([seen[name] for name in marked]).reshape(-1, 2),
                                   image.sensor_step, lines))
    return path
