"""What a further photo under another lamp or through filters would add to what was measured.

Spectra are drawn from what is known of a surface, the photos of each are simulated with the errors
that they would have, and the spectrum behind them is estimated as it will be: the forecast is the
mean over draws. Photos share errors as `measure.flat` has them; under the same lamp the second
chart sharpens the camera's curves: they are conditioned on the signals of its patches, whose
levels are free. Where the light of a session is unknown, the camera's own curves are the products
over the light's posterior mean.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from spectrabox.measure.regions.region_signals import DARK_BAND, SHARED_BY_PHOTOS
from spectrabox.measure.surfaces.surface_signals import errors_by_cause
from spectrabox.radiometry.covariance import error_patterns, symmetric
from spectrabox.radiometry.error_model import (
    CAUSES,
    DISAGREEMENT,
    FILTER,
    LIGHT_SPECTRUM,
    PHOTO_NOISE,
    RENDERING_NOISE,
    SENSITIVITIES,
    filter_covariance,
    light_covariance,
    sensitivity_covariance,
)
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.radiometry.records import (
    Calibration,
    Filter,
    FittedFilter,
    Quantity,
    SpectralMeasurement,
    Spectrum,
    SurfaceSignals,
)
from spectrabox.radiometry.spectra.spectrum_files import on_grid, spectrum_on_grid
from spectrabox.sampling.further.planner import PHOTO_MINUTES, PlannedStep
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture
from spectrabox.sampling.prior.mixture_posterior import (
    calibrated_bands,
    mean_and_spread,
    posterior,
)

DARK = 1e-3             # of the brightest: no curve is divided by a light below it
DARK_PATCH = 0.03       # of white: darker patches err as this
LEAST_SIGNAL = 0.02     # of white: below it noise is that of reading out
LEVEL = 0.95
SPECTRA = 24            # drawn, of which a further photo is simulated
TO_FINE = interpolation_matrix(PRIOR_GRID.nm, FINE_GRID.nm)
NOISES = (PHOTO_NOISE, RENDERING_NOISE)


@dataclass(frozen=True)
class LampsAtHand:
    """Lamps, and filters for the present light, by name."""

    lamps: Mapping[str, np.ndarray]     # (301,) spectra at 400, 401 ... 700 nm, any unit
    filters: Mapping[str, Filter]


@dataclass(frozen=True, eq=False)
class FurtherPhoto:
    """A photo that may be taken: what its bands see, and how bright they are."""

    name: str
    response: np.ndarray        # (K, 301) to reflectances; rows sum to 1
    white: np.ndarray           # (K,) signal of white, that of the brightest band being 1
    stops: float                # exposure to add for that; 0 under another lamp
    same_lamp: bool
    light: np.ndarray           # (301,) that the camera sees
    filter: Filter | None = None

    @property
    def dark(self) -> np.ndarray:
        """Numbers of the bands that tell nothing."""
        return np.flatnonzero(self.white < DARK_BAND)


@dataclass(frozen=True)
class Surface:
    """A surface of a session, with what its errors come from."""

    signals: SurfaceSignals
    index: int
    calibration: Calibration        # of the first photo
    chart: np.ndarray               # (I, 301) reflectances of the patches
    patch_error: float              # relative, of a patch in one band against the model


@dataclass(frozen=True)
class KnownSurface:
    """What is known of a surface before a further photo."""

    prior: LogitMixture
    measured: SpectralMeasurement
    spectra: np.ndarray             # (T, 61) draws of its reflectance
    surface: Surface | None = None  # None: photos err by noise alone


@dataclass(frozen=True)
class SecondPhoto(PlannedStep):
    """What a further photo, or several, would bring."""

    stops: tuple[float, ...] = ()           # of exposure to add in each
    dark_bands: tuple[int, ...] = ()        # from 1, over the bands of all


def photos_at_hand(curves: np.ndarray, present: np.ndarray,
                   hand: LampsAtHand) -> list[FurtherPhoto]:
    """A further photo under each lamp and through each filter.

    Parameters
    ----------
    curves : (K, 301) array
        Sensitivities at 400, 401 ... 700 nm.
    present : (301,) array
        The light that filters are used under.
    hand : LampsAtHand

    Raises
    ------
    InputError
        If a band sees nothing at all.
    """
    now = _white(curves, present).max()
    lights = {name: (light, None) for name, light in hand.lamps.items()} | {
        name: (present * filter.transmittance, filter) for name, filter in hand.filters.items()}
    photos = []
    for name, (light, filter) in lights.items():
        white = _white(curves, light)
        if np.any(white <= 0):
            raise InputError(f"a band of the camera sees nothing with {name}; leave it out")
        photos.append(FurtherPhoto(
            name, curves * light * FINE_GRID.weights_nm / white[:, None], white / white.max(),
            0.0 if filter is None else float(np.log2(now / white.max())), filter is not None,
            light, filter))
    return photos


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
    return np.asarray((curves * light) @ FINE_GRID.weights_nm)


def curves_and_light(calibration: Calibration) -> tuple[np.ndarray, np.ndarray]:
    """Sensitivities (K, 301) and the light (301,) of a calibration.

    Parameters
    ----------
    calibration : Calibration
    """
    fit = calibration.sensitivity
    curves = on_grid(fit.grid.nm, np.maximum(fit.curves, 0), FINE_GRID, "the camera's curves")
    if calibration.light_posterior is None:
        return curves, spectrum_on_grid(calibration.light, FINE_GRID)
    known = calibration.light_posterior
    light = on_grid(known.grid.nm, known.mean, FINE_GRID, "the light's posterior")
    light = np.maximum(light, DARK * light.max())
    return curves / light, light


def forecasts(known: KnownSurface, chosen: Sequence[Sequence[FurtherPhoto]],
              white: np.ndarray) -> list[SecondPhoto]:
    """Error and band of one surface's spectrum after each choice of further photos.

    Parameters
    ----------
    known : KnownSurface
    chosen : sequence of sequences of FurtherPhoto
        One or several photos together.
    white : (K,) array
        Signal of white in the first photo, that of the brightest band being 1.
    """
    prior, measured = known.prior, known.measured
    with threadpool_limits(1, "blas"):      # threads within small products would only wait
        spectra = _likely(prior, measured, known.spectra)
        before = simulated_errors(prior, measured.relative_response, measured.noise_covariance,
                                  spectra)
        steps = []
        for photos in chosen:
            rmse, width = simulated_errors(prior, *joined_errors(
                measured, spectra.mean(axis=0) @ TO_FINE.T, photos, white, known.surface), spectra)
            dark = [number * len(white) + int(band) + 1 for number, photo in enumerate(photos)
                    for band in photo.dark]
            steps.append(SecondPhoto(
                " and ".join(photo.name for photo in photos), before[1], width, before[0], rmse,
                PHOTO_MINUTES * len(photos), tuple(photo.stops for photo in photos), tuple(dark)))
    return steps


def joined_errors(measured: SpectralMeasurement, spectrum: np.ndarray,
                  photos: Sequence[FurtherPhoto], white: np.ndarray,
                  surface: Surface | None) -> tuple[np.ndarray, np.ndarray]:
    """Response (J, 301) and covariance (J, J) of what was measured and of further photos, without
    bands that are dark.

    Parameters
    ----------
    measured : SpectralMeasurement
    spectrum : (301,) array
        The reflectance about which the errors hold.
    photos : sequence of FurtherPhoto
    white : (K,) array
        As of ``forecasts``.
    surface : Surface or None
        None: photos err by noise alone.
    """
    response, covariances = joined_errors_of_several(
        [measured], spectrum[None], photos, white, None if surface is None else [surface])
    return response, covariances[0]


def joined_errors_of_several(measured: Sequence[SpectralMeasurement], spectra: np.ndarray,
                             photos: Sequence[FurtherPhoto], white: np.ndarray,
                             surfaces: Sequence[Surface] | None) -> tuple[np.ndarray, np.ndarray]:
    """The same of n surfaces of one photo, whose responses are one: response (J, 301), covariances
    (n, J, J).

    Parameters
    ----------
    measured : sequence of n SpectralMeasurement
    spectra : (n, 301) array
    photos, white
        As of ``joined_errors``.
    surfaces : sequence of n Surface or None
    """
    before = np.array([one.noise_covariance for one in measured])
    if not photos:
        return measured[0].relative_response, before
    known, bands = measured[0].signal.size, len(white)
    response = np.vstack([measured[0].relative_response, *(photo.response for photo in photos)])
    signals = np.hstack([[one.signal for one in measured], spectra @ response[known:].T])
    total = np.zeros((len(measured), len(response), len(response)))
    total[:, :known, :known] = before
    blocks = [slice(known + number * bands, known + (number + 1) * bands)
              for number in range(len(photos))]
    for index, signal in enumerate(signals):
        causes = ({PHOTO_NOISE: before[index]} if surfaces is None
                  else errors_by_cause(surfaces[index].signals, surfaces[index].index))
        for cause, covariance in causes.items():
            own = covariance[:bands, :bands]
            if cause in NOISES:
                level = np.maximum(signal, LEAST_SIGNAL)
                # of bands that are others than the first photo's all count as well exposed
                bright = white if len(own) == bands else np.ones(len(own))
                each = float(np.mean(np.diag(own) * bright / level[:len(own)]))
                for block, photo in zip(blocks, photos, strict=True):
                    total[index, block, block] += np.diag(
                        each * level[block] / np.maximum(photo.white, DARK))
            elif cause not in (SENSITIVITIES, LIGHT_SPECTRUM, FILTER):
                total[index] += _of_cause(cause, own, signal, known, blocks, photos)
    if surfaces is not None:
        total += _of_response(surfaces, signals, spectra, response, known, photos)
    seen = np.concatenate([np.ones(known, bool), *(photo.white >= DARK_BAND for photo in photos)])
    return response[seen], np.array([symmetric(one) for one in total[:, seen][:, :, seen]])


def _of_cause(cause: str, own: np.ndarray, signal: np.ndarray, known: int,
              blocks: Sequence[slice], photos: Sequence[FurtherPhoto]) -> np.ndarray:
    """What one cause adds to the covariance (J, J), being ``own`` (K, K) in the first photo."""
    bands = len(own)
    scale = np.ones_like(signal) if CAUSES[cause].kind == "added" else signal
    relative = own / np.outer(scale[:bands], scale[:bands])
    under_one, under_two = (share * relative for share in SHARED_BY_PHOTOS.get(cause, (0.0, 0.0)))
    if cause == DISAGREEMENT:       # what the bands of a patch have in common, photos have
        under_one = np.full_like(relative, relative[~np.eye(bands, dtype=bool)].mean())
    total = np.zeros((signal.size,) * 2)
    first = slice(0, bands)
    for number, (block, photo) in enumerate(zip(blocks, photos, strict=True)):
        total[block, block] = relative * np.outer(scale[block], scale[block])
        others = [(first, True), *((blocks[other], photos[other].same_lamp)
                                   for other in range(number))]
        for other, same_lamp in others:
            shared = under_one if photo.same_lamp and same_lamp else under_two
            both = shared * np.outer(scale[other], scale[block])
            total[other, block], total[block, other] = both, both.T
    return total


def _of_response(surfaces: Sequence[Surface], signals: np.ndarray, spectra: np.ndarray,
                 response: np.ndarray, known: int, photos: Sequence[FurtherPhoto]) -> np.ndarray:
    """What errors of curves, light and filters add to the covariances (n, J, J); of the first photo
    what they then add less than now.
    """
    bands = len(photos[0].white)
    seen = np.r_[0:bands, known:signals.shape[1]]
    now = surfaces[0].calibration
    calibrations = [now, *(_calibration_of(now, photo) for photo in photos)]
    calibrations = _with_charts(surfaces[0], calibrations, photos)
    views = np.repeat(np.arange(len(photos) + 1), bands)
    joint = SurfaceSignals(
        tuple(f"{number}" for number in range(len(signals))), (False,) * len(signals), FINE_GRID,
        spectra, tuple(f"{number}" for number in seen), views, response[seen], signals[:, seen], ())
    total = np.zeros((*signals.shape, signals.shape[1]))
    total[:, seen[:, None], seen] = (
        sensitivity_covariance(calibrations, joint) + light_covariance(calibrations, joint)
        + filter_covariance(calibrations, joint))
    own = slice(0, bands)
    for index, surface in enumerate(surfaces):
        for error in surface.signals.errors:
            if error.cause in (SENSITIVITIES, LIGHT_SPECTRUM):
                total[index, own, own] -= error.covariance[surface.index][own, own]
    return total


def _with_charts(surface: Surface, calibrations: list[Calibration],
                 photos: Sequence[FurtherPhoto]) -> list[Calibration]:
    """The calibrations once the charts of photos under the first lamp are fitted too: curves and
    filters are conditioned on their patches, relative to a white of free level in every band.
    """
    fit = surface.calibration.sensitivity
    filtered = [number for number, photo in enumerate(photos, start=1) if photo.filter is not None]
    if fit.covariance is None or not filtered:
        return calibrations
    patterns = error_patterns(fit.covariance).T
    curves = patterns.shape[1]
    starts = curves + np.cumsum([0, *(len(each.filter.covariance) for each in calibrations
                                      if each.filter is not None)])
    rows, noise = [], []
    for number, start, stop in zip(filtered, starts[:-1], starts[1:], strict=True):
        for band in np.flatnonzero(photos[number - 1].white >= DARK_BAND):
            patches, by_curve, by_filter = _patches_in_band(surface.chart, calibrations[number],
                                                            int(band))
            row = np.zeros((len(patches), starts[-1]))
            row[:, :curves] = by_curve @ patterns
            row[:, start:stop] = by_filter
            rows.append(row)
            noise.append(surface.patch_error * np.maximum(patches, DARK_PATCH))
    seen = np.vstack(rows)
    spread = seen @ seen.T + np.diag(np.concatenate(noise) ** 2)
    left = symmetric(np.eye(starts[-1]) - seen.T @ np.linalg.solve(spread, seen))
    sharper = dataclasses.replace(fit, covariance=symmetric(
        patterns @ left[:curves, :curves] @ patterns.T))
    known = [dataclasses.replace(each, sensitivity=sharper) for each in calibrations]
    for number, start, stop in zip(filtered, starts[:-1], starts[1:], strict=True):
        fitted = known[number].filter
        assert fitted is not None
        known[number] = dataclasses.replace(known[number], filter=FittedFilter(
            fitted.filter, left[start:stop, start:stop],
            left[start:stop, :curves] @ patterns.T))
    return known


def _patches_in_band(chart: np.ndarray, calibration: Calibration, band: int
                     ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Signals (I,) of patches relative to white in one band, and their derivatives by the
    coefficients of all curves (I, D) and by the errors of the filter (I, E).
    """
    fit, fitted = calibration.sensitivity, calibration.filter
    assert fit.basis is not None and fitted is not None
    nodes = fit.basis.shape[1]
    weight = spectrum_on_grid(calibration.light, FINE_GRID) * FINE_GRID.weights_nm
    white = float(weight @ fit.curves[band])
    patches = chart @ (weight * fit.curves[band]) / white
    change = (chart - patches[:, None]) * weight / white
    by_curve = np.zeros((len(patches), len(fit.curves) * nodes))
    by_curve[:, band * nodes:(band + 1) * nodes] = change @ fit.basis
    return patches, by_curve, (change * fit.curves[band]) @ fitted.filter.modes


def _calibration_of(calibration: Calibration, photo: FurtherPhoto) -> Calibration:
    """The calibration that a further photo would have, by the curves of the first one's."""
    present = spectrum_on_grid(calibration.light, FINE_GRID)
    _, light = curves_and_light(calibration)
    own = Spectrum(FINE_GRID, present * photo.light / light, Quantity.RELATIVE, photo.name)
    if photo.filter is None:
        return dataclasses.replace(calibration, light=own)
    modes = photo.filter.modes.shape[1]
    coefficients = calibration.sensitivity.coefficients
    with_curves = np.zeros((modes, 0 if coefficients is None else coefficients.size))
    return dataclasses.replace(calibration, light=own,
                               filter=FittedFilter(photo.filter, np.eye(modes), with_curves))


def _likely(prior: LogitMixture, measured: SpectralMeasurement, spectra: np.ndarray) -> np.ndarray:
    """Some draws (n, 61), as far from their mean as the prior itself says: those that a band is
    read from are wider, for the surfaces that it errs about.
    """
    chosen = spectra[np.linspace(0, len(spectra) - 1, min(SPECTRA, len(spectra))).astype(int)]
    mixture = posterior(prior, measured.relative_response @ TO_FINE, measured.signal[None],
                        measured.noise_covariance)
    mean, spread = (each[0] for each in mean_and_spread(mixture))
    shrink = np.minimum(spread / np.maximum(spectra.std(axis=0), 1e-6), 1.0)
    return np.asarray(np.clip(mean + (chosen - spectra.mean(axis=0)) * shrink, 0, 1))


def simulated_errors(prior: LogitMixture, response: np.ndarray, covariance: np.ndarray,
                     spectra: np.ndarray) -> tuple[float, float]:
    """Mean RMSE of the estimates from simulated signals of spectra, and mean width of their bands.

    Parameters
    ----------
    prior : LogitMixture
    response : (J, 301) array
        Of the bands to reflectances; rows sum to 1.
    covariance : (J, J) or (T, J, J) array
        Of the signals.
    spectra : (T, 61) array
    """
    coarse = response @ TO_FINE
    values, vectors = np.linalg.eigh(covariance)
    # of all roots the symmetric one: like covariances give like errors, whatever their eigenvectors
    root = (vectors * np.sqrt(np.maximum(values, 0))[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    normal = np.random.default_rng(1).standard_normal((len(spectra), len(coarse)))
    off = (root @ normal[..., None])[..., 0]
    mean, ends = calibrated_bands(prior, posterior(prior, coarse, spectra @ coarse.T + off,
                                                   covariance), (LEVEL,))
    lower, upper = ends[0]
    return (float(np.sqrt(np.mean((mean - spectra) ** 2, axis=1)).mean()),
            float(np.mean(upper - lower)))
