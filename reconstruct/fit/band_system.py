"""Noise-weighted equations of a photo in the products of reflectances, made small once by QR.

The photo says rows @ G = target in every band, G (E, K) being the signals of the products. A thin
QR factor of the weighted rows of each surface keeps all of it: a fit then costs the same for 4096
pixels as for 400.

The rows carry Monte Carlo noise, an error in the variables, which would pull every spectrum down by
its relative variance. The scatter of independent passes gives the noise's share of their Gram
matrix; ``noise`` carries it, and the fit takes its sum of squares off. The cost is then the
unbiased product of residuals of different passes.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEGLIGIBLE_NOISE = 0.01     # share of a surface's Monte Carlo noise that is not taken off
HUBER = 3.0     # standard deviations beyond which a pixel's pull on the fit grows no more


@dataclass(frozen=True)
class BandSystem:
    """Q equations for each of K bands, and the Monte Carlo noise that their rows carry.

    cost = sum (root (rows G - target))^2 - sum (noise_root noise G)^2
    """

    rows: np.ndarray         # (Q, E)
    target: np.ndarray       # (Q, K)
    root: np.ndarray         # (Q, K) square root of the weight
    group: np.ndarray        # (Q,) surface of each equation
    noise: np.ndarray        # (Z, E) Monte Carlo noise of the rows, compressed as they are
    noise_root: np.ndarray   # (Z, K)
    noise_group: np.ndarray  # (Z,)


def compress(coefficients: np.ndarray, measured: np.ndarray, weight: np.ndarray, group: np.ndarray,
             deviations: np.ndarray | None = None) -> BandSystem:
    """Equations of the pixels, as few as carry the same information.

    Bands may be weighted differently, but within one surface in a fixed proportion (its median), so
    that one factor serves all bands: noise is nearly proportional to the signal, whose colour is
    that of the surface.

    Parameters
    ----------
    coefficients : (R, E) transport of each pixel or region
    measured : (R, K) signal
    weight : (R, K) inverse variance; a row of zeros does not count
    group : (R,) surface index
    deviations : (A, R, E), optional
        Whose squares sum to the Monte Carlo variance of ``coefficients``.

    Raises
    ------
    ValueError
        If no pixel has any weight.
    """
    counts = np.flatnonzero((weight > 0).all(axis=1))
    if not counts.size:
        raise ValueError("no pixel has any weight")
    products = coefficients.shape[1]
    parts: list[tuple[np.ndarray, ...]] = []
    noises: list[tuple[np.ndarray, ...]] = []
    for name in np.unique(group[counts]):
        members = counts[group[counts] == name]
        band_weight = np.median(weight[members], axis=0)
        pixel_root = np.sqrt((weight[members] / band_weight).mean(axis=1))[:, None]
        rows = np.hstack([pixel_root * coefficients[members], pixel_root * measured[members]])
        if len(rows) > rows.shape[1]:
            rows = np.asarray(np.linalg.qr(rows, mode="r"))
        noise = np.zeros((0, products))
        if deviations is not None:
            noise = _compressed_noise((pixel_root * deviations[:, members]).reshape(-1, products))
        for pieces, equations in ((parts, rows), (noises, noise)):
            root = np.broadcast_to(np.sqrt(band_weight), (len(equations), band_weight.size))
            pieces.append((equations, root, np.full(len(equations), name)))
    (rows, root, names), (noise, noise_root, noise_names) = (
        [np.concatenate(columns) for columns in zip(*pieces, strict=True)]
        for pieces in (parts, noises))
    return BandSystem(rows[:, :products], rows[:, products:], root, names, noise, noise_root,
                      noise_names)


def _compressed_noise(noise: np.ndarray) -> np.ndarray:
    """Triangular factor of the noise, the products with most of it first, without the rows that
    hold next to nothing.
    """
    order = np.argsort(-np.sum(noise**2, axis=0))
    factor = np.asarray(np.linalg.qr(noise[:, order], mode="r"))
    left = np.cumsum(np.sum(factor**2, axis=1)[::-1])[::-1]     # from each row on
    kept = factor[left > NEGLIGIBLE_NOISE * left[0]]
    rows = np.empty_like(kept)
    rows[:, order] = kept
    return rows


def huber_weight(residual: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Factor (R, 1) in (0, 1] for the weights of pixels, below 1 beyond ``HUBER`` sigma.

    Parameters
    ----------
    residual : (R, K) array
        Whose worst band counts.
    sigma : (R, K) array
        Its standard deviation, above 0.
    """
    worst = np.abs(residual / sigma).max(axis=1, keepdims=True)
    return np.minimum(1.0, HUBER / np.maximum(worst, 1e-12))
