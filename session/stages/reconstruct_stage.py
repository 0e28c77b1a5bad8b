"""The stage that finds spectra: photos, scenes and calibrations to one reconstruction."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from spectrabox.measure.scene.draws import require_one_transport
from spectrabox.measure.scene.photo_errors import with_photo_errors
from spectrabox.measure.scene.reconstruction import learnt_spectra
from spectrabox.measure.surface_signals import scene_signals
from spectrabox.radiometry.error_model import REPEATABILITY, with_common_error
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.light_scale import drift_between, scale_after_drift, scale_for_photo
from spectrabox.radiometry.records import (
    Calibration,
    LightDrift,
    LightScale,
    LinearImage,
)
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.reconstruct.engines.transport_engine import require_lit
from spectrabox.reconstruct.inverse_rendering import SINGLE_VIEW, reconstruct_views, settings_for
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.scene.scene_file import SceneFile, not_plain_products
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.view import MaterialSpec, View
from spectrabox.session.box.scene_geometry import scene_geometry
from spectrabox.session.config.session_schema import SessionConfig, ViewInputs
from spectrabox.session.stages.inputs import (
    GRID,
    band_names,
    read_known_light,
    read_reflectance,
)
from spectrabox.session.stages.scenes import read_session_scene, require_materials
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import (
    calibrations_of,
    chart_glare_of,
    chart_of,
    photo_of,
    reference_signals,
)
from spectrabox.session.store.store import StoredStage

FIRST_VIEW = "photo"
TRACE = ".trace.npz"      # in the results, while a trace goes on and where it was stopped


def invert_photos(task: StageTask) -> dict[str, Any]:
    """Photos, scenes and calibrations to spectra.

    A drift of the light between the first view's chart and photo corrects its scale and widens its
    errors. A trace that was stopped goes on from its checkpoint among the results.

    Returns
    -------
    dict
        "joint", a JointReconstruction, the "signals" of its materials, the "drift" of the light, a
        LightDrift or None, and the "geometry" that was estimated, a SceneGeometry.
    """
    config, stored = task.config, task.stored
    start_mitsuba(task.device)
    drift = drift_of(config, stored)
    views = views_of(config, stored, drift)
    _require_picture(config, views)
    joint = reconstruct_views(views, settings_of(config), task.progress,
                              config.results_folder / TRACE)
    joint = with_photo_errors(joint, drift, glare_error(config, stored),
                              config.stray_light.ambient)
    return {"drift": drift, "joint": joint, "geometry": scene_geometry(config),
            "signals": scene_signals(joint, calibrations_of(config, stored))}


def glare_error(config: SessionConfig, stored: Mapping[str, StoredStage]) -> np.ndarray:
    """Standard error (K,) of veiling glare, of the mean signal of an object photo."""
    return np.hypot(config.stray_light.glare, chart_glare_of(stored))


def require_invertible(config: SessionConfig, stored: Mapping[str, StoredStage],
                       device: str) -> int | None:
    """Refuse a session that the stage would refuse, before more than a first, short trace.

    Parameters
    ----------
    stored : of the stages before
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    int or None
        Bytes that the stage will take besides the program; None where the engine does not trace.

    Raises
    ------
    InputError
    """
    start_mitsuba(device)
    views = views_of(config, stored, drift_of(config, stored))
    _require_picture(config, views)
    settings, _ = settings_for(views, settings_of(config))
    if config.sampling.through == "transport":
        alike = settings.engine not in SINGLE_VIEW and not any(view.own_lights for view in views)
        require_one_transport(len(views), alike)
    return None if settings.engine in SINGLE_VIEW else require_lit(views, settings)


def _require_picture(config: SessionConfig, views: Sequence[View]) -> None:
    """Refuse a picture of surfaces that do more to light than to multiply it, before anything is
    traced.
    """
    scene = views[0].scene_file
    if config.picture is not None and (others := not_plain_products(scene)):
        raise InputError(f"[picture] takes diffuse surfaces only, and {', '.join(others)} of "
                         f"{scene.path.name} is coated or glossy: leave [picture] out, or make "
                         "them diffuse and expect their highlights to be masked")


def views_of(config: SessionConfig, stored: Mapping[str, StoredStage],
             drift: LightDrift | None) -> list[View]:
    """Every photo with all that explains it.

    Parameters
    ----------
    drift : LightDrift or None
        Of the light between the first view's chart and photo.

    Raises
    ------
    InputError
        If scene and session do not name the same materials, or an input cannot be read.
    """
    photos = [photo_of(stored, view) for view in config.all_views]
    bands = band_names(config, photos[0].signal.shape[2])
    views: list[View] = []
    for inputs, photo, calibration in zip(config.all_views, photos,
                                          calibrations_of(config, stored), strict=True):
        scene = read_session_scene(config, inputs)
        drifted = drift if not inputs.name else None
        scale = scale_of_view(config, inputs, photo, calibration, stored, drifted)
        lights = {light: read_known_light(config, spectrum)
                  for light, spectrum in inputs.lights_by_id.items()}
        views.append(View(inputs.name or FIRST_VIEW, scene, photo, calibration, bands,
                          read_materials(config, scene), scale, lights))
    return views


def settings_of(config: SessionConfig) -> InversionSettings:
    """The settings of the inversion, with the learnt prior where it is asked for."""
    chosen = config.reconstruct
    learnt = learnt_spectra(()) if chosen.spectrum_prior == "learnt" else None
    return InversionSettings(**chosen.settings(), seed=config.session.seed, learnt=learnt)


def read_materials(config: SessionConfig, scene: SceneFile) -> tuple[MaterialSpec, ...]:
    """Materials of the session with their known spectra on the working grid, or what is expected of
    their families.

    Raises
    ------
    InputError
        If scene and session do not name the same materials.
    """
    require_materials(scene, config.bsdfs)
    specs = []
    for name, material in config.materials.items():
        known = None if material.known is None else \
            spectrum_on_grid(read_reflectance(config, material.known), GRID)
        learnt = learnt_spectra(material.families) if material.families \
            and config.reconstruct.spectrum_prior == "learnt" else None
        specs.append(MaterialSpec(name, config.bsdfs[name], known, learnt))
    return tuple(specs)


def drift_of(config: SessionConfig, stored: Mapping[str, StoredStage]) -> LightDrift | None:
    """Change of the light between the first chart photo and object photo, where both show
    references.
    """
    if not config.drift.chart_px:
        return None
    chart = chart_of(stored)
    assert chart is not None
    return drift_between(chart[2], reference_signals(stored["chart"]), photo_of(stored),
                         reference_signals(stored["photo"]), config.drift.relative_error)


def view_of_chart(config: SessionConfig, view: ViewInputs) -> ViewInputs | None:
    """The view whose chart photo sets a view's light scale: its own, else the first where the light
    is the same.
    """
    first = config.all_views[0]
    return view if view.chart else first if first.chart and view.light == first.light else None


def scale_of_view(config: SessionConfig, view: ViewInputs, photo: LinearImage,
              calibration: Calibration, stored: Mapping[str, StoredStage],
              drift: LightDrift | None) -> LightScale | None:
    """Light scale of a photo from the chart under its light, corrected by the drift between them;
    None leaves it to the materials.
    """
    with_chart = view_of_chart(config, view)
    chart = None if with_chart is None else chart_of(stored, with_chart)
    if chart is None or calibration.light_scale is None or config.scale.source != "chart":
        return None
    scale = scale_for_photo(calibration.light_scale, chart[2], photo, drift is not None)
    if drift is not None:
        return scale_after_drift(scale, drift)
    assert with_chart is not None
    if with_chart.chart_files == view.photo_files:
        return scale
    return with_common_error(scale, REPEATABILITY, config.repeatability.relative_error)
