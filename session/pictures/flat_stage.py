"""The stage that makes a picture of spectra of a flat sample."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.measure.pictures.crop import Crop, crop_of, crop_photo, node_grid
from spectrabox.measure.pictures.illumination import even_light
from spectrabox.measure.pictures.lit_photo import LitPhoto
from spectrabox.measure.pictures.pixel_errors import PixelErrors, White
from spectrabox.radiometry.error_model import drift_covariance, glare_signal
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, load_prior, of_families
from spectrabox.session.flat.signals_stage import (
    drift_of,
    model_error,
    response_of,
    white_of_photo,
)
from spectrabox.session.pictures.picture_files import write_picture
from spectrabox.session.stages.inputs import GRID
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import calibrations_of, photo_of

COLUMNS = 24                # of the nodes at which white and its errors are computed


def picture_of_spectra(task: StageTask) -> dict[str, Any]:
    """Spectra of every pixel of the first photo, or of a part of it.

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
    crop = crop_of(photo, section.rect)
    prior = of_families(load_prior(), section.families)
    errors = pixel_errors(task, crop, prior)
    return {"notes": ()} | write_picture(LitPhoto(crop_photo(photo, crop), errors), section,
                                         task.folder, lambda share: task.progress(share, ""))


def pixel_errors(task: StageTask, crop: Crop, prior: LogitMixture) -> PixelErrors:
    """White and errors over a rectangle of the first photo, which shows a region."""
    config, stored = task.config, task.stored
    view, calibration = config.all_views[0], calibrations_of(config, stored)[0]
    nodes_px, between = node_grid(crop, COLUMNS)
    response, drift = response_of(calibration), drift_of(task)
    white = white_of_photo(task, view, response, drift, nodes_px)
    assert white is not None
    bands, count = white.glare.size, len(nodes_px)
    first = len(white.samples.names) - count        # the nodes stand after the regions
    covariance = np.array([white.white_and_glare(first + node) for node in range(count)])
    relative = model_error(task).among_bands(bands)
    if drift is not None and not view.name:
        relative = relative + drift_covariance(drift)
    on_prior = response @ interpolation_matrix(PRIOR_GRID.nm, GRID.nm)
    return PixelErrors(
        between, White(white.white[first:], covariance[:, :bands, :bands],
                       covariance[:, :bands, bands:]),
        even_light(on_prior, count), white.glare + white.mean[bands:2 * bands],
        covariance[0, bands:, bands:],
        glare_signal(config.stray_light.glare, photo_of(stored, view).signal.mean(axis=(0, 1))),
        relative, (calibration,), response[None], prior)
