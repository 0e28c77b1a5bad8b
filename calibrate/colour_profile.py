"""A camera's signals under one light to colours under D50: a matrix, and root polynomials.

A root polynomial (Finlayson, Mackiewicz, Hurlbert 2015) adds to R, G and B the roots of their
products, such as the root of RG, so that twice the light still gives twice the colour. Both are
fitted to known surfaces as the camera would see them, by least squares of CIELAB differences to
first order, chroma weighted as CIEDE2000 weights it. White goes to white exactly.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Annotated

import numpy as np

from spectrabox.radiometry import appearance, errors, shaped
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.radiometry.spectra.named_spectra import light

MATRIX, ROOTS = 1, 2        # degrees
STEP = 1e-5                 # of white: for derivatives of L*, a*, b*
DARKEST = 0.01              # of white: darker colours weigh as if they were that light


@dataclass(frozen=True, eq=False)
class ColourTransform(shaped.Record):
    """From camera signals relative to white to X, Y, Z under D50, white (1, 1, 1) to D50."""

    exponents: Annotated[np.ndarray, "E 3"]     # of R, G and B in each term; rows sum to 1
    coefficients: Annotated[np.ndarray, "3 E"]

    def xyz(self, signals: np.ndarray) -> np.ndarray:
        """X, Y, Z (..., 3) under D50, Y = 1 for white, of signals (..., 3) relative to white.

        Parameters
        ----------
        signals : (..., 3) array
            Below 0 they are taken for 0 where a root is drawn.
        """
        return np.asarray(_terms(signals, self.exponents) @ self.coefficients.T)

    def lab(self, signals: np.ndarray) -> np.ndarray:
        """L*, a*, b* (..., 3) under D50, as ``xyz``."""
        return appearance.lab_from_xyz(self.xyz(signals), D50)


def d50_weights(grid: WavelengthGrid) -> np.ndarray:
    """Weights (3, P) that give X, Y, Z under D50 of reflectances; of white that of ICC profiles.

    Parameters
    ----------
    grid : WavelengthGrid
    """
    weights = appearance.tristimulus_weights(grid.nm, "D50")
    return np.asarray(weights * (D50 / weights.sum(axis=1))[:, None])


def fit_transform(response: np.ndarray, reflectances: np.ndarray, grid: WavelengthGrid,
                  degree: int = ROOTS) -> ColourTransform:
    """The transform that gives known surfaces the colours that they have under D50.

    Parameters
    ----------
    response : (3, P) or (T, 3, P) array
        Of the camera's bands to reflectances under the light, rows summing to 1; of T cameras that
        it may be, all alike probable.
    reflectances : (n, P) array
    grid : WavelengthGrid
    degree : int
        1 for a matrix; 2 and 3 with roots of products of as many signals.

    Raises
    ------
    CalibrationError
        If the surfaces or the bands are too alike to fit it.
    """
    signals = np.einsum("tkp,np->tnk", response.reshape(-1, *response.shape[-2:]),
                        reflectances).reshape(-1, 3)
    xyz = np.tile(reflectances @ d50_weights(grid).T, (len(signals) // len(reflectances), 1))
    return transform_of_signals(signals, xyz, degree)


def transform_of_signals(signals: np.ndarray, xyz: np.ndarray, degree: int) -> ColourTransform:
    """The transform that gives signals the colours that their surfaces have under D50.

    Parameters
    ----------
    signals : (n, 3) array
        Relative to white.
    xyz : (n, 3) array
        Under D50, Y = 1 for white.
    degree : int
        As of ``fit_transform``.

    Raises
    ------
    CalibrationError
        As ``fit_transform``.
    """
    exponents = _exponents(degree)
    weights = _weights(xyz)                                 # (n, 3, 3)
    terms = _terms(signals, exponents)
    # coefficients = start + free @ basis, whose rows sum to 0: white stays D50
    basis = np.linalg.qr(np.column_stack([np.ones(len(exponents)),
                                          np.eye(len(exponents))[:, 1:]]))[0].T[1:]
    start = np.zeros((3, len(exponents)))
    start[np.arange(3), np.arange(3)] = D50
    rows = np.einsum("nij,ne->nije", weights, terms @ basis.T).reshape(len(xyz) * 3, -1)
    target = np.einsum("nij,nj->ni", weights, xyz - terms @ start.T).ravel()
    free, _, rank, _ = np.linalg.lstsq(rows, target, rcond=None)
    if rank < free.size:
        raise errors.CalibrationError("the camera's bands are too alike for a colour profile: only "
                                      f"{rank} of {free.size} coefficients are determined")
    return ColourTransform(exponents, start + free.reshape(3, -1) @ basis)


def stated_transform(camera_from_xyz: np.ndarray) -> ColourTransform:
    """The camera's own matrix as raw developers use it: from white-balanced signals to D50.

    Its rows are scaled so that the white of daylight (D65) gives 1, 1, 1, as dcraw and LibRaw do;
    colours under D65 are adapted to D50 by Bradford.

    Parameters
    ----------
    camera_from_xyz : (3, 3) array
        From X, Y, Z to R, G, B in daylight, of any scale.
    """
    white = np.linalg.solve(appearance.TO_SRGB, np.ones(3))
    to_xyz = np.linalg.inv(camera_from_xyz / (camera_from_xyz @ white)[:, None])
    return ColourTransform(np.eye(3), appearance.adaptation(white, D50) @ to_xyz)


def colour_errors(transform: ColourTransform, response: np.ndarray, reflectances: np.ndarray,
                  grid: WavelengthGrid) -> np.ndarray:
    """CIEDE2000 (n,) under D50 of surfaces as a camera sees them without noise.

    Parameters
    ----------
    transform : ColourTransform
    response : (3, P) array
        Of the camera, as of ``fit_transform``.
    reflectances : (n, P) array
    grid : WavelengthGrid
    """
    true = appearance.lab_from_xyz(reflectances @ d50_weights(grid).T, D50)
    return appearance.ciede2000(transform.lab(reflectances @ response.T), true)


def _exponents(degree: int) -> np.ndarray:
    """Exponents (E, 3) of the distinct terms, R, G and B first."""
    powers = {tuple(np.bincount(product, minlength=3) / size)
              for size in range(2, degree + 1)
              for product in combinations_with_replacement(range(3), size)}
    singles = [tuple(row) for row in np.eye(3)]
    return np.array(singles + sorted(powers - set(singles)))


def _terms(signals: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """Products (..., E) of powers of the signals; of R, G and B themselves with their sign."""
    signals = np.asarray(signals)
    roots = np.maximum(signals, 0)[..., None, :] ** exponents[3:]
    return np.concatenate([signals, roots.prod(axis=-1)], axis=-1)


def _weights(xyz: np.ndarray) -> np.ndarray:
    """Derivatives (n, 3, 3) of L*, a*, b* by X, Y, Z, chroma and lightness as CIEDE2000 weighs."""
    lighter = np.maximum(xyz, DARKEST * D50)
    lab = appearance.lab_from_xyz(lighter, D50)
    derivative = np.stack([(appearance.lab_from_xyz(lighter + STEP * one, D50) - lab) / STEP
                           for one in np.eye(3)], axis=2)
    lightness = 1 + 0.015 * (lab[:, 0] - 50)**2 / np.sqrt(20 + (lab[:, 0] - 50)**2)
    chroma = 1 + 0.045 * np.hypot(lab[:, 1], lab[:, 2])
    return np.asarray(derivative / np.column_stack([lightness, chroma, chroma])[:, :, None])


# ---- matrices of a DNG profile -------------------------------------------------------------------
# Colour matrices of a camera from its curves: those of a DNG profile, and how well they do.
#
# After the DNG specification 1.6, chapter 6. A colour matrix maps X, Y, Z under an illuminant to
# the camera's signals; a forward matrix maps signals divided by those of white to X, Y, Z under
# D50, and white exactly to white. Both are fitted by least squares to the patches of a chart.

ILLUMINANTS = {"A": 17, "D65": 21}          # and their numbers in EXIF
D50 = np.array([0.9642, 1.0, 0.8249])       # white of the profile connection space (ICC)


def matrices(cameras: Sequence[np.ndarray], name: str, grid: WavelengthGrid, fitted: np.ndarray,
             judged: tuple[np.ndarray, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colour and forward matrices (T, 3, 3) of some curves under an illuminant, and the mean
    CIEDE2000 (T, J) of the forward matrix by set.

    A colour matrix goes from X, Y, Z to the camera, white's largest signal being 1; a forward
    matrix from the white-balanced camera to X, Y, Z under D50.

    Parameters
    ----------
    cameras : sequence of T (3, P) arrays
        Curves, each of any scale.
    name : str
        CIE name of the illuminant.
    grid : WavelengthGrid
    fitted : (I, P) array
        Reflectances of the chart that matrices are fitted to.
    judged : tuple of J (n, P) arrays
        Sets of reflectances that they are judged by.
    """
    to_xyz = appearance.tristimulus_weights(grid.nm, name)
    to_d65 = appearance.adapted_tristimulus(grid.nm, name)
    # D50 by the same adaptation: linear, so that white stays white
    to_d50 = appearance.adaptation(to_d65.sum(axis=1), D50) @ to_d65
    labs = [appearance.lab_from_xyz(each @ to_d50.T, D50) for each in judged]
    power = light(name, grid) * grid.weights_nm
    colours, forwards, differences = [], [], []
    for curves in cameras:
        response = curves * power
        signals, white = fitted @ response.T, response.sum(axis=1)
        colour = np.linalg.lstsq(fitted @ to_xyz.T, signals, rcond=None)[0].T
        colour = colour / (colour @ to_xyz.sum(axis=1)).max()
        forward = _white_keeping(signals / white, fitted @ to_d50.T)
        colours.append(colour)
        forwards.append(forward)
        differences.append([np.mean(appearance.ciede2000(appearance.lab_from_xyz(
            (each @ response.T / white) @ forward.T, D50), lab))
            for each, lab in zip(judged, labs, strict=True)])
    return np.array(colours), np.array(forwards), np.array(differences)


def _white_keeping(signals: np.ndarray, xyz: np.ndarray) -> np.ndarray:
    """The least-squares matrix (3, 3) of those that map signals 1, 1, 1 to D50."""
    free = np.linalg.qr(np.column_stack([np.ones(3), np.eye(3)[:, :2]]))[0][:, 1:]
    start = np.repeat(D50[:, None] / 3, 3, axis=1)
    more = np.linalg.lstsq(signals @ free, xyz - signals @ start.T, rcond=None)[0]
    return np.asarray(start + (free @ more).T)
