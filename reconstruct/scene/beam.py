"""The beam of a small lamp: how strongly it shines into each direction about an axis.

    log intensity = a . (x, y, x^2, xy, y^2)

x and y are the components of the direction across the axis, so that all directions have a value.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

TERMS = 5
PRIOR = np.array([0.5, 0.5, 0.7, 0.7, 0.7])     # standard deviations of the coefficients


@dataclass(frozen=True, eq=False)
class Beam:
    """A beam about an axis; coefficients of 0 are an even lamp."""

    axis: np.ndarray            # (3,) unit vector, from the lamp
    coefficients: np.ndarray    # (5,)

    @property
    def across(self) -> tuple[np.ndarray, np.ndarray]:
        """Two unit vectors (3,) across the axis and each other."""
        helper = np.eye(3)[np.argmin(np.abs(self.axis))]
        first = np.cross(self.axis, helper)
        first /= np.linalg.norm(first)
        return first, np.cross(self.axis, first)

    def intensity(self, direction: Any) -> Any:
        """Relative intensity, 1 along the axis.

        Parameters
        ----------
        direction : mi.Vector3f, or (3, n) array
            Unit vectors, from the lamp.
        """
        x, y = (sum(float(part) * direction[index] for index, part in enumerate(axis))
                for axis in self.across)
        a = [float(value) for value in self.coefficients]
        exponent = a[0] * x + a[1] * y + a[2] * x * x + a[3] * x * y + a[4] * y * y
        if isinstance(exponent, np.ndarray):
            return np.exp(exponent)
        import drjit as dr
        return dr.exp(exponent)
