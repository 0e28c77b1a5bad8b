"""Sections of the report: what its templates lay out of the chart, and of a rendering."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.calibrate import chart_findings
from spectrabox.measure import rules, texts
from spectrabox.measure.results.capture_result import CaptureResult, ChartResult
from spectrabox.radiometry.appearance import reflectance_to_srgb
from spectrabox.radiometry.records.calibration import HeldOutPatches
from spectrabox.session.report import figures
from spectrabox.session.report.spectra import css_colour, swatch_pairs


def chart_section(result: CaptureResult) -> dict[str, Any]:
    """What the templates show of the chart and of the calibration by it: ``chart``, None where no
    chart was used, and beside it

    * ``chart_patches``: of each patch its name; of each band the signal measured, its standard
      error, the signal predicted, the residual (measured - predicted) / measured, the same of a fit
      without this patch, and whether to mark the first; and the share of saturated pixels in the
      worst band;
    * ``swatches``, ``residual_figure``, ``irradiance_figure``, ``prior_figure`` (the share of the
      prior in each band; None where none was used), ``camera_families`` with their probabilities;
    * ``chart_rms`` of the residuals, and ``chart_limit`` up to which they are none;
    * ``left_out``: of each patch by a calibration without it, where there is one, its colour as
      estimated and as the reference has it, as CSS writes them, and CIEDE2000 between both; and of
      all patches ``left_out_difference`` and ``left_out_sentence``.
    """
    residuals, chart = rules.chart_residuals(result), result.chart
    swatches = swatch_pairs(result)
    if chart is None or residuals is None or swatches is None:
        return {"chart": None}
    fit, prior, left_out = result.calibration.sensitivity, chart.prior, chart.left_out
    limit = chart_findings.chart_limits(result.stated.chart_stated)[0]
    of_prior = {"prior_figure": None} if prior is None else {
        "prior_figure": figures.prior_share_figure("prior-share", prior.share, fit.grid,
                                                   result.bands),
        "camera_families": list(zip(prior.families, prior.probabilities.tolist(), strict=True))}
    of_left_out = {"left_out": []} if left_out is None else {
        "left_out": _left_out(left_out),
        "left_out_difference": chart_findings.difference_summary(left_out),
        "left_out_sentence": texts.sentence(
            chart_findings.held_out(left_out, chart.layout.names)[0])}
    return {"chart": chart, "chart_patches": _patches(chart, residuals, fit.held_out_residuals),
            "swatches": swatches, **of_prior,
            "residual_figure": figures.chart_residual_figure(
                "chart-residuals", residuals, fit.held_out_residuals, result.bands, limit),
            "irradiance_figure": figures.irradiance_figure("irradiance", chart.irradiance,
                                                           chart.layout.rows),
            "chart_rms": chart_findings.root_mean_square(residuals), "chart_limit": limit,
            **of_left_out}


def _left_out(patches: HeldOutPatches) -> list[tuple[str, str, float]]:
    estimates, references = (
        [css_colour(reflectance_to_srgb(patches.grid.nm, one)) for one in spectra]
        for spectra in (patches.mean, patches.reference))
    return list(zip(estimates, references, chart_findings.patch_differences(patches).tolist(),
                    strict=True))


def _patches(chart: ChartResult, residuals: np.ndarray,
             held_out: np.ndarray | None
             ) -> list[tuple[str, list[tuple[float, float, float, float, float | None, bool]],
                             float]]:
    without = np.full(residuals.shape, None) if held_out is None else held_out
    rows = []
    for index, name in enumerate(chart.layout.names):
        bands = [(float(measured), float(error), float(predicted), float(residual),
                  None if other is None else float(other), abs(float(residual)) > rules.SURFACE_OFF)
                 for measured, error, predicted, residual, other
                 in zip(chart.samples.mean[index], chart.samples.standard_error[index],
                        chart.predicted[index], residuals[index], without[index], strict=True)]
        rows.append((name, bands, float(chart.samples.saturated_fraction[index].max())))
    return rows


def held_out_rms(result: CaptureResult) -> float | None:
    """Rms residual (a share) of patches left out of their own fit, None where nobody did that."""
    return chart_findings.root_mean_square(result.calibration.sensitivity.held_out_residuals)
