"""The stage that makes a picture of spectra of a flat sample."""
from __future__ import annotations

import numpy as np

from spectrabox.measure.pictures.crop import Crop, crop_of, crop_photo, node_grid
from spectrabox.measure.pictures.illumination import even_light
from spectrabox.measure.pictures.lit_photo import LitPhoto
from spectrabox.measure.pictures.pixel_errors import PixelErrors, White
from spectrabox.measure.white import white_at_regions
from spectrabox.radiometry.error_model import (
    SURFACE_REFLECTIONS,
    drift_covariance,
    glare_signal,
)
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, load_prior, of_families
from spectrabox.session.pictures.picture_files import write_picture
from spectrabox.session.stages.records import PictureRecords
from spectrabox.session.stages.signals_stage import flat_errors, flat_photos, known_spectra
from spectrabox.session.stages.stage_task import StageTask

COLUMNS = 24                # of the nodes at which white and its errors are computed


def picture_of_spectra(task: StageTask) -> PictureRecords:
    """Spectra of every pixel of the first photo, or of a part of it.

    Parameters
    ----------
    task : StageTask

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
    return write_picture(LitPhoto(crop_photo(photo, crop), errors), section, task.folder,
                         lambda share: task.progress(share, ""))


def pixel_errors(task: StageTask, crop: Crop, prior: LogitMixture) -> PixelErrors:
    """White and errors over a rectangle of the first photo, which shows a region."""
    config, records = task.config, task.records
    assert config.picture is not None
    photo, errors = flat_photos(config, records)[0], flat_errors(config, records)
    nodes_px, between = node_grid(crop, COLUMNS)
    white = white_at_regions(photo, known_spectra(config), errors, nodes_px)
    assert white is not None
    response, bands, count = photo.response, white.glare.size, len(nodes_px)
    first = len(white.samples.names) - count        # the nodes stand after the regions
    covariance = np.array([white.white_and_glare(first + node) for node in range(count)])
    relative = errors.disagreement.among_bands(bands)
    if photo.drift is not None:
        relative = relative + drift_covariance(photo.drift)
    on_prior = response @ interpolation_matrix(PRIOR_GRID.nm, FINE_GRID.nm)
    return PixelErrors(
        between, White(white.white[first:], covariance[:, :bands, :bands],
                       covariance[:, :bands, bands:]),
        even_light(on_prior, count), white.glare + white.mean[white.glare_part],
        covariance[0, bands:, bands:],
        glare_signal(errors.glare, photo.image.signal.mean(axis=(0, 1))),
        SURFACE_REFLECTIONS[config.picture.surface],
        relative, (photo.calibration,), response[None], prior)
