"""The scenes of a session's measured box as files."""
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from spectrabox.measure.shoot.captures import BOX_SCENE_NAME, CHART_SCENE_NAME
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.system.words import file_stem
from spectrabox.reconstruct.scene.box_scene import chart_xml
from spectrabox.session.config.session_file import SessionConfig


def write_box_scenes(config: SessionConfig, scenes: Mapping[str, str]) -> list[Path]:
    """Write the scenes that [scene.box] describes beside session.toml.

    Parameters
    ----------
    config : SessionConfig
    scenes : mapping
        XML by view; of a session whose scene is a file there are none.

    Returns
    -------
    list of Path
        Of these scenes, and of that of the chart photo where there is one.
    """
    texts = {named_after(config, BOX_SCENE_NAME, view): text for view, text in scenes.items()}
    if config.box is not None and config.box.chart is not None:
        texts[config.folder / CHART_SCENE_NAME] = chart_xml(config.box, config.box.chart)
    for path, text in texts.items():
        write_text_whole(path, text)
    return [*texts]


def named_after(config: SessionConfig, name: str, view: str) -> Path:
    """Where a file of one view lies, beside session.toml.

    Parameters
    ----------
    config : SessionConfig
    name : str
        Of that of the first view.
    view : str
        Name of the view.
    """
    path = config.folder / name
    return path.with_name(f"{path.stem}-{file_stem(view)}{path.suffix}") if view else path
