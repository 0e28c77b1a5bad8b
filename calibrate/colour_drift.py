"""Whether one kind of light falls on a chart: colours of its patches that drift from side to side.

Two lamps of different spectra from two sides change the colour of the light over the chart, and a
fit with one light cannot follow. Its residuals r = signal - prediction then hold a part D d, with

    D(patch, band; axis, contrast) = signal(patch, band) position(patch, axis) contrast(band)

for contrasts between bands that sum to 0. With R the covariance of the patches' errors, J and P
derivatives and covariance of all that was fitted, Cov(r) = R - J P J^T [Rasmussen & Williams 2006,
Sec. 2.7], so that

    S = D^T R^-1 r,    Cov(S) = D^T (R^-1 - R^-1 J P J^T R^-1) D,    d = Cov(S)^-1 S

and S Cov(S)^-1 S is a chi-square of as many degrees of freedom as d has entries. How large the
errors of colours are is taken from what d leaves of the residuals: an F statistic.
"""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spectrabox.calibrate import chart_equations
from spectrabox.calibrate.prior import curve_posterior, prior_fit

FALSE_ALARM = 1e-3           # probability by chance, below which a drift is beyond it
MIN_DRIFT = 0.01             # of the ratio of two bands, across the chart: less does no harm
MIN_KEPT = 0.3               # share of a drift's information that a fit is taken to leave at least
MIN_SPREAD = 0.05            # of the squared errors of colours, over those that were fitted


def colour_drift(posterior: prior_fit.CurvePosterior,
                 photos: Sequence[chart_equations.ChartEquations],
                 number: int) -> tuple[float, float] | None:
    """Linear drift of the light's colour over the chart of one of the photos of a fit.

    Parameters
    ----------
    posterior : CurvePosterior
    photos : sequence of ChartEquations
        In the order in which the posterior was made.
    number : int
        Of the photo.

    Returns
    -------
    size : float
        Largest relative change of the ratio of two bands, side to side.
    chance : float
        Probability of so much under one kind of light.

    None in place of both where the positions of the patches are not known: the light on each was
    given.
    """
    photo = photos[number]
    if photo.field_terms.shape[1] < 2:
        return None
    patches, bands = photo.signal.shape
    size = bands * posterior.basis.shape[1]
    mean, covariance = curve_posterior.mixture_moments(posterior.weights, posterior.means,
                                                       posterior.covariances)
    start, stop = size + chart_equations.nuisance_starts(photos)[number:number + 2]
    signal, derivatives = chart_equations.predicted_signal(
        photo, chart_equations.unlit_design(photo, posterior.basis),
        np.maximum(mean[:size], 0).reshape(bands, -1), mean[start], mean[start + 1:stop],
        photo.modes(posterior.basis))
    states = np.r_[:size, start:stop]
    fitted = derivatives @ covariance[np.ix_(states, states)] @ derivatives.T \
        / posterior.widening**2
    residuals = photo.signal.ravel() - signal
    noise = chart_equations.noise_of_photos([photo], posterior.best_error)
    weights = np.linalg.inv(noise)

    at = start + 1 + photo.field_terms.shape[1]
    glare = mean[at:at + bands] if photo.glare else np.zeros(bands)
    contrasts = np.linalg.svd(np.eye(bands) - 1 / bands)[0][:, :bands - 1]
    along = photo.field_terms[:, :2]        # x and y, of zero mean and unit spread
    drifts = np.einsum("ik,ia,kc->ikac", signal.reshape(patches, bands) - glare, along,
                       contrasts).reshape(residuals.size, -1)
    weighted = weights @ drifts
    # Cov(S) over D^T R^-1 D: no less than MIN_KEPT, for P is that of a mixture and is rough
    root = np.linalg.cholesky(drifts.T @ weighted)
    whitened = np.linalg.solve(root, weighted.T)
    kept, axes = np.linalg.eigh(np.eye(len(root)) - whitened @ fitted @ whitened.T)
    moved = axes.T @ whitened @ residuals / np.maximum(kept, MIN_KEPT)
    chi_square = float(moved**2 @ np.maximum(kept, MIN_KEPT))
    drift = np.linalg.solve(root.T, axes @ moved).reshape(2, -1) @ contrasts.T

    # squared errors of colours alone: lightness errs by a cause of its own
    level = np.maximum(photo.signal, chart_equations.DARK_SHARE * photo.signal.max(axis=0))
    colours = np.einsum("ij,ik,kc->icjk", np.eye(patches), 1 / level, contrasts).reshape(
        -1, residuals.size)
    unit = np.linalg.solve(np.linalg.cholesky(colours @ noise @ colours.T), colours)
    free = float(np.maximum(1 - np.linalg.eigvalsh(unit @ fitted @ unit.T), 0).sum()) \
        - drift.size - np.count_nonzero(~photo.readable)    # a clipped band takes one of its patch
    spread = (np.sum((unit @ residuals) ** 2) - chi_square) / free if free > 0 else 1.0
    statistic = chi_square / drift.size / max(spread, MIN_SPREAD)
    across = drift * np.ptp(along, axis=0)[:, None]
    return float(np.ptp(across, axis=1).max()), _chance(statistic, drift.size, max(free, 1.0))


def _chance(statistic: float, freedom: int, free: float) -> float:
    """Probability of an F statistic as large."""
    from scipy.special import fdtrc  # a third of a second to import
    return float(fdtrc(freedom, free, statistic))
