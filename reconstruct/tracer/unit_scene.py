"""A scene as the tracer takes it: open, with reflectances and light spectra of 1.

With tables from the renderer's numbers of BSDFs and emitters to what a traced path needs.
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.scene.beam import Beam
from spectrabox.reconstruct.scene.scene_file import TABLE_DEG

# of Mitsuba's emitters: the one whose radiance comes from a picture
SKY_MAP_CLASS = "EnvironmentMapEmitter"


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
    beam : Beam, optional
        Of every lamp, besides its profile.
    """

    scene: Any
    material_of_bsdf: Mapping[str, str]
    size: tuple[int, int]
    bounces: int
    lights: tuple[tuple[str, ...], ...] | None = None
    profiles: Mapping[str, np.ndarray] = field(default_factory=dict)
    beam: Beam | None = None

    @property
    def materials(self) -> tuple[str, ...]:
        """Names (M) of the materials, in the order of the columns of exponents."""
        return tuple(dict.fromkeys(self.material_of_bsdf.values()))

    @property
    def groups(self) -> int:
        """Number L of light groups."""
        return 1 if self.lights is None else len(self.lights)


def bsdf_table(scene: Any, material_of_bsdf: Mapping[str, str],
               materials: tuple[str, ...]) -> np.ndarray:
    """Material index by the renderer's number of the BSDF; M where a BSDF reflects nothing.

    Parameters
    ----------
    scene : mi.Scene
    material_of_bsdf : mapping
        From BSDF id to material name.
    materials : M names

    Raises
    ------
    InputError
        If a BSDF that reflects light has no material.
    """
    import drjit as dr
    import mitsuba as mi

    bsdfs = list(dict.fromkeys(shape.bsdf() for shape in scene.shapes()))
    numbers = np.array(dr.reinterpret_array(mi.UInt32, mi.BSDFPtr(bsdfs)))
    table = np.full(numbers.max() + 1, len(materials), dtype=np.uint32)
    for bsdf, number in zip(bsdfs, numbers, strict=True):
        if bsdf.id() in material_of_bsdf:
            table[number] = materials.index(material_of_bsdf[bsdf.id()])
            continue
        hit: Any = mi.SurfaceInteraction3f()
        hit.wavelengths, hit.wi = mi.Spectrum(550.0), mi.Vector3f(0.0, 0.0, 1.0)
        if np.any(np.array(bsdf.eval_diffuse_reflectance(hit)) != 0):
            raise InputError(f"the scene's BSDF {bsdf.id()!r} has no material: every surface needs "
                             "one, since light that it reflects reaches all the others")
    return table


def profile_table(scene: Any, profiles: Mapping[str, np.ndarray]) -> np.ndarray:
    """Profiles, one after the other, by the renderer's number of the emitter; 1 without a profile.

    Mitsuba multiplies a map of the sky by its D65, which is divided out at the wavelength of the
    paths.

    Parameters
    ----------
    scene : mi.Scene
    profiles : mapping
        From the id of an area light's shape to its table of ``light_profile.py``.

    Returns
    -------
    (numbers * 181,) float32
    """
    import drjit as dr
    import mitsuba as mi

    daylight: Any = dr.zeros(mi.SurfaceInteraction3f)
    daylight.wavelengths = scene.sensors()[0].sample_ray(0.0, 0.5, mi.Point2f(0.5),
                                                         mi.Point2f(0.5))[0].wavelengths
    d65 = float(np.array(mi.load_dict({"type": "d65"}).eval(daylight)[0]).item())

    numbers = np.array(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(scene.emitters())))
    table = np.ones((numbers.max() + 1, TABLE_DEG.size), dtype=np.float32)
    for emitter, number in zip(scene.emitters(), numbers, strict=True):
        shape = emitter.get_shape()
        if shape is not None and shape.id() in profiles:
            table[number] = profiles[shape.id()]
        elif emitter.class_name() == SKY_MAP_CLASS:
            table[number] = 1 / d65
    return table.ravel()


def light_table(scene: Any, lights: tuple[tuple[str, ...], ...]) -> np.ndarray:
    """Light group by the renderer's number of the emitter; L where an emitter is in none.

    Parameters
    ----------
    scene : mi.Scene
    lights : L groups of ids of emitters or of their shapes
    """
    import drjit as dr
    import mitsuba as mi

    emitters = scene.emitters()
    numbers = np.array(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(emitters)))
    table = np.full(numbers.max() + 1, len(lights), dtype=np.uint32)
    for emitter, number in zip(emitters, numbers, strict=True):
        shape = emitter.get_shape()
        names = {emitter.id(), shape.id() if shape is not None else emitter.id()}
        for group, members in enumerate(lights):
            if names & set(members):
                table[number] = group
    return table
