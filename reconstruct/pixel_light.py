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
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array

from spectrabox.radiometry.interreflection import lower_products, products
from spectrabox.reconstruct.tracer import transport, unit_scene

MAX_NODES = 25_000
PATHS_OF_NODE = 1024        # at least, of all passes together
PASSES = 4                  # whose scatter is the noise
BYTES = 3 << 27             # of the coefficients: with more products there are fewer nodes


def light_on_nodes(traced: transport.TracedTransport, own: np.ndarray, reflectances: np.ndarray,
                   lamps: np.ndarray) -> np.ndarray:
    """Light (N, P) on the surfaces of N regions: radiance of a perfect white there.

    Parameters
    ----------
    traced : TracedTransport
        Of the regions, by E products of M materials.
    own : (N,) int
        Material of each region.
    reflectances : (M, P) array
    lamps : (L, P) array
        Spectra of the light groups.
    """
    terms, lower = products(traced.exponents, reflectances), lower_products(traced.exponents)
    coefficients = traced.coefficients.reshape(len(own), len(lamps), -1)
    light = np.zeros((len(own), reflectances.shape[1]))
    for material in np.unique(own):
        nodes = np.flatnonzero(own == material)
        begins = np.flatnonzero(traced.exponents[:, material] > 0)
        onward = terms[lower[begins, material]]
        for group, lamp in enumerate(lamps):
            light[nodes] += coefficients[nodes, group][:, begins] @ (onward * lamp)
    return light


def trace_pixel_light(unit: unit_scene.UnitScene, surface: np.ndarray, *, seed: int,
                      progress: Callable[[float], None], checkpoint: Path | None = None
                      ) -> tuple[LightNodes, transport.TracedTransport]:
    """Trace the light on all surfaces of a photo: its nodes, and the transport of their cells.

    Parameters
    ----------
    unit : UnitScene
        Of the photo's size.
    surface : (H, W) int
        Index of the one surface that each pixel shows; -1 where it is not wanted.
    seed : int
    progress : function of the share that is done
    checkpoint : Path, optional
        File from which a trace that was stopped goes on.

    Raises
    ------
    InputError
        As ``trace_transport``.
    """
    exponents, _ = transport.kept_products(unit, surface, seed)
    most = min(MAX_NODES,
               max(BYTES // transport.memory_of(1, unit.groups * len(exponents), PASSES), 1))
    nodes = _nodes(surface, most)
    region = nodes.region
    count, pixels = nodes.keys.shape[1], np.count_nonzero(region >= 0)
    traced = transport.trace_transport(unit, region, spp=-(-PATHS_OF_NODE * count // pixels),
                                       seed=seed, passes=PASSES, exponents=exponents,
                                       progress=progress, checkpoint=checkpoint)
    return nodes, traced


def _nodes(surface: np.ndarray, most: int) -> LightNodes:
    """Nodes of the smallest cells of which there are no more than that; one for each surface where
    these are more.
    """
    cell = max(round(np.sqrt(np.count_nonzero(surface >= 0) / most)), 1)
    while (nodes := LightNodes(surface, cell)).keys.shape[1] > most and cell < max(surface.shape):
        cell += 1
    return nodes


# ---- nodes ---------------------------------------------------------------------------------------
# Nodes at which the light on a photo's surfaces is traced, and every pixel between them.
#
# Square cells of pixels, each cut by the surfaces in it: light changes slowly over one surface, and
# jumps from one to the next. A pixel takes its light from the nodes of its own surface in the four
# cells around it.

@dataclass(frozen=True, eq=False)
class LightNodes:
    """Nodes 0 to N-1 of a photo."""

    surface: np.ndarray         # (H, W) index of each pixel's surface, -1 where none or several
    cell: int                   # pixels along its sides

    @cached_property
    def keys(self) -> np.ndarray:
        """Surface, row and column (3, N) of each node's cell."""
        row, column = np.nonzero(self.surface >= 0)
        height, width = self._cells
        numbers = (self.surface[row, column].astype(np.int64) * height
                   + row // self.cell) * width + column // self.cell
        return np.array(np.unravel_index(np.unique(numbers), (self._surfaces, height, width)))

    @cached_property
    def node(self) -> np.ndarray:
        """Node (S, h, w) of each surface in each cell, -1 where it does not reach."""
        nodes = np.full((self._surfaces, *self._cells), -1, dtype=np.int32)
        nodes[tuple(self.keys)] = np.arange(self.keys.shape[1])
        return nodes

    @property
    def region(self) -> np.ndarray:
        """Node (H, W) whose cell holds each pixel, -1 where it has none."""
        row, column = np.ogrid[:self.surface.shape[0], :self.surface.shape[1]]
        node = self.node[self.surface, row // self.cell, column // self.cell]
        return np.where(self.surface >= 0, node, -1)

    def weights(self, row: np.ndarray, column: np.ndarray) -> csr_array:
        """Weights (n, N), four to a row, of the nodes for some pixels; 0 for those without a
        surface.

        Parameters
        ----------
        row, column : (n,) int arrays
        """
        surface = self.surface[row, column]
        sides = [self._corner_and_share(at, cells)
                 for at, cells in zip((row, column), self._cells, strict=True)]
        nodes = np.empty((surface.size, 4), np.int32)
        weights = np.empty((surface.size, 4), np.float32)
        for number, beyond in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
            cell = [np.minimum(corner + more, cells - 1)
                    for (corner, _), more, cells in zip(sides, beyond, self._cells, strict=True)]
            nodes[:, number] = self.node[surface, cell[0], cell[1]]
            weights[:, number] = np.prod([share if more else 1 - share for (_, share), more
                                          in zip(sides, beyond, strict=True)], axis=0)
        weights[(nodes < 0) | (surface < 0)[:, None]] = 0
        weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
        return csr_array((weights.ravel(), np.maximum(nodes, 0).ravel(),
                          np.arange(0, nodes.size + 1, 4)),
                         shape=(surface.size, self.keys.shape[1]))

    def _corner_and_share(self, at: np.ndarray, cells: int) -> tuple[np.ndarray, np.ndarray]:
        """The cell before each pixel along one side, and how far (0 to 1) on to the next it is."""
        position = np.clip((at + 0.5) / self.cell - 0.5, 0, cells - 1)
        corner = position.astype(np.int32)
        return corner, (position - corner).astype(np.float32)

    def unevenness(self, light: np.ndarray, misplaced_px: float) -> np.ndarray:
        """By what share (N,) light may be off at a pixel: its slope times the pixels by which photo
        and scene may be misplaced, and what straight lines between nodes leave out.

        Parameters
        ----------
        light : (N,) array
        misplaced_px : float
        """
        surface, row, column = self.keys
        height, width = self._cells
        error = np.zeros(light.size)
        for down, across in ((0, 1), (1, 0)):
            neighbours = []
            for sign in (-1, 1):
                rows = np.clip(row + sign * down, 0, height - 1)
                columns = np.clip(column + sign * across, 0, width - 1)
                node = self.node[surface, rows, columns]
                neighbours.append(np.where(node >= 0, light[node], light))
            slope = np.abs(neighbours[1] - neighbours[0]) / (2 * self.cell)
            bend = np.abs(neighbours[0] - 2 * light + neighbours[1]) / 8 if self.cell > 1 else 0.0
            error = np.hypot(error, np.hypot(slope * misplaced_px, bend))
        return np.asarray(error / np.maximum(light, 1e-30))

    @property
    def _surfaces(self) -> int:
        return int(self.surface.max()) + 1

    @property
    def _cells(self) -> tuple[int, int]:
        height, width = self.surface.shape
        return -(-height // self.cell), -(-width // self.cell)
