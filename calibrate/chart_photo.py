"""A photo of a chart with what is stated of it, and whether patches, light and reference can belong
together.
"""


from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated, NoReturn

import numpy as np

from spectrabox.calibrate import chart_equations
from spectrabox.calibrate.light_error import light_terms
from spectrabox.radiometry import errors, findings, shaped
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.charts.references import ChartCopies
from spectrabox.radiometry.records import calibration, photos, spectra
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid


@dataclass(frozen=True, eq=False)
class ChartPhoto(shaped.Record):
    """A photo of a chart: its patches, their reflectances, and the light on them."""

    samples: photos.PatchSamples
    reflectances: Annotated[np.ndarray, "I P"]
    light: spectra.Spectrum | spectra.UnknownLight
    # On each patch for a light spectrum of 1. None: not known, a smooth field is allowed.
    irradiance: Annotated[np.ndarray, "I"] | None = None
    excluded: Annotated[np.ndarray, "I"] | None = None      # bool: patches that no fit may use
    chart: Chart = CLASSIC
    # before the lens or the lamp; never of the first photo
    filter: calibration.Filter | None = None
    bands: tuple[str, ...] = ()         # K names; none: those of bands that nobody named
    # What the chart may be, the likelier first: a copy of the first about its mean, which the
    # reflectances are. None: they are the chart's own.
    editions: tuple[ChartCopies, ...] = ()

    @property
    def used(self) -> np.ndarray:
        """Whether each patch (I,) may be used: neither excluded nor saturated in every band. Of one
        that is, fits use the bands that are not clipped.
        """
        if self.excluded is None:
            return ~self.samples.saturated
        return ~(self.excluded.astype(bool) | self.samples.saturated)

    @property
    def irradiance_or_pi(self) -> np.ndarray:
        """Irradiance (I,) on each patch; pi where unknown."""
        if self.irradiance is None:
            return np.full(len(self.reflectances), np.pi)
        return self.irradiance

    @property
    def band_names(self) -> tuple[str, ...]:
        """K names, those that are usual where nobody named the bands."""
        return self.bands or spectra.default_band_names(self.samples.mean.shape[1])

    def light_on(self, grid: spectra.WavelengthGrid) -> spectra.Spectrum:
        """The light as a calibration carries it; of an unknown one, whose products with the curves
        are fitted, a light of 1.

        Parameters
        ----------
        grid : WavelengthGrid
            Working grid, of P wavelengths.
        """
        if isinstance(self.light, spectra.UnknownLight):
            return spectra.Spectrum(grid, np.ones_like(grid.nm), spectra.Quantity.RELATIVE,
                                    self.light.words)
        return self.light

    def equations(self, grid: spectra.WavelengthGrid) -> chart_equations.ChartEquations:
        """Of all patches, with a field where the illumination of the chart is not known.

        Parameters
        ----------
        grid : WavelengthGrid
            Working grid, of P wavelengths.
        """
        power, _ = light_power(self.light_on(grid), grid)
        positions = self.chart.centres_uv if self.irradiance is None else None
        terms = light_terms(self.light, grid) if isinstance(self.light, spectra.Spectrum) else None
        return chart_equations.chart_equations(self.samples, self.reflectances, power,
                                               self.irradiance_or_pi, grid, rows=self.chart.rows,
                                               positions=positions, light_terms=terms,
                                               filter=self.filter,
                                               copies=self.editions[0] if self.editions else None)


def first_date(shown: Sequence[photos.PatchSamples]) -> str:
    """When the first of some photos was taken; empty where none says so.

    Parameters
    ----------
    shown : sequence of PatchSamples
    """
    return min((samples.taken_at for samples in shown if samples.taken_at), default="")


def used_and_excluded(photos: Sequence[ChartPhoto], grid: spectra.WavelengthGrid
                      ) -> tuple[list[chart_equations.ChartEquations],
                                 chart_equations.ChartEquations | None]:
    """The patches of all photos that are used, and those of the first that are not.

    Parameters
    ----------
    photos : sequence of ChartPhoto
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    used, excluded = [], None
    for number, photo in enumerate(photos):
        equations = photo.equations(grid)
        if photo.used.all():
            used.append(equations)
            continue
        used.append(chart_equations.some_patches(equations, photo.used))
        if number == 0:
            excluded = chart_equations.some_patches(equations, ~photo.used)
    return used, excluded


# ---- whether patches, light and reference can belong together at all, before and after a fit -----

ALIKE = 1e-3                 # relative spread of the ratio of two bands over the patches
DARK_LIGHT = 1e-3            # of the light's largest value
MAX_IRRADIANCE = 50.0        # W m-2 nm-1; the sun gives 1.5
WORST_MODEL_ERROR = 0.05     # relative: no camera explains patches that disagree by more
WORST_CHI_SQUARE = 3.0


def require_usable(signal: np.ndarray, filtered: bool = False) -> None:
    """Refuse signals of patches to which no sensitivities can be fitted.

    Parameters
    ----------
    signal : (I, K) array
    filtered : bool
        Whether a filter leaves bands dark or alike, as it may.

    Raises
    ------
    CalibrationError
        If patches are too few or not positive, or two bands give every patch the same signal, as in
        a grey picture.
    """
    if len(signal) < photos.MIN_PATCHES:
        raise errors.CalibrationError(f"{len(signal)} patches are too few to find sensitivities; "
                               f"{photos.MIN_PATCHES} are needed")
    if filtered:
        return
    bad = np.flatnonzero(~(np.isfinite(signal).all(axis=1) & (signal > 0).all(axis=1)))
    if bad.size:
        raise errors.CalibrationError(
            f"patch {bad[0] + 1} has no positive signal in every band; check "
            "the black level of the photo, that no converter computed its colours with a "
            "matrix, and that each column of a table of patches is a band")
    balanced = signal / signal.mean(axis=0)
    for second, first in combinations(range(signal.shape[1]), 2):
        if np.std(balanced[:, first] / balanced[:, second]) < ALIKE:
            raise errors.CalibrationError(f"bands {second + 1} and {first + 1} read alike on every "
                                   "patch; the photo is grey or a band was written twice: give "
                                   "a colour photo")


def light_power(light: spectra.Spectrum,
                grid: spectra.WavelengthGrid) -> tuple[np.ndarray, tuple[findings.Finding, ...]]:
    """The light (P,) on the working grid, and where it has no power.

    Parameters
    ----------
    light : Spectrum
    grid : WavelengthGrid
        Working grid, of P wavelengths.

    Raises
    ------
    InputError
        If the light does not cover the grid, is negative, or cannot be in the unit it states.
    """
    power = spectrum_on_grid(light, grid)
    if power.max() <= 0 or power.min() < -0.01 * power.max():
        raise errors.InputError(f"{light.source}: a light spectrum must be positive; it runs from "
                         f"{power.min():.3g} to {power.max():.3g} over "
                         f"{grid.nm[0]:g}-{grid.nm[-1]:g} nm")
    if light.quantity is spectra.Quantity.IRRADIANCE and power.max() > MAX_IRRADIANCE:
        raise errors.InputError(
            f"{light.source}: {power.max():.3g} W m-2 nm-1 is more than any lamp "
            "gives; state the unit, for example '# unit: uW cm-2 nm-1'")
    power = np.maximum(power, 0.0)
    return power, tuple(
        findings.Finding("light.unlit", findings.Severity.NOTE,
                values={"low_nm": low, "high_nm": high, "below": DARK_LIGHT})
        for low, high in wavelength_ranges(unlit(power), grid))


def unlit(power: np.ndarray) -> np.ndarray:
    """Whether the light has practically no power, at each wavelength (P,).

    Parameters
    ----------
    power : (P,) array
        Its spectrum, any unit.
    """
    return power < DARK_LIGHT * power.max()


def wavelength_ranges(chosen: np.ndarray,
                      grid: spectra.WavelengthGrid) -> list[tuple[float, float]]:
    """First and last wavelength (nm) of each run of chosen samples.

    Parameters
    ----------
    chosen : (P,) bool array
    grid : WavelengthGrid
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(int)))
    return [(float(grid.nm[start]), float(grid.nm[stop - 1]))
            for start, stop in edges.reshape(-1, 2)]


def disagreement(signal: np.ndarray, held_out: np.ndarray) -> float:
    """Rms relative difference of signals (I, K) and what the other patches predict of each.

    Of patches darker than 3 % of the brightest, relative to that.

    Parameters
    ----------
    signal, held_out : (I, K) arrays
    """
    return float(np.sqrt(np.mean(disagreement_of_bands(signal, held_out) ** 2)))


def disagreement_of_bands(signal: np.ndarray, held_out: np.ndarray) -> np.ndarray:
    """The same of each band (K,).

    Parameters
    ----------
    signal, held_out : (I, K) arrays
    """
    return np.sqrt(np.mean(_relative(signal, held_out) ** 2, axis=0))


def _relative(signal: np.ndarray, held_out: np.ndarray) -> np.ndarray:
    return np.asarray((signal - held_out)
                      / np.maximum(signal, chart_equations.DARK_SHARE * signal.max(axis=0)))


def refuse_disagreement(explanation: str, signal: np.ndarray, held_out: np.ndarray,
                        chi_square: float, reading: str | None) -> NoReturn:
    """Raise the error of a photo that is not explained, with what may be the cause.

    Parameters
    ----------
    explanation : str
        What does not explain which photo.
    signal, held_out : (I, K) arrays
        See ``disagreement``.
    chi_square : float
        Of the fit, see ``PriorFit``.
    reading : str or None
        How the photo would have to be read for some camera to explain it.

    Raises
    ------
    UnexplainedChartError
    """
    hint = (f"read as {reading} the patches would agree: correct that" if reading is not None else
            "check the chart reference, the light spectrum (or state the light as \"unknown\"), "
            "glare, and that the photo is linear (not a JPEG)")
    percent = float(f"{100 * disagreement(signal, held_out):.2g}")     # 120, not 1.2e+02
    raise errors.UnexplainedChartError(
        f"{explanation}: its patches disagree with the reference by {percent:g} % rms "
        f"(chi-square {chi_square:.1f} per signal); {hint}",
        int(np.argmax(np.square(_relative(signal, held_out)).sum(axis=1))))
