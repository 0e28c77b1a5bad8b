"""Simulation-based calibration of one session: its own photos again, with known truths.

Talts, Betancourt, Simpson, Vehtari and Gelman 2018: where truths are drawn from the prior and data
from the truths, the rank of each truth among the draws is uniform if everything between is right.
Here what lies between is this session's geometry, light, camera, noise and errors. Truths are made
by the models behind the prior's families, not drawn from the fitted mixture, so that bands can fail
by the prior too. Reflectances, curves of the camera, the light's readings, scale and repeatability,
glare and stray light, surfaces that are brighter than the scene says and uneven, and the noise of
photo and tracing are drawn anew each time; the transport, traced once, carries them to a photo, and
the session's own code takes it from there. What the session takes as certain is certain here too:
where the lamp stands, that surfaces are matt. It shows "calibrated here" as far as the stated
errors are right.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from spectrabox.calibrate.prior.curve_posterior import sensitivity_draws
from spectrabox.measure.scene.photo_errors import with_photo_errors
from spectrabox.measure.surface_signals import measurement, scene_signals
from spectrabox.radiometry.error_model import drift_covariance, scale_covariances
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import Calibration, JointReconstruction, LightDrift, Progress
from spectrabox.radiometry.response import response_matrix, white_signal
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.reconstruct.fit.traced_view import TracedView
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.replay import Stage, Truth, replay, set_stage
from spectrabox.sampling.prior.families.truths import true_reflectances
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, load_prior, of_families
from spectrabox.sampling.prior.signal_posterior import solve_posterior
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.pipeline import load_finished, stage_states
from spectrabox.session.stages.reconstruct_stage import (
    drift_of,
    glare_error,
    settings_of,
    views_of,
)
from spectrabox.session.stages.stored_records import calibrations_of, joint_of
from spectrabox.session.store.store import StoredStage

DRAWS = 399              # of each posterior: ranks 0 to 399 fall into ten bins of 40
RANK_BINS = 10
RANK_STEP = 6            # every 30 nm: closer wavelengths rank alike
MIN_TIMES = 20

Scores = tuple[float, float, float, np.ndarray]


@dataclass(frozen=True, eq=False)
class MaterialRehearsal:
    """How one material's bands held known truths, over T rehearsals."""

    name: str
    coverage: np.ndarray        # (T,) share of wavelengths inside the band
    rmse: np.ndarray            # (T,) of the mean
    width: np.ndarray           # (T,) mean over wavelengths
    ranks: np.ndarray           # (bins,) truths by their rank among the draws, every 30 nm

    @property
    def coverage_error(self) -> float:
        """Standard error of the mean coverage; wavelengths of one truth are no separate trials."""
        return float(self.coverage.std(ddof=1) / np.sqrt(self.coverage.size))


def rehearse(config: SessionConfig, times: int, seed: int, device: str,
             progress: Progress) -> list[MaterialRehearsal]:
    """Replay a finished session with known truths.

    Parameters
    ----------
    times : int
        T, from 20 up.
    seed : int
        Of the truths, their photos and the draws.
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    list of MaterialRehearsal
        Of every unknown material.

    Raises
    ------
    InputError
        If the session is not finished, was solved by another engine than the transport's, samples
        by another method than the prior, or is to be rehearsed fewer than 20 times.
    """
    if times < MIN_TIMES:
        raise InputError(f"{times} rehearsals tell nothing of coverage: {MIN_TIMES} or more are "
                         "needed, and 200 know it to about one percent")
    of_times = np.random.SeedSequence(seed).spawn(2)[1]
    rows = []
    with threadpool_limits(1, "blas"):      # as in the stages; the matrices are small
        scene = prepared(config, times, seed, device,
                         lambda done, what: progress(0.1 * done, what))
        for number, one in enumerate(of_times.spawn(times)):
            progress(0.1 + 0.9 * number / times, f"rehearsal {number + 1} of {times}")
            rows.append(scene.once(number, one))
    return [_gathered(name, [row[index] for row in rows])
            for index, name in enumerate(scene.priors)]


def prepared(config: SessionConfig, times: int, seed: int, device: str,
             progress: Progress) -> Rehearsed:
    """A finished session with its light traced, and the truths and cameras of its replays.

    Parameters and errors as of `rehearse`.
    """
    _require_replayable(config)
    stored = load_finished(config).stored
    calibrations, joint = calibrations_of(config, stored), joint_of(stored)
    start_mitsuba(device)
    progress(0.0, "tracing light")
    drift = drift_of(config, stored)
    prior = load_prior()
    priors = {name: of_families(prior, config.materials[name].families)
              for name, known in zip(joint.materials, joint.known, strict=True) if not known}
    of_truths = np.random.SeedSequence(seed).spawn(2)[0]
    truths = {name: true_reflectances(own, times, np.random.default_rng(one)) for (name, own), one
              in zip(priors.items(), of_truths.spawn(len(priors)), strict=True)}
    stage = set_stage(views_of(config, stored, drift), settings_of(config), progress)
    return Rehearsed(config, stored, drift, stage, calibrations, joint, priors, truths,
                     _cameras(calibrations[0], times, seed))


@dataclass(frozen=True, eq=False)
class Rehearsed:
    """A session as it is replayed, and the cameras (T, K, P) of the replays."""

    config: SessionConfig
    stored: Mapping[str, StoredStage]
    drift: LightDrift | None
    stage: Stage
    calibrations: Sequence[Calibration]
    joint: JointReconstruction
    priors: Mapping[str, LogitMixture]      # of every unknown material, of its families if stated
    truths: Mapping[str, np.ndarray]        # (T, 61) each
    cameras: np.ndarray

    def once(self, number: int, seed: np.random.SeedSequence) -> list[Scores]:
        """Scores of every unknown material in one replay."""
        rng = np.random.default_rng(seed)
        return self.scores(self.again(number, rng), number, rng)

    def again(self, number: int, rng: np.random.Generator) -> JointReconstruction:
        """The reconstruction from photos of one truth."""
        return with_photo_errors(replay(self.stage, self.truth(number, rng), rng), self.drift,
                                 glare_error(self.config, self.stored),
                                 self.config.stray_light.ambient)

    def truth(self, number: int, rng: np.random.Generator) -> Truth:
        """What is photographed in one replay."""
        joint = self.joint
        spectra = {name: joint.spectra[index] for index, name in enumerate(joint.materials)}
        spectra |= {name: np.interp(joint.grid.nm, PRIOR_GRID.nm, truths[number])
                    for name, truths in self.truths.items()}
        views = range(len(self.stage.views))
        responses = tuple(self._response(index, self.cameras[number], rng) for index in views)
        return Truth(spectra, responses, *self._stray_light(rng))

    def scores(self, again: JointReconstruction, number: int,
               rng: np.random.Generator) -> list[Scores]:
        """Scores of every unknown material of one replay, drawn as the session draws."""
        scores, signals = [], scene_signals(again, self.calibrations)
        for name, prior in self.priors.items():
            seen = measurement(signals, again.materials.index(name))
            spectra = solve_posterior(prior, seen).draws(DRAWS, int(rng.integers(1 << 31)))
            scores.append(_scores(spectra, self.truths[name][number],
                                  self.config.sampling.level))
        return scores

    def _stray_light(self, rng: np.random.Generator) -> tuple[tuple[np.ndarray, ...],
                                                              tuple[float, ...]]:
        """Glare (K,) and ambient light of each view: as large as stated, and never less than none.
        """
        error, views = glare_error(self.config, self.stored), len(self.stage.views)
        glare = [error * part for part in np.abs(rng.standard_normal(views))]
        ambient = self.config.stray_light.ambient * np.abs(rng.standard_normal(views))
        return tuple(glare), tuple(ambient.tolist())

    def _response(self, index: int, curves: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Response (L, K, P) of a true camera (K, P) under true light, with the true scale in it.
        """
        factor = _response(self.stage.views[index], self.calibrations[index], self.joint, index,
                           curves, rng)
        if self.drift is None or index:
            return factor
        colour = rng.multivariate_normal(np.zeros(factor.shape[1]), drift_covariance(self.drift))
        return factor * (1 + colour)[:, None]


def facts(rehearsals: Sequence[MaterialRehearsal], level: float, seed: int) -> dict[str, Any]:
    """The rehearsal as JSON."""
    return {"level": level, "seed": seed, "times": int(rehearsals[0].coverage.size),
            "materials": [{"name": each.name, "coverage": float(each.coverage.mean()),
                           "coverage_standard_error": each.coverage_error,
                           "rmse": float(each.rmse.mean()), "width": float(each.width.mean()),
                           "ranks": each.ranks.tolist()} for each in rehearsals]}


def _require_replayable(config: SessionConfig) -> None:
    if config.flat:
        raise InputError("a rehearsal traces the light of a scene, and this session has flat "
                         "samples and no scene; 'spectrabox certify' tests bands without one")
    waiting = [state.name for state in stage_states(config) if state.state in ("stale", "missing")]
    if waiting:
        raise InputError(f"stage {waiting[0]!r} is not up to date: run 'spectrabox run' first")
    if config.sampling.method != "prior" or config.sampling.through != "surface":
        raise InputError("a rehearsal draws its truths from the learnt prior, one surface after "
                         "another: set [sampling] method = \"prior\" and through = \"surface\"")
    joint = joint_of(load_finished(config).stored)
    if not any("transport" in view.engine or "bounce" in view.engine for view in joint.views):
        raise InputError("a rehearsal needs the light transport, and this session was solved by "
                         f"the engine {joint.views[0].engine!r}")


def _cameras(calibration: Calibration, times: int, seed: int) -> np.ndarray:
    """Curves (T, K, P) of as many cameras as there are rehearsals."""
    fit = calibration.sensitivity
    if fit.covariance is not None:
        return sensitivity_draws(calibration, times, seed)
    # measured curves: each admits a stated share of light from everywhere
    rng = np.random.default_rng(seed)
    bands = len(fit.curves)
    shares = rng.multivariate_normal(np.zeros(bands), calibration.relative_covariance, times)
    tails = fit.curves.mean(axis=1, keepdims=True) * np.ones_like(fit.curves)
    return np.asarray(fit.curves + shares[..., None] * (tails - fit.curves))


def _response(traced: TracedView, calibration: Calibration, joint: JointReconstruction, index: int,
              curves: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Response (L, K, P) of a true camera (K, P) under true light, with the true scale in it."""
    view = traced.view
    stated = calibration.light.standard_error
    noise = np.zeros_like(view.light) if stated is None else np.interp(
        view.grid.nm, calibration.light.grid.nm, stated * rng.standard_normal(stated.size))
    light = np.maximum(spectrum_on_grid(calibration.light, view.grid) + noise, 0)
    separate = traced.traced.passes.shape[2] > 1
    lights = [view.own_lights.get(name, light) for name, in view.light_groups] if separate \
        else [light]
    # what a band reads of white is calibrated, and known to the error of the scale
    covariance = sum(scale_covariances(calibration, joint.views[index].light_scale).values())
    white = white_signal(view.response) * (1 + rng.multivariate_normal(
        np.zeros(len(view.bands)), covariance))
    factor = joint.views[index].light_scale.value * white / white_signal(
        response_matrix(view.grid, curves, light))
    return np.array([response_matrix(view.grid, curves, each) * factor[:, None]
                     for each in lights])


def _scores(draws: np.ndarray, truth: np.ndarray, level: float) -> Scores:
    """Coverage, RMSE of the mean, mean width, and truths (bins,) by their rank."""
    lower, upper = np.quantile(draws, [(1 - level) / 2, (1 + level) / 2], axis=0)
    ranks = (draws[:, ::RANK_STEP] < truth[::RANK_STEP]).sum(axis=0)
    bins = np.bincount(ranks * RANK_BINS // (DRAWS + 1), minlength=RANK_BINS)
    inside = (truth >= lower) & (truth <= upper)
    return (float(inside.mean()), float(np.sqrt(np.mean((draws.mean(axis=0) - truth) ** 2))),
            float(np.mean(upper - lower)), bins)


def _gathered(name: str, rows: Sequence[Scores]) -> MaterialRehearsal:
    coverage, rmse, width, ranks = zip(*rows, strict=True)
    return MaterialRehearsal(name, np.array(coverage), np.array(rmse), np.array(width),
                             np.sum(ranks, axis=0))
