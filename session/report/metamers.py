"""Two spectra that the photo cannot tell apart, and the lights under which the eye can."""
from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from spectrabox.radiometry.appearance import (
    adapted_tristimulus,
    ciede2000,
    encoded_srgb,
    lab_from_xyz,
    tristimulus_weights,
)
from spectrabox.radiometry.grid import WavelengthGrid
from spectrabox.radiometry.records import SpectrumSamples

LIGHTS = ("D65", "A", "FL11", "LED-B3", "LED-RGB1")
ENDS = (0.025, 0.975)           # of the draws along their main difference
WIDTH, HEIGHT = 300, 90         # of the drawing, in its own unit
COLOURS = ("#1f4e8c", "#b3261e")


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
        weights, adapted = _weights(name, tuple(grid.nm.tolist()))
        lab = lab_from_xyz(pair @ weights.T, weights.sum(axis=1))
        differences.append(float(ciede2000(lab[0], lab[1])))
        colours.append([encoded_srgb(adapted @ one) for one in pair])
    apart = float(grid.nm[int(np.argmax(np.abs(pair[0] - pair[1])))])
    return MetamerPair(grid, pair, np.array(colours), np.array(differences), apart)


@functools.cache
def _weights(light: str, nm: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Weights (3, P) of X, Y, Z under a light, and of what looks alike under D65."""
    return tristimulus_weights(np.array(nm), light), adapted_tristimulus(np.array(nm), light)


def metamer_facts(pair: MetamerPair) -> dict[str, Any]:
    """The pair as numbers for the page's data."""
    return {"nm": pair.grid.nm, "spectra": pair.spectra, "apart_nm": pair.apart_nm,
            "delta_e00": dict(zip(LIGHTS, pair.delta_e00.tolist(), strict=True))}


def metamer_drawing(pair: MetamerPair) -> Markup:
    """Both spectra as a small drawing: 0 to 1 upwards, the wavelengths of their grid across."""
    nm = pair.grid.nm
    across = (nm - nm[0]) / (nm[-1] - nm[0]) * WIDTH
    lines = "".join(
        f'<polyline fill="none" stroke="{colour}" stroke-width="1.6" points="'
        + " ".join(f"{x:.1f},{HEIGHT * (1 - y):.1f}" for x, y in zip(across, values, strict=True))
        + '"/>' for colour, values in zip(COLOURS, pair.spectra, strict=True))
    apart = (pair.apart_nm - nm[0]) / (nm[-1] - nm[0]) * WIDTH
    label = (f"Two spectra between {nm[0]:.0f} and {nm[-1]:.0f} nm that give one signal, furthest "
             f"apart at {pair.apart_nm:.0f} nm")
    return Markup(f'<svg class="metamers" role="img" aria-label="{label}" viewBox="-1 -1 '
                  f'{WIDTH + 2} {HEIGHT + 2}"><rect width="{WIDTH}" height="{HEIGHT}" fill="none" '
                  f'stroke="#8a8a85" stroke-width=".6"/><line x1="{apart:.1f}" x2="{apart:.1f}" '
                  f'y1="0" y2="{HEIGHT}" stroke="#8a8a85" stroke-width=".8" '
                  f'stroke-dasharray="3 2"/>{lines}</svg>')
