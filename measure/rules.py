"""What speaks for and against a result: one function a rule, from a result to findings.

Causes come before symptoms: the first finding that speaks against a result is the headline. A
finding's words are in ``measure.texts``.
"""
from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from spectrabox.calibrate import camera_curves, chart_findings
from spectrabox.measure.results.surface_result import VALID_OUTCOMES
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.spectra import Outcome, UnknownLight

if TYPE_CHECKING:
    from spectrabox.measure.camera import CameraFit
    from spectrabox.measure.results.capture_result import CaptureResult

# how serious an outcome is: ill-posed is information, as the bands already carry what the data
# left open; what is not named here is a warning
HARMLESS = {Outcome.CONVERGED, Outcome.ILL_POSED, *VALID_OUTCOMES}


# ---- calibration ---------------------------------------------------------------------------------

def of_calibration(found: CaptureResult) -> list[Finding]:
    """Left-out patches, what the calibrations found, copies of charts, residuals of charts."""
    return [*held_out_patches(found), *of_fits(found), *chart_agreement(found)]


def of_fits(found: CaptureResult) -> list[Finding]:
    """What the fits found of cameras, lights and charts."""
    fits = {"": found.calibration, **found.other_calibrations}
    return [*(of_photo(one, view) for view, fit in fits.items() for one in fit.findings),
            *found.calibration_findings]


def of_photo(finding: Finding, view: str) -> Finding:
    """The finding, of a further photo; as it is of the first."""
    return replace(finding, subject=view) if view else finding


def held_out_patches(found: CaptureResult) -> list[Finding]:
    """How well each chart patch is predicted by a calibration without it; nothing without a chart.
    """
    chart = found.chart
    if chart is None or chart.left_out is None:
        return []
    return [of_photo(one, view) for view, patches in {"": chart.left_out, **chart.others}.items()
            for one in chart_findings.held_out(patches, chart.layout.names)]


def chart_agreement(found: CaptureResult) -> list[Finding]:
    """How well each calibration reproduces the first chart that it was fitted to."""
    residuals, chart = chart_residuals(found), found.chart
    if residuals is not None and chart is not None:
        residuals = residuals[~chart.samples.clipped]
    if chart_findings.root_mean_square(residuals) is None:
        passes, fails = chart_findings.CHART_LIMITS
        return [Finding("calibration.no-chart", Severity.INFO,
                        values={"value": None, "passes": passes, "fails": fails})]
    each = {"": residuals}
    for view, made in found.other_calibrations.items():
        assert chart is not None and made.sensitivity.residuals is not None
        each[view] = made.sensitivity.residuals[chart.others[view].judged]
    return [of_photo(one, view) for view, values in each.items() if values is not None
            for one in chart_findings.chart_residual(values, found.stated.chart_stated)]


def chart_residuals(found: CaptureResult) -> np.ndarray | None:
    """(photo - predicted) / photo of the patches (I, K), or None where no chart was used."""
    residuals = found.calibration.sensitivity.residuals
    if residuals is None and found.chart is not None:
        measured = found.chart.samples.mean
        return (measured - found.chart.predicted) / measured
    return residuals


# ---- a camera by itself --------------------------------------------------------------------------

def of_camera(fit: CameraFit) -> list[Finding]:
    """All that was found of a camera that was fitted by itself, in the order of a result."""
    calibration, first, copy = fit.chart.calibration, fit.photos[0], fit.chart.copy
    names = first.chart.names
    light = "" if calibration.products else calibration.light.source
    off = 1 - fit.chart.predicted / first.samples.mean
    outcome = fit.sensitivity.outcome
    return [*calibration.findings,
            *([] if copy is None else [chart_findings.edition(copy),
                                       *chart_findings.departures(copy, names, light)]),
            *chart_findings.off_level(fit.held_out, names),
            *chart_findings.held_out(fit.held_out, names), chart_findings.colours(fit.held_out),
            *chart_findings.chart_residual(off[~first.samples.clipped], not first.editions),
            Finding("fit.of-camera", Severity.INFO if outcome in HARMLESS else Severity.WARN,
                    values={"outcome": outcome.name})]


def camera_fitted(fit: CameraFit) -> Finding:
    """What was fitted of a camera, how surely, and what it is for."""
    light, band = fit.photos[0].light, fit.band
    if isinstance(light, UnknownLight):
        stated = f"a light stated as {light.stated}" if light.stated else "an unknown light"
    else:
        stated = "the given light" if fit.light == "given" else fit.light
    return Finding("camera.fitted", Severity.INFO, values={
        "bands": list(fit.bands), "photos": len(fit.photos), "light": stated,
        "products": fit.chart.calibration.products, "level": camera_curves.LEVEL,
        "half_width": None if band is None else float((band.upper - band.lower).mean()) / 2,
        "noise_alone": fit.chart.prior_fit is None,
        "delta_e00": float((fit.chart.delta_e if band is None
                            else fit.chart.held_out_delta_e).mean())})
