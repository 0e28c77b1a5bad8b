"""A filter measured from two photos of a chart, and further photos of the same samples."""


from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from spectrabox.calibrate import chart_calibration, chart_photo
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.measure.camera import chart_signals
from spectrabox.measure.regions.flat_signals import DARK_BAND
from spectrabox.measure.steps import chart_fit
from spectrabox.radiometry import chart, grid, light_scale
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import calibration, photos
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight
from spectrabox.radiometry.spectra.filters import unknown_filter
from spectrabox.radiometry.spectra.spectrum_files import on_grid, spectrum_on_grid

READING_ERROR = 0.005       # relative, of a reading whose error nobody stated: the lamp repeats
DARK_READING = 1e-3         # of the largest: no transmittance is read from less light


def filter_from_photos(bare: photos.LinearImage, through: photos.LinearImage, chart: chart.Chart,
                       reflectances: np.ndarray, light: Spectrum | UnknownLight
                       ) -> tuple[Spectrum, bool]:
    """Transmittance between two photos of a chart from one tripod under one light, as of
    `filter_from_charts`.

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
    expected = chart_signals(chart, reflectances, grid.FINE_GRID)
    detection, patches = chart_fit.find_patches(bare, expected, chart)
    _, filtered = chart_fit.find_patches(through, expected, chart, before=detection, filtered=True)
    stated = bare.exposure_s is not None and through.exposure_s is not None
    return filter_from_charts(
        chart_photo.ChartPhoto(patches, reflectances, light, chart=chart),
        chart_photo.ChartPhoto(filtered, reflectances, light, chart=chart, filter=unknown_filter()),
        light_scale.exposure_ratio(bare, through) if stated else None)


def filter_from_charts(
        bare: chart_photo.ChartPhoto, through: chart_photo.ChartPhoto, exposure: float | None,
        prior: CameraPrior | None = None) -> tuple[Spectrum, bool]:
    """Transmittance between two photos of a chart under one light, known or not.

    Parameters
    ----------
    bare : ChartPhoto
    through : ChartPhoto
        Through the filter: ``filters.unknown_filter()``, or one whose statement is checked.
    exposure : float or None
        Of the second photo relative to the first; None where it is not stated.
    prior : CameraPrior, optional

    Returns
    -------
    transmittance : Spectrum
        With its standard error, at 400, 401 ... 700 nm.
    level_known : bool
        Else it is 1 where most light passes.

    Raises
    ------
    CalibrationError, CheckError, InputError
        As ``calibrate_chart``.
    """
    fit = chart_calibration.calibrate_chart([bare, through], grid.FINE_GRID,
                                            prior=prior).prior_fit
    assert fit is not None and fit.photos[1].filter is not None
    first, second = fit.photos
    fitted = fit.photos[1].filter
    level = second.scale / first.scale / exposure if exposure is not None else \
        1 / fitted.transmittance.max()
    transmittance = level * fitted.transmittance
    relative = np.einsum("pe,ef,pf->p", fitted.modes, fitted.covariance, fitted.modes)
    return Spectrum(grid.FINE_GRID, transmittance, Quantity.RELATIVE,
                    f"{through.samples.mean.shape[0]} patches with and without the filter",
                    transmittance * np.sqrt(np.maximum(relative, 0))), exposure is not None


def filter_from_readings(without: Spectrum, with_filter: Spectrum) -> Spectrum:
    """Transmittance as the ratio of two readings of one lamp, with and without the filter, with its
    standard error at 400, 401 ... 700 nm.

    Parameters
    ----------
    without, with_filter : Spectrum
        Where they state no standard error, 0.5 % of each reading is assumed.

    Raises
    ------
    InputError
        If the lamp leaves wavelengths dark, or the filter adds light.
    """
    lamp, passed = (spectrum_on_grid(reading, grid.FINE_GRID) for reading in (without, with_filter))
    dark = lamp < DARK_READING * lamp.max()
    if dark.any():
        nm = grid.FINE_GRID.nm[dark]
        raise InputError(f"{without.source}: the lamp gives no light at {nm[0]:g} nm (of "
                         f"{nm.size} nm in all); read the filter in front of a lamp that covers "
                         "400-700 nm, halogen or daylight")
    transmittance = passed / lamp
    if transmittance.max() > 1.2:
        raise InputError(f"{with_filter.source} has {transmittance.max():.3g} times the light of "
                         f"{without.source}; give the reading without the filter first")
    errors = [READING_ERROR * values if reading.standard_error is None else on_grid(
        reading.grid.nm, reading.standard_error, grid.FINE_GRID, reading.source)
        for reading, values in ((without, lamp), (with_filter, passed))]
    error = np.hypot(errors[1], transmittance * errors[0]) / lamp
    return Spectrum(grid.FINE_GRID, np.maximum(transmittance, 0), Quantity.RELATIVE,
                    f"{with_filter.source} over {without.source}", error)


# ---- photos that may still be taken: under other lamps, and through filters ----------------------

DARK = 1e-3             # of the brightest: no curve is divided by a light below it


# Lamps, as spectra (301,) at 400, 401 ... 700 nm in any unit, and filters for the present light, by
# name
AtHand = Mapping[str, np.ndarray | calibration.Filter]


@dataclass(frozen=True, eq=False)
class FurtherPhoto:
    """A photo that may be taken: what its bands see, and how bright they are."""

    name: str
    response: np.ndarray        # (K, 301) to reflectances; rows sum to 1
    white: np.ndarray           # (K,) signal of white, that of the brightest band being 1
    stops: float                # exposure to add for that; 0 under another lamp
    light: np.ndarray           # (301,) that the camera sees
    filter: calibration.Filter | None = None        # None under another lamp

    @property
    def same_lamp(self) -> bool:
        """Whether it is taken under the lamp of the first photo, through a filter."""
        return self.filter is not None

    @property
    def dark(self) -> np.ndarray:
        """Numbers of the bands that tell nothing."""
        return np.flatnonzero(self.white < DARK_BAND)


def photos_at_hand(curves: np.ndarray, present: np.ndarray, hand: AtHand) -> list[FurtherPhoto]:
    """A further photo under each lamp and through each filter.

    Parameters
    ----------
    curves : (K, 301) array
        Sensitivities at 400, 401 ... 700 nm.
    present : (301,) array
        The light that filters are used under.
    hand : mapping
        From names to lamps and filters.

    Raises
    ------
    InputError
        If a band sees nothing at all.
    """
    photos = []
    now = _white(curves, present).max()
    for name, each in hand.items():
        if not isinstance(each, calibration.Filter):
            photos.append(_photo(name, curves, each))
            continue
        light = present * each.transmittance
        photo = _photo(name, curves, light)
        stops = float(np.log2(now / _white(curves, light).max()))
        photos.append(replace(photo, stops=stops, filter=each))
    return photos


def _photo(name: str, curves: np.ndarray, light: np.ndarray) -> FurtherPhoto:
    """A photo under another lamp."""
    white = _white(curves, light)
    if np.any(white <= 0):
        raise InputError(f"a band of the camera sees nothing with {name}; leave it out")
    return FurtherPhoto(name, curves * light * grid.FINE_GRID.weights_nm / white[:, None],
                        white / white.max(), 0.0, light)


def white_of_bands(curves: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Signal of white (K,), that of the brightest band being 1.

    Parameters
    ----------
    curves : (K, 301) array
    light : (301,) array
    """
    white = _white(curves, light)
    return white / white.max()


def _white(curves: np.ndarray, light: np.ndarray) -> np.ndarray:
    return np.asarray((curves * light) @ grid.FINE_GRID.weights_nm)


def curves_and_light(calibration: calibration.Calibration) -> tuple[np.ndarray, np.ndarray]:
    """Sensitivities (K, 301) and the light (301,) of a calibration.

    Parameters
    ----------
    calibration : Calibration
    """
    fit = calibration.sensitivity
    curves = on_grid(fit.grid.nm, np.maximum(fit.curves, 0), grid.FINE_GRID, "the camera's curves")
    if calibration.light_posterior is None:
        return curves, spectrum_on_grid(calibration.light, grid.FINE_GRID)
    known = calibration.light_posterior
    light = on_grid(known.grid.nm, known.mean, grid.FINE_GRID, "the light's posterior")
    light = np.maximum(light, DARK * light.max())
    return curves / light, light
