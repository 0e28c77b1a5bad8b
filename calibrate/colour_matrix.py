"""The colour matrix of a raw file, held against fitted curves: an alarm for a mistaken light.

Makers and converters state a matrix from X, Y, Z to the camera's R, G and B in daylight. The curves
predict it as the least-squares map over the patches of a ColorChecker under D65. Stated and
predicted matrix are compared along the principal axes of the patches' X, Y, Z, each band by its own
brightness, so that the first column is the camera's white balance.

Matrices are rough: those of 37 measured cameras depart from what the measured curves predict by
``TYPICAL`` in the mean and ``SPREAD`` about it (``benchmarks/bench_colour_matrix.py``), as much as
cameras differ. As evidence besides a chart photo a matrix therefore changes nothing. But it knows
the camera without the light that the photo was taken by: curves that were fitted under the spectrum
of another lamp contradict it by far.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.appearance import tristimulus
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.records import WavelengthGrid
from spectrabox.radiometry.spectra.named_spectra import light

# Rows R, G, B; shares of each band's brightness.
TYPICAL = np.array([[0.030, 0.033, 0.041], [0.010, 0.016, -0.003], [-0.037, 0.003, 0.016]])
SPREAD = np.array([[0.059, 0.031, 0.044], [0.019, 0.013, 0.016], [0.038, 0.027, 0.009]])
FREEDOM = 8                  # nine entries less a common scale
DOUBTFUL = 4.5               # mean square in spreads; 1 in 20 cameras with the right light


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
    """Mean square of the deviation, in spreads about what is typical: of most cameras about 1."""
    deviation = matrix_deviation(camera_from_xyz, curves, grid)
    return float(np.sum(((deviation - TYPICAL) / SPREAD) ** 2) / FREEDOM)


def matrix_contradicts(camera_from_xyz: np.ndarray | None, curves: np.ndarray,
                       grid: WavelengthGrid) -> bool:
    """Whether a file's colour matrix speaks against the curves; not where there is none."""
    if camera_from_xyz is None or len(curves) != len(camera_from_xyz):
        return False
    return matrix_doubt(camera_from_xyz, curves, grid) >= DOUBTFUL
