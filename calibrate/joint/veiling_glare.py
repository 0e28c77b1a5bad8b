"""Glare that veils a chart: light that the lens spreads over the photo, the same on every patch."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from spectrabox.calibrate.chart_equations import GLARE_SD, HAZE_SD, ChartEquations
from spectrabox.calibrate.joint.joint_estimate import Light, estimate_jointly
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.sensitivity import PriorFit
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.calibration import LightPosterior
from spectrabox.radiometry.records.spectra import WavelengthGrid

RARE_HAZE = 3.0             # log odds against a veil beforehand
DOUBTED_VEIL, MAX_VEIL = 0.04, 0.3      # of the brightest patch: a warning; no photo of a chart


def estimate_through_glare(photos: list[ChartEquations], light: Light, cameras: CameraPrior,
                           grid: WavelengthGrid, excluded: ChartEquations | None
                           ) -> tuple[PriorFit, LightPosterior | None]:
    """The joint estimate under usual glare or, where glare is large or the photos are not
    explained, under haze, if the evidence is for it.

    Parameters
    ----------
    photos, light, cameras, grid, excluded
        As of ``estimate_jointly``.
    """
    usual, usual_light = estimate_jointly(photos, light, cameras, grid, excluded)
    large = [veil > 2 * GLARE_SD for veil in _veils(usual, photos)]
    if not (usual.disagrees or any(large)):
        return usual, usual_light
    veiled = large if any(large) else [True] * len(photos)
    hazy, hazy_light = estimate_jointly(
        [replace(photo, glare_sd=HAZE_SD) if haze else photo
         for photo, haze in zip(photos, veiled, strict=True)], light, cameras, grid, excluded)
    gain = hazy.posterior.log_evidence - usual.posterior.log_evidence
    if gain > RARE_HAZE and max(_veils(hazy, photos)) <= MAX_VEIL:
        return hazy, hazy_light
    return usual, usual_light


def _veils(fit: PriorFit, photos: list[ChartEquations]) -> list[float]:
    """Largest glare of each photo, of its brightest patch."""
    return [float(np.max(np.abs(state.glare) / photo.signal.max(axis=0)))
            for photo, state in zip(photos, fit.photos, strict=True)]


def veiled(fit: PriorFit) -> list[Finding]:
    """Whether glare beyond chance veils any photo of a fit; nothing where none is.

    Parameters
    ----------
    fit : PriorFit
    """
    veil = max(float(np.max(state.certain_glare / state.predicted.max(axis=0)))
               for state in fit.photos)
    return [Finding("calibration.veil", Severity.WARN, values={
        "veil": veil, "limit": DOUBTED_VEIL})] if veil > DOUBTED_VEIL else []
