"""The only module that starts Mitsuba: it picks the variant, loads a scene, renders it in bands.

One variant per process; nothing of Mitsuba is touched at import time.
"""
from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.reconstruct.rendering.llvm import ensure_llvm, writable_home
from spectrabox.reconstruct.scene import meshes, plugins

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


@contextlib.contextmanager
def all_cores() -> Iterator[None]:
    """Work that gives the same bits in any order may use every core of this process."""
    import drjit as dr
    import mitsuba as mi

    if mi.variant() != CPU_VARIANT:
        yield
        return
    before = dr.thread_count()
    cores = (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity")
             else os.cpu_count() or 1)
    dr.set_thread_count(max(cores, 2))  # not 1: Mitsuba's reader of EXR files would wait for ever
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
