"""A bent lens and what it sees of a board, for the tests of lens and pose."""
from __future__ import annotations

import cv2
import numpy as np

from spectrabox.calibrate.geometry.board import Board
from spectrabox.calibrate.geometry.lens import Lens

TRUE = Lens(640, 480, np.array([[700.0, 0, 325], [0, 702.0, 236], [0, 0, 1]]),
            np.array([-0.12, 0.05, 0.001, -0.001, 0]), np.zeros(4), np.zeros(5), 0.0, "given")
BOARD = Board(columns=9, rows=7, square=0.03, marker=0.022)
TILTS = ((0.3, 0.0, 0.0), (-0.3, 0.2, 0.1), (0.1, 0.4, -0.2), (0.2, -0.4, 0.0), (0.0, 0.0, 0.3),
         (-0.2, -0.2, -0.1))
SHIFT = (-0.12, -0.1, 0.5)
NOISE_PX = 0.05


def seen(places, tilt, shift=SHIFT, rng=None, noise_px=NOISE_PX, lens=TRUE):
    """Pixels (n, 2) of places (n, 3)."""
    points, _ = cv2.projectPoints(places, np.array(tilt), np.array(shift, float), lens.matrix,
                                  lens.distortion)
    noise = 0 if rng is None else noise_px * rng.standard_normal((len(places), 2))
    return points.reshape(-1, 2) + noise


def view(tilt, rng=None):
    """Inner corners of the board, and their pixels."""
    column, row = np.meshgrid(np.arange(1, BOARD.columns), np.arange(1, BOARD.rows))
    places = BOARD.square * np.column_stack([column.ravel(), row.ravel(), np.zeros(column.size)])
    return places, seen(places, tilt, rng=rng)
