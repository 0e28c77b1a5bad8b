"""The stage that finds spectra: photos, scenes and calibrations to one reconstruction."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spectrabox.measure.scene.draws import require_one_transport
from spectrabox.measure.scene.photo_errors import StatedErrors, with_photo_errors
from spectrabox.measure.scene.reconstruction import learnt_spectra
from spectrabox.measure.surface_signals import scene_signals
from spectrabox.radiometry.error_model import (
    REPEATABILITY,
    SCENE_LEVEL,
    SURFACE_REFLECTIONS,
    with_common_error,
)
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.light_scale import scale_after_drift, scale_for_photo
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
from spectrabox.session.stages.inputs import band_names, read_known_light, read_reflectance
from spectrabox.session.stages.records import ReconstructionRecords, SessionRecords
from spectrabox.session.stages.scenes import read_session_scene, require_materials
from spectrabox.session.stages.stage_task import StageTask

TRACE = ".trace.npz"      # in the results, while a trace goes on and where it was stopped


def invert_photos(task: StageTask) -> ReconstructionRecords:
    """Photos, scenes and calibrations to spectra.

    A drift of the light between the first view's chart and photo corrects its scale and widens its
    errors. A trace that was stopped goes on from its checkpoint among the results.

    Parameters
    ----------
    task : StageTask
    """
    config, records = task.config, task.records
    start_mitsuba(task.device)
    drift = records.drift(config)
    views = views_of(config, records, drift)
    _require_picture(config, views)
    joint = reconstruct_views(views, settings_of(config), task.progress,
                              config.results_folder / TRACE)
    joint = with_photo_errors(joint, stated_errors(config, records, views, drift))
    return ReconstructionRecords(joint, scene_signals(joint, records.calibrations(config)), drift,
                                 scene_geometry(config))


def stated_errors(config: SessionConfig, records: SessionRecords, views: Sequence[View],
                  drift: LightDrift | None) -> StatedErrors:
    """What the session states of its photos; surfaces that the scene says to be glossy mirror what
    it says.

    Parameters
    ----------
    drift : LightDrift or None
        Of the light between the first view's chart and photo.
    """
    modelled = {bsdf for view in views for bsdf in not_plain_products(view.scene_file)}
    return StatedErrors(drift, glare_error(config, records), config.stray_light.ambient,
                        {name: SURFACE_REFLECTIONS[material.surface]
                         for name, material in config.materials.items()
                         if material.known is None and config.bsdfs[name] not in modelled})


def glare_error(config: SessionConfig, records: SessionRecords) -> np.ndarray:
    """Standard error (K,) of veiling glare, of the mean signal of an object photo; (1,) for all
    bands where no chart photo was used.
    """
    chart = records.calibrate.chart
    return np.hypot(config.stray_light.glare, np.zeros(1) if chart is None else chart.glare)


def require_invertible(config: SessionConfig, records: SessionRecords, device: str) -> int | None:
    """Refuse a session that the stage would refuse, before more than a first, short trace.

    Parameters
    ----------
    records : SessionRecords
        Of the stages before.
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
    views = views_of(config, records, records.drift(config))
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


def views_of(config: SessionConfig, records: SessionRecords,
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
    photos = records.photo.photos
    bands = band_names(config, records.photo.bands)
    views: list[View] = []
    for inputs, calibration in zip(config.all_views, records.calibrations(config), strict=True):
        scene, photo = read_session_scene(config, inputs), photos[inputs.name]
        drifted = drift if not inputs.name else None
        scale = scale_of_view(config, inputs, photo, calibration, records, drifted)
        lights = {light: read_known_light(config, spectrum)
                  for light, spectrum in inputs.lights_by_id.items()}
        views.append(View(inputs.title, scene, photo, calibration, bands,
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
            spectrum_on_grid(read_reflectance(config, material.known), FINE_GRID)
        learnt = learnt_spectra(material.families) if material.families \
            and config.reconstruct.spectrum_prior == "learnt" else None
        specs.append(MaterialSpec(name, config.bsdfs[name], known, learnt))
    return tuple(specs)


def view_of_chart(config: SessionConfig, view: ViewInputs) -> ViewInputs | None:
    """The view whose chart photo sets a view's light scale: its own, else the first where the light
    is the same.
    """
    first = config.all_views[0]
    return view if view.chart else first if first.chart and view.same_light(first) else None


def scale_of_view(config: SessionConfig, view: ViewInputs, photo: LinearImage,
                  calibration: Calibration, records: SessionRecords,
                  drift: LightDrift | None) -> LightScale | None:
    """Light scale of a photo from the chart under its light, corrected by the drift between them;
    None leaves it to the materials, which then tell how strong the light on the scene is.

    Parameters
    ----------
    photo : LinearImage
        Of the view.
    calibration : Calibration
        Of the view.
    records : SessionRecords
    drift : LightDrift or None
        Of the light between chart and photo.
    """
    with_chart = view_of_chart(config, view) if config.scale.source == "chart" else None
    chart = None if with_chart is None else records.chart.charts.get(with_chart.name)
    if with_chart is None or chart is None or calibration.light_scale is None:
        return None
    scale = with_common_error(
        scale_for_photo(calibration.light_scale, chart.thumbnail, photo, drift is not None),
        SCENE_LEVEL, config.repeatability.scene_level)
    if drift is not None:
        return scale_after_drift(scale, drift)
    if with_chart.chart_files == view.photo_files:
        return scale
    return with_common_error(scale, REPEATABILITY, config.repeatability.relative_error)
