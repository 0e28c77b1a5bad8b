"""What the copy of a chart does to the signals of its patches, and what they say of the copy.

A copy departs from the mean of its edition by terms of unit normals (``ChartCopies``), and each
band of a patch sees a share of them: of which wavelengths, the chart itself tells well enough.
All further errors of the signals being Gaussian too, the terms given the signals are

    mean = C^T W r,  covariance = 1 - C^T W C

with C the signals by the terms and W the inverse covariance of the innovations r. Fall-off over the
chart, exposure, glare and camera are in W: where they look like a darker patch, the error says so.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from scipy.special import logsumexp

from spectrabox.radiometry.charts.references import ChartCopies
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.radiometry.shaped import Record

NODES_NM = 20.0             # of the bands as the chart itself shows them
ROUGHNESS = 0.02            # of them, against relative errors of signals
DARK_SHARE = 0.03           # of the brightest patch: below it errors are no longer relative
LEVEL_FROM_NM = 430.0       # the level of a patch is what it reflects from here on
BLUE_NM, RED_NM = (430.0, 490.0), (600.0, 700.0)    # whose difference is a patch's tint


@dataclass(frozen=True, eq=False)
class Explained(Record):
    """What a fit leaves of all signals of its photos."""

    weights: Annotated[np.ndarray, "C"]             # of components of the prior, summing to 1
    weighted: Annotated[np.ndarray, "C Y"]          # innovations by each times the inverse
    inverse: Annotated[np.ndarray, "Y Y"]           # of the innovations' covariance


def copy_errors(signal: np.ndarray, clipped: np.ndarray, copies: ChartCopies,
                weights_nm: np.ndarray, grid: WavelengthGrid) -> np.ndarray:
    """Signals (I, K, R) by the terms of a copy: R = I Q of the patches' own, then S in common; of
    the first of a patch's own, its level, the least part.

    Parameters
    ----------
    signal : (I, K) array
    clipped : (I, K) bool array
        Signals that say nothing.
    copies : ChartCopies
    weights_nm : (P,) array
        Of the integral, times the light.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    seen, shares = _seen(signal, clipped, copies.mean, weights_nm, grid)
    patches, bands = signal.shape
    own = seen[:, :, None] * np.einsum("ikp,ipq->ikq", shares, copies.own)
    own[..., 0] *= copies.least_level[:, None]
    common = seen[:, :, None] * np.einsum("ikp,ips->iks", shares, copies.common)
    each = np.einsum("ikq,ij->ikjq", own, np.eye(patches)).reshape(patches, bands, -1)
    return np.concatenate([each, common], axis=2)


def edition_errors(signal: np.ndarray, clipped: np.ndarray, mean: np.ndarray, others: np.ndarray,
                   weights_nm: np.ndarray, grid: WavelengthGrid) -> np.ndarray:
    """Signals (E, I, K) that another mean of the copies would add.

    Parameters
    ----------
    signal, clipped, weights_nm, grid
        As of ``copy_errors``.
    mean : (I, P) array
        Reflectance.
    others : (E, I, P) array
        Reflectances of other editions.
    """
    seen, shares = _seen(signal, clipped, mean, weights_nm, grid)
    return np.asarray(seen * np.einsum("ikp,eip->eik", shares, others / mean - 1))


def _seen(signal: np.ndarray, clipped: np.ndarray, reflectances: np.ndarray,
          weights_nm: np.ndarray, grid: WavelengthGrid) -> tuple[np.ndarray, np.ndarray]:
    """Signals (I, K) that patches themselves give, and the share (I, K, P) of each wavelength, by
    bands without negative parts that explain the chart.
    """
    from scipy.optimize import nnls  # slow to import, and a report fits nothing

    nodes = np.append(np.arange(grid.nm[0], grid.nm[-1], NODES_NM), grid.nm[-1])
    basis = interpolation_matrix(nodes, grid.nm)
    design = np.column_stack([(reflectances * weights_nm) @ basis, np.zeros(len(signal))])
    design /= design.mean()
    rough = np.zeros((nodes.size - 2, nodes.size + 1))
    for row in range(nodes.size - 2):
        rough[row, row:row + 3] = 1, -2, 1
    seen, shares = np.empty(signal.shape), np.empty((*signal.shape, grid.nm.size))
    for band, measured in enumerate(signal.T):
        brightest = measured.max()
        error = np.maximum(measured, DARK_SHARE * brightest) / brightest
        use = np.where(clipped[:, band], 0, 1 / error)[:, None]
        design[:, -1] = 1
        solution, _ = nnls(np.vstack([design * use, ROUGHNESS * nodes.size**2 * rough]),
                           np.r_[use[:, 0] * measured / brightest, np.zeros(len(rough))])
        each = reflectances * weights_nm * (basis @ (solution[:-1] + 1e-6))
        shares[:, band] = each / each.sum(axis=1, keepdims=True)
        seen[:, band] = np.maximum(measured - solution[-1] * brightest,
                                   DARK_SHARE / 10 * brightest)
    return seen, shares


def terms_of_copy(explained: Explained, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (R,) and covariance (R, R) of the terms of a copy, given the photos of it.

    Parameters
    ----------
    explained : Explained
        By the fit of the photos.
    errors : (Y, R) array
        Signals of all photos by the terms of the copy.
    """
    weighted = explained.weighted @ errors                      # (C, R)
    terms = explained.weights @ weighted
    away = (weighted - terms) * np.sqrt(explained.weights)[:, None]
    return terms, np.eye(terms.size) - errors.T @ explained.inverse @ errors + away.T @ away


def edition_log_odds(explained: Explained, others: np.ndarray) -> np.ndarray:
    """Evidence (E,) for each further edition, in nats over the one that was taken.

    Parameters
    ----------
    explained : Explained
        By the fit of the photos.
    others : (E, Y) array
        What the means of other editions would add to the signals.
    """
    gains = explained.weighted @ others.T - 0.5 * np.einsum(
        "ey,yz,ez->e", others, explained.inverse, others)       # (C, E), nats
    with np.errstate(divide="ignore"):      # a component whose weight is 0 says nothing
        log_weights = np.log(explained.weights)
    return np.asarray(logsumexp(gains + log_weights[:, None], axis=0))


def departure(copies: ChartCopies, terms: np.ndarray) -> np.ndarray:
    """Departure (I, P) of the logarithm of the reflectances of a copy from their mean.

    Parameters
    ----------
    copies : ChartCopies
    terms : (R,) array
        Of the copy.
    """
    patches, _, own = copies.own.shape
    return np.asarray(np.einsum("ipq,iq->ip", copies.own,
                                terms[:patches * own].reshape(patches, own))
                      + copies.common @ terms[patches * own:])


def copy_spread(copies: ChartCopies, grid: WavelengthGrid) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations (I,) of level and tint of each patch among copies of an edition.

    Parameters
    ----------
    copies : ChartCopies
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    level, tint = (np.sqrt(np.sum(rows**2, axis=1)) for rows in level_and_tint(copies, grid))
    return level, tint


def with_level_of_fit(errors: np.ndarray, copies: ChartCopies,
                      common: float) -> tuple[np.ndarray, ChartCopies]:
    """Signals (Y, R) by the terms of a copy, and the copies, where levels scatter as a fit found.

    Parameters
    ----------
    errors : (Y, R) array
        From ``copy_errors``.
    copies : ChartCopies
    common : float
        Relative error of a patch that its bands have in common.
    """
    level = np.abs(copies.own[:, :, 0]).max(axis=1)
    found = np.hypot(copies.least_level * level, common) / level        # (I,)
    patches, _, terms = copies.own.shape
    own = copies.own.copy()
    own[:, :, 0] *= found[:, None]
    errors = errors.copy()
    errors[:, :patches * terms:terms] *= found / copies.least_level
    return errors, replace(copies, own=own)


def level_and_tint(copies: ChartCopies, grid: WavelengthGrid) -> tuple[np.ndarray, np.ndarray]:
    """Level and tint (I, R) of each patch, by the terms: logarithms, relative to the mean of the
    copies' edition.

    The level is that from 430 nm on, the tint blue less red: negative where a patch is yellower.

    Parameters
    ----------
    copies : ChartCopies
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    nm = grid.nm
    level, blue, red = (_mean_departure(copies, part) for part in (
        nm >= LEVEL_FROM_NM, (nm >= BLUE_NM[0]) & (nm <= BLUE_NM[1]),
        (nm >= RED_NM[0]) & (nm <= RED_NM[1])))
    return level, blue - red


def _mean_departure(copies: ChartCopies, chosen: np.ndarray) -> np.ndarray:
    """Departure (I, R) of what each patch reflects over some wavelengths, by the terms."""
    patches = len(copies.mean)
    reflected = copies.mean[:, chosen] / copies.mean[:, chosen].sum(axis=1, keepdims=True)
    own = np.einsum("ip,ipq,ij->ijq", reflected, copies.own[:, chosen], np.eye(patches))
    common = np.einsum("ip,ips->is", reflected, copies.common[:, chosen])
    return np.hstack([own.reshape(patches, -1), common])
