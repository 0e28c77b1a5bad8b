"""Colours of a session's materials for programs that know no spectra: X, Y, Z and ACEScg, with
their spread.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.appearance import BRADFORD, tristimulus_weights
from spectrabox.radiometry.system.words import cell
from spectrabox.session.store.results import MaterialResult

DAYLIGHT = "D65"
# X, Y, Z to ACEScg (AP1), S-2014-004, and its white, about D60, from x, y = 0.32168, 0.33767
TO_ACESCG = np.array([[1.6410233797, -0.3248032942, -0.2364246952],
                      [-0.6636628587, 1.6153315917, 0.0167563477],
                      [0.0117218943, -0.0082844420, 0.9883948585]])
ACES_WHITE = np.array([0.32168 / 0.33767, 1.0, (1 - 0.32168 - 0.33767) / 0.33767])
COLUMNS = ("X", "Y", "Z", "ACEScg R", "ACEScg G", "ACEScg B")


def colour_weights(nm: np.ndarray) -> np.ndarray:
    """Weights (6, P) that give X, Y, Z under D65 (white's Y is 1) and ACEScg of a reflectance.

    ACEScg is of what looks alike under its own white, by the Bradford transform: 1, 1, 1 is white.

    Parameters
    ----------
    nm : (P,) array
        Ascending.
    """
    to_xyz = tristimulus_weights(nm, DAYLIGHT)
    cones, wanted = BRADFORD @ to_xyz.sum(axis=1), BRADFORD @ ACES_WHITE
    adapted = np.linalg.solve(BRADFORD, (wanted / cones)[:, None] * (BRADFORD @ to_xyz))
    return np.vstack([to_xyz, TO_ACESCG @ adapted])


def colours_text(materials: list[MaterialResult], grid_nm: np.ndarray) -> str:
    """A CSV with a row for each material: its colours, and their standard deviations over the
    draws; 0 where the spectrum was given.

    Parameters
    ----------
    materials : list of MaterialResult
    grid_nm : (P,) array
        Of the spectra that were given.
    """
    header = ["material", *COLUMNS, *(f"standard deviation {name}" for name in COLUMNS)]
    rows = [",".join(header)]
    for material in materials:
        mean, deviation = _colours(material, grid_nm)
        rows.append(",".join(['"' + cell(material.name).replace('"', '""') + '"',
                              *(f"{value:.6f}" for value in (*mean, *deviation))]))
    return "\n".join(rows) + "\n"


def _colours(material: MaterialResult,
             grid_nm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Colours (6,) and their standard deviations."""
    if material.samples is None:
        assert material.spectrum is not None
        return colour_weights(grid_nm) @ material.spectrum, np.zeros(len(COLUMNS))
    drawn = material.samples.spectra @ colour_weights(material.samples.grid.nm).T
    return drawn.mean(axis=0), drawn.std(axis=0, ddof=1)
