"""Sums of what paths contribute, as integers, whose sum does not depend on the order.

The same seed therefore gives the same bits on any number of threads.
"""
from __future__ import annotations

from typing import Any

import numpy as np


class Contributions:
    """Sums by region, light group and product of reflectances; or by region and band.

    Parameters
    ----------
    regions, groups, products : int
        R, L and E.
    light : UInt32 array or None
        Light group by the renderer's number of the emitter; None puts all into one.
    signals : (L E, K) array or None
        Of the products: given, the sums are by band.
    bits : int
        Each contribution is rounded to a multiple of 2^-bits.
    """

    def __init__(self, regions: int, groups: int, products: int, light: Any,
                 signals: np.ndarray | None, bits: int) -> None:
        import drjit as dr
        import mitsuba as mi

        self.regions, self.groups, self.products, self.light = regions, groups, products, light
        self.bands = None if signals is None else signals.shape[1]
        self.signals = None if signals is None else mi.Float(signals.astype(np.float32).ravel())
        self.columns = groups * products if self.bands is None else self.bands
        self.bits, self.unit = bits, dr.opaque(mi.Float, 2.0**bits)
        self.buffer = dr.zeros(mi.Int64, regions * self.columns)

    def add(self, region: Any, contribution: Any, emitter: Any, product: Any, active: Any) -> None:
        """Add a contribution of each active path.

        Parameters
        ----------
        region : UInt32
            0 to R-1.
        contribution : Float
            Light that arrives with reflectances of 1; 0 and less is left out.
        emitter : EmitterPtr
            Whose light it is.
        product : UInt32
            Reflectances encountered, 0 to E-1; others are left out.
        active : Bool
        """
        import drjit as dr
        import mitsuba as mi

        group = mi.UInt32(0)
        if self.light is not None:
            number: Any = dr.reinterpret_array(mi.UInt32, emitter)
            group = dr.gather(mi.UInt32, self.light, number, active)
        active = active & (contribution > 0) & (product < self.products) & (group < self.groups)
        term = group * self.products + product
        if self.bands is None:
            dr.scatter_reduce(dr.ReduceOp.Add, self.buffer,
                              mi.Int64(dr.round(contribution * self.unit)),
                              region * self.columns + term, active)
            return
        for band in range(self.bands):
            signal = dr.gather(mi.Float, self.signals, term * self.bands + band, active)
            dr.scatter_reduce(dr.ReduceOp.Add, self.buffer,
                              mi.Int64(dr.round(contribution * signal * self.unit)),
                              region * self.columns + band, active)

    def values(self) -> np.ndarray:
        """The sums (R, L E) or (R, K)."""
        return np.array(self.buffer).reshape(self.regions, -1) * 2.0**-self.bits
