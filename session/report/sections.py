"""Sections of the report: what its templates lay out of the chart, and of a rendering."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from spectrabox.calibrate import chart_findings
from spectrabox.measure import rules, texts
from spectrabox.measure.results.capture_result import CaptureResult, ChartResult
from spectrabox.radiometry.appearance import reflectance_to_srgb
from spectrabox.radiometry.records.calibration import HeldOutPatches
from spectrabox.radiometry.records.scenes import Reconstruction
from spectrabox.session.report import figures, maps
from spectrabox.session.report.spectra import SwatchPairs, css_colour, swatch_pairs


@dataclass(frozen=True, eq=False)
class RenderedSurface:
    """One surface of a photo against its rendering."""

    number: int                     # in the map, from 1
    colour: str
    name: str
    material: str
    pixels: int
    bands: list[tuple[float, float, bool]]      # ratio, spread, and whether it is off


def rendered_surfaces(fit: Reconstruction) -> list[RenderedSurface]:
    """Every surface of a photo that was rendered."""
    agreement, rows = fit.agreement, []
    for index, colour in enumerate(maps.surface_colours(len(agreement.names))):
        bands = [(float(ratio), float(spread), abs(float(ratio) - 1) > rules.SURFACE_OFF)
                 for ratio, spread in zip(agreement.ratio[index], agreement.spread[index],
                                          strict=True)]
        rows.append(RenderedSurface(index + 1, colour, agreement.names[index],
                                    agreement.materials[index], int(agreement.pixels[index]),
                                    bands))
    return rows


@dataclass(frozen=True)
class ChartPatch:
    """A row of the table of patches."""

    number: int
    name: str
    # of each band: signal measured, its standard error, signal predicted, residual (measured -
    # predicted) / measured, the same of a fit without this patch, and whether to mark the first
    bands: list[tuple[float, float, float, float, float | None, bool]]
    saturated: float                # share of its pixels in the worst band


@dataclass(frozen=True)
class PatchSpectrum:
    """A patch whose spectrum was estimated without it, and its reference, as the page shows it."""

    number: int
    name: str
    kept_out: bool                  # of all fits, by the operator
    estimate: str                   # colours as CSS writes them
    reference: str
    delta_e00: float | None         # between both; None of a patch that is saturated
    rmse: float
    inside: float                   # share of wavelengths at which the band holds the reference


@dataclass(frozen=True, eq=False)
class ChartSection:
    """What the report shows of the chart and of the calibration by it."""

    chart: ChartResult
    patches: list[ChartPatch]
    swatches: SwatchPairs
    prior_figure: Markup | None     # share of the prior in each band; None where none was used
    families: list[tuple[str, float]]   # of cameras, with their probabilities
    residuals: Markup
    rms: float | None
    irradiance: Markup
    left_out: list[PatchSpectrum]   # each patch by a calibration without it; empty without one
    limit: float

    @property
    def left_out_sentence(self) -> str:
        """One sentence on all patches."""
        if self.chart.left_out is None:
            return ""
        return texts.sentence(
            chart_findings.held_out(self.chart.left_out, self.chart.layout.names)[0])

    @property
    def difference(self) -> chart_findings.DifferenceSummary | None:
        """CIEDE2000 between the estimated and the reference spectra of all patches."""
        return None if self.chart.left_out is None else chart_findings.difference_summary(
            self.chart.left_out)


def chart_section(result: CaptureResult) -> ChartSection | None:
    """Patches, residuals and irradiance of the chart photo; None where no chart was used."""
    residuals, chart = rules.chart_residuals(result), result.chart
    swatches = swatch_pairs(result)
    if chart is None or residuals is None or swatches is None:
        return None
    fit, prior, left_out = result.calibration.sensitivity, chart.prior, chart.left_out
    prior_figure, families = None, []
    if prior is not None:
        prior_figure = figures.prior_share_figure("prior-share", prior.share, fit.grid,
                                                  result.bands)
        families = list(zip(prior.families, prior.probabilities.tolist(), strict=True))
    return ChartSection(
        chart, _patches(chart, residuals, fit.held_out_residuals), swatches, prior_figure, families,
        figures.chart_residual_figure("chart-residuals", residuals, fit.held_out_residuals,
                                      result.bands,
                                      chart_findings.chart_limits(result.stated.chart_stated)[0]),
        chart_findings.root_mean_square(residuals),
        figures.irradiance_figure("irradiance", chart.irradiance, chart.layout.rows),
        [] if left_out is None else _patch_spectra(left_out, chart.layout.names),
        chart_findings.chart_limits(result.stated.chart_stated)[0])


def _patch_spectra(patches: HeldOutPatches, names: tuple[str, ...]) -> list[PatchSpectrum]:
    colours = [[css_colour(reflectance_to_srgb(patches.grid.nm, one)) for one in spectra]
               for spectra in (patches.mean, patches.reference)]
    return [
        PatchSpectrum(number, name, bool(kept_out), estimate, reference,
                      float(difference) if judged else None, float(rmse), float(inside))
        for number, (
            name, kept_out, estimate, reference, difference, judged, rmse, inside) in enumerate(
                zip(names, patches.excluded, *colours, chart_findings.patch_differences(patches),
                    patches.judged, patches.rmse, patches.inside, strict=True), start=1)
    ]


def _patches(chart: ChartResult, residuals: np.ndarray,
             held_out: np.ndarray | None) -> list[ChartPatch]:
    without = np.full(residuals.shape, None) if held_out is None else held_out
    rows = []
    for index, name in enumerate(chart.layout.names):
        bands = [(float(measured), float(error), float(predicted), float(residual),
                  None if other is None else float(other), abs(float(residual)) > rules.SURFACE_OFF)
                 for measured, error, predicted, residual, other
                 in zip(chart.samples.mean[index], chart.samples.standard_error[index],
                        chart.predicted[index], residuals[index], without[index], strict=True)]
        rows.append(ChartPatch(index + 1, name, bands,
                               float(chart.samples.saturated_fraction[index].max())))
    return rows


def held_out_rms(result: CaptureResult) -> float | None:
    """Rms residual (a share) of patches left out of their own fit, None where nobody did that."""
    return chart_findings.root_mean_square(result.calibration.sensitivity.held_out_residuals)
