"""A table of colours over the cube of a camera's signals, as profiles hold it."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

SIDE = 33           # nodes a channel
ROOT = 3            # nodes lie evenly in the cube roots of the signals, and so do their colours


def colour_table(xyz: Callable[[np.ndarray], np.ndarray], white: np.ndarray) -> np.ndarray:
    """Cube roots (SIDE, SIDE, SIDE, 3) of X, Y, Z over those of white, by R, G and B.

    Where twice the light gives twice the colour, the roots lie on straight lines from black, and
    interpolation between nodes is exact on the line of neutral colours.

    Parameters
    ----------
    xyz : function of signals (n, 3), 0 to 1 of white, that gives X, Y, Z (n, 3)
    white : (3,) array
        X, Y, Z of white. What lies below 0 or above white is clipped.
    """
    node = np.linspace(0, 1, SIDE) ** ROOT
    signals = np.stack(np.meshgrid(node, node, node, indexing="ij"), axis=-1)
    relative = np.clip(xyz(signals.reshape(-1, 3)) / white, 0, 1)
    return np.asarray(np.cbrt(relative).reshape(signals.shape))
