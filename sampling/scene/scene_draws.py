"""Draws of all unknown materials of a photographed scene through its traced light transport, for a
session.

What is wrong with the calibration, the light's scale or the model of a surface befalls many regions
at once, so it is carried as errors that they share and not as noise of each. Which of them multiply
the signals is for `error_model.split_errors` to say, as of a surface alone (`split_shared`).
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import chdtrc

from spectrabox.radiometry import covariance, error_model, grid
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.scenes import RegionTransport
from spectrabox.radiometry.records.spectra import Outcome, SpectrumSamples
from spectrabox.sampling.prior import mixture
from spectrabox.sampling.scene import joint_posterior, joint_sampling
from spectrabox.sampling.spectral_measurement import nearest_splines

METHOD = "learnt prior through the light transport"
# chance of a picture as unlike the model as this one, below which the outcome says so
SURPRISING = 1e-3
EFFECTIVE = 1000.0      # number of the weighted draws, for a 95 % band
# Relative errors up to which it makes no difference whether they multiply or add: of one signal the
# mean then moves by .01 to .04 standard deviations.
MAY_ADD = 0.03


def draw_scene(regions: RegionTransport, response: np.ndarray, draws: int, seed: int,
               prior: mixture.LogitMixture | None = None, *, common: np.ndarray | None = None,
               logs: np.ndarray | None = None, known: Mapping[str, np.ndarray] | None = None,
               families: Mapping[str, Sequence[str]] | None = None,
               coefficients: int = 13) -> dict[str, SpectrumSamples]:
    """Draws of every unknown material of a scene, by name; row t of all of them belongs to the same
    scene.

    Nine parameters: the two before ``draws`` are the likelihood, the others have the defaults of
    a session.

    Parameters
    ----------
    regions : RegionTransport
        R regions; a signal of NaN leaves one out. The light's scale is in ``response``.
    response : (K, P)
        Scale x sensitivity x light x weight in nm, on the prior's 61 wavelengths.
    draws, seed : int
        T, at least 100.
    prior : LogitMixture, optional
        The one shipped with the project by default.
    common : (Q, R, K), optional
        Errors that regions share: what they add to signals, from `shared_errors` or `split_shared`.
    logs : (Q, R, K), optional
        What they add to the logarithm of the light besides, from `split_shared`.
    known : mapping, optional
        Reflectance (61,) of the materials that are given, by name.
    families : mapping, optional
        Families of surfaces stated for a material, by name.
    coefficients : int
        N of the splines that are fitted to the draws.

    Raises
    ------
    InputError
        If shapes do not belong together, or nothing is unknown.
    ConvergenceError
        If fewer draws are effective after 16000 proposals.
    """
    if unknown := set(known or {}) - set(regions.materials):
        raise InputError(f"the known materials {', '.join(sorted(unknown))} are not in the "
                         f"transport, which has {', '.join(regions.materials)}; name them as the "
                         "scene does")
    scene = regions, response, prior or mixture.load_prior()
    problem = joint_posterior.joint_problem(*scene, common, known, families, logs)
    if not problem.materials:
        raise InputError("every material of the scene is known; leave at least one to be estimated")
    modes = joint_sampling.find_modes(
        problem, joint_sampling.SAMPLED,
        None if common is None else joint_posterior.joint_problem(*scene, None, known, families))
    drawn, effective, _ = joint_sampling.sample_joint(problem, seed, modes, draws, EFFECTIVE)
    likely = surprise(problem, *modes) >= SURPRISING
    outcome = Outcome.THROUGH_TRANSPORT if likely else Outcome.DISAGREES
    basis = grid.basis_matrix(mixture.PRIOR_GRID.nm, coefficients)

    def samples_of(spectra: np.ndarray) -> SpectrumSamples:
        return SpectrumSamples(mixture.PRIOR_GRID, spectra, nearest_splines(spectra, basis), METHOD,
                               effective, seed, outcome, (outcome.finding(),))

    return {name: samples_of(drawn[:, m])
            for m, name in enumerate(problem.materials)}


def shared_errors(signal: np.ndarray, relative_covariance: np.ndarray, scale_error: float = 0.0,
                  surface: np.ndarray | None = None, colour_error: float = 0.0,
                  brightness_error: float = 0.0) -> np.ndarray:
    """What one standard deviation of each error that regions share does to the signals (Q, R, K).

    Parameters
    ----------
    signal : (R, K)
    relative_covariance : (K, K)
        Of the bands, common to all regions: `Calibration.relative_covariance`.
    scale_error : float
        Relative standard error of the light's scale, common to all regions and bands.
    surface : (R,) int, optional
        Which surface each region belongs to.
    colour_error, brightness_error : float
        Relative standard error of the model of each surface: independent in each band, and common
        to all bands.

    Raises
    ------
    InputError
        For a covariance that is none, or errors that are negative.
    """
    if not covariance.is_covariance(relative_covariance) \
            or min(scale_error, colour_error, brightness_error) < 0:
        raise InputError("the calibration's relative covariance must be positive semi-definite and "
                         "the errors of scale and surfaces not negative; fit the calibration again")
    alike, apart = np.ones(signal.shape[1]), np.eye(signal.shape[1])
    patterns = [*covariance.error_patterns(relative_covariance), scale_error * alike]
    of_surface = [brightness_error * alike, *(colour_error * apart)]
    errors = [signal * pattern for pattern in patterns if pattern.any()]
    for name in np.unique(surface) if surface is not None else ():
        errors += [np.where((surface == name)[:, None], signal * pattern,
                            0.0) for pattern in of_surface
                   if pattern.any()]
    return np.nan_to_num(np.array(errors).reshape(-1, *signal.shape))


def split_shared(signal: np.ndarray, group: np.ndarray, causes: Mapping[str, np.ndarray]
                 ) -> tuple[np.ndarray, np.ndarray]:
    """Errors that regions share, as what one standard deviation of each of as many independent ones
    adds to the signals (Q, R, K), and what it adds to the logarithm of the light besides
    (Q, R, K).

    `error_model.split_errors` says of each cause and group whether it multiplies. What a cause that
    does so changes by other shares in one region of a group than in another adds.

    Parameters
    ----------
    signal : (R, K) array
        About which the errors hold.
    group : (R,) int array
        Regions of one number, as those of one surface, have one share of each error.
    causes : mapping of (Q', R, K) arrays
        What one standard deviation of each error of a cause does to the signals, by name.
    """
    names, group = np.unique(group, return_inverse=True)
    sums = np.eye(names.size)[:, group] / np.bincount(group)[:, None]                  # (G, R)
    of_groups = sums @ signal                                                           # (G, K)
    common, logs = [np.zeros((0, *signal.shape))], [np.zeros((0, *of_groups.shape))]
    for cause, changes in causes.items():
        mean = sums @ changes                                                        # (Q', G, K)
        relative = error_model.split_errors(of_groups,
                                            {cause: np.einsum("qgk,qgl->gkl", mean, mean)}).relative
        multiplies = np.any(relative, axis=(1, 2))[:, None] & (of_groups > 0)
        logs.append(np.divide(mean, of_groups, out=np.zeros_like(mean),
                              where=np.broadcast_to(multiplies, mean.shape)))
        common.append(changes - signal * logs[-1][:, group])
    together, by_group = np.concatenate(common), np.concatenate(logs)
    flat = by_group.reshape(len(by_group), of_groups.size)
    if np.sqrt((flat**2).sum(axis=0)).max(initial=0) < MAY_ADD:
        return together + signal * by_group[:, group], np.zeros_like(together)
    # the same errors, turned so that as few as can be multiply
    directions = np.linalg.svd(flat)[0].T
    together, flat = np.tensordot(directions, together, 1), directions @ flat
    flat[np.abs(flat).max(axis=1) < MAY_ADD] = 0
    whole = np.tensordot(directions, by_group, 1)
    by_group = flat.reshape(whole.shape)
    return together + signal * (whole - by_group)[:, group], by_group[:, group]


def surprise(problem: joint_posterior.JointProblem, labels: np.ndarray, z: np.ndarray,
             evidence: np.ndarray) -> float:
    """Chance of a picture at least as far from the prior's as this one, in the Gaussian
    approximation at the best mode.

    Parameters
    ----------
    problem : JointProblem
    labels, z, evidence : (B, M), (B, M P + Q) and (B,) arrays
        Of the modes.
    """
    best = int(np.argmax(evidence))
    residual, *_ = joint_posterior.residual_by_logit(
        problem, joint_posterior.logits_of(problem, labels[best], z[best][None])[0],
        problem.errors_of(z[best]))
    return float(chdtrc(len(residual), residual @ residual + z[best] @ z[best]))
