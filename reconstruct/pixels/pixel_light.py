"""Light on every part of a photo's surfaces, as a polynomial in the reflectances of the materials.

What a surface of reflectance rho sends to the camera is, wavelength by wavelength, rho x light, its
light being direct light and what comes from everywhere else. Of the traced products of reflectances
(radiometry/interreflection.py) every one that begins at this surface holds its own reflectance once
more than the light does: that one is divided out.

    light_x(nm) = sum over e, e_own >= 1, of coefficients_xe lamp(nm)
                  prod_m reflectance_m(nm)^(e_m - [m = own])
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spectrabox.radiometry.interreflection import lower_products, products
from spectrabox.reconstruct.fit.traced_view import LAMP_SHARE, smoothed_variance
from spectrabox.reconstruct.pixels.light_nodes import LightNodes
from spectrabox.reconstruct.tracer.transport import kept_products, memory_of, trace_transport
from spectrabox.reconstruct.tracer.unit_scene import UnitScene

MAX_NODES = 25_000
PATHS_OF_NODE = 1024        # at least, of all passes together
PASSES = 4                  # whose scatter is the noise
BYTES = 3 << 27             # of the coefficients: with more products there are fewer nodes


@dataclass(frozen=True, eq=False)
class PixelLight:
    """Light at N nodes, of L light groups, by E products of M materials."""

    nodes: LightNodes
    own: np.ndarray                 # (N,) material of each node
    exponents: np.ndarray           # (E, M)
    coefficients: np.ndarray        # (N, L, E)
    relative_variance: np.ndarray   # (N,) by the noise of tracing

    @property
    def lamp(self) -> np.ndarray:
        """Nodes (N,) bool that show a lamp."""
        seen = self.coefficients[..., 0].sum(axis=1)
        return np.asarray(seen > LAMP_SHARE * self.coefficients.sum(axis=(1, 2)))

    def on_nodes(self, reflectances: np.ndarray, lamps: np.ndarray) -> np.ndarray:
        """Light (N, P): radiance of a perfect white there.

        Parameters
        ----------
        reflectances : (M, P) array
        lamps : (L, P) array
            Spectra of the light groups.
        """
        terms, lower = products(self.exponents, reflectances), lower_products(self.exponents)
        light = np.zeros((len(self.own), reflectances.shape[1]))
        for material in np.unique(self.own):
            nodes = np.flatnonzero(self.own == material)
            begins = np.flatnonzero(self.exponents[:, material] > 0)
            onward = terms[lower[begins, material]]
            for group, lamp in enumerate(lamps):
                light[nodes] += self.coefficients[nodes, group][:, begins] @ (onward * lamp)
        return light


def trace_pixel_light(unit: UnitScene, surface: np.ndarray, own: np.ndarray, *, seed: int,
                      progress: Callable[[float], None],
                      checkpoint: Path | None = None) -> PixelLight:
    """Trace the light on all surfaces of a photo.

    Parameters
    ----------
    unit : UnitScene
        Of the photo's size.
    surface : (H, W) int
        Index of the one surface that each pixel shows; -1 where it is not wanted.
    own : (S,) int
        Material of each surface.
    seed : int
    progress : function of the share that is done
    checkpoint : Path, optional
        File from which a trace that was stopped goes on.

    Raises
    ------
    InputError
        As ``trace_transport``.
    """
    exponents, _ = kept_products(unit, surface, seed)
    most = min(MAX_NODES, max(BYTES // memory_of(1, unit.groups * len(exponents), PASSES), 1))
    nodes = _nodes(surface, most)
    region = nodes.region
    count, pixels = nodes.keys.shape[1], np.count_nonzero(region >= 0)
    traced = trace_transport(unit, region, spp=-(-PATHS_OF_NODE * count // pixels), seed=seed,
                             passes=PASSES, exponents=exponents, progress=progress,
                             checkpoint=checkpoint)
    variance = smoothed_variance(traced.relative_variance, nodes.keys[0],
                                 np.bincount(region[region >= 0]))
    return PixelLight(nodes, own[nodes.keys[0]], exponents, traced.passes.mean(axis=0, dtype=float),
                      variance)


def _nodes(surface: np.ndarray, most: int) -> LightNodes:
    """Nodes of the smallest cells of which there are no more than that; one for each surface where
    these are more.
    """
    cell = max(round(np.sqrt(np.count_nonzero(surface >= 0) / most)), 1)
    while (nodes := LightNodes(surface, cell)).keys.shape[1] > most and cell < max(surface.shape):
        cell += 1
    return nodes
