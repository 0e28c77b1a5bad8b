"""The stage that makes a picture of spectra of a scene, shading and interreflection taken out."""
from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from spectrabox.calibrate.geometry.projection import undistorted
from spectrabox.measure.pictures.crop import crop_of
from spectrabox.measure.pictures.scene_light import converge_light
from spectrabox.measure.pictures.surface_textures import TextureSums
from spectrabox.measure.pictures.traced_photo import TracedPhoto
from spectrabox.radiometry.error_model import SURFACE_REFLECTIONS
from spectrabox.reconstruct.engines.transport_engine import unit_scene
from spectrabox.reconstruct.pixels.pixel_light import trace_pixel_light
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.sampling.prior.mixture import load_prior, of_families
from spectrabox.session.box.box_camera import lens_of_view
from spectrabox.session.pictures.picture_files import layout_of, write_picture
from spectrabox.session.pictures.texture_files import write_textures
from spectrabox.session.stages.reconstruct_stage import glare_error, views_of
from spectrabox.session.stages.records import PictureRecords
from spectrabox.session.stages.stage_task import StageTask

TRACED, LIT = 0.4, 0.6      # shares of the time
TRACE = ".picture-trace.npz"    # in the results, while a trace goes on and where it was stopped
NEAR_EDGE = 3               # pixels: within as many across, only one surface may lie


def picture_of_scene(task: StageTask) -> PictureRecords:
    """Spectra of every pixel of the first photo of a scene, or of a part of it.

    Parameters
    ----------
    task : StageTask

    Raises
    ------
    InputError
        If the picture's rectangle leaves the photo, or the scene has surfaces that do more to light
        than to multiply it.
    """
    section = task.config.picture
    assert section is not None
    start_mitsuba(task.device)
    scene = traced_photo(task)
    light = converge_light(scene, lambda share: task.progress(TRACED + (LIT - TRACED) * share,
                                                              "light from other surfaces"))
    assert light.photo.flags is not None
    sums = TextureSums(scene, light.photo.flags, layout_of(section))
    written = write_picture(light.photo, section, task.folder,
                            lambda share: task.progress(LIT + (1 - LIT) * share, ""),
                            sums.add)
    textures = write_textures(sums.textures(), layout_of(section), task.folder)
    return replace(written, files=(*written.files, *textures), rounds=np.array(light.changes),
                   notes=(light.sentence, *sums.notes))


def traced_photo(task: StageTask) -> TracedPhoto:
    """The first photo in full, as the renderer's pinhole sees it, with the light on it traced."""
    config, records, section = task.config, task.records, task.config.picture
    assert section is not None
    task.progress(0.0, f"reading {config.all_views[0].photo_files[0]}")
    photo, _ = task.photos.developed(config, config.all_views[0].photo)
    if (lens := lens_of_view(config, config.all_views[0])) is not None:
        photo = undistorted(photo, lens)
    drift = records.reconstruct.drift
    view = replace(views_of(config, records, drift)[0], photo=photo)
    crop = crop_of(photo, section.rect)
    task.progress(0.02, "tracing light")
    direct = config.reconstruct.engine == "single-bounce"
    unit = unit_scene(view, 1 if direct else view.scene_file.max_depth - 1, bool(view.own_lights))
    surface = np.full(view.surface.shape, -1, np.int32)
    surface[crop.rows, crop.columns] = view.surface[crop.rows, crop.columns]
    own = np.array([unit.materials.index(name) for name in view.surface_materials])
    traced = trace_pixel_light(unit, surface, own, seed=config.session.seed,
                               progress=lambda done: task.progress(0.02 + (TRACED - 0.02) * done,
                                                                   "tracing light"),
                               checkpoint=config.results_folder / TRACE)
    edges = maximum_filter(view.surface, NEAR_EDGE) != minimum_filter(view.surface, NEAR_EDGE)
    joint, settings = records.reconstruct.joint, config.reconstruct
    return TracedPhoto(
        view, unit, traced, crop, edges, of_families(load_prior(), section.families), joint,
        records.calibrations(config)[0], drift,
        glare_error(config, records) * joint.views[0].measured.mean(axis=(0, 1)),
        config.stray_light.ambient, SURFACE_REFLECTIONS[section.surface],
        float(np.hypot(settings.surface_error, settings.brightness_error)), config.session.seed)
