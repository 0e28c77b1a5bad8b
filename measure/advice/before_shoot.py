"""Before the shoot: errors of spectra to expect of a photo with a chart in it, and what would help.

Cameras are drawn from the prior, lamps from what is known of the light, surfaces of every family
from the learnt prior. A chart photo is simulated, fitted as a photo would be, and the surfaces are
recovered with the errors that the fit states and that flat samples have besides; beside it stands
what camera, lamp and white, known exactly, would leave. Light over chart and samples is taken as
even, with its field unknown to the fit, as always. Further photos have the errors with which they
are forecast after a photo; what a surface mirrors is one more error then.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from spectrabox.calibrate.chart_equations import chart_equations
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.products.lamps import lamps_like
from spectrabox.calibrate.products.product_fit import fit_products
from spectrabox.calibrate.products.product_prior import draw_cameras
from spectrabox.calibrate.sensitivity import PriorFit, fit_with_prior
from spectrabox.measure.advice.advice import GEL, SECOND_LAMP, TWO_GELS, Advice, advice, ranked
from spectrabox.measure.advice.at_hand import exposure_words
from spectrabox.measure.advice.forecast import Outlook
from spectrabox.measure.more_bands.further_photos import (
    FurtherPhoto,
    LampsAtHand,
    curves_and_light,
    photos_at_hand,
    white_of_bands,
)
from spectrabox.measure.more_bands.joined_errors import Surface, joined_errors
from spectrabox.measure.surfaces.surface_signals import FEW_BANDS, with_errors
from spectrabox.radiometry.appearance import ciede2000, reflectance_to_lab
from spectrabox.radiometry.error_model import (
    DISAGREEMENT,
    PHOTO_NOISE,
    PLANE_ERROR,
    SAMPLE_PLANE,
    SENSITIVITIES,
    WHITE,
    Errors,
    proportional_covariance,
    sensitivity_covariance,
    split_errors,
)
from spectrabox.radiometry.gloss import draw_gloss, gloss_states
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.radiometry.records.calibration import Calibration
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import (
    Quantity,
    SpectralMeasurement,
    Spectrum,
    SurfaceSignals,
    UnknownLight,
    default_band_names,
)
from spectrabox.radiometry.response import relative_response, response_matrix, white_signal
from spectrabox.radiometry.spectra.named_spectra import light as named_light
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.sampling.prior.mixture import (
    PRIOR_GRID,
    LogitMixture,
    load_prior,
    of_families,
    reflectance,
)
from spectrabox.sampling.prior.mixture_posterior import (
    calibrated_bands,
    central_band,
    mean_and_spread,
    multiplying,
    posterior,
)
from spectrabox.sampling.prior.state_posteriors import posteriors_in_states
from spectrabox.sampling.spectral_measurement import without_states

TO_FINE = interpolation_matrix(PRIOR_GRID.nm, FINE_GRID.nm)
LEVEL, REFERENCE_LIGHT = 0.95, "D65"
PHOTOS, SURFACES, SEED = 3, 20, 1
FEW = 42                        # surfaces of all families, for what further photos bring
PAIRED = 4                      # best gels, of which every pair is tried
# of the RMSE that camera and lamp, known exactly, would leave; of that under a full daylight
MUCH_BY_CHART, MUCH_BY_LAMP = 1.10, 1.15


@dataclass(frozen=True)
class Shoot:
    """A photo that is planned."""

    light: Spectrum | UnknownLight
    cameras: CameraPrior
    reflectances: np.ndarray    # (I, P) of the chart at 400, 401 ... 700 nm
    positions: np.ndarray       # (I, 2) of its patches
    noise: float                # relative error of a patch or region in each band


@dataclass(frozen=True)
class FamilyExpectation:
    """Means over surfaces of one family and over photos."""

    family: str
    rmse: float
    width: float                # of the 95 % band
    inside: float               # share of wavelengths at which it holds
    rmse_known: float           # camera, lamp and white being known exactly
    width_known: float


@dataclass(frozen=True)
class Expectation:
    """What to expect of a photo, by family and over all, and what further photos would bring."""

    families: tuple[FamilyExpectation, ...]
    rmse_daylight: float        # mean over families by the same cameras, known exactly, under D65
    advice: tuple[Advice, ...]  # best first

    @property
    def mean(self) -> FamilyExpectation:
        """Over the families, each counting alike."""
        return FamilyExpectation("all", *(float(np.mean([getattr(one, name)
                                                         for one in self.families]))
                                          for name in ("rmse", "width", "inside", "rmse_known",
                                                       "width_known")))

    @property
    def doubts(self) -> tuple[str, ...]:
        """What speaks against this photo, in sentences; none where chart and lamp will do."""
        mean, doubts = self.mean, []
        if mean.rmse > MUCH_BY_CHART * mean.rmse_known:
            doubts.append(f"chart and light leave camera and lamp open: the error is "
                        f"{mean.rmse / mean.rmse_known - 1:.0%} above what both, known exactly, "
                        "would leave; measure the light, take less noise, or a chart of more "
                        "colours")
        if mean.rmse_known > MUCH_BY_LAMP * self.rmse_daylight:
            doubts.append(f"this lamp shows less of a spectrum than others: even with everything "
                        f"known the error is {mean.rmse_known / self.rmse_daylight - 1:.0%} above "
                        f"that under {REFERENCE_LIGHT}; take another lamp, or add a photo under "
                        "one")
        return tuple(doubts)


def expected_spectra(shoot: Shoot, hand: LampsAtHand, *, photos: int = PHOTOS,
                     surfaces: int = SURFACES) -> Expectation:
    """Errors and widths of bands to expect of surfaces of every family.

    Parameters
    ----------
    shoot : Shoot
    hand : LampsAtHand
        For further photos.
    photos, surfaces : int
        Photos that are simulated, and surfaces of each family in each.
    """
    rng, known = np.random.default_rng(SEED), load_prior()
    cameras = draw_cameras(shoot.cameras, photos, rng) @ interpolation_matrix(shoot.cameras.nm,
                                                                             FINE_GRID.nm).T
    lamps = _lamps(shoot.light, photos, rng)
    rows, taken = [], []
    for curves, lamp in zip(cameras, lamps, strict=True):
        truth = np.vstack([_surfaces(known, family, surfaces, rng) for family in known.families])
        off = _errors(shoot, len(truth), len(curves), rng)
        photo = _fit(shoot, curves, lamp, rng)
        fitted, signals = _recovered(photo, curves * lamp, truth, off, known)
        exact, daylight = (_exact(shoot, curves * light, truth, off, known)
                           for light in (lamp, named_light(REFERENCE_LIGHT, FINE_GRID)))
        rows.append(np.array([*fitted, *exact[:2], daylight[0]]).reshape(
            6, len(known.families), surfaces).mean(axis=2))
        taken.append((photo, signals, truth))
    means = np.mean(rows, axis=0)
    return Expectation(tuple(FamilyExpectation(family, *(float(value) for value in column[:5]))
                             for family, column in zip(known.families, means.T, strict=True)),
                       float(means[5].mean()), _advice(shoot, taken, hand, known))


def _lamps(light: Spectrum | UnknownLight, count: int, rng: np.random.Generator) -> np.ndarray:
    """Spectra (n, P) that the light may have."""
    if isinstance(light, UnknownLight):
        likely = lamps_like(light)
        return likely.spectra[rng.choice(len(likely.names), count, p=likely.weights)]
    return np.tile(spectrum_on_grid(light, FINE_GRID), (count, 1))


def _surfaces(prior: LogitMixture, family: str, count: int,
              rng: np.random.Generator) -> np.ndarray:
    """Reflectances (n, 61) of a family, as the prior knows it."""
    mine = of_families(prior, (family,))
    component = rng.choice(mine.weights.size, count, p=mine.weights / mine.weights.sum())
    return reflectance(np.array([rng.multivariate_normal(
        mine.means[one], mine.covariances[one].astype(float), method="cholesky")
        for one in component]))


@dataclass(frozen=True)
class _Photo:
    """A chart photo that was simulated and fitted."""

    fit: PriorFit
    calibration: Calibration
    scale: float                # of the chart's signals


@dataclass(frozen=True)
class _Errors:
    """What the signals (n, K) of surfaces are off by: factors, and mirrored light that is added."""

    factors: np.ndarray         # (n, K)
    added: np.ndarray           # (n, 1)


def _errors(shoot: Shoot, count: int, bands: int, rng: np.random.Generator) -> _Errors:
    plane = 1 + PLANE_ERROR * rng.standard_normal((count, 1))
    return _Errors(plane * (1 + shoot.noise * rng.standard_normal((count, bands))),
                   draw_gloss(None, count, rng)[:, None])


def _fit(shoot: Shoot, curves: np.ndarray, lamp: np.ndarray, rng: np.random.Generator) -> _Photo:
    """The photo by curves (K, P) under a lamp (P,)."""
    signal = shoot.reflectances @ response_matrix(FINE_GRID, curves, lamp).T
    scale = 1 / signal.max()
    signal = signal * scale * (1 + shoot.noise * rng.standard_normal(signal.shape))
    patches, bands = signal.shape
    samples = PatchSamples(signal, np.zeros((patches, bands, bands)), np.ones(patches),
                           0 * signal, 0 * signal)
    stated = not isinstance(shoot.light, UnknownLight)
    photo = chart_equations(samples, shoot.reflectances, lamp if stated else np.ones_like(lamp),
                            np.full(patches, np.pi), FINE_GRID, positions=shoot.positions)
    if isinstance(shoot.light, UnknownLight):
        products = fit_products([photo], shoot.cameras, lamps_like(shoot.light), FINE_GRID,
                                shoot.light.words)
        fit, posterior = products.fit, products.light
        light = Spectrum(FINE_GRID, np.ones(FINE_GRID.nm.size), Quantity.RELATIVE, "products")
    else:
        fit, posterior, light = fit_with_prior([photo], shoot.cameras, FINE_GRID), None, shoot.light
    return _Photo(fit, Calibration(fit.sensitivity, light, None, np.zeros((bands, bands)), (),
                                   light_posterior=posterior), scale)


def _recovered(photo: _Photo, products: np.ndarray, truth: np.ndarray, off: _Errors,
               prior: LogitMixture) -> tuple[list[np.ndarray], SurfaceSignals]:
    """RMSE, width and share inside (n,) of surfaces (n, 61) seen by true products (K, P), and their
    signals with errors by cause.
    """
    exact = response_matrix(FINE_GRID, products, np.ones(FINE_GRID.nm.size))
    white = photo.fit.photos[0].white
    signal = photo.scale * truth @ TO_FINE.T @ exact.T * off.factors / white.level + off.added
    response = relative_response(photo.calibration, FINE_GRID)
    count, bands = signal.shape
    estimate = truth.mean(axis=0) * np.ones_like(truth)
    for _ in range(2):
        signals = SurfaceSignals(
            tuple(f"{number}" for number in range(count)), (False,) * count, FINE_GRID,
            estimate @ TO_FINE.T, default_band_names(bands), np.zeros(bands, int), response,
            signal, (), (gloss_states(None, [""] * bands),) * count)
        signals = with_errors(signals, {
            SENSITIVITIES: sensitivity_covariance([photo.calibration], signals),
            WHITE: proportional_covariance(signal, white.covariance[:bands, :bands]),
            DISAGREEMENT: proportional_covariance(signal,
                                                  photo.fit.patch_error.among_bands(bands)),
            SAMPLE_PLANE: _of_plane(signal)})
        judged = _judged(prior, response, signal, {error.cause: error.covariance
                                                   for error in signals.errors}, truth)
        estimate = judged[0]
    return list(judged[1:]), signals


def _exact(shoot: Shoot, products: np.ndarray, truth: np.ndarray, off: _Errors,
           prior: LogitMixture) -> list[np.ndarray]:
    """The same figures with products and white known."""
    response = response_matrix(FINE_GRID, products, np.ones(FINE_GRID.nm.size))
    response = response / white_signal(response)[:, None]
    signals = truth @ TO_FINE.T @ response.T * off.factors + off.added
    noise = (shoot.noise * signals)[:, :, None] ** 2 * np.eye(len(response))
    return list(_judged(prior, response, signals, {
        PHOTO_NOISE: noise, SAMPLE_PLANE: _of_plane(signals)}, truth)[1:])


def _of_plane(signals: np.ndarray) -> np.ndarray:
    """Covariance (n, K, K) of signals (n, K) by the plane of samples."""
    return proportional_covariance(signals, np.full((signals.shape[1],) * 2, PLANE_ERROR**2))


def _judged(prior: LogitMixture, response: np.ndarray, signals: np.ndarray,
            causes: Mapping[str, np.ndarray], truth: np.ndarray) -> tuple[np.ndarray, ...]:
    """Mean (n, 61) of each surface, then RMSE, width and share inside (n,); nothing is known of
    its gloss.
    """
    coarse, errors = response @ TO_FINE, split_errors(signals, causes)
    with threadpool_limits(1, "blas"):      # threads within small products would only wait
        drawn = posteriors_in_states(
            prior, coarse, signals, errors.absolute, gloss_states(None, [""] * len(response)),
            relative=errors.relative).marginals(prior, coarse)
        mean, (lower, upper) = mean_and_spread(drawn)[0], central_band(drawn, LEVEL)
    return (mean, np.sqrt(np.mean((mean - truth) ** 2, axis=1)),
            np.mean(upper - lower, axis=1), ((lower <= truth) & (truth <= upper)).mean(axis=1))


def _advice(shoot: Shoot, taken: Sequence[tuple[_Photo, SurfaceSignals, np.ndarray]],
            hand: LampsAtHand, prior: LogitMixture) -> tuple[Advice, ...]:
    """What further photos bring, the best first; of each photo that was simulated: the fit, and
    signals and spectra (n, 61) of surfaces.
    """
    at_hand = [photos_at_hand(*curves_and_light(photo.calibration), hand) for photo, _, _ in taken]
    before = _outlook(shoot, taken, [[] for _ in taken], prior)

    def after(action: str, chosen: Sequence[int]) -> Advice:
        photos = [at_hand[0][index] for index in chosen]
        stops = np.mean([[further[index].stops for index in chosen] for further in at_hand], axis=0)
        return advice(action, before, _outlook(shoot, taken, [
            [further[index] for index in chosen] for further in at_hand], prior),
            " and ".join(photo.name for photo in photos), exposure_words([
                replace(photo, stops=float(each)) for photo, each in zip(photos, stops,
                                                                         strict=True)]))
    order = {photo.name: index for index, photo in enumerate(at_hand[0])}
    singles = [after(GEL if name in hand.filters else SECOND_LAMP, [index])
               for name, index in order.items()]
    gels = sorted((one for one in singles if one.action == GEL), key=lambda one: one.width_after)
    best = [order[one.subject] for one in gels[:PAIRED]]
    pairs = [after(TWO_GELS, [first, second]) for number, first in enumerate(best)
             for second in best[number + 1:]]
    return ranked([*singles, *pairs])


def _outlook(shoot: Shoot, taken: Sequence[tuple[_Photo, SurfaceSignals, np.ndarray]],
             further: Sequence[Sequence[FurtherPhoto]], prior: LogitMixture) -> Outlook:
    """Means over the simulated photos, each with further ones."""
    return Outlook(*np.mean([_errors_after(shoot, *one, photos, prior)
                             for one, photos in zip(taken, further, strict=True)], axis=0).tolist())


def _errors_after(shoot: Shoot, photo: _Photo, signals: SurfaceSignals, truth: np.ndarray,
                  photos: Sequence[FurtherPhoto], prior: LogitMixture) -> tuple[float, float]:
    """Mean width and colour error of some of the surfaces (n, 61) in a photo and further ones."""
    white = white_of_bands(*curves_and_light(photo.calibration))
    some = range(0, len(truth), max(len(truth) // FEW, 1))
    measured = [without_states(SpectralMeasurement(
        FINE_GRID, signals.response, signals.signal[index],
        np.sum([error.covariance[index] for error in signals.errors], axis=0),
        signals.states[index])) for index in some]
    # of more bands each surface has a choice of its own
    surfaces = [Surface(signals, index, photo.calibration, shoot.reflectances,
                        photo.fit.patch_error.own)
                for index in some] if len(white) <= FEW_BANDS else None
    response, _, errors = joined_errors(measured, truth[some] @ TO_FINE.T, photos, white, surfaces)
    with threadpool_limits(1, "blas"):      # threads within small products would only wait
        return _simulated_errors(prior, response, errors, truth[some])


def _simulated_errors(prior: LogitMixture, response: np.ndarray, errors: Errors,
                      spectra: np.ndarray) -> tuple[float, float]:
    """Mean width of the bands of spectra (T, 61) from simulated signals, and root mean square
    CIEDE2000 of their means.

    Parameters
    ----------
    prior : LogitMixture
    response : (J, 301) array
        Of the bands to reflectances; rows sum to 1.
    errors : Errors
        Of T signals.
    spectra : (T, 61) array
    """
    coarse = response @ TO_FINE
    signals = spectra @ coarse.T
    values, vectors = np.linalg.eigh(errors.total(signals))
    # of all roots the symmetric one: like covariances give like errors, whatever their eigenvectors
    root = (vectors * np.sqrt(np.maximum(values, 0))[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    normal = np.random.default_rng(SEED).standard_normal((len(spectra), len(coarse)))
    off = (root @ normal[..., None])[..., 0]
    mean, ((lower, upper),) = calibrated_bands(prior, posterior(
        prior, coarse, signals + off, errors.absolute, relative=multiplying(errors.relative)),
        (LEVEL,))
    colours = [reflectance_to_lab(PRIOR_GRID.nm, each) for each in (mean, spectra)]
    return float(np.mean(upper - lower)), float(np.sqrt(np.mean(ciede2000(*colours)**2)))
