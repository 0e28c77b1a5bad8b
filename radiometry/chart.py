"""The 24 patches of a ColorChecker Classic: names, positions and reflectances with their source."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.published.tables import CHARTS, published_curves
from spectrabox.radiometry.records import WavelengthGrid
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_reflectances

PATCH_NAMES = (
    "dark skin", "light skin", "blue sky", "foliage", "blue flower", "bluish green",
    "orange", "purplish blue", "moderate red", "purple", "yellow green", "orange yellow",
    "blue", "green", "red", "yellow", "magenta", "cyan",
    "white 9.5", "neutral 8", "neutral 6.5", "neutral 5", "neutral 3.5", "black 2",
)
ROWS, COLUMNS = 4, 6

# The printed card: its size, the side of a patch and the distance from patch to patch; the border
# is what remains.
CARD_CM, PATCH_CM, PITCH_CM = (29.0, 20.3), 4.0, 4.35

# Chart names of colour-science that cover 400-700 nm, by what an operator may write.
REFERENCES = ("BabelColor Average", "ISO 17321-1", "ColorChecker N Ohta")

# Peak and standard deviation (nm) of the bands of an ordinary colour camera, to know a chart when
# one is seen.
TYPICAL_BANDS_NM = ((600.0, 38.0), (535.0, 40.0), (460.0, 30.0))


def chart_reflectances(reference: str, grid: WavelengthGrid) -> np.ndarray:
    """Reflectances (24, P) of a named published chart, dark skin first.

    ``BabelColor Average`` is the average of 30 charts that the paper uses [Pascale 2023], shipped
    by colour-science.

    Parameters
    ----------
    reference : str
        One of ``REFERENCES``.
    grid : WavelengthGrid
        Working grid, of P wavelengths.

    Raises
    ------
    InputError
        If the reference is not known.
    """
    if reference not in REFERENCES:
        raise InputError(f"chart reference {reference!r} is not known; known are "
                         f"{', '.join(REFERENCES)}, or a CSV file with one column per patch")
    nm, patches = published_curves(CHARTS, reference)
    return on_grid(nm, patches, grid, reference)


def measured_chart(path: Path, grid: WavelengthGrid) -> np.ndarray:
    """Reflectances (24, P) of one's own chart, from a file of one column per patch, dark skin
    first.

    Parameters
    ----------
    path : Path
        Any spectral file.
    grid : WavelengthGrid
        Working grid, of P wavelengths.

    Raises
    ------
    InputError
        If the file does not hold 24 columns of reflectances that cover the grid.
    """
    patches = read_reflectances(path, grid)
    if len(patches) != len(PATCH_NAMES):
        raise InputError(f"{path.name} holds {len(patches)} columns; 24 are needed, one per patch, "
                         "dark skin first")
    return np.array(list(patches.values()))


def patch_centres_uv() -> np.ndarray:
    """Centres (24, 2) of the patches as fractions of the card, from the dark-skin corner."""
    row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    from_centre_cm = PITCH_CM * np.column_stack([column - (COLUMNS - 1) / 2, row - (ROWS - 1) / 2])
    return 0.5 + from_centre_cm / np.array(CARD_CM)


def patch_size_uv() -> tuple[float, float]:
    """Width and height of a patch in the same fractions."""
    return PATCH_CM / CARD_CM[0], PATCH_CM / CARD_CM[1]


def plane_centres() -> np.ndarray:
    """Centres (24, 2) of the patches in widths of the card, from its dark-skin corner."""
    return patch_centres_uv() * np.array([1.0, CARD_CM[1] / CARD_CM[0]])


def plane_from_picture(centres_px: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) from pixels to the plane of the chart, in widths of the card.

    Parameters
    ----------
    centres_px : (24, 2) array
        Of the patches in a photo, in chart order.
    """
    (x, y), (u, v) = centres_px.T, plane_centres().T
    unit = np.abs(centres_px).max()         # pixels in the thousands would spoil the last digits
    x, y = x / unit, y / unit
    zero, one = np.zeros(x.size), np.ones(x.size)
    equations = np.vstack([np.column_stack([x, y, one, zero, zero, zero, -u * x, -u * y]),
                           np.column_stack([zero, zero, zero, x, y, one, -v * x, -v * y])])
    solution = np.linalg.lstsq(equations, np.r_[u, v], rcond=None)[0]
    return np.append(solution, 1.0).reshape(3, 3) @ np.diag([1 / unit, 1 / unit, 1.0])


def projected(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (N, 2) through a matrix (3, 3) of the plane.

    Parameters
    ----------
    matrix : (3, 3) array
    points : (N, 2) array
    """
    mapped = points @ matrix[:, :2].T + matrix[:, 2]
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def typical_camera_signals(reflectances: np.ndarray, grid: WavelengthGrid,
                           light: np.ndarray | None = None) -> np.ndarray:
    """Signals (24, 3) that an ordinary camera would read, a perfect reflector about 1 in each band.

    Only to recognise a chart and its orientation; nothing is measured with it.

    Parameters
    ----------
    reflectances : (24, P) array
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    light : (P,) array or None
        Its spectrum, any unit; None for equal energy.
    """
    power = grid.weights_nm if light is None else light * grid.weights_nm
    bands = np.array([np.exp(-0.5 * ((grid.nm - peak) / width) ** 2) * power
                      for peak, width in TYPICAL_BANDS_NM])
    return reflectances @ (bands / bands.sum(axis=1, keepdims=True)).T
