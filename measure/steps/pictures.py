"""The step "picture": spectra of every pixel of flat samples and of scenes."""


from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from spectrabox.calibrate.geometry.projection import undistorted
from spectrabox.capture.photo.registration import resampled, uncertain_edges
from spectrabox.measure.captured import FlatCapture, SceneCapture
from spectrabox.measure.pictures import (
    picture_files,
    scene_light,
    stacked_photos,
    surface_textures,
    texture_files,
)
from spectrabox.measure.pictures.crop import Crop, crop_of, crop_photo, node_grid
from spectrabox.measure.pictures.lit_photo import LitPhoto
from spectrabox.measure.pictures.traced_photo import TracedPhoto
from spectrabox.measure.records import CaptureRecords, PictureRecords
from spectrabox.measure.regions import white
from spectrabox.measure.scene.box_camera import lens_of
from spectrabox.measure.steps import inversion, signals
from spectrabox.measure.steps.work import Work
from spectrabox.radiometry import errors, findings
from spectrabox.radiometry.records.photos import LinearImage, Registration
from spectrabox.reconstruct import known_light, pixel_light, transport_engine
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.sampling.prior.mixture import load_prior, of_families

COLUMNS = 24                # of the nodes at which white and its errors are computed
SHARE_OF_TIME = 0.1         # reading photos


def flat_picture(capture: FlatCapture, records: CaptureRecords, work: Work) -> PictureRecords:
    """Spectra of every pixel of the first photo, or of a part of it, in the bands of all photos
    that show the same regions.

    Parameters
    ----------
    capture : FlatCapture
    records : CaptureRecords
        Of charts, photos and calibration.
    work : Work
        With a folder.

    Raises
    ------
    InputError
        If the picture's rectangle leaves the photo.
    """
    assert capture.picture is not None
    if work.folder is None:
        raise errors.InputError("a picture of spectra is files: name a folder for them")
    lit = lit_photo(capture, records, work)
    written = picture_files.write_picture(
        lit, capture.picture, work.folder,
        lambda share: work.progress(SHARE_OF_TIME + (1 - SHARE_OF_TIME) * share, ""))
    return replace(written, findings=tuple(_findings(capture, lit)))


def lit_photo(capture: FlatCapture, records: CaptureRecords, work: Work) -> LitPhoto:
    """All photos of the picture, in the pixels of the first, with white and its errors."""
    assert capture.picture is not None
    views = capture.picture_views
    all_photos = signals.flat_photos(capture, records)
    photos = [all_photos[capture.views.index(view)] for view in views]
    images: list[LinearImage] = []
    nodes_of: list[np.ndarray] = []
    for number, view in enumerate(views):
        work.progress(SHARE_OF_TIME * number / len(views), f"reading {view.photo_names[0]}")
        image, _ = work.photos.developed(view.photo)
        if not number:
            crop = crop_of(image, capture.picture.rect)
            nodes_px, between = node_grid(crop, COLUMNS)
        motion = records.photo.registrations.get(view.name)
        images.append(_in_first(image, motion, crop))
        nodes_of.append(nodes_px if motion is None else motion.moved(nodes_px))
    stated = signals.flat_errors(capture, records)
    known, _ = white.agreeing_known(photos, capture.known, stated)
    return stacked_photos.stack_photos(photos, images, nodes_of, between, known, stated,
                                       capture.picture.surface,
                                       of_families(load_prior(), capture.picture.families))


def _in_first(image: LinearImage, motion: Registration | None, crop: Crop) -> LinearImage:
    """A photo in the pixels of the first, the part of the picture alone; edges that may lie beside
    those of the first count as saturated.
    """
    off_px: np.ndarray | float
    if motion is None:
        return crop_photo(image, crop)
    if motion.still:
        shown = crop_photo(image, crop)
        off_px = motion.shift_px / crop.step
    else:
        shown, off_px = resampled(image, motion.matrix, crop.x_px, crop.y_px)
    uncertain = uncertain_edges(shown, np.hypot(off_px, (motion.residual_px or 0) / crop.step))
    return replace(shown, saturated=shown.saturated | uncertain[..., None])


def _findings(capture: FlatCapture, lit: LitPhoto) -> Iterator[findings.Finding]:
    """What a reader of the picture has to know of its photos."""
    views = capture.picture_views
    for view in capture.views:
        if view not in views:
            yield findings.Finding("picture.without-photo", findings.Severity.NOTE, view.title)
    if len(views) > 1:
        yield findings.Finding("picture.photos", findings.Severity.INFO, values={
            "names": [view.title for view in views], "bands": int(lit.size[2])})
    if lit.band_sets is not None and len(lit.band_sets[0]) > 1:
        _, index = lit.band_sets
        yield findings.Finding("picture.fewer-photos", findings.Severity.INFO, values={
            "share": float(np.mean((index > 0) & (lit.flags == 0)))})


# ---- scene picture -------------------------------------------------------------------------------

TRACED, LIT = 0.4, 0.6      # shares of the time
TRACE = ".picture-trace.npz"    # among the checkpoints, while a trace goes on
NEAR_EDGE = 3               # pixels: within as many across, only one surface may lie


def scene_picture(capture: SceneCapture, records: CaptureRecords, work: Work) -> PictureRecords:
    """Spectra of every pixel of the first photo of a scene, or of a part of it.

    Parameters
    ----------
    capture : SceneCapture
    records : CaptureRecords
        Of the steps up to the inversion.
    work : Work
        With a folder.

    Raises
    ------
    InputError
        If the picture's rectangle leaves the photo, or the scene has surfaces that do more to light
        than to multiply it.
    """
    section = capture.picture
    assert section is not None
    if work.folder is None:
        raise errors.InputError("a picture of spectra is files: name a folder for them")
    start_mitsuba(work.device)
    scene = traced_photo(capture, records, work)
    photo, _, _, changes = scene_light.converge_light(
        scene, lambda share: work.progress(TRACED +
                                           (LIT - TRACED) * share, "light from other surfaces"))
    assert photo.flags is not None
    sums = surface_textures.TextureSums(scene, photo.flags, picture_files.layout_of(section))
    written = picture_files.write_picture(photo, section, work.folder,
                            lambda share: work.progress(LIT + (1 - LIT) * share, ""),
                            sums.add)
    textures = texture_files.write_textures(sums, picture_files.layout_of(section),
                                            work.folder)
    return replace(written, files=(*written.files, *textures), rounds=np.array(changes),
                   findings=(scene_light.light_finding(changes), *sums.findings))


def traced_photo(capture: SceneCapture, records: CaptureRecords, work: Work) -> TracedPhoto:
    """The first photo in full, as the renderer's pinhole sees it, with the light on it traced."""
    section, first = capture.picture, capture.views[0]
    assert section is not None
    work.progress(0.0, f"reading {first.photo_names[0]}")
    photo, _ = work.photos.developed(first.photo)
    lens = lens_of(first)
    if lens is not None:
        photo = undistorted(photo, lens)
    light = records.reconstruct.joint.views[0].known_light
    if light is not None:
        photo = known_light.in_chart_light(photo, light)
    view = replace(inversion.views_of(capture, records)[0], photo=photo)
    crop = crop_of(photo, section.rect)
    work.progress(0.02, "tracing light")
    direct = capture.inversion.engine == "single-bounce"
    unit = transport_engine.unit_scene(view, 1 if direct else view.scene_file.max_depth - 1,
                                       bool(view.own_lights))
    surface = np.full(view.surface.shape, -1, np.int32)
    surface[crop.rows, crop.columns] = view.surface[crop.rows, crop.columns]
    nodes, traced = pixel_light.trace_pixel_light(
        unit, surface, seed=capture.seed, checkpoint=work.checkpoint(TRACE),
        progress=lambda done: work.progress(0.02 + (TRACED - 0.02) * done, "tracing light"))
    edges = maximum_filter(view.surface, NEAR_EDGE) != minimum_filter(view.surface, NEAR_EDGE)
    joint, settings = records.reconstruct.joint, capture.inversion
    return TracedPhoto(
        view, unit, nodes, traced, crop, edges, of_families(load_prior(), section.families), joint,
        records.calibrations(capture.views)[0],
        inversion.glare_error(capture, records) * joint.views[0].measured.mean(axis=(0, 1)),
        capture.stray_light.ambient, section.surface,
        float(np.hypot(settings.surface_error, settings.brightness_error)), capture.seed)
