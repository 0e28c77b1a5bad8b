"""A finished session replayed with known truths: its stored results to a rehearsal."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from spectrabox.measure.scene.rehearsal import (
    MaterialRehearsal,
    Replays,
    prepare_replays,
)
from spectrabox.measure.scene.rehearsal import rehearse as rehearse_scene
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import Progress
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.pipeline import load_finished, stage_states
from spectrabox.session.stages.reconstruct_stage import settings_of, stated_errors, views_of


def rehearse(config: SessionConfig, times: int, seed: int, device: str,
             progress: Progress) -> list[MaterialRehearsal]:
    """Replay a finished session with known truths.

    Parameters
    ----------
    config : SessionConfig
    times : int
        T, from 20 up.
    seed : int
        Of the truths, their photos and the draws.
    device : {"auto", "cpu", "cuda"}
    progress : callable

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
    with threadpool_limits(1, "blas"):      # as in the stages; the matrices are small
        replays = replays_of(config, times, seed, device,
                             lambda done, what: progress(0.1 * done, what))
        return rehearse_scene(replays, config.sampling.level, seed,
                              lambda done, what: progress(0.1 + 0.9 * done, what))


def replays_of(config: SessionConfig, times: int, seed: int, device: str,
               progress: Progress) -> Replays:
    """A finished session with its light traced, and the truths and cameras of its replays.

    Parameters and errors as of `rehearse`.
    """
    _require_replayable(config)
    records = load_finished(config).records
    start_mitsuba(device)
    drift = records.reconstruct.drift
    views = views_of(config, records, drift)
    return prepare_replays(
        views, settings_of(config), records.calibrations(config), records.reconstruct.joint,
        {name: material.families for name, material in config.materials.items()},
        stated_errors(config, records, views, drift),
        times=times, seed=seed, progress=progress)


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
    joint = load_finished(config).records.reconstruct.joint
    if not any("transport" in view.engine or "bounce" in view.engine for view in joint.views):
        raise InputError("a rehearsal needs the light transport, and this session was solved by "
                         f"the engine {joint.views[0].engine!r}")
