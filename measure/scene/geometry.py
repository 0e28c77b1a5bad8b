"""Stated and estimated positions of lamp and cameras, of a measured box or of a scene in a file."""
from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from spectrabox.measure.captured import BoxPhoto, SceneCapture
from spectrabox.measure.scene import box_camera
from spectrabox.radiometry.records import scenes
from spectrabox.reconstruct.scene import box_scene, box_tables, edit_scene, scene_file


def scene_geometry(capture: SceneCapture
                   ) -> tuple[tuple[scenes.Placement, ...], tuple[scenes.MarkedView, ...]]:
    """What of a capture's scenes was estimated, with errors; empty where everything stands as
    stated.

    Parameters
    ----------
    capture : SceneCapture

    Raises
    ------
    InputError, CheckError
        As ``box_camera``.
    """
    placements, views = [], []
    for view in capture.views:
        stated = view.scene
        if isinstance(stated, scene_file.SceneFile):
            continue
        if not view.name:
            placements += lamp_placements(stated.box.lamp)
        if stated.camera.measured or stated.camera_view != view.name:   # another photo's camera
            continue
        camera = box_camera.box_camera(stated)
        placements.append(camera_placement(view.name, camera))
        views.append(marked_view(view.name, stated.box, camera))
    for file, refinements in capture.refinements.items():
        placements += refined_placements(file, refinements)
    return tuple(placements), tuple(views)


def box_scenes(capture: SceneCapture) -> dict[str, str]:
    """XML of the scenes of a capture's measured box, by the first view of each.

    Parameters
    ----------
    capture : SceneCapture

    Raises
    ------
    InputError, CheckError
        As ``box_camera``.
    """
    stated: dict[str, BoxPhoto] = {}
    for name, scene in capture.scenes.items():
        if isinstance(scene, BoxPhoto) and not any(
                scene.camera_view == other.camera_view and scene.box == other.box
                for other in stated.values()):
            stated[name] = scene
    return {name: box_camera.box_text(scene) for name, scene in stated.items()}


def lamp_placements(lamp: box_tables.LampTable) -> list[scenes.Placement]:
    """The placement of a box's lamp; none where it stands as measured."""
    if lamp.moved_mm is None:
        return []
    return [
        scenes.Placement(
            "lamp", "measured with a tape, then moved to explain the shading of surfaces "
            "of known reflectance", scenes.MM, np.array(lamp.at_mm), np.array(lamp.position_mm),
            np.array(lamp.moved_mm), _array(lamp.moved_error_mm))
    ]


def refined_placements(file: str,
                       refinements: Iterable[edit_scene.Refinement]) -> list[scenes.Placement]:
    """The placements that comments of a scene file state.

    Parameters
    ----------
    file : str
        Its name.
    refinements : iterable of Refinement
    """
    return [scenes.Placement(f"{refinement.what} {refinement.name!r} of {file}", refinement.how,
                      scenes.SCENE_UNIT, None, _array(refinement.place), _array(refinement.moved),
                      np.array(refinement.standard_error)) for refinement in refinements]


def camera_placement(name: str, camera: box_camera.BoxCamera) -> scenes.Placement:
    """The placement of an estimated camera of a box.

    Parameters
    ----------
    name : str
        Of the view; empty of the first.
    camera : BoxCamera
    """
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
    return scenes.Placement(f"camera of “{name}”" if name else "camera", how, scenes.MM, None,
                     np.array(camera.at_mm), None, np.array(camera.standard_error_mm))


def marked_view(name: str, box: box_tables.BoxTable,
                camera: box_camera.BoxCamera) -> scenes.MarkedView:
    """The edges of a box, and its marked corners, as a camera sees them.

    Parameters
    ----------
    name : str
        Of the view; empty of the first.
    box : BoxTable
        Turned as in this photo.
    camera : BoxCamera
    """
    seen = box_camera.undistorted_shares(camera,
                                         box_camera.visible_corners(camera, box.corner_positions()))
    marked = box_camera.undistorted_shares(camera, camera.marks)
    corners = tuple(marked)
    return scenes.MarkedView(
        name, np.array([[seen[start], seen[end]] for start, end in box_scene.box_edges(box)]),
        corners,
        np.array([marked[corner] for corner in corners]).reshape(-1, 2),
        np.array([seen[corner] for corner in corners]).reshape(-1, 2),
        np.array([camera.residuals_px[corner] for corner in corners]))


def _array(values: Iterable[float] | None) -> np.ndarray | None:
    return None if values is None else np.array([*values])
