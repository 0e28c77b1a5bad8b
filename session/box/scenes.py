"""What a session states of the scenes of its photos, and the scenes of its box as files."""
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from spectrabox.calibrate.geometry.colmap_model import ModelImage, read_colmap
from spectrabox.calibrate.geometry.lens import read_lens
from spectrabox.measure.captured import BoxPhoto, InputFile
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.system.words import file_stem
from spectrabox.reconstruct.scene.box_scene import chart_xml
from spectrabox.reconstruct.scene.scene_file import (
    SceneFile,
    read_scene,
    scene_of_text,
)
from spectrabox.session.config.session_schema import FILE_NAME, SessionConfig, ViewInputs

BOX_SCENE_NAME, CHART_SCENE_NAME = "scene.xml", "chart-scene.xml"   # made of [scene.box]
COLMAP = f"{FILE_NAME}: scene.box.colmap"
SHOWN = 12              # names of pictures in an error


def stated_scene(config: SessionConfig, view: ViewInputs | None = None) -> SceneFile | BoxPhoto:
    """The scene of a photo: a file, which lies within the session folder, or a measured box.

    Parameters
    ----------
    config : SessionConfig
    view : ViewInputs, optional
        The first by default.

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
        return box_photo(config, view)
    return read_scene(config.path(view.scene), _allowed_folder(config))


def box_photo(config: SessionConfig, view: ViewInputs | None = None) -> BoxPhoto:
    """What a session with [scene.box] states of one of its photos.

    Parameters
    ----------
    config : SessionConfig
    view : ViewInputs, optional
        The first by default.

    Raises
    ------
    InputError
        If a file cannot be read, or lies outside the session.
    """
    box, first = config.box, config.all_views[0]
    view = view or first
    assert box is not None
    box = box.model_copy(update={"chart": None})        # which stands in a scene of its own
    turned = box.turned(view.turn_deg).lit_from(view.lamp_at_mm)
    # a view without a camera of its own was taken by the first photo's, which marked its corners
    if view.camera is None:
        camera, marked, taken = box.camera, box, first.photo_files[0]
        camera_view, table = first.name, "scene.box.camera"
    else:
        camera, marked, taken = view.camera, turned, view.photo_files[0]
        camera_view, table = view.name, f"views.{view.name}.camera"
    lens, beam = config.camera.lens, box.lamp.beam
    return BoxPhoto(
        box=turned, camera=camera, marked=marked, taken=InputFile(taken, config.path(taken)),
        lens=None if lens is None else read_lens(config.path(lens)),
        path=config.folder / BOX_SCENE_NAME,
        beam=None if beam is None else InputFile(beam, config.path(beam)),
        model={} if camera.image is None else _pictures(config, camera.image),
        camera_view=camera_view, camera_place=f"{FILE_NAME}: {table}", model_place=COLMAP)


def _pictures(config: SessionConfig, image: str) -> dict[str, ModelImage]:
    """The picture of the session's COLMAP model that is a photo, and those that tie it to the box.
    """
    assert config.box is not None and config.box.colmap is not None
    images = read_colmap(config.path(config.box.colmap.folder))
    needed = (image, *config.box.colmap.corners_px)
    for name in needed:
        if name not in images:
            some = ", ".join([*images][:SHOWN]) + (", ..." if len(images) > SHOWN else "")
            raise InputError(f"{COLMAP}: the model has no picture {name!r}; it has {some}")
    return {name: images[name] for name in needed}


def read_chart_scene(config: SessionConfig) -> SceneFile | None:
    """The scene of the chart photo, where there is one."""
    if config.chart.scene is not None:
        return read_scene(config.path(config.chart.scene), _allowed_folder(config))
    if config.box is None or config.box.chart is None:
        return None
    return scene_of_text(chart_xml(config.box, config.box.chart),
                         config.folder / CHART_SCENE_NAME, _allowed_folder(config))


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


def _allowed_folder(config: SessionConfig) -> Path | None:
    return None if config.allow_outside else config.folder
