"""The numbers of the report as one JSON object, so that they can be checked and used again."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.calibrate.chart_findings import root_mean_square
from spectrabox.measure import conditions, rules, texts
from spectrabox.measure.records import ChartFit, MeasuredChart
from spectrabox.measure.results import (
    calibration_facts,
    capture_result,
    flat_result,
    scene_result,
    surface_result,
)
from spectrabox.radiometry.records.scenes import SurfaceAgreement
from spectrabox.radiometry.records.spectra import SpectrumSamples
from spectrabox.sampling.prior.family_coverage import coverage_facts
from spectrabox.session.outputs.session_results import SessionResults
from spectrabox.session.report import cards, spectra

SCHEMA = "spectrabox-results/1"


def report_numbers(results: SessionResults) -> dict[str, Any]:
    """What the report of any session shows, but what is of its kind; wavelengths in nm, shares as
    fractions.
    """
    result = results.found
    return {
        "schema": SCHEMA, "name": results.name, "operator": results.operator,
        "notes": results.notes,
        "conditions": [conditions.facts(one) for one in result.conditions],
        "findings": [texts.facts(one) for one in result.findings],
        "bands": result.bands, "verdict": _verdict(result.verdict), "advice": result.advice.facts,
        "signal_bands": result.signal_bands,
        "calibration": _calibration(result, results.sensitivity_truth),
        "chart": None if result.chart is None or result.measured_chart is None
        else _chart(result, result.chart, result.measured_chart),
        "clipped_share": result.photo.clipped_share,
        "inputs": [file.numbers for file in results.inputs],
        "stages": results.facts()["stages"], "warnings": result.warnings,
        "provenance": results.provenance, "made_from": results.input_digests,
        }


def scene_numbers(result: scene_result.SceneResult) -> dict[str, Any]:
    """What the report of a scene shows beside that."""
    fit = result.reconstruction
    return {
        "materials": [_surface(surface) for surface in result.surfaces],
        "agreement": _agreement(fit.agreement),
        "views": [{"name": name, "bands": result.bands,
                   "agreement": _agreement(made.agreement),
                   "light": _fields(calibration.light, "values", "standard_error", "quantity",
                                    "source"),
                   "light_scale": _fields(made.light_scale, "value", "standard_error", "source")}
                  for name, (calibration, made) in result.views.items()],
        "reconstruction": {"engine": fit.engine, "spp": fit.spp, "seed": fit.seed,
                           "outcome": fit.outcome, "loss_history": fit.loss_history,
                           "pixels_used": int(fit.used.sum()),
                           "pixels": fit.used.size, "white_signal": fit.white_signal},
        "geometry": _geometry(result) if result.placements else None,
        }


def flat_numbers(result: flat_result.FlatResult) -> dict[str, Any]:
    """What the report of flat samples shows beside that."""
    return {
        "regions": [_surface(region) for region in result.surfaces],
        "photos": [{"name": photo.name, "size_px": photo.size_px, "outlines_px": photo.outlines,
                    "light": {name: {"level": level, "standard_error": error}
                              for name, (level, error) in photo.light.items()}}
                   for photo in result.photos],
        "light": calibration_facts.light_facts(result.calibration),
        }


def _verdict(verdict: rules.Verdict) -> dict[str, Any]:
    return {"status": verdict.severity.name if verdict.problems else "PASS", "says": verdict.says,
            "criteria": [{"name": texts.name(one), "value": one.values.get("value"),
                          "shown": texts.shown(one), "limit": texts.limit(one),
                          "status": one.severity.name, "says": texts.says(one)}
                         for one in verdict.findings if texts.is_tested(one)]}


def _geometry(result: scene_result.SceneResult) -> dict[str, Any]:
    """What of the scene was estimated."""
    return {"placements": [_fields(one, "what", "how", "unit", "stated", "place", "moved",
                                   "standard_error") for one in result.placements],
            "views": [{"name": view.name,
                       "corners": [{"corner": corner, "residual_px": residual}
                                   for corner, residual in zip(view.corners, view.residuals_px,
                                                               strict=True)]}
                      for view in result.marked_views]}


def _surface(surface: surface_result.SurfaceResult) -> dict[str, Any]:
    curves = spectra.surface_curves(surface)
    noise, disagreement = surface.covariances
    single = None if surface.spectrum is None else {"nm": surface.grid.nm,
                                                    "reflectance": surface.spectrum}
    return {
        "name": surface.name,
        "known": surface.known,
        "inverse_rendering": single,
        "signal": surface.signal,
        "signal_covariance": noise,
        "model_covariance": disagreement,
        "error_budget": surface.error_budget,
        "variance_shares": surface.causes,
        "families": coverage_facts(surface.families),
        "summary": None if surface.summary is None else {
            **(_fields(surface.summary, "mean", "standard_deviation", "lower", "upper",
                       "bound_lower", "bound_upper", "level", "next_measurement_nm") or {}),
            "conditional_on":
            texts.paragraph(surface.summary.conditional_on)
        },
        "band_width": None if surface.known else surface.band_width,
        "colour": {
            "lab": surface.lab().value, "lab_error": surface.lab_error, "hex":
            spectra.hex_colour(surface.srgb)
        },
        "every_10_nm":
        {"columns": ["nm", *curves], "rows": spectra.every_10_nm(surface.nm, curves)},
        "samples": _samples(surface.samples),
        "metamers": None if surface.metamers is None else cards.metamer_facts(surface.metamers),
        "truth": _fields(surface.truth, "values", "standard_error", "source"),
        "scores": None if surface.scores is None else vars(surface.scores),
    }


def _samples(samples: SpectrumSamples | None) -> dict[str, Any] | None:
    if samples is None:
        return None
    return {"nm": samples.grid.nm, "method": samples.method,
            "effective_samples": samples.effective_samples, "seed": samples.seed,
            "outcome": texts.paragraph(samples.findings)}


def _fields(record: Any, *names: str) -> dict[str, Any] | None:
    """The named fields of a record, with the wavelengths where it has a grid."""
    if record is None:
        return None
    grid = {"nm": record.grid.nm} if hasattr(record, "grid") else {}
    return grid | {name: getattr(record, name) for name in names}


def _agreement(agreement: SurfaceAgreement) -> list[dict[str, Any]]:
    return [{"surface": name, "material": agreement.materials[s], "pixels": agreement.pixels[s],
             "ratio": agreement.ratio[s], "spread": agreement.spread[s]} for s,
            name in enumerate(agreement.names)]


def _calibration(result: capture_result.CaptureResult,
                 truth: tuple[np.ndarray, np.ndarray] | None) -> dict[str, Any]:
    calibration, light = result.calibration, result.calibration.light_posterior
    residuals = rules.chart_residuals(result)
    return {
        "sensitivity": _fields(calibration.sensitivity, "curves", "standard_error", "residuals",
                               "held_out_residuals", "condition_number", "method", "outcome"),
        "sensitivity_truth": None if truth is None else {"nm": truth[0], "curves": truth[1]},
        "light": _fields(calibration.light, "values", "standard_error", "quantity", "source"),
        "light_posterior": None if light is None else {
            **(_fields(light, "kinds", "probabilities", "mean", "lower", "upper", "level") or {}),
            "sentences": calibration_facts.checks(light.findings)},
        "doubts": calibration_facts.doubts(calibration),
        "relative_covariance": calibration.relative_covariance,
        "chart_residuals": residuals,
        "chart_rms": root_mean_square(residuals),
        "held_out_rms": root_mean_square(calibration.sensitivity.held_out_residuals),
        "checks": calibration_facts.checks(calibration.findings),
        **({} if result.light_scale is None else {"light_scale": _fields(
            result.light_scale, "value", "standard_error", "residuals", "source")}),
        }


def _chart(result: capture_result.CaptureResult, chart: ChartFit,
           measured: MeasuredChart) -> dict[str, Any]:
    samples, detection = measured.samples, measured.detection
    swatches = spectra.swatch_pairs(result)
    return {"swatches": _fields(swatches, "measured", "predicted", "delta_e00", "from_others",
                                "order"),
            "prior": None if chart.prior_share is None else {
                "share": chart.prior_share, "families": [members for members, _ in chart.families],
                "probabilities": np.array([probability for _, probability in chart.families])},
            "measured": samples.mean, "standard_error": samples.standard_error,
            "covariance_of_mean": samples.covariance_of_mean,
            "saturated_fraction": samples.saturated_fraction,
            "saturated": samples.saturated_fraction.max(axis=1), "predicted": chart.predicted,
            "irradiance": chart.irradiance, "corners_px": detection.corners_px,
            "confidence": detection.confidence, "how_found": texts.says(detection.how_found),
            "mirrored": detection.mirrored,
            "left_out": None if chart.left_out is None
            else calibration_facts.held_out_facts(chart.left_out, result.layout.names)}
