"""A scene as the tracer takes it: open, with reflectances and light spectra of 1."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class UnitScene:
    """An open scene of unit reflectances and lights, and what the tracer must know of it.

    Parameters
    ----------
    scene : mi.Scene
        Loaded with ``optimize=False``, its reflectances and light spectra 1.
    material_of_bsdf : mapping
        From BSDF id to material name; BSDFs that reflect nothing (lamps) need no entry.
    size : (width, height) of the film in pixels
    bounces : int
        Most reflections along a path; Mitsuba's ``max_depth`` less one.
    lights : L groups of emitter (or light shape) ids, optional
        Each group gets its own coefficients; None puts all lights into one.
    profiles : mapping, optional
        From the id of an area light's shape to its table of ``light_profile.py``.
    """

    scene: Any
    material_of_bsdf: Mapping[str, str]
    size: tuple[int, int]
    bounces: int
    lights: tuple[tuple[str, ...], ...] | None = None
    profiles: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def materials(self) -> tuple[str, ...]:
        """Names (M) of the materials, in the order of the columns of exponents."""
        return tuple(dict.fromkeys(self.material_of_bsdf.values()))

    @property
    def groups(self) -> int:
        """Number L of light groups."""
        return 1 if self.lights is None else len(self.lights)
