"""The stage that makes a picture of spectra of a flat sample."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from spectrabox.capture.photo.registration import Registration
from spectrabox.capture.photo.resampled import resampled, uncertain_edges
from spectrabox.measure.pictures.crop import Crop, crop_of, crop_photo, node_grid
from spectrabox.measure.pictures.lit_photo import LitPhoto
from spectrabox.measure.pictures.stacked_photos import PicturePhoto, stack_photos
from spectrabox.radiometry.error_model import SURFACE_REFLECTIONS
from spectrabox.radiometry.records import LinearImage
from spectrabox.sampling.prior.mixture import load_prior, of_families
from spectrabox.session.pictures.picture_files import write_picture
from spectrabox.session.stages.records import PictureRecords
from spectrabox.session.stages.signals_stage import flat_errors, flat_photos, known_spectra
from spectrabox.session.stages.stage_task import StageTask

COLUMNS = 24                # of the nodes at which white and its errors are computed
SHARE_OF_TIME = 0.1         # reading photos


def picture_of_spectra(task: StageTask) -> PictureRecords:
    """Spectra of every pixel of the first photo, or of a part of it, in the bands of all photos
    that show the same regions.

    Parameters
    ----------
    task : StageTask

    Raises
    ------
    InputError
        If the picture's rectangle leaves the photo.
    """
    section = task.config.picture
    assert section is not None
    lit = lit_photo(task)
    written = write_picture(lit, section, task.folder, lambda share: task.progress(
        SHARE_OF_TIME + (1 - SHARE_OF_TIME) * share, ""))
    return replace(written, notes=_notes(task, lit))


def lit_photo(task: StageTask) -> LitPhoto:
    """All photos of the picture, in the pixels of the first, with white and its errors."""
    config, records = task.config, task.records
    assert config.picture is not None
    views, photos = config.picture_views, flat_photos(config, records)
    shown: list[PicturePhoto] = []
    for number, view in enumerate(views):
        task.progress(SHARE_OF_TIME * number / len(views), f"reading {view.photo_files[0]}")
        image, _ = task.photos.developed(config, view.photo)
        if not number:
            crop = crop_of(image, config.picture.rect)
            nodes_px, between = node_grid(crop, COLUMNS)
        motion = records.photo.registrations.get(view.name)
        shown.append(PicturePhoto(
            photos[config.all_views.index(view)], _in_first(image, motion, crop),
            nodes_px if motion is None else motion.moved(nodes_px)))
    return stack_photos(shown, between, known_spectra(config), flat_errors(config, records),
                        SURFACE_REFLECTIONS[config.picture.surface],
                        of_families(load_prior(), config.picture.families))


def _in_first(image: LinearImage, motion: Registration | None, crop: Crop) -> LinearImage:
    """A photo in the pixels of the first, the part of the picture alone; edges that may lie beside
    those of the first count as saturated.
    """
    off_px: np.ndarray | float
    if motion is None:
        return crop_photo(image, crop)
    if motion.still:
        shown, off_px = crop_photo(image, crop), motion.shift_px / crop.step
    else:
        shown, off_px = resampled(image, motion.matrix, crop.x_px, crop.y_px)
    uncertain = uncertain_edges(shown, np.hypot(off_px, (motion.residual_px or 0) / crop.step))
    return replace(shown, saturated=shown.saturated | uncertain[..., None])


def _notes(task: StageTask, lit: LitPhoto) -> tuple[str, ...]:
    """What a reader of the picture has to know of its photos."""
    config = task.config
    views = config.picture_views
    notes = [f"photo {view.title} shows no region of the first photo: the picture does without it"
             for view in config.all_views if view not in views]
    if len(views) > 1:
        notes.append(f"the signals of a pixel are those of {len(views)} photos, "
                     f"{', '.join(view.title for view in views)}, in {lit.size[2]} bands")
    if lit.shown is not None and len(lit.shown.sets) > 1:
        fewer = float(np.mean((lit.shown.index > 0) & (lit.shown.flags == 0)))
        notes.append(f"{fewer:.1%} of the pixels have spectra from fewer photos: others are "
                     "clipped or without signal there, do not show them, or show an edge whose "
                     "position is not known as well")
    return tuple(notes)
