"""Trace the light of a scene once, without any spectrum (docs/explanation/reconstruction.md).

A path tracer with unit reflectances and unit lights carries along each path the product of
reflectances encountered, and adds its contribution to (region, light, product). Every rendering,
gradient or posterior sample is then a small matrix product (radiometry/interreflection.py). The
paths are drawn in independent passes, kept separately for their scatter.
"""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.interreflection import exponents_up_to, product_count, prune
from spectrabox.reconstruct.rendering.renderer import all_cores
from spectrabox.reconstruct.tracer.path_samples import MAX_POINTS
from spectrabox.reconstruct.tracer.path_tracer import Tracer
from spectrabox.reconstruct.tracer.trace_checkpoint import (
    PassSums,
    TraceCheckpoint,
    trace_fingerprint,
)

MAX_BYTES = 2 << 30         # of memory for trace and fit; more is refused before it is allocated
PILOT_PATHS = 1 << 19        # of all regions together, by which products are judged before pruning
BRIGHTEST = 0.9  # reflectance that no material is taken to exceed when products are judged
DROPPED = 1e-4  # share of the pilot's signal, at that reflectance, whose products are dropped
PRUNE_ABOVE = 256            # products: below, pruning saves less than its pilot costs


@dataclass(frozen=True)
class TracedTransport:
    """Transport coefficients of R regions, L lights and E products, in A independent passes of
    equal length.
    """

    materials: tuple[str, ...]
    exponents: np.ndarray        # (E, M)
    passes: np.ndarray           # (A, R, L, E) float32
    spp: int                     # paths per pixel of all passes together, on average
    seed: int
    # share of the signal lost by pruning, were every reflectance 0.9: a bound for darker
    dropped: float

    @property
    def coefficients(self) -> np.ndarray:
        """Mean (R, L E) over the passes, light after light."""
        mean = self.passes.mean(axis=0, dtype=float)
        return mean.reshape(len(mean), -1)

    @property
    def deviations(self) -> np.ndarray:
        """Deviations (A, R, L E) of the passes, scaled so that the sum of their squares is the
        variance of the mean.
        """
        count = len(self.passes)
        flat = self.passes.reshape(count, self.passes.shape[1], -1)
        return (flat - flat.mean(axis=0, dtype=float)) / np.sqrt(count * max(count - 1, 1))

    @property
    def relative_variance(self) -> np.ndarray:
        """Monte Carlo variance (R,) of the signal that reflectances of 0.5 would give, relative to
        its square.
        """
        grey = np.tile(0.5 ** self.exponents.sum(axis=1), self.passes.shape[2])
        return np.sum((self.deviations @ grey) ** 2, axis=0) / np.maximum(self.coefficients @ grey,
                                                                          1e-30) ** 2


def trace_transport(scene: Any, material_of_bsdf: Mapping[str, str], size: tuple[int, int],
                    region: np.ndarray, *, bounces: int, spp: int, seed: int, passes: int = 4,
                    lights: tuple[tuple[str, ...], ...] | None = None,
                    exponents: np.ndarray | None = None,
                    progress: Callable[[float], None] | None = None,
                    checkpoint: Path | None = None,
                    profiles: Mapping[str, np.ndarray] | None = None) -> TracedTransport:
    """Transport coefficients of every region, for unit reflectances and lights of unit spectrum.

    Thirteen parameters: five describe the open scene and are passed on as they are, the others are
    options of the trace and go by keyword.

    Parameters
    ----------
    scene : mi.Scene
        Loaded with ``optimize=False``, its reflectances and light spectra 1.
    material_of_bsdf : mapping
        From BSDF id to material name; BSDFs that reflect nothing (lamps) need no entry.
    size : (width, height) of the film in pixels
    region : (H, W) int
        Region 0 to R-1 of each pixel, -1 where it is not wanted. Regions receive the mean over
        their pixels.
    bounces : int
        Most reflections along a path; Mitsuba's ``max_depth`` less one.
    spp : int
        Paths per pixel in all passes together, at the least: each pass draws a power of two.
    passes : int
        Independent passes A that are kept separately; their scatter is the Monte Carlo noise.
    lights : groups of emitter (or light shape) ids, optional
        Each group gets its own coefficients; None puts all lights into one.
    exponents : (E, M) int, optional
        Products to keep; None for all up to ``bounces``, pruned where there are many.
    checkpoint : Path, optional
        File for what has been traced so far. A trace that was stopped goes on from there when it is
        asked for again, and ends with the same bits; the file is removed then. Another trace's file
        is not used.
    profiles : mapping, optional
        From the id of an area light's shape to its table of ``light_profile.py``.

    Raises
    ------
    InputError
        If the coefficients would not fit into memory, or a BSDF has no material.
    """
    materials = tuple(dict.fromkeys(material_of_bsdf.values()))
    groups = 1 if lights is None else len(lights)
    regions, dropped = int(region.max()) + 1, 0.0
    if exponents is None:
        exponents, dropped = _exponents(scene, material_of_bsdf, materials, size, region, bounces,
                                        seed, lights, profiles)
    require_memory(regions, groups * len(exponents), passes, len(materials), bounces)
    tracer = Tracer(scene, material_of_bsdf, materials, size, region, exponents, lights, profiles)
    count, paths = _schedule(spp, passes, tracer.pixels)
    facts = (sorted(material_of_bsdf.items()), size, lights, list(profiles or ()), bounces, count,
             paths, passes, seed)
    kept = None if checkpoint is None else TraceCheckpoint(
        checkpoint, trace_fingerprint(scene, facts,
                                      (region, exponents, *(profiles or {}).values())))
    sums = (kept and kept.read()) or PassSums(0,
                                              (np.zeros((regions, groups, len(exponents)),
                                                        np.float32),) * passes)
    try:
        with all_cores():
            for number in range(sums.done, count):
                part = tracer.trace(bounces, paths, seed * 1009 + number)
                sums = sums.with_one_more(part * np.float32(passes / count))
                if kept is not None:
                    kept.write_now_and_then(sums)
                if progress is not None:
                    progress((number + 1) / count)
    except BaseException:
        if kept is not None:
            kept.write(sums)
        raise
    if kept is not None:
        kept.remove()
    return TracedTransport(materials, exponents, np.array(sums.passes),
                           round(count * paths / tracer.pixels), seed, dropped)


def joined(first: TracedTransport, second: TracedTransport) -> TracedTransport:
    """Two traces of the same products, each pass of one joined to a pass of the other."""
    spp = first.spp + second.spp
    passes = (first.passes * np.float32(first.spp / spp)
              + second.passes * np.float32(second.spp / spp))
    return TracedTransport(first.materials, first.exponents, passes, spp, first.seed, first.dropped)


def shaded_image(scene: Any, material_of_bsdf: Mapping[str, str], size: tuple[int, int],
                 exponents: np.ndarray, signals: np.ndarray, *, bounces: int, spp: int, seed: int,
                 lights: tuple[tuple[str, ...], ...] | None = None,
                 profiles: Mapping[str, np.ndarray] | None = None) -> np.ndarray:
    """Image (H, W, K) of the scene once the signals (L E, K) of its products are known.

    The same paths as in ``trace_transport``, and its parameters; every band of every path is exact,
    so there is no noise of colour.
    """
    width, height = size
    region = np.arange(width * height).reshape(height, width)
    tracer = Tracer(scene, material_of_bsdf, tuple(dict.fromkeys(material_of_bsdf.values())), size,
                    region, exponents, lights, profiles)
    count, paths = _schedule(spp, 1, region.size)
    with all_cores():
        passes = [tracer.trace(bounces, paths, seed * 1013 + number, signals)
                  for number in range(count)]
    image = np.mean(passes, axis=0)
    return image.reshape(height, width, signals.shape[1]).astype(float)


def require_memory(regions: int, products: int, passes: int, materials: int, bounces: int) -> None:
    """Refuse a trace whose coefficients would not fit.

    A coefficient takes 4 bytes in each pass and 8 in each deviation and in the mean, or 28 while a
    pass is traced.

    Raises
    ------
    InputError
        Saying how large it would be and what makes it smaller.
    """
    needed = regions * products * max(12 * passes + 8, 4 * passes + 28)
    if needed > MAX_BYTES:
        raise InputError(
            f"the light transport of {regions} regions and {products} products of {materials} "
            f"reflectances ({product_count(materials, bounces)} before pruning) needs "
            f"{needed / 2**30:.1f} GiB, more than the {MAX_BYTES / 2**30:.0f} GiB set aside; "
            "lower [reconstruct] width or the scene's max_depth")


def _exponents(scene: Any, material_of_bsdf: Mapping[str, str], materials: tuple[str, ...],
               size: tuple[int, int], region: np.ndarray, bounces: int, seed: int,
               lights: tuple[tuple[str, ...], ...] | None,
               profiles: Mapping[str, np.ndarray] | None) -> tuple[np.ndarray, float]:
    """Products up to ``bounces``, pruned where they are many, and the share of the signal that is
    lost at most.

    One pilot picks the products, another says what is lost: the first has never encountered most of
    what it drops.
    """
    exponents = exponents_up_to(len(materials), bounces)
    if len(exponents) <= PRUNE_ABOVE:
        return exponents, 0.0
    tracer = Tracer(scene, material_of_bsdf, materials, size, np.where(region >= 0, 0, -1),
                    exponents, lights, profiles)
    with all_cores():
        picking, judging = (tracer.trace(bounces, PILOT_PATHS, seed + draw).sum(axis=1)
                            for draw in (104729, 130363))
    kept, _ = prune(exponents, picking, BRIGHTEST, DROPPED)
    bound = judging.sum(axis=0) * BRIGHTEST ** exponents.sum(axis=1)
    return exponents[kept], float(bound[~kept].sum() / bound.sum())


def _schedule(spp: int, passes: int, pixels: int) -> tuple[int, int]:
    """Number of passes, a multiple of ``passes``, and paths of each: a power of two, within the
    lattice.
    """
    paths = 1 << max(int(np.ceil(np.log2(max(spp * pixels / passes, 1)))), 10)
    return passes * max(paths // MAX_POINTS, 1), min(paths, MAX_POINTS)
