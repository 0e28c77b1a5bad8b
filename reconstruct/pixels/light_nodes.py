"""Nodes at which the light on a photo's surfaces is traced, and every pixel between them.

Square cells of pixels, each cut by the surfaces in it: light changes slowly over one surface, and
jumps from one to the next. A pixel takes its light from the nodes of its own surface in the four
cells around it.
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array


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
