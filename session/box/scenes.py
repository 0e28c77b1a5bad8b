"""The scenes of a session, read without any renderer."""
from __future__ import annotations

from pathlib import Path

from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.scene.box_scene import chart_xml
from spectrabox.reconstruct.scene.scene_file import (
    SceneFile,
    read_scene,
    scene_of_text,
)
from spectrabox.session.config.session_schema import FILE_NAME, SessionConfig, ViewInputs

BOX_SCENE_NAME, CHART_SCENE_NAME = "scene.xml", "chart-scene.xml"   # made of [scene.box]


def read_session_scene(config: SessionConfig, view: ViewInputs | None = None) -> SceneFile:
    """The scene of a photo; its files lie within the session folder.

    Parameters
    ----------
    view : ViewInputs, optional
        The first photo's by default.

    Raises
    ------
    InputError
        If the session has no scene, or it cannot be read.
    """
    if config.scene is None:
        raise InputError(f"{FILE_NAME} describes regions of a flat sample and no scene; this needs "
                         "a session with [scene]")
    view = view or config.all_views[0]
    if view.scene is None:
        # SciPy's optimizers, 0.3 s to import, which a scene in a file does not need
        from spectrabox.session.box.box_camera import box_text
        return scene_of_text(box_text(config, view), config.folder / BOX_SCENE_NAME,
                             _allowed_folder(config))
    return read_scene(config.path(view.scene), _allowed_folder(config))


def read_chart_scene(config: SessionConfig) -> SceneFile | None:
    """The scene of the chart photo, where there is one."""
    if config.chart.scene is not None:
        return read_scene(config.path(config.chart.scene), _allowed_folder(config))
    if config.box is None or config.box.chart is None:
        return None
    return scene_of_text(chart_xml(config.box, config.box.chart),
                         config.folder / CHART_SCENE_NAME, _allowed_folder(config))


def _allowed_folder(config: SessionConfig) -> Path | None:
    return None if config.allow_outside else config.folder
