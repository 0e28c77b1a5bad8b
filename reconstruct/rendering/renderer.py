"""The only module that starts Mitsuba: it picks the variant, loads a scene, renders it in bands,
and gives the irradiance on a chart.

The only module that starts Mitsuba: it picks the variant, loads a scene, renders it in bands.

One variant per process; nothing of Mitsuba is touched at import time.

A spectral EXR as a texture of Mitsuba, whose own ``bitmap`` knows three channels alone.

    from spectrabox.reconstruct.rendering.renderer import register_spectral_texture
    register_spectral_texture()     # after mi.set_variant("llvm_ad_spectral"), or cuda
    mi.load_dict({"type": "diffuse", "reflectance": {"type": "spectral_picture",
                                                     "filename": "uplifted/mean.exr"}})

Pixels are the nearest, wavelengths interpolated; outside those of the file its ends are held.
"""


from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.spectra.spectral_layers import REFLECTANCE, spectral_layers
from spectrabox.reconstruct.rendering.llvm import ensure_llvm, writable_home
from spectrabox.reconstruct.scene import meshes, plugins, scene_file, stated
from spectrabox.reconstruct.scene.scene_xml import scene_xml

STARTING = threading.Lock()
CPU_VARIANT, GPU_VARIANT = "llvm_ad_spectral", "cuda_ad_spectral"


def start_mitsuba(device: str = "auto") -> ModuleType:
    """Mitsuba with its variant set: ``cuda_ad_spectral`` for "cuda", else ``llvm_ad_spectral``.

    Parameters
    ----------
    device : {"auto", "cpu", "cuda"}
        "auto" is the CPU, which all results were measured on; a GPU is untested.

    Raises
    ------
    EnvironmentProblem
        If there is no usable LLVM, or no GPU although one was asked for.
    """
    if device != "cuda":
        ensure_llvm()  # before drjit is imported: it reads the variable once
    with STARTING, writable_home():
        import drjit as dr
        import mitsuba as mi

        if device == "cuda" and not dr.has_backend(dr.JitBackend.CUDA):
            raise EnvironmentProblem("a GPU was asked for, but no CUDA device can be used here; "
                                     "leave out --device cuda, or check the driver with nvidia-smi")
        variant = GPU_VARIANT if device == "cuda" else CPU_VARIANT
        if mi.variant() not in (None, variant):
            raise EnvironmentProblem(f"this process already renders with {mi.variant()}; start a "
                                     f"new one for {variant}")
        # Mitsuba looks for its plugins and data in the working folder first: diffuse.so would be
        # run that lies in a folder "plugins" of a stranger's session
        file_resolver: Any = mi.file_resolver
        resolver = file_resolver()
        resolver.clear()
        resolver.append(str(Path(mi.__file__).resolve().parent))
        mi.set_variant(variant)
        mi.set_log_level(mi.LogLevel.Error)
        if variant == CPU_VARIANT:
            # with more, gradients are added in the order in which threads end: not reproducible
            dr.set_thread_count(1)
        return mi


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def threads_given_back() -> Iterator[None]:
    """A program that calls the library renders on as it did: with the one thread of
    ``start_mitsuba`` Mitsuba's reader and writer of EXR files would wait for ever.
    """
    drjit = sys.modules.get("drjit")
    before = _cores() if drjit is None else drjit.thread_count()
    try:
        yield
    finally:
        drjit = sys.modules.get("drjit")
        if drjit is not None:
            drjit.set_thread_count(before)


@contextlib.contextmanager
def all_cores() -> Iterator[None]:
    """Work that gives the same bits in any order may use every core of this process."""
    import drjit as dr
    import mitsuba as mi

    if mi.variant() != CPU_VARIANT:
        yield
        return
    before = dr.thread_count()
    # not 1: Mitsuba's reader of EXR files would wait for ever
    dr.set_thread_count(max(_cores(), 2))
    try:
        yield
    finally:
        dr.set_thread_count(before)


def load_scene(xml: str) -> Any:
    """Scene of Mitsuba from XML text; identical placeholder materials are not merged.

    Parameters
    ----------
    xml : str
        Whole scene; files that it names have absolute paths.

    Raises
    ------
    InputError
        If the scene names a plugin that is not on the list of ``plugins.py``, or a mesh whose file
        would end the process; with Mitsuba's own words, if it cannot load the scene.
    """
    import mitsuba as mi

    root = plugins.parse_xml(xml, "the scene")
    plugins.require_harmless(root)
    meshes.require_sound_meshes(root)
    try:
        with all_cores() if ".exr" in xml.lower() else contextlib.nullcontext():
            return mi.load_string(xml, optimize=False)
    except RuntimeError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"Mitsuba cannot load the scene: {reason}") from None


def render(scene: Any, spp: int, seed: int, passes: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Camera signal (H, W, K) for sensitivities and light as loaded, and its Monte Carlo variance.

    ``specfilm`` agrees with the integral of the piecewise-linear spectra within 1e-4
    (tests/test_renderer.py); a trapezoid sum over coarse samples does not, by up to 0.4 %, since
    the product of spectra bends between them.

    Parameters
    ----------
    scene : mi.Scene
    spp : int
        Samples per pixel in all passes together.
    seed : int
        Of the first pass; each pass takes the next.
    passes : int
        Independent passes; their scatter gives the variance. At least 2 for a variance, NaN
        otherwise.
    """
    import mitsuba as mi

    images = np.array([np.array(mi.render(scene, spp=max(spp // passes, 1), seed=seed + number))
                       for number in range(passes)], dtype=np.float64)
    variance = images.var(axis=0, ddof=1) / passes if passes > 1 else np.full(images.shape[1:],
                                                                              np.nan)
    return images.mean(axis=0), variance


# ---- irradiance ----------------------------------------------------------------------------------

CHART_SHAPE = "chart"
SAMPLED_PART = 0.5       # of a patch's side, as the photo is sampled
SAMPLES = 4096           # light directions per patch
TINY = 1e-300


def patch_irradiance(scene_file: scene_file.SceneFile, centres_uv: np.ndarray, sizes_uv: np.ndarray,
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


def lamp_position_error(scene_file: scene_file.SceneFile, centres_uv: np.ndarray,
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


def _sampled(scene_file: scene_file.SceneFile, centres_uv: np.ndarray, sizes_uv: np.ndarray,
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
                                 light=stated.strengths(scene_file), bands={"one": ones},
                                 range_nm=(400.0, 700.0), size=(4, 4), integrator="path"))
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
            factor[mine] = scene_file.relative_radiance(profiles[shape.id()], cosine[mine])
    return factor


# ---- a spectral EXR as a texture of Mitsuba, whose own ``bitmap`` knows three channels alone -----

def register_spectral_texture() -> None:
    """Make the texture known to Mitsuba under ``spectral_picture``; its variant is set before."""
    import drjit as dr
    import mitsuba as mi

    texture: Any = mi.Texture

    class SpectralPicture(texture):
        """Reflectance of a spectral EXR at a surface's texture coordinates."""

        def __init__(self, properties: Any) -> None:
            texture.__init__(self, properties)
            pixels, nm = read_spectral_picture(properties["filename"])
            self.height, self.width, self.count = pixels.shape
            self.first, self.step = float(nm[0]), float(nm[1] - nm[0])
            self.values = mi.Float(np.ascontiguousarray(pixels.ravel(), dtype=np.float32))

        def eval(self, si: Any, active: bool = True) -> Any:
            """Reflectance at the wavelengths of a ray."""
            column = dr.clip(mi.Int32(dr.floor(si.uv.x * self.width)), 0, self.width - 1)
            # v runs upwards, rows downwards
            row = dr.clip(mi.Int32(dr.floor((1 - si.uv.y) * self.height)), 0, self.height - 1)
            start = (row * self.width + column) * self.count
            reflectance = []
            for wavelength in si.wavelengths:
                position = dr.clip((wavelength - self.first) / self.step, 0, self.count - 1)
                below = dr.minimum(mi.Int32(dr.floor(position)), self.count - 2)
                low = dr.gather(mi.Float, self.values, start + below, active)
                high = dr.gather(mi.Float, self.values, start + below + 1, active)
                reflectance.append(dr.lerp(low, high, position - below))
            return mi.UnpolarizedSpectrum(reflectance)

        def mean(self) -> Any:
            """Mean over picture and wavelengths."""
            return dr.mean(self.values)

        def is_spatially_varying(self) -> bool:
            """Whether it differs over a surface."""
            return True

        def to_string(self) -> str:
            """As Mitsuba prints it."""
            return f"SpectralPicture[{self.width} x {self.height}, {self.count} wavelengths]"

    mi.register_texture(plugins.SPECTRAL_PICTURE, lambda properties: SpectralPicture(properties))


def read_spectral_picture(path: str) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (H, W, P) and wavelengths (P,) of the layers T of an EXR file."""
    import mitsuba as mi
    file_resolver: Any = mi.file_resolver       # knows the folder of the file that is loaded
    path = str(file_resolver().resolve(path))
    with all_cores():       # its reader waits for ever where there is one thread
        picture: Any = mi.Bitmap(path)
    names = [field.name for field in picture.struct_()]
    kind, layers = spectral_layers(names, first=REFLECTANCE)
    nm = np.array([wavelength for wavelength, _ in layers])
    if kind != REFLECTANCE or nm.size < 2 or np.ptp(np.diff(nm)) > 1e-6:
        raise InputError(f"{path} holds no layers T of evenly spaced wavelengths, such as "
                         "T.400,000000nm; give a spectral EXR of reflectances")
    pixels = np.array(picture).astype(np.float32)[..., [index for _, index in layers]]
    if not np.all(np.isfinite(pixels)):
        raise InputError(f"{path} has pixels that are not numbers (clipped ones); fill them first")
    return pixels, nm
