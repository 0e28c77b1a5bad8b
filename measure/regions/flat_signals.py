"""Flat samples: photos of regions beside a chart, to signals relative to white with every error."""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from spectrabox.calibrate.chart_equations import PatchError
from spectrabox.measure.regions.moved_lamp import gloss_and_level
from spectrabox.measure.regions.white import FlatErrors, FlatPhoto, PhotoWhite
from spectrabox.radiometry import error_model, gloss, grid
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.records.spectra import SurfaceSignals
from spectrabox.sampling.prior import mixture_posterior
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior, of_families

# of the brightest band of a photo: below it the black level and stray light are most of a signal
DARK_BAND = 0.01
SAME = 1e-9             # relative: responses closer than this are one
EXPECTED = 0.01         # of white: error of the signals whose spectra the errors are evaluated at
# of white, beyond which a veil is haze; and how far it then differs over a photo: on a real one by
# 0.3 of itself over a chart
USUAL_VEIL, UNEVEN_VEIL = 0.03, 0.3
# Share of an error's variance that photos repeat: under one lamp that stayed in its position,
# whatever the filter; and under another lamp. All tell the light at a region by the same patches,
# whose errors grow with the distance from the chart (benchmarks/bench_light_field.py); what a
# surface mirrors is half its own, half the lamp's position.
SHARED_BY_PHOTOS = {
    error_model.SAMPLE_PLANE: (1.0, 0.0), error_model.SURFACE_REFLECTION: (1.0, gloss.SAME_SURFACE),
    error_model.LIGHT_FIELD: (0.95, 0.6)
}


def flat_signals(photos: Sequence[FlatPhoto], whites: Sequence[PhotoWhite | None],
                 families: Mapping[str, Sequence[str]], known: Mapping[str, np.ndarray],
                 bands: Sequence[str], errors: FlatErrors) -> SurfaceSignals:
    """Signals of all regions in the bands of all photos; photos of one response are averaged but
    for those whose lamp was moved, and bands that are dark or saturated on a region are not a
    number there.

    Photos of one chart err alike in part, those under one lamp, through filters, nearly as one.

    Parameters
    ----------
    photos : sequence of FlatPhoto
    whites : sequence of PhotoWhite or None
        At the regions of each photo, from ``white.white_at_regions``.
    families : mapping
        From the name of each region, in the order of the result, to the families of surfaces that
        it is said to be of; none for any.
    known : mapping
        From names of regions to their known reflectances (P,) on the grid.
    bands : sequence of K str
        Names of the camera's bands.
    errors : FlatErrors

    Raises
    ------
    CheckError
        If no band of any photo shows a region that is not known.
    """
    responses = [photo.response for photo in photos]
    of_photo = first_alike(photos)
    distinct = sorted(set(of_photo))
    names = tuple(families)
    count = len(bands)
    labels = tuple(f"{photos[number].name}: {band}" if len(photos) > 1 else band
                   for number in distinct for band in bands)
    signal = np.full((len(names), len(labels)), np.nan)
    lamp_of_band = np.repeat([lamp_of(photos, number) for number in distinct], count).tolist()
    silent = np.zeros(signal.shape, bool)
    causes: dict[str, np.ndarray] = {}
    for index, name in enumerate(names):
        lamps = np.full(len(labels), "", dtype=object)
        for block, number in enumerate(distinct):
            shown = [(photo, white) for photo, white, other
                     in zip(photos, whites, of_photo, strict=True)
                     if other == number and white is not None and name in white.samples.names]
            if not shown:
                continue
            own = slice(block * count, (block + 1) * count)
            signal[index, own] = np.mean([white.signal[white.samples.names.index(name)]
                                          for _, white in shown], axis=0)
            for cause, covariance in errors_of_region(name, shown, errors).items():
                whole = causes.setdefault(cause, np.zeros((len(names), *(2 * [len(labels)]))))
                whole[index, own, own] = covariance
            lamps[own] = lamp_of(photos, number)
            silent[index, own] = np.any([_silent_bands(white, name) for _, white in shown], axis=0)
        for cause, covariance in causes.items():
            covariance[index] += common_to_photos(cause, covariance[index], signal[index], lamps,
                                                  errors.disagreement)
    signal[silent] = np.nan
    for name, seen in zip(names, np.isfinite(signal).any(axis=1), strict=True):
        if not seen and name not in known:
            raise CheckError(f"no band of any photo tells anything of region {name!r}: it is "
                             "saturated there, or too dark by the light that the chart shows; "
                             "take a photo at another exposure, or leave the region out")
    response = np.vstack([responses[number] for number in distinct])
    spectra = np.array([known[name] if name in known
                        else _expected_spectrum(families[name], response, signal[index])
                        for index, name in enumerate(names)])
    moved = any(photos[number].moved for number in distinct)
    states = tuple(gloss_and_level(errors.surfaces.get(name), signal[index], lamp_of_band,
                                   causes[error_model.SAMPLE_PLANE][index]) if moved
                   else gloss.gloss_states(errors.surfaces.get(name), lamp_of_band)
                   for index, name in enumerate(names))
    if moved:
        del causes[error_model.SAMPLE_PLANE]        # it is the level of the states
    signals = SurfaceSignals(names, tuple(name in known for name in names), grid.FINE_GRID, spectra,
                             labels, np.repeat(distinct, count), response, signal, {}, states)
    filled = dataclasses.replace(signals, signal=np.nan_to_num(signal))
    calibrations = [photo.calibration for photo in photos]
    causes[error_model.SENSITIVITIES] = error_model.sensitivity_covariance(calibrations, filled)
    causes[error_model.LIGHT_SPECTRUM] = error_model.light_covariance(calibrations, filled)
    if any(calibration.filter is not None for calibration in calibrations):
        causes[error_model.FILTER] = error_model.filter_covariance(calibrations, filled)
    return dataclasses.replace(signals, errors=causes)


def errors_of_region(name: str, shown: Sequence[tuple[FlatPhoto, PhotoWhite]],
                     errors: FlatErrors) -> dict[str, np.ndarray]:
    """Covariance (K, K) by cause of a region's mean signal over photos of one response.

    Noise is averaged; the other errors are taken as common to the photos.

    Parameters
    ----------
    name : str
        Of the region.
    shown : sequence of (FlatPhoto, PhotoWhite)
        The photos that show it.
    errors : FlatErrors
    """
    rows = [white.samples.names.index(name) for _, white in shown]
    noise = np.sum([white.noise(row) for row, (_, white) in zip(rows, shown, strict=True)],
                   axis=0) / len(shown) ** 2
    parts: list[dict[str, np.ndarray]] = []
    for row, (photo, white) in zip(rows, shown, strict=True):
        signal = white.signal[row]
        parts.append({**white.errors(row),
                      error_model.GLARE: stray_light(photo, white, row, errors)
                      / np.outer(white.white[row], white.white[row]),
                      error_model.DISAGREEMENT: error_model.proportional_covariance(
                          signal, errors.disagreement.among_bands(signal.size))})
    causes = dict.fromkeys(cause for part in parts for cause in part)
    zero = np.zeros_like(noise)
    return {error_model.PHOTO_NOISE: noise, **{
        cause: np.mean([part.get(cause, zero) for part in parts], axis=0) for cause in causes}}


def stray_light(photo: FlatPhoto, white: PhotoWhite, row: int, errors: FlatErrors) -> np.ndarray:
    """Covariance (K, K) of a photo's signal by stray light that the chart does not tell of: one
    veil over the whole photo, what of haze differs over it, and what the chart's own patches
    mirror, which lies on the chart alone.

    Parameters
    ----------
    photo : FlatPhoto
    white : PhotoWhite
        At its regions.
    row : int
        Of the region.
    errors : FlatErrors
    """
    veil = error_model.glare_signal(errors.glare, photo.image.signal.mean(axis=(0, 1)))
    haze = UNEVEN_VEIL * np.maximum(white.glare - USUAL_VEIL * white.white[row], 0)
    return error_model.added_covariance(veil) + error_model.added_covariance(haze) \
        + error_model.added_covariance(errors.chart_gloss * white.white[row])


def _silent_bands(white: PhotoWhite, name: str) -> np.ndarray:
    """Bands (K,) that say nothing of a region: too dark beside the brightest, or saturated."""
    row = white.samples.names.index(name)
    return np.asarray(dark_bands(white.white[row]) | white.clipped(row))


def dark_bands(white: np.ndarray) -> np.ndarray:
    """Bands (K,) of a photo in which white (K,) is too dark beside the brightest to say anything.
    """
    return np.asarray(white < DARK_BAND * white.max())


def lamp_of(photos: Sequence[FlatPhoto], number: int) -> str:
    """The lamp of a photo, the same for all under one that stayed in its position."""
    return photos[number].lamp or f"of {number}"


def common_to_photos(cause: str, covariance: np.ndarray, signal: np.ndarray, lamps: np.ndarray,
                     disagreement: PatchError) -> np.ndarray:
    """What one cause adds to a surface's covariance (J, J) between photos.

    Parameters
    ----------
    cause : str
        Of radiometry.error_model.
    covariance : (J, J) array
        Of the signal by this cause, within each photo.
    signal : (J,) array
        Relative to white.
    lamps : (J,) array of str
        Of each band, from ``lamp_of``; empty for a band that shows nothing.
    disagreement : PatchError
    """
    one_lamp = lamps[:, None] == lamps
    if cause == error_model.DISAGREEMENT:
        common = disagreement.common * signal
        share = one_lamp.astype(float)
    else:
        common = np.sqrt(np.diag(covariance))
        share = np.where(one_lamp, *SHARED_BY_PHOTOS.get(cause, (0.0, 0.0)))
    between = (covariance == 0) & (lamps != "") & (lamps != "")[:, None]
    return np.asarray(np.where(between, share * np.outer(common, common), 0.0))


def _expected_spectrum(families: Sequence[str], response: np.ndarray,
                       signal: np.ndarray) -> np.ndarray:
    """The spectrum (P,) that the learnt prior expects behind a signal (J,)."""
    seen = np.isfinite(signal)
    coarse = response[seen] @ grid.interpolation_matrix(PRIOR_GRID.nm, grid.FINE_GRID.nm)
    mixture = mixture_posterior.posterior(of_families(load_prior(), families), coarse,
                                          signal[None, seen], EXPECTED**2 * np.eye(int(seen.sum())))
    return np.interp(grid.FINE_GRID.nm, PRIOR_GRID.nm,
                     mixture_posterior.mean_and_spread(mixture)[0][0])


def first_alike(photos: Sequence[FlatPhoto]) -> list[int]:
    """Of each photo the first that has the same response, and its lamp where it was moved."""
    alike = first_of_response([photo.response for photo in photos])
    return [next(other for other in range(number + 1) if alike[other] == alike[number]
                 and (photos[other].lamp == photo.lamp
                      or not (photo.moved or photos[other].moved)))
            for number, photo in enumerate(photos)]


def first_of_response(responses: Sequence[np.ndarray]) -> list[int]:
    """Of each photo the first that has the same response (K, P)."""
    return [next(other for other in range(number + 1)
                 if _same(responses[other], responses[number]))
            for number in range(len(responses))]


def _same(response: np.ndarray, other: np.ndarray) -> bool:
    """Whether two responses (K, P) are the same within round-off."""
    return response.shape == other.shape and bool(
        np.abs(response - other).max() <= SAME * np.abs(other).max())
