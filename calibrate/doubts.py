"""What makes a calibration doubtful although some camera explains its chart photos.

Unlike cameras: the prior's last component, of a camera unlike those measured, explains the photos
best.

Wrong light: the mixture of ``products`` is asked twice, with the stated spectrum alone under every
camera, and with all known lamps. A right spectrum explains the photo better than the average lamp
does; a wrong one has to be explained by a camera that no maker built.

Colour matrix: an alarm for a mistaken light. Makers and converters state a matrix from X, Y, Z to
the camera's R, G and B in daylight. The curves predict it as the least-squares map over the patches
of a ColorChecker under D65. Stated and predicted matrix are compared along the principal axes of
the patches' X, Y, Z, each band by its own brightness, so that the first column is the camera's
white balance.

Matrices are rough: those of 37 measured cameras depart from what the measured curves predict by
``TYPICAL`` in the mean and ``SPREAD`` about it (``benchmarks/bench_colour_matrix.py``), as much as
cameras differ. As evidence besides a chart photo a matrix therefore changes nothing. But it knows
the camera without the light that the photo was taken by: curves that were fitted under the spectrum
of another lamp contradict it by far.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from spectrabox.calibrate.chart_equations import ChartEquations
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.prior.learnt_prior import UNLIKE
from spectrabox.calibrate.prior.plain_priors import SMOOTH_SOURCE
from spectrabox.calibrate.products.lamps import Lamps, all_lamps
from spectrabox.calibrate.products.product_posterior import evidence_of_products
from spectrabox.calibrate.products.product_prior import product_prior
from spectrabox.calibrate.sensitivity import PriorFit
from spectrabox.radiometry.appearance import tristimulus
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.records.calibration import CalibrationDoubt
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.radiometry.spectra.named_spectra import light

SURELY = 0.9                 # probability of an unlike camera above which something may be wrong
SEED = 1                     # of the draws of cameras
# nats for another lamp, of photos of lamps of the prior by cameras of makers outside it: exceeded
# by right spectra in 2 % of cases (benchmarks/bench_unknown_light.py --shipped --naming)
CONTRADICTS = 7.0
UNKNOWN_KIND = 0             # of the stated lamp: no kind is asked for
# Rows R, G, B; shares of each band's brightness.
TYPICAL = np.array([[0.030, 0.033, 0.041], [0.010, 0.016, -0.003], [-0.037, 0.003, 0.016]])
SPREAD = np.array([[0.059, 0.031, 0.044], [0.019, 0.013, 0.016], [0.038, 0.027, 0.009]])
FREEDOM = 8                  # nine entries less a common scale
DOUBTFUL = 4.5               # mean square in spreads; 1 in 20 cameras with the right light


def unlike_cameras(fit: PriorFit) -> bool:
    """Whether the photos are explained by a camera unlike those measured alone.

    Parameters
    ----------
    fit : PriorFit
    """
    return dict(fit.families).get(UNLIKE, 0.0) > SURELY and len(fit.families) > 1


def light_doubts(sources: Sequence[str], photos: Sequence[ChartEquations], cameras: CameraPrior,
                 grid: WavelengthGrid) -> tuple[tuple[CalibrationDoubt, ...], tuple[str, ...]]:
    """Whether chart photos contradict their stated lights, and a sentence for each that does.

    Parameters
    ----------
    sources : sequence of str
        Of the stated light of each photo.
    photos : sequence of ChartEquations
    cameras : CameraPrior
        Where no camera is known, smoothness alone, no lamp can be told from another.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    if cameras.source == SMOOTH_SOURCE:
        return (), ()
    sentences = []
    for source, photo in zip(sources, photos, strict=True):
        evidence = evidence_for_another_light([photo], cameras, photo.power / grid.weights_nm, grid)
        if evidence > CONTRADICTS:
            sentences.append(f"{CalibrationDoubt.WRONG_LIGHT.value} ({source}: other lamps "
                             f"explain the chart better, by {evidence:.0f} nats)")
    return (CalibrationDoubt.WRONG_LIGHT,) if sentences else (), tuple(sentences)


def evidence_for_another_light(photos: list[ChartEquations], cameras: CameraPrior,
                               stated: np.ndarray, grid: WavelengthGrid) -> float:
    """Log Bayes factor: known lamps against the stated light.

    Parameters
    ----------
    photos : list of ChartEquations
        Of one camera under one light.
    cameras : CameraPrior
    stated : (P,) array
        The stated spectrum, any unit.
    grid : WavelengthGrid
        Working grid, of P wavelengths, every nm from 400 to 700 nm.
    """
    unlit = [replace(photo, power=grid.weights_nm) for photo in photos]
    alone = Lamps((stated / stated.mean())[None], np.array([UNKNOWN_KIND]), np.ones(1), ("stated",))
    with threadpool_limits(1, "blas"):      # see fit_with_prior
        any_lamp, this_lamp = (evidence_of_products(unlit, product_prior(cameras, lamps, SEED))
                               for lamps in (all_lamps(), alone))
    return any_lamp - this_lamp


def matrix_deviation(camera_from_xyz: np.ndarray, curves: np.ndarray,
                     grid: WavelengthGrid) -> np.ndarray:
    """Stated less predicted matrix (3, 3), as shares of each band's brightness.

    Parameters
    ----------
    camera_from_xyz : (3, 3) array
        From X, Y, Z to R, G, B, of any scale.
    curves : (3, P) array
        Sensitivities R, G, B on ``grid``, of any scale.
    grid : WavelengthGrid
    """
    surfaces = chart_reflectances("BabelColor Average", grid)
    xyz = np.array([tristimulus(grid.nm, surface) for surface in surfaces])
    signals = surfaces @ (curves * light("D65", grid) * grid.weights_nm).T
    predicted = np.linalg.lstsq(xyz, signals, rcond=None)[0].T
    _, sizes, axes = np.linalg.svd(xyz, full_matrices=False)
    scaled_axes = (axes * np.sign(axes[:, :1])).T * sizes / np.sqrt(len(xyz))
    stated, ours = camera_from_xyz @ scaled_axes, predicted @ scaled_axes
    scale = np.sum(stated * ours) / np.sum(ours**2)
    return (stated / scale - ours) / ours[:, :1]


def matrix_doubt(camera_from_xyz: np.ndarray, curves: np.ndarray, grid: WavelengthGrid) -> float:
    """Mean square of the deviation, in spreads about what is typical: of most cameras about 1.

    Parameters
    ----------
    camera_from_xyz : (3, 3) array
    curves : (3, P) array
    grid : WavelengthGrid
        As in ``matrix_deviation``.
    """
    deviation = matrix_deviation(camera_from_xyz, curves, grid)
    return float(np.sum(((deviation - TYPICAL) / SPREAD) ** 2) / FREEDOM)


def matrix_contradicts(camera_from_xyz: np.ndarray | None, curves: np.ndarray,
                       grid: WavelengthGrid) -> bool:
    """Whether a file's colour matrix speaks against the curves; not where there is none.

    Parameters
    ----------
    camera_from_xyz : (3, 3) array or None
        Of a raw file; None where it states none.
    curves : (K, P) array
    grid : WavelengthGrid
    """
    if camera_from_xyz is None or len(curves) != len(camera_from_xyz):
        return False
    return matrix_doubt(camera_from_xyz, curves, grid) >= DOUBTFUL
