"""Camera signals of surfaces: of one by itself, and of many that light each other.

Camera signal from reflectance, light and sensitivity (Eqs. 1, 4 and 8).

The paper's Eqs. 4 and 8 carry the reflectance inside M; read as printed, the signal would be
quadratic in it. Here M_ij = sensitivity_i(nm_j) light(nm_j) weight_j, and signal = M @ reflectance.

Evaluate a traced light transport for any reflectances, with its derivative (NumPy alone).

Where the spectrum of every material only multiplies, the light along a path is (spectrum of the
light) x (product of the reflectances encountered) x (geometry). The geometry has no wavelength, so
a signal is a polynomial in the reflectances:

    signal_rk = sum over e of coefficients_re * integral of sensitivity_k light prod_m
    reflectance_m^exponents_em dnm

with e over the products (how often the path encounters each material). Symbols: E products, M
materials, P wavelengths, K bands.
"""


from __future__ import annotations

import functools
import math

import numpy as np

from spectrabox.radiometry.records.calibration import Calibration
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid


def response_matrix(grid: WavelengthGrid, sensitivities: np.ndarray,
                    light: np.ndarray) -> np.ndarray:
    """M (K, P) of Eq. 8.

    Parameters
    ----------
    grid : WavelengthGrid
    sensitivities : (K, P) array
    light : (P,) array
        Its spectrum, any unit.
    """
    return sensitivities * light * grid.weights_nm


def white_signal(response: np.ndarray) -> np.ndarray:
    """White signal (K,) of each band: that of a reflectance of 1 at every wavelength.

    Parameters
    ----------
    response : (K, P) array
        As ``response_matrix`` gives it.
    """
    return response.sum(axis=1)


def relative_response(calibration: Calibration, grid: WavelengthGrid) -> np.ndarray:
    """Response (K, P) of a calibrated camera's bands to reflectances under its light; rows sum
    to 1.

    Parameters
    ----------
    calibration : Calibration
    grid : WavelengthGrid
        Of its curves.
    """
    matrix = response_matrix(grid, calibration.sensitivity.curves,
                             spectrum_on_grid(calibration.light, grid))
    return np.asarray(matrix / white_signal(matrix)[:, None])


def relative_operator(response: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """A (K, N) of Eq. 4 over the white signal of each band: coefficients of 1 give a signal of 1.

    Parameters
    ----------
    response : (K, P) array
        As ``response_matrix`` gives it.
    basis : (P, N) array
    """
    return response @ basis / white_signal(response)[:, None]


# ---- interreflection -----------------------------------------------------------------------------

def product_count(materials: int, bounces: int) -> int:
    """Number E of products of reflectances, counting that of no reflection.

    Parameters
    ----------
    materials : int
    bounces : int
        Reflections at most.
    """
    return math.comb(materials + bounces, materials)


def exponents_up_to(materials: int, bounces: int) -> np.ndarray:
    """Exponents (E, M) of every product of reflectances, fewest reflections first.

    The first row is no reflection (the light seen directly). Within one degree the order is
    lexicographic.

    Parameters
    ----------
    materials : int
        M.
    bounces : int
        Reflections at most.
    """
    rows: list[tuple[int, ...]] = [(0,) * materials]
    shell = rows
    for _ in range(bounces):
        shell = sorted({(*row[:m], row[m] + 1, *row[m + 1:]) for row in shell
                        for m in range(materials)}, reverse=True)
        rows = rows + shell
    return np.array(rows, dtype=np.int64)


def product_after(exponents: np.ndarray) -> np.ndarray:
    """Index (E + 1, M) of the product after one more reflection.

    E, which leads to itself, where that product is not kept.

    Parameters
    ----------
    exponents : (E, M) int array
        With every product's lower products among them, as ``exponents_up_to`` and ``pruned`` give.
    """
    count, materials = exponents.shape
    index = {tuple(row): number for number, row in enumerate(exponents.tolist())}
    table = np.full((count + 1, materials), count, dtype=np.uint32)
    for row, number in index.items():
        for m in range(materials):
            table[number, m] = index.get((*row[:m], row[m] + 1, *row[m + 1:]), count)
    return table


def lower_products(exponents: np.ndarray) -> np.ndarray:
    """Index (E, M) of the product with one fewer reflection off m; E where there is none.

    Parameters
    ----------
    exponents : (E, M) int array
        As ``exponents_up_to`` and ``pruned`` give.
    """
    following = product_after(exponents)
    count, materials = exponents.shape
    table = np.full((count, materials), count, dtype=np.int64)
    for m in range(materials):
        reached = following[:count, m]
        kept = reached < count
        table[reached[kept], m] = np.flatnonzero(kept)
    return table


def products(exponents: np.ndarray, reflectances: np.ndarray) -> np.ndarray:
    """Product (E, P) of reflectances for each row of exponents; exact where a reflectance is 0.

    Parameters
    ----------
    exponents : (E, M) int array
    reflectances : (M, P) array
    """
    values = np.ones((len(exponents) + 1, reflectances.shape[1]))
    _, steps = _recurrence(exponents.tobytes(), exponents.shape)
    for level, parent, material in steps:
        values[level] = values[parent] * reflectances[material]
    return values[:-1]


def band_products(exponents: np.ndarray, reflectances: np.ndarray,
                  response: np.ndarray) -> np.ndarray:
    """Signal (E, K) of each product of reflectances.

    Parameters
    ----------
    exponents : (E, M) int array
    reflectances : (M, P) array
    response : (K, P) array
        Sensitivity x light x integration weight.
    """
    return products(exponents, reflectances) @ response.T


def band_products_jacobian(exponents: np.ndarray, reflectances: np.ndarray, response: np.ndarray,
                           basis: np.ndarray,
                           unknown: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Signal (E, K) of each product, and its derivative (E, K, U, N) by spline coefficients.

    Parameters
    ----------
    exponents : (E, M) int array
    reflectances : (M, P) array
    response : (K, P) array
        Sensitivity x light x integration weight.
    basis : (P, N) array
    unknown : tuple of U int
        Indices of the materials whose coefficients vary.
    """
    values = np.vstack([products(exponents, reflectances), np.zeros(reflectances.shape[1])])
    lower, _ = _recurrence(exponents.tobytes(), exponents.shape)
    bands, coefficients = response.shape[0], basis.shape[1]
    carrier = (response.T[:, :, None] * basis[:, None, :]).reshape(len(basis), bands * coefficients)
    jacobian = np.zeros((len(exponents), bands, len(unknown), coefficients))
    for column, m in enumerate(unknown):
        met = np.flatnonzero(exponents[:, m])       # of many materials a product has few
        derivative = exponents[met, m, None] * values[lower[met, m]]
        jacobian[met, :, column] = (derivative @ carrier).reshape(met.size, bands, coefficients)
    return values[:-1] @ response.T, jacobian


def signal(coefficients: np.ndarray, exponents: np.ndarray, reflectances: np.ndarray,
           response: np.ndarray) -> np.ndarray:
    """Signal (R, K) of R regions.

    Parameters
    ----------
    coefficients : (R, E) array, or (R, L, E) for L lights
        Of the transport. Several lights are traced separately, and their signals add.
    exponents : (E, M) int array
    reflectances : (M, P) array
    response : (K, P) array, or (L, K, P)
        Sensitivity x light x integration weight, of each light.
    """
    if coefficients.ndim == 2:
        return coefficients @ band_products(exponents, reflectances, response)
    terms = products(exponents, reflectances)
    return np.einsum("rle,lke->rk", coefficients, np.einsum("ep,lkp->lke", terms, response),
                     optimize=True)


def encountered(met: np.ndarray, contributions: np.ndarray,
                materials: int) -> tuple[np.ndarray, np.ndarray]:
    """Products that paths encountered, and the sum of what they contributed after each.

    Parameters
    ----------
    met : (T, D) int
        Materials that each of T paths met, one after the other; M where it had ended.
    contributions : (T, D + 1) array
        After none to D reflections.
    materials : int
        M.

    Returns
    -------
    exponents : (E, M) uint8
        Fewest reflections first; no reflection is the first.
    contributions : (E,) array
    """
    paths, bounces = met.shape
    # A product is a sum of random numbers of its materials: equal whatever their order; that two
    # of a million products have one sum of 64 bits has a probability of 1e-7.
    keys = np.random.default_rng(1).integers(0, 1 << 64, materials + 1, dtype=np.uint64)
    key = np.zeros((paths, bounces + 1), dtype=np.uint64)
    key[:, 1:] = np.cumsum(keys[met], axis=1, dtype=np.uint64)
    alive = np.ones((paths, bounces + 1), dtype=bool)
    alive[:, 1:] = np.cumsum(met == materials, axis=1) == 0
    path, reflections = np.nonzero(alive)
    _, first, which = np.unique(key[alive], return_index=True, return_inverse=True)
    sums = np.bincount(which.ravel(), contributions[alive])
    exponents = np.zeros((first.size, materials), dtype=np.uint8)
    for step in range(bounces):
        some = np.flatnonzero(reflections[first] > step)
        exponents[some, met[path[first[some]], step]] += 1
    order = np.lexsort((*exponents.T[::-1], exponents.sum(axis=1)))
    return exponents[order], sums[order]


def pruned(exponents: np.ndarray, contributions: np.ndarray, brightest: float,
           share: float) -> np.ndarray:
    """Exponents (E', M) of the products to keep of those that were encountered.

    A product can give at most contribution x ``brightest``^degree of what a light seen through unit
    reflectances would give. Products are dropped from the least upwards while the sum of these
    bounds stays below ``share`` of the bound of the whole; every product with fewer reflections of
    one that is kept is kept as well, whether it was encountered or not.

    Parameters
    ----------
    exponents : (E, M) int
    contributions : (E,) array
    brightest : float
        No material reflects more than this at any wavelength.
    share : float
    """
    bound = contributions * brightest ** exponents.sum(axis=1)
    order = np.argsort(bound, kind="stable")
    kept = exponents[order[np.cumsum(bound[order]) > share * bound.sum()]].astype(np.uint8)
    levels: list[np.ndarray] = []
    for degree in range(int(kept.sum(axis=1).max(initial=0)), 0, -1):
        level = kept[kept.sum(axis=1) == degree]
        if levels:
            level = np.vstack([level, _one_fewer(levels[-1])])
        levels.append(np.unique(level, axis=0)[::-1])
    none = np.zeros((1, exponents.shape[1]), dtype=np.uint8)
    return np.vstack([none, *levels[::-1]]).astype(np.int64)


def _one_fewer(exponents: np.ndarray) -> np.ndarray:
    """Products with one reflection fewer off any of their materials."""
    row, material = np.nonzero(exponents)
    lower = exponents[row]
    lower[np.arange(row.size), material] -= 1
    return lower


@functools.lru_cache(maxsize=8)
def _recurrence(content: bytes, shape: tuple[int, ...]
                ) -> tuple[np.ndarray, tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]]:
    """``lower_products``; and per degree its products, the product from which each is reached, and
    the material encountered last. Kept: a fit asks for the same at every step.
    """
    exponents = np.frombuffer(content, dtype=np.int64).reshape(shape)
    degree = exponents.sum(axis=1)
    lower = lower_products(exponents)
    steps = []
    for value in range(1, degree.max() + 1):
        level = np.flatnonzero(degree == value)
        material = np.argmax(exponents[level] > 0, axis=1)
        steps.append((level, lower[level, material], material))
    return lower, tuple(steps)
