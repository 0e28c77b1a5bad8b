"""Trace the light of a scene once, apart from every spectrum (docs/reconstruction.md).

A path tracer with unit reflectances and unit lights carries along each path which product of reflectances it has met,
and adds its contribution to (region, light, product). Every rendering, gradient or posterior sample is then a small
matrix product (radiometry/interreflection.py). Direct light is sampled towards the emitters and by the surfaces, the
two joined by multiple importance sampling; there is no Russian roulette, paths end at the stated number of bounces.
"""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from radiometry.errors import InputError
from radiometry.interreflection import exponents_up_to, met_next, product_count, prune
from radiometry.records import LightTransport

MOST_BYTES = 1 << 30         # of transport coefficients; more is refused before it is allocated
PILOT_SPP = 4                # paths per pixel by which products are judged before pruning
BRIGHTEST = 0.9              # reflectance that no material is taken to exceed when products are judged
DROPPED = 1e-4               # share of the signal, at that reflectance, which pruning may lose
PRUNE_ABOVE = 256            # products: below, pruning saves nothing worth its pilot
MOST_PATHS = 1 << 24         # per pass: bounds the renderer's memory


@dataclass(frozen=True)
class TracedTransport:
    """Transport coefficients of R regions, L lights and E products, in A independent passes of equal length."""

    materials: tuple[str, ...]
    exponents: np.ndarray        # (E, M)
    passes: np.ndarray           # (A, R, L, E) float32
    spp: int                     # of all passes together
    seed: int
    dropped: float               # bound on the share of the signal lost by pruning

    @property
    def coefficients(self) -> np.ndarray:
        """Mean (R, L E) over the passes, light after light."""
        mean = self.passes.mean(axis=0, dtype=float)
        return mean.reshape(len(mean), -1)

    @property
    def deviations(self) -> np.ndarray:
        """Deviations (A, R, L E) of the passes, scaled so that the sum of their squares is the variance of the mean."""
        count = len(self.passes)
        flat = self.passes.reshape(count, self.passes.shape[1], -1)
        return (flat - flat.mean(axis=0, dtype=float)) / np.sqrt(count * max(count - 1, 1))

    @property
    def relative_variance(self) -> np.ndarray:
        """Monte Carlo variance (R,) of the signal that reflectances of 0.5 would give, relative to its square."""
        grey = np.tile(0.5 ** self.exponents.sum(axis=1), self.passes.shape[2])
        return np.sum((self.deviations @ grey) ** 2, axis=0) / np.maximum(self.coefficients @ grey, 1e-30) ** 2


def trace_transport(scene: Any, material_of_bsdf: Mapping[str, str], size: tuple[int, int], region: np.ndarray, *,
                    bounces: int, spp: int, seed: int, passes: int = 4,
                    lights: tuple[tuple[str, ...], ...] | None = None, exponents: np.ndarray | None = None,
                    progress: Callable[[float], None] | None = None) -> TracedTransport:
    """Transport coefficients of every region, for unit reflectances and lights of unit spectrum.

    Parameters
    ----------
    scene : mi.Scene
        Loaded with ``optimize=False``, its reflectances and light spectra 1.
    material_of_bsdf : mapping
        From BSDF id to material name; BSDFs that reflect nothing (lamps) need no entry.
    size : (width, height) of the film in pixels
    region : (H, W) int
        Region 0 to R-1 of each pixel, -1 where it is not wanted. Regions receive the mean over their pixels.
    bounces : int
        Most reflections along a path; Mitsuba's ``max_depth`` less one.
    spp : int
        Paths per pixel in all passes together.
    passes : int
        Independent passes A that are kept apart; their scatter is the Monte Carlo noise.
    lights : groups of emitter (or light shape) ids, optional
        Each group gets its own coefficients; None puts all lights into one.
    exponents : (E, M) int, optional
        Products to keep; None for all up to ``bounces``, pruned where there are many.

    Raises
    ------
    InputError
        If the coefficients would not fit into memory, or a BSDF has no material.
    """
    materials = tuple(dict.fromkeys(material_of_bsdf.values()))
    groups = 1 if lights is None else len(lights)
    regions, dropped = int(region.max()) + 1, 0.0
    if exponents is None:
        exponents = exponents_up_to(len(materials), bounces)
        if len(exponents) > PRUNE_ABOVE:
            tracer = Tracer(scene, material_of_bsdf, materials, size, np.where(region >= 0, 0, -1), exponents, lights)
            pilot = tracer.trace(bounces, PILOT_SPP, seed + 104729)
            kept, dropped = prune(exponents, pilot.sum(axis=1), BRIGHTEST, DROPPED)
            exponents = exponents[kept]
    require_memory(passes * regions * groups, len(exponents), len(materials), bounces)
    tracer = Tracer(scene, material_of_bsdf, materials, size, region, exponents, lights)
    count, part = _passes(spp, passes, int(np.count_nonzero(region >= 0)))
    kept = np.zeros((passes, regions, groups, len(exponents)), dtype=np.float32)
    for number in range(count):
        kept[number % passes] += tracer.trace(bounces, part, seed * 1009 + number) * np.float32(passes / count)
        if progress is not None:
            progress((number + 1) / count)
    return TracedTransport(materials, exponents, kept, count * part, seed, dropped)


def joined(first: TracedTransport, second: TracedTransport) -> TracedTransport:
    """Two traces of the same products, each pass of one joined to a pass of the other."""
    spp = first.spp + second.spp
    passes = (first.passes * np.float32(first.spp / spp) + second.passes * np.float32(second.spp / spp))
    return TracedTransport(first.materials, first.exponents, passes, spp, first.seed, first.dropped)


def shaded_image(scene: Any, material_of_bsdf: Mapping[str, str], size: tuple[int, int], exponents: np.ndarray,
                 signals: np.ndarray, *, bounces: int, spp: int, seed: int,
                 lights: tuple[tuple[str, ...], ...] | None = None) -> np.ndarray:
    """Image (H, W, K) of the scene once the signals (L E, K) of its products are known.

    The same paths as in ``trace_transport``; every band of every path is exact, so there is no noise of colour.
    """
    width, height = size
    region = np.arange(width * height).reshape(height, width)
    tracer = Tracer(scene, material_of_bsdf, tuple(dict.fromkeys(material_of_bsdf.values())), size, region, exponents,
                    lights)
    count, part = _passes(spp, 1, region.size)
    image = np.mean([tracer.trace(bounces, part, seed * 1013 + number, signals) for number in range(count)], axis=0)
    return image.reshape(height, width, signals.shape[1]).astype(float)


def light_transport(traced: TracedTransport) -> LightTransport:
    """The coefficients and their Monte Carlo covariance as the record that stages exchange.

    Several lights stand one after the other as products. The covariance has the rank of the passes less one.
    """
    deviations = traced.deviations
    return LightTransport(traced.materials, np.tile(traced.exponents, (traced.passes.shape[2], 1)),
                          traced.coefficients, np.einsum("are,arf->ref", deviations, deviations))


def require_memory(regions: int, products: int, materials: int, bounces: int) -> None:
    """Refuse a trace whose coefficients would not fit.

    Raises
    ------
    InputError
        Saying how large it would be and what makes it smaller.
    """
    needed = 4 * regions * products
    if needed > MOST_BYTES:
        raise InputError(
            f"the light transport of {regions} regions and {products} products of {materials} reflectances "
            f"({product_count(materials, bounces)} before pruning) needs {needed / 2**30:.1f} GiB, more than the "
            f"{MOST_BYTES / 2**30:.0f} GiB set aside; lower [reconstruct] width or the scene's max_depth")


def _passes(spp: int, passes: int, pixels: int) -> tuple[int, int]:
    """Number of passes, a multiple of ``passes``, and paths per pixel of each: within the renderer's memory."""
    most = max(MOST_PATHS // max(pixels, 1), 1)
    count = passes * -(-spp // (passes * most))
    return count, max(spp // count, 1)


class Tracer:
    """One scene made ready for tracing: tables from BSDF to material and from emitter to light group."""

    def __init__(self, scene: Any, material_of_bsdf: Mapping[str, str], materials: tuple[str, ...],
                 size: tuple[int, int], region: np.ndarray, exponents: np.ndarray,
                 lights: tuple[tuple[str, ...], ...] | None) -> None:
        import mitsuba as mi

        self.scene, self.size = scene, size
        self.regions = int(region.max()) + 1
        self.groups = 1 if lights is None else len(lights)
        self.products, self.materials = len(exponents), len(materials)
        row, column = np.nonzero(region >= 0)
        self.column, self.row = mi.UInt32(column), mi.UInt32(row)
        self.region = mi.UInt32(region[row, column])
        self.pixels_of_region = np.bincount(region[row, column], minlength=self.regions)
        self.pixels = row.size
        self.following = mi.UInt32(met_next(exponents).ravel())
        self.material = mi.UInt32(_bsdf_table(scene, material_of_bsdf, materials))
        self.light = None if lights is None else mi.UInt32(_light_table(scene, lights))

    def trace(self, bounces: int, spp: int, seed: int, signals: np.ndarray | None = None) -> np.ndarray:
        """Mean contribution (R, L, E) over the paths of each region; the same seed gives the same paths.

        With the signals (L E, K) of the products, the mean signal (R, K) instead.
        """
        import drjit as dr
        import mitsuba as mi

        count = self.pixels * spp
        index = dr.arange(mi.UInt32, count)
        pixel = index // spp
        sampler = mi.load_dict({"type": "independent", "sample_count": spp})
        sampler.seed(seed, count)
        column, row, region = (dr.gather(mi.UInt32, table, pixel) for table in (self.column, self.row, self.region))
        place = (mi.Point2f(column, row) + sampler.next_2d()) / mi.Point2f(*self.size)
        ray, _ = self.scene.sensors()[0].sample_ray(0.0, 0.5, place, mi.Point2f(0.5))
        shape = (self.groups, self.products) if signals is None else signals.shape[1:]
        buffer = dr.zeros(mi.Float, self.regions * int(np.prod(shape)))
        self._follow(mi.Ray3f(ray), sampler, region, bounces, buffer, signals)
        weight: np.ndarray = 1 / np.maximum(self.pixels_of_region * spp, 1)
        traced = np.array(buffer).reshape(self.regions, -1) * weight.astype(np.float32)[:, None]
        return traced.reshape(self.regions, *shape)

    def _follow(self, ray: Any, sampler: Any, region: Any, bounces: int, buffer: Any,
                signals: np.ndarray | None) -> None:
        """Follow the paths to their end and add what they bring to ``buffer``."""
        import drjit as dr
        import mitsuba as mi

        scene, context, products = self.scene, mi.BSDFContext(), self.products
        bands = 1 if signals is None else signals.shape[1]
        worth = None if signals is None else mi.Float(signals.astype(np.float32).ravel())

        def add(value: Any, emitter: Any, product: Any, where: Any) -> None:
            group = mi.UInt32(0)
            if self.light is not None:
                group = dr.gather(mi.UInt32, self.light, _number(emitter), where)
            where &= (value > 0) & (product < products) & (group < self.groups)
            column = group * products + product
            if worth is None:
                dr.scatter_reduce(dr.ReduceOp.Add, buffer, value, region * (self.groups * products) + column, where)
                return
            for band in range(bands):
                price = dr.gather(mi.Float, worth, column * bands + band, where)
                dr.scatter_reduce(dr.ReduceOp.Add, buffer, value * price, region * bands + band, where)

        def step(ray: Any, throughput: Any, product: Any, depth: Any, previous: Any, pdf: Any, active: Any,
                 sampler: Any) -> Any:
            hit = scene.ray_intersect(ray, active)
            emitter = hit.emitter(scene, active)
            direct = mi.DirectionSample3f(scene, hit, previous)
            towards = scene.pdf_emitter_direction(previous, direct, active & (depth > 0))
            weight = dr.select(depth > 0, _balance(pdf, towards), 1.0)
            add(throughput * weight * emitter.eval(hit, active)[0], emitter, product,
                active & (emitter != None))  # noqa: E711 - an array of pointers, compared one by one
            active &= hit.is_valid() & (depth < bounces)
            bsdf = hit.bsdf(ray)
            met = dr.gather(mi.UInt32, self.material, _number(bsdf), active)
            active &= met < self.materials
            product = dr.gather(mi.UInt32, self.following, product * self.materials + met, active)
            active &= product < products
            lamp, brought = scene.sample_emitter_direction(hit, sampler.next_2d(active), True, active)
            value, forward = bsdf.eval_pdf(context, hit, hit.to_local(lamp.d), active)
            weight = dr.select(lamp.delta, 1.0, _balance(lamp.pdf, forward))
            add(throughput * value[0] * brought[0] * weight, lamp.emitter, product, active & (lamp.pdf > 0))
            sample, factor = bsdf.sample(context, hit, sampler.next_1d(active), sampler.next_2d(active), active)
            throughput = throughput * factor[0]
            ray = hit.spawn_ray(hit.to_world(sample.wo))
            active &= (throughput > 0) & (sample.pdf > 0)
            return ray, throughput, product, depth + 1, dr.detach(hit), sample.pdf, active, sampler

        start = (ray, mi.Float(1), mi.UInt32(0), mi.UInt32(0), dr.zeros(mi.SurfaceInteraction3f), mi.Float(0),
                 mi.Bool(True), sampler)
        dr.while_loop(start, lambda *state: state[6], step, labels=("ray", "throughput", "product", "depth",
                                                                    "previous", "pdf", "active", "sampler"))
        dr.eval(buffer)


def _number(pointer: Any) -> Any:
    """The renderer's number of a BSDF or emitter."""
    import drjit as dr
    import mitsuba as mi

    return dr.reinterpret_array(mi.UInt32, pointer)


def _balance(pdf: Any, other: Any) -> Any:
    """Power heuristic of two ways to sample the same direction."""
    import drjit as dr

    return dr.select(pdf > 0, dr.square(pdf) / (dr.square(pdf) + dr.square(other)), 0.0)


def _bsdf_table(scene: Any, material_of_bsdf: Mapping[str, str], materials: tuple[str, ...]) -> np.ndarray:
    """Material index by the renderer's number of the BSDF; the count of materials where a BSDF reflects nothing."""
    import drjit as dr
    import mitsuba as mi

    worn = list(dict.fromkeys(shape.bsdf() for shape in scene.shapes()))
    numbers = np.array(dr.reinterpret_array(mi.UInt32, mi.BSDFPtr(worn)))
    table = np.full(numbers.max() + 1, len(materials), dtype=np.uint32)
    for bsdf, number in zip(worn, numbers, strict=True):
        if bsdf.id() in material_of_bsdf:
            table[number] = materials.index(material_of_bsdf[bsdf.id()])
        elif _reflects(bsdf):
            raise InputError(f"the scene's BSDF {bsdf.id()!r} has no material: every surface needs one, "
                             "since light that it reflects reaches all the others")
    return table


def _reflects(bsdf: Any) -> bool:
    import mitsuba as mi

    hit: Any = mi.SurfaceInteraction3f()
    hit.wavelengths, hit.wi = mi.Spectrum(550.0), mi.Vector3f(0.0, 0.0, 1.0)
    return bool(np.any(np.array(bsdf.eval_diffuse_reflectance(hit)) != 0))


def _light_table(scene: Any, lights: tuple[tuple[str, ...], ...]) -> np.ndarray:
    """Light group by the renderer's number of the emitter; the count of groups where an emitter is in none."""
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
