"""What a box's measures become, to look at and to keep: scenes as XML, edges over the photos."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.calibrate.geometry.projection import points_overlay
from spectrabox.capture.develop.developed import open_any
from spectrabox.capture.photo.image_files import write_png
from spectrabox.capture.photo.preview import signal_rgb8
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.system.names import file_stem
from spectrabox.reconstruct.scene.box_scene import box_edges, chart_xml
from spectrabox.session.box.box_camera import box_camera, box_text, corners_in_photo
from spectrabox.session.box.scenes import BOX_SCENE_NAME, CHART_SCENE_NAME
from spectrabox.session.config.session_schema import SessionConfig, ViewInputs

OVERLAY_NAME = "box.png"


def box_views(config: SessionConfig) -> list[ViewInputs]:
    """The first photo of a measured box, and those that another camera took or that show it
    turned.
    """
    first, *others = config.all_views
    return [first, *(view for view in others if view.scene is None
                     and (view.camera is not None or view.turn_deg))]


def write_scene_files(config: SessionConfig) -> list[Path]:
    """Write the scenes that [scene.box] describes beside session.toml.

    Returns
    -------
    list of Path
        Of the scene, of those of views with another camera or turn, and of that of the chart photo
        where there is one; empty where the session's scene is a file.
    """
    if config.box is None:
        return []
    texts = {_named_after(config, BOX_SCENE_NAME, view): box_text(config, view)
             for view in box_views(config)}
    if config.box.chart is not None:
        texts[config.folder / CHART_SCENE_NAME] = chart_xml(config.box, config.box.chart)
    for path, text in texts.items():
        write_text_whole(path, text)
    return [*texts]


def write_overlays(config: SessionConfig) -> list[Path]:
    """Write each photo with the box's edges as its camera would see them, and the marked corners.

    Returns
    -------
    list of Path
        One for each of ``box_views``.
    """
    paths = []
    for view in box_views(config):
        paths.append(_named_after(config, OVERLAY_NAME, view))
        write_png(paths[-1], overlay(config, view))
    return paths


def overlay(config: SessionConfig, view: ViewInputs) -> np.ndarray:
    """A photo (H, W, 3) uint8 with the box's edges and the marked corners drawn over it.

    Edges are drawn straight, through ends that the lens bends.
    """
    assert config.box is not None
    seen = corners_in_photo(config, view)
    # a turned view without its own camera has no marks: its camera is the first photo's
    marked = box_camera(config, view).marks if view.camera is not None or not view.name else {}
    image = open_any(config.path(view.photo_files[0]), not_linear=True)
    lines = np.array([[seen[start], seen[end]] for start, end in box_edges(config.box)])
    return points_overlay(signal_rgb8(image.signal), np.array([*marked.values()]).reshape(-1, 2),
                          np.array([seen[name] for name in marked]).reshape(-1, 2),
                          image.sensor_step, lines)


def _named_after(config: SessionConfig, name: str, view: ViewInputs) -> Path:
    path = config.folder / name
    return path.with_name(f"{path.stem}-{file_stem(view.name)}{path.suffix}") if view.name else path
