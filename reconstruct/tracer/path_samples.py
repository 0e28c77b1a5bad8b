"""Random numbers of light paths from a shifted lattice, even over picture, lights and bounces.

Point i of the rule has the coordinates frac(phi(i) z_d + shift_d), phi the radical inverse in base
2, z a generating vector whose every pair of dimensions is spread evenly (Cools, Kuo and Nuyens,
SIAM J. Sci. Comput. 28, 2006, up to 2^20 points). The shift is uniform, so each coordinate is
uniform as well and every mean is unbiased; rules with other shifts are independent, and their
scatter gives the error. Compared with independent numbers the noise of a picture's total falls by
two and more, at less cost per number (docs/explanation/reconstruction.md).
"""
from __future__ import annotations

from typing import Any

import numpy as np

GENERATOR = (
    1, 182667, 469891, 498753, 110745, 446247, 250185, 118627, 245333, 283199, 408519, 391023,
    246327, 126539, 399185, 461527, 300343, 69681, 516695, 436179, 106383, 238523, 413283, 70841,
    47719, 300129, 113029, 123925, 410745, 211325, 17489, 511893, 40767, 186077, 519471, 255369,
    101819, 243573, 66189, 152143, 503455, 113217, 132603, 463967, 297717, 157383, 224015, 502917,
    36237, 94049, 170665, 79397, 123963, 223451, 323871, 303633, 98567, 318855, 494245, 477137,
    177975, 64483, 26695, 88779, 94497, 239429, 381007)
# for which the vector was made; more are several rules with shifts of their own
MAX_POINTS = 1 << 20


class ShiftedLattice:
    """The first points of one rule, as arrays of the renderer.

    Parameters
    ----------
    dimensions : int
    seed : int
        Of the shift; another seed is another, independent rule.
    points : int
        At most ``MAX_POINTS``.
    """

    def __init__(self, dimensions: int, seed: int, points: int) -> None:
        import drjit as dr
        import mitsuba as mi

        self.index = dr.arange(mi.UInt32, points)
        self.generator = mi.UInt32(generating_vector(dimensions))
        self.shift = mi.UInt32(np.random.default_rng(seed).integers(0, 1 << 32, dimensions,
                                                                    dtype=np.uint32))

    def integer(self, dimension: Any) -> Any:
        """Coordinate times 2^32 of every point.

        Parameters
        ----------
        dimension : UInt32
            One for all points, or one for each.
        """
        import drjit as dr
        import mitsuba as mi

        return (dr.brev(self.index) * dr.gather(mi.UInt32, self.generator, dimension)
                + dr.gather(mi.UInt32, self.shift, dimension))

    def pair(self, dimension: Any) -> Any:
        """Two coordinates of every point in [0, 1).

        Parameters
        ----------
        dimension : UInt32
            Of the first; the second is the next. One for all points, or one for each.
        """
        import mitsuba as mi

        scale = 2.0**-24  # 24 bits, as many as a float32 holds: 32 could round up to 1
        return mi.Point2f(mi.Float(self.integer(dimension) >> 8) * scale,
                          mi.Float(self.integer(dimension + 1) >> 8) * scale)


def generating_vector(dimensions: int) -> np.ndarray:
    """Components of the generating vector, all odd.

    Odd numbers drawn once follow those of the published vector. They belong to bounces beyond the
    sixteenth, where little light is left.

    Parameters
    ----------
    dimensions : int

    Returns
    -------
    (dimensions,) uint32
    """
    drawn = np.random.default_rng(1).integers(0, 1 << 31,
                                              max(dimensions - len(GENERATOR), 0)) * 2 + 1
    return np.r_[np.array(GENERATOR, dtype=np.uint32), drawn.astype(np.uint32)][:dimensions]
