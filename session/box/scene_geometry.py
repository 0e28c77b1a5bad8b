"""Stated and estimated places of lamp and cameras, of a box or of a scene in a file."""
from __future__ import annotations

import numpy as np

from spectrabox.reconstruct.scene.box_scene import box_edges
from spectrabox.reconstruct.scene.refinements import refinements
from spectrabox.session.box.box_camera import FoundCamera, found_camera, straight_corners
from spectrabox.session.box.geometry_record import MarkedView, Placement, SceneGeometry
from spectrabox.session.box.scene_files import box_views
from spectrabox.session.config.session_schema import SessionConfig, ViewInputs

UNIT, MM = "scene's unit", "mm"


def scene_geometry(config: SessionConfig) -> SceneGeometry:
    """What of the session's scenes was estimated, with errors.

    Raises
    ------
    InputError, CheckError
        As of ``found_camera``.
    """
    placements, views = [], []
    if config.box is not None:
        placements += _lamp(config)
        for view in box_views(config):
            if view.name and view.camera is None:       # turned before the first photo's camera
                continue
            camera = found_camera(config, view)
            if camera.how != "measured":
                placements.append(_camera(view, camera))
                views.append(_marked(config, view, camera))
    for file in dict.fromkeys(view.scene for view in config.all_views if view.scene is not None):
        placements += [Placement(f"{one.what} {one.name!r} of {file}", one.how, UNIT, None,
                                 _array(one.place), _array(one.moved),
                                 np.array(one.standard_error))
                       for one in refinements(config.path(file))]
    return SceneGeometry(tuple(placements), tuple(views))


def _array(values: tuple[float, ...] | None) -> np.ndarray | None:
    return None if values is None else np.array(values)


def _lamp(config: SessionConfig) -> list[Placement]:
    assert config.box is not None
    lamp = config.box.lamp
    if lamp.moved_mm is None:
        return []
    return [Placement("lamp", "measured with a tape, then moved to explain the shading of surfaces "
                      "of known reflectance", MM, np.array(lamp.at_mm), np.array(lamp.place_mm),
                      np.array(lamp.moved_mm), _array(lamp.moved_error_mm))]


def _camera(view: ViewInputs, camera: FoundCamera) -> Placement:
    known = (f"direction known to {camera.direction_error_deg:.2f} degrees, field of view "
             f"{camera.fov_deg:.1f} degrees")
    if (model := camera.model) is None:
        worst = max(camera.residuals_px.values())
        how = (f"found from {len(camera.residuals_px)} marked corners, the worst {worst:.2f} "
               f"pixels off; {known}")
    else:
        how = (f"from COLMAP, tied to the box by {len(model.residuals_px)} marks, rms "
               f"{model.rms_px:.2f} pixels, corners within {max(model.distances.values()):.1f} mm "
               f"of the tape's; {known}")
    return Placement(f"camera of “{view.name}”" if view.name else "camera", how, MM, None,
                     np.array(camera.at_mm), None, np.array(camera.standard_error_mm))


def _marked(config: SessionConfig, view: ViewInputs, camera: FoundCamera) -> MarkedView:
    assert config.box is not None
    seen, marked = straight_corners(config, view)
    names = tuple(marked)
    return MarkedView(
        view.name, np.array([[seen[one], seen[other]] for one, other in box_edges(config.box)]),
        names, np.array([marked[name] for name in names]).reshape(-1, 2),
        np.array([seen[name] for name in names]).reshape(-1, 2),
        np.array([camera.residuals_px[name] for name in names]))
