"""Position of a light, refined from a photo of surfaces whose reflectances are known.

The photo's logarithm is fitted by Gauss-Newton steps in the light's offset and brightness. The
rendering is the traced transport; its derivative comes from tracing the same paths with the light
moved to and fro, which sees moving shadows too. Mitsuba 3.9.0's own derivative was tried first:
``prb`` stops with an error on a point light and gives 0 for a moving lamp; the projective
integrators took two minutes for 48 x 32 pixels and were off by a factor of two. The brightness of
surfaces and the reflectance of paints, as far as they are not known, are fitted along with it, so
that the offset rests on how the light falls off over each surface.
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from spectrabox.radiometry import interreflection, shaped
from spectrabox.radiometry.errors import CalibrationError, InputError
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.radiometry.records.spectra import Outcome, Progress
from spectrabox.reconstruct.rendering.renderer import load_scene
from spectrabox.reconstruct.scene import edit_scene, stated, surfaces
from spectrabox.reconstruct.scene.scene_file import SceneFile, not_plain_products
from spectrabox.reconstruct.scene.scene_xml import scene_xml
from spectrabox.reconstruct.tracer.transport import trace_transport
from spectrabox.reconstruct.tracer.unit_scene import UnitScene

# of the surfaces' extent, for the derivative: less, and the noise of shadow edges rules it
STEP = 0.015
MAX_MOVE = 0.1          # of the same, in one iteration
ITERATIONS = 12
NEW_SLOPES = 2          # iterations that trace the derivative
TINY, ROUND_OFF = 1e-300, 1e-12
SMALL_MOVE = 0.2        # of the standard error: converged
MIN_REGIONS = 12
MIN_SIGNAL = 0.01       # of a band's median signal
MIN_LIT = 0.5           # of the regions, that a step for the derivative must leave lit
MAX_ERROR = 0.5         # of the surfaces' extent: above, the position is not known at all
# relative standard deviations of what the model of the photo does not know
SURFACE_ERROR = 0.01    # of each surface in all bands: uneven paint, pose
PAINT_ERROR = 0.02      # of each material in each band: its known reflectance
BLOCK_ERROR = 0.005     # of each block of pixels besides its noise

UNDETERMINED = ("the photo does not tell where the light is: brightness hardly changes when it "
                "moves; photograph surfaces nearer to it, in several directions")
LAMP_HIDDEN = ("moved a little way, the light goes behind a surface and leaves most of the scene "
               "dark, so its position cannot be refined: it hangs too close to a wall or ceiling; "
               "measure it")


@dataclass(frozen=True, eq=False)
class LightPosition(shaped.Record):
    """Estimated position of a light, relative to that in the scene, in the scene's unit."""

    light: str
    offset: Annotated[np.ndarray, "3"]
    standard_error: Annotated[np.ndarray, "3"]
    covariance: Annotated[np.ndarray, "3 3"]
    light_scale: float  # factor from rendering to photo with the light there
    light_scale_standard_error: float
    chi_square_before: float  # per degree of freedom, with the light as given
    chi_square: float  # the same with the light moved; above 1 it widens the errors
    offsets: Annotated[np.ndarray, "I 3"]
    outcome: Outcome


def refine_light_position(scene_file: SceneFile, reflectances: Mapping[str, np.ndarray],
                          response: np.ndarray, photo: LinearImage, light_id: str | None = None,
                          spp: int = 256, seed: int = 0,
                          progress: Progress = lambda *_: None) -> LightPosition:
    """Offset of a light, with the standard error of the Gauss-Newton Hessian.

    Parameters
    ----------
    scene_file : SceneFile
    reflectances : mapping of BSDF id to (P,)
        Of every material, 0 to 1.
    response : (K, P) array
        Sensitivity x light x integration weight.
    photo : LinearImage
        At the render's size, (H, W, K).
    light_id : str or None
        None takes the scene's only light.
    spp : int
        Paths per pixel of each trace.
    seed : int
    progress : function of (fraction done, what is being done)

    Raises
    ------
    InputError
        If the light has no position, a material no reflectance, or too little of the photo can be
        compared.
    CalibrationError
        If the photo does not tell where the light is, or a step puts it behind a surface.
    """
    number = edit_scene.light_number(scene_file, light_id)
    bsdfs = _require_reflectances(scene_file, reflectances)
    size = photo.signal.shape[1], photo.signal.shape[0]

    def unit(offset: np.ndarray) -> UnitScene:
        """The scene with its light moved by ``offset`` (3,), open, with unit spectra."""
        ones = np.ones(2)
        scene = load_scene(scene_xml(edit_scene.with_light_moved(scene_file, number, offset),
                                     reflectances=dict.fromkeys(bsdfs, ones),
                                     light=stated.strengths(scene_file),
                                     bands={"one": ones}, range_nm=(400.0, 700.0), size=size))
        return UnitScene(scene, {bsdf: bsdf for bsdf in bsdfs}, size, scene_file.max_depth - 1,
                         profiles=scene_file.profiles)

    unmoved = unit(np.zeros(3))
    surface = surfaces.surface_map(unmoved.scene, tuple(scene_file.surfaces), unmoved.size)
    floor = MIN_SIGNAL * np.median(photo.signal, axis=(0, 1))
    usable = ~photo.saturated.any(axis=2) & np.all(photo.signal > floor, axis=2)
    region, group = surfaces.block_regions(surface, usable)
    if len(group) < MIN_REGIONS:
        raise InputError(f"photo {photo.source}: {len(group)} blocks of single surfaces can be "
                         f"compared, {MIN_REGIONS} are needed; render at a larger size, or "
                         "expose so that less is saturated")
    extent = _extent(unmoved.scene, scene_file)
    measured = surfaces.region_means(photo.signal.astype(float), region)
    noise = surfaces.region_means(photo.variance.astype(float), region)
    noise /= np.bincount(region[region >= 0])[:, None]
    spectra = np.array([reflectances[bsdf] for bsdf in bsdfs])

    def rendered(offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signal (R, K), and its relative Monte Carlo variance (R,)."""
        traced = trace_transport(unit(offset), region, spp=spp, seed=seed)
        received = interreflection.signal(traced.coefficients, traced.exponents, spectra, response)
        return received, traced.relative_variance

    now, monte_carlo = rendered(np.zeros(3))
    kept = np.all((now > 0) & (measured > 0), axis=1)
    if np.count_nonzero(kept) < MIN_REGIONS:
        raise InputError(f"{scene_file.path.name}: the light reaches {np.count_nonzero(kept)} of "
                         f"{kept.size} blocks that the photo shows; check where the scene has it")
    whiten = whitening(monte_carlo[kept] + BLOCK_ERROR**2,
                        noise[kept] / measured[kept] ** 2)
    materials = [bsdfs.index(bsdf)
                 for bsdf in np.array(list(scene_file.surfaces.values()))[group[kept]]]
    nuisance = _nuisance(group[kept], np.array(materials), response.shape[0])
    target = np.log(measured[kept])
    offset, offsets, slopes = np.zeros(3), [np.zeros(3)], np.zeros((3, *target.shape))
    _, _, before = _solve(target - np.log(now[kept]), slopes[:0], whiten, nuisance)
    outcome = Outcome.STEP_LIMIT
    for iteration in range(ITERATIONS):
        progress(iteration / ITERATIONS, f"light moved by {np.linalg.norm(offset):.3g}")
        if iteration < NEW_SLOPES:  # then kept: their noise would keep the steps from ending
            ends = np.array([[rendered(offset + sign * step)[0][kept] for sign in (1, -1)]
                             for step in STEP * extent * np.eye(3)])
            if np.any((ends > 0).mean(axis=(2, 3)) < MIN_LIT):
                raise CalibrationError(LAMP_HIDDEN)
            ahead, behind = np.log(np.maximum(ends, TINY)).swapaxes(0, 1)
            slopes = (ahead - behind) / (2 * STEP * extent)
        solution, covariance, misfit = _solve(target - np.log(np.maximum(now[kept], TINY)), slopes,
                                              whiten, nuisance)
        variance = np.diag(covariance)[:3]
        if not np.all(variance < (MAX_ERROR * extent) ** 2):
            raise CalibrationError(UNDETERMINED)
        length = max(float(np.linalg.norm(solution[:3])), TINY)
        move = solution[:3] * min(1.0, MAX_MOVE * extent / length)
        # Back and forth for ever, where kept slopes are a little too flat: half the way is between.
        if iteration >= NEW_SLOPES and move @ (offsets[-1] - offsets[-2]) < 0:
            move = move / 2
        offset = offset + move
        offsets.append(offset)
        now = rendered(offset)[0]
        if np.all(np.abs(move) < SMALL_MOVE * np.sqrt(variance)):
            outcome = Outcome.CONVERGED
            break
    value = float(np.exp(solution[3]))
    return LightPosition(scene_file.light_ids[number], offset, np.sqrt(variance),
                         covariance[:3, :3], value, value * float(np.sqrt(covariance[3, 3])),
                         before, misfit, np.array(offsets), outcome)


def _extent(scene: Any, scene_file: SceneFile) -> float:
    """Diagonal of the box around all surfaces."""
    boxes = [shape.bbox() for shape in scene.shapes() if shape.id() in scene_file.surfaces]
    lower, upper = (np.array([np.array(end, dtype=float).ravel() for end in ends])
                    for ends in ([box.min for box in boxes], [box.max for box in boxes]))
    return float(np.linalg.norm(upper.max(axis=0) - lower.min(axis=0)))


def whitening(common: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Matrices (R, K, K) that make residuals independent, of variance 1 each.

    ``common`` (R,) is the variance that the bands of a block share, its paths' and its geometry's;
    ``own`` (R, K) is of each band alone.
    """
    bands = own.shape[1]
    shared = common[:, None, None] * np.ones((bands, bands))
    alone = (own + ROUND_OFF)[:, None, :] * np.eye(bands)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(shared + alone)))


def _solve(residual: np.ndarray, slopes: np.ndarray, whiten: np.ndarray,
           nuisance: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Weighted least-squares step in offset and log brightness (4,), from residuals (R, K), with
    its covariance (4, 4) and the misfit per degree of freedom.

    ``whiten`` (R, K, K) makes the residuals of each block independent and of variance 1; nuisances
    have a prior of variance 1. Slopes are (3, R, K), or none of them: the light stays where it is.
    """
    free, count = len(slopes), nuisance.shape[2]
    columns = np.concatenate([np.moveaxis(slopes, 0, 2), np.ones((*residual.shape, 1)), nuisance],
                             axis=2)
    rows = (whiten @ columns).reshape(residual.size, -1)
    rows = np.vstack([rows, np.eye(count, rows.shape[1], k=free + 1)])
    wanted = np.concatenate([(whiten @ residual[..., None]).ravel(), np.zeros(count)])
    size = np.sqrt(np.sum(rows**2, axis=0))
    if np.any(size[:free] < TINY):
        raise CalibrationError(UNDETERMINED)
    covariance = np.linalg.inv((rows / size).T @ (rows / size)) / np.outer(size, size)
    solution = covariance @ rows.T @ wanted
    misfit = float(np.sum((wanted - rows @ solution) ** 2)) / max(residual.size - free - 1, 1)
    covariance *= max(misfit, 1.0)
    return solution[:free + 1], covariance[:free + 1, :free + 1], misfit


def _nuisance(group: np.ndarray, material: np.ndarray, bands: int) -> np.ndarray:
    """Columns (R, K, U): a standard deviation of each surface's brightness, each material's bands.
    """
    surfaces = SURFACE_ERROR * (group[:, None] == np.unique(group)[None])
    paints = PAINT_ERROR * (material[:, None] == np.unique(material)[None])
    columns = np.hstack([np.repeat(surfaces, bands, axis=0), np.kron(paints, np.eye(bands))])
    return columns.reshape(len(group), bands, -1)


def _require_reflectances(scene_file: SceneFile,
                          reflectances: Mapping[str, np.ndarray]) -> tuple[str, ...]:
    bsdfs = tuple(dict.fromkeys(scene_file.surfaces.values()))
    if missing := [bsdf for bsdf in bsdfs if bsdf not in reflectances]:
        raise InputError(f"the reflectance of {', '.join(missing)} in {scene_file.path.name} is "
                         "not given; every surface sends light to the others, so all are needed")
    if glossy := not_plain_products(scene_file):
        raise InputError(f"{', '.join(glossy)} of {scene_file.path.name} is coated or glossy; the "
                         "light's position is estimated from diffuse surfaces only")
    return bsdfs
