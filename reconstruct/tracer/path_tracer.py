"""The path tracer behind the traced transport: unit reflectances, and along each path the product
of those it has met.

Direct light is sampled towards the emitters and by the surfaces, the two joined by multiple
importance sampling; there is no Russian roulette, paths end at the stated number of bounces.
Contributions are added as integers, whose sum is the same in any order: the same seed gives the
same bits on any number of threads.
"""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from spectrabox.radiometry.interreflection import met_next
from spectrabox.reconstruct.scene.light_profile import STEP_DEG, TABLE_DEG
from spectrabox.reconstruct.tracer.path_samples import ShiftedLattice
from spectrabox.reconstruct.tracer.tracer_tables import (
    bsdf_table,
    is_sky_map,
    light_table,
    number_of,
    profile_table,
)

# random numbers: of pixel and place in it; of light and direction
BEFORE_BOUNCES, PER_BOUNCE = 3, 4
LOBE = 0.5  # the number that picks a BSDF's lobe: diffuse ones have a single one
TRIAL_PATHS = 1 << 10  # whose largest sum sets the unit in which contributions are counted
HEADROOM = 12  # bits by which a path may be brighter, on average, than that sum
LEAST_COUNT, MOST_BITS = 1 << 10, 62


class Tracer:
    """One scene made ready for tracing: tables from BSDF to material and from emitter to light
    group.
    """

    def __init__(self, scene: Any, material_of_bsdf: Mapping[str, str], materials: tuple[str, ...],
                 size: tuple[int, int], region: np.ndarray, exponents: np.ndarray,
                 lights: tuple[tuple[str, ...], ...] | None, profiles: Mapping[str, np.ndarray]
                 | None = None) -> None:
        import mitsuba as mi

        self.scene, self.size = scene, size
        self.regions = int(region.max()) + 1
        self.groups = 1 if lights is None else len(lights)
        self.products, self.materials = len(exponents), len(materials)
        row, column = np.nonzero(region >= 0)
        # Region after region: the paths of each are then an interval of the lattice's first
        # dimension, evenly filled.
        order = np.argsort(region[row, column], kind="stable")
        row, column = row[order], column[order]
        self.column, self.row = mi.UInt32(column), mi.UInt32(row)
        self.region = mi.UInt32(region[row, column])
        self.pixels_of_region = np.bincount(region[row, column], minlength=self.regions)
        self.pixels = row.size
        self.following = mi.UInt32(met_next(exponents).ravel())
        self.material = mi.UInt32(bsdf_table(scene, material_of_bsdf, materials))
        self.light = None if lights is None else mi.UInt32(light_table(scene, lights))
        shaped = bool(profiles) or any(is_sky_map(emitter) for emitter in scene.emitters())
        self.profile = mi.Float(profile_table(scene, profiles or {})) if shaped else None
        self.units: dict[bool, int] = {}

    def trace(self, bounces: int, paths: int, seed: int,
              signals: np.ndarray | None = None) -> np.ndarray:
        """Mean contribution (R, L, E) over the paths of each region; the same seed gives the same
        paths.

        With the signals (L E, K) of the products, the mean signal (R, K) instead.

        Parameters
        ----------
        paths : int
            Over all pixels; a power of two is spread most evenly.
        """
        bits = self._unit(bounces, signals) - int(np.ceil(np.log2(paths)))
        weight: np.ndarray = self.pixels / (np.maximum(self.pixels_of_region, 1) * float(paths))
        sums = self._sums(bounces, paths, seed, signals, bits) * weight[:, None]
        return sums.astype(np.float32).reshape(self.regions, *self._shape(signals))

    def _shape(self, signals: np.ndarray | None) -> tuple[int, ...]:
        return (self.groups, self.products) if signals is None else signals.shape[1:]

    def _unit(self, bounces: int, signals: np.ndarray | None) -> int:
        """Bits that the sum of paths leaves for one contribution: found with few paths and ever
        finer units.
        """
        known = self.units.get(signals is None)
        if known is not None:
            return known
        for bits in range(30, MOST_BITS + 40, 16):
            largest = np.abs(self._sums(bounces, TRIAL_PATHS, 0, signals, bits)).max()
            if largest * 2.0**bits >= LEAST_COUNT:
                break
        peak = int(np.ceil(np.log2(largest))) if largest > 0 else 0
        return self.units.setdefault(signals is None, MOST_BITS - HEADROOM - peak)

    def _sums(self, bounces: int, paths: int, seed: int, signals: np.ndarray | None,
              bits: int) -> np.ndarray:
        """Sums (R, L E) or (R, K) over paths, each contribution rounded to a multiple of
        2^-bits.
        """
        import drjit as dr
        import mitsuba as mi

        # ended paths read one bounce on
        lattice = ShiftedLattice(BEFORE_BOUNCES + PER_BOUNCE * (bounces + 1), seed)
        index = dr.arange(mi.UInt32, paths)
        pixel: Any = dr.mul_hi(lattice.integer(index, mi.UInt32(0)), mi.UInt32(self.pixels))
        column, row, region = (dr.gather(mi.UInt32, table, pixel) for table in (self.column,
                                                                                self.row,
                                                                                self.region))
        place = (mi.Point2f(column, row) + lattice.pair(index,
                                                        mi.UInt32(1))) / mi.Point2f(*self.size)
        ray, _ = self.scene.sensors()[0].sample_ray(0.0, 0.5, place, mi.Point2f(0.5))
        buffer = dr.zeros(mi.Int64, self.regions * int(np.prod(self._shape(signals))))
        unit = dr.opaque(mi.Float, 2.0**bits)
        self._follow(mi.Ray3f(ray), lattice, index, region, bounces, buffer, unit, signals)
        return np.array(buffer).reshape(self.regions, -1) * 2.0**-bits

    def _follow(self, ray: Any, lattice: ShiftedLattice, index: Any, region: Any, bounces: int,
                buffer: Any,
                unit: Any, signals: np.ndarray | None) -> None:
        """Follow the paths to their end and add what they bring to ``buffer``, times ``unit``, as
        integers.
        """
        import drjit as dr
        import mitsuba as mi

        scene, context, products = self.scene, mi.BSDFContext(), self.products
        bands = 1 if signals is None else signals.shape[1]
        worth = None if signals is None else mi.Float(signals.astype(np.float32).ravel())

        def add(value: Any, emitter: Any, product: Any, where: Any) -> None:
            group = mi.UInt32(0)
            if self.light is not None:
                group = dr.gather(mi.UInt32, self.light, number_of(emitter), where)
            where &= (value > 0) & (product < products) & (group < self.groups)
            column = group * products + product
            if worth is None:
                dr.scatter_reduce(dr.ReduceOp.Add, buffer, mi.Int64(dr.round(value * unit)),
                                  region * (self.groups * products) + column, where)
                return
            for band in range(bands):
                price = dr.gather(mi.Float, worth, column * bands + band, where)
                dr.scatter_reduce(dr.ReduceOp.Add, buffer, mi.Int64(dr.round(value * price * unit)),
                                  region * bands + band, where)

        def step(ray: Any, throughput: Any, product: Any, depth: Any, previous: Any, pdf: Any,
                 active: Any) -> Any:
            hit = scene.ray_intersect(ray, active)
            emitter = hit.emitter(scene, active)
            direct = mi.DirectionSample3f(scene, hit, previous)
            towards = scene.pdf_emitter_direction(previous, direct, active & (depth > 0))
            weight = dr.select(depth > 0, _balance(pdf, towards), 1.0)
            shine = emitter.eval(hit, active)[0] * self._shape_of(emitter, hit.wi.z, active & (emitter != None))  # noqa
            add(throughput * weight * shine, emitter, product,
                active & (emitter != None))  # noqa: E711 - an array of pointers, compared one by one
            active &= hit.is_valid() & (depth < bounces)
            bsdf = hit.bsdf(ray)
            met = dr.gather(mi.UInt32, self.material, number_of(bsdf), active)
            active &= met < self.materials
            product = dr.gather(mi.UInt32, self.following, product * self.materials + met, active)
            active &= product < products
            dimension = BEFORE_BOUNCES + PER_BOUNCE * depth
            lamp, brought = scene.sample_emitter_direction(hit, lattice.pair(index, dimension),
                                                           True, active)
            value, forward = bsdf.eval_pdf(context, hit, hit.to_local(lamp.d), active)
            weight = dr.select(lamp.delta, 1.0, _balance(lamp.pdf, forward))
            shine = brought[0] * self._shape_of(lamp.emitter, -dr.dot(lamp.d, lamp.n),
                                                active & (lamp.pdf > 0))
            add(throughput * value[0] * shine * weight, lamp.emitter, product,
                active & (lamp.pdf > 0))
            sample, factor = bsdf.sample(context, hit, mi.Float(LOBE),
                                         lattice.pair(index, dimension + 2), active)
            throughput = throughput * factor[0]
            ray = hit.spawn_ray(hit.to_world(sample.wo))
            active &= (throughput > 0) & (sample.pdf > 0)
            return ray, throughput, product, depth + 1, dr.detach(hit), sample.pdf, active

        start = (ray, mi.Float(1), mi.UInt32(0), mi.UInt32(0), dr.zeros(mi.SurfaceInteraction3f),
                 mi.Float(0), mi.Bool(True))
        dr.while_loop(start, lambda *state: state[6], step,
                      labels=("ray", "throughput", "product", "depth", "previous", "pdf", "active"))
        dr.eval(buffer)


    def _shape_of(self, emitter: Any, cosine: Any, where: Any) -> Any:
        """Relative radiance of an emitter in a direction at this cosine from its normal: 1 without
        a profile.
        """
        import drjit as dr
        import mitsuba as mi

        if self.profile is None:
            return mi.Float(1)
        place = dr.safe_acos(cosine) * (180 / np.pi / STEP_DEG)
        below = dr.minimum(mi.UInt32(dr.maximum(place, 0.0)), TABLE_DEG.size - 2)
        first = number_of(emitter) * TABLE_DEG.size + below
        left, right = (dr.gather(mi.Float, self.profile, first + step, where) for step in (0, 1))
        return dr.lerp(left, right, dr.clip(place - mi.Float(below), 0.0, 1.0))


def _balance(pdf: Any, other: Any) -> Any:
    """Power heuristic of two ways to sample the same direction."""
    import drjit as dr

    return dr.select(pdf > 0, dr.square(pdf) / (dr.square(pdf) + dr.square(other)), 0.0)
