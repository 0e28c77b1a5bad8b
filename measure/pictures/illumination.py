"""The colours of the light over a picture: a few shapes times maps, and some typical ones.

Light from other surfaces is coloured: each pixel sees reflectances through a response of its own.
Over a picture these have low rank: light = sum over a of map_a(pixel) shape_a(nm). Signals of
pixels with similar light are adapted to one typical colour of light, so that one table of spectra
serves them all: a signal under one light is predicted under another for the spectrum that the prior
expects behind it. The remaining error is the difference of two similar lights times the error of
the expected spectrum.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.cluster.vq import kmeans2, vq

MAX_RANK, MAX_LEFT_OUT = 8, 5e-4   # shapes; share of a light's strength that they may miss
MAX_TYPICAL = 4                 # colours: more change spectra by 1 % of their error
SAME = 2e-3                     # relative: lights closer than this have one colour
SAMPLED = 4096                  # nodes by which typical colours are chosen
EXPECTED = 0.01                 # of white: error of the signals of which spectra are expected


@dataclass(frozen=True)
class Illumination:
    """Light at N nodes: maps times Q shapes, and J typical colours."""

    maps: np.ndarray            # (N, Q)
    spectra: np.ndarray         # (Q, P) of the shapes
    shapes: np.ndarray          # (Q, K, 61) signals, of reflectances on the prior's wavelengths
    typical: np.ndarray         # (J, Q) maps of the typical colours
    kind: np.ndarray            # (N,) the typical colour of each node

    @property
    def white(self) -> np.ndarray:
        """Signal (N, K) of a perfect white at the nodes."""
        return np.asarray(self.maps @ self.shapes.sum(axis=2))

    @property
    def responses(self) -> np.ndarray:
        """Relative response (J, K, 61) under the typical colours; rows sum to 1."""
        responses = np.einsum("jq,qkp->jkp", self.typical, self.shapes)
        return np.asarray(responses / responses.sum(axis=2, keepdims=True))


def adapted_signals(signals: np.ndarray, light: Illumination, maps: np.ndarray,
                    kind: np.ndarray | None,
                    moments: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Signals (n, K) as they would be under the typical colour of each pixel, for the spectra that
    a prior expects, to first order ``mean + gain (signal - response mean)``.

    Parameters
    ----------
    signals : (n, K) array
        Relative to white under the pixels' own light.
    light : Illumination
    maps : (n, Q) array
        At the pixels; 0 where one has no known light.
    kind : (n,) int array or None
        Index of the typical colour of each pixel; None where there is one.
    moments : (61,) and (61, 61) arrays
        Mean and covariance of reflectances, from ``mixture.reflectance_moments``.
    """
    if len(light.typical) == 1 and maps.shape[1] == 1:
        return signals
    mean, covariance = moments
    white = light.shapes.sum(axis=2)
    adapted = np.empty_like(signals)
    for number, (typical, response) in enumerate(zip(light.typical, light.responses, strict=True)):
        some = np.arange(len(signals)) if kind is None else np.flatnonzero(kind == number)
        seen = response @ covariance
        gain = np.linalg.solve(seen @ response.T + EXPECTED**2 * np.eye(len(response)), seen).T
        under = light.shapes @ mean + np.einsum(    # each shape, (n, Q, K)
            "qkl,nl->nqk", light.shapes @ gain, signals[some] - response @ mean)
        irradiance = maps[some] @ white
        own = np.einsum("nq,nqk->nk", maps[some], under) / np.where(irradiance > 0, irradiance, 1.0)
        adapted[some] = signals[some] - own + (typical @ under) / (typical @ white)
    return adapted


def even_light(response: np.ndarray, nodes: int) -> Illumination:
    """Light of one colour, through a relative response (K, 61), at some number of nodes."""
    return Illumination(np.ones((nodes, 1)), np.ones((1, 1)), response[None], np.ones((1, 1)),
                        np.zeros(nodes, np.int32))


def illumination(light: np.ndarray, to_signals: np.ndarray) -> Illumination:
    """Light at nodes as a few shapes times maps.

    Parameters
    ----------
    light : (N, P) array
        Radiance of a perfect white.
    to_signals : (K, P, 61) array
        Signal of light at each wavelength from reflectances on the prior's wavelengths.
    """
    strength = np.maximum(light.mean(axis=1, keepdims=True), 1e-30)
    colours = light / strength
    _, vectors = np.linalg.eigh(colours.T @ colours)
    shapes = vectors[:, ::-1][:, :MAX_RANK].T
    maps = colours @ shapes.T
    left = np.sum(colours**2, axis=1, keepdims=True) - np.cumsum(maps**2, axis=1)
    enough = left.max(axis=0) < colours.shape[1] * MAX_LEFT_OUT**2
    rank = int(np.argmax(enough)) + 1 if enough.any() else MAX_RANK
    shapes, maps = shapes[:rank], maps[:, :rank]
    typical, kind = _typical(maps)
    return Illumination(maps * strength, shapes, np.einsum("qp,kpr->qkr", shapes, to_signals),
                        typical, kind)


def _typical(maps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Typical colours (J, Q) and the nearest one (N,) of each node."""
    with_light = maps[np.any(maps != 0, axis=1)]
    size = np.sqrt(np.mean(np.sum(with_light**2, axis=1)))
    if np.abs(with_light - with_light.mean(axis=0)).max() < SAME * size:
        return with_light.mean(axis=0, keepdims=True), np.zeros(len(maps), np.int32)
    sample = with_light[np.linspace(0, len(with_light) - 1,
                                    min(len(with_light), SAMPLED)).astype(int)]
    different = len(np.unique(np.rint(sample / (SAME * size)), axis=0))
    centres, kind = kmeans2(sample, min(MAX_TYPICAL, different), seed=1, minit="++")
    centres = centres[np.unique(kind)]
    return centres, vq(maps, centres)[0]
