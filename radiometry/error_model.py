"""Every cause of error of a surface's signal, once: its name, its covariance, what it is common to.

    signal (J,) = response (J, P) @ reflectance (P,) + errors

relative to a perfect white in the surface's place. To first order, an error does one of three
things, and for each there is one function:

    added           it adds light: d s = pattern                        `added_covariance`
    proportional    it changes white or its light: d s = s x relative   `proportional_covariance`
    response        it bends curves: d s = integral (r - s) d response  `ResponseErrors`

The last holds s as well as r, since what white reads is calibrated: an error that is common to a
whole curve changes no signal. Flat samples, scenes, pixels and rehearsals read their errors here.

To first order is enough for an error of a few per cent. A light that is off by half is not an error
of half the measured signal that black has as well: it multiplies what the surface gives, whatever
that is. `split_errors` says which part of the errors does so,

    signal = (response @ reflectance) e^eps + n,    eps ~ N(0, relative), n ~ N(0, absolute)
"""
from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spectrabox.radiometry import covariance as covariances
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.interreflection import white_signal
from spectrabox.radiometry.records import calibration as calibration_records
from spectrabox.radiometry.records.spectra import SurfaceSignals, WavelengthGrid
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid

PHOTO_NOISE = "photo noise"
RENDERING_NOISE = "photo and rendering noise"
SENSITIVITIES = "sensitivities"
LIGHT = "light"     # its strength and its spectrum as one stated error, of a signal alone
LIGHT_SPECTRUM = "light spectrum"
WHITE = "white on the chart"
LIGHT_FIELD = "light over the picture"
LIGHT_SCALE = "light scale"
REPEATABILITY = "light and shutter repeat"
ROUNDED_EXPOSURES = "rounded exposures"
LAMP_AT_CHART = "lamp position at chart"
SCENE_LEVEL = "level of light on the scene"
KNOWN_SURFACES = "light by known surfaces"
LEVEL_BY_PRIOR = "level of light by what is expected of surfaces"
GLARE = "veiling glare"
STRAY_LIGHT = "stray light"
SAMPLE_PLANE = "plane of the samples"
SURFACE_REFLECTION = "surface reflection"
DISAGREEMENT = "photo and model disagree"
FILTER = "filter"


class Cause(NamedTuple):
    """What one cause of error does, and whether one error of it befalls several at once."""

    kind: str           # "added", "proportional" or "response"
    bands: bool         # of one photo
    surfaces: bool      # of one photo
    photos: bool        # under different light; those that only repeat a photo share all but noise


CAUSES = {
    PHOTO_NOISE: Cause("added", bands=False, surfaces=False, photos=False),
    RENDERING_NOISE: Cause("added", bands=False, surfaces=False, photos=False),
    SENSITIVITIES: Cause("response", bands=True, surfaces=True, photos=True),
    LIGHT: Cause("proportional", bands=True, surfaces=True, photos=False),
    LIGHT_SPECTRUM: Cause("response", bands=True, surfaces=True, photos=False),
    FILTER: Cause("response", bands=True, surfaces=True, photos=False),
    WHITE: Cause("proportional", bands=True, surfaces=True, photos=False),
    LIGHT_FIELD: Cause("proportional", bands=True, surfaces=False, photos=False),
    LIGHT_SCALE: Cause("proportional", bands=True, surfaces=True, photos=False),
    REPEATABILITY: Cause("proportional", bands=True, surfaces=True, photos=False),
    ROUNDED_EXPOSURES: Cause("proportional", bands=True, surfaces=True, photos=False),
    LAMP_AT_CHART: Cause("proportional", bands=True, surfaces=True, photos=False),
    SCENE_LEVEL: Cause("proportional", bands=True, surfaces=True, photos=False),
    KNOWN_SURFACES: Cause("proportional", bands=True, surfaces=True, photos=False),
    LEVEL_BY_PRIOR: Cause("proportional", bands=True, surfaces=True, photos=True),
    GLARE: Cause("added", bands=True, surfaces=True, photos=False),
    STRAY_LIGHT: Cause("added", bands=True, surfaces=True, photos=False),
    SAMPLE_PLANE: Cause("proportional", bands=True, surfaces=True, photos=False),
    SURFACE_REFLECTION: Cause("added", bands=True, surfaces=False, photos=False),
    DISAGREEMENT: Cause("proportional", bands=True, surfaces=False, photos=False),
}

PLANE_ERROR = 0.03          # relative, of the light on flat samples: tilt, height, distance
# relative, of the light on a scene against that on its chart: distances to 0.5 % (1 %), a lamp that
# shines unevenly to different sides (1 %), a chart tilted by 2 degrees in light from 30 (2 %)
SCENE_LEVEL_ERROR = 0.025

DARK = 1e-12             # of the light's strongest wavelength
# Of the signal of the brightest band, that of a nearly dark one; and of that, its error by curves
# from which it is light that other bands tell of.
NEARLY_DARK = 0.25
LEAST_SIGNAL = 1e-9      # of white: of less there is no share
# Relative variance of a sum of bands, over the largest of theirs, from which they cancel.
CANCELLING = 2.0


# ---- errors that add light, and errors of white --------------------------------------------------

def added_covariance(pattern: np.ndarray, view_of_band: np.ndarray | None = None) -> np.ndarray:
    """Covariance (..., J, J) of signals by light that is added to the bands of a photo at once.

    Parameters
    ----------
    pattern : (..., J) array
        What one standard deviation of it adds to the signals.
    view_of_band : (J,) array, optional
        The photo of each band: that of different photos is independent. One photo by default.
    """
    covariance = pattern[..., :, None] * pattern[..., None, :]
    return covariance if view_of_band is None else \
        covariance * (view_of_band[:, None] == view_of_band)


def proportional_covariance(signal: np.ndarray, relative: np.ndarray) -> np.ndarray:
    """Covariance (..., J, J) of signals by errors in proportion to them.

    Parameters
    ----------
    signal : (..., J) array
    relative : (..., J, J) array
        Relative covariance.
    """
    return np.asarray(signal[..., :, None] * signal[..., None, :] * relative)


class Errors(NamedTuple):
    """Errors of signals: what multiplies them, as shares, and what adds to them."""

    relative: np.ndarray        # (..., K, K) covariance of the logarithm of what multiplies them
    absolute: np.ndarray        # (..., K, K) covariance

    @classmethod
    def of_total(cls, total: np.ndarray, signals: np.ndarray,
                 relative: np.ndarray | None) -> Errors:
        """Of a covariance (..., K, K) about measured signals (..., K): as much of what multiplies
        them as it holds, and the rest.
        """
        if relative is None or not relative.any():
            return cls(np.zeros_like(total), total)
        share = covariances.largest_share(total, proportional_covariance(signals, relative))
        relative = share[..., None, None] * relative
        return cls(relative, total - proportional_covariance(signals, relative))

    def total(self, signals: np.ndarray) -> np.ndarray:
        """Covariance (..., K, K) about signals (..., K)."""
        return np.asarray(self.absolute + proportional_covariance(signals, self.relative))

    def rows(self, index: np.ndarray | slice) -> Errors:
        """Those of some of many signals."""
        return Errors(self.relative[index], self.absolute[index])

    def of_sums(self, gain: np.ndarray, signals: np.ndarray) -> Errors:
        """Errors of sums of bands, by a gain (r, K) and the signals (..., K): the logarithm of a
        sum errs as those of its bands do, each by its share of the sum.

        Shares are those of the measured signals. Where bands cancel, so that a sum errs by more
        than its bands do, its logarithm says nothing: what multiplies all bands alike does so with
        the sums, the rest adds to them.
        """
        total = gain @ self.total(signals) @ gain.T
        if not self.relative.any():
            return Errors(np.zeros_like(total), total)
        sums = signals @ gain.T
        seen = sums > LEAST_SIGNAL
        shares = gain * signals[..., None, :] / np.where(seen, sums, 1.0)[..., None]
        of_each = shares @ self.relative @ np.swapaxes(shares, -1, -2)
        largest = np.diagonal(self.relative, axis1=-2, axis2=-1).max(axis=-1)
        kept = seen & (np.diagonal(of_each, axis1=-2, axis2=-1)
                       <= CANCELLING * largest[..., None])
        common = covariances.common_variance(self.relative, np.ones(gain.shape[1]))
        return Errors.of_total(total, sums, np.where(
            kept.all(axis=-1)[..., None, None], of_each, common[..., None, None]))


def split_errors(signals: np.ndarray, causes: Mapping[str, np.ndarray]) -> Errors:
    """The errors of signals in two: those that multiply them, and those that add to them.

    Errors in proportion to a signal multiply it. Errors of the response do as well, unless they are
    large in a band that is nearly dark beside the others: it sees light that they tell of. Then
    they add to all bands, to which they may be common.

    Parameters
    ----------
    signals : (..., K) array
        As measured.
    causes : mapping of (..., K, K) arrays
        Covariances about these signals, by name; what the error model does not name is added.

    Returns
    -------
    Errors
        The absolute part, and the signals times the relative one, add up to the sum of the causes.
    """
    signals = np.asarray(signals, dtype=float)
    total = np.sum([np.zeros((*signals.shape, signals.shape[-1])), *causes.values()], axis=0)
    seen = np.abs(signals) > LEAST_SIGNAL
    inverse = np.where(seen, 1 / np.where(seen, signals, 1.0), 0.0)
    dark = signals < NEARLY_DARK * signals.max(axis=-1, initial=0, keepdims=True)
    relative = np.zeros_like(total)
    for name, covariance in causes.items():
        kind = CAUSES[name].kind if name in CAUSES else "added"
        if kind == "added":
            continue
        own = proportional_covariance(inverse, covariance)
        if kind == "response":
            large = np.diagonal(own, axis1=-2, axis2=-1) > NEARLY_DARK**2
            adds = (dark & (large | ~seen)).any(axis=-1)
            own = np.where(adds[..., None, None], 0.0, own)
        relative += own
    return Errors.of_total(total, signals, relative)


def stated_causes(signals: np.ndarray, noise_covariance: np.ndarray, light_error: float,
                  sensitivity_error: float) -> dict[str, np.ndarray]:
    """Covariances (..., K, K) of signals by cause, one error being stated of camera and light each.

    An error of the light is common to all bands; that of a curve changes its own band alone.

    Parameters
    ----------
    signals : (..., K) array
    noise_covariance : (..., K, K) array
        Of the photo.
    light_error, sensitivity_error : float
        Relative standard errors.
    """
    bands = signals.shape[-1]
    return {PHOTO_NOISE: noise_covariance,
            LIGHT: proportional_covariance(signals, light_error**2 * np.ones((bands, bands))),
            SENSITIVITIES: proportional_covariance(signals, sensitivity_error**2 * np.eye(bands))}


def glare_signal(share: np.ndarray | float, mean_signal: np.ndarray) -> np.ndarray:
    """Signal (K,) that one standard deviation of veiling glare adds everywhere in a photo.

    Parameters
    ----------
    share : float or (K,) array
        Standard error of the glare, of the photo's mean signal.
    mean_signal : (K,) array
        Of the whole photo.
    """
    return np.asarray(share * mean_signal)


def with_common_error(scale: calibration_records.LightScale, cause: str,
                      relative: float) -> calibration_records.LightScale:
    """The scale with one more error, independent of its others, that all bands share.

    Parameters
    ----------
    scale : LightScale
    cause : str
    relative : float
        Standard error; 0 leaves the scale as it is.
    """
    if relative == 0:
        return scale
    error = scale.standard_error
    if error is not None:
        error = float(np.hypot(error, relative * scale.value))
    before = scale.common_errors.get(cause, 0.0)
    return dataclasses.replace(scale, standard_error=error, common_errors={
        **scale.common_errors, cause: float(np.hypot(before, relative))})


def error_of_each_band(scale: calibration_records.LightScale) -> float:
    """Relative standard error of the scale in one band without what all bands share; 0 where
    nobody stated it.
    """
    if scale.standard_error is None:
        return 0.0
    common = sum(error**2 for error in scale.common_errors.values())
    return float(np.sqrt(max((scale.standard_error / scale.value) ** 2 - common, 0.0)))


def scale_covariances(calibration: calibration_records.Calibration,
                      scale: calibration_records.LightScale) -> dict[str, np.ndarray]:
    """Relative covariance (K, K) of what the bands of one photo read of white, by cause.

    A known material sets one scale for all bands. A chart to which the curves are fitted too gives
    every band its own: their errors on white are uncorrelated within what
    benchmarks/bench_white_signal.py can tell. What befell the light or the shutter between the
    photos befell all bands.

    Parameters
    ----------
    calibration : Calibration
        Of the photo.
    scale : LightScale
        As it was used for the photo.
    """
    bands = len(calibration.sensitivity.curves)
    fitted = calibration.light_scale is not None and calibration.sensitivity.covariance is not None
    alike = np.ones((bands, bands))
    own = error_of_each_band(scale)**2 * (np.eye(bands) if fitted else alike)
    return {LIGHT_SCALE: own} | {cause: error**2 * alike
                                 for cause, error in scale.common_errors.items()}


# ---- errors of the response ----------------------------------------------------------------------

@dataclass(frozen=True, eq=False)
class ResponseErrors:
    """What E independent errors of one standard deviation change in the response of K bands, each
    relative to its response to white.
    """

    by_spectrum: np.ndarray     # (K, P, E) change of the signal by reflectance at each wavelength
    by_white: np.ndarray        # (K, E) its sum: change of the signal of white
    of_brightest: np.ndarray    # (K, K) covariance relative to the brightest band's signal

    def changes(self, signals: np.ndarray, spectra: np.ndarray) -> np.ndarray:
        """Changes (n, K, E) of signals (n, K) for the reflectances (n, P) behind them, white being
        calibrated.
        """
        return np.stack([spectra @ by_spectrum for by_spectrum in self.by_spectrum], axis=1) \
            - signals[:, :, None] * self.by_white

    def covariance(self, signals: np.ndarray, spectra: np.ndarray) -> np.ndarray:
        """Covariance (n, K, K) of signals (n, K), for the reflectances (n, P) behind them."""
        changes = self.changes(signals, spectra)
        brightest = signals.max(axis=1)[:, None, None]
        return np.asarray(changes @ changes.transpose(0, 2, 1) + brightest**2 * self.of_brightest)

    def together_with(self, other: ResponseErrors) -> ResponseErrors:
        """These errors and others, independent of them."""
        return ResponseErrors(np.concatenate([self.by_spectrum, other.by_spectrum], axis=2),
                              np.concatenate([self.by_white, other.by_white], axis=1),
                              self.of_brightest + other.of_brightest)

    def at(self, nm: np.ndarray, grid: WavelengthGrid) -> ResponseErrors:
        """The same for reflectances that are straight lines between other wavelengths ``nm``."""
        return dataclasses.replace(
            self, by_spectrum=interpolation_matrix(nm, grid.nm).T @ self.by_spectrum)


def curve_errors(calibration: calibration_records.Calibration,
                 grid: WavelengthGrid) -> ResponseErrors:
    """Errors of the camera's curves, SENSITIVITIES.

    With a covariance of the curves they are its principal directions, the same in photos under
    every light. Without one, every band errs by the stated share of the brightest band,
    independently in each photo: an error of a curve's tail admits light from there. Of a photo
    through a filter they are those of curves and filter that come with the same directions: both
    were fitted to the same charts. What the filter errs by besides is ``filter_errors``.

    Parameters
    ----------
    calibration : Calibration
    grid : WavelengthGrid
        Of the curves.
    """
    fit, bands = calibration.sensitivity, len(calibration.sensitivity.curves)
    if fit.covariance is None or fit.basis is None:
        return ResponseErrors(np.zeros((bands, grid.nm.size, 0)), np.zeros((bands, 0)),
                              calibration.relative_covariance)
    weight = spectrum_on_grid(calibration.light, grid) * grid.weights_nm
    white = white_signal(fit.curves * weight)[:, None, None]
    variances, directions = np.linalg.eigh(fit.covariance)
    chosen = variances > 0
    independent = (directions[:, chosen] * np.sqrt(variances[chosen])).reshape(
        bands, fit.basis.shape[1], -1)
    changes = (weight[:, None] * fit.basis / white) @ independent
    if calibration.filter is not None:
        changes = changes + _by_filter(calibration, grid) @ _filter_with(
            calibration.filter, variances[chosen], directions[:, chosen])
    return ResponseErrors(changes, changes.sum(axis=1), np.zeros((bands, bands)))


def filter_errors(calibration: calibration_records.Calibration,
                  grid: WavelengthGrid) -> ResponseErrors:
    """Errors of the filter's transmittance that are independent of the curves' errors, FILTER;
    none of a photo without one.

    Parameters
    ----------
    calibration : Calibration
    grid : WavelengthGrid
        Of the curves.
    """
    fit, bands = calibration.sensitivity, len(calibration.sensitivity.curves)
    if calibration.filter is None:
        changes = np.zeros((bands, grid.nm.size, 0))
    else:
        covariance = calibration.filter.covariance
        if fit.covariance is not None:
            variances, directions = np.linalg.eigh(fit.covariance)
            chosen = variances > 0
            shared = _filter_with(calibration.filter, variances[chosen], directions[:, chosen])
            covariance = covariance - shared @ shared.T
        changes = _by_filter(calibration, grid) @ covariances.error_patterns(covariance).T
    return ResponseErrors(changes, changes.sum(axis=1), np.zeros((bands, bands)))


def _by_filter(calibration: calibration_records.Calibration, grid: WavelengthGrid) -> np.ndarray:
    """Change (K, P, E) of the response by each mode of the filter, relative to white."""
    assert calibration.filter is not None
    response = calibration.sensitivity.curves * spectrum_on_grid(calibration.light, grid) \
        * grid.weights_nm
    response = response / white_signal(response)[:, None]
    return np.asarray(response[:, :, None] * calibration.filter.modes)


def _filter_with(filter: calibration_records.Filter, variances: np.ndarray,
                 directions: np.ndarray) -> np.ndarray:
    """Errors (E, C) of the filter that come with one standard deviation of the curves along each
    of their principal directions.
    """
    if filter.with_curves is None:
        return np.zeros((filter.modes.shape[1], variances.size))
    certain = variances > DARK * variances.max(initial=0.0)     # none of curves that are certain
    return np.asarray(filter.with_curves @ directions
                      * np.where(certain, 1 / np.sqrt(np.where(certain, variances, 1)), 0))


def light_errors(calibration: calibration_records.Calibration, grid: WavelengthGrid,
                 response: np.ndarray) -> ResponseErrors:
    """Errors of the readings of one light, LIGHT_SPECTRUM, which are independent of each other;
    none where nobody stated them.

    Parameters
    ----------
    calibration : Calibration
    grid : WavelengthGrid
    response : (K, P) array
        Of the bands to reflectances; rows sum to 1.
    """
    light, bands = calibration.light, len(response)
    if light.standard_error is None:
        changes = np.zeros((*response.shape, 0))
    else:
        power = spectrum_on_grid(light, grid)
        by_power = response / np.maximum(power, DARK * power.max())
        changes = by_power[:, :, None] * interpolation_matrix(light.grid.nm, grid.nm) \
            * light.standard_error
    return ResponseErrors(changes, changes.sum(axis=1), np.zeros((bands, bands)))


def sensitivity_covariance(calibrations: Sequence[calibration_records.Calibration],
                           surfaces: SurfaceSignals) -> np.ndarray:
    """Covariance (M, J, J) of the signals of M surfaces by the errors of the camera's curves.

    Parameters
    ----------
    calibrations : sequence of Calibration
        Of every photo, as ``surfaces.view_of_band`` numbers them.
    surfaces : SurfaceSignals
        Its signals and spectra; its own errors are not read.
    """
    views = [int(view) for view in np.unique(surfaces.view_of_band)]
    covariance = np.zeros((len(surfaces.names), len(surfaces.bands), len(surfaces.bands)))
    errors = {view: curve_errors(calibrations[view], surfaces.grid) for view in views}
    for number, view in enumerate(views):
        mine = np.flatnonzero(surfaces.view_of_band == view)
        signals = surfaces.signal[:, mine]
        covariance[:, mine[:, None], mine] = errors[view].covariance(signals, surfaces.spectra)
        for other in views[:number]:
            # photos under lights that are each unknown have products of their own
            if not np.array_equal(calibrations[view].sensitivity.curves,
                                  calibrations[other].sensitivity.curves):
                continue
            theirs = np.flatnonzero(surfaces.view_of_band == other)
            both = errors[view].changes(signals, surfaces.spectra) @ errors[other].changes(
                surfaces.signal[:, theirs], surfaces.spectra).transpose(0, 2, 1)
            covariance[:, mine[:, None], theirs] = both
            covariance[:, theirs[:, None], mine] = both.transpose(0, 2, 1)
    return covariance


def light_covariance(calibrations: Sequence[calibration_records.Calibration],
                     surfaces: SurfaceSignals) -> np.ndarray:
    """Covariance (M, J, J) of the signals of M surfaces by the stated errors of each light's
    readings.

    Views with the same bands are under the same light, and share them.

    Parameters
    ----------
    calibrations, surfaces
        As of ``sensitivity_covariance``.
    """
    covariance = np.zeros((len(surfaces.names), len(surfaces.bands), len(surfaces.bands)))
    mine = {int(view): np.flatnonzero(surfaces.view_of_band == view)
            for view in np.unique(surfaces.view_of_band)}
    responses = {view: surfaces.response[bands] for view, bands in mine.items()}
    changes = {view: light_errors(calibrations[view], surfaces.grid, responses[view]).changes(
        surfaces.signal[:, bands], surfaces.spectra) for view, bands in mine.items()}
    for view, bands in mine.items():
        for other, theirs in mine.items():
            if view == other or np.array_equal(responses[view], responses[other]):
                covariance[:, bands[:, None], theirs] = \
                    changes[view] @ changes[other].transpose(0, 2, 1)
    return covariance


def filter_covariance(calibrations: Sequence[calibration_records.Calibration],
                      surfaces: SurfaceSignals) -> np.ndarray:
    """Covariance (M, J, J) of the signals of M surfaces by the errors of each photo's filter.

    Parameters
    ----------
    calibrations, surfaces
        As of ``sensitivity_covariance``.
    """
    return _independent_of_views(surfaces, lambda view, _: filter_errors(
        calibrations[view], surfaces.grid))


def _independent_of_views(surfaces: SurfaceSignals,
                          errors_of: Callable[[int, np.ndarray], ResponseErrors]) -> np.ndarray:
    """Covariance (M, J, J) by errors that each view has of its own."""
    by_view = []
    for view in np.unique(surfaces.view_of_band):
        mine = surfaces.view_of_band == view
        by_view.append(errors_of(int(view), surfaces.response[mine]).covariance(
            surfaces.signal[:, mine], surfaces.spectra))
    bands = len(surfaces.bands)     # no surface is no row
    return np.array([covariances.block_diagonal(*blocks) for blocks
                     in zip(*by_view, strict=True)]).reshape(-1, bands, bands)
