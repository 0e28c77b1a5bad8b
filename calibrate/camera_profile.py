"""Colour matrices of a camera from its curves: those of a DNG profile, and how well they do.

After the DNG specification 1.6, chapter 6. A colour matrix maps X, Y, Z under an illuminant to the
camera's signals; a forward matrix maps signals divided by those of white to X, Y, Z under D50, and
white exactly to white. Both are fitted by least squares to the patches of a chart.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.radiometry.appearance import (
    BRADFORD,
    adapted_tristimulus,
    ciede2000,
    lab_from_xyz,
    tristimulus_weights,
)
from spectrabox.radiometry.records import WavelengthGrid
from spectrabox.radiometry.shaped import Record
from spectrabox.radiometry.spectra.named_spectra import light

ILLUMINANTS = {"A": 17, "D65": 21}          # and their numbers in EXIF
D50 = np.array([0.9642, 1.0, 0.8249])       # white of the profile connection space (ICC)


@dataclass(frozen=True, eq=False)
class IlluminantMatrices(Record):
    """Matrices under one illuminant, and the mean CIEDE2000 of the forward matrix by set."""

    colour: Annotated[np.ndarray, "3 3"]    # X, Y, Z to camera; white's largest signal is 1
    forward: Annotated[np.ndarray, "3 3"]   # white-balanced camera to X, Y, Z under D50
    delta_e00: tuple[float, ...]


@dataclass(frozen=True)
class Target:
    """What matrices under an illuminant are fitted to and judged by."""

    power: np.ndarray                       # (P,) of the illuminant times the width of its samples
    fitted: np.ndarray                      # (I, P) reflectances
    fitted_xyz: np.ndarray                  # (I, 3) under the illuminant
    fitted_d50: np.ndarray                  # (I, 3) adapted to D50
    white_xyz: np.ndarray                   # (3,) of the illuminant
    judged: tuple[np.ndarray, ...]          # (n, P) reflectances, of each set
    judged_lab: tuple[np.ndarray, ...]      # (n, 3) of the same


def target(name: str, grid: WavelengthGrid, fitted: np.ndarray,
           judged: tuple[np.ndarray, ...]) -> Target:
    """The target of an illuminant.

    Parameters
    ----------
    name : str
        CIE name.
    grid : WavelengthGrid
    fitted : (I, P) array
        Reflectances of the chart.
    judged : tuple of (n, P) arrays
    """
    to_xyz = tristimulus_weights(grid.nm, name)
    to_d65 = adapted_tristimulus(grid.nm, name)
    # D50 by the same adaptation: linear, so that white stays white
    gains = BRADFORD @ D50 / (BRADFORD @ to_d65.sum(axis=1))
    to_d50 = np.linalg.solve(BRADFORD, gains[:, None] * BRADFORD) @ to_d65
    labs = tuple(lab_from_xyz(each @ to_d50.T, D50) for each in judged)
    return Target(light(name, grid) * grid.weights_nm, fitted, fitted @ to_xyz.T,
                  fitted @ to_d50.T, to_xyz.sum(axis=1), judged, labs)


def matrices(curves: np.ndarray, aim: Target) -> IlluminantMatrices:
    """Colour and forward matrix of curves (3, P), of any scale.

    Parameters
    ----------
    curves : (3, P) array
    aim : Target
    """
    response = curves * aim.power
    signals, white = aim.fitted @ response.T, response.sum(axis=1)
    colour = np.linalg.lstsq(aim.fitted_xyz, signals, rcond=None)[0].T
    colour = colour / (colour @ aim.white_xyz).max()
    forward = _white_keeping(signals / white, aim.fitted_d50)
    errors = tuple(float(np.mean(ciede2000(lab_from_xyz(
        (each @ response.T / white) @ forward.T, D50), lab)))
        for each, lab in zip(aim.judged, aim.judged_lab, strict=True))
    return IlluminantMatrices(colour, forward, errors)


def _white_keeping(signals: np.ndarray, xyz: np.ndarray) -> np.ndarray:
    """The least-squares matrix (3, 3) of those that map signals 1, 1, 1 to D50."""
    free = np.linalg.qr(np.column_stack([np.ones(3), np.eye(3)[:, :2]]))[0][:, 1:]
    start = np.repeat(D50[:, None] / 3, 3, axis=1)
    more = np.linalg.lstsq(signals @ free, xyz - signals @ start.T, rcond=None)[0]
    return np.asarray(start + (free @ more).T)
