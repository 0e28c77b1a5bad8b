"""The stage that makes a picture of spectra of a flat sample."""
from __future__ import annotations

from typing import Any

from spectrabox.sampling.prior.mixture import load_prior, of_families
from spectrabox.session.flat.errors_of_pixels import errors_of_pixels
from spectrabox.session.picture.part_of_photo import cut, part_of
from spectrabox.session.picture.picture import LitPixels, write_picture
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import calibrations_of


def picture_of_spectra(task: StageTask) -> dict[str, Any]:
    """Every pixel of the first photo, or of a part of it, to its spectrum.

    Returns
    -------
    dict
        As of ``write_picture``, and "notes".

    Raises
    ------
    InputError
        If the picture's rectangle leaves the photo.
    """
    config, section = task.config, task.config.picture
    assert section is not None
    view = config.all_views[0]
    task.progress(0.0, f"reading {view.photo_files[0]}")
    photo, _ = task.photos.developed(config, view.photo)
    part = part_of(photo, section.rect)
    prior = of_families(load_prior(), section.families)
    errors = errors_of_pixels(task, view, calibrations_of(config, task.stored)[0], part.corners_px,
                              (part.x_px, part.y_px), prior)
    return {"notes": ()} | write_picture(LitPixels(cut(photo, part), errors), section, task.folder,
                                         lambda share: task.progress(share, ""))
