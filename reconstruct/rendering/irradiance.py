"""Irradiance on each patch of a chart of known pose and light (paper Eq. 17, for any emitter)."""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.reconstruct.rendering.renderer import load_scene
from spectrabox.reconstruct.scene.light_profile import relative_radiance
from spectrabox.reconstruct.scene.scene_file import SceneFile
from spectrabox.reconstruct.scene.scene_xml import scene_xml

CHART_SHAPE = "chart"
SAMPLED_PART = 0.5       # of a patch's side, as the photo is sampled
SAMPLES = 4096           # light directions per patch
TINY = 1e-300


def patch_irradiance(scene_file: SceneFile, centres_uv: np.ndarray, sizes_uv: np.ndarray,
                     seed: int = 0) -> np.ndarray:
    """Irradiance (I,) in the centre of each patch, for an emitter whose spectrum is 1.

    The spectrum is that of its radiance, or intensity.

    Parameters
    ----------
    scene_file : SceneFile
        Holds the light and a rectangle with the id "chart". Its (u, v) = (0, 1) is the
        corner at the first patch (dark skin) and (1, 1) that at the end of the first row (bluish
        green), so v falls from row to row.
    centres_uv : (I, 2) array
        Centres of the patches as fractions of width and height from the corner at the first patch.
    sizes_uv : (I, 2) or (2,) array
        Width and height of each patch, or of all, in the same fractions.
    seed : int
        Of the points and directions that are drawn.

    Raises
    ------
    InputError
        If the scene has no such shape, or the light does not reach it.
    """
    irradiance = _sampled(scene_file, centres_uv, sizes_uv, seed, ())[0]
    if not np.all(irradiance > 0):
        raise InputError(f"{scene_file.path.name}: the light does not reach "
                         f"{np.count_nonzero(irradiance <= 0)} of the {len(centres_uv)} patches; "
                         "turn the chart's rectangle to face the light")
    return irradiance


def lamp_position_error(scene_file: SceneFile, centres_uv: np.ndarray,
                        sizes_uv: np.ndarray, position_error: float,
                        seed: int = 0) -> float:
    """Relative standard error of the light on the chart by that of the lamp's position.

    By finite differences: the chart is moved by one standard error along each axis under the same
    light directions. What all patches have in common counts; their differences show in the chart's
    residuals.

    Parameters
    ----------
    scene_file, centres_uv, sizes_uv, seed
        As of ``patch_irradiance``.
    position_error : float
        Standard error of the position along each axis, relative to the distance of lamp and chart.
    """
    if position_error == 0:
        return 0.0
    still, *moved = _sampled(scene_file, centres_uv, sizes_uv, seed, position_error * np.eye(3))
    changes = [np.log(np.maximum(one, TINY) / still).mean() for one in moved]
    return float(np.linalg.norm(changes))


def _sampled(scene_file: SceneFile, centres_uv: np.ndarray, sizes_uv: np.ndarray,
             seed: int, shifts: np.ndarray | tuple[()]) -> list[np.ndarray]:
    """Irradiance (I,) on the patches as they lie, then shifted by each row of ``shifts``, along
    the chart's tangents and its normal, as shares of the lamp's distance.
    """
    import mitsuba as mi

    if CHART_SHAPE not in scene_file.surfaces:
        raise InputError(f"{scene_file.path.name} has no shape with the id {CHART_SHAPE!r}: "
                         "place a rectangle of the chart's size where the chart was, with that id")
    ones = np.ones(2)
    scene = load_scene(scene_xml(scene_file, reflectances=dict.fromkeys(scene_file.bsdf_ids, ones),
                                 light=ones, bands={"one": ones}, range_nm=(400.0, 700.0),
                                 size=(4, 4), integrator="path"))
    shape = next(shape for shape in scene.shapes() if shape.id() == CHART_SHAPE)
    rng = np.random.default_rng(seed)
    offset = (rng.random((len(centres_uv), SAMPLES, 2)) - 0.5) \
        * SAMPLED_PART * sizes_uv.reshape(-1, 1, 2)
    uv = (centres_uv[:, None] + offset).reshape(-1, 2)
    interaction = shape.eval_parameterization(mi.Point2f(uv[:, 0], 1.0 - uv[:, 1]))
    interaction.wavelengths = mi.Spectrum(550.0)
    numbers = mi.Point2f(rng.random(len(uv)), rng.random(len(uv)))

    def irradiance() -> tuple[np.ndarray, float]:
        direction, weight = scene.sample_emitter_direction(interaction, numbers, True)
        normal, towards = interaction.n, direction.d
        cosine = np.maximum(np.array(mi.Float(normal.x * towards.x + normal.y * towards.y
                                              + normal.z * towards.z)), 0.0)
        value = np.array(weight[0]) * _profile(scene, scene_file.profiles, direction) * cosine
        distance = float(np.median(np.array(direction.dist)))
        return value.reshape(len(centres_uv), SAMPLES).mean(axis=1), distance

    still, distance = irradiance()
    results, start = [still], mi.Point3f(interaction.p)
    frame = mi.Frame3f(interaction.n)
    for along_s, along_t, along_n in np.asarray(shifts) * distance:
        # outwards along the normal: behind the card nothing is lit
        interaction.p = start + along_s * frame.s + along_t * frame.t + along_n * frame.n
        results.append(irradiance()[0])
    return results


def _profile(scene: Any, profiles: Mapping[str, np.ndarray], direction: Any) -> np.ndarray:
    """Relative radiance of the light that each direction was sampled from, by the angle at which it
    leaves.
    """
    import drjit as dr
    import mitsuba as mi

    cosine = -np.array(dr.dot(direction.d, direction.n))
    number = np.array(dr.reinterpret_array(mi.UInt32, direction.emitter))
    factor = np.ones(cosine.size)
    for emitter in scene.emitters():
        shape = emitter.get_shape()
        if shape is not None and shape.id() in profiles:
            mine = number == np.array(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(emitter)))
            factor[mine] = relative_radiance(profiles[shape.id()], cosine[mine])
    return factor
