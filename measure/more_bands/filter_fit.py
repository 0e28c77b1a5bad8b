"""The transmittance of a filter, from two photos of a chart or from two readings of a lamp."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.calibrate.chart_calibration import CalibrationOptions, calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.measure.camera import chart_signals
from spectrabox.measure.steps import chart_fit
from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.light_scale import exposure_ratio
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.radiometry.records.spectra import Spectrum, UnknownLight
from spectrabox.radiometry.spectra.filters import unknown_filter
from spectrabox.radiometry.spectra.spectrum_files import on_grid, spectrum_on_grid

READING_ERROR = 0.005       # relative, of a reading whose error nobody stated: the lamp repeats
DARK_READING = 1e-3         # of the largest: no transmittance is read from less light


@dataclass(frozen=True, eq=False)
class MeasuredFilter:
    """A transmittance with its standard error, at 400, 401 ... 700 nm."""

    transmittance: np.ndarray       # (301,)
    standard_error: np.ndarray      # (301,)
    level_known: bool               # else it is of mean 1 where most light passes
    source: str

    def facts(self) -> dict[str, object]:
        """As ``spectrabox filter fit --json`` names them."""
        return {"wavelengths_nm": FINE_GRID.nm, "transmittance": self.transmittance,
                "standard_error": self.standard_error, "level_known": self.level_known}

    def text(self) -> str:
        """Range and errors, for a person."""
        relative = self.standard_error / self.transmittance.max()
        level = "" if self.level_known else \
            "; its level is not known, and was set to 1 at its best"
        return (f"transmittance {self.transmittance.min():.3f} to {self.transmittance.max():.3f}, "
                f"standard error {relative.mean():.1%} of its largest value on average, "
                f"{relative.max():.1%} at worst{level}")


def filter_from_photos(bare: LinearImage, through: LinearImage, chart: Chart,
                       reflectances: np.ndarray, light: Spectrum | UnknownLight) -> MeasuredFilter:
    """Transmittance between two photos of a chart from one tripod under one light.

    Parameters
    ----------
    bare, through : LinearImage
        The second through the filter.
    chart : Chart
    reflectances : (I, 301) array
        Of the chart.
    light : Spectrum or UnknownLight

    Raises
    ------
    ChartNotFoundError, CheckError, ClippedPhotoError, InputError, CalibrationError
        If they are one photo, or one does not show the chart well.
    """
    if bare.signal.shape == through.signal.shape and np.array_equal(bare.signal, through.signal):
        raise InputError(f"{bare.source} and {through.source} are one photo; the second is to be "
                         "taken through the filter")
    expected = chart_signals(chart, reflectances, FINE_GRID)
    first = chart_fit.find(bare, expected, chart)
    second = chart_fit.find(through, expected, chart, before=first, filtered=True)
    shown = []
    for photo, detection, passed in ((bare, first, None), (through, second, unknown_filter())):
        patches = chart_fit.patches(photo, detection, chart, photo.source)
        shown.append(ChartPhoto(patches, reflectances, light, chart=chart, filter=passed))
    stated = bare.exposure_s is not None and through.exposure_s is not None
    return filter_from_charts(shown[0], shown[1],
                              exposure_ratio(bare, through) if stated else None)


def filter_from_charts(bare: ChartPhoto, through: ChartPhoto, exposure: float | None,
                       options: CalibrationOptions | None = None) -> MeasuredFilter:
    """Transmittance between two photos of a chart under one light, known or not.

    Parameters
    ----------
    bare : ChartPhoto
    through : ChartPhoto
        Through the filter: ``filters.unknown_filter()``, or one whose statement is checked.
    exposure : float or None
        Of the second photo relative to the first; None where it is not stated.
    options : CalibrationOptions, optional

    Raises
    ------
    CalibrationError, CheckError, InputError
        As ``calibrate_chart``.
    """
    fit = calibrate_chart([bare, through], FINE_GRID, options).prior_fit
    assert fit is not None and fit.photos[1].filter is not None
    first, second = fit.photos
    fitted = fit.photos[1].filter
    level = second.scale / first.scale / exposure if exposure is not None else \
        1 / fitted.filter.transmittance.max()
    transmittance = level * fitted.filter.transmittance
    relative = np.einsum("pe,ef,pf->p", fitted.filter.modes, fitted.covariance,
                         fitted.filter.modes)
    return MeasuredFilter(transmittance, transmittance * np.sqrt(np.maximum(relative, 0)),
                          exposure is not None, f"{through.samples.mean.shape[0]} patches with and "
                          "without the filter")


def filter_from_readings(without: Spectrum, with_filter: Spectrum) -> MeasuredFilter:
    """Transmittance as the ratio of two readings of one lamp, with and without the filter.

    Parameters
    ----------
    without, with_filter : Spectrum
        Where they state no standard error, 0.5 % of each reading is assumed.

    Raises
    ------
    InputError
        If the lamp leaves wavelengths dark, or the filter adds light.
    """
    lamp, passed = (spectrum_on_grid(reading, FINE_GRID) for reading in (without, with_filter))
    dark = lamp < DARK_READING * lamp.max()
    if dark.any():
        nm = FINE_GRID.nm[dark]
        raise InputError(f"{without.source}: the lamp gives no light at {nm[0]:g} nm (of "
                         f"{nm.size} nm in all); read the filter in front of a lamp that covers "
                         "400-700 nm, halogen or daylight")
    transmittance = passed / lamp
    if transmittance.max() > 1.2:
        raise InputError(f"{with_filter.source} has {transmittance.max():.3g} times the light of "
                         f"{without.source}; give the reading without the filter first")
    errors = [READING_ERROR * values if reading.standard_error is None else on_grid(
        reading.grid.nm, reading.standard_error, FINE_GRID, reading.source)
        for reading, values in ((without, lamp), (with_filter, passed))]
    error = np.hypot(errors[1], transmittance * errors[0]) / lamp
    return MeasuredFilter(np.maximum(transmittance, 0), error, True,
                          f"{with_filter.source} over {without.source}")
