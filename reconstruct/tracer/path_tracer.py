"""The path tracer behind the traced transport, with unit reflectances.

Along each path it carries the product of the reflectances encountered. Direct light is sampled
towards the emitters and by the surfaces, the two joined by multiple importance sampling; there is
no Russian roulette, paths end at the stated number of bounces.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from spectrabox.radiometry.interreflection import product_after
from spectrabox.reconstruct.scene.scene_file import STEP_DEG, TABLE_DEG
from spectrabox.reconstruct.tracer import unit_scene

# random numbers: of pixel and position in it; of light and direction
BEFORE_BOUNCES, PER_BOUNCE = 3, 4
LOBE = 0.5  # the number that picks a BSDF's lobe: diffuse ones have a single one
TRIAL_PATHS = 1 << 10  # whose largest sum sets the unit in which contributions are counted
HEADROOM = 12  # bits by which a path may be brighter, on average, than that sum
MIN_COUNT, MAX_BITS = 1 << 10, 62


@dataclass
class PathState:
    """Loop state: all that one path carries from vertex to vertex, as arrays over the paths."""

    ray: Any            # Ray3f                  towards the next vertex
    throughput: Any     # Float                  of the path so far, every reflectance being 1
    product: Any        # UInt32                 of the reflectances encountered so far, its index
    depth: Any          # UInt32                 reflections so far
    previous: Any       # SurfaceInteraction3f   the last vertex, from which the ray starts
    bsdf_pdf: Any       # Float                  density with which its BSDF drew the ray
    active: Any         # Bool                   False: the path has ended


class Tracer:
    """One scene made ready for tracing: tables of its pixels, materials, lights and products.

    Parameters
    ----------
    unit : UnitScene
    region : (H, W) int
        Region 0 to R-1 of each pixel, -1 where it is not wanted.
    exponents : (E, M) int, optional
        Products of reflectances that are kept; None counts reflections alone, for ``encounters``.

    Raises
    ------
    InputError
        If a BSDF that reflects light has no material.
    """

    def __init__(self, unit: unit_scene.UnitScene, region: np.ndarray,
                 exponents: np.ndarray | None) -> None:
        import mitsuba as mi

        self.scene, self.size, self.bounces = unit.scene, unit.size, unit.bounces
        self.regions, self.groups = int(region.max()) + 1, unit.groups
        self.materials = len(unit.materials)
        after = np.repeat(np.arange(1, self.bounces + 3), self.materials) if exponents is None \
            else product_after(exponents).ravel()
        self.products = self.bounces + 1 if exponents is None else len(exponents)
        row, column = np.nonzero(region >= 0)
        # Region after region: the paths of each are then an interval of the lattice's first
        # dimension, evenly filled.
        order = np.argsort(region[row, column], kind="stable")
        row, column = row[order], column[order]
        self.column, self.row = mi.UInt32(column), mi.UInt32(row)
        self.region = mi.UInt32(region[row, column])
        self.pixels_of_region = np.bincount(region[row, column], minlength=self.regions)
        self.pixels = row.size
        self.next_product = mi.UInt32(after.astype(np.uint32))
        self.material = mi.UInt32(
            unit_scene.bsdf_table(unit.scene, unit.material_of_bsdf, unit.materials))
        self.light = (None if unit.lights is None
                      else mi.UInt32(unit_scene.light_table(unit.scene, unit.lights)))
        shaped = bool(unit.profiles) or any(emitter.class_name() == unit_scene.SKY_MAP_CLASS
                                            for emitter in unit.scene.emitters())
        self.profile = mi.Float(unit_scene.profile_table(unit.scene,
                                                         unit.profiles)) if shaped else None
        self.beam = unit.beam
        self.units: dict[bool, int] = {}

    def trace(self, paths: int, seed: int, signals: np.ndarray | None = None) -> np.ndarray:
        """Mean contribution over the paths of each region, or mean signal.

        Parameters
        ----------
        paths : int
            Over all pixels, at most ``MAX_POINTS``; a power of two is spread most evenly.
        seed : int
            Of the lattice's shift; the same seed gives the same paths.
        signals : (L E, K) array, optional
            Of the products.

        Returns
        -------
        (R, L, E) or, where signals are given, (R, K) float32
        """
        bits = self._unit(signals) - int(np.ceil(np.log2(paths)))
        weight: np.ndarray = self.pixels / (np.maximum(self.pixels_of_region, 1) * float(paths))
        sums = self._sums(paths, seed, signals, bits) * weight[:, None]
        shape = (self.groups, self.products) if signals is None else signals.shape[1:]
        return sums.astype(np.float32).reshape(self.regions, *shape)

    def encounters(self, paths: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Materials that each path meets, and what it contributes after each number of reflections.

        Of a tracer without exponents.

        Parameters
        ----------
        paths, seed : as of ``trace``

        Returns
        -------
        materials : (paths, bounces) int
            The number of materials where the path has ended.
        contributions : (paths, bounces + 1) float32
            Light that arrives with reflectances of 1.
        """
        import drjit as dr
        import mitsuba as mi

        sums = Encounters(paths, self.bounces, self.materials)
        self._follow(paths, seed, lambda region: dr.arange(mi.UInt32, paths), sums)
        return sums.values()

    def _unit(self, signals: np.ndarray | None) -> int:
        """Bits that the sum of paths leaves for one contribution, judged by ``TRIAL_PATHS``."""
        known = self.units.get(signals is None)
        if known is not None:
            return known
        for bits in range(30, MAX_BITS + 40, 16):
            largest = np.abs(self._sums(TRIAL_PATHS, 0, signals, bits)).max()
            if largest * 2.0**bits >= MIN_COUNT:
                break
        peak = int(np.ceil(np.log2(largest))) if largest > 0 else 0
        return self.units.setdefault(signals is None, MAX_BITS - HEADROOM - peak)

    def _sums(self, paths: int, seed: int, signals: np.ndarray | None, bits: int) -> np.ndarray:
        """Sums (R, L E) or (R, K) over paths, of contributions rounded to multiples of 2^-bits."""
        sums = Contributions(self.regions, self.groups, self.products, self.light, signals, bits)
        self._follow(paths, seed, lambda region: region, sums)
        return sums.values()

    def _follow(self, paths: int, seed: int, of_region: Callable[[Any], Any],
                sums: Contributions | Encounters) -> None:
        """Follow paths to their ends; ``of_region`` gives the row of the sums of each."""
        import drjit as dr
        import mitsuba as mi

        # ended paths read one bounce on
        lattice = ShiftedLattice(BEFORE_BOUNCES + PER_BOUNCE * (self.bounces + 1), seed, paths)
        pixel: Any = dr.mul_hi(lattice.integer(mi.UInt32(0)), mi.UInt32(self.pixels))
        column, row, region = (dr.gather(mi.UInt32, table, pixel)
                               for table in (self.column, self.row, self.region))
        position = (mi.Point2f(column, row) + lattice.pair(mi.UInt32(1))) / mi.Point2f(*self.size)
        ray, _ = self.scene.sensors()[0].sample_ray(0.0, 0.5, position, mi.Point2f(0.5))
        row_of_sums = of_region(region)
        start = PathState(ray=mi.Ray3f(ray), throughput=mi.Float(1), product=mi.UInt32(0),
                          depth=mi.UInt32(0), previous=dr.zeros(mi.SurfaceInteraction3f),
                          bsdf_pdf=mi.Float(0), active=mi.Bool(True))
        dr.while_loop((start,), lambda path: path.active,
                      lambda path: (self._next_vertex(path, row_of_sums, lattice, sums),))

    def _next_vertex(self, path: PathState, region: Any, lattice: ShiftedLattice,
                     sums: Contributions | Encounters) -> PathState:
        """The paths one vertex on."""
        import drjit as dr
        import mitsuba as mi

        scene, active = self.scene, path.active
        dimension = BEFORE_BOUNCES + PER_BOUNCE * path.depth
        hit = scene.ray_intersect(path.ray, active)

        # ------------------------- emitter that the ray hits -------------------------
        emitter = hit.emitter(scene, active)
        hits_light = active & (emitter != None)  # noqa: E711 - an array of pointers, one by one
        direct = mi.DirectionSample3f(scene, hit, path.previous)
        emitter_pdf = scene.pdf_emitter_direction(path.previous, direct, active & (path.depth > 0))
        weight = dr.select(path.depth > 0, power_heuristic(path.bsdf_pdf, emitter_pdf), 1.0)
        radiance = (emitter.eval(hit, active)[0] * self._profile(emitter, hit.wi.z, hits_light)
                    * self._beam(-path.ray.d))
        sums.add(region, path.throughput * weight * radiance, emitter, path.product, hits_light)

        # ------------------------- reflectance of the surface ------------------------
        active &= hit.is_valid() & (path.depth < self.bounces)
        bsdf = hit.bsdf(path.ray)
        number: Any = dr.reinterpret_array(mi.UInt32, bsdf)
        material = dr.gather(mi.UInt32, self.material, number, active)
        active &= material < self.materials
        product = dr.gather(mi.UInt32, self.next_product, path.product * self.materials + material,
                            active)
        active &= product < self.products
        if isinstance(sums, Encounters):
            sums.meet(region, path.depth, material, active)

        # ----------------------------- emitter sampling ------------------------------
        # ``received`` is radiance / pdf; the cosine of the bounce is part of the BSDF's value.
        context = mi.BSDFContext()
        light, received = scene.sample_emitter_direction(hit, lattice.pair(dimension), True, active)
        reached = active & (light.pdf > 0)
        value, bsdf_pdf = bsdf.eval_pdf(context, hit, hit.to_local(light.d), active)
        weight = dr.select(light.delta, 1.0, power_heuristic(light.pdf, bsdf_pdf))
        radiance = (received[0] * self._profile(light.emitter, -dr.dot(light.d, light.n), reached)
                    * self._beam(-light.d))
        sums.add(region, path.throughput * value[0] * radiance * weight, light.emitter, product,
                 reached)

        # ------------------------------- BSDF sampling --------------------------------
        sample, factor = bsdf.sample(context, hit, mi.Float(LOBE), lattice.pair(dimension + 2),
                                     active)
        throughput = path.throughput * factor[0]
        active &= (throughput > 0) & (sample.pdf > 0)
        return PathState(ray=hit.spawn_ray(hit.to_world(sample.wo)), throughput=throughput,
                         product=product, depth=path.depth + 1, previous=dr.detach(hit),
                         bsdf_pdf=sample.pdf, active=active)

    def _beam(self, direction: Any) -> Any:
        """Relative intensity of the lamp into a direction: 1 without a beam."""
        return 1.0 if self.beam is None else self.beam.intensity(direction)

    def _profile(self, emitter: Any, cosine: Any, active: Any) -> Any:
        """Relative radiance of an emitter at this cosine from its normal: 1 without a profile."""
        import drjit as dr
        import mitsuba as mi

        if self.profile is None:
            return mi.Float(1)
        position = dr.safe_acos(cosine) * (180 / np.pi / STEP_DEG)
        below = dr.minimum(mi.UInt32(dr.maximum(position, 0.0)), TABLE_DEG.size - 2)
        number: Any = dr.reinterpret_array(mi.UInt32, emitter)
        first = number * TABLE_DEG.size + below
        left, right = (dr.gather(mi.Float, self.profile, first + step, active) for step in (0, 1))
        return dr.lerp(left, right, dr.clip(position - mi.Float(below), 0.0, 1.0))


def power_heuristic(pdf: Any, other: Any) -> Any:
    """Weight, 0 to 1, of a direction that two strategies could have drawn (Veach 1997, beta = 2).

    Parameters
    ----------
    pdf : Float
        Density of the strategy that drew it.
    other : Float
        Density of the other one.
    """
    import drjit as dr

    return dr.select(pdf > 0, dr.square(pdf) / (dr.square(pdf) + dr.square(other)), 0.0)


# ---- random numbers ------------------------------------------------------------------------------
# Random numbers of light paths from a shifted lattice, even over picture, lights and bounces.
#
# Point i of the rule has the coordinates frac(phi(i) z_d + shift_d), phi the radical inverse in
# base 2, z a generating vector whose every pair of dimensions is spread evenly (Cools, Kuo and
# Nuyens, SIAM J. Sci. Comput. 28, 2006, up to 2^20 points). The shift is uniform, so each
# coordinate is uniform as well and every mean is unbiased; rules with other shifts are
# independent, and their scatter gives the error. Compared with independent numbers the noise of a
# picture's total falls by two and more, at less cost per number
# (docs/explanation/reconstruction.md).

GENERATOR = (
    1, 182667, 469891, 498753, 110745, 446247, 250185, 118627, 245333, 283199, 408519, 391023,
    246327, 126539, 399185, 461527, 300343, 69681, 516695, 436179, 106383, 238523, 413283, 70841,
    47719, 300129, 113029, 123925, 410745, 211325, 17489, 511893, 40767, 186077, 519471, 255369,
    101819, 243573, 66189, 152143, 503455, 113217, 132603, 463967, 297717, 157383, 224015, 502917,
    36237, 94049, 170665, 79397, 123963, 223451, 323871, 303633, 98567, 318855, 494245, 477137,
    177975, 64483, 26695, 88779, 94497, 239429, 381007)
# for which the vector was made; more are several rules with shifts of their own
MAX_POINTS = 1 << 20


class ShiftedLattice:
    """The first points of one rule, as arrays of the renderer.

    Parameters
    ----------
    dimensions : int
    seed : int
        Of the shift; another seed is another, independent rule.
    points : int
        At most ``MAX_POINTS``.
    """

    def __init__(self, dimensions: int, seed: int, points: int) -> None:
        import drjit as dr
        import mitsuba as mi

        self.index = dr.arange(mi.UInt32, points)
        self.generator = mi.UInt32(generating_vector(dimensions))
        self.shift = mi.UInt32(np.random.default_rng(seed).integers(0, 1 << 32, dimensions,
                                                                    dtype=np.uint32))

    def integer(self, dimension: Any) -> Any:
        """Coordinate times 2^32 of every point.

        Parameters
        ----------
        dimension : UInt32
            One for all points, or one for each.
        """
        import drjit as dr
        import mitsuba as mi

        return (dr.brev(self.index) * dr.gather(mi.UInt32, self.generator, dimension)
                + dr.gather(mi.UInt32, self.shift, dimension))

    def pair(self, dimension: Any) -> Any:
        """Two coordinates of every point in [0, 1).

        Parameters
        ----------
        dimension : UInt32
            Of the first; the second is the next. One for all points, or one for each.
        """
        import mitsuba as mi

        scale = 2.0**-24  # 24 bits, as many as a float32 holds: 32 could round up to 1
        return mi.Point2f(mi.Float(self.integer(dimension) >> 8) * scale,
                          mi.Float(self.integer(dimension + 1) >> 8) * scale)


def generating_vector(dimensions: int) -> np.ndarray:
    """Components of the generating vector, all odd.

    Odd numbers drawn once follow those of the published vector. They belong to bounces beyond the
    sixteenth, where little light is left.

    Parameters
    ----------
    dimensions : int

    Returns
    -------
    (dimensions,) uint32
    """
    drawn = np.random.default_rng(1).integers(0, 1 << 31,
                                              max(dimensions - len(GENERATOR), 0)) * 2 + 1
    return np.r_[np.array(GENERATOR, dtype=np.uint32), drawn.astype(np.uint32)][:dimensions]


# ---- sums ----------------------------------------------------------------------------------------
# Sums of what paths contribute, as integers, whose sum does not depend on the order.
#
# The same seed therefore gives the same bits on any number of threads.

class Contributions:
    """Sums by region, light group and product of reflectances; or by region and band.

    Parameters
    ----------
    regions, groups, products : int
        R, L and E.
    light : UInt32 array or None
        Light group by the renderer's number of the emitter; None puts all into one.
    signals : (L E, K) array or None
        Of the products: given, the sums are by band.
    bits : int
        Each contribution is rounded to a multiple of 2^-bits.
    """

    def __init__(self, regions: int, groups: int, products: int, light: Any,
                 signals: np.ndarray | None, bits: int) -> None:
        import drjit as dr
        import mitsuba as mi

        self.regions, self.groups, self.products, self.light = regions, groups, products, light
        self.bands = None if signals is None else signals.shape[1]
        self.signals = None if signals is None else mi.Float(signals.astype(np.float32).ravel())
        self.columns = groups * products if self.bands is None else self.bands
        self.bits, self.unit = bits, dr.opaque(mi.Float, 2.0**bits)
        self.buffer = dr.zeros(mi.Int64, regions * self.columns)

    def add(self, region: Any, contribution: Any, emitter: Any, product: Any, active: Any) -> None:
        """Add a contribution of each active path.

        Parameters
        ----------
        region : UInt32
            0 to R-1.
        contribution : Float
            Light that arrives with reflectances of 1; 0 and less is left out.
        emitter : EmitterPtr
            Whose light it is.
        product : UInt32
            Reflectances encountered, 0 to E-1; others are left out.
        active : Bool
        """
        import drjit as dr
        import mitsuba as mi

        group = mi.UInt32(0)
        if self.light is not None:
            number: Any = dr.reinterpret_array(mi.UInt32, emitter)
            group = dr.gather(mi.UInt32, self.light, number, active)
        active = active & (contribution > 0) & (product < self.products) & (group < self.groups)
        term = group * self.products + product
        if self.bands is None:
            dr.scatter_reduce(dr.ReduceOp.Add, self.buffer,
                              mi.Int64(dr.round(contribution * self.unit)),
                              region * self.columns + term, active)
            return
        for band in range(self.bands):
            signal = dr.gather(mi.Float, self.signals, term * self.bands + band, active)
            dr.scatter_reduce(dr.ReduceOp.Add, self.buffer,
                              mi.Int64(dr.round(contribution * signal * self.unit)),
                              region * self.columns + band, active)

    def values(self) -> np.ndarray:
        """The sums (R, L E) or (R, K)."""
        return np.array(self.buffer).reshape(self.regions, -1) * 2.0**-self.bits


class Encounters:
    """What each path meets, and what it contributes, path by path.

    Parameters
    ----------
    paths, bounces, materials : int
    """

    def __init__(self, paths: int, bounces: int, materials: int) -> None:
        import drjit as dr
        import mitsuba as mi

        self.paths, self.bounces = paths, bounces
        self.met = dr.full(mi.UInt32, materials, paths * bounces)
        self.contributed = dr.zeros(mi.Float, paths * (bounces + 1))

    def meet(self, path: Any, depth: Any, material: Any, active: Any) -> None:
        """Note the material (UInt32) that each active path (UInt32) meets after ``depth``
        reflections.
        """
        import drjit as dr

        dr.scatter(self.met, material, path * self.bounces + depth, active)

    def add(self, path: Any, contribution: Any, emitter: Any, product: Any, active: Any) -> None:
        """As of ``Contributions``, its region being the path and its product the number of
        reflections.
        """
        import drjit as dr

        dr.scatter_add(self.contributed, contribution, path * (self.bounces + 1) + product,
                       active & (contribution > 0) & (product <= self.bounces))

    def values(self) -> tuple[np.ndarray, np.ndarray]:
        """Materials (paths, bounces) and contributions (paths, bounces + 1)."""
        return (np.array(self.met).reshape(self.paths, self.bounces),
                np.array(self.contributed).reshape(self.paths, self.bounces + 1))
