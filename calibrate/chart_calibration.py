"""A whole calibration: curves, light and scale, from chart photos or from measured curves."""
from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from spectrabox.calibrate.chart_equations import (
    GLARE_SD,
    HAZE_SD,
    ChartEquations,
    chart_equations,
    some_patches,
)
from spectrabox.calibrate.colour_drift import colour_drift
from spectrabox.calibrate.doubts import light_doubts, matrix_contradicts, unlike_cameras
from spectrabox.calibrate.held_out_patches import PatchesWithout, in_chart_order
from spectrabox.calibrate.light_error import LightDeparture, light_departures, light_terms
from spectrabox.calibrate.photo_checks import (
    WORST_CHI_SQUARE,
    WORST_MODEL_ERROR,
    disagreement_of_bands,
    light_power,
    refuse_disagreement,
)
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.prior.curve_posterior import (
    camera_alone,
    curve_moments,
    curve_variance,
    draw_curves,
    relit,
)
from spectrabox.calibrate.prior.plain_priors import SMOOTH_SOURCE
from spectrabox.calibrate.prior.prior_fit import posterior_of_curves
from spectrabox.calibrate.products.lamps import lamps_like
from spectrabox.calibrate.products.product_fit import SEED, ProductFit, fit_products
from spectrabox.calibrate.products.product_posterior import evidence_of_products
from spectrabox.calibrate.products.product_prior import product_prior
from spectrabox.calibrate.sensitivity import (
    CHART_ERROR,
    PriorFit,
    default_prior,
    fit_sensitivities,
    fit_with_prior,
    relative_prediction_covariance,
    require_fit_for,
)
from spectrabox.calibrate.spline_fit import SPLINE_BANDS, SPLINE_COEFFICIENTS
from spectrabox.calibrate.trust import (
    chart_colour_differences,
    check_measured_curves,
    fit_notes,
    other_reading,
)
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.light_scale import scale_from_signals
from spectrabox.radiometry.records import (
    Calibration,
    CalibrationDoubt,
    ChartWhite,
    Filter,
    LightPosterior,
    LightScale,
    Outcome,
    PatchSamples,
    PriorInfluence,
    Quantity,
    SensitivityFit,
    Spectrum,
    UnknownLight,
    WavelengthGrid,
    default_band_names,
)
from spectrabox.radiometry.response import response_matrix
from spectrabox.radiometry.shaped import Record
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid

MIN_BANDS = 3
LEVEL = 0.9                 # of the band of curves
NORMAL_QUANTILE = 1.6449    # of that level, two-sided
DRAWS = 1000                # of the curves
NAMED_BANDS = 3             # at most, that disagree most
RARE_HAZE = 3.0             # log odds against a veil beforehand
DOUBTED_VEIL, MAX_VEIL = 0.04, 0.3      # of the brightest patch: a warning; no photo of a chart
# Standard errors by which a patch is off, and the same over the rms of the other patches, beyond
# which it is a suspect; by chance in one chart of ten.
SUSPECT, SUSPECT_TO_OTHERS, MAX_SUSPECTS = 2.6, 3.5, 3
Fit = TypeVar("Fit", PriorFit, ProductFit)


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

    @property
    def used(self) -> np.ndarray:
        """Whether each patch (I,) may be used: neither excluded nor saturated in every band. Of one
        that is, fits use the bands that are not clipped.
        """
        return ~self.samples.saturated if self.excluded is None \
            else ~(self.excluded.astype(bool) | self.samples.saturated)

    @property
    def irradiance_or_pi(self) -> np.ndarray:
        """Irradiance (I,) on each patch; pi where unknown."""
        return np.full(len(self.reflectances), np.pi) if self.irradiance is None \
            else self.irradiance


@dataclass(frozen=True)
class CalibrationOptions:
    """What an operator may choose of a calibration."""

    method: str = "prior"                       # or one of spline_fit.SPLINE_METHODS
    prior: CameraPrior | None = None            # None: shipped, or smoothness for other bands
    coefficients: int = SPLINE_COEFFICIENTS     # of each band, for "paper" and "nonnegative"
    curves: np.ndarray | None = None            # (K, P) measured; fits none, whatever the method


@dataclass(frozen=True, eq=False)
class ChartCalibration(Record):
    """A calibration with everything that led to it."""

    calibration: Calibration
    scale: LightScale                               # also where the calibration has none
    predicted: Annotated[np.ndarray, "I K"]
    held_out: Annotated[np.ndarray, "I K"]          # each patch predicted from the others
    delta_e: Annotated[np.ndarray, "I"]             # CIEDE2000 of each patch, fitted
    held_out_delta_e: Annotated[np.ndarray, "I"]    # the same, the patch left out of the fit
    prior_fit: PriorFit | None                      # of the method "prior"
    without: PatchesWithout                         # the first photo's patches, each left out
    excluded: Annotated[np.ndarray, "I"]            # bool: excluded from every fit
    saturated: Annotated[np.ndarray, "I"]           # bool: of the excluded, in every band
    cleaned: PatchesWithout                         # as ``without``, suspects out of every fit
    departures: tuple[LightDeparture, ...] = ()     # of the lights that may depart from the stated

    @property
    def prior_influence(self) -> PriorInfluence | None:
        """What of the curves is the prior's; None by methods that use none."""
        fit = self.prior_fit
        return None if fit is None else PriorInfluence(
            fit.prior_share, tuple(members for members, _ in fit.families),
            np.array([probability for _, probability in fit.families]))

    @property
    def white(self) -> ChartWhite | None:
        """White, field and glare of the first photo; None by methods that fit none."""
        return None if self.prior_fit is None else self.prior_fit.photos[0].white


def calibrate_chart(photos: Sequence[ChartPhoto], grid: WavelengthGrid,
                    options: CalibrationOptions | None = None) -> ChartCalibration:
    """Calibration of a camera and its light from photos of a chart.

    Parameters
    ----------
    photos : sequence of ChartPhoto
        By one camera; those of an unknown light all under the first one's. Light, scale, predicted
        signals and colour differences are those of the first; more than one needs the method
        ``prior``. With a known irradiance of the first,
        the calibration carries a light scale.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    options : CalibrationOptions or None
        None takes the defaults.

    Raises
    ------
    InputError
        If a photo has fewer than 3 bands, several are given to a method that takes one, the method
        is not known, or a light cannot be one (see ``light_power``).
    CheckError
        If no camera explains the patches, or given curves explain them only if the photo is read in
        another way.
    CalibrationError
        If chart and light do not determine the curves (see ``fit_sensitivities``).
    """
    chosen = CalibrationOptions() if options is None else options
    first = photos[0]
    _require_usable(photos, chosen)
    light, power, unseen = _power_of(first.light, grid)
    if chosen.curves is not None:
        fitted = _from_measured(first, power, grid, chosen.curves)
    elif chosen.method == "prior":
        fitted = _with_prior(photos, grid, chosen.prior)
    else:
        fitted = _by_splines(first, power, grid, chosen)
    fit, scale, doubts = fitted.fit, fitted.scale, fitted.doubts
    # what the photo shows, what the fit gives, and what fits without each patch give
    held_out = fit.residuals if fit.held_out_residuals is None else fit.held_out_residuals
    assert held_out is not None
    measured, signals_without = first.samples.mean, first.samples.mean * (1 - held_out)
    covariance = relative_prediction_covariance(held_out, first.samples)
    known = ~first.samples.clipped.any(axis=1)
    delta_e, delta_e_without = (
        chart_colour_differences(measured, signal, first.reflectances, grid)
        for signal in (fitted.predicted, signals_without))
    left_out = ("" if chosen.curves is not None
                else f", {delta_e_without[known].mean():.2f} for patches left out of the fit")
    checks = [f"chart colour difference {delta_e[known].mean():.2f} CIEDE2000{left_out}",
              f"relative error of predicted signals {np.sqrt(np.diag(covariance)).max():.1%} in "
              "the worst band, from patches"
              + ("" if fit.held_out_residuals is None else " left out of the fit")]
    if fit.condition_number is not None:
        checks.append(f"condition number {fit.condition_number:.4g}")
    if scale.standard_error is not None:
        checks.append("signal of a perfect reflector (light scale times curves) known to "
                      f"{scale.standard_error / scale.value:.2%} in each band")
    if fitted.prior_fit is not None and any(
            np.any(state.certain_glare > DOUBTED_VEIL * state.predicted.max(axis=0))
            for state in fitted.prior_fit.photos):
        doubts += (CalibrationDoubt.VEIL,)
    # products with an unknown light are no curves that a matrix could be held against
    if fitted.light is None and matrix_contradicts(first.samples.camera_from_xyz, fit.curves, grid):
        doubts += (CalibrationDoubt.COLOUR_MATRIX,)
    checks += [*unseen, *_clipped_notes(fitted.without, first), *fitted.notes,
               *(doubt.value for doubt in doubts
                 if not any(note.startswith(doubt.value) for note in fitted.notes))]
    calibration = Calibration(fit, light, None if first.irradiance is None else scale, covariance,
                              tuple(checks), doubts, fitted.light,
                              isinstance(first.light, UnknownLight))
    return ChartCalibration(calibration, scale, fitted.predicted, signals_without, delta_e,
                            delta_e_without, fitted.prior_fit, fitted.without, ~first.used,
                            first.samples.saturated, fitted.cleaned or fitted.without,
                            fitted.departures)


def log_evidence(photos: Sequence[ChartPhoto], grid: WavelengthGrid,
                 prior: CameraPrior | None = None) -> float:
    """How well the joint estimate explains photos, in nats up to a constant of their signals.

    Parameters
    ----------
    photos : sequence of ChartPhoto
        By one camera.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    prior : CameraPrior or None
        None takes the default.

    Raises
    ------
    CalibrationError, InputError
        As ``fit_with_prior``.
    """
    used, _ = _used_and_excluded(photos, grid)
    cameras = default_prior(used, grid) if prior is None else prior
    require_fit_for(used, cameras)
    light = photos[0].light
    with threadpool_limits(1, "blas"):      # see fit_with_prior
        if isinstance(light, UnknownLight) and cameras.source != SMOOTH_SOURCE:
            return evidence_of_products(used, product_prior(cameras, lamps_like(light), SEED))
        return posterior_of_curves(used, cameras, grid).log_evidence


def camera_curves(calibration: ChartCalibration) -> SensitivityFit:
    """The camera's curves by themselves, for use under any light.

    Those of a calibration belong to its stated light: together they give the chart's signals. Where
    the fit infers that another light shone the camera's own curves are others.

    Parameters
    ----------
    calibration : ChartCalibration
    """
    fit, joint = calibration.calibration.sensitivity, calibration.prior_fit
    if joint is None or not joint.posterior.lights:
        return fit
    bands = len(fit.curves)
    alone = camera_alone(joint.posterior, bands)
    moments = curve_moments(alone, bands)
    return replace(fit, curves=moments.coefficients @ alone.basis.T,
                   coefficients=moments.coefficients, covariance=moments.covariance,
                   standard_error=np.sqrt(curve_variance(alone.basis, moments.covariance, bands)))


def through_filter(calibration: Calibration, fit: PriorFit, number: int,
                   grid: WavelengthGrid) -> Calibration:
    """The calibration of one photo of a fit: that of its light through the photo's filter.

    Parameters
    ----------
    calibration : Calibration
        Of the light that the photo was taken under, without a filter.
    fit : PriorFit
    number : int
        Of the photo in the fit.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    fitted, light = fit.photos[number].filter, calibration.light
    if fitted is None:
        return calibration
    passed = fitted.filter.transmittance / fitted.filter.transmittance.max()
    error = light.standard_error
    return replace(calibration, filter=fitted, light=Spectrum(
        grid, spectrum_on_grid(light, grid) * passed, light.quantity,
        f"{light.source} through {fitted.filter.name}",
        None if error is None else np.interp(grid.nm, light.grid.nm, error) * passed))


@dataclass(frozen=True, eq=False)
class CurveBand(Record):
    """Band of curves of largest value 1; draws are None for methods without a posterior."""

    lower: Annotated[np.ndarray, "K P"]
    upper: Annotated[np.ndarray, "K P"]
    draws: Annotated[np.ndarray, "T K P"] | None


def curve_band(calibration: ChartCalibration, seed: int = 0) -> CurveBand | None:
    """The pointwise 90 % band of the camera's curves; None for measured curves.

    Quantiles of 1000 draws with the method ``prior``, else from the standard error.

    Parameters
    ----------
    calibration : ChartCalibration
    seed : int
        Of the draws.
    """
    fit = calibration.calibration.sensitivity
    if calibration.prior_fit is not None:
        draws = draw_curves(camera_alone(calibration.prior_fit.posterior, len(fit.curves)),
                            len(fit.curves), DRAWS, seed)
        lower, upper = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
        return CurveBand(lower, upper, draws)
    if fit.standard_error is None:
        return None
    half = NORMAL_QUANTILE * fit.standard_error
    return CurveBand(np.maximum(fit.curves - half, 0), fit.curves + half, None)


def calibration_from_curves(grid: WavelengthGrid, curves: np.ndarray, light: Spectrum,
                            relative_error: float) -> Calibration:
    """Calibration from measured curves alone, without a chart photo.

    Parameters
    ----------
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    curves : (K, P) array
        Measured sensitivities, the largest value of all bands being 1.
    light : Spectrum
    relative_error : float
        Within which predicted signals are taken to be right, independent in each band.
    """
    covariance = np.eye(len(curves)) * relative_error**2
    note = ("sensitivities taken as given; predicted signals assumed right within "
            f"{relative_error:.1%} a band")
    return Calibration(_measured_curves(grid, curves, None), light, None, covariance, (note,))


class _Fitted(NamedTuple):
    """What a method says of the first photo's chart, and of its light where that was unknown."""

    fit: SensitivityFit
    scale: LightScale
    predicted: np.ndarray       # (I, K)
    without: PatchesWithout
    notes: tuple[str, ...]
    prior_fit: PriorFit | None = None
    light: LightPosterior | None = None
    doubts: tuple[CalibrationDoubt, ...] = ()
    cleaned: PatchesWithout | None = None       # by fits without patches that others contradict
    departures: tuple[LightDeparture, ...] = ()


def _require_usable(photos: Sequence[ChartPhoto], chosen: CalibrationOptions) -> None:
    """Refuse photos that the method cannot take."""
    first, bands = photos[0], photos[0].samples.mean.shape[1]
    if first.filter is not None:
        raise InputError("the first photo under a light must be without a filter; photos through "
                         "filters come after it")
    if bands < MIN_BANDS:
        raise InputError(f"the photo has {bands} band{'s' * (bands > 1)}; {MIN_BANDS} or more "
                         "are needed: stack photos that were taken through different filters into "
                         "one of several bands")
    method = chosen.method if chosen.curves is None else "file"
    if isinstance(first.light, UnknownLight):
        if method != "prior":
            raise InputError(f"method {method} needs the spectrum of the light, and the photo has "
                             f"an {first.light.words}; use method prior, or measure the light")
        if any(not isinstance(photo.light, UnknownLight) for photo in photos[1:]):
            raise InputError("several chart photos of which one has an unknown light must all be "
                             "under that light: fit those under other lights by themselves, or "
                             "measure it")
    if len(photos) > 1 and method != "prior":
        raise InputError(f"method {method} takes one photo; {len(photos)} photos need method prior")


def _clipped_notes(without: PatchesWithout, photo: ChartPhoto) -> tuple[str, ...]:
    """What it costs that clipped bands of patches could not be used."""
    samples, known = photo.samples, without.known_within(photo.reflectances)
    bands = np.array(photo.bands or default_band_names(samples.mean.shape[1]))
    return tuple(
        f"patch {photo.chart.names[patch]} is saturated"
        + (" and was left out" if samples.saturated[patch] else
           f" in {', '.join(bands[samples.clipped[patch]])} and was left out there")
        + f": its signal is predicted within {known[patch, 0]:.1%}, and would be within "
        f"{known[patch, 1]:.1%} had it been used"
        for patch in np.flatnonzero(samples.clipped.any(axis=1)))


def _power_of(light: Spectrum | UnknownLight,
              grid: WavelengthGrid) -> tuple[Spectrum, np.ndarray, tuple[str, ...]]:
    """The light as the calibration carries it, on the grid (P,), and what it cannot show."""
    if isinstance(light, UnknownLight):
        ones = np.ones_like(grid.nm)
        return Spectrum(grid, ones, Quantity.RELATIVE, light.words), ones, ()
    return (light, *light_power(light, grid))


def _as_equations(photo: ChartPhoto, grid: WavelengthGrid) -> ChartEquations:
    """All patches of a photo, with a field where the illumination of the chart is not known."""
    return chart_equations(photo.samples, photo.reflectances, _power_of(photo.light, grid)[1],
                           photo.irradiance_or_pi, grid, rows=photo.chart.rows,
                           positions=None if photo.irradiance is not None
                           else photo.chart.centres_uv,
                           light_terms=light_terms(photo.light, grid)
                           if isinstance(photo.light, Spectrum) else None, filter=photo.filter)


def _with_prior(photos: Sequence[ChartPhoto], grid: WavelengthGrid,
                prior: CameraPrior | None) -> _Fitted:
    """By the joint estimate from all photos; of an unknown light, products with it."""
    first = photos[0]
    used, excluded = _used_and_excluded(photos, grid)
    cameras = default_prior(used, grid) if prior is None else prior
    light: LightPosterior | None = None
    doubts: tuple[CalibrationDoubt, ...] = ()
    departures: tuple[LightDeparture, ...] = ()
    if isinstance(first.light, Spectrum):
        fit = _one_camera(used, grid, cameras, excluded)
        departures = light_departures(fit.posterior, [_power_of(photo.light, grid)[0]
                                                      for photo in photos], grid)
        bare = [number for number, photo in enumerate(photos) if photo.filter is None]
        doubts, notes = light_doubts([_power_of(photos[number].light, grid)[0].source
                                      for number in bare], [used[number] for number in bare],
                                     cameras, grid)
        notes += tuple(departure.words for departure in departures)
        if unlike_cameras(fit):
            doubts = (CalibrationDoubt.UNLIKE_CAMERAS, *doubts)
    elif cameras.source == SMOOTH_SOURCE:
        fit = _one_camera(used, grid, cameras, excluded)
        notes = (f"no measured camera has {cameras.bands} bands: products of sensitivity and light "
                 "were fitted with smoothness alone, so narrow lines of the lamp are smoothed over "
                 "and the light by itself is not known",)
    else:
        lamps, words = lamps_like(first.light), first.light.words
        products = _with_veil(used, lambda shown: fit_products(shown, cameras, lamps, grid, words,
                                                               excluded))
        fit, light, notes = products.fit, products.light, products.light.sentences
        if fit.disagrees:
            refuse_disagreement("no camera under any lamp explains the chart photo", used[0].signal,
                                fit.held_out[0], fit.chi_square, None)
    if cameras.source == SMOOTH_SOURCE and fit.model_error > WORST_MODEL_ERROR:
        doubts = (*doubts, CalibrationDoubt.BANDS)
        notes = (*notes, _disagreeing_bands(first, used[0], fit))
    for number in range(len(used)):
        drift = colour_drift(fit.posterior, relit(fit.posterior, used), number)
        if drift is not None and drift.two_lights:
            doubts = (*dict.fromkeys((*doubts, CalibrationDoubt.TWO_LIGHTS)),)
            notes = (*notes, f"{f'photo {number + 1}: ' * (len(used) > 1)}the colour of the light "
                     f"drifts by {drift.size:.1%} over the chart (probability by chance "
                     f"{drift.chance:.0e})")
    without = in_chart_order(fit.without, first.used)
    held_out = without.predicted(first.reflectances)
    predicted = held_out.copy()     # excluded patches: what the fit without them predicts
    predicted[first.used] = fit.photos[0].predicted
    residuals = 1 - predicted / first.samples.mean
    return _Fitted(replace(fit.sensitivity, residuals=residuals,
                           held_out_residuals=1 - held_out / first.samples.mean),
                   replace(fit.photos[0].light_scale, residuals=residuals), predicted, without,
                   (*fit_notes(fit, grid), *notes), fit, light, doubts,
                   _without_suspects(photos, grid, cameras, without), departures)


def _any_light(light: Spectrum | UnknownLight, cameras: CameraPrior, grid: WavelengthGrid,
               excluded: ChartEquations | None, photos: list[ChartEquations]) -> PriorFit:
    """The joint estimate, of products where the light is unknown and cameras are measured."""
    if isinstance(light, UnknownLight) and cameras.source != SMOOTH_SOURCE:
        return fit_products(photos, cameras, lamps_like(light), grid, light.words, excluded).fit
    return fit_with_prior(photos, cameras, grid, excluded=excluded)


def _used_and_excluded(photos: Sequence[ChartPhoto], grid: WavelengthGrid
                       ) -> tuple[list[ChartEquations], ChartEquations | None]:
    """The patches of all photos that are used, and those of the first that are not."""
    whole = [_as_equations(photo, grid) for photo in photos]
    used = [equations if photo.used.all() else some_patches(equations, photo.used)
            for photo, equations in zip(photos, whole, strict=True)]
    return used, None if photos[0].used.all() else some_patches(whole[0], ~photos[0].used)


def _without_suspects(photos: Sequence[ChartPhoto], grid: WavelengthGrid, cameras: CameraPrior,
                      without: PatchesWithout) -> PatchesWithout:
    """The first photo's patches once those are out of the fit that other patches contradict.

    A patch that is off makes the fit take all patches for worse than they are, and may bend the
    light over its neighbours: of the two that are furthest off the one is left out that is further
    off by a fit without it, and so on.
    """
    first, suspects = photos[0], np.zeros(len(photos[0].reflectances), bool)
    for _ in range(MAX_SUSPECTS):
        brighter, error, _ = without.deviations(first.reflectances)
        off = np.where(first.used & ~suspects, np.abs(brighter / error), 0.0)
        others = np.sqrt((np.sum(off**2) - off**2) / (np.count_nonzero(off) - 1))
        doubted = [patch for patch in np.argsort(-off)[:2].tolist()
                   if off[patch] > SUSPECT or off[patch] > SUSPECT_TO_OTHERS * others[patch]]
        fits = []
        for patch in doubted:
            kept_out = ~first.used | suspects
            kept_out[patch] = True
            shown = [replace(first, excluded=kept_out), *photos[1:]]
            used, excluded = _used_and_excluded(shown, grid)
            fit = _with_veil(used, functools.partial(_any_light, first.light, cameras, grid,
                                                     excluded))
            rest = in_chart_order(fit.without, shown[0].used)
            level, spread, _ = rest.deviations(first.reflectances)
            fits.append((abs(level[patch] / spread[patch]), patch, rest))
        if not fits:
            break
        _, patch, without = max(fits, key=lambda fit: fit[0])
        suspects[patch] = True
    return without


def _with_veil(photos: list[ChartEquations],
               fitted: Callable[[list[ChartEquations]], Fit]) -> Fit:
    """A fit under usual glare or, where glare is large or the photos are not explained, under haze,
    if the evidence is for it.
    """
    def joint(fit: Fit) -> PriorFit:
        return fit if isinstance(fit, PriorFit) else fit.fit

    def veils(fit: Fit) -> list[float]:
        return [float(np.max(np.abs(state.glare) / photo.signal.max(axis=0)))
                for photo, state in zip(photos, joint(fit).photos, strict=True)]

    usual = fitted(photos)
    large = [veil > 2 * GLARE_SD for veil in veils(usual)]
    if not (joint(usual).disagrees or any(large)):
        return usual
    hazy = fitted([replace(photo, glare_sd=HAZE_SD) if veiled or not any(large) else photo
                   for photo, veiled in zip(photos, large, strict=True)])
    gain = joint(hazy).posterior.log_evidence - joint(usual).posterior.log_evidence
    return hazy if gain > RARE_HAZE and max(veils(hazy)) <= MAX_VEIL else usual


def _one_camera(photos: list[ChartEquations], grid: WavelengthGrid, prior: CameraPrior,
                excluded: ChartEquations | None) -> PriorFit:
    """The joint estimate, refused where no camera explains the photos: it says which photo, and
    which other reading of it would agree.
    """
    joint = _with_veil(photos, lambda shown: fit_with_prior(shown, prior, grid, excluded=excluded))
    # where no camera is known the error is what it is, and the spectra carry it
    bearable = prior.source == SMOOTH_SOURCE and joint.chi_square <= WORST_CHI_SQUARE
    if bearable or not joint.disagrees:
        return joint
    alone = ([joint] if len(photos) == 1
             else [fit_with_prior([photo], prior, grid) for photo in photos])
    for number, (photo, fit) in enumerate(zip(photos, alone, strict=True), start=1):
        if fit.disagrees:
            which = "the chart photo" if len(photos) == 1 else f"chart photo {number}"
            refuse_disagreement(f"no camera explains {which}", photo.signal, fit.held_out[0],
                                fit.chi_square, other_reading(photo, prior, grid))
    raise CheckError(f"each of the {len(photos)} chart photos can be explained, but not all by one "
                     f"camera (patches and model agree only within {joint.model_error:.1%}, "
                     f"chi-square {joint.chi_square:.1f} per signal together); check that the "
                     "camera and its settings were the same, and that each photo has the spectrum "
                     "of its own light")


def _disagreeing_bands(photo: ChartPhoto, used: ChartEquations, fit: PriorFit) -> str:
    """Which bands of the chart's patches disagree most with what the other patches predict."""
    bands = photo.bands or default_band_names(used.signal.shape[1])
    off = disagreement_of_bands(used.signal, fit.held_out[0])
    worst = np.argsort(-off)[:NAMED_BANDS]
    return (f"{CalibrationDoubt.BANDS.value} (what the others predict of a patch is off by "
            + ", ".join(f"{off[band]:.0%} in {bands[band]}" for band in worst)
            + f", in half of the bands by less than {np.median(off):.0%})")


def _from_measured(photo: ChartPhoto, power: np.ndarray, grid: WavelengthGrid,
                   curves: np.ndarray) -> _Fitted:
    """Measured curves as they are; the photo gives the scale of its light."""
    samples, used, irradiance = photo.samples, photo.used, photo.irradiance_or_pi
    unscaled = _chart_signals(photo, grid, curves, power)
    patches, bands = samples.mean.shape

    def scale_by(chosen: np.ndarray) -> LightScale:
        return scale_from_signals(samples.mean[chosen], unscaled[chosen], CHART_ERROR,
                                  "chart photo", ~samples.clipped[chosen])

    scale = scale_by(used)
    others = [scale_by(used & rest).value for rest in ~np.eye(patches, dtype=bool)]
    predicted = scale.value * unscaled
    residuals = 1 - predicted / samples.mean
    relative = relative_prediction_covariance(residuals, samples)
    factor = (np.array(others) * irradiance / np.pi)[:, None, None]
    covariance = np.zeros((patches, bands * bands + bands, bands * bands + bands))
    covariance[:, bands * bands:, bands * bands:] = (
        relative * samples.mean[:, :, None] * samples.mean[:, None, :])
    without = PatchesWithout(curves.T, power * grid.weights_nm, factor * np.eye(bands),
                             np.zeros((patches, bands)), covariance, samples.mean,
                             samples.covariance_of_mean, samples.clipped)
    equations = _as_equations(photo, grid)
    note = check_measured_curves(equations if used.all() else some_patches(equations, used), curves,
                                 grid)
    return _Fitted(_measured_curves(grid, curves, residuals), replace(scale, residuals=residuals),
                   predicted, without, (note,))


def _by_splines(photo: ChartPhoto, power: np.ndarray, grid: WavelengthGrid,
                chosen: CalibrationOptions) -> _Fitted:
    """By one of ``spline_fit.SPLINE_METHODS``."""
    fit, scale, without = fit_sensitivities(
        photo.samples, photo.reflectances, power, photo.irradiance_or_pi, grid, chosen.coefficients,
        method=chosen.method, used=photo.used)
    predicted = scale.value * _chart_signals(photo, grid, fit.curves, power)
    return _Fitted(fit, scale, predicted, without, (SPLINE_BANDS[chosen.method],))


def _chart_signals(photo: ChartPhoto, grid: WavelengthGrid, curves: np.ndarray,
                   power: np.ndarray) -> np.ndarray:
    return (photo.reflectances @ response_matrix(grid, curves, power).T
            * (photo.irradiance_or_pi / np.pi)[:, None])


def _measured_curves(grid: WavelengthGrid, curves: np.ndarray,
                     residuals: np.ndarray | None) -> SensitivityFit:
    return SensitivityFit(grid, curves, None, None, None, None, residuals, None, None,
                          "measured curves from a file", Outcome.CONVERGED)
