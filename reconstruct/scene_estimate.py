"""What of a scene is not as stated, estimated from its photo: pose, lamp, beam, vignetting.

Where photo and scene disagree beyond noise, the scene is estimated together with the surfaces. The
camera's pose comes first, from the edges of photo and rendering. Then the logarithms of the blocks'
signals are fitted by weighted least squares in the lamp's position and beam, the lens's fall-off,
and what is not known besides: the light scale, gains of bands, every paint in every band, the
brightness of every surface. All have Gaussian priors around what is stated. Derivatives are those
of the traced transport: the same paths with the lamp moved to and fro, or with another beam.

Painted patterns are no errors of the scene: each surface weighs by what its own blocks leave
unexplained, nothing is estimated where lamp and lens explain less than three tenths of it, and an
estimate that still leaves surfaces far apart is not kept: paints that shine are no error of the
scene either.

A tone curve would be taken for a lamp elsewhere: its power is one more unknown of a first fit, and
where it is not 1 nothing is estimated.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.reconstruct import linearity
from spectrabox.reconstruct.fit.transport_fit import TracedView
from spectrabox.reconstruct.fit.view_terms import ViewFit
from spectrabox.reconstruct.scene import beam, edit_scene, light_position, surfaces
from spectrabox.reconstruct.tracer.transport import TracedTransport
from spectrabox.reconstruct.view import PhotoView

# Standard deviations before the photo is seen; of the lamp's position that of linearity.py.
FALLOFF_ERROR = 0.3         # of the logarithm, in the corners: r^2 and r^4
TURN_ERROR, SHIFT_ERROR = np.radians(1.0), 0.02     # of the camera; of its distance
GAIN_ERROR = 0.05           # of a band, where paints are known
KNOWN_ERROR, UNKNOWN_ERROR, FREE = 0.01, 1.0, 10.0  # of a paint in a band; of the scale
SURFACE_ERROR = 0.01        # of a surface's brightness, besides a tilt of 1 degree
# relative, of a block in all bands and in each; a surface's blocks have no more independent ones
BLOCK_ERROR, PATTERN_TERMS = 0.01, 6
POWER_ERROR = 0.5           # of a tone curve's power
BEAM_STEP, LAMP_STEP = 0.1, 0.015       # of the derivatives; the second of the surfaces' extent
WEIGHING_ROUNDS = 3         # in which a surface's own pattern is told
HUBER = 3.0                 # standard deviations beyond which a block's pull grows no more
SLOPE_SPP, SOLVED_SPP = 64, 256     # paths per pixel of a derivative's traces, of a fit's
DISAGREEMENT = 0.01         # of surfaces, or within them, from which the scene is estimated
# that lamp and lens may leave, and as a share of what there was: those that are off leave .003 to
# .017, those that are fitted to paints that shine .025 and more
# (benchmarks/bench_scene_estimate.py, bench_scene_faults.py)
LEFT, LEFT_SHARE = 0.02, 0.25
CHANCE = 1e-3               # that a right scene shows as much
# of the variance of the blocks: where lamp and lens explain less, paints are uneven and send uneven
# light on to other surfaces (.1 to .4 of paints that are uneven by 8 %; .2 to .8 of lamps 2 cm off)
EXPLAINED = 0.3
TINY = 1e-300
GROUPS = {"lamp": slice(0, 3), "beam": slice(3, 3 + beam.TERMS),
          "vignetting": slice(3 + beam.TERMS, 5 + beam.TERMS)}
NAMED = 0.01                # chance at which one part of the scene is named as not as stated
EDGE_PX, FIELD_PX = 1.0, 3.0    # of blurs: that makes edges differentiable, that leaves fields
MIN_GRADIENT, MIN_EDGE_PIXELS = 0.05, 50    # of the logarithm by pixel, from which it is an edge
POSE_ROUNDS = 2
MIN_TURN_PX = 0.1           # a pose that moves edges by less is as stated
# of what edges differ by, that a camera's move must explain: one that is off explains .86 to .93,
# light that falls otherwise on edges, as of paints that shine, .04 to .43
EDGES_EXPLAINED = 0.6


def finding(parts: list[dict[str, Any]]) -> Finding:
    """That parts of the scene were estimated."""
    return Finding("scene.estimated", Severity.NOTE, values={"parts": parts})


def camera_part(turn: np.ndarray, error: float) -> dict[str, Any]:
    """The camera as a part of the scene, by a rotation vector (3,) and its error in radians."""
    return {"what": "camera", "size": float(np.degrees(np.linalg.norm(turn))),
            "error": float(np.degrees(error)), "named": True}


# ---- the camera's pose ---------------------------------------------------------------------------

def estimate_pose(view: PhotoView, rendered: np.ndarray
                  ) -> tuple[np.ndarray, np.ndarray, float, float] | None:
    """Turn and shift of the camera by which the rendering's edges meet the photo's; None where
    they do as they are.

    The logarithm of photo / rendering at edges, without what varies slowly over surfaces, is
    fitted by the motion that turn and shift give each point of the scene times the rendering's
    gradient. The focal length stays as it is.

    Parameters
    ----------
    view : PhotoView
    rendered : (H, W, K) array
        In the photo's unit.

    Returns
    -------
    to_world : (4, 4) array
        As of Mitsuba's sensors.
    turn : (3,) array
        Rotation vector, radians.
    turn_error : float
        Standard error along it, radians.
    explained : float
        Share of the edges' squared differences that the move explains.
    """
    from scipy.ndimage import gaussian_filter
    from scipy.special import chdtri

    logs = [np.log(np.maximum(gaussian_filter(image.mean(axis=2), EDGE_PX), floor))
            for image, floor in ((image, 1e-3 * float(np.percentile(image, 95)))
                                 for image in (view.measured, rendered))]
    camera = _Camera(view)
    motion, prior = camera.motion(), camera.prior
    down, right = np.gradient(logs[1])
    columns = -(right[..., None] * motion[..., 0] + down[..., None] * motion[..., 1])

    def sharp(image: np.ndarray) -> np.ndarray:
        """An image (H, W) without its fields over surfaces."""
        weight = gaussian_filter(view.used.astype(float), FIELD_PX)
        return np.asarray(image - gaussian_filter(image * view.used, FIELD_PX)
                          / np.maximum(weight, 1e-3))
    at = (np.hypot(right, down) > MIN_GRADIENT) & camera.seen & ~view.photo.saturated.any(axis=2)
    if np.count_nonzero(at) < MIN_EDGE_PIXELS:
        return None
    wanted = sharp(logs[0] - logs[1])[at]
    rows = np.stack([sharp(np.nan_to_num(columns[..., each])) for each in range(6)], axis=-1)[at]
    weight = np.ones(len(wanted))
    for _ in range(5):
        information = rows.T @ (weight[:, None] * rows)
        residual = wanted - rows @ np.linalg.lstsq(information, rows.T @ (weight * wanted),
                                                   rcond=None)[0]
        error = max(float(np.median(np.abs(residual))) / 0.6745, 1e-6)
        weight = np.minimum(1, HUBER / 2 * error / np.maximum(np.abs(residual), 1e-9))
    # a blurred pixel is not independent of its neighbours
    variance = error**2 * 4 * np.pi * EDGE_PX**2
    covariance = np.linalg.inv(information / variance + np.diag(1 / prior**2))
    pose = covariance @ (rows.T @ (weight * wanted)) / variance
    moved = np.einsum("nij,i->nj", motion[at], pose)
    move_px = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
    if (pose @ np.linalg.solve(covariance, pose) < chdtri(6, CHANCE) or move_px < MIN_TURN_PX):
        return None
    left = np.sum(weight * (wanted - rows @ pose) ** 2) / np.sum(weight * wanted**2)
    size = np.linalg.norm(pose[:3])
    along = pose[:3] / max(size, 1e-12)
    return (camera.placed(pose), camera.axes.T @ pose[:3],
            float(np.sqrt(along @ covariance[:3, :3] @ along)), 1 - float(left))


class _Camera:
    """A view's camera, and the points of the scene that its pixels see."""

    def __init__(self, view: PhotoView) -> None:
        import mitsuba as mi
        from scipy.ndimage import minimum_filter

        scene = view.scene()
        self.sensor = scene.sensors()[0]
        self.matrix = np.array(self.sensor.world_transform().matrix, dtype=float).reshape(4, 4)
        self.width, self.height = view.size
        row, column = np.indices((self.height, self.width))
        origin, away = self._rays((column.ravel() + 0.5) / self.width,
                                  (row.ravel() + 0.5) / self.height)
        hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(*origin.T), mi.Vector3f(*away.T)))
        shape = (self.height, self.width)
        distance = np.where(np.array(hit.is_valid()), np.array(hit.t), np.inf).reshape(shape)
        self.seen = np.isfinite(distance)
        # an edge moves with the nearer of the surfaces beside it
        nearest = minimum_filter(np.where(self.seen, distance, np.inf), 3)
        self.origin = origin[0]
        self.point = self.origin + away.reshape(*shape, 3) * np.where(
            np.isfinite(nearest), nearest, 1.0)[..., None]
        ends = self._rays(np.array([0.5, 0.0, 1.0, 0.5, 0.5]), np.array([0.5, 0.5, 0.5, 0, 1]))[1]
        forward = ends[0]
        plane = ends / (ends @ forward)[:, None]
        self.across, self.along = plane[2] - plane[1], plane[4] - plane[3]
        self.forward, self.corner = forward, plane[0] - (self.across + self.along) / 2
        unit = self.across / np.linalg.norm(self.across)
        self.axes = np.array([unit, np.cross(forward, unit), forward])
        self.prior = np.r_[np.full(3, TURN_ERROR), np.full(
            3, SHIFT_ERROR * float(np.median(distance[self.seen])))]

    def _rays(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        import mitsuba as mi

        ray, _ = self.sensor.sample_ray(0.0, 0.5, mi.Point2f(x, y), mi.Point2f(0.5))
        away = np.array(ray.d).T
        # rays start on the near plane: from their common centre instead
        return np.broadcast_to(self.matrix[:3, 3], away.shape), away

    def _turned(self, pose: np.ndarray) -> np.ndarray:
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_rotvec(self.axes.T @ pose[:3]).as_matrix())

    def _pixels(self, pose: np.ndarray) -> np.ndarray:
        """Columns and rows (H, W, 2) of the points, as a camera turned and shifted sees them."""
        seen = (self.point - self.origin - self.axes.T @ pose[3:]) @ self._turned(pose)
        plane = seen / (seen @ self.forward)[..., None] - self.corner
        return np.stack([plane @ self.across / (self.across @ self.across) * self.width,
                         plane @ self.along / (self.along @ self.along) * self.height], axis=-1)

    def motion(self) -> np.ndarray:
        """Motion (H, W, 6, 2) of each pixel's point, in pixels by unit of turn and shift."""
        as_stated = self._pixels(np.zeros(6))
        steps = 1e-3 * self.prior
        return np.stack([(self._pixels(step * unit) - as_stated) / step
                         for step, unit in zip(steps, np.eye(6), strict=True)], axis=2)

    def placed(self, pose: np.ndarray) -> np.ndarray:
        """Transform (4, 4) of the camera turned and shifted."""
        moved = self.matrix.copy()
        moved[:3, :3] = self._turned(pose) @ self.matrix[:3, :3]
        moved[:3, 3] = self.origin + self.axes.T @ pose[3:]
        return moved


# ---- lamp and lens -------------------------------------------------------------------------------

def estimate_lamp(stated: TracedView, solve: Callable[[TracedView], ViewFit],
                  trace: Callable[[PhotoView, int], TracedTransport]
                  ) -> tuple[PhotoView, dict[str, np.ndarray], list[dict[str, Any]],
                             tuple[Finding, ...]]:
    """Position and beam of the only lamp, and the lens's fall-off.

    Parameters
    ----------
    stated : TracedView
        Whose lamp has a position.
    solve : function of a traced view
        The fit of its spectra.
    trace : function of a view and of paths per pixel
        Its transport; the same seed every time.

    Returns
    -------
    view : PhotoView
        With the scene, beam and photo that are estimated.
    covariance : dict
        Name of a material -> (K, K) relative covariance of its signal by what is estimated.
    parts : list of dict
        Of the scene: what, size, error, whether it is certain. Empty where the photo shows lamp
        and lens to be as stated.
    findings : tuple of Finding
        That they cannot be estimated.
    """
    from scipy.special import chdtrc

    if stated.traced.spp < SOLVED_SPP:      # the noise of a trace would be left unexplained
        stated = replace(stated, traced=trace(stated.view, SOLVED_SPP))
    as_stated = stated.view, dict[str, np.ndarray](), list[dict[str, Any]]()
    problem = _LampProblem(stated, lambda view: trace(view, SLOPE_SPP), solve(stated))
    powers = [problem.power()]
    lamp, _, _, weight = problem.solved()
    if problem.chance(weight) > CHANCE:
        return *as_stated, ()
    most = (1 - EXPLAINED) * problem.unexplained(weight, 0)
    view = problem.changed(lamp)
    traced = replace(stated, view=view, traced=trace(view, SOLVED_SPP))
    problem.start_from(lamp, traced, solve(traced))
    powers.append(problem.power())
    lamp, covariance, of_materials, weight = problem.solved()
    # a lamp far off bends ratios as well, of which the second round knows
    bent = all(abs(value - 1) > max(linearity.DOUBTED * error, linearity.MIN_DEPARTURE)
               for value, error in powers)
    if bent and problem.unexplained(weight, lamp.size, tone=True) < most:
        value, error = powers[0]
        return *as_stated, (Finding("scene.not-linear", Severity.FAIL, values={
            "value": value, "error": error, "edges": []}),)
    if problem.unexplained(weight, lamp.size) > most:
        return *as_stated, ()
    parts = []
    for name, where in GROUPS.items():
        own, of_own = lamp[where], covariance[where, where]
        squares = float(own @ np.linalg.solve(of_own, own))
        size, error = problem.size_of(name, own, of_own)
        parts.append({"what": name, "size": size, "error": error,
                      "named": bool(chdtrc(own.size, squares) < NAMED)})
    return problem.changed(lamp), of_materials, parts, ()


class _LampProblem:
    """The linear problem of one view: residuals of log signals, and their derivatives."""

    def __init__(self, traced: TracedView, trace: Callable[[PhotoView], TracedTransport],
                 fit: ViewFit) -> None:
        self.view = traced.view
        predicted = fit.scale * (traced.traced.coefficients @ fit.signals)
        kept = ((predicted > 0) & (traced.measured > 0)).all(axis=1) & (
            traced.weight.max(axis=1) > 0)
        height, width = traced.region.shape
        row, column = surfaces.region_means(np.moveaxis(np.indices((height, width)), 0,
                                                        -1).astype(float),
                                            traced.region).T
        point, _, _ = surfaces.hits_of(self.view.scene(), (width, height), row.round().astype(int),
                                       column.round().astype(int))
        self.extent = float(np.linalg.norm(np.ptp(point[kept], axis=0)))
        self.number = edit_scene.light_number(self.view.scene_file, None)
        lamp, tangent = _lamp_seen(self.view, row, column)
        axis = point[kept].mean(axis=0) - lamp
        self.beam = beam.Beam(axis / np.linalg.norm(axis), np.zeros(beam.TERMS))
        radius = np.hypot(column - (width - 1) / 2, row - (height - 1) / 2) / np.hypot(
            (width - 1) / 2, (height - 1) / 2)
        self.falloff = np.column_stack([radius**2, radius**4])
        self.trace, self.kept = trace, kept
        self._linearise(np.zeros(5 + beam.TERMS), traced, fit)
        self.prior = np.r_[np.full(3, linearity.LAMP_ERROR * self.extent), beam.PRIOR,
                           np.full(2, FALLOFF_ERROR)]
        group = traced.group[kept]
        blocks = np.bincount(group)[group]
        pixels = np.bincount(traced.region[traced.region >= 0])[kept]
        noise = surfaces.region_means(self.view.photo.variance.astype(float), traced.region)[kept]
        self.group, self.correlated = group, np.maximum(blocks / PATTERN_TERMS, 1)
        self.common_noise = traced.traced.relative_variance[kept]
        self.noise = noise / pixels[:, None] / traced.measured[kept] ** 2
        self._add_unknown(group, tangent[kept])
        self._weigh()

    def _add_unknown(self, group: np.ndarray, tangent: np.ndarray) -> None:
        """Columns (R, K, U) and standard deviations (U,) of all that is unknown besides the lamp;
        those of materials first.
        """
        names = [material.name for material in self.view.scene_materials]
        of_surface = np.array([names.index(name) for name in self.view.surface_materials])
        material = of_surface[group]
        shown = [index for index in range(len(names)) if (material == index).any()]
        self.shown = [names[index] for index in shown]
        bands = self.log.shape[1]
        unit = np.eye(bands)
        paints = (material[:, None] == np.array(shown))[:, None, :, None] * unit[:, None, :]
        surfaces = np.unique(group)
        own = (group[:, None] == surfaces)
        tilt = linearity.TILT_ERROR * np.array([np.median(tangent[group == surface])
                                                for surface in surfaces])
        self.unknown = np.concatenate([
            paints.reshape(len(group), bands, -1),
            np.broadcast_to(unit, (len(group), bands, bands)),
            np.ones((len(group), bands, 1)),
            np.repeat(own[:, None], bands, axis=1)], axis=2).astype(float)
        known = [name in self.view.known for name in self.shown]
        self.unknown_error = np.r_[
            np.repeat(np.where(known, KNOWN_ERROR, UNKNOWN_ERROR), bands),
            np.full(bands, GAIN_ERROR), FREE, np.hypot(SURFACE_ERROR, tilt)]

    def start_from(self, lamp: np.ndarray, traced: TracedView, fit: ViewFit) -> None:
        """Take residuals (R, K) from lamp and lens as estimated, with derivatives and weights."""
        self._linearise(lamp, traced, fit)
        self._weigh()

    def _weigh(self) -> None:
        """Whitening (R, K, K) of the blocks, by what each surface's own leave unexplained.

        A pattern that is painted on a surface is not as many independent errors as it fills
        blocks: however large it is, it has ``PATTERN_TERMS`` of them.
        """
        own = np.full(self.residual.shape[0], BLOCK_ERROR**2)
        for _ in range(WEIGHING_ROUNDS):
            pattern = own * self.correlated
            self.white = light_position.whitening(pattern + self.common_noise,
                                                  pattern[:, None] + self.noise)
            left = self._least_squares(self.columns, self.prior,
                                       np.where(self.dark, 0.0, 1.0))[2]
            # half of the variance is common to the bands
            unexplained = self._beyond_noise(left) / 2
            for surface in np.unique(self.group):
                blocks = (self.group == surface) & ~self.dark
                if blocks.any():
                    own[self.group == surface] = max(
                        BLOCK_ERROR**2, float(np.median(unexplained[blocks])))

    def _beyond_noise(self, left: np.ndarray) -> np.ndarray:
        """Squares (R,) of residuals (R, K), mean over the bands, less their noise."""
        return np.asarray(np.mean(left**2 - self.noise, axis=1) - self.common_noise)

    def unexplained(self, weight: np.ndarray, count: int, tone: bool = False) -> float:
        """Variance of the blocks beyond noise that lamp and lens leave, or a tone curve with them.

        Parameters
        ----------
        weight : (R,) array
        count : int
            Of the lamp's and the lens's unknowns, how many are fitted.
        tone : bool
        """
        columns, prior = self._with_tone() if tone else (self.columns[..., :count],
                                                         self.prior[:count])
        left = self._least_squares(columns, prior, weight)[2]
        return max(float(weight @ self._beyond_noise(left) / weight.sum()), 0.0)

    def _linearise(self, lamp: np.ndarray, traced: TracedView, fit: ViewFit) -> None:
        """Residuals (R, K) with lamp and lens as estimated, and their derivatives (R, K, L)."""
        self.start, self.signals = lamp, fit.signals
        slopes = self._slopes()[:, self.kept]
        self.dark = ~np.isfinite(slopes).all(axis=(0, 2))
        slopes = np.nan_to_num(np.moveaxis(slopes, 0, 2), posinf=0.0, neginf=0.0)
        self.columns = np.concatenate([slopes, np.repeat(
            self.falloff[self.kept][:, None], slopes.shape[1], axis=1)], axis=2)
        predicted = fit.scale * (traced.traced.coefficients @ fit.signals)[self.kept]
        self.log = np.log(np.maximum(predicted, TINY))
        self.residual = np.log(np.maximum(traced.measured[self.kept], TINY)) - self.log

    def _slopes(self) -> np.ndarray:
        """Derivatives (3 + 5, R, K) of the log signals by the lamp's position and beam."""
        def logs(offset: np.ndarray, beam: np.ndarray) -> np.ndarray:
            view = self.changed(self.start + np.r_[offset, beam, 0, 0])
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.asarray(np.log(self.trace(view).coefficients @ self.signals))
        none, step = np.zeros(beam.TERMS), LAMP_STEP * self.extent
        even = logs(np.zeros(3), none)
        with np.errstate(invalid="ignore"):
            by_place = [(logs(move, none) - logs(-move, none)) / (2 * step)
                        for move in step * np.eye(3)]
            by_beam = [(logs(np.zeros(3), BEAM_STEP * unit) - even) / BEAM_STEP
                       for unit in np.eye(beam.TERMS)]
        return np.array([*by_place, *by_beam])

    def changed(self, lamp: np.ndarray) -> PhotoView:
        """The view with its lamp and lens as estimated.

        Parameters
        ----------
        lamp : (L,) array
        """
        view = self.view
        scene = edit_scene.with_light_moved(view.scene_file, self.number, lamp[:3])
        photo = view.photo
        if lamp[-2:].any():
            height, width = photo.signal.shape[:2]
            row, column = np.indices((height, width))
            radius = np.hypot(column - (width - 1) / 2, row - (height - 1) / 2) / np.hypot(
                (width - 1) / 2, (height - 1) / 2)
            factor = np.exp(-(lamp[-2] * radius**2 + lamp[-1] * radius**4))[..., None]
            photo = replace(photo, signal=(photo.signal * factor).astype(np.float32),
                            variance=(photo.variance * factor**2).astype(np.float32))
        changed = replace(view, scene_file=scene, photo=photo,
                          beam=replace(self.beam, coefficients=lamp[3:3 + beam.TERMS]))
        vars(changed).update(surface=view.surface, used=view.used)  # the camera is the same
        return changed

    def power(self) -> tuple[float, float]:
        """Power of the photo's tone curve with all else unknown, and its standard error."""
        solution, covariance, _, _ = self._least_squares(
            *self._with_tone(), np.where(self.dark, 0.0, 1.0))
        place = self.prior.size
        return 1 + float(solution[place]), float(np.sqrt(covariance[place, place]))

    def _with_tone(self) -> tuple[np.ndarray, np.ndarray]:
        """Columns and standard deviations of lamp, lens and a tone curve's power."""
        level = self.log - self.log.mean()
        return (np.concatenate([self.columns, level[..., None]], axis=2),
                np.r_[self.prior, POWER_ERROR])

    def chance(self, weight: np.ndarray) -> float:
        """Chance that a scene that is right shows as much, by its lamp, its beam or its lens alone,
        or by all together.

        Parameters
        ----------
        weight : (R,) array
        """
        from scipy.special import chdtrc

        misfit = max(self._least_squares(self.columns, self.prior, weight)[3], 1.0)
        without = self._cost(self.columns[..., :0], self.prior[:0], weight)
        causes = [*GROUPS.values(), slice(None)]
        each = [chdtrc(self.prior[cause].size, max(without - self._cost(
            self.columns[..., cause], self.prior[cause], weight), 0.0) / misfit)
            for cause in causes]
        return len(causes) * float(min(each))

    def solved(self) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray], np.ndarray]:
        """Position, beam and fall-off (L,), their covariance (L, L), by material the covariance of
        its signal by them, and the weight (R,) of each block.
        """
        count = self.prior.size
        weight = np.where(self.dark, 0.0, 1.0)
        for _ in range(3):
            solution, covariance, left, misfit = self._least_squares(
                self.columns, self.prior, weight)
            size = np.sqrt(np.sum((self.white @ left[..., None])[..., 0]**2, axis=1)
                           / left.shape[1])
            weight = np.where(self.dark, 0.0, np.minimum(
                1, HUBER * max(np.sqrt(misfit), 1.0) / np.maximum(size, 1e-9)))
        bands, held = self.log.shape[1], slice(count, count + len(self.shown) * self.log.shape[1])
        # the share of the paints' errors that comes by lamp and lens
        rows, _ = self._rows(self.columns[..., :0], self.prior[:0], weight)
        alone = max(misfit, 1.0) * np.linalg.inv(rows.T @ rows)
        own = covariance[held, held] - alone[:held.stop - count, :held.stop - count]
        values, vectors = np.linalg.eigh((own + own.T) / 2)
        own = (vectors * np.maximum(values, 0)) @ vectors.T
        of_materials = {name: own[index * bands:(index + 1) * bands,
                                  index * bands:(index + 1) * bands]
                        for index, name in enumerate(self.shown)}
        return (self.start + solution[:count], covariance[:count, :count], of_materials, weight)

    def size_of(self, name: str, own: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
        """How far a part of the scene is off, and its standard error: the lamp's offset in the
        scene's unit, the range of the beam over the blocks, the light lost in the corners.
        """
        if name == "lamp":
            size = float(np.linalg.norm(own))
            along = own / max(size, 1e-12)
            return size, float(np.sqrt(along @ covariance @ along))
        if name == "beam":
            logs = self.columns[:, :, GROUPS[name]].mean(axis=1)
            by_block = logs @ own
            along = logs[by_block.argmax()] - logs[by_block.argmin()]
        else:
            along = np.ones(2)
        log, error = float(along @ own), float(np.sqrt(along @ covariance @ along))
        sign = 1 if name == "beam" else -1      # brightest over darkest; darker by the lens
        return sign * float(np.expm1(log)), float(np.exp(log)) * error

    def _rows(self, columns: np.ndarray, prior: np.ndarray,
              weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        whole = np.concatenate([columns, self.unknown], axis=2)
        root = self.white * np.sqrt(weight)[:, None, None]
        rows = (root @ whole).reshape(self.residual.size, -1)
        wanted = (root @ self.residual[..., None]).ravel()
        error = np.r_[prior, self.unknown_error]
        held = np.zeros(error.size)
        known = min(self.start.size, columns.shape[2])
        held[:known] = -self.start[:known]
        return np.vstack([rows, np.diag(1 / error)]), np.r_[wanted, held / error]

    def _cost(self, columns: np.ndarray, prior: np.ndarray, weight: np.ndarray) -> float:
        rows, wanted = self._rows(columns, prior, weight)
        return float(np.sum((wanted - rows @ np.linalg.lstsq(rows, wanted, rcond=None)[0]) ** 2))

    def _least_squares(self, columns: np.ndarray, prior: np.ndarray, weight: np.ndarray
                       ) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Solution, its covariance widened by the misfit, residuals (R, K), misfit."""
        rows, wanted = self._rows(columns, prior, weight)
        covariance = np.linalg.inv(rows.T @ rows)
        solution = covariance @ (rows.T @ wanted)
        misfit = float(np.sum((wanted - rows @ solution) ** 2)) / self.residual.size
        left = self.residual - np.concatenate([columns, self.unknown], axis=2) @ solution
        return solution, covariance * max(misfit, 1.0), left, misfit


def _lamp_seen(view: PhotoView, row: np.ndarray,
               column: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) of the lamp, and tangent (R,) of the angle at which its light falls on pixels.
    """
    import mitsuba as mi

    scene = view.scene()
    position = mi.Point2f((column + 0.5) / view.size[0], (row + 0.5) / view.size[1])
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, position, mi.Point2f(0.5))
    hit = scene.ray_intersect(mi.Ray3f(ray))
    light, _ = scene.sample_emitter_direction(hit, mi.Point2f(0.5), False)
    cosine = np.abs(np.sum(np.array(hit.n).T * np.array(light.d).T, axis=1)).clip(0.02, 1)
    place = np.nanmedian(np.array(light.p).T, axis=0)
    return place, np.nan_to_num(np.sqrt(1 / cosine**2 - 1), nan=1.0)


def can_be_estimated(view: PhotoView) -> bool:
    """Whether a view has one lamp, with a position."""
    lights = list(view.scene_file.root.iter("emitter"))
    return len(lights) == 1 and lights[0].get("type", "") in edit_scene.POSITIONED
