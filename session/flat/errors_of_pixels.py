"""White at every pixel of a photo of flat samples, and what its pixels' errors depend on.

Both change slowly over the photo: they are known at the nodes of a coarse grid.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.sparse import csr_array, kron

from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.light_drift import drift_covariance
from spectrabox.radiometry.records import Calibration
from spectrabox.sampling.prior.mixture import GRID as PRIOR_GRID
from spectrabox.sampling.prior.mixture import LogitMixture
from spectrabox.session.config.session_schema import ViewInputs
from spectrabox.session.flat.signals_stage import (
    drift_of,
    model_error,
    response_of,
    white_of_photo,
)
from spectrabox.session.picture.illumination import even_light
from spectrabox.session.picture.pixel_errors import PixelErrors, White
from spectrabox.session.stages.inputs import GRID
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import photo_of

COLUMNS = 24                # of the nodes


def errors_of_pixels(task: StageTask, view: ViewInputs, calibration: Calibration,
                     within_px: Sequence[float], pixels_px: tuple[np.ndarray, np.ndarray],
                     prior: LogitMixture) -> PixelErrors:
    """White and errors over a rectangle of a photo.

    Parameters
    ----------
    view : ViewInputs
        The photo; it shows a region.
    calibration : Calibration
        Of its camera and light.
    within_px : (x0, y0, x1, y1)
        Pixels of the photo.
    pixels_px : (W,) and (H,) arrays
        Columns and rows of the picture's pixels, likewise.
    prior : LogitMixture
    """
    x0, y0, x1, y1 = within_px
    rows = max(round(COLUMNS * (y1 - y0) / (x1 - x0)), 2)
    x_px, y_px = np.linspace(x0, x1, COLUMNS), np.linspace(y0, y1, rows)
    nodes = np.stack(np.meshgrid(x_px, y_px), axis=-1).reshape(-1, 2)
    response, drift = response_of(calibration), drift_of(task)
    found = white_of_photo(task, view, response, drift, nodes)
    assert found is not None
    bands, count = found.glare.size, len(nodes)
    total, regions = found.covariance, len(found.samples.names) - count
    level, glare = slice(0, bands), slice(bands, 2 * bands)
    causes = np.arange(2 * bands + regions + count, len(total))
    log, between = np.empty((count, bands, bands)), np.empty((count, bands, bands))
    for node in range(count):
        # what all bands share there: the field, and the errors of the exposure
        common = np.r_[2 * bands + regions + node, causes]
        with_level = total[level, common].sum(axis=1)
        log[node] = total[level, level] + with_level[:, None] + with_level \
            + total[np.ix_(common, common)].sum()
        between[node] = total[level, glare] + total[common, glare].sum(axis=0)
    # a signal falls as white rises, and as glare does
    white = White(found.white[regions:], log, between)
    shared = np.zeros((bands, bands)) if drift is None or view.name else drift_covariance(drift)
    veil = task.config.stray_light.glare * photo_of(task.stored, view).signal.mean(axis=(0, 1))
    on_prior = response @ interpolation_matrix(PRIOR_GRID.nm, GRID.nm)
    return PixelErrors(
        _between(x_px, y_px, *pixels_px), white, even_light(on_prior, count),
        found.glare + found.mean[glare], total[glare, glare], veil, shared,
        model_error(task).among_bands(bands), (calibration,), response[None], prior)


def _between(x_px: np.ndarray, y_px: np.ndarray, columns_px: np.ndarray,
             rows_px: np.ndarray) -> Callable[[int, int], csr_array]:
    """Weights of nodes at every place of x and y, row by row, for pixels at columns and rows."""
    across, down = (csr_array(interpolation_matrix(nodes, np.clip(at, nodes[0], nodes[-1])))
                    for nodes, at in ((x_px, columns_px), (y_px, rows_px)))
    return lambda first, last: kron(down[first:last], across, format="csr")

