"""A finished session replayed with known truths, and rendered under another light."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.measure.captured import SceneCapture, require_scene
from spectrabox.measure.pictures import texture_files
from spectrabox.measure.records import CaptureRecords
from spectrabox.measure.results.calibration_facts import checks
from spectrabox.measure.scene import box_camera
from spectrabox.measure.scene.rehearsal import Rehearsed
from spectrabox.measure.scene.rehearsal import rehearse as rehearse_scene
from spectrabox.measure.scene.relight import ColourSpread, light_by_itself
from spectrabox.measure.scene.relight import relight as relight_scene
from spectrabox.measure.steps import inversion
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Progress
from spectrabox.radiometry.spectra.named_spectra import light as named_light
from spectrabox.radiometry.spectra.named_spectra import sensitivities as named_observer
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.session import kept_stages
from spectrabox.session.config.session_file import SessionConfig

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
    capture, records = _replayable(config)
    start_mitsuba(device)
    views = inversion.views_of(capture, records)
    return rehearse_scene(
        views, inversion.settings_of(capture), records.calibrations(capture.views),
        records.reconstruct.joint, capture.families,
        *inversion.stray_light(capture, records, views),
        times=times, level=config.sampling.level, seed=seed, progress=progress)


def _replayable(config: SessionConfig) -> tuple[SceneCapture, CaptureRecords]:
    """A finished session that a rehearsal can follow."""
    capture = require_scene(config.capture(), NO_SCENE)
    waiting = [name for name, (state, _) in kept_stages.stage_states(config).items()
               if state in ("stale", "missing")]
    if waiting:
        raise InputError(f"stage {waiting[0]!r} is not up to date: run 'spectrabox run' first")
    if config.sampling.method != "prior" or config.sampling.through != "surface":
        raise InputError("a rehearsal draws its truths from the learnt prior, one surface after "
                         "another: set [sampling] method = \"prior\" and through = \"surface\"")
    finished = kept_stages.load_finished(config)
    joint = finished.records.reconstruct.joint
    if not any("transport" in view.engine or "bounce" in view.engine for view in joint.views):
        raise InputError("a rehearsal needs the light transport, and this session was solved by "
                         f"the engine {joint.views[0].engine!r}")
    return capture, finished.records


# ---- the stored results of a finished session, rendered under another light ----------------------

OBSERVER = "CIE 1931 2 Degree Standard Observer"


def relight(run: kept_stages.FinishedRun, *, light: str | None, observer: str,
            size: tuple[int, int], spp: int, device: str, pictures: Path
            ) -> tuple[np.ndarray, np.ndarray, dict[str, ColourSpread], tuple[str, ...]]:
    """Render the scene with the means of the draws, and with the textures of a picture of spectra.

    Parameters
    ----------
    run : FinishedRun
    light : str or None
        A CIE illuminant or a file; None for the session's own.
    observer : str
        Colour-matching functions by name or from a file of three curves.
    size : (width, height)
        In pixels.
    spp : int
        Paths per pixel.
    device : {"auto", "cpu", "cuda"}
    pictures : Path
        Folder of the picture of spectra.

    Returns
    -------
    xyz, picture, colours
        As of ``measure.scene.relight.relight``.
    notes : tuple of str
        How surely the light by itself is known.

    Raises
    ------
    InputError
        If light or observer are not known.
    """
    records = run.records
    capture = require_scene(run.capture, "session.toml describes regions of a flat sample and no "
                            "scene; this needs a session with [scene]")
    joint, calibration = records.reconstruct.joint, records.calibrations(capture.views)[0]
    grid = joint.grid
    power = light_by_itself(calibration, grid) if light is None else named_light(light, grid)
    matching = named_observer(observer, grid)
    spectra = {name: spectrum if known else records.spectra[name].draws
               for name, known, spectrum in zip(joint.materials, joint.known, joint.spectra,
                                                strict=True)}
    start_mitsuba(device)
    scene = box_camera.scene_of(capture.views[0].scene)
    relit = relight_scene(scene, capture.bsdfs, spectra, grid, power, matching,
                          size=size, spp=spp, seed=capture.seed,
                          textures={} if records.picture is None else texture_files.textures_of(
                              records.picture.files, scene.surfaces, pictures))
    posterior = calibration.light_posterior
    if light is not None or posterior is None:
        return *relit, ()
    return *relit, ("nobody measured the session's light: rendered under the most likely one",
                    *checks(posterior.findings))
