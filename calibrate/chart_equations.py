"""One chart photo as equations: the signal of each patch, and its derivatives by what is unknown.

    signal(i, k) = exp(exposure + field(i)) irradiance(i) / pi
                   x integral reflectance(i) light filter sensitivity(k) + glare(k)

``field`` is a quadratic polynomial of the patch's position on the chart, ``glare`` an offset of
each band (stray light, black level). Where the geometry is known the irradiance is given (Eq. 17)
and the field may be switched off. A photo through a filter has further unknowns: relative errors of
its transmittance. Its level cannot be told from the exposure.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np

from spectrabox.calibrate.copy_errors import copy_errors
from spectrabox.radiometry.charts.references import ChartCopies
from spectrabox.radiometry.covariance import block_diagonal
from spectrabox.radiometry.records import calibration, spectra
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.shaped import Record

FIELD_SD = 0.15              # of each quadratic term of the log irradiance; a term spans the chart
GLARE_SD = 0.01              # of the brightest patch of the band
HAZE_SD = 0.1                # the same under haze or light on the lens
DARK_SHARE = 0.03            # of the brightest patch: below it an error is no longer relative
# The same of each band's own error: spectra of one chart depart from the published ones by 0.007 of
# reflectance in dark and in light paints.
OWN_DARK_SHARE = 0.2
DARK_BAND = 0.003            # of the brightest band: the same of bands that a filter leaves dark
# rms difference of two bands' signals of patches, each of mean 1, at which they see nearly the same
# wavelengths. The evidence of 16 real bands is for .08 to .3 over none, largest at .15; at .1 what
# they say of other samples is as near as with none.
SAME_WAVELENGTHS = 0.1
COLOURS, MIN_PATCHES = 3, 8  # bands of a colour camera; patches that tell how alike bands are
# of the brightest patch of the band: standard error of a clipped signal. It leaves no weight (1e-8
# of that of a signal that can be read), and inverses keep their digits.
CLIPPED_SD = 100.0
# relative errors that the bands of a patch may have in common: light that is no smooth field, and
# patches that are lighter than their reference
COMMON_ERRORS = (0.0, 0.004, 0.01, 0.025)


class PatchError(NamedTuple):
    """Disagreement of patches and model as relative standard deviations: independent in each band
    of a patch, and common to all its bands.
    """

    own: float
    common: float = 0.0

    @property
    def whole(self) -> float:
        """Of one band, both parts together."""
        return float(np.hypot(*self))

    def among_bands(self, bands: int) -> np.ndarray:
        """Relative covariance (K, K) of one patch."""
        return self.own**2 * np.eye(bands) + self.common**2


# Share of the variance of a patch's errors that a photo through a filter repeats of one without:
# chart and light are the same. The wavelengths are not, so that of a band's own error it is half,
# and products err as they state; but what is lighter than its reference is so through any filter.
REPEATED = PatchError(own=0.5, common=0.95)


def mean_error(weights: np.ndarray, errors: Sequence[PatchError]) -> PatchError:
    """Means of both parts.

    Parameters
    ----------
    weights : (n,) array
        Of any sum.
    errors : sequence of n PatchError
    """
    return PatchError(*(float(part) for part in weights @ np.array(errors) / weights.sum()))


@dataclass(frozen=True, eq=False)
class ChartEquations(Record):
    """Patches of one photo under one light. I patches of any chart; K bands."""

    signal: Annotated[np.ndarray, "I K"]
    covariance: Annotated[np.ndarray, "I K K"]      # of the mean signal, from the pixels
    reflectances: Annotated[np.ndarray, "I P"]
    # light x transmittance of the filter x integration weight, working grid
    power: Annotated[np.ndarray, "P"]
    irradiance: Annotated[np.ndarray, "I"]
    field_terms: Annotated[np.ndarray, "I E"]       # at each patch; E = 0: no field
    glare: bool
    relative_exposure_sd: float | None = None       # of the log, to the first photo; None: unknown
    rows: int | None = None                         # of the chart; None: patches are no whole grid
    glare_sd: float = GLARE_SD                      # beforehand, of the brightest patch of the band
    # log of the true light over ``power``: sum of independent unit normals times these; None: exact
    light_terms: Annotated[np.ndarray, "P J"] | None = None
    filter: calibration.Filter | None = None        # before lens or lamp
    # of each patch on the chart, the same in photos whose patches err alike; None: in no other
    number: Annotated[np.ndarray, "I"] | None = None
    # bool: signals that say nothing, being clipped; None: none is
    clipped: Annotated[np.ndarray, "I K"] | None = None
    # by the terms of the chart's copy, each a unit normal and the same in all photos; None: the
    # reflectances are the chart's own
    copy_errors: Annotated[np.ndarray, "I K R"] | None = None
    # of the errors of a patch that each band has for itself; None: independent
    band_correlation: Annotated[np.ndarray, "K K"] | None = None

    @property
    def readable(self) -> np.ndarray:
        """Whether each signal (I, K) can be read."""
        return np.ones(self.signal.shape, bool) if self.clipped is None else ~self.clipped

    @property
    def filter_errors(self) -> int:
        """Number E of unknown errors of the filter."""
        return 0 if self.filter is None else int(self.filter.modes.shape[1])

    @property
    def light_power(self) -> np.ndarray:
        """Light x integration weight (P,), before the filter."""
        return self.power if self.filter is None else self.power / self.filter.transmittance

    def modes(self, basis: np.ndarray) -> np.ndarray:
        """Relative errors (N, E) of the filter's transmittance at the nodes of a basis (P, N);
        E = 0 without one.
        """
        if self.filter is None:
            return np.zeros((basis.shape[1], 0))
        return np.asarray((basis / basis.sum(axis=0)).T @ self.filter.modes)


def chart_equations(samples: PatchSamples, reflectances: np.ndarray, light: np.ndarray,
                    irradiance: np.ndarray, grid: spectra.WavelengthGrid, *,
                    positions: np.ndarray | None = None, rows: int | None = None,
                    light_terms: np.ndarray | None = None,
                    filter: calibration.Filter | None = None,
                    copies: ChartCopies | None = None) -> ChartEquations:
    """One photo in the form that every fit takes, with an unknown offset in each band.

    Parameters
    ----------
    samples : PatchSamples
        Mean signal (I, K) and its covariance; clipped bands get no weight.
    reflectances : (I, P) array
    light : (P,) array
        Spectrum of the light on ``grid``.
    irradiance : (I,) array
        On each patch for a light spectrum of 1; pi everywhere where it is not known.
    grid : WavelengthGrid
    positions : (I, 2) array or None
        Of the patches on the chart; None where the illumination of the patches is known.
    rows : int or None
        Of the chart, whose patches are listed row by row; None where some are left out.
    light_terms : (P, J) array or None
        How the light may differ from what is stated, see ``light_error``; None: it does not.
    filter : Filter or None
        That the photo was taken through.
    copies : ChartCopies or None
        Of which the chart is one; None: the reflectances are its own.
    """
    terms = np.zeros((len(samples.mean), 0)) if positions is None else field_terms(positions)
    passed = light if filter is None else light * filter.transmittance
    return ChartEquations(samples.mean, samples.covariance_of_mean, reflectances,
                          passed * grid.weights_nm, irradiance, terms, glare=True, rows=rows,
                          light_terms=light_terms, filter=filter,
                          number=np.arange(len(samples.mean)),
                          clipped=samples.clipped if samples.clipped.any() else None,
                          copy_errors=None if copies is None else copy_errors(
                              samples.mean, samples.clipped, copies, passed * grid.weights_nm,
                              grid),
                          band_correlation=_band_correlation(samples))


def _band_correlation(samples: PatchSamples) -> np.ndarray | None:
    """Correlation (K, K) of the errors that each band of a patch has for itself; None of a colour
    camera's three bands, where they are independent.

    A patch whose paint is not its reference's is so over tens of nm. Bands that see the same
    wavelengths have that error in common, and the same signals.
    """
    if samples.mean.shape[1] <= COLOURS:
        return None
    readable = ~samples.clipped.any(axis=1)
    shown = samples.mean[readable if np.count_nonzero(readable) >= MIN_PATCHES else slice(None)]
    balanced = shown / shown.mean(axis=0)
    square = np.mean((balanced[:, :, None] - balanced[:, None, :]) ** 2, axis=0)
    return np.asarray(np.exp(-square / (2 * SAME_WAVELENGTHS**2)))


def some_patches(photo: ChartEquations, chosen: np.ndarray) -> ChartEquations:
    """The equations of some patches alone.

    Parameters
    ----------
    photo : ChartEquations
        Of I patches.
    chosen : (I,) bool array
    """
    return replace(photo, signal=photo.signal[chosen], covariance=photo.covariance[chosen],
                   reflectances=photo.reflectances[chosen], irradiance=photo.irradiance[chosen],
                   field_terms=photo.field_terms[chosen], rows=None,
                   number=None if photo.number is None else photo.number[chosen],
                   clipped=None if photo.clipped is None else photo.clipped[chosen],
                   copy_errors=None if photo.copy_errors is None else photo.copy_errors[chosen])


def field_terms(positions: np.ndarray) -> np.ndarray:
    """Linear and quadratic terms (I, 5) of patches, of zero mean and unit spread over a chart.

    Parameters
    ----------
    positions : (I, 2) array
        On the chart, any unit.
    """
    x, y = ((positions - positions.mean(axis=0)) / positions.std(axis=0)).T
    terms = np.column_stack([x, y, x**2, y**2, x * y])
    return np.asarray((terms - terms.mean(axis=0)) / terms.std(axis=0))


def unlit_design(photo: ChartEquations, basis: np.ndarray) -> np.ndarray:
    """Signal (I, N) of each patch for each coefficient of one band.

    Before exposure, field and glare.

    Parameters
    ----------
    photo : ChartEquations
    basis : (P, N) array
        From coefficients to a sensitivity curve.
    """
    return (photo.reflectances * photo.power * (photo.irradiance / np.pi)[:, None]) @ basis


def nuisance_sd(photo: ChartEquations) -> np.ndarray:
    """Prior standard deviations of the field terms, the glare of each band and the errors of the
    filter, in this order.

    Parameters
    ----------
    photo : ChartEquations
    """
    glare = photo.glare_sd * photo.signal.max(axis=0) if photo.glare else np.zeros(0)
    return np.concatenate([np.full(photo.field_terms.shape[1], FIELD_SD), glare,
                           np.ones(photo.filter_errors)])


def nuisance_starts(photos: Sequence[ChartEquations]) -> np.ndarray:
    """Index of each photo's log exposure among the nuisances of all photos, then their number.

    The nuisances stand photo by photo: log exposure, field terms, glare of each band, errors of
    the filter.

    Parameters
    ----------
    photos : sequence of V ChartEquations

    Returns
    -------
    (V + 1,) int array
    """
    return np.cumsum([0, *(1 + nuisance_sd(photo).size for photo in photos)])


def passed(error: np.ndarray) -> np.ndarray:
    """Transmittance of a filter relative to the stated one, for a relative error of any size: never
    negative, and no more than in proportion to an error that adds light.

    Parameters
    ----------
    error : array
    """
    return np.where(error < 0, np.exp(np.minimum(error, 0)), 1 + error)


def passed_slope(error: np.ndarray) -> np.ndarray:
    """Derivative of ``passed``.

    Parameters
    ----------
    error : array
    """
    return np.asarray(np.exp(np.minimum(error, 0)))


def predicted_signal(photo: ChartEquations, design: np.ndarray, coefficients: np.ndarray,
                     exposure: float, nuisance: np.ndarray,
                     modes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signal (I K,) patch after patch, and its derivatives (I K, K N + 1 + nuisances).

    Parameters
    ----------
    photo : ChartEquations
    design : (I, N) array
        From ``unlit_design``.
    coefficients : (K, N) array
        Of the curves.
    exposure : float
        Logarithm.
    nuisance : array
        Coefficients of the field terms, then the glare of each band where the photo allows it,
        then those of the filter's errors.
    modes : (N, F) array
        From ``ChartEquations.modes``.
    """
    patches, bands = photo.signal.shape
    terms = photo.field_terms.shape[1]
    of_filter = nuisance.size - modes.shape[1]
    error = modes @ nuisance[of_filter:]
    change = design * passed_slope(error)
    design = design * passed(error)
    exposed = np.exp(exposure + photo.field_terms @ nuisance[:terms])
    bare = exposed[:, None] * (design @ coefficients.T)
    glare = nuisance[terms:of_filter] if photo.glare else np.zeros(bands)
    by_curve = np.einsum("in,kl->ikln", exposed[:, None] * design,
                         np.eye(bands)).reshape(patches * bands, -1)
    by_exposure = bare.reshape(-1, 1)
    by_field = (bare[:, :, None] * photo.field_terms[:, None, :]).reshape(patches * bands, terms)
    by_glare = np.tile(np.eye(bands), (patches, 1))[:, :of_filter - terms]
    by_filter = np.einsum("in,kn,nf->ikf", exposed[:, None] * change, coefficients, modes,
                          optimize=True).reshape(patches * bands, -1)
    return (bare + glare).ravel(), np.hstack([by_curve, by_exposure, by_field, by_glare, by_filter])


def noise_covariance(photo: ChartEquations, error: PatchError) -> np.ndarray:
    """Covariance (I, K, K) of the patches' signals, that of the pixels and the model's.

    Errors of different patches are independent. A clipped signal is not known at all.

    Parameters
    ----------
    photo : ChartEquations
    error : PatchError
        Of every patch. One that is darker errs as one of 3 % of the brightest patch, and each of
        its bands by itself as one of 20 %.
    """
    level = _relative_to(photo)
    covariance = photo.covariance + _model_covariance(error, level, level, photo.band_correlation)
    if photo.copy_errors is not None:
        covariance = covariance + photo.copy_errors @ photo.copy_errors.transpose(0, 2, 1)
    if photo.clipped is None:
        return covariance
    return covariance + variance_of_clipped(photo.clipped, photo.signal)


def variance_of_clipped(clipped: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """Covariance (I, K, K) that takes all weight from clipped signals, 0 in the others.

    Parameters
    ----------
    clipped : (I, K) bool array
    signal : (I, K) array
    """
    return np.asarray(np.eye(clipped.shape[1]) * (
        clipped * (CLIPPED_SD * signal.max(axis=0))**2)[:, :, None])


def noise_of_photos(photos: Sequence[ChartEquations], error: PatchError) -> np.ndarray:
    """Covariance (Y, Y) of all signals of photos, patch after patch, see ``noise_covariance``.

    A photo through a filter repeats ``REPEATED`` of the model's errors of the same patches; what a
    copy of the chart departs from its mean, all photos have in common.

    Parameters
    ----------
    photos : sequence of ChartEquations
    error : PatchError
    """
    covariance = block_diagonal(*(patch for photo in photos for patch in noise_covariance(
        replace(photo, copy_errors=None), error)))
    of_copy = copy_patterns(photos)
    if of_copy is not None:
        covariance += of_copy @ of_copy.T
    bands, same = photos[0].signal.shape[1], _same_patches(photos)
    levels = np.concatenate([_relative_to(photo) for photo in photos], axis=1)
    repeated = PatchError(*np.sqrt(REPEATED) * error)
    for mine, theirs in np.argwhere(np.triu(same)).tolist():
        rows, columns = (slice(patch * bands, (patch + 1) * bands) for patch in (mine, theirs))
        block = _model_covariance(repeated, levels[:, mine], levels[:, theirs],
                                  photos[0].band_correlation)
        covariance[rows, columns] += block
        covariance[columns, rows] += block.T
    return covariance


def copy_patterns(photos: Sequence[ChartEquations]) -> np.ndarray | None:
    """Signals (Y, R) of all photos by the terms of the chart's copy; None where it is no copy.

    Parameters
    ----------
    photos : sequence of ChartEquations
    """
    parts = [photo.copy_errors for photo in photos if photo.copy_errors is not None]
    return np.vstack([part.reshape(-1, part.shape[2]) for part in parts]) if parts else None


def common_patterns(photos: Sequence[ChartEquations]) -> np.ndarray:
    """Errors of signals (Y, R), one for each patch of each photo, that bands have in common:
    ``noise_of_photos`` with a common error is that without and the error squared times
    ``patterns @ patterns.T``.

    Parameters
    ----------
    photos : sequence of ChartEquations
    """
    columns = block_diagonal(*(patch[:, None] for photo in photos
                               for patch in _relative_to(photo)[1]))
    same = _same_patches(photos)
    return columns @ np.linalg.cholesky(np.eye(len(same)) + REPEATED.common * same)


def _same_patches(photos: Sequence[ChartEquations]) -> np.ndarray:
    """Which of all patches of all photos (R, R) are one that errs alike in both."""
    of_photo = np.repeat(np.arange(len(photos)), [len(photo.signal) for photo in photos])
    number = np.concatenate([np.full(len(photo.signal), -1) if photo.number is None
                             else photo.number for photo in photos])
    return np.asarray((number[:, None] == number) & (number >= 0) & _through_filters(photos)
                      & (of_photo[:, None] != of_photo))


def _through_filters(photos: Sequence[ChartEquations]) -> bool:
    """Whether patches err alike in photos: in all as soon as one is through a filter. If two that
    are alike to a third were not so to each other, there would be no such errors.
    """
    return any(photo.filter is not None for photo in photos)


def rows_of_patch(photos: Sequence[ChartEquations], patch: int) -> np.ndarray:
    """Rows of the signals (Y,) that show one patch of the first photo: in that photo, and if any is
    through a filter or the chart is a copy, in all photos, whose errors are its own.

    Parameters
    ----------
    photos : sequence of ChartEquations
    patch : int
        Index in the first photo.
    """
    first, start, rows = photos[0], 0, []
    for number, photo in enumerate(photos):
        bands = photo.signal.shape[1]
        if number == 0:
            mine = np.array([patch])
        elif not (_through_filters(photos) or photo.copy_errors is not None) \
                or photo.number is None or first.number is None:
            mine = np.zeros(0, int)
        else:
            mine = np.flatnonzero(photo.number == first.number[patch])
        rows += [start + index * bands + band for index in mine for band in range(bands)]
        start += photo.signal.size
    return np.array(rows)


def _model_covariance(error: PatchError, mine: np.ndarray, theirs: np.ndarray,
                      correlation: np.ndarray | None) -> np.ndarray:
    """Covariance (..., K, K) of the model's errors of signals that both show the same patches.

    Parameters
    ----------
    error : PatchError
    mine, theirs : (2, ..., K) arrays
        From ``_relative_to``.
    correlation : (K, K) array or None
        Of the bands' own errors; None: independent.
    """
    each = (np.eye(mine.shape[-1]) if correlation is None else correlation) \
        * mine[0][..., :, None] * theirs[0][..., None, :]
    return error.own**2 * each + error.common**2 * mine[1][..., :, None] * theirs[1][..., None, :]


def _relative_to(photo: ChartEquations) -> np.ndarray:
    """Signals (2, I, K) that the errors of patches are relative to: each band's own, and those that
    bands have in common.
    """
    brightest, dark = photo.signal.max(axis=0), 0.0
    if photo.filter is not None:        # which may leave a band with little but stray light
        dark = DARK_BAND * photo.signal.max()
    return np.array([np.maximum(photo.signal, np.maximum(share * brightest, dark))
                     for share in (OWN_DARK_SHARE, DARK_SHARE)])
