"""What a further photo under another lamp or through filters would add to what was measured.

Spectra are drawn from what is known of a surface, the photos of each are simulated with the errors
that they would have, and the spectrum behind them is estimated as it will be: the forecast is the
mean over draws.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from spectrabox.measure.more_bands.further_photos import FurtherPhoto
from spectrabox.measure.more_bands.joined_errors import Surface, joined_errors
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.sampling.further.planner import PHOTO_MINUTES, PlannedStep
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture
from spectrabox.sampling.prior.mixture_posterior import (
    calibrated_bands,
    mean_and_spread,
    posterior,
)

LEVEL = 0.95
SPECTRA = 24            # drawn, of which a further photo is simulated
TO_FINE = interpolation_matrix(PRIOR_GRID.nm, FINE_GRID.nm)


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
    surfaces = None if known.surface is None else [known.surface]
    steps = []
    with threadpool_limits(1, "blas"):      # threads within small products would only wait
        spectra = _likely(prior, measured, known.spectra)
        rmse_before, width_before = simulated_errors(prior, measured.relative_response,
                                                     measured.noise_covariance, spectra)
        centre = spectra.mean(axis=0) @ TO_FINE.T
        for photos in chosen:
            response, covariances = joined_errors([measured], centre[None], photos, white, surfaces)
            rmse, width = simulated_errors(prior, response, covariances[0], spectra)
            dark = [number * len(white) + int(band) + 1 for number, photo in enumerate(photos)
                    for band in photo.dark]
            steps.append(SecondPhoto(
                " and ".join(photo.name for photo in photos), width_before, width, rmse_before,
                rmse, PHOTO_MINUTES * len(photos), tuple(photo.stops for photo in photos),
                tuple(dark)))
    return steps


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
