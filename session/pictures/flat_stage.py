"""The stage that makes a picture of spectra of a flat sample."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse import csr_array, kron

from spectrabox.measure.pictures.crop import Crop, crop_of, crop_photo
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
    x0, y0, x1, y1 = crop.corners_px
    x_px = np.linspace(x0, x1, COLUMNS)
    y_px = np.linspace(y0, y1, max(round(COLUMNS * (y1 - y0) / (x1 - x0)), 2))
    nodes = np.stack(np.meshgrid(x_px, y_px), axis=-1).reshape(-1, 2)
    response, drift = response_of(calibration), drift_of(task)
    white = white_of_photo(task, view, response, drift, nodes)
    assert white is not None
    bands, count = white.glare.size, len(nodes)
    total, regions = white.covariance, len(white.samples.names) - count
    level, glare = slice(0, bands), slice(bands, 2 * bands)
    causes = np.arange(2 * bands + regions + count, len(total))
    log, with_glare = np.empty((count, bands, bands)), np.empty((count, bands, bands))
    for node in range(count):
        # what all bands share there: the field, and the errors of the exposure
        common = np.r_[2 * bands + regions + node, causes]
        with_level = total[level, common].sum(axis=1)
        log[node] = total[level, level] + with_level[:, None] + with_level \
            + total[np.ix_(common, common)].sum()
        with_glare[node] = total[level, glare] + total[common, glare].sum(axis=0)
    relative = model_error(task).among_bands(bands)
    if drift is not None and not view.name:
        relative = relative + drift_covariance(drift)
    veil = glare_signal(config.stray_light.glare, photo_of(stored, view).signal.mean(axis=(0, 1)))
    on_prior = response @ interpolation_matrix(PRIOR_GRID.nm, GRID.nm)
    return PixelErrors(
        node_weights(x_px, y_px, crop.x_px, crop.y_px), White(white.white[regions:], log,
                                                              with_glare),
        even_light(on_prior, count), white.glare + white.mean[glare], total[glare, glare], veil,
        relative, (calibration,), response[None], prior)


def node_weights(x_px: np.ndarray, y_px: np.ndarray, columns_px: np.ndarray,
                 rows_px: np.ndarray) -> Callable[[int, int], csr_array]:
    """Weights of nodes on a grid of x and y, row by row, for pixels at columns and rows."""
    across, down = (csr_array(interpolation_matrix(nodes, np.clip(at, nodes[0], nodes[-1])))
                    for nodes, at in ((x_px, columns_px), (y_px, rows_px)))
    return lambda first, last: kron(down[first:last], across, format="csr")
