"""Trace the light of a scene once, without any spectrum (docs/explanation/reconstruction.md).

A path tracer with unit reflectances and unit lights carries along each path the product of
reflectances encountered, and adds its contribution to (region, light, product). Every rendering,
gradient or posterior sample is then a small matrix product (radiometry/interreflection.py). The
paths are drawn in independent passes, kept separately for their scatter.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from spectrabox.radiometry import errors, interreflection
from spectrabox.radiometry.system.archives import free_memory
from spectrabox.reconstruct.rendering.renderer import all_cores
from spectrabox.reconstruct.tracer import path_tracer, trace_checkpoint, unit_scene

MAX_BYTES = 2 << 30         # of memory for trace and fit; more is refused before it is allocated
PILOT_PATHS = 1 << 19        # of all regions together, by which products are judged before pruning
PILOT_ENTRIES = 1 << 24      # of a pilot's paths times their vertices
BRIGHTEST = 0.9  # reflectance that no material is taken to exceed when products are judged
# Shares of the pilot's signal, at that reflectance, whose products are dropped: the first that
# leaves no more than MAX_TERMS products times materials, whose fit takes about a minute.
DROPPED = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
MAX_TERMS = 200_000
MAX_IMAGE_COEFFICIENTS = 1 << 23  # of all pixels of a picture, 28 bytes each while traced
PRUNE_ABOVE = 512            # products: below, pruning saves less than its pilots cost


@dataclass(frozen=True)
class TracedTransport:
    """Transport coefficients of R regions, L lights and E products, in A independent passes.

    The passes have as many paths each.
    """

    exponents: np.ndarray        # (E, M)
    passes: np.ndarray           # (A, R, L, E) float32
    spp: int                     # paths per pixel of all passes together, on average
    # share of the signal lost by pruning, were every reflectance 0.9: a bound for darker
    dropped: float

    @property
    def coefficients(self) -> np.ndarray:
        """Mean (R, L E) over the passes, light after light."""
        mean = self.passes.mean(axis=0, dtype=float)
        return mean.reshape(len(mean), -1)

    @property
    def deviations(self) -> np.ndarray:
        """Deviations (A, R, L E) of the passes; their squares sum to the variance of the mean."""
        count = len(self.passes)
        flat = self.passes.reshape(count, self.passes.shape[1], -1)
        return (flat - flat.mean(axis=0, dtype=float)) / np.sqrt(count * max(count - 1, 1))

    @property
    def relative_variance(self) -> np.ndarray:
        """Monte Carlo variance (R,) of the signal of grey 0.5, relative to the signal's square."""
        grey = np.tile(0.5 ** self.exponents.sum(axis=1), self.passes.shape[2])
        return np.sum((self.deviations @ grey) ** 2, axis=0) / np.maximum(self.coefficients @ grey,
                                                                          1e-30) ** 2


def trace_transport(unit: unit_scene.UnitScene, region: np.ndarray, *, spp: int, seed: int,
                    passes: int = 4, exponents: np.ndarray | None = None,
                    progress: Callable[[float], None] | None = None,
                    checkpoint: Path | None = None) -> TracedTransport:
    """Transport coefficients of every region, for unit reflectances and lights of unit spectrum.

    Parameters
    ----------
    unit : UnitScene
    region : (H, W) int
        Region 0 to R-1 of each pixel, -1 where it is not wanted. Regions receive the mean over
        their pixels.
    spp : int
        Paths per pixel in all passes together, at the least: each pass draws a power of two.
    seed : int
    passes : int
        Independent passes A that are kept separately; their scatter is the Monte Carlo noise.
    exponents : (E, M) int, optional
        Products to keep; None for all up to the scene's bounces, pruned where there are many.
    progress : function of the fraction done, optional
    checkpoint : Path, optional
        File for what has been traced so far. A trace that was stopped goes on from there when it is
        asked for again, and ends with the same bits; the file is removed then. Another trace's file
        is not used.

    Raises
    ------
    InputError
        If the coefficients would not fit into memory, or a BSDF has no material.
    """
    dropped = 0.0
    if exponents is None:
        exponents, dropped = kept_products(unit, region, seed)
    shape = int(region.max()) + 1, unit.groups, len(exponents)
    require_memory(shape[0], shape[1] * shape[2], passes, len(unit.materials), unit.bounces)
    tracer = path_tracer.Tracer(unit, region, exponents)
    count, paths = _schedule(spp, passes, tracer.pixels)
    facts = (sorted(unit.material_of_bsdf.items()), unit.size, unit.lights, list(unit.profiles),
             unit.bounces, count, paths, passes, seed)
    kept = None if checkpoint is None else trace_checkpoint.TraceCheckpoint(
        checkpoint,
        trace_checkpoint.trace_fingerprint(unit.scene, facts,
                                           (region, exponents, *unit.profiles.values())))
    sums = (kept and kept.read()) or trace_checkpoint.PassSums(
        0, (np.zeros(shape, np.float32), ) * passes)
    try:
        with all_cores():
            for number in range(sums.done, count):
                part = tracer.trace(paths, seed * 1009 + number)
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
    return TracedTransport(exponents, np.array(sums.passes), round(count * paths / tracer.pixels),
                           dropped)


def joined(first: TracedTransport, second: TracedTransport) -> TracedTransport:
    """Two traces as one, each pass of the first joined to a pass of the second.

    Parameters
    ----------
    first, second : TracedTransport
        Of the same regions, products and number of passes, with different seeds.
    """
    spp = first.spp + second.spp
    passes = (first.passes * np.float32(first.spp / spp)
              + second.passes * np.float32(second.spp / spp))
    return TracedTransport(first.exponents, passes, spp, first.dropped)


def images_of_signals(unit: unit_scene.UnitScene, exponents: np.ndarray, *, spp: int, seed: int,
                      passes: int) -> Callable[[np.ndarray], np.ndarray]:
    """The images (A, H, W, K) of the scene as a function of the signals of its products: those of
    ``shaded_images``, to round-off.

    The paths are followed once, however many images are asked for, where the coefficients of all
    pixels fit into ``MAX_IMAGE_COEFFICIENTS``; otherwise every time. Parameters as of
    ``shaded_images``.
    """
    width, height = unit.size
    if passes * width * height * unit.groups * len(exponents) > MAX_IMAGE_COEFFICIENTS:
        return partial(shaded_images, unit, exponents, spp=spp, seed=seed, passes=passes)
    coefficients = _pixel_means(unit, exponents, spp, seed, passes)

    def images(signals: np.ndarray) -> np.ndarray:
        # Not @: BLAS splits its sums by the number of cores.
        bands = np.einsum("are,ek->ark", coefficients, signals)
        return bands.reshape(passes, height, width, signals.shape[1])
    return images


def shaded_images(unit: unit_scene.UnitScene, exponents: np.ndarray, signals: np.ndarray, *,
                  spp: int, seed: int, passes: int = 1) -> np.ndarray:
    """Independent images (A, H, W, K) of the scene once the signals of its products are known.

    Paths are drawn as in ``trace_transport``; every band of every path is exact, so there is no
    noise of colour.

    Parameters
    ----------
    unit : UnitScene
    exponents : (E, M) int
        Products of reflectances; light of others is left out.
    signals : (L E, K) array
        Of the products, light group after light group.
    spp : int
        Paths per pixel of all images together, at the least.
    seed : int
    passes : int
        Images A; their scatter is the Monte Carlo noise.
    """
    width, height = unit.size
    images = _pixel_means(unit, exponents, spp, seed, passes, signals)
    return images.reshape(passes, height, width, signals.shape[1])


def _pixel_means(unit: unit_scene.UnitScene, exponents: np.ndarray, spp: int, seed: int,
                 passes: int, signals: np.ndarray | None = None) -> np.ndarray:
    """Mean contribution (A, H W, L E) of each pixel's paths, or their mean signal (A, H W, K)."""
    width, height = unit.size
    region = np.arange(width * height).reshape(height, width)
    tracer = path_tracer.Tracer(unit, region, exponents)
    count, paths = _schedule(spp, passes, region.size)
    with all_cores():
        traces = np.array([tracer.trace(paths, seed * 1013 + number, signals)
                           for number in range(count)])
    means = traces.reshape(count // passes, passes, region.size, -1).mean(axis=0)
    return np.asarray(means, dtype=float)


def require_memory(regions: int, products: int, passes: int, materials: int, bounces: int) -> None:
    """Refuse a trace whose coefficients would not fit, or of which the machine has no memory.

    Parameters
    ----------
    regions : int
    products : int
        Of all light groups together, L E.
    passes : int
    materials, bounces : int
        For the sentence.

    Raises
    ------
    InputError
        Saying how large it would be and what makes it smaller.
    """
    needed, free = memory_of(regions, products, passes), free_memory()
    most = MAX_BYTES if free is None else min(MAX_BYTES, free)
    if needed > most:
        whose = "set aside; lower" if most == MAX_BYTES else \
            "of memory that are free; close other programs, or lower"
        raise errors.InputError(
            f"the light transport of {regions} regions and {products} products of {materials} "
            f"reflectances ({interreflection.product_count(materials, bounces)} before pruning) "
            f"needs {needed / 2**30:.1f} GiB, more than the "
            f"{most / 2**30:.{most < MAX_BYTES:d}f} GiB {whose} [reconstruct] width or the "
            "scene's max_depth")


def memory_of(regions: int, products: int, passes: int) -> int:
    """Bytes that a trace and its fit take: 4 a coefficient in each pass and 8 in each deviation and
    in the mean, or 28 while a pass is traced.
    """
    return regions * products * max(12 * passes + 8, 4 * passes + 28)


def memory_of_image(pixels: int, products: int) -> int:
    """Bytes that the products of all pixels of a picture take while they are traced; 0 where they
    are not kept.
    """
    coefficients = pixels * products
    return 28 * coefficients if coefficients <= MAX_IMAGE_COEFFICIENTS else 0


def kept_products(unit: unit_scene.UnitScene, region: np.ndarray,
                  seed: int) -> tuple[np.ndarray, float]:
    """Products (E, M) up to the scene's bounces, pruned where they are many, and the share of the
    signal lost at most.

    Products are made as the paths of a pilot meet them, and not enumerated. Another pilot says what
    is lost: the first has never met most of what it drops.

    Parameters
    ----------
    unit : UnitScene
    region : (H, W) int
        0 and above where a pixel counts.
    seed : int
    """
    materials, bounces = len(unit.materials), unit.bounces
    if interreflection.product_count(materials, bounces) <= PRUNE_ABOVE:
        return interreflection.exponents_up_to(materials, bounces), 0.0
    tracer = path_tracer.Tracer(unit, np.where(region >= 0, 0, -1), None)
    paths = min(PILOT_PATHS, 1 << max(int(np.log2(PILOT_ENTRIES / (bounces + 1))), 10))
    with all_cores():
        picking, judging = (interreflection.encountered(*tracer.encounters(paths, seed + draw),
                                                        materials) for draw in (104729, 130363))
    for share in DROPPED:
        kept = interreflection.pruned(*picking, BRIGHTEST, share)
        if kept.size <= MAX_TERMS:
            break
    exponents, contributions = judging
    bound = contributions * BRIGHTEST ** exponents.sum(axis=1)
    among = {row.tobytes() for row in kept.astype(exponents.dtype)}
    lost = [row.tobytes() not in among for row in exponents]
    return kept, float(bound[lost].sum() / bound.sum())


def _schedule(spp: int, passes: int, pixels: int) -> tuple[int, int]:
    """Number of passes, a multiple of ``passes``, and paths of each: a power of two, within the
    lattice.
    """
    paths = 1 << max(int(np.ceil(np.log2(max(spp * pixels / passes, 1)))), 10)
    return passes * max(paths // path_tracer.MAX_POINTS, 1), min(paths, path_tracer.MAX_POINTS)
