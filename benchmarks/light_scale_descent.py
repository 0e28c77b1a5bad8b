"""The light's scale by gradient descent through Mitsuba, as in the paper (Sec. 4.3), beside the
closed form.

The chart is rendered with its 24 reflectances in the place of the scene's rectangle "chart", in the
camera's bands, and one factor on every light follows Adam. The signal is linear in that factor, so
``radiometry.light_scale`` has the same answer in closed form; this one shares no irradiance with it
and serves as its check.
"""
from __future__ import annotations

import copy
import dataclasses
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.light_scale import scale_from_signals
from spectrabox.radiometry.records import LightScale, WavelengthGrid
from spectrabox.reconstruct.engines.gradient import cosine_rate
from spectrabox.reconstruct.rendering.irradiance import CHART_SHAPE
from spectrabox.reconstruct.rendering.renderer import load_scene
from spectrabox.reconstruct.scene.elsewhere import EMITTED
from spectrabox.reconstruct.scene.scene_file import SceneFile
from spectrabox.reconstruct.scene.scene_xml import scene_xml
from spectrabox.reconstruct.scene.surfaces import surface_map

FILM = 32               # pixels: a patch of the printed chart is 4 x 6 of them
HEIGHT = 1e-3           # of the camera over the chart, in chart widths: nothing comes between them
STEPS, SPP = 120, 16
LEARNING_RATE = 0.03    # of the factor's logarithm
START = 0.8             # of the factor that the summed signals ask for: the descent has a way to go
TAIL = 0.25


def scale_by_descent(scene_file: SceneFile, centres_uv: np.ndarray, size_uv: np.ndarray,
                     grid: WavelengthGrid, reflectances: np.ndarray, light: np.ndarray,
                     sensitivities: np.ndarray, measured: np.ndarray, relative_error: float, *,
                     steps: int = STEPS, spp: int = SPP, seed: int = 0) -> LightScale:
    """Factor from the rendered chart to the photo's patches, with its standard error.

    Twelve parameters: nine say what was photographed and how, three have defaults.

    Parameters
    ----------
    scene_file : SceneFile
        Holds the light and a rectangle with the id "chart", as ``patch_irradiance`` wants it.
    centres_uv : (24, 2) array
        Centres of the patches as fractions of width and height from the dark-skin corner.
    size_uv : (2,) array
        Width and height of a patch in the same fractions.
    reflectances : (24, P) array
    light : (P,) array
        Radiance (or intensity) spectrum of every light.
    sensitivities : (K, P) array
    measured : (24, K) signal
        Each known to ``relative_error``.

    Raises
    ------
    InputError
        If the scene has no such rectangle, or no light reaches it.
    """
    import drjit as dr
    import mitsuba as mi

    patches = chart_in_place(scene_file, centres_uv, size_uv)
    names = tuple(f"patch_{number:02d}" for number in range(len(centres_uv)))
    paints = [patches.surfaces[name] for name in names]
    spectra = (dict.fromkeys(patches.bsdf_ids, np.full(light.shape, 0.5))
               | dict(zip(paints, reflectances, strict=True)))
    scene = load_scene(scene_xml(patches, reflectances=spectra, light=light, size=(FILM, FILM),
                                 bands={f"{band:03d}": curve for band,
                                        curve in enumerate(sensitivities)},
                                 range_nm=(float(grid.nm[0]), float(grid.nm[-1]))))
    pixels, count = _pixels_of_patches(scene, names, measured.shape[1])
    parameters = mi.traverse(scene)
    keys = [key for key in parameters.keys()  # noqa: SIM118 - not a dict
            if key.endswith(tuple(f".{name}.values" for name in set(EMITTED.values())))]
    parameters.keep(keys)
    unscaled = {key: mi.Float(parameters[key]) for key in keys}

    def patch_means(image: Any) -> Any:
        return dr.block_sum(dr.gather(mi.Float, image.array, pixels), count) / count

    first = np.array(patch_means(mi.render(scene, spp=spp, seed=seed * 100003)))
    if not np.all(first > 0):
        raise InputError(f"{scene_file.path.name}: no light reaches some patches of the chart; "
                         "turn the chart's rectangle to face the light")
    target = mi.Float(measured.ravel().astype(np.float32))
    optimizer = mi.ad.Adam(lr=LEARNING_RATE)
    optimizer["log_scale"] = mi.Float(float(np.log(START * measured.sum() / first.sum())))
    logs, rendered = [], []
    for step in range(steps):
        optimizer.set_learning_rate(LEARNING_RATE * cosine_rate(step / steps))
        scale = dr.exp(optimizer["log_scale"])
        for key in keys:
            parameters[key] = unscaled[key] * scale
        parameters.update()
        draw = 2 * (seed * 100003 + step) + 1
        means = patch_means(mi.render(scene, parameters, spp=spp, seed=draw, seed_grad=draw + 1))
        loss = dr.mean(dr.square((means - target) / target))
        dr.backward(loss)
        logs.append(float(optimizer["log_scale"][0]))
        rendered.append(np.array(means) / np.exp(logs[-1]))
        optimizer.step()
    tail = slice(-max(int(TAIL * steps), 1), None)
    value = float(np.exp(np.mean(logs[tail])))
    predicted = np.mean(rendered, axis=0, dtype=float).reshape(measured.shape)
    # The error of the minimum is that of the parabola around it; its rendering is the mean over all
    # steps.
    error = scale_from_signals(measured, predicted, relative_error, "").standard_error
    return LightScale(value, error, 1 - value * predicted / measured,
                      "chart photo, by descent through the renderer")


def chart_in_place(scene_file: SceneFile, centres_uv: np.ndarray,
                   size_uv: np.ndarray) -> SceneFile:
    """The scene with one rectangle per patch, ``patch_00`` on, where "chart" was, and a camera that
    sees just them.

    Only direct light counts. The camera is orthographic: how a diffuse chart is seen does not
    matter.
    """
    if CHART_SHAPE not in scene_file.surfaces:
        raise InputError(f"{scene_file.path.name} has no shape with the id {CHART_SHAPE!r}: "
                         "place a rectangle of the chart's size where the chart was, with that id")
    chart_to_world = _to_world(scene_file)
    root = copy.deepcopy(scene_file.root)
    for node in [node for node in root if node.tag == "sensor" or node.get("id") == CHART_SHAPE]:
        root.remove(node)
    width = np.linalg.norm(chart_to_world[:3, 0])
    normal = np.cross(chart_to_world[:3, 0], chart_to_world[:3, 1])
    camera = chart_to_world @ np.diag([-1.0, 1.0, 1.0, 1.0])  # x to the left, z into the chart
    camera[:3, 2] = -normal / np.linalg.norm(normal)
    camera[:3, 3] -= 2 * HEIGHT * width * camera[:3, 2]
    sensor = ET.Element("sensor", type="orthographic")
    ET.SubElement(sensor, "float", name="near_clip", value=f"{HEIGHT * width:.9g}")
    _matrix(sensor, camera)
    root.insert(0, sensor)
    bsdf_of_patch = {}
    for number, (u, v) in enumerate(centres_uv):
        patch, paint = f"patch_{number:02d}", f"paint_{number:02d}"
        bsdf = ET.SubElement(root, "bsdf", type="diffuse", id=paint)
        ET.SubElement(bsdf, "spectrum", name="reflectance", value="0.5")
        shape = ET.SubElement(root, "shape", type="rectangle", id=patch)
        ET.SubElement(shape, "ref", id=paint)
        bsdf_of_patch[patch] = paint
        pose = np.diag([size_uv[0], size_uv[1], 1.0, 1.0])
        pose[:2, 3] = 2 * u - 1, 1 - 2 * v
        _matrix(shape, chart_to_world @ pose)
    others = {shape: bsdf for shape, bsdf in scene_file.surfaces.items() if shape != CHART_SHAPE}
    return dataclasses.replace(scene_file, root=root, max_depth=2,
                               bsdf_ids=(*scene_file.bsdf_ids, *bsdf_of_patch.values()),
                               surfaces=others | bsdf_of_patch)


def _to_world(scene_file: SceneFile) -> np.ndarray:
    import mitsuba as mi

    ones = np.ones(2)
    scene = load_scene(scene_xml(scene_file, reflectances=dict.fromkeys(scene_file.bsdf_ids, ones),
                                 light=ones, bands={"one": ones}, range_nm=(400.0, 700.0),
                                 size=(4, 4), integrator="path"))
    return np.array(mi.traverse(scene)[f"{CHART_SHAPE}.to_world"].matrix, dtype=float).reshape(4, 4)


def _matrix(node: ET.Element, matrix: np.ndarray) -> None:
    transform = ET.SubElement(node, "transform", name="to_world")
    ET.SubElement(transform, "matrix", value=" ".join(f"{value:.9g}" for value in matrix.ravel()))


def _pixels_of_patches(scene: Any, names: tuple[str, ...], bands: int) -> tuple[Any, int]:
    """Indices into the flat image, patch by patch and band by band, and the number of each."""
    import mitsuba as mi

    surface = surface_map(scene, names, (FILM, FILM)).ravel()
    pixels = [np.flatnonzero(surface == patch) for patch in range(len(names))]
    count = min(len(own) for own in pixels)
    if count == 0:
        raise InputError("the chart's rectangle faces away from its own patches, or another shape "
                         "covers them; let nothing lie on the rectangle \"chart\"")
    chosen = np.array([own[np.linspace(0, len(own) - 1, count).astype(int)] for own in pixels])
    return mi.UInt32((chosen[:, None, :] * bands + np.arange(bands)[None, :, None]).ravel()), count
