"""The numbers of the report as one JSON object, so that they can be checked and used again."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.measure.chart_check import held_out_facts, light_facts
from spectrabox.measure.surfaces.metamers import metamer_pair
from spectrabox.measure.verdict.calibration import chart_residuals, root_mean_square
from spectrabox.measure.verdict.criteria import Verdict
from spectrabox.measure.verdict.evidence import ChartResult, MaterialResult
from spectrabox.radiometry.placements import SceneGeometry
from spectrabox.radiometry.records import SpectrumSamples, SurfaceAgreement
from spectrabox.sampling.prior.family_coverage import coverage_facts
from spectrabox.session.outputs.results import (
    CommonResults,
    FlatResults,
    SceneResults,
    SessionResults,
)
from spectrabox.session.report.cards import surface_colour
from spectrabox.session.report.metamers import metamer_facts
from spectrabox.session.report.spectra import every_10_nm, material_curves
from spectrabox.session.report.swatches import swatch_facts

SCHEMA = "spectrabox-results/1"


def report_numbers(results: SessionResults, verdict: Verdict) -> dict[str, Any]:
    """Everything the report shows, images left out; wavelengths in nm, shares as fractions."""
    common = {
        "schema": SCHEMA, "name": results.name, "operator": results.operator,
        "notes": results.notes, "bands": results.bands,
        "verdict": {"status": verdict.status, "says": verdict.sentence,
                    "criteria": [{"name": c.name, "value": c.value, "shown": c.shown,
                                  "limit": c.limit, "status": c.status, "says": c.sentence}
                                 for c in verdict.criteria]},
        "signal_bands": results.signal_bands, "calibration": _calibration(results),
        "chart": None if results.chart is None else _chart(results, results.chart),
        "clipped_share": results.photo.saturated.any(axis=2).mean(),
        "inputs": results.inputs, "stages": results.stages, "warnings": results.warnings,
        "provenance": results.provenance, "made_from": results.input_digests,
        }
    return common | (_flat_numbers(results) if isinstance(results, FlatResults)
                     else _scene_numbers(results, common["calibration"]))


def _scene_numbers(results: SceneResults, calibration: dict[str, Any]) -> dict[str, Any]:
    fit = results.reconstruction
    return {
        "materials": [_material(m, results.grid.nm) for m in results.materials],
        "agreement": _agreement(fit.agreement),
        "views": [{"name": view.name, "bands": view.bands,
                   "agreement": _agreement(view.reconstruction.agreement),
                   "light": _fields(view.calibration.light, "values", "standard_error", "quantity",
                                    "source"),
                   "light_scale": _fields(view.reconstruction.light_scale, "value",
                                          "standard_error", "source")}
                  for view in results.views],
        "calibration": calibration | {"light_scale": _fields(
            results.light_scale, "value", "standard_error", "residuals", "source")},
        "reconstruction": {"engine": fit.engine, "spp": fit.spp, "seed": fit.seed,
                           "outcome": fit.outcome, "loss_history": fit.loss_history,
                           "pixels_used": int(fit.used.sum()),
                           "pixels": fit.used.size, "white_signal": fit.white_signal},
        "geometry": None if results.geometry is None else _geometry(results.geometry),
        }


def _flat_numbers(results: FlatResults) -> dict[str, Any]:
    return {
        "regions": [_material(region, results.grid.nm) for region in results.materials],
        "photos": [{"name": photo.name, "size_px": photo.size_px, "outlines_px": photo.outlines,
                    "light": {name: {"level": level, "standard_error": error}
                              for name, (level, error) in photo.light.items()}}
                   for photo in results.photos],
        "light": light_facts(results.calibration),
        }


def _geometry(geometry: SceneGeometry) -> dict[str, Any]:
    """What of the scene was estimated."""
    return {"placements": [_fields(one, "what", "how", "unit", "stated", "place", "moved",
                                   "standard_error") for one in geometry.placements],
            "views": [{"name": view.name,
                       "corners": [{"corner": corner, "residual_px": residual}
                                   for corner, residual in zip(view.corners, view.residuals_px,
                                                               strict=True)]}
                      for view in geometry.views]}


def _material(material: MaterialResult, nm: np.ndarray) -> dict[str, Any]:
    shown_nm, curves = material_curves(material, nm)
    single = None if material.spectrum is None else {"nm": nm, "reflectance": material.spectrum}
    return {
        "name": material.name, "known": material.summary is None, "inverse_rendering": single,
        "signal": material.signal, "signal_covariance": material.signal_covariance,
        "model_covariance": material.model_covariance, "error_budget": material.error_budget,
        "variance_shares": material.variance_shares, "families": family_facts(material),
        "summary": _fields(material.summary, "mean", "standard_deviation", "lower", "upper",
                           "bound_lower", "bound_upper", "level", "conditional_on",
                           "next_measurement_nm"),
        "band_width": material.band_width,
        "colour": _fields(surface_colour(material, nm), "lab", "lab_error", "hex"),
        "every_10_nm": {"columns": ["nm", *curves], "rows": every_10_nm(shown_nm, curves)},
        "samples": _samples(material.samples),
        "metamers": None if material.samples is None or len(material.samples.spectra) < 2
        else metamer_facts(metamer_pair(material.samples)),
        "truth": _fields(material.truth, "values", "standard_error", "source"),
        "scores": None if material.scores is None else vars(material.scores),
        }


def family_facts(material: MaterialResult) -> list[dict[str, Any]]:
    """The families that a material may be of, and what 95 % bands of each held when it was judged;
    None where it was not.
    """
    return coverage_facts(material.families)


def _samples(samples: SpectrumSamples | None) -> dict[str, Any] | None:
    if samples is None:
        return None
    return {"nm": samples.grid.nm, "method": samples.method,
            "effective_samples": samples.effective_samples, "seed": samples.seed,
            "outcome": samples.sentence}


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


def _calibration(results: CommonResults) -> dict[str, Any]:
    calibration = results.calibration
    truth = results.sensitivity_truth
    return {
        "sensitivity": _fields(calibration.sensitivity, "curves", "standard_error", "residuals",
                               "held_out_residuals", "condition_number", "method", "outcome"),
        "sensitivity_truth": None if truth is None else {"nm": truth[0], "curves": truth[1]},
        "light": _fields(calibration.light, "values", "standard_error", "quantity", "source"),
        "light_posterior": _fields(calibration.light_posterior, "kinds", "probabilities", "mean",
                                   "lower", "upper", "level", "sentences"),
        "doubts": [doubt.value for doubt in calibration.doubts],
        "relative_covariance": calibration.relative_covariance,
        "chart_residuals": chart_residuals(results),
        "chart_rms": root_mean_square(chart_residuals(results)),
        "held_out_rms": root_mean_square(calibration.sensitivity.held_out_residuals),
        "checks": calibration.checks,
        }


def _chart(results: CommonResults, chart: ChartResult) -> dict[str, Any]:
    return {"swatches": swatch_facts(results), "prior": _fields(
                chart.prior, "share", "families", "probabilities"),
            "measured": chart.samples.mean, "standard_error": chart.samples.standard_error,
            "covariance_of_mean": chart.samples.covariance_of_mean,
            "saturated_fraction": chart.samples.saturated_fraction,
            "saturated": chart.samples.saturated_fraction.max(axis=1), "predicted": chart.predicted,
            "irradiance": chart.irradiance, "corners_px": chart.detection.corners_px,
            "confidence": chart.detection.confidence, "how_found": chart.detection.how_found,
            "mirrored": chart.detection.mirrored,
            "left_out": None if chart.left_out is None
            else held_out_facts(chart.left_out, chart.layout.names)}
