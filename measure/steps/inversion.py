"""The step that inverts the photos of a scene: photos and calibrations to one reconstruction."""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from spectrabox.measure.captured import SceneCapture, SceneView
from spectrabox.measure.opened_photos import require_one_camera
from spectrabox.measure.records import CaptureRecords, ReconstructionRecords
from spectrabox.measure.scene import box_camera, draws, geometry, photo_errors
from spectrabox.measure.steps.work import Work
from spectrabox.measure.surfaces.surface_signals import scene_signals
from spectrabox.radiometry import error_model, light_scale
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, each_once
from spectrabox.radiometry.records.calibration import Calibration, LightScale
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.radiometry.records.spectra import Progress
from spectrabox.reconstruct import inverse_rendering
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.scene import scene_file
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.reconstruct.view import MaterialSpec, PhotoView

TRACE = ".trace.npz"      # among the checkpoints, while a trace goes on and where it was stopped


def invert_photos(capture: SceneCapture, records: CaptureRecords,
                  work: Work) -> ReconstructionRecords:
    """Photos, scenes and calibrations to spectra.

    Where neither a chart nor a known material tells the strength of the light, it is
    estimated from what the prior expects of surfaces. A trace that was stopped goes on from its
    checkpoint.

    Parameters
    ----------
    capture : SceneCapture
    records : CaptureRecords
        Of charts, photos and calibration.
    work : Work

    Raises
    ------
    InputError
        If two cameras took photos and chart.
    """
    require_one_camera([*(chart.thumbnail for chart in records.charts.values()),
                        *records.photo.photos.values()])
    start_mitsuba(work.device)
    views = views_of(capture, records)
    _require_picture(capture, views)
    settings = settings_of(capture)
    views = with_estimated_scale(capture, views, settings, work.progress)
    joint = inverse_rendering.reconstruct_views(views, settings, work.progress,
                                                work.checkpoint(TRACE))
    joint = photo_errors.with_stray_light(joint, *stray_light(capture, records, views))
    return ReconstructionRecords(joint, scene_signals(joint, records.calibrations(capture.views)),
                                 *geometry.scene_geometry(capture), geometry.box_scenes(capture),
                                 each_once(one for view in views for one in view.findings))


def stray_light(capture: SceneCapture, records: CaptureRecords, views: Sequence[PhotoView]
                ) -> tuple[np.ndarray, float, dict[str, str | None]]:
    """Glare, ambient light and gloss as ``photo_errors.with_stray_light`` takes them; surfaces that
    the scene says to be glossy mirror what it says.

    Parameters
    ----------
    capture : SceneCapture
    records : CaptureRecords
    views : sequence of PhotoView
    """
    modelled = {bsdf for view in views for bsdf in scene_file.not_plain_products(view.scene_file)}
    return glare_error(capture, records), capture.stray_light.ambient, {
        name: material.surface for name, material in capture.materials.items()
        if material.known is None and capture.bsdfs[name] not in modelled}


def glare_error(capture: SceneCapture, records: CaptureRecords) -> np.ndarray:
    """Standard error (K,) of veiling glare, of the mean signal of an object photo; (1,) for all
    bands where no chart photo was used.
    """
    return np.hypot(capture.stray_light.glare, records.calibrate.glare)


def require_invertible(capture: SceneCapture, records: CaptureRecords, device: str
                       ) -> tuple[str, float, int | None, tuple[Finding, ...]]:
    """Refuse a capture that the step would refuse: all that it uses is built, and a first, short
    piece of its work done.

    Parameters
    ----------
    capture : SceneCapture
    records : CaptureRecords
        Of the steps before.
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    engine, seconds, tracing_bytes
        As of ``inverse_rendering.forecast``.
    findings : tuple of Finding
        What of the scenes is not kept, and how their lights are taken.

    Raises
    ------
    InputError
    """
    start_mitsuba(device)
    views = views_of(capture, records)
    _require_picture(capture, views)
    if _level_is_free(capture, views):      # which any guess lets be checked
        views = [dataclasses.replace(view, light_scale=LightScale(1.0, None, None, ""))
                 for view in views]
    settings, _ = inverse_rendering.settings_for(views, settings_of(capture))
    findings = each_once(one for view in views for one in view.findings)
    if capture.sampling.through == "transport":
        alike = settings.engine not in inverse_rendering.SINGLE_VIEW and not any(view.own_lights
                                                                                 for view in views)
        draws.require_one_transport(len(views), alike)
    return *inverse_rendering.forecast(views, settings), findings


def _require_picture(capture: SceneCapture, views: Sequence[PhotoView]) -> None:
    """Refuse a picture of surfaces that do more to light than to multiply it, before anything is
    traced.
    """
    scene = views[0].scene_file
    if capture.picture is not None and (others := scene_file.not_plain_products(scene)):
        raise InputError(f"[picture] takes diffuse surfaces only, and {', '.join(others)} of "
                         f"{scene.path.name} is coated or glossy: leave [picture] out, or make "
                         "them diffuse and expect their highlights to be masked")


def views_of(capture: SceneCapture, records: CaptureRecords) -> list[PhotoView]:
    """Every photo with all that explains it.

    Parameters
    ----------
    capture : SceneCapture
    records : CaptureRecords
        Of charts, photos and calibration.

    Raises
    ------
    InputError
        If scene and capture do not name the same materials.
    """
    bands = capture.band_names(records.photo.bands)
    views: list[PhotoView] = []
    for own, calibration in zip(capture.views, records.calibrations(capture.views), strict=True):
        photo = records.photo.photos[own.name]
        scale = scale_of_view(capture, own, photo, calibration, records)
        scene = box_camera.scene_of(own.scene)
        views.append(PhotoView(own.title, scene, photo, calibration, bands,
                               materials_of(capture, scene), scale, dict(own.lights_by_id),
                               own.lamp))
    return views


def settings_of(capture: SceneCapture) -> InversionSettings:
    """The settings of the inversion, with the learnt prior where it is asked for."""
    chosen = capture.inversion
    learnt = photo_errors.learnt_spectra(()) if chosen.spectrum_prior == "learnt" else None
    return InversionSettings(**chosen.settings(), seed=capture.seed, learnt=learnt)


def materials_of(capture: SceneCapture, scene: scene_file.SceneFile) -> tuple[MaterialSpec, ...]:
    """Materials of the capture with their known spectra on the working grid, or what is expected of
    their families.

    Parameters
    ----------
    capture : SceneCapture
    scene : SceneFile

    Raises
    ------
    InputError
        If scene and capture do not name the same materials.
    """
    require_materials(scene, capture.bsdfs)
    learnt = capture.inversion.spectrum_prior == "learnt"
    return tuple(
        MaterialSpec(
            name, capture.bsdfs[name], material.known,
            photo_errors.learnt_spectra(material.families) if material.families and learnt else None
        ) for name, material in capture.materials.items())


def require_materials(scene: scene_file.SceneFile, bsdfs: dict[str, str]) -> None:
    """Refuse a scene whose BSDFs are not those of the materials.

    Parameters
    ----------
    scene : SceneFile
    bsdfs : dict
        From the name of each material to the id of its BSDF.

    Raises
    ------
    InputError
        One sentence a line.
    """
    problems = scene_file.check_materials(scene, bsdfs)
    if problems:
        raise InputError(*problems)


def with_estimated_scale(capture: SceneCapture, views: list[PhotoView],
                          settings: InversionSettings, progress: Progress) -> list[PhotoView]:
    """Views with the strength of the light, by the prior where nothing else tells it: a level that
    is then estimated with the spectra.

    Parameters
    ----------
    capture : SceneCapture
    views : list of PhotoView
    settings : InversionSettings
    progress : callable

    Raises
    ------
    InputError
        If no strength of the light explains a photo.
    """
    if not _level_is_free(capture, views):
        return views
    scaled: list[PhotoView] = []
    for view in views:
        # the level of one photo carries over to those that show its surfaces
        linked = {material for other in scaled for material in other.name_of_bsdf}
        if linked & view.name_of_bsdf.keys():
            scaled.append(dataclasses.replace(view, level_error=scaled[0].level_error))
            continue
        scale = photo_errors.scale_from_prior(view, settings, capture.families, progress)
        assert scale.standard_error is not None
        scaled.append(dataclasses.replace(
            view, light_scale=scale, level_error=scale.standard_error / scale.value))
    return scaled


def _level_is_free(capture: SceneCapture, views: Sequence[PhotoView]) -> bool:
    """Whether neither a chart nor a known material tells the strength of the light."""
    known = any(material.known is not None for material in capture.materials.values())
    return not known and all(view.light_scale is None for view in views)


def view_of_chart(capture: SceneCapture, view: SceneView) -> SceneView | None:
    """The view whose chart photo sets a view's light scale: its own, else the first where the light
    is the same.
    """
    first = capture.views[0]
    return view if view.chart else first if first.chart and view.same_light(first) else None


def scale_of_view(capture: SceneCapture, view: SceneView, photo: LinearImage,
                  calibration: Calibration, records: CaptureRecords) -> LightScale | None:
    """Light scale of a photo from the chart under its light; None leaves it to the materials,
    which then tell how strong the light on the scene is.

    Parameters
    ----------
    capture : SceneCapture
    view : SceneView
    photo : LinearImage
        Of the view.
    calibration : Calibration
        Of the view.
    records : CaptureRecords
    """
    if view.scale is not None:
        return view.scale
    with_chart = view_of_chart(capture, view) if capture.scale_from_chart else None
    chart = None if with_chart is None else records.charts.get(with_chart.name)
    if with_chart is None or chart is None or calibration.light_scale is None:
        return None
    scale = error_model.with_common_error(
        light_scale.scale_for_photo(calibration.light_scale, chart.thumbnail, photo),
        error_model.SCENE_LEVEL, capture.repeatability.scene_level)
    if with_chart.chart == view.photo:
        return scale
    return error_model.with_common_error(scale, error_model.REPEATABILITY,
                                         capture.repeatability.relative_error)
