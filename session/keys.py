"""What each stage of a session is made from: files, settings, earlier stages, and its code."""
from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from typing import Any

from spectrabox.calibrate.geometry.colmap_model import CAMERAS_NAME, IMAGES_NAME
from spectrabox.radiometry.files import sha256_of
from spectrabox.radiometry.spectra.kept_cameras import own_cameras
from spectrabox.reconstruct.rendering.llvm import llvm_name
from spectrabox.reconstruct.scene.scene_file import SceneFile
from spectrabox.session.config.curve_sources import SourceTable, SpectrumTable
from spectrabox.session.config.session_chart import chart_files
from spectrabox.session.config.session_schema import ONE_PHOTO, SessionConfig
from spectrabox.session.stages.order import stages_of
from spectrabox.session.stages.scenes import read_chart_scene, read_session_scene
from spectrabox.session.store.input_files import InputFiles
from spectrabox.session.store.program import DECISIVE, room_digests, versions
from spectrabox.session.store.store import fingerprint

Key = dict[str, Any]


@dataclass(frozen=True)
class StageInputs:
    """What one stage reads: names of files, settings, and the stages whose records it takes."""

    files: list[str | None]
    settings: dict[str, Any]
    stages: tuple[str, ...] = ()


@dataclass(frozen=True)
class SessionScenes:
    """Scenes of a session; none of flat samples."""

    chart: SceneFile | None = None
    photos: dict[str | None, SceneFile] = field(default_factory=dict)   # by file


def stage_keys(config: SessionConfig, inputs: InputFiles) -> dict[str, Key]:
    """What each stage of this session is made from.

    Parameters
    ----------
    inputs : InputFiles
        Takes the state of every file that a key names.

    Returns
    -------
    dict
        From the name of each stage that this session needs, in order, to its key: "files" (name to
        SHA-256), "settings", "stages" (fingerprints of those before), "versions" and "code".

    Raises
    ------
    InputError
        If an input file is missing.
    """
    # before they are parsed: a layout or scene that is replaced after this is noticed
    inputs.digests(config.chart.layout_file)
    scenes = SessionScenes() if config.flat else _scenes(config, inputs)
    installed = versions(DECISIVE) | ({} if config.flat else {"llvm": llvm_name()})
    keys: dict[str, Key] = {}
    for name, stage in stages_of(config).items():
        needed = INPUTS_OF[name](config, scenes)
        keys[name] = {"files": inputs.digests(*needed.files), "settings": needed.settings,
                      "stages": {before: fingerprint(keys[before]) for before in needed.stages
                                 if before in keys},
                      "versions": installed, "code": room_digests(stage.rooms)}
    result: dict[str, Key] = json.loads(json.dumps(keys))       # as they are stored: no tuples
    return result


def _chart(config: SessionConfig, _: SessionScenes) -> StageInputs:
    views = config.views_with_chart
    charts = [name for view in views for name in view.chart_files]
    return StageInputs(
        [*charts, *_correcting(config), *chart_files(config), *_light_files(config)],
        {"reference": config.chart.reference, "layout": config.chart.layout,
         "corners_px": config.chart.corners_px, "photos": {view.name: view.chart for view in views},
         "lights": _lights(config)} | _developing(config))


def _photo(config: SessionConfig, scenes: SessionScenes) -> StageInputs:
    views = config.all_views
    photos = [name for view in views for name in view.photo_files]
    if config.views_with_chart and ONE_PHOTO not in views[0].photo:
        photos += config.views_with_chart[0].chart_files  # the channel of each band is chosen there
    shared = None if config.box is None else config.box.camera
    cameras = {view.name: view.camera or shared for view in views}
    return StageInputs(
        [*photos, *_correcting(config), *scenes.photos, config.camera.lens, *_colmap_files(config)],
        {"shown": _outlines(config) if config.flat else {"width": config.reconstruct.width},
         # the picture of a COLMAP model that says what the lens of each photo is
         "images": {name: camera.image for name, camera in cameras.items()
                    if camera is not None and camera.image is not None},
         "photos": {view.name: view.photo for view in views}} | _developing(config),
        ("chart",) if config.flat and config.views else ())     # whose corners must agree


def _calibrate(config: SessionConfig, scenes: SessionScenes) -> StageInputs:
    chosen = config.sensitivity
    return StageInputs(
        [*_light_files(config), config.chart.scene, None if chosen.from_chart
         else chosen.source.file, *(chart_files(config) if config.views_with_chart else ()),
         chosen.prior, *_named_by(config, scenes.chart)],
        {"lights": _lights(config), "sensitivity": _plain(chosen.source),
         "own camera": _own_camera(chosen.source), "method": chosen.method,
         "coefficients": chosen.coefficients, "seed": config.session.seed,
         "lamp position": config.repeatability.lamp_position,
         "box": {} if config.box is None else config.box.model_dump(include={"lamp", "chart"}),
         "relative_error": chosen.relative_error, "reference": config.chart.reference,
         "layout": config.chart.layout, "leave out": list(config.chart.leave_out)}, ("chart",))


def _reconstruct(config: SessionConfig, scenes: SessionScenes) -> StageInputs:
    views = config.all_views
    learnt = config.reconstruct.spectrum_prior == "learnt"
    return StageInputs(
        [*scenes.photos, *_known_files(config), *_named_by(config, *scenes.photos.values()),
         *_colmap_files(config)],
        {"materials": config.bsdfs, "families": _families(config) if learnt else {},
         "known": {name: _plain(table) for name, table in _known(config).items()},
         "scenes": {view.name: view.scene for view in views},
         "box": {} if config.box is None else config.box.model_dump(exclude={"chart"}),
         "turns": {view.name: view.turn_deg for view in views},
         "cameras": {view.name: view.camera.model_dump() for view in views
                     if view.camera is not None},
         "lights by id": [list(view.lights_by_id) for view in views],
         "reconstruct": _plain(config.reconstruct), "scale": config.scale.source}
        | _stated_errors(config) | {"seed": config.session.seed, "surfaces": _surfaces(config)},
        ("photo", "calibrate"))


def _signals(config: SessionConfig, _: SessionScenes) -> StageInputs:
    swatches = _swatches(config)
    return StageInputs(
        [*_known_files(config), *(table.file for table in swatches.values())],
        {"known": {name: _plain(table) for name, table in _known(config).items()},
         "swatches": {name: _plain(table) for name, table in swatches.items()},
         "families": _families(config), "surfaces": _surfaces(config)} | _stated_errors(config),
        ("chart", "photo", "calibrate"))


def _sample(config: SessionConfig, _: SessionScenes) -> StageInputs:
    return StageInputs([], {"sampling": _plain(config.sampling), "families": _families(config),
                            "seed": config.session.seed, "swatches": list(_swatches(config))},
                       ("signals", "reconstruct"))


def _picture(config: SessionConfig, scenes: SessionScenes) -> StageInputs:
    """Of the photo's key what changes with the regions of flat samples is left out: the picture
    shows none.
    """
    files = [*config.all_views[0].photo_files, *_correcting(config)]
    settings = {"picture": _plain(config.picture), "seed": config.session.seed} \
        | _stated_errors(config) | _developing(config)
    if config.flat:
        known = {name: _outlines(config)[name] | {"spectrum": _plain(table)}
                 for name, table in _known(config).items()}
        further = config.picture_views[1:]
        return StageInputs(
            [*files, *(name for view in further for name in view.photo_files),
             *_known_files(config)],
            settings | {"known": known, "further photos": {view.name: view.photo
                                                           for view in further}},
            ("chart", "calibrate"))
    return StageInputs([*files, *scenes.photos, *_named_by(config, *scenes.photos.values()),
                        config.camera.lens, *_colmap_files(config)],
                       settings | {"engine": config.reconstruct.engine},
                       ("calibrate", "reconstruct"))


INPUTS_OF = {"chart": _chart, "photo": _photo, "calibrate": _calibrate,
             "reconstruct": _reconstruct, "signals": _signals, "sample": _sample,
             "picture": _picture}


def _scenes(config: SessionConfig, inputs: InputFiles) -> SessionScenes:
    inputs.digests(config.chart.scene, *(view.scene for view in config.all_views),
                   *_colmap_files(config))
    first = {view.scene: view for view in reversed(config.all_views)}
    return SessionScenes(read_chart_scene(config), {scene: read_session_scene(config, view)
                                                    for scene, view in first.items()})


def _colmap_files(config: SessionConfig) -> list[str]:
    """Names of the files of the COLMAP model; none where the session has no model."""
    if config.box is None or config.box.colmap is None:
        return []
    folder = config.box.colmap.folder.rstrip("/")
    return [f"{folder}/{name}" for name in (CAMERAS_NAME, IMAGES_NAME)]


def _named_by(config: SessionConfig, *scenes: SceneFile | None) -> list[str]:
    """Meshes and textures of scenes, by their place as seen from the session folder."""
    return [os.path.relpath(path, config.folder) for scene in scenes if scene is not None
            for path in scene.files]


def _correcting(config: SessionConfig) -> list[str]:
    return [*config.photos.flats.values(), *config.photos.dark_files]


def _developing(config: SessionConfig) -> dict[str, Any]:
    return {"not_linear": config.photos.not_linear, "flats": config.photos.flats,
            "orientation": config.photos.orientation,
            "drift": _plain(config.drift)}


def _stated_errors(config: SessionConfig) -> dict[str, Any]:
    return {"repeatability": _plain(config.repeatability),
            "stray light": _plain(config.stray_light)}


def _lights(config: SessionConfig) -> dict[str, Any]:
    return {view.name: {"lights": [_plain(light) for light in view.all_lights], "lamp": view.lamp,
                        "filter": None if view.filter is None else _plain(view.filter)}
            for view in config.all_views}


def _light_files(config: SessionConfig) -> list[str]:
    return [name for view in config.all_views for name in view.light_files]


def _own_camera(source: SourceTable) -> str | None:
    """Digest of a camera that the operator keeps under a name, outside of every session."""
    if source.camera is None:
        return None
    kept = own_cameras().get(source.camera)
    return None if kept is None else sha256_of(kept)


def _outlines(config: SessionConfig) -> dict[str, Any]:
    return {name: {"rect": region.rect, "polygon": region.polygon, "photo": region.photos}
            for name, region in config.regions.items()}


def _known(config: SessionConfig) -> dict[str, SpectrumTable]:
    return {name: surface.known for name, surface in config.surfaces.items()
            if surface.known is not None}


def _known_files(config: SessionConfig) -> list[str | None]:
    return [table.file for table in _known(config).values()]


def _swatches(config: SessionConfig) -> dict[str, SpectrumTable]:
    return {name: region.swatch for name, region in config.regions.items()
            if region.swatch is not None}


def _families(config: SessionConfig) -> dict[str, tuple[str, ...]]:
    return {name: surface.families for name, surface in config.surfaces.items()}


def _surfaces(config: SessionConfig) -> dict[str, str | None]:
    return {name: surface.surface for name, surface in config.surfaces.items()}


def _plain(section: Any) -> dict[str, Any]:
    return dict(vars(section))
