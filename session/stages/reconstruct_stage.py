"""The stage that finds spectra: photos, scenes and calibrations to one reconstruction."""
from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from spectrabox.radiometry.light_drift import (
    LightDrift,
    drift_between,
    drift_covariance,
    scale_after_drift,
)
from spectrabox.radiometry.light_scale import scale_for_photo
from spectrabox.radiometry.records import (
    Calibration,
    JointReconstruction,
    LearntSpectra,
    LightScale,
    LinearImage,
)
from spectrabox.reconstruct.inverse_rendering import MaterialSpec, View, reconstruct_views
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.reconstruct.settings import InversionSettings
from spectrabox.sampling.prior.mixture import load_prior, reflectance_moments
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.stages.inputs import (
    band_names,
    read_light,
    read_materials,
    read_session_scene,
)

Progress = Callable[[float, str], None]
FIRST_VIEW = "photo"


def invert_photos(config: SessionConfig, device: str, photos: Sequence[LinearImage],
                  calibrations: Sequence[Calibration], charts: Sequence[LinearImage | None],
                  drift: LightDrift | None, checkpoint: Path,
                  progress: Progress) -> JointReconstruction:
    """Photos, scenes and calibrations to spectra; of every shot its photo, calibration and chart
    under its light.

    A drift of the light between the first shot's chart and photo corrects its scale and widens its
    errors. A trace that was stopped goes on from the file ``checkpoint``.
    """
    start_mitsuba(device)
    bands = band_names(config, photos[0].signal.shape[2])
    views: list[View] = []
    materials: dict[str, MaterialSpec] = {}
    for shot, photo, calibration, chart in zip(config.shots, photos, calibrations, charts,
                                               strict=True):
        scene = read_session_scene(config, shot.scene)
        materials |= {material.bsdf: material for material in read_materials(config, scene)}
        compared = drift is not None and not shot.name
        scale = _scale_of(config, photo, calibration, chart, compared)
        if scale is not None and drift is not None and compared:
            scale = scale_after_drift(scale, drift)
        views.append(View(shot.name or FIRST_VIEW, scene, photo, calibration, bands, scale,
                          {light: read_light(config, spectrum) for light,
                           spectrum in shot.lights_by_id.items()}))
    chosen = config.reconstruct
    settings = InversionSettings(**{name: value for name, value in vars(chosen).items()
                                    if name != "width"}, seed=config.session.seed,
                                 learnt=_learnt_spectra(chosen.spectrum_prior))
    joint = reconstruct_views(views, tuple(materials.values()), settings, progress, checkpoint)
    return joint if drift is None else _widened(joint, drift)


def drift_of_light(config: SessionConfig, chart: LinearImage, chart_signals: np.ndarray,
                   photo: LinearImage, object_signals: np.ndarray) -> LightDrift:
    """Change of the light between chart photo and object photo."""
    return drift_between(chart, chart_signals, photo, object_signals, config.drift.relative_error)


def _widened(joint: JointReconstruction, drift: LightDrift) -> JointReconstruction:
    """The same with a change of the light's colour among what photo and model disagree by, and said
    in a note.
    """
    model = np.array(joint.model_covariance)
    mine = np.flatnonzero(joint.view_of_band == 0)
    model[:, mine[:, None], mine] += drift_covariance(drift)
    first = dataclasses.replace(joint.views[0], notes=(*joint.views[0].notes, drift.sentence))
    return dataclasses.replace(joint, model_covariance=model, views=(first, *joint.views[1:]))


def _learnt_spectra(spectrum_prior: str) -> LearntSpectra | None:
    prior = load_prior() if spectrum_prior == "learnt" else None
    return None if prior is None else LearntSpectra(np.asarray(prior.nm),
                                                    *reflectance_moments(prior))


def _scale_of(config: SessionConfig, photo: LinearImage, calibration: Calibration,
              chart: LinearImage | None, compared: bool) -> LightScale | None:
    """Light scale of a photo from the chart under its light; None leaves it to the materials.

    ``compared``: references in both photos correct it afterwards.
    """
    if chart is None or calibration.light_scale is None or config.scale.source != "chart":
        return None
    return scale_for_photo(calibration.light_scale, chart, photo, compared)
