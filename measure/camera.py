"""A camera from photos of a chart and the spectrum of its light.

``chart_in_photo`` takes the patches from a photo; ``CameraFit.of_charts`` fits the curves of a
capture with their band, and checks them on patches that no fit saw. Files are read and written by
the callers.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from spectrabox.calibrate import chart_calibration, chart_photo
from spectrabox.calibrate.camera_curves import LEVEL, camera_curves, curve_band, curve_draws
from spectrabox.capture.chart import chart_agreement, quality
from spectrabox.measure import captured, rules, texts
from spectrabox.measure.results import calibration_facts
from spectrabox.measure.steps import chart_fit
from spectrabox.radiometry.chart import CLASSIC, Chart, typical_camera_signals
from spectrabox.radiometry.charts.references import published_signals, reference_reflectances
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity, faults, worst
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import calibration, photos, spectra

ERROR_PREFIX = "standard_error"   # before a band's name, of a column of errors


def chart_signals(chart: Chart, reflectances: np.ndarray | None,
                  grid: spectra.WavelengthGrid) -> np.ndarray:
    """Signals (I, 3) by which a chart is known in a photo whose light is not.

    Parameters
    ----------
    chart : Chart
    reflectances : (I, P) array or None
        On ``grid``; None for a chart whose published colours are known.
    grid : WavelengthGrid
    """
    if chart.references == CLASSIC.references:
        return chart_agreement.TYPICAL_SIGNALS
    return (published_signals(chart, grid) if reflectances is None
            else typical_camera_signals(reflectances, grid))


@dataclass(frozen=True, eq=False)
class ChartSignals:
    """The patches of a chart, as a photo of it or a table of signals gives them."""

    source: str
    samples: photos.PatchSamples
    bands: tuple[str, ...]
    findings: tuple[Finding, ...] = ()
    photo: photos.LinearImage | None = None     # None of a table


def chart_in_photo(photo: photos.LinearImage, stated: captured.Capture) -> ChartSignals:
    """The patches of the stated chart in a photo."""
    chart = stated.lit_chart
    expected = chart_signals(chart.layout, chart.reflectances, FINE_GRID)
    _, samples = chart_fit.find_patches(photo, expected, chart.layout, chart.corners_px,
                                        excluded=chart.excluded)
    return ChartSignals(photo.source, samples, spectra.default_band_names(photo.signal.shape[2]),
                        photo=photo)


def judged_chart(
        photo: photos.LinearImage, chart: Chart, reference: str | None,
        corners_px: np.ndarray | None = None, excluded: np.ndarray | None = None
) -> tuple[photos.ChartDetection, quality.ChartVerdict]:
    """The chart in a photo, and whether the photo is good enough.

    Parameters
    ----------
    photo : LinearImage
    chart : Chart
    reference : str or None
        Of its reflectances, by name or file; None for the layout's own.
    corners_px : (4, 2) array or None
        Of the chart, in pixels of the photo; None to search for it.
    excluded : (I,) bool array, optional
        Patches that the operator leaves out.

    Raises
    ------
    ChartNotFoundError, CheckError
        As ``find_chart``.
    InputError
        If the reference cannot be read.
    """
    reflectances = None if chart.has_known_colours and reference is None else \
        reference_reflectances(reference, chart, FINE_GRID)
    signals = chart_signals(chart, reflectances, FINE_GRID)
    detection = chart_fit.find(photo, signals, chart, corners_px, excluded=excluded)
    return detection, quality.judge_chart(photo, detection, signals, chart, excluded=excluded)


@dataclass(frozen=True, eq=False, repr=False)
class CameraFit:
    """A camera's curves with everything that led to them.

    ``chart`` holds those that belong to the stated light, ``sensitivity`` the camera's own.
    ``photo`` is the first of a chart: its exposure tells the light's strength in other photos.
    """

    chart: chart_calibration.ChartCalibration
    sensitivity: calibration.SensitivityFit
    draws: np.ndarray | None        # (T, K, P) of the curves; None by methods without a posterior
    # lower and upper (K, P), 90 %; None for measured curves
    curve_band: tuple[np.ndarray, np.ndarray] | None
    held_out: calibration.HeldOutPatches  # of the first photo, each by a calibration without it
    chart_photos: tuple[chart_photo.ChartPhoto, ...]
    bands: tuple[str, ...]          # K names
    of_signals: tuple[Finding, ...]
    photo: photos.LinearImage | None    # None of patches that were given as numbers

    @classmethod
    def of_charts(cls, shown: Sequence[ChartSignals], stated: Sequence[captured.Capture],
                  seed: int = 0) -> Self:
        """The curves of the camera that took some photos of a chart.

        Parameters
        ----------
        shown : sequence of ChartSignals
            One for each photo.
        stated : sequence of Capture
            One for each photo, or one for all. How the curves are fitted, and where light and chart
            stood, is stated with the first.
        seed : int
            Of the draws of the curves.

        Raises
        ------
        InputError
            If photos are of other bands, or two are the same.
        CheckError, CalibrationError
            As ``calibrate_chart``.
        """
        first = stated[0]
        chosen, scene = first.sensitivity, first.chart_scene
        _require_one_camera(shown)
        first.band_names(shown[0].bands)        # refuses measured curves of other bands
        irradiance = None if scene is None else chart_fit.irradiance_on(first.layout, scene,
                                                                        first.seed, "auto")
        charts = photos_of_charts(shown, stated, irradiance)
        fit, held_out = chart_fit.fit(charts, FINE_GRID, chosen)
        curves, draws = camera_curves(fit), curve_draws(fit, seed)
        band = curve_band(fit, draws)
        if scene is not None:
            error = chart_fit.lamp_error(first.layout, scene, first.repeatability.lamp_position,
                                         first.seed)
            fit = replace(fit, calibration=chart_fit.with_lamp_error(fit.calibration, error))
        return cls(fit, curves, draws, band, held_out, tuple(charts), shown[0].bands,
                   tuple(finding for one in shown for finding in one.findings), shown[0].photo)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What was found, each with ``code``, ``severity``, ``subject`` and ``values``: of light,
        camera and chart; causes before symptoms.
        """
        return (*rules.of_camera(self), *self.of_signals)

    @property
    def fitted(self) -> Finding:
        """What was fitted, how surely, and what it is for."""
        return rules.camera_fitted(self)

    @property
    def verdict(self) -> str:
        """"pass", "warn" or "fail", by the worst finding."""
        return {Severity.WARN: "warn", Severity.FAIL: "fail"}.get(worst(self.findings), "pass")

    @property
    def says(self) -> str:
        """What was fitted, how surely, and what speaks against it, in one sentence."""
        severity = worst(self.findings)
        against = [*dict.fromkeys(texts.says(one) for one in faults(self.findings)
                                  if one.severity is severity)]
        if not against:
            return f"{texts.sentence(self.fitted)}. {texts.remedy(self.fitted)}"
        more = f" And {len(against) - 1} more, above." if len(against) > 1 else ""
        return f"{texts.sentence(self.fitted)}. {against[0]}{more}"

    @property
    def line(self) -> str:
        """The verdict, for a terminal."""
        return f"verdict: {self.verdict.upper()}. {self.says}"

    @property
    def checks(self) -> tuple[str, ...]:
        """What was found, in sentences: the light first, then chart and colour matrix."""
        return tuple(calibration_facts.checks(self.findings))

    @property
    def light(self) -> str:
        """What is known of the light of each photo, in words."""
        return ", ".join(light_words(photo.light) for photo in self.chart_photos)

    @property
    def source(self) -> str:
        """Method and light, as a file of the curves states them."""
        method = self.sensitivity.method
        if self.chart.calibration.products and not method.startswith(spectra.PRODUCTS):
            method = f"{spectra.PRODUCTS}: {method}"
        return f"{method}, light {self.light}".replace("\n", " ")

    def facts(self) -> dict[str, object]:
        """As ``spectrabox camera fit --json`` names them (docs/reference/json.md)."""
        result, fit, names = self.chart, self.sensitivity, self.chart_photos[0].chart.names
        known = result.calibration.light_posterior
        facts: dict[str, object] = {
            "verdict": self.verdict, "says": self.says,
            "light_evidence": [
                {"light": one.values["stated"], "against": one.values["against"],
                 "limit": one.values["limit"], "contradicts": one.code == "light.contradicted",
                 "kinds": one.values["kinds"], "says": texts.says(one)}
                for one in result.light_evidence],
            "wavelengths_nm": fit.grid.nm, "sensitivities": fit.curves, "bands": self.bands,
            "lower": None if self.curve_band is None else self.curve_band[0],
            "upper": None if self.curve_band is None else self.curve_band[1],
            "level": LEVEL, "condition_number": fit.condition_number,
            "chart_delta_e00": float(result.delta_e.mean()),
            "held_out_delta_e00": float(result.held_out_delta_e.mean()),
            "chart_delta_e00_patches": result.delta_e, "light": self.light,
            "light_scale": result.scale.value,
            "light_scale_standard_error": result.scale.standard_error,
            "method": fit.method, "outcome": fit.outcome, "checks": list(self.checks),
            "findings": [texts.facts(one) for one in self.findings],
            "left_out": calibration_facts.held_out_facts(self.held_out, names),
            "doubts": calibration_facts.checks(faults(result.calibration.findings)),
            "chart_generation": calibration_facts.copy_facts(result.copy, names),
            "stated_lights": [
                {"light": one.values["stated"], "expected": one.values["expected"],
                 "departs": one.values["size"], "standard_error": one.values["size_error"],
                 "spectrum": spectrum} for one, spectrum in result.departures],
            "light_posterior": None if known is None else calibration_facts.posterior_facts(known)}
        joint = result.prior_fit
        if joint is not None:
            first = joint.photos[0]
            facts |= {"model_error": joint.model_error, "chi_square": joint.chi_square,
                      "prior_share": joint.prior_share, "photos": len(joint.photos),
                      "field": first.field, "glare": first.white.glare,
                      "nearest_cameras": [{"cameras": members, "probability": share}
                                          for members, share in joint.families]}
        return facts

    def text(self) -> str:
        """What was fitted and checked, for a person."""
        return "\n".join([f"bands {', '.join(self.bands)}: {self.sensitivity.method}",
                          *(f"- {check}" for check in self.checks), self.line])

    def columns(self) -> dict[str, np.ndarray]:
        """Curves (P,) and their standard errors, as the columns of a table."""
        fit = self.sensitivity
        columns = dict(zip(self.bands, fit.curves, strict=True))
        if fit.standard_error is not None:
            columns |= {f"{ERROR_PREFIX} {name}": values
                        for name, values in zip(self.bands, fit.standard_error, strict=True)}
        return columns


def light_words(light: spectra.Spectrum | spectra.UnknownLight) -> str:
    """What is known of a light, in words."""
    return light.words if isinstance(light, spectra.UnknownLight) else light.source


def photos_of_charts(shown: Sequence[ChartSignals], stated: Sequence[captured.Capture],
                     irradiance: np.ndarray | None = None) -> list[chart_photo.ChartPhoto]:
    """Charts in photos as their fits take them: where nobody stated the reflectances, the photos
    tell which copy it is.

    Parameters
    ----------
    shown, stated
        As of ``CameraFit.of_charts``.
    irradiance : (I,) array, optional
        On each patch for a light spectrum of 1; None where it is not known.
    """
    of_photos = [stated[index if len(stated) > 1 else 0] for index in range(len(shown))]
    return chart_fit.as_fitted([one.samples for one in shown], [one.lit_chart for one in of_photos],
                               [one.views[0].light for one in of_photos], irradiance)


def _require_one_camera(shown: Sequence[ChartSignals]) -> None:
    first = shown[0]
    for index, one in enumerate(shown):
        if any(np.array_equal(one.samples.mean, other.samples.mean) for other in shown[:index]):
            raise InputError(f"{one.source} holds the same signals as another of the photos; "
                             "counted twice, one photo would seem surer than it is: give each "
                             "photo once")
        if one.bands != first.bands:
            raise InputError(f"{one.source} has the bands {', '.join(one.bands)}, "
                             f"{first.source} has {', '.join(first.bands)}; all photos must be "
                             "of one camera, its bands in the same order")
