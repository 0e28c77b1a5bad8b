"""Two spectra that the photo cannot tell apart, and the lights under which the eye can."""
from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.appearance import (
    adapted_tristimulus,
    ciede2000,
    encoded_srgb,
    lab_from_xyz,
    tristimulus_weights,
)
from spectrabox.radiometry.grid import WavelengthGrid
from spectrabox.radiometry.records.spectra import SpectrumSamples

LIGHTS = ("D65", "A", "FL11", "LED-B3", "LED-RGB1")
ENDS = (0.025, 0.975)           # of the draws along their main difference


@dataclass(frozen=True, eq=False)
class MetamerPair:
    """Two draws at the ends of what the draws span along their main difference.

    ``srgb`` (L, 2, 3) are their colours under each of ``LIGHTS``, adapted to D65 by Bradford,
    ``delta_e00`` (L,) their CIEDE2000 there; ``apart_nm`` is where a reading tells them apart best.
    """

    grid: WavelengthGrid
    spectra: np.ndarray         # (2, P)
    srgb: np.ndarray
    delta_e00: np.ndarray
    apart_nm: float


def metamer_pair(samples: SpectrumSamples) -> MetamerPair:
    """The pair of a material.

    Parameters
    ----------
    samples : SpectrumSamples
        Two draws or more.
    """
    grid, spectra = samples.grid, samples.spectra
    off = (spectra - spectra.mean(axis=0)) * np.sqrt(grid.weights_nm)
    _, axes = np.linalg.eigh(off.T @ off)
    along = off @ axes[:, -1]
    chosen = [int(np.argmin(np.abs(along - np.quantile(along, share)))) for share in ENDS]
    pair = np.clip(spectra[chosen], 0.0, 1.0)
    colours, differences = [], []
    for name in LIGHTS:
        weights, adapted = colour_weights(name, tuple(grid.nm.tolist()))
        lab = lab_from_xyz(pair @ weights.T, weights.sum(axis=1))
        differences.append(float(ciede2000(lab[0], lab[1])))
        colours.append([encoded_srgb(adapted @ one) for one in pair])
    apart = float(grid.nm[int(np.argmax(np.abs(pair[0] - pair[1])))])
    return MetamerPair(grid, pair, np.array(colours), np.array(differences), apart)


@functools.cache
def colour_weights(light: str, nm: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Weights (3, P) of X, Y, Z under a light, and of what looks alike under D65.

    Parameters
    ----------
    light : str
        CIE name.
    nm : tuple of P floats
        Ascending.
    """
    return tristimulus_weights(np.array(nm), light), adapted_tristimulus(np.array(nm), light)
