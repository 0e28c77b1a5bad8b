"""The stage that makes a picture of spectra of a scene, shading and interreflection taken out."""
from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from spectrabox.calibrate.geometry.lens_files import read_lens
from spectrabox.calibrate.geometry.projection import undistorted
from spectrabox.radiometry.records import LinearImage
from spectrabox.reconstruct.engines.transport_engine import unit_scene
from spectrabox.reconstruct.pixels.pixel_light import trace_pixel_light
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.sampling.prior.mixture import load_prior, of_families
from spectrabox.session.picture.part_of_photo import part_of
from spectrabox.session.picture.picture import kept_wavelengths, write_picture
from spectrabox.session.picture.scene_light import found_light
from spectrabox.session.picture.scene_of_picture import SceneOfPicture
from spectrabox.session.picture.textures import Textures
from spectrabox.session.stages.reconstruct_stage import drift_of, views_of
from spectrabox.session.stages.stage_task import StageTask

TRACED, FOUND = 0.4, 0.6     # shares of the time
TRACE = ".picture-trace.npz"    # in the results, while a trace goes on and where it was stopped
NEAR_EDGE = 3               # pixels: within as many across, only one surface may lie


def picture_of_scene(task: StageTask) -> dict[str, Any]:
    """Every pixel of the first photo of a scene, or of a part of it, to its spectrum.

    Returns
    -------
    dict
        As of ``write_picture``, and "notes"; the largest relative change of the light in each of
        the "rounds" in which light and spectra were found.

    Raises
    ------
    InputError
        If the picture's rectangle leaves the photo, or the scene has surfaces that do more to light
        than to multiply it.
    """
    section = task.config.picture
    assert section is not None
    start_mitsuba(task.device)
    scene = scene_of(task)
    found = found_light(scene, lambda share: task.progress(TRACED + (FOUND - TRACED) * share,
                                                           "light from other surfaces"))
    assert found.pixels.unseen is not None
    textures = Textures(scene, found.pixels.unseen, kept_wavelengths(section))
    written = write_picture(found.pixels, section, task.folder,
                            lambda share: task.progress(FOUND + (1 - FOUND) * share, ""),
                            textures.add)
    files = (*written["files"], *textures.write(task.folder))
    return written | {"notes": (found.sentence, *textures.notes), "files": files,
                      "rounds": np.array(found.changes)}


def scene_of(task: StageTask) -> SceneOfPicture:
    """The photo in full, with the light on it traced."""
    config, section = task.config, task.config.picture
    assert section is not None
    task.progress(0.0, f"reading {config.all_views[0].photo_files[0]}")
    view = views_of(config, task.stored, drift_of(config, task.stored))[0]
    view = replace(view, photo=_photo(task))
    part = part_of(view.photo, section.rect)
    task.progress(0.02, "tracing light")
    direct = config.reconstruct.engine == "single-bounce"
    unit = unit_scene(view, 1 if direct else view.scene_file.max_depth - 1, bool(view.own_lights))
    surface = np.full(view.surface.shape, -1, np.int32)
    surface[part.rows, part.columns] = view.surface[part.rows, part.columns]
    own = np.array([unit.materials.index(name) for name in view.surface_materials])
    traced = trace_pixel_light(unit, surface, own, seed=config.session.seed,
                               progress=lambda done: task.progress(0.02 + (TRACED - 0.02) * done,
                                                                   "tracing light"),
                               checkpoint=config.results_folder / TRACE)
    edges = maximum_filter(view.surface, NEAR_EDGE) != minimum_filter(view.surface, NEAR_EDGE)
    return SceneOfPicture(task, view, unit, traced, part, edges,
                          of_families(load_prior(), section.families))


def _photo(task: StageTask) -> LinearImage:
    """The first photo as the renderer's pinhole sees it."""
    photo, _ = task.photos.developed(task.config, task.config.all_views[0].photo)
    lens = task.config.camera.lens
    return photo if lens is None else undistorted(photo, read_lens(task.config.path(lens)))
