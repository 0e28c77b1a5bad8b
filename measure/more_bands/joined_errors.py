"""Errors of what was measured of a surface together with those of further photos of it.

Photos share errors as `measure.flat` has them; under the same lamp the second chart sharpens the
camera's curves: they are conditioned on the signals of its patches, whose levels are free. Where
the light of a session is unknown, the camera's own curves are the products over the light's
posterior mean.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.measure.more_bands import filter_fit
from spectrabox.measure.regions.flat_signals import DARK_BAND, SHARED_BY_PHOTOS
from spectrabox.measure.surfaces.surface_signals import errors_by_cause, measurement
from spectrabox.radiometry import error_model, grid
from spectrabox.radiometry.covariance import common_variance, error_patterns, symmetric
from spectrabox.radiometry.records import spectra
from spectrabox.radiometry.records.calibration import Calibration
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid

DARK_PATCH = 0.03       # of white: darker patches err as this
LEAST_SIGNAL = 0.02     # of white: below it noise is that of reading out
NOISES = (error_model.PHOTO_NOISE, error_model.RENDERING_NOISE)
OF_RESPONSE = (error_model.SENSITIVITIES, error_model.LIGHT_SPECTRUM, error_model.FILTER)


@dataclass(frozen=True, eq=False)
class ChartFitted:
    """What errors of further photos come from, where a chart was fitted."""

    calibration: Calibration        # of the first photo
    chart: np.ndarray               # (I, 301) reflectances of the patches
    patch_error: float              # relative, of a patch in one band against the model


def joined_errors(surface: spectra.SurfaceSignals, spectrum: np.ndarray,
                  photos: Sequence[filter_fit.FurtherPhoto], white: np.ndarray,
                  fitted: ChartFitted | None
                  ) -> tuple[np.ndarray, np.ndarray, error_model.Errors]:
    """Response (J, 301), expected signal (J,) and its errors, of what was measured of a surface in
    one photo and of further photos of it, without bands that are dark.

    Parameters
    ----------
    surface : SurfaceSignals
        Of it alone, without what states of the capture add.
    spectrum : (301,) array
        The reflectance about which the errors hold.
    photos : sequence of FurtherPhoto
    white : (K,) array
        Signal of white in the first photo, that of the brightest band being 1.
    fitted : ChartFitted or None
        None: photos err by noise alone.
    """
    measured = measurement(surface, 0)
    before, now = measured.noise_covariance, measured.signal
    known, bands = now.size, len(white)
    response = np.vstack([measured.relative_response, *(photo.response for photo in photos)])
    # an error of the light makes all photos as bright as the first one: what shares a factor has to
    # be in proportion to signals that share it
    expected = response @ spectrum
    brighter = np.sum(now * expected[:known]) / np.sum(expected[:known]**2)
    signal = np.r_[now, brighter * expected[known:]]
    blocks = [slice(known + number * bands, known + (number + 1) * bands)
              for number in range(len(photos))]
    total, multiplies = np.zeros((2, len(response), len(response)))
    total[:known, :known] = before
    causes = {error_model.PHOTO_NOISE: before} if fitted is None else errors_by_cause(surface, 0)
    for cause, covariance in causes.items():
        own = covariance[:bands, :bands]
        if cause in NOISES:
            total += _of_noise(own, white, signal, blocks, photos)
        elif cause not in OF_RESPONSE:
            added = _of_cause(cause, own, signal, blocks, photos)
            total += added
            if error_model.CAUSES[cause].kind == "proportional":
                multiplies += added
                multiplies[:known, :known] += covariance
    if fitted is not None:
        total += _of_response(fitted, surface, signal, spectrum, response, photos)
    elif measured.relative_covariance is not None:
        multiplies[:known, :known] = error_model.proportional_covariance(
            now, measured.relative_covariance)
    seen = np.concatenate([np.ones(known, bool), *(photo.white >= DARK_BAND for photo in photos)])
    signal, within = signal[seen], np.ix_(seen, seen)
    inverse = np.divide(1.0, signal, out=np.zeros_like(signal), where=signal != 0)
    return response[seen], signal, error_model.Errors.of_total(
        symmetric(total[within]), signal,
        error_model.proportional_covariance(inverse, multiplies[within]))


def _of_noise(own: np.ndarray, white: np.ndarray, signal: np.ndarray, blocks: Sequence[slice],
              photos: Sequence[filter_fit.FurtherPhoto]) -> np.ndarray:
    """What noise adds to the covariance (J, J), being ``own`` (K, K) in the first photo."""
    level = np.maximum(signal, LEAST_SIGNAL)
    bright = white
    if len(own) != len(white):      # bands that are others than the first photo's: well exposed
        bright = np.ones(len(own))
    each = float(np.mean(np.diag(own) * bright / level[:len(own)]))
    variance = np.zeros(signal.size)
    for block, photo in zip(blocks, photos, strict=True):
        variance[block] = each * level[block] / np.maximum(photo.white, filter_fit.DARK)
    return np.diag(variance)


def _of_cause(cause: str, own: np.ndarray, signal: np.ndarray, blocks: Sequence[slice],
              photos: Sequence[filter_fit.FurtherPhoto]) -> np.ndarray:
    """What one cause adds to the covariance (J, J), being ``own`` (K, K) in the first photo."""
    bands = len(own)
    scale = np.ones_like(signal) if error_model.CAUSES[cause].kind == "added" else signal
    relative = own / np.outer(scale[:bands], scale[:bands])
    under_one, under_two = (share * relative for share in SHARED_BY_PHOTOS.get(cause, (0.0, 0.0)))
    if cause == error_model.DISAGREEMENT:  # what the bands of a patch have in common, photos have
        common = min(float(relative[~np.eye(bands, dtype=bool)].mean()),
                     common_variance(relative, np.ones(bands)))
        under_one = np.full_like(relative, max(common, 0.0))
    total = np.zeros((signal.size,) * 2)
    earlier = [(slice(0, bands), True)]     # blocks, and whether under the first photo's lamp
    for block, photo in zip(blocks, photos, strict=True):
        total[block, block] = relative * np.outer(scale[block], scale[block])
        for other, same_lamp in earlier:
            shared = under_one if photo.same_lamp and same_lamp else under_two
            both = shared * np.outer(scale[other], scale[block])
            total[other, block], total[block, other] = both, both.T
        earlier.append((block, photo.same_lamp))
    return total


def _of_response(fitted: ChartFitted, surface: spectra.SurfaceSignals, signal: np.ndarray,
                 spectrum: np.ndarray, response: np.ndarray,
                 photos: Sequence[filter_fit.FurtherPhoto]) -> np.ndarray:
    """What errors of curves, light and filters add to the covariance (J, J); of the first photo
    what they then add less than now.
    """
    bands = len(photos[0].white)
    seen = np.r_[0:bands, signal.size - len(photos) * bands:signal.size]
    now = fitted.calibration
    calibrations = _with_charts(fitted, [
        now, *(_calibration_of(now, photo) for photo in photos)], photos)
    views = np.repeat(np.arange(len(photos) + 1), bands)
    joint = spectra.SurfaceSignals(("",), (False,), grid.FINE_GRID, spectrum[None],
                                   tuple(f"{number}" for number in seen), views, response[seen],
                                   signal[None, seen], {})
    total = np.zeros((signal.size, signal.size))
    total[np.ix_(seen, seen)] = (error_model.sensitivity_covariance(calibrations, joint)
                                 + error_model.light_covariance(calibrations, joint)
                                 + error_model.filter_covariance(calibrations, joint))[0]
    for cause in (error_model.SENSITIVITIES, error_model.LIGHT_SPECTRUM):
        if cause in surface.errors:
            total[:bands, :bands] -= surface.errors[cause][0][:bands, :bands]
    return total


def _with_charts(fitted: ChartFitted, calibrations: list[Calibration],
                 photos: Sequence[filter_fit.FurtherPhoto]) -> list[Calibration]:
    """The calibrations once the charts of photos under the first lamp are fitted too: curves and
    filters are conditioned on their patches, relative to a white of free level in every band.
    """
    fit = fitted.calibration.sensitivity
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
            patches, by_curve, by_filter = _patches_in_band(fitted.chart, calibrations[number],
                                                            int(band))
            row = np.zeros((len(patches), starts[-1]))
            row[:, :curves] = by_curve @ patterns
            row[:, start:stop] = by_filter
            rows.append(row)
            noise.append(fitted.patch_error * np.maximum(patches, DARK_PATCH))
    seen = np.vstack(rows)
    spread = seen @ seen.T + np.diag(np.concatenate(noise) ** 2)
    left = symmetric(np.eye(starts[-1]) - seen.T @ np.linalg.solve(spread, seen))
    sharper = dataclasses.replace(fit, covariance=symmetric(
        patterns @ left[:curves, :curves] @ patterns.T))
    known = [dataclasses.replace(each, sensitivity=sharper) for each in calibrations]
    for number, start, stop in zip(filtered, starts[:-1], starts[1:], strict=True):
        own = known[number].filter
        assert own is not None
        known[number] = dataclasses.replace(known[number], filter=dataclasses.replace(
            own, covariance=left[start:stop, start:stop],
            with_curves=left[start:stop, :curves] @ patterns.T))
    return known


def _patches_in_band(chart: np.ndarray, calibration: Calibration, band: int
                     ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Signals (I,) of patches relative to white in one band, and their derivatives by the
    coefficients of all curves (I, D) and by the errors of the filter (I, E).
    """
    fit, filter = calibration.sensitivity, calibration.filter
    assert fit.basis is not None and filter is not None
    nodes = fit.basis.shape[1]
    weight = spectrum_on_grid(calibration.light, grid.FINE_GRID) * grid.FINE_GRID.weights_nm
    white = float(weight @ fit.curves[band])
    patches = chart @ (weight * fit.curves[band]) / white
    change = (chart - patches[:, None]) * weight / white
    by_curve = np.zeros((len(patches), len(fit.curves) * nodes))
    by_curve[:, band * nodes:(band + 1) * nodes] = change @ fit.basis
    return patches, by_curve, (change * fit.curves[band]) @ filter.modes


def _calibration_of(calibration: Calibration, photo: filter_fit.FurtherPhoto) -> Calibration:
    """The calibration that a further photo would have, by the curves of the first one's."""
    power = photo.light
    if calibration.light_posterior is not None:     # of products: its curves hold the light's mean
        _, light = filter_fit.curves_and_light(calibration)
        power = power * spectrum_on_grid(calibration.light, grid.FINE_GRID) / light
    # a stated light may be dark at some wavelengths: nothing is divided by it
    own = spectra.Spectrum(grid.FINE_GRID, power, spectra.Quantity.RELATIVE, photo.name)
    return dataclasses.replace(calibration, light=own, filter=photo.filter)
