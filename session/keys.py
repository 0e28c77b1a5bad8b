"""What each stage of a session is made from: files, settings, earlier stages, and its code."""
from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
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
Files = Callable[..., dict[str, str]]       # names of files to their digests


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
    files = inputs.digests
    files(config.chart.layout_file)     # before it is parsed: one that is replaced then is noticed
    chart_scene, scenes = (None, {}) if config.flat else _scenes(config, files)
    chart = chart_files(config) if config.views_with_chart else []
    curves = None if config.sensitivity.from_chart else config.sensitivity.source.file
    installed = versions(DECISIVE) | ({} if config.flat else {"llvm": llvm_name()})
    stages = stages_of(config)

    def made_by(stage: str) -> Key:
        return {"versions": installed, "code": room_digests(stages[stage].rooms)}

    keys: dict[str, Key] = {}
    views, correcting = config.all_views, (*config.photos.flats.values(), *config.photos.dark_files)
    lights = {view.name: [_plain(light) for light in view.all_lights] for view in views}
    light_files = [name for view in views for light in view.all_lights for name in light.files]
    developing = {"not_linear": config.photos.not_linear, "flats": config.photos.flats,
                  "drift": _plain(config.drift)}
    if config.views_with_chart:
        charts = [name for view in config.views_with_chart for name in view.chart_files]
        keys["chart"] = {"files": files(*charts, *correcting, *chart, *light_files),
                         "settings": {"reference": config.chart.reference,
                                      "layout": config.chart.layout,
                                      "corners_px": config.chart.corners_px,
                                      "photos": {view.name: view.chart
                                                 for view in config.views_with_chart},
                                      "lights": lights} | developing} | made_by("chart")
    photos = [name for view in views for name in view.photo_files]
    if config.views_with_chart and ONE_PHOTO not in views[0].photo:
        photos += config.views_with_chart[0].chart_files  # the channel of each band is chosen there
    keys["photo"] = {"files": files(*photos, *correcting, *scenes, config.camera.lens,
                                    *_colmap_files(config)),
                     "settings": {"shown": _outlines(config) if config.flat
                                  else {"width": config.reconstruct.width},
                                  "images": _images(config),
                                  "photos": {view.name: view.photo for view in views}} | developing
                     } | made_by("photo")
    keys["calibrate"] = {
        "files": files(*light_files, config.chart.scene, curves, *chart,
                       config.sensitivity.prior) | files(
                           *_named_by(chart_scene, config.folder)),
        "settings": {"lights": lights, "sensitivity": _plain(config.sensitivity.source),
                     "own camera": _own_camera(config.sensitivity.source),
                     "method": config.sensitivity.method,
                     "coefficients": config.sensitivity.coefficients, "seed": config.session.seed,
                     "lamp position": config.repeatability.lamp_position,
                     "box": _measured(config, of_chart=True),
                     "relative_error": config.sensitivity.relative_error,
                     "reference": config.chart.reference, "layout": config.chart.layout,
                     "leave out": list(config.chart.leave_out)},
        "stages": {"chart": fingerprint(keys["chart"])} if "chart" in keys
        else {}} | made_by("calibrate")
    last = "signals" if config.flat else "reconstruct"
    found = _signals_key(config, files) if config.flat else _reconstruct_key(config, scenes, files)
    before = ("chart", "photo", "calibrate") if config.flat else ("photo", "calibrate")
    keys[last] = found | {"stages": {name: fingerprint(keys[name]) for name in before}
                          } | made_by(last)
    keys["sample"] = {"settings": {"sampling": _plain(config.sampling),
                                   "families": _families(config),
                                   "seed": config.session.seed},
                      "stages": {last: fingerprint(keys[last])}} | made_by("sample")
    if config.picture is not None:
        own = _flat_picture_key(config, keys, files) if config.flat \
            else _scene_picture_key(config, keys, scenes, files)
        keys["picture"] = own | {
            "files": own["files"] | files(*views[0].photo_files, *correcting),
            "settings": own["settings"] | {"picture": _plain(config.picture),
                                           "repeatability": _plain(config.repeatability),
                                           "stray light": _plain(config.stray_light),
                                           "seed": config.session.seed} | developing
            } | made_by("picture")
    result: dict[str, Key] = json.loads(json.dumps(keys))       # as they are stored: no tuples
    return result


def _flat_picture_key(config: SessionConfig, keys: Mapping[str, Key], files: Files) -> Key:
    """What a picture of a flat sample is made from beside its photo.

    Of the photo's key what changes with the regions is left out: the picture shows none.
    """
    known = {name: _outlines(config)[name] | {"spectrum": _plain(reference)}
             for name, reference in _known(config).items()}
    return {"files": files(*(reference.file for reference in _known(config).values())),
            "settings": {"known": known},
            "stages": {name: fingerprint(keys[name]) for name in ("chart", "calibrate")}}


def _scene_picture_key(config: SessionConfig, keys: Mapping[str, Key],
                       scenes: Mapping[str | None, SceneFile], files: Files) -> Key:
    """What a picture of a scene is made from beside its photo."""
    named = [name for scene in scenes.values() for name in _named_by(scene, config.folder)]
    return {"files": files(*scenes, *named, config.camera.lens),
            "settings": {"engine": config.reconstruct.engine},
            "stages": {name: fingerprint(keys[name]) for name in ("calibrate", "reconstruct")}}


def _scenes(config: SessionConfig,
            files: Files) -> tuple[SceneFile | None, dict[str | None, SceneFile]]:
    """The scene of the chart photo, and those of the object photos by file."""
    # before they are parsed: a scene that is replaced after this is noticed
    files(config.chart.scene, *(view.scene for view in config.all_views), *_colmap_files(config))
    first = {view.scene: view for view in reversed(config.all_views)}
    return read_chart_scene(config), {scene: read_session_scene(config, view)
                                      for scene, view in first.items()}


def _colmap_files(config: SessionConfig) -> list[str]:
    """Names of the files of the COLMAP model; none where the session has no model."""
    if config.box is None or config.box.colmap is None:
        return []
    folder = config.box.colmap.folder.rstrip("/")
    return [f"{folder}/{name}" for name in (CAMERAS_NAME, IMAGES_NAME)]


def _reconstruct_key(config: SessionConfig, scenes: dict[str | None, SceneFile],
                     files: Files) -> Key:
    """Files and settings of the stage that inverts photos of a scene."""
    views, known = config.all_views, _known(config)
    named = [name for scene in scenes.values() for name in _named_by(scene, config.folder)]
    learnt = config.reconstruct.spectrum_prior == "learnt"
    return {
        "files": files(*scenes, *(reference.file for reference in known.values()), *named,
                       *_colmap_files(config)),
        "settings": {"materials": config.bsdfs,
                     "families": _families(config) if learnt else {},
                     "known": {name: _plain(reference) for name, reference in known.items()},
                     "scenes": {view.name: view.scene for view in views},
                     "box": _measured(config, of_chart=False),
                     "turns": {view.name: view.turn_deg for view in views},
                     "cameras": {view.name: view.camera.model_dump() for view in views
                                 if view.camera is not None},
                     "lights by id": [list(view.lights_by_id) for view in views],
                     "reconstruct": _plain(config.reconstruct),
                     "scale": config.scale.source,
                     "repeatability": _plain(config.repeatability),
                     "stray light": _plain(config.stray_light),
                     "seed": config.session.seed}}


def _signals_key(config: SessionConfig, files: Files) -> Key:
    """Files and settings of the stage that reads the signals of flat samples."""
    known = _known(config)
    return {"files": files(*(reference.file for reference in known.values())),
            "settings": {"known": {name: _plain(reference) for name, reference in known.items()},
                         "families": _families(config),
                         "repeatability": _plain(config.repeatability),
                         "stray light": _plain(config.stray_light)}}


def _measured(config: SessionConfig, of_chart: bool) -> dict[str, Any]:
    """What of the measures of a box the chart's scene is made from, or that of the photo."""
    if config.box is None:
        return {}
    return config.box.model_dump(include={"lamp", "chart"} if of_chart else None,
                                 exclude=None if of_chart else {"chart"})


def _images(config: SessionConfig) -> dict[str, str]:
    """The picture of a COLMAP model that says what the lens of each photo is."""
    shared = None if config.box is None else config.box.camera
    cameras = {view.name: view.camera or shared for view in config.all_views}
    return {name: camera.image for name, camera in cameras.items()
            if camera is not None and camera.image is not None}


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


def _families(config: SessionConfig) -> dict[str, tuple[str, ...]]:
    return {name: surface.families for name, surface in config.surfaces.items()}


def _named_by(scene: SceneFile | None, folder: Path) -> list[str]:
    """Meshes and textures of a scene, by their place as seen from the session folder."""
    return [] if scene is None else [os.path.relpath(path, folder) for path in scene.files]


def _plain(section: Any) -> dict[str, Any]:
    return dict(vars(section))
