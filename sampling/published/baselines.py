"""Other ways to a spectrum from the same signal, to compare with: single guesses, and the paper's
ranking and refinement.

Other ways to a spectrum from the same signal, to compare with: single guesses, and a greedy
sampler.

The single guesses (colour-science) take tristimulus values. A camera's signal is turned into them
by the least-squares matrix over the test reflectances, which is what a raw converter does; for the
CIE observer itself nothing is lost.
"""


from __future__ import annotations

from dataclasses import replace

import numpy as np

from spectrabox.radiometry import colour_science, errors, grid
from spectrabox.radiometry.records import spectra
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.sampling import spectral_measurement
from spectrabox.sampling.further.more_measurements import MoreMeasurement, measured_rows
from spectrabox.sampling.polytope.refinement import lifting, residual_directions
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.published.per_axis_box import draw_in_box

ATTEMPTS = 20_000


def baseline_spectra(measurement: spectra.SpectralMeasurement,
                     methods: tuple[str, ...] = colour_science.METHODS) -> dict[str, np.ndarray]:
    """Spectrum (61,) of every method for one signal.

    Parameters
    ----------
    measurement : SpectralMeasurement
    methods : tuple of str
        Of `colour_science.METHODS`.

    Raises
    ------
    InputError
        If the signal has fewer than three bands.
    """
    xyz = to_tristimulus(spectral_measurement.response_on(measurement, PRIOR_GRID),
                         measurement.signal[None])[0]
    return {method: colour_science.upsampled(xyz, PRIOR_GRID, method) for method in methods}


def to_tristimulus(relative_response: np.ndarray, signals: np.ndarray) -> np.ndarray:
    """Tristimulus values (n, 3), white being 1, from signals (n, K) by a matrix that keeps white
    white.

    Parameters
    ----------
    relative_response : (K, 61) array
        Rows summing to 1.
    signals : (n, K) array
        Relative to white.

    Raises
    ------
    InputError
        If there are fewer than three bands.
    """
    if len(relative_response) < 3:
        raise errors.InputError(
            f"{len(relative_response)} bands give no colour; the baselines need three "
            "or more")
    known = np.concatenate([*test_reflectances(PRIOR_GRID).values(),
                            np.ones((1000, PRIOR_GRID.nm.size))])
    matrix = np.linalg.lstsq(known @ relative_response.T,
                             known @ colour_science.observer_response(PRIOR_GRID).T, rcond=None)[0]
    return np.clip(signals @ matrix, 0, None)


def greedy_draws(operator: spectral_measurement.MeasurementOperator, draws: int,
                 seed: int) -> tuple[np.ndarray, float]:
    """Draws (<= T, N) in the manner of Belcour et al. (2023) and the share of attempts that gave
    one.

    Our reading: coefficients are drawn one after the other, uniformly in the interval that the K
    last ones can still make up for one at a time; the K last are solved for, and the draw is
    dropped where they leave [0, 1]. It fails on some signals that can be reached and its draws are
    not uniform: kept to be compared with.

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N), signal ``y`` (K,) relative to white, and its noise covariance (K, K).
    draws : int
        T, at least 1.
    seed : int
        Of the random generator; the same seed gives the same draws bit for bit.
    """
    rng = np.random.default_rng(seed)
    bands, count = operator.A.shape
    # the K in the middle are solved for
    order = np.argsort(np.abs(np.arange(count) - (count - 1) / 2))
    solved, free = order[:bands], order[bands:]
    c = np.empty((ATTEMPTS, count))
    remaining = np.tile(operator.y, (ATTEMPTS, 1))
    for position, j in enumerate(free):
        later = np.r_[free[position + 1:], solved]
        most = operator.A[:, later].sum(axis=1)
        column = operator.A[:, j]
        seen = column > 1e-12
        with np.errstate(divide="ignore", invalid="ignore"):
            high = np.nanmin(np.where(seen, remaining / column, np.inf), axis=1)
            low = np.nanmax(np.where(seen, (remaining - most) / column, -np.inf), axis=1)
        low, high = np.clip(low, 0, 1), np.clip(high, 0, 1)
        c[:, j] = low + np.maximum(high - low, 0) * rng.random(ATTEMPTS)
        remaining -= c[:, j, None] * operator.A[:, j]
    c[:, solved] = np.linalg.solve(operator.A[:, solved], remaining.T).T
    kept = c[np.all((c >= 0) & (c <= 1), axis=1)]
    return kept[:draws], len(kept) / ATTEMPTS


# ---- what the paper does with more measurements and more coefficients, for comparison ------------


def ranked(samples: spectra.SpectrumSamples, base: spectra.SpectralMeasurement,
           more: list[MoreMeasurement], twice: np.ndarray | None,
           keep: int) -> spectra.SpectrumSamples:
    """The ``keep`` draws nearest to all further measurements (Eq. 9) and to light reflected twice
    (Eq. 10).

    Parameters
    ----------
    samples : SpectrumSamples
        T draws.
    base : SpectralMeasurement
        What the photo says of the surface.
    more : list of MoreMeasurement
        Further measurements of the same surface.
    twice : (K,) array, optional
        Signal of light reflected twice.
    keep : int
        How many.

    Raises
    ------
    InputError
        If there is nothing to rank by, or fewer draws than are to be kept.
    """
    seen, measured = [], []
    for _, further in more:
        rows, values, _ = measured_rows(base, further)
        seen.append(samples.spectra @ rows.T)
        measured.append(values)
    if twice is not None:
        seen.append(samples.spectra**2 @ spectral_measurement.response_on(base, PRIOR_GRID).T)
        measured.append(twice)
    if not seen:
        raise errors.InputError(
            "--best ranks draws by further measurements; give some, or leave it out")
    kept = best_by_signals(np.hstack(seen), np.concatenate(measured), keep)
    return replace(samples, spectra=samples.spectra[kept], coefficients=samples.coefficients[kept],
                   effective_samples=float(keep),
                   method=f"{samples.method}, best {keep} of {len(samples.spectra)}",
                   outcome=spectra.Outcome.RANKED,
                   findings=(*samples.findings, spectra.Outcome.RANKED.finding()))


def best_by_signals(signals: np.ndarray, measured: np.ndarray, keep: int) -> np.ndarray:
    """Indices (keep,) of the draws whose signals (T, ...) come nearest to the measured ones (Eqs.
    9, 10).

    Ranking keeps the best of the draws however badly they fit; `conditioning` makes every draw fit.

    Parameters
    ----------
    signals : (T, ...) array
        Of the draws.
    measured : (...) array
    keep : int
        How many.

    Raises
    ------
    InputError
        If fewer than one or more than all are to be kept.
    """
    loss = np.sum((signals - measured).reshape(len(signals), -1)**2, axis=1)
    if not 1 <= keep <= loss.size:
        raise errors.InputError(
            f"the best {keep} of {loss.size} draws were asked for; ask for 1 to "
            f"{loss.size}")
    return np.argsort(loss, kind="stable")[:keep]


def refined_as_published(measurement: spectra.SpectralMeasurement, coarse: int, fine: int,
                         draws: int, seed: int) -> np.ndarray:
    """Draws (T, fine) around one lifted solution in the box of the residual directions (Eqs. 11-16
    read literally).

    Parameters
    ----------
    measurement : SpectralMeasurement
    coarse : int
        Number of coefficients.
    fine : int
        Larger number, whose knots contain the coarse ones.
    draws : int
        T, at least 1.
    seed : int
        Of the random generator; the same seed gives the same draws bit for bit.

    Raises
    ------
    InputError
        If the knots do not nest, or nothing is left to draw along.
    """
    operator = spectral_measurement.spline_operator(measurement, coarse)
    solution = spectral_measurement.nearest_coefficients(operator.A, operator.y)
    T = lifting(coarse, fine)
    start = np.clip(T @ solution, 0, 1)
    fine_basis = grid.basis_matrix(measurement.grid.nm, fine)
    directions = residual_directions(measurement.relative_response @ fine_basis, T)
    if not directions.shape[1]:
        raise errors.InputError(
            f"refining {coarse} coefficients to {fine} leaves no direction that the "
            "camera does not see; refine to more")
    coefficients, _ = draw_in_box(start, directions, draws, seed)
    return coefficients
