"""A photo of a chart with what is stated of it, and its equations on a grid."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.calibrate.chart_consistency import light_power
from spectrabox.calibrate.chart_equations import ChartEquations, chart_equations, some_patches
from spectrabox.calibrate.light_error import light_terms
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.charts.classic_copies import ChartCopies
from spectrabox.radiometry.records.calibration import Filter
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import (
    Quantity,
    Spectrum,
    UnknownLight,
    WavelengthGrid,
    default_band_names,
)
from spectrabox.radiometry.shaped import Record


@dataclass(frozen=True, eq=False)
class ChartPhoto(Record):
    """A photo of a chart: its patches, their reflectances, and the light on them."""

    samples: PatchSamples
    reflectances: Annotated[np.ndarray, "I P"]
    light: Spectrum | UnknownLight
    # On each patch for a light spectrum of 1. None: not known, a smooth field is allowed.
    irradiance: Annotated[np.ndarray, "I"] | None = None
    excluded: Annotated[np.ndarray, "I"] | None = None      # bool: patches that no fit may use
    chart: Chart = CLASSIC
    filter: Filter | None = None        # before the lens or the lamp; never of the first photo
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
        return self.bands or default_band_names(self.samples.mean.shape[1])

    def light_on(self, grid: WavelengthGrid) -> Spectrum:
        """The light as a calibration carries it; of an unknown one, whose products with the curves
        are fitted, a light of 1.

        Parameters
        ----------
        grid : WavelengthGrid
            Working grid, of P wavelengths.
        """
        if isinstance(self.light, UnknownLight):
            return Spectrum(grid, np.ones_like(grid.nm), Quantity.RELATIVE, self.light.words)
        return self.light

    def equations(self, grid: WavelengthGrid) -> ChartEquations:
        """Of all patches, with a field where the illumination of the chart is not known.

        Parameters
        ----------
        grid : WavelengthGrid
            Working grid, of P wavelengths.
        """
        power, _ = light_power(self.light_on(grid), grid)
        positions = self.chart.centres_uv if self.irradiance is None else None
        terms = light_terms(self.light, grid) if isinstance(self.light, Spectrum) else None
        return chart_equations(self.samples, self.reflectances, power, self.irradiance_or_pi, grid,
                               rows=self.chart.rows, positions=positions, light_terms=terms,
                               filter=self.filter,
                               copies=self.editions[0] if self.editions else None)


def first_date(shown: Sequence[PatchSamples]) -> str:
    """When the first of some photos was taken; empty where none says so.

    Parameters
    ----------
    shown : sequence of PatchSamples
    """
    return min((samples.taken_at for samples in shown if samples.taken_at), default="")


def used_and_excluded(photos: Sequence[ChartPhoto], grid: WavelengthGrid
                      ) -> tuple[list[ChartEquations], ChartEquations | None]:
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
        used.append(some_patches(equations, photo.used))
        if number == 0:
            excluded = some_patches(equations, ~photo.used)
    return used, excluded
