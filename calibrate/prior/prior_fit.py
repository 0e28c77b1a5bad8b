"""Camera sensitivities from chart photos and the prior of measured cameras, as one joint estimate.

Unknown are the curves of all bands together, and of every photo its exposure, its illumination
field and its glare. For each family of the prior and each plausible size of the model error (chart
against reference, field, light) the photo's equations are linearised about the best answer
(Gauss-Newton, as in an iterated Kalman filter), which gives a Gaussian posterior and how well that
family explains the photo (its evidence). The posterior is their mixture, worked out in the state of
the prior (the logarithm of the curves) and handed on in the curves.
"""
from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product
from typing import Annotated, NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from spectrabox.calibrate import chart_equations, copy_errors, held_out_patches
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.prior.evidence import log_densities
from spectrabox.radiometry.covariance import block_diagonal
from spectrabox.radiometry.errors import CalibrationError
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.radiometry.shaped import Record

MODEL_ERRORS = (0.0003, 0.002, 0.004, 0.008, 0.016, 0.032, 0.064)   # relative; which is inferred
LINEARISED_AT = 0.008
# standard deviation of each band's log gain beyond the prior's, and its share: most photos are as
# the sensor saw them, some were white-balanced
GAINS = ((0.05, 0.8), (0.4, 0.2))
EXPOSURE_SD = 3.0            # of log exposure about the first guess: nothing is known
MAX_ITERATIONS = 10
CONVERGED = 0.1              # largest change of a signal an iteration, in standard errors
MAX_LOG_STEP = 1.0           # of the logarithm of a curve an iteration
MAX_STEP = 0.5               # of a log exposure or field term an iteration: exp() of more runs away
NEGLIGIBLE = 1e-4            # share of a component below which it is left out


@dataclass(frozen=True, eq=False)
class CurvePosterior(Record):
    """Mixture of Gaussians on the stacked curves (D = K N) and on the nuisances (U) of all photos.

    The photo never tells exposure from sensitivity: curves are scaled so that, at an exposure of 1,
    the first chart's whole signal is what the mean of the prior would give. They are not yet
    divided by their largest value.
    """

    basis: Annotated[np.ndarray, "P N"]
    weights: Annotated[np.ndarray, "C"]
    means: Annotated[np.ndarray, "C Z"]             # Z = D + U
    covariances: Annotated[np.ndarray, "C Z Z"]
    families: Annotated[np.ndarray, "F"]            # posterior probability of each of the prior's
    model_error: chart_equations.PatchError                         # posterior mean
    log_evidence: float
    best_family: int                                # of the component that weighs most
    best_gain_sd: float
    best_error: chart_equations.PatchError
    widening: float                                 # factor in the standard errors of the best
    lights: tuple[LightDesign, ...] = ()            # of every photo; empty: as stated


class LightDesign(NamedTuple):
    """How a photo's light may depart from what is stated."""

    terms: np.ndarray           # (N, J) of its logarithm by each departure, at the curves' nm
    own: slice                  # of the departures in the state; one for photos under one light

    def logarithm(self, state: np.ndarray) -> np.ndarray:
        """Of the true light over the stated one (N,), by a state (Z,)."""
        return np.asarray(self.terms @ state[self.own])


class Design(NamedTuple):
    """A photo's signals by the curves (I, N), see ``unlit_design``, and its light."""

    matrix: np.ndarray
    light: LightDesign


# a prediction of the signals that is linear in the state: its mean (Z,) and covariance (Z, Z)
# beforehand, derivatives (Y, Z), and the data (Y,) of y = J state
Linearised = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def posterior_of_curves(photos: list[chart_equations.ChartEquations], prior: CameraPrior,
                        grid: WavelengthGrid, *,
                        model_errors: tuple[float, ...] = MODEL_ERRORS) -> CurvePosterior:
    """Posterior of the curves, given the photos and the measured cameras.

    Parameters
    ----------
    photos : list of ChartEquations
        Of one camera; charts, lights and exposures may differ.
    prior : CameraPrior
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    model_errors : tuple of float
        Relative errors of each band of a patch against the model that are held possible, equally
        likely beforehand; each is tried with ``COMMON_ERRORS`` of all bands.

    Raises
    ------
    CalibrationError
        If no component of the prior has a finite evidence.
    """
    basis = interpolation_matrix(prior.nm, grid.nm)
    designs = _designs(photos, basis)
    # a prior without cameras knows nothing of gains either
    gains = GAINS if prior.between.size else ((0.0, 1.0),)
    # the last component first: it is the widest, and where it ends the others are nearly done
    choices = list(product(range(len(prior.weights))[::-1], gains))
    models, logs = _linear_models(photos, designs, prior, choices, model_errors)
    errors = [chart_equations.PatchError(own, common)
              for own, common in product(model_errors, chart_equations.COMMON_ERRORS)]
    if not np.isfinite(logs.max()):
        raise CalibrationError("the signals of the patches span too many orders of magnitude to be "
                               "fitted; check the photo's black level and that the patches are "
                               "those of the chart")
    weights = np.exp(logs - logs.max())
    log_evidence = float(logs.max() + np.log(weights.sum()))
    weights /= weights.sum()            # of each model and error
    kept = np.argwhere(weights > NEGLIGIBLE)
    solved = [_in_curves(prior, *_condition(
        models[model], chart_equations.noise_of_photos(photos, errors[error]), prior),
        designs, photos) for model, error in kept]
    families = np.array([family for family, _ in choices])
    widening = prior.widening[prior.level[families]]
    best, best_error = np.unravel_index(np.argmax(weights), weights.shape)
    best_family, (best_gain_sd, _) = choices[best]
    return CurvePosterior(
        basis, weights[tuple(kept.T)] / weights[tuple(kept.T)].sum(),
        np.array([mean for mean, _ in solved]),
        np.array([covariance for _, covariance in solved])
        * widening[kept[:, 0], None, None] ** 2,
        np.bincount(np.repeat(families, len(errors)), weights.ravel(),
                    minlength=len(prior.weights)),
        chart_equations.mean_error(weights.ravel(), errors * len(models)), log_evidence,
        best_family, best_gain_sd, errors[best_error], float(widening[best]),
        tuple(light for _, light in designs) if any(light.terms.size for _, light in designs)
        else ())


def _linear_models(photos: list[chart_equations.ChartEquations], designs: list[Design],
                   prior: CameraPrior, choices: list[tuple[int, tuple[float, float]]],
                   model_errors: tuple[float, ...]) -> tuple[list[Linearised], np.ndarray]:
    """The prediction of the signals for each choice of a family and a spread of gains, and the log
    weights (models, errors) with each size of the model error, by bands and in common.
    """
    own_noises = np.array([
        chart_equations.noise_of_photos(photos, chart_equations.PatchError(own))
        for own in model_errors
    ])
    patterns = chart_equations.common_patterns(photos)
    spreads = prior.covariances()
    models: list[Linearised] = []
    log_weights, guess = [], None
    for family, (gain_sd, share) in choices:
        covariance, start = _joint_prior(prior, spreads[prior.level[family]], family, gain_sd,
                                         photos, designs)
        jacobian, linear, guess = _linearise(photos, designs, start, covariance, prior, guess)
        projected = _project(jacobian, _project(jacobian, covariance, prior).T, prior)
        models.append((start, covariance, jacobian, linear))
        log_share = float(np.log(prior.weights[family] * share))
        log_weights.append([log_share + log_density for own_noise in own_noises
                            for log_density in log_densities(
                                projected + own_noise, linear - jacobian @ start, patterns,
                                chart_equations.COMMON_ERRORS)])
    return models, np.array(log_weights)


def held_out_signals(
    photos: list[chart_equations.ChartEquations], prior: CameraPrior, grid: WavelengthGrid,
    posterior: CurvePosterior, excluded: chart_equations.ChartEquations | None = None
) -> tuple[list[np.ndarray], float, held_out_patches.PatchesWithout, copy_errors.Explained]:
    """Signals (I, K) of every photo, each patch predicted from all others; chi-square per datum;
    what fits without each say of the patches of the first photo; and the innovations.

    In closed form for the component of largest weight: the error of patch i is (Q^-1)_ii^-1 (Q^-1
    r)_i, with Q the covariance of the residuals r of the prior's prediction [Rasmussen & Williams
    2006, Eq. 5.12]. Chi-square per datum is r Q^-1 r over the number of signals that can be read:
    1 where photo, chart, light and prior agree within their errors.

    Parameters
    ----------
    photos, prior, grid
        As given to ``posterior_of_curves``.
    posterior : CurvePosterior
        Its result.
    excluded : ChartEquations or None
        Patches of the first photo that were in no fit; they come after its own.
    """
    designs = _designs(photos, posterior.basis)
    family = posterior.best_family
    covariance, start = _joint_prior(prior, prior.covariance(prior.level[family]), family,
                                     posterior.best_gain_sd, photos, designs)
    jacobian, linear, _ = _linearise(photos, designs, start, covariance, prior)
    projected = _project(jacobian, covariance, prior).T
    inverse = np.linalg.inv(_project(jacobian, projected, prior)
                            + chart_equations.noise_of_photos(photos, posterior.best_error))
    innovation = linear - jacobian @ start
    weighted = inverse @ innovation
    signals, row = [], 0
    for photo in photos:
        without = np.empty(photo.signal.shape)
        for patch in range(len(photo.signal)):
            block = (chart_equations.rows_of_patch(photos, patch) if photo is photos[0]
                     else np.arange(row, row + prior.bands))
            off = np.linalg.solve(inverse[np.ix_(block, block)], weighted[block])
            without[patch] = photo.signal[patch] - off[:prior.bands]
            row += prior.bands
        signals.append(without)
    widened = prior.widening[prior.level[family]] ** 2
    own = prior.means.shape[1] + 1 + chart_equations.nuisance_sd(photos[0]).size
    gain = projected @ inverse
    after, patches = covariance - gain @ projected.T, []

    def add(photo: chart_equations.ChartEquations, patch: int, state: np.ndarray,
            spread: np.ndarray) -> None:
        mean, moved = _in_curves(prior, state, spread, designs, photos)
        patches.append(
            held_out_patches.patch_moments(photo, patch, mean[:own], widened * moved[:own, :own],
                                           posterior.basis))

    for patch in range(len(photos[0].signal)):
        rows = chart_equations.rows_of_patch(photos, patch)
        add(photos[0], patch,
            start + projected @ held_out_patches.weights_without(inverse, weighted, rows),
            held_out_patches.covariance_without(after, gain, inverse, rows))
    for patch in range(0 if excluded is None else len(excluded.signal)):
        assert excluded is not None
        add(excluded, patch, start + projected @ weighted, after)
    without_each = held_out_patches.gathered([photos[0], *([] if excluded is None else [excluded])],
                                             posterior.basis, posterior.best_error, patches)
    readable = sum(np.count_nonzero(photo.readable) for photo in photos)
    return (signals, float(innovation @ weighted / readable), without_each,
            copy_errors.Explained(np.ones(1), weighted[None], inverse))


def _joint_prior(prior: CameraPrior, spread: np.ndarray, family: int, gain_sd: float,
                 photos: list[chart_equations.ChartEquations],
                 designs: list[Design]) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (Z, Z) and mean (Z,) of state and nuisances beforehand.

    The exposure starts where it fits best. ``spread`` (D, D) is the covariance of the family's
    states. Curves are scaled to the same whole signal of the first chart, so that exposure alone
    says how bright a photo is.
    """
    whole = _whole(designs, prior)
    centre = prior.means[family]
    factor = 1 / (whole @ prior.curves(centre))
    curves = prior.curves(centre) * factor
    mean = prior.state(curves)
    slope = prior.slope(mean)
    bands = curves.reshape(prior.bands, -1)
    moved = prior.slope(centre) * factor / slope  # derivative of the scaled state by the state
    gains = block_diagonal(*(gain_sd * band[:, None] for band in bands)) / slope[:, None]
    covariance = spread * np.outer(moved, moved) + gains @ gains.T
    # (1 - brighter seen) covariance (1 - brighter seen)^T: the whole signal does not vary
    brighter, seen = curves / slope, whole * slope
    covariance = covariance - np.outer(brighter, seen @ covariance)
    covariance = covariance - np.outer(covariance @ seen, brighter)
    exposures = [np.log(photo.signal.sum() / (design.matrix @ bands.T).sum())
                 for photo, design in zip(photos, designs, strict=True)]
    sds = [
        np.r_[photo.relative_exposure_sd or EXPOSURE_SD,
              chart_equations.nuisance_sd(photo)] for photo in photos
    ]
    sds[0][0] = EXPOSURE_SD
    linked = np.array([index == 0 or photo.relative_exposure_sd is not None
                       for index, photo in enumerate(photos)])
    nuisances = [np.r_[exposures[0] if tied else exposure, np.zeros(sd.size - 1)]
                 for exposure, sd, tied in zip(exposures, sds, linked, strict=True)]
    lights = np.ones(max(light.own.stop for _, light in designs) - designs[0].light.own.start)
    start = np.concatenate([mean, *nuisances, 0 * lights])
    total = np.diag(np.concatenate([np.zeros(mean.size), *(sd**2 for sd in sds), lights]))
    total[:mean.size, :mean.size] = covariance
    indices = mean.size + chart_equations.nuisance_starts(photos)[:-1][linked]
    others = 1 - np.eye(len(indices)) * (indices == indices[0])
    total[np.ix_(indices, indices)] += EXPOSURE_SD**2 * others
    return total, start


def _equations(photos: list[chart_equations.ChartEquations], designs: list[Design],
               state: np.ndarray, prior: CameraPrior) -> tuple[np.ndarray, np.ndarray]:
    """Predicted signals of all photos (Y,) and their derivatives (Y, Z)."""
    size = prior.means.shape[1]
    curves, slope = prior.curves(state[:size]), prior.slope(state[:size])
    signals, rows = [], []
    for photo, design, (start, stop) in zip(
            photos, designs, pairwise(size + chart_equations.nuisance_starts(photos)), strict=True):
        brighter, by_light = _brighter(state, design.light, prior.bands)
        signal, derivative = chart_equations.predicted_signal(
            photo, design.matrix, (curves * brighter).reshape(prior.bands, -1), state[start],
            state[start + 1:stop], photo.modes(interpolation_matrix(prior.nm, FINE_GRID.nm)))
        row = np.zeros((signal.size, state.size))
        row[:, :size] = derivative[:, :size] * (slope * brighter)
        row[:, start:stop] = derivative[:, size:]
        row[:, design.light.own] = (derivative[:, :size] * curves) @ by_light
        signals.append(signal)
        rows.append(row)
    return np.concatenate(signals), np.vstack(rows)


def _linearise(photos: list[chart_equations.ChartEquations], designs: list[Design],
               start: np.ndarray, covariance: np.ndarray, prior: CameraPrior,
               guess: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives J (Y, Z) at the best solution, the data (Y,) of the model y = J state, and that
    solution (Z,); ``guess`` (Z,) is where to begin.
    """
    measured = np.concatenate([photo.signal.ravel() for photo in photos])
    noise = chart_equations.noise_of_photos(photos, chart_equations.PatchError(LINEARISED_AT))
    sigma = np.sqrt(np.diag(noise))
    state, size = start if guess is None else guess, prior.means.shape[1]
    # exposures and field terms are logarithms, errors of filters are relative, glare is in the unit
    # of the signals
    logarithms = np.concatenate([
        np.r_[start:start + 1 + photo.field_terms.shape[1],
              stop - photo.filter_errors:stop] for (start, stop), photo in zip(
                  pairwise(size + chart_equations.nuisance_starts(photos)), photos, strict=True)
    ])
    for _ in range(MAX_ITERATIONS):
        predicted, jacobian = _equations(photos, designs, state, prior)
        linear = measured - predicted + jacobian @ state
        projected = _project(jacobian, covariance, prior)
        gain = np.linalg.solve(_project(jacobian, projected.T, prior) + noise,
                               linear - jacobian @ start)
        step = start + gain @ projected - state
        step /= max(1.0, np.abs(step[logarithms]).max() / MAX_STEP)
        if prior.floor is not None:
            step[:size] = np.clip(step[:size], -MAX_LOG_STEP, MAX_LOG_STEP)
        state = state + step
        if np.abs(jacobian @ step / sigma).max() < CONVERGED:
            break
    predicted, jacobian = _equations(photos, designs, state, prior)
    return jacobian, measured - predicted + jacobian @ state, state


def _project(jacobian: np.ndarray, covariance: np.ndarray, prior: CameraPrior) -> np.ndarray:
    """``jacobian @ covariance`` (Y, ...), of derivatives (Y, Z) of signals that depend on the curve
    of their own band alone; whole matrices would cost as many times more as there are bands.
    """
    bands, nodes = prior.bands, prior.nm.size
    projected = jacobian[:, bands * nodes:] @ covariance[bands * nodes:]
    for band in range(bands):
        own = slice(band * nodes, (band + 1) * nodes)
        projected[band::bands] += jacobian[band::bands, own] @ covariance[own]
    return np.asarray(projected)


def _condition(model: Linearised, noise: np.ndarray,
               prior: CameraPrior) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of a Gaussian given linear data."""
    start, covariance, jacobian, linear = model
    projected = _project(jacobian, covariance, prior)
    lower = np.linalg.cholesky(_project(jacobian, projected.T, prior) + noise)
    innovation, shrink = np.split(solve_triangular(lower, np.column_stack([
        linear - jacobian @ start, projected]), lower=True), [1], 1)
    return start + shrink.T @ innovation[:, 0], covariance - shrink.T @ shrink


def _designs(photos: list[chart_equations.ChartEquations], basis: np.ndarray) -> list[Design]:
    """Every photo's design; the departures of the lights stand after all nuisances."""
    nodes, stop = basis.argmax(axis=0), photos[0].signal.shape[1] * basis.shape[1]
    stop += int(chart_equations.nuisance_starts(photos)[-1])
    designs: list[Design] = []
    for number, photo in enumerate(photos):
        terms = (np.zeros((nodes.size, 0)) if photo.light_terms is None
                 else photo.light_terms[nodes])
        same = [design.light.own for design, other in zip(designs, photos[:number], strict=True)
                if other.light_terms is not None and np.allclose(
                    other.light_power, photo.light_power, rtol=1e-9, atol=0)]
        own = same[0] if same else slice(stop, stop + terms.shape[1])
        stop = max(stop, own.stop)
        designs.append(Design(chart_equations.unlit_design(photo, basis), LightDesign(terms, own)))
    return designs


def _brighter(state: np.ndarray, light: LightDesign, bands: int) -> tuple[np.ndarray, np.ndarray]:
    """What a photo's light is of its stated spectrum, at every value of the curves (D,), and its
    derivatives (D, J).
    """
    brighter = np.tile(np.exp(light.logarithm(state)), bands)
    return brighter, brighter[:, None] * np.tile(light.terms, (bands, 1))


def _whole(designs: list[Design], prior: CameraPrior) -> np.ndarray:
    """Row (D,) that sums the first chart's signals, 1 for the mean of the prior."""
    row = np.tile(designs[0].matrix.sum(axis=0), prior.bands)
    return row / (row @ (prior.weights @ prior.curves(prior.means)))


def _in_curves(prior: CameraPrior, mean: np.ndarray, covariance: np.ndarray,
               designs: list[Design],
               photos: list[chart_equations.ChartEquations]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of curves and nuisances from those of state and nuisances.

    The curves are those that together with the stated light of the first photo give its signals.
    They are scaled to a whole signal of 1, from which exp() takes them, and the exposures make up
    for it.
    """
    whole = _whole(designs, prior)
    size = whole.size
    exposures = size + chart_equations.nuisance_starts(photos)[:-1]
    brighter, by_light = _brighter(mean, designs[0].light, prior.bands)
    curves = prior.curves(mean[:size]) * brighter
    signal = whole @ curves
    # the change of variables is a diagonal and a few columns times rows: no product of whole
    # matrices, which would grow with the cube of the bands
    slope = prior.slope(mean[:size]) * brighter
    diagonal = np.r_[slope / signal, np.ones(mean.size - size)]
    by_whole = np.r_[-curves / signal, np.zeros(mean.size - size)]
    by_whole[exposures] = 1
    per_curve = whole * curves / brighter
    lights = np.zeros((mean.size, by_light.shape[1]))
    lights[:size] = (curves / brighter / signal)[:, None] * by_light
    lights += by_whole[:, None] * (per_curve @ by_light / signal)
    columns = np.column_stack([by_whole, lights])
    rows = np.zeros((mean.size, columns.shape[1]))
    rows[:size, 0] = whole * slope / signal
    rows[designs[0].light.own, 1:] = np.eye(lights.shape[1])
    moved = np.concatenate([curves / signal, mean[size:]])
    moved[exposures] += np.log(signal)
    seen = covariance @ rows
    across = columns @ (diagonal[:, None] * seen).T
    spread = covariance * np.outer(diagonal, diagonal) + across + across.T
    return moved, spread + columns @ (rows.T @ seen) @ columns.T
