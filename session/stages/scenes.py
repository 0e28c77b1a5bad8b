"""The scenes of a session, read without any renderer."""
from __future__ import annotations

from spectrabox.reconstruct.scene.scene_file import SceneFile, read_scene
from spectrabox.session.config.session_schema import SessionConfig


def read_session_scene(config: SessionConfig, file: str | None = None) -> SceneFile:
    """The scene of the object photo, or another one; its files lie within the session folder."""
    return read_scene(config.path(file or config.scene.file), None if config.allow_outside
                      else config.folder)


def read_chart_scene(config: SessionConfig) -> SceneFile | None:
    """The scene of the chart photo, where there is one."""
    if config.chart.scene is None:
        return None
    return read_scene(config.path(config.chart.scene), None if config.allow_outside
                      else config.folder)
