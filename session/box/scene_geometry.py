"""What was estimated of a session's scenes: positions of lamp and cameras, with errors."""
from __future__ import annotations

from spectrabox.measure.scene.geometry import (
    camera_placement,
    lamp_placements,
    marked_view,
    refined_placements,
)
from spectrabox.radiometry.placements import SceneGeometry
from spectrabox.reconstruct.scene.refinements import refinements
from spectrabox.session.box.box_camera import box_camera
from spectrabox.session.box.scene_files import box_views
from spectrabox.session.config.session_schema import SessionConfig


def scene_geometry(config: SessionConfig) -> SceneGeometry:
    """What of the session's scenes was estimated, with errors.

    Parameters
    ----------
    config : SessionConfig

    Raises
    ------
    InputError, CheckError
        As ``box_camera``.
    """
    placements, views = [], []
    if config.box is not None:
        placements += lamp_placements(config.box.lamp)
        for view in box_views(config):
            if view.name and view.camera is None:       # turned before the first photo's camera
                continue
            camera = box_camera(config, view)
            if camera.how != "measured":
                placements.append(camera_placement(view.name, camera))
                views.append(marked_view(view.name, config.box.turned(view.turn_deg), camera))
    for file in dict.fromkeys(view.scene for view in config.all_views if view.scene is not None):
        placements += refined_placements(file, refinements(config.path(file)))
    return SceneGeometry(tuple(placements), tuple(views))
