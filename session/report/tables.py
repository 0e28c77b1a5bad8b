"""Rows of the report's tables, and the figures that belong to one row."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.measure.chart_check import held_out_sentence
from spectrabox.measure.surfaces.metamers import LIGHTS, metamer_pair
from spectrabox.measure.verdict.calibration import CHART_LIMITS, chart_residuals, root_mean_square
from spectrabox.measure.verdict.evidence import MaterialResult
from spectrabox.measure.words import OFF
from spectrabox.radiometry.records import Reconstruction, SpectrumSamples
from spectrabox.sampling.prior.family_coverage import certified_sentence, mostly_in_doubt
from spectrabox.session.outputs.results import CommonResults
from spectrabox.session.report.figures import (
    chart_residual_figure,
    irradiance_figure,
)
from spectrabox.session.report.maps import surface_colours
from spectrabox.session.report.metamers import metamer_drawing
from spectrabox.session.report.small_figures import error_budget_bars, prior_share_figure
from spectrabox.session.report.spectra import (
    every_10_nm,
    left_out_figure,
    material_curves,
    material_figure,
)
from spectrabox.session.report.swatches import css_colour, swatch_section

MAX_CAUSES, SMALL_SHARE = 5, 0.01     # of the spectrum's variance, named beside its plot


def material_section(number: int, material: MaterialResult, grid_nm: np.ndarray,
                     signal_bands: tuple[str, ...]) -> dict[str, Any]:
    """The material, and what the report shows of it: table row, figures and data table.

    Parameters
    ----------
    number : int
        On the page.
    grid_nm : (P,) array
        Of the material's single spectrum.
    signal_bands : tuple of str
        Of its signal.
    """
    nm, curves = material_curves(material, grid_nm)
    causes = sorted(material.variance_shares.items(), key=lambda cause: -cause[1])
    return {
        "id": f"material-{number}", "material": material,
        "largest_causes": [cause for cause in causes[:MAX_CAUSES] if cause[1] >= SMALL_SHARE],
        "columns": list(curves), "rows": every_10_nm(nm, curves),
        "figure": material_figure(f"spectrum-{number}", material, grid_nm),
        "certified": certified_sentence(material.families),
        "in_doubt": mostly_in_doubt(material.families),
        "metamers": None if material.samples is None else metamers_section(material.samples),
        "budget": error_budget_bars(f"budget-{number}", material, signal_bands),
        }


def metamers_section(samples: SpectrumSamples) -> dict[str, Any] | None:
    """Two spectra that the photo cannot tell apart, under several lights; None for one draw."""
    if len(samples.spectra) < 2:
        return None
    pair = metamer_pair(samples)
    return {"drawing": metamer_drawing(pair), "apart_nm": pair.apart_nm,
            "lights": [(name, *(css_colour(srgb) for srgb in both), difference)
                       for name, both, difference in zip(LIGHTS, pair.srgb, pair.delta_e00,
                                                         strict=True)]}


def surface_rows(made: Reconstruction) -> list[dict[str, Any]]:
    """One row per surface: its number and colour in the map, and ratio and spread in each band."""
    agreement = made.agreement
    return [{"number": s + 1, "colour": colour, "name": agreement.names[s],
             "material": agreement.materials[s], "pixels": int(agreement.pixels[s]),
             "bands": [(float(r), float(d), abs(float(r) - 1) > OFF)
                       for r, d in zip(agreement.ratio[s], agreement.spread[s], strict=True)]}
            for s, colour in enumerate(surface_colours(len(agreement.names)))]


def chart_section(results: CommonResults) -> dict[str, Any] | None:
    """Overlay, patches and irradiance of the chart photo; None where no chart was used."""
    residuals = chart_residuals(results)
    if results.chart is None or residuals is None:
        return None
    held_out = results.calibration.sensitivity.held_out_residuals
    return {
        "patches": _patches(results, residuals, held_out), "swatches": swatch_section(results),
        "prior": _prior_section(results),
        "residuals": chart_residual_figure("chart-residuals", residuals, held_out, results.bands,
                                           CHART_LIMITS[0]), "rms": root_mean_square(residuals),
        "irradiance": irradiance_figure("irradiance", results.chart.irradiance,
                                        results.chart.layout.rows),
        "detection": results.chart.detection, "layout": results.chart.layout,
        "limit": CHART_LIMITS[0],
        "left_out": None if (patches := results.chart.left_out) is None else {
            "figure": left_out_figure("left-out", patches, results.chart.layout),
            "level": patches.level, "sentence": held_out_sentence(patches)},
        }


def _prior_section(results: CommonResults) -> dict[str, Any] | None:
    """What of the camera's curves is the prior's, and the cameras that they are most like."""
    standing = None if results.chart is None else results.chart.prior
    if standing is None:
        return None
    return {"figure": prior_share_figure("prior-share", standing.share,
                                         results.calibration.sensitivity.grid, results.bands),
            "families": list(zip(standing.families, standing.probabilities.tolist(), strict=True))}


def _patches(results: CommonResults, residuals: np.ndarray,
             held_out: np.ndarray | None) -> list[dict[str, Any]]:
    chart = results.chart
    assert chart is not None
    measured, predicted = chart.samples.mean, np.asarray(chart.predicted)
    error = chart.samples.standard_error
    return [{"number": p + 1, "name": chart.layout.names[p],
             "bands": [{"measured": float(measured[p, k]), "error": float(error[p, k]),
                        "predicted": float(predicted[p, k]), "residual": float(residuals[p, k]),
                        "held_out": None if held_out is None else float(held_out[p, k]),
                        "off": abs(float(residuals[p, k])) > OFF}
                       for k in range(len(results.bands))],
             "saturated": float(chart.samples.saturated_fraction[p].max())}
            for p in range(len(measured))]


def held_out_rms(results: CommonResults) -> float | None:
    """Rms residual (a share) of patches left out of their own fit, None where nobody did that."""
    return root_mean_square(results.calibration.sensitivity.held_out_residuals)


def input_rows(results: CommonResults) -> list[dict[str, Any]]:
    """One row per input file; facts that have no column of their own are kept together."""
    return [_input_row(dict(row) | row.get("facts", {})) for row in results.inputs]


def _input_row(row: dict[str, Any]) -> dict[str, Any]:
    columns = {key: row.get(key) for key in ("role", "file", "sha256", "bytes", "exposure_s",
                                             "clipped")}
    return columns | {"facts": {key: value for key, value in row.items() if key not in columns
                                and key != "facts"}}
