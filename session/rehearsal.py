"""A finished session replayed with known truths: its stored results to a rehearsal."""
from __future__ import annotations

from spectrabox.measure.captured import SceneCapture, require_scene
from spectrabox.measure.records import CaptureRecords
from spectrabox.measure.scene.rehearsal import Replays, prepare_replays
from spectrabox.measure.scene.rehearsal import rehearse as rehearse_scene
from spectrabox.measure.scene.rehearsed import Rehearsed, RehearsedMaterial
from spectrabox.measure.steps.inversion import settings_of, stated_errors, views_of
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Progress
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.session.config.session_file import SessionConfig
from spectrabox.session.kept_stages import load_finished, stage_states

NO_SCENE = ("a rehearsal traces the light of a scene, and this session has flat samples and no "
            "scene")


def rehearse(config: SessionConfig, times: int, seed: int, device: str,
             progress: Progress) -> Rehearsed:
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
    Rehearsed
        Of every unknown material.

    Raises
    ------
    InputError
        If the session is not finished, was solved by another engine than the transport's, samples
        by another method than the prior, or is to be rehearsed fewer than 20 times.
    """
    replays = replays_of(config, times, seed, device,
                         lambda done, what: progress(0.1 * done, what))
    rehearsals = rehearse_scene(replays, config.sampling.level, seed,
                                lambda done, what: progress(0.1 + 0.9 * done, what))
    return Rehearsed(config.sampling.level, seed, int(rehearsals[0].coverage.size), tuple(
        RehearsedMaterial(each.name, float(each.coverage.mean()), float(each.coverage_error),
                          float(each.rmse.mean()), float(each.width.mean()),
                          tuple(each.ranks.tolist())) for each in rehearsals))


def replays_of(config: SessionConfig, times: int, seed: int, device: str,
               progress: Progress) -> Replays:
    """A finished session with its light traced, and the truths and cameras of its replays.

    Parameters and errors as of `rehearse`.
    """
    capture, records = _replayable(config)
    start_mitsuba(device)
    views = views_of(capture, records)
    return prepare_replays(
        views, settings_of(capture), records.calibrations(capture.views),
        records.reconstruct.joint, capture.families,
        stated_errors(capture, records, views),
        times=times, seed=seed, progress=progress)


def _replayable(config: SessionConfig) -> tuple[SceneCapture, CaptureRecords]:
    """A finished session that a rehearsal can follow."""
    capture = require_scene(config.capture(), NO_SCENE)
    waiting = [state.name for state in stage_states(config) if state.state in ("stale", "missing")]
    if waiting:
        raise InputError(f"stage {waiting[0]!r} is not up to date: run 'spectrabox run' first")
    if config.sampling.method != "prior" or config.sampling.through != "surface":
        raise InputError("a rehearsal draws its truths from the learnt prior, one surface after "
                         "another: set [sampling] method = \"prior\" and through = \"surface\"")
    finished = load_finished(config)
    joint = finished.records.reconstruct.joint
    if not any("transport" in view.engine or "bounce" in view.engine for view in joint.views):
        raise InputError("a rehearsal needs the light transport, and this session was solved by "
                         f"the engine {joint.views[0].engine!r}")
    return capture, finished.records
