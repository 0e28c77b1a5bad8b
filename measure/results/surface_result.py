"""What was found of one surface of a photo: a material of a scene, or a region of a flat sample."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from spectrabox.measure import estimate, extras, words
from spectrabox.measure.regions import moved_lamp
from spectrabox.measure.results.facts import Fact, known_facts
from spectrabox.measure.surfaces import colour_comparison, surface_signals
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.grid import WavelengthGrid
from spectrabox.radiometry.records import photos, spectra
from spectrabox.sampling.prior import family_coverage, mixture

STEP_NM = 5     # of spectra among the facts; spectra.csv holds every nanometre


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SurfaceResult(estimate.Estimate):
    """The estimate of a surface's spectrum, and what photos alone say of it.

    Attributes
    ----------
    signals : SurfaceSignals
        Of this surface alone, in the J bands of all photos.
    light : (float, float) or None
        Of a region: light on it relative to the chart's mean, and its relative standard error.
    scatter : float or None
        Of a region: relative scatter of its pixels beyond noise and a plane, in the worst band.
    edge : RegionEdge or None
        Across a region, in the first photo that shows one.
    """

    signals: spectra.SurfaceSignals
    light: tuple[float, float] | None = None
    scatter: float | None = None
    edge: photos.RegionEdge | None = None

    @property
    def grid(self) -> WavelengthGrid:
        """Of ``spectrum``."""
        return self.signals.grid

    @property
    def spectrum(self) -> np.ndarray | None:
        """The spectrum (P,) of inverse rendering, or as given; None of an estimated region."""
        return self.inverse_rendering if self.given is None else self.given[1]

    @property
    def bands(self) -> tuple[str, ...]:
        """Names of the J bands of the signal."""
        return self.signals.bands

    @property
    def signal(self) -> np.ndarray:
        """The signal (J,) relative to white, NaN in bands that do not show it."""
        return self.signals.signal[0]

    @property
    def covariances(self) -> tuple[np.ndarray, np.ndarray]:
        """Covariance (J, J) of the signal by noise; and relative by the disagreement of photo and
        model.
        """
        return surface_signals.noise_and_disagreement(self.signals, 0)

    @property
    def error_budget(self) -> dict[str, np.ndarray]:
        """Relative standard error of the signal by cause, in the bands that show it; empty where
        the spectrum was given.
        """
        return {} if self.known else surface_signals.relative_errors(self.signals, 0)

    @property
    def gloss(self) -> spectra.StateEstimate | None:
        """What the signal says of its gloss; None without the learnt prior, or where none may be.
        """
        return None if self.summary is None else self.summary.states

    @property
    def places(self) -> list[dict[str, Any]]:
        """Of a region under a lamp that was moved: gloss and level in each of its places."""
        return moved_lamp.found_in_places(self.signals, 0, self.gloss)

    @property
    def lab_error(self) -> np.ndarray | None:
        """Standard errors (3,) of L*, a*, b* under D65; None of a spectrum given, or of a single
        draw.
        """
        if self.samples is None or len(self.samples.spectra) < 2:
            return None
        return self.lab().standard_error

    @property
    def metamers(self) -> spectra.SpectrumSamples | None:
        """Two of its draws that the photo cannot tell apart; None without two draws."""
        return self.compared[0]

    @cached_property
    def compared(self) -> tuple[spectra.SpectrumSamples | None, Finding | None]:
        """The same, and why it could not be made."""
        samples = self.samples
        if samples is None or len(samples.spectra) < 2:
            return None, None
        return extras.attempt("comparison of spectra that look alike",
                              lambda: colour_comparison.metamer_pair(samples), None)

    def facts(self) -> dict[str, Any]:
        """What is known, as plain numbers and sentences, by the keys of a region or a material of
        ``spectrabox run --json`` (docs/reference/json.md).
        """
        return known_facts(SURFACE_FACTS, self)


def surface_result(signals: spectra.SurfaceSignals, index: int,
                   summary: spectra.SpectrumSummary | None,
                   prior: mixture.LogitMixture | None = None, truth: spectra.Spectrum | None = None,
                   inverse_rendering: np.ndarray | None = None,
                   light: tuple[float, float] | None = None, scatter: float | None = None,
                   edge: photos.RegionEdge | None = None) -> SurfaceResult:
    """What was found of one surface.

    Parameters
    ----------
    signals : SurfaceSignals
    index : int
        Of the surface.
    summary : SpectrumSummary or None
        None where the spectrum was given.
    prior : LogitMixture or None
        That the spectra were drawn from; None for another method than the learnt prior.
    truth : Spectrum, optional
        Measured, to compare with.
    inverse_rendering : (P,) array, optional
        The one spectrum of inverse rendering.
    light, scatter, edge
        Of a region, as of `SurfaceResult`.
    """
    common: dict[str, Any] = {
        "name": signals.names[index], "signals": surface_signals.alone(signals, index),
        "truth": truth, "light": light, "scatter": scatter, "edge": edge}
    if summary is None:
        return SurfaceResult(**common, summary=None, given=(signals.grid.nm,
                                                            signals.spectra[index]))
    return SurfaceResult(**common, summary=summary,
                         measurement=surface_signals.measurement(signals, index),
                         errors=surface_signals.errors_by_cause(signals, index), prior=prior,
                         inverse_rendering=inverse_rendering,
                         from_more=summary.draws.outcome is spectra.Outcome.THROUGH_TRANSPORT)


def _shown_bands(surface: SurfaceResult) -> np.ndarray:
    return np.isfinite(surface.signal)


def _of_summary(name: str, meaning: str) -> Fact[SurfaceResult]:
    """A curve of the summary, every few nanometres."""
    return Fact(name, f"{meaning}, reflectance", lambda surface: None if surface.summary is None
                else getattr(surface.summary, name)[::STEP_NM].tolist())


def _of_scores(name: str, meaning: str, heading: str = "",
               shown: Any = str) -> Fact[SurfaceResult]:
    return Fact(name, meaning, lambda surface: None if surface.scores is None
                else getattr(surface.scores, name), heading, shown)


def _edge_facts(edge: photos.RegionEdge) -> dict[str, Any]:
    part = edge.larger_part_px
    return {"kind": edge.kind.value,
            "step": [None if np.isnan(step) else float(step) for step in edge.step],
            "line_px": edge.line_px.tolist(),
            "larger_part_px": None if part is None else part.astype(int).tolist()}


def _in_place(place: Mapping[str, Any]) -> str:
    """Gloss and level in one place of a lamp, for a table."""
    gloss, gloss_error, level, level_error = (
        100 * place[name] for name in ("gloss", "gloss_error", "level", "level_error"))
    return (f"{place['photo']}: {gloss:.1f} ± {gloss_error:.1f} %, "
            f"{level:+.0f} ± {level_error:.0f} %")


def _if_estimated(value: Any) -> Any:
    """A fact of surfaces that were estimated."""
    return lambda surface: None if surface.known else value(surface)


# in the order of the columns of a table
SURFACE_FACTS: tuple[Fact[SurfaceResult], ...] = (
    Fact("name", "of the region or material", lambda surface: surface.name),
    Fact("known", "whether its spectrum was given", lambda surface: surface.known),
    Fact("lab_d65", "L*, a*, b* of the mean under D65, 2 degree observer",
         _if_estimated(lambda surface: surface.lab().value.tolist()), "L*a*b* under D65",
         lambda lab: " ".join(f"{value:.1f}" for value in lab)),
    Fact("lab_d65_error", "standard errors of L*, a*, b*; none of a single draw",
         lambda surface: None if surface.lab_error is None else surface.lab_error.tolist(), "±",
         lambda errors: " ".join(f"{value:.1f}" for value in errors)),
    Fact(
        "delta_e00_within", "CIEDE2000 under D65 from the mean, within which draws lie with the "
        "probability of the band", lambda surface: surface.within and surface.within[0],
        "ΔE00 within", lambda size: f"{size:.1f}"),
    Fact("spectrum_within", "the same of the root mean square difference over wavelengths, "
         "reflectance", lambda surface: surface.within and surface.within[1], "spectrum within",
         lambda size: f"{size:.3f}"),
    Fact("band_width", "mean width of the band over wavelength, reflectance",
         _if_estimated(lambda surface: surface.band_width)),
    Fact("light", "on the region, relative to the chart's mean",
         lambda surface: surface.light and surface.light[0]),
    Fact("light_error", "relative standard error of that light",
         lambda surface: surface.light and surface.light[1], "light against chart ±",
         words.percent),
    Fact("scatter", "of the region's pixels beyond noise and a plane, relative",
         lambda surface: surface.scatter),
    Fact(
        "edge", "across the region: `kind` (shadow or fold, two paints, or either), the `step` of "
        "the smaller part against the larger in each band of the photo, relative, the ends "
        "`line_px` of its line, and a rectangle `larger_part_px` on its larger side",
        lambda surface: surface.edge and _edge_facts(surface.edge)),
    Fact(
        "gloss", "share of white that the surface mirrors beyond what the chart does, in the "
        "first photo: what is known beforehand and what the signals say together",
        lambda surface: surface.gloss and float(surface.gloss.mean[0]), "gloss", words.percent),
    Fact("gloss_error", "standard error of that share",
         lambda surface: surface.gloss and float(surface.gloss.standard_deviation[0]),
         "gloss known to", words.percent),
    Fact(
        "lamp_places", "of a region under a lamp that was moved, for each of its places: `photo` "
        "(the first with it there), `gloss`, `gloss_error` (shares of white), `level`, "
        "`level_error` (light on the region against the chart's, relative)",
        lambda surface: surface.places or None, "gloss, level",
        lambda places: "; ".join(map(_in_place, places))),
    Fact("gloss_kinds", "probability of each kind of surface, by its gloss",
         lambda surface: surface.gloss and surface.gloss.shares),
    _of_scores("coverage_95", "share of wavelengths at which the 95 % band holds the truth",
               "95 % band holds", words.percent),
    _of_scores("rmse_mean", "root mean square error of the mean against the truth, reflectance",
               "RMSE", lambda rmse: f"{rmse:.4f}"),
    _of_scores("rmse_inverse_rendering", "the same of the one spectrum of inverse rendering",
               "RMSE inverse rendering", lambda rmse: f"{rmse:.4f}"),
    _of_scores("coverage_bounds", "share of wavelengths at which the exact bounds hold the truth"),
    _of_scores("delta_e00_mean", "CIEDE2000 of the mean against the truth under D65", "ΔE00",
               lambda difference: f"{difference:.2f}"),
    Fact("next_measurement_nm", "wavelength in nm at which one more reading would narrow the band "
         "most", lambda surface: surface.next_reading_nm),
    Fact("signal", "relative to white, in the bands that show it",
         lambda surface: surface.signal[_shown_bands(surface)].tolist()),
    Fact(
        "bands", "names of these bands", lambda surface:
        [band for band, shown in zip(surface.bands, _shown_bands(surface), strict=True) if shown]),
    Fact("wavelengths_nm", f"of the curves, every {STEP_NM} nm",
         _if_estimated(lambda surface: surface.nm[::STEP_NM].tolist())),
    _of_summary("mean", "mean of the draws"), _of_summary("standard_deviation", "of the draws"),
    _of_summary("lower", "lower end of the band"), _of_summary("upper", "upper end of the band"),
    _of_summary("bound_lower", "lowest that any smooth spectrum behind the signal reaches"),
    _of_summary("bound_upper", "highest that any smooth spectrum behind the signal reaches"),
    Fact("level", "probability that the band is made for",
         _if_estimated(lambda surface: surface.summary.level)),
    Fact("outcome", "how the sampler ended",
         lambda surface: surface.samples and surface.samples.outcome.name),
    Fact(
        "error_budget", "relative standard error of the signal in each band, by cause",
        _if_estimated(lambda surface:
                      {cause: errors.tolist()
                       for cause, errors in surface.error_budget.items()})),
    Fact("variance_shares", "share of each cause in the variance of the spectrum",
         _if_estimated(lambda surface: surface.causes)),
    Fact("families", "of surfaces that the signal allows, and what 95 % bands of each held when "
         "judged", _if_estimated(lambda surface: family_coverage.coverage_facts(surface.families))))
