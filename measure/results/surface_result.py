"""What was found of one surface: a material of a scene, or a region of a flat sample."""
from __future__ import annotations

from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from spectrabox.measure.extras import attempt
from spectrabox.measure.regions.moved_lamp import InPlace, found_in_places
from spectrabox.measure.results.facts import Fact, known_facts
from spectrabox.measure.surfaces.metamers import MetamerPair, metamer_pair
from spectrabox.measure.surfaces.surface_signals import noise_and_disagreement, relative_errors
from spectrabox.measure.surfaces.surface_spectra import Scores, score
from spectrabox.measure.words import percent
from spectrabox.radiometry.appearance import reflectance_to_lab, reflectance_to_srgb
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.grid import FINE_GRID, WavelengthGrid
from spectrabox.radiometry.records.photos import RegionEdge
from spectrabox.radiometry.records.spectra import (
    Spectrum,
    SpectrumSamples,
    SpectrumSummary,
    SurfaceSignals,
    SurfaceSpectrum,
)
from spectrabox.radiometry.records.states import StateEstimate
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.sampling.prior.family_coverage import (
    FamilyCoverage,
    coverage_facts,
    mostly_in_doubt,
)

STEP_NM = 5     # of spectra among the facts; spectra.csv holds every nanometre


@dataclass(frozen=True, eq=False, kw_only=True)
class SurfaceResult:
    """Everything known of one surface."""

    name: str
    grid: WavelengthGrid              # of ``spectrum``
    # (P,) of inverse rendering, or as given. None of an estimated region
    spectrum: np.ndarray | None
    bands: tuple[str, ...]            # J names, of the signal
    signal: np.ndarray                # (J,) relative to white, NaN in bands that do not show it
    signal_covariance: np.ndarray     # (J, J) noise
    model_covariance: np.ndarray      # (J, J) relative: photo and model disagree
    summary: SpectrumSummary | None = None      # None where the spectrum was given
    samples: SpectrumSamples | None = None
    # cause -> relative standard error of this surface's signal in the bands that show it
    error_budget: dict[str, np.ndarray] = field(default_factory=dict)
    truth: Spectrum | None = None
    scores: Scores | None = None
    # cause -> share of the spectrum's variance
    variance_shares: dict[str, float] = field(default_factory=dict)
    # of surfaces that the signal allows, or that were stated; none without the learnt prior
    families: tuple[FamilyCoverage, ...] = ()
    # what the signal says of its gloss; None without the learnt prior, or where none may be
    gloss: StateEstimate | None = None
    # of a region under a lamp that was moved: gloss and level in each of its places
    places: tuple[InPlace, ...] = ()
    # of a region: light relative to the chart's mean, and its relative standard error
    light: tuple[float, float] | None = None
    # of a region: relative scatter of its pixels beyond noise and a plane, in the worst band
    scatter: float | None = None
    edge: RegionEdge | None = None      # across a region, in the first photo that shows one

    @property
    def known(self) -> bool:
        """Whether its spectrum was given."""
        return self.summary is None

    @property
    def nm(self) -> np.ndarray:
        """Wavelengths (P,) of ``mean``."""
        return self.grid.nm if self.summary is None else self.summary.grid.nm

    @property
    def mean(self) -> np.ndarray:
        """The mean (P,) of the draws, or the spectrum that was given."""
        if self.summary is not None:
            return self.summary.mean
        assert self.spectrum is not None, "a surface is estimated or given"
        return self.spectrum

    @property
    def band_width(self) -> float | None:
        """Mean width of the band over wavelength; None where the spectrum was given."""
        if self.summary is None:
            return None
        return float(np.mean(self.summary.upper - self.summary.lower))

    @cached_property
    def lab(self) -> np.ndarray:
        """L*, a*, b* (3,) of the mean under D65."""
        return reflectance_to_lab(self.nm, self.mean)

    @cached_property
    def lab_error(self) -> np.ndarray | None:
        """Standard errors (3,) of L*, a*, b*; None of a spectrum given, or of a single draw."""
        samples = self.samples
        if samples is None or len(samples.spectra) < 2:
            return None
        return np.asarray(reflectance_to_lab(samples.grid.nm, samples.spectra).std(axis=0))

    @cached_property
    def srgb(self) -> np.ndarray:
        """Encoded sRGB (3,) of the mean, 0 to 1."""
        return reflectance_to_srgb(self.nm, self.mean)

    @property
    def metamers(self) -> MetamerPair | None:
        """Two of its draws that the photo cannot tell apart; None without two draws."""
        return self.compared[0]

    @cached_property
    def compared(self) -> tuple[MetamerPair | None, Finding | None]:
        """The same, and why it could not be made."""
        samples = self.samples
        if samples is None or len(samples.spectra) < 2:
            return None, None
        return attempt("comparison of spectra that look alike", lambda: metamer_pair(samples), None)

    @property
    def doubtful(self) -> bool:
        """Whether its draws ended with a reservation."""
        return self.samples is not None and not self.samples.outcome.as_intended

    @property
    def facts(self) -> dict[str, Any]:
        """For JSON: `SURFACE_FACTS` that are known of it."""
        return known_facts(SURFACE_FACTS, self)

    @property
    def untested(self) -> bool:
        """Whether most of what it may be was not certified on measured surfaces."""
        return mostly_in_doubt(self.families)


def surface_result(signals: SurfaceSignals, index: int, spectrum: SurfaceSpectrum | None,
                   truth: Spectrum | None = None, inverse_rendering: np.ndarray | None = None,
                   families: tuple[FamilyCoverage, ...] = (),
                   light: tuple[float, float] | None = None,
                   scatter: float | None = None, edge: RegionEdge | None = None) -> SurfaceResult:
    """What was found of one surface.

    Parameters
    ----------
    signals : SurfaceSignals
    index : int
        Of the surface.
    spectrum : SurfaceSpectrum or None
        None where the spectrum was given.
    truth : Spectrum, optional
        Measured, to compare with.
    inverse_rendering : (P,) array, optional
        The one spectrum of inverse rendering.
    families : tuple of FamilyCoverage
        That the surface may be of.
    light, scatter, edge
        Of a region, as of `SurfaceResult`.
    """
    noise, disagreement = noise_and_disagreement(signals, index)
    common: dict[str, Any] = {
        "name": signals.names[index], "grid": signals.grid, "bands": signals.bands,
        "signal": signals.signal[index], "signal_covariance": noise,
        "model_covariance": disagreement, "truth": truth, "light": light, "scatter": scatter,
        "edge": edge}
    if spectrum is None:
        return SurfaceResult(**common, spectrum=signals.spectra[index])
    scores = None
    if truth is not None:
        scores = score(spectrum_on_grid(truth, FINE_GRID), inverse_rendering, spectrum.summary,
                       spectrum.samples)
    return SurfaceResult(
        **common, spectrum=inverse_rendering, summary=spectrum.summary, samples=spectrum.samples,
        error_budget=relative_errors(signals, index), scores=scores,
        variance_shares=spectrum.variance_shares, families=families, gloss=spectrum.states,
        places=found_in_places(signals, index, spectrum.states))


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


def _next(surface: SurfaceResult) -> float | None:
    return None if surface.summary is None else surface.summary.next_measurement_nm


def _edge_facts(edge: RegionEdge) -> dict[str, Any]:
    part = edge.larger_part_px
    return {"kind": edge.kind.value,
            "step": [None if np.isnan(step) else float(step) for step in edge.step],
            "line_px": edge.line_px.tolist(),
            "larger_part_px": None if part is None else part.astype(int).tolist()}


def _if_estimated(value: Any) -> Any:
    """A fact of surfaces that were estimated."""
    return lambda surface: None if surface.known else value(surface)


# in the order of the columns of a table
SURFACE_FACTS: tuple[Fact[SurfaceResult], ...] = (
    Fact("name", "of the region or material", lambda surface: surface.name),
    Fact("known", "whether its spectrum was given", lambda surface: surface.known),
    Fact("lab_d65", "L*, a*, b* of the mean under D65, 2 degree observer",
         _if_estimated(lambda surface: surface.lab.tolist()), "L*a*b* under D65",
         lambda lab: " ".join(f"{value:.1f}" for value in lab)),
    Fact("lab_d65_error", "standard errors of L*, a*, b*; none of a single draw",
         lambda surface: None if surface.lab_error is None else surface.lab_error.tolist(), "±",
         lambda errors: " ".join(f"{value:.1f}" for value in errors)),
    Fact("band_width", "mean width of the band over wavelength, reflectance",
         lambda surface: surface.band_width, "band width", lambda width: f"{width:.3f}"),
    Fact("light", "on the region, relative to the chart's mean",
         lambda surface: surface.light and surface.light[0]),
    Fact("light_error", "relative standard error of that light",
         lambda surface: surface.light and surface.light[1], "light against chart ±", percent),
    Fact("scatter", "of the region's pixels beyond noise and a plane, relative",
         lambda surface: surface.scatter),
    Fact("edge", "across the region: `kind` (shadow or fold, two paints, or either), the `step` of "
         "the smaller part against the larger in each band of the photo, relative, the ends "
         "`line_px` of its line, and a rectangle `larger_part_px` on its larger side",
         lambda surface: surface.edge and _edge_facts(surface.edge)),
    Fact("gloss", "share of white that the surface mirrors beyond what the chart does, in the "
         "first photo: what is known beforehand and what the signals say together",
         lambda surface: surface.gloss and float(surface.gloss.mean[0]), "gloss", percent),
    Fact("gloss_error", "standard error of that share",
         lambda surface: surface.gloss and float(surface.gloss.standard_deviation[0]),
         "gloss known to", percent),
    Fact("lamp_places", "of a region under a lamp that was moved, for each of its places: `photo` "
         "(the first with it there), `gloss`, `gloss_error` (shares of white), `level`, "
         "`level_error` (light on the region against the chart's, relative)",
         lambda surface: [asdict(place) for place in surface.places] or None, "gloss, level",
         lambda places: "; ".join(InPlace(**place).text for place in places)),
    Fact("gloss_kinds", "probability of each kind of surface, by its gloss",
         lambda surface: surface.gloss and surface.gloss.shares),
    _of_scores("coverage_95", "share of wavelengths at which the 95 % band holds the truth",
               "95 % band holds", percent),
    _of_scores("rmse_mean", "root mean square error of the mean against the truth, reflectance",
               "RMSE", lambda rmse: f"{rmse:.4f}"),
    _of_scores("rmse_inverse_rendering", "the same of the one spectrum of inverse rendering",
               "RMSE inverse rendering", lambda rmse: f"{rmse:.4f}"),
    _of_scores("coverage_bounds", "share of wavelengths at which the exact bounds hold the truth"),
    _of_scores("delta_e00_mean", "CIEDE2000 of the mean against the truth under D65", "dE00",
               lambda difference: f"{difference:.2f}"),
    Fact("next_measurement_nm", "wavelength in nm at which one more reading would narrow the band "
         "most", _next),
    Fact("signal", "relative to white, in the bands that show it",
         lambda surface: surface.signal[_shown_bands(surface)].tolist()),
    Fact("bands", "names of these bands", lambda surface: [
        band for band, shown in zip(surface.bands, _shown_bands(surface), strict=True) if shown]),
    Fact("wavelengths_nm", f"of the curves, every {STEP_NM} nm",
         _if_estimated(lambda surface: surface.nm[::STEP_NM].tolist())),
    _of_summary("mean", "mean of the draws"),
    _of_summary("standard_deviation", "of the draws"),
    _of_summary("lower", "lower end of the band"), _of_summary("upper", "upper end of the band"),
    _of_summary("bound_lower", "lowest that any smooth spectrum behind the signal reaches"),
    _of_summary("bound_upper", "highest that any smooth spectrum behind the signal reaches"),
    Fact("level", "probability that the band is made for",
         _if_estimated(lambda surface: surface.summary.level)),
    Fact("outcome", "how the sampler ended",
         lambda surface: surface.samples and surface.samples.outcome.name),
    Fact("error_budget", "relative standard error of the signal in each band, by cause",
         _if_estimated(lambda surface: {cause: errors.tolist() for cause, errors
                                        in surface.error_budget.items()})),
    Fact("variance_shares", "share of each cause in the variance of the spectrum",
         _if_estimated(lambda surface: surface.variance_shares)),
    Fact("families", "of surfaces that the signal allows, and what 95 % bands of each held when "
         "judged", _if_estimated(lambda surface: coverage_facts(surface.families))))
