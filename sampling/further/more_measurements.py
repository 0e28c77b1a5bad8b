"""More measurements of the same surface: readings, bands, spectrometer spots, other photos, other
patches.

All become rows of one measurement, which every draw then obeys (conditioning.py). One that
contradicts the others is named: outright where no reflectance between 0 and 1 gives all of them, as
doubtful where the prior finds it hard to believe.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import SpectralMeasurement
from spectrabox.sampling.further.conditioning import (
    CONTRADICTION,
    Reading,
    condition,
    same_bands,
    same_material,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture
from spectrabox.sampling.prior.mixture_posterior import with_floor
from spectrabox.sampling.prior.signal_posterior import solve_posterior
from spectrabox.sampling.spline_measurement import nearest_coefficients, response_on

DOUBT_DRAWS = 400


@dataclass(frozen=True)
class MoreMeasurement:
    """One more thing that was measured of the surface: readings, or another measurement by a
    camera.
    """

    name: str
    readings: tuple[Reading, ...] = ()
    measurement: SpectralMeasurement | None = None


def joined(base: SpectralMeasurement, more: list[MoreMeasurement]) -> SpectralMeasurement:
    """One measurement of all.

    Parameters
    ----------
    base : SpectralMeasurement
        What the photo says of the surface.
    more : list of MoreMeasurement
        Further measurements of the same surface.

    Raises
    ------
    InputError
        If some cannot be true together; they are named.
    """
    photos = [base]        # one a camera and light: what came twice is averaged
    for further in more:
        photo = further.measurement
        if photo is None:
            continue
        twin = next((index for index, known in enumerate(photos) if same_bands(known, photo)), None)
        try:
            if twin is None:
                photos.append(photo)
            else:
                photos[twin] = same_material([photos[twin], photo])
        except InputError as error:
            raise InputError(f"{further.name}: {error}") from None
    readings = [reading for further in more for reading in further.readings]
    whole = condition(same_material(photos), readings)
    check_possible(base, more)
    return whole


def check_possible(base: SpectralMeasurement, more: list[MoreMeasurement]) -> None:
    """Raise where no reflectance between 0 and 1 gives all measurements within their errors (chance
    1 in a million).

    Parameters
    ----------
    base : SpectralMeasurement
        What the photo says of the surface.
    more : list of MoreMeasurement
        Further measurements of the same surface.

    Raises
    ------
    InputError
        Naming the measurements without which the rest would agree.
    """
    if not more or _possible(base, more):
        return
    blamed = [further.name for index, further in enumerate(more)
              if _possible(base, more[:index] + more[index + 1:])]
    names = " or ".join(blamed) if blamed else ", ".join(further.name for further in more)
    raise InputError(f"{names} contradicts the other measurements: no reflectance between 0 and 1 "
                     "gives all of them within their errors; measure again, state larger errors, "
                     "or leave it out")


def doubtful(base: SpectralMeasurement, more: list[MoreMeasurement], prior: LogitMixture,
             seed: int) -> list[str]:
    """Sentences on measurements that lie far from what the others and the prior let expect (1 in a
    million).

    Parameters
    ----------
    base : SpectralMeasurement
        What the photo says of the surface.
    more : list of MoreMeasurement
        Further measurements of the same surface.
    prior : LogitMixture
    seed : int
        Of the random generator; the same seed gives the same draws bit for bit.
    """
    sentences = []
    for index, further in enumerate(more):
        rest = joined(base, more[:index] + more[index + 1:])
        rows, values, covariance = measured_rows(base, further)
        expected = solve_posterior(prior, rest).draws(DOUBT_DRAWS, seed) @ rows.T
        spread = np.atleast_2d(np.cov(expected, rowvar=False)) + with_floor(covariance)
        away = values - expected.mean(axis=0)
        if away @ np.linalg.solve(spread, away) > chdtri(len(away), CONTRADICTION):
            worst = int(np.argmax(np.abs(away)))
            sentences.append(f"{further.name} is hard to believe beside the others: "
                             f"{values[worst]:.3g} was measured and "
                             f"{expected[:, worst].mean():.3g} +- "
                             f"{np.sqrt(spread[worst, worst]):.2g} expected.")
    return sentences


def _possible(base: SpectralMeasurement, more: list[MoreMeasurement]) -> bool:
    parts = [(response_on(base, PRIOR_GRID), base.signal, base.noise_covariance),
             *(measured_rows(base, further) for further in more)]
    rows, targets = [], []
    for part, values, covariance in parts:
        whiten = np.linalg.inv(np.linalg.cholesky(with_floor(covariance)))
        rows.append(whiten @ part)
        targets.append(whiten @ values)
    A, y = np.vstack(rows), np.concatenate(targets)
    misfit = np.sum((A @ nearest_coefficients(A, y) - y)**2)
    return bool(misfit < chdtri(y.size, CONTRADICTION))


def measured_rows(base: SpectralMeasurement,
                  more: MoreMeasurement) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows (J, 61) on the prior's wavelengths, values (J,) and covariance (J, J) of one more
    measurement.

    Parameters
    ----------
    base : SpectralMeasurement
        Whose grid readings are put on.
    more : MoreMeasurement
    """
    if more.measurement is not None:
        photo = more.measurement
        return response_on(photo, PRIOR_GRID), photo.signal, photo.noise_covariance
    both, bands = condition(base, list(more.readings)), len(base.signal)
    return (response_on(both, PRIOR_GRID)[bands:], both.signal[bands:],
            both.noise_covariance[bands:, bands:])
