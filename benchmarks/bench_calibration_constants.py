"""How far a learnt prior on sensitivities should reach: its constants from measured curves alone.

The score is the mean log density that a prior gives to the curves of cameras it was not made from:
each camera left out alone (two thirds of the score), and with every camera of its maker (one
third). First the departures are found, from makers left out and the broad level only, then weights
and reach of all levels. Nelder-Mead, some minutes; no photo is simulated.
"""
from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp, softmax

from spectrabox.calibrate.prior.camera_database import CameraDatabase, read_camera_database
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.prior.learnt_prior import CONSTANTS, PriorConstants, build_prior

KNOWN_MAKER = 2 / 3         # how often a camera's maker is in the database: an assumption
SHAPE_STEPS, REACH_STEPS = 500, 250
# a prior, and the vectors (n, D) of cameras that it does not know
Fold = tuple[CameraPrior, np.ndarray]


def makers_of(database: CameraDatabase) -> np.ndarray:
    """First word of each camera's name, (C,)."""
    return np.array([name.split()[0] for name in database.names])


def fold(database: CameraDatabase, train: np.ndarray, test: np.ndarray) -> Fold:
    """The prior of the cameras ``train``, and the curves of ``test``; both are masks (C,)."""
    names = tuple(name for name, kept in zip(database.names, train, strict=True) if kept)
    vectors = database.curves[test] / database.curves[test].mean(axis=(1, 2), keepdims=True)
    return (build_prior(database.nm, database.curves[train], names, source="", licence=""),
            vectors.reshape(len(vectors), -1))


def with_constants(prior: CameraPrior, constants: PriorConstants) -> CameraPrior:
    """The same prior with other constants: only weights, shares and departures depend on them."""
    families = np.count_nonzero(prior.level == 0)
    sizes = prior.weights[:families] / prior.weights[:families].sum() if families else np.zeros(0)
    family, kin = (constants.family_weight, constants.kin_weight) if families else (0.0, 0.0)
    scales = np.ones((3, 6))
    scales[:, ::2] = [[constants.family_departure], [constants.kin_departure],
                      [constants.broad_departure]]
    return dataclasses.replace(
        prior, weights=np.concatenate([family * sizes, kin * sizes, [1 - family - kin]]),
        shares=np.array([[1.0, constants.family_between], [1.0, constants.kin_between],
                         [0.0, 1.0]]),
        departures=scales * constants.departures)


def log_density(prior: CameraPrior, vectors: np.ndarray) -> np.ndarray:
    """Log density (n,) of curves (n, D), up to a constant."""
    found = np.empty((len(prior.weights), len(vectors)))
    for level, covariance in enumerate(prior.covariances()):
        lower = np.linalg.cholesky(covariance)
        for index in np.flatnonzero(prior.level == level):
            whitened = np.linalg.solve(lower, (vectors - prior.means[index]).T)
            found[index] = -0.5 * np.sum(whitened**2, axis=0) - np.log(np.diag(lower)).sum()
    with np.errstate(divide="ignore"):
        return logsumexp(found + np.log(prior.weights)[:, None], axis=0)


def mean_score(folds: list[Fold], constants: PriorConstants) -> float:
    """Mean log density over all cameras of some folds."""
    return float(np.mean(np.concatenate([log_density(with_constants(prior, constants), vectors)
                                         for prior, vectors in folds])))


def choose(database: CameraDatabase, scored: np.ndarray) -> tuple[PriorConstants, float]:
    """Constants that predict the cameras of the mask ``scored`` (C,) best, and their score.

    The prior of every fold is made from all cameras that are not left out, scored or not.
    """
    makers, every = makers_of(database), np.arange(len(database.names))
    alone = [fold(database, every != camera, every == camera) for camera in every[scored]]
    brands = [fold(database, makers != maker, (makers == maker) & scored)
              for maker in np.unique(makers[scored])]
    broad_only = dataclasses.replace(CONSTANTS, family_weight=0.0, kin_weight=0.0)

    def of_shape(logs: np.ndarray) -> PriorConstants:
        return dataclasses.replace(broad_only, departures=tuple(np.exp(logs)))

    shape = _search(lambda logs: mean_score(brands, of_shape(logs)), np.log(CONSTANTS.departures),
                    SHAPE_STEPS)

    def of_reach(state: np.ndarray) -> PriorConstants:
        weights = softmax(np.append(state[:2], 0.0))
        return PriorConstants(*map(float, (*weights[:2], *np.exp(state[2:]))), tuple(np.exp(shape)))

    def both(state: np.ndarray) -> float:
        constants = of_reach(state)
        return (KNOWN_MAKER * mean_score(alone, constants)
                + (1 - KNOWN_MAKER) * mean_score(brands, constants))

    start = np.r_[0.0, -1.0, np.log([0.05, 0.5, 0.1, 0.3, 1.0])]
    found = _search(both, start, REACH_STEPS)
    return of_reach(found), both(found)


def _search(score, start: np.ndarray, steps: int) -> np.ndarray:  # type: ignore[no-untyped-def]
    return minimize(lambda state: -score(state), start, method="Nelder-Mead",
                    options={"maxfev": steps}).x


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the lines")
    arguments = parser.parse_args()
    database = read_camera_database(arguments.data / "cameras")
    constants, score = choose(database, np.ones(len(database.names), bool))
    if arguments.json:
        print(json.dumps({"score": score, **dataclasses.asdict(constants)}))
        return
    print(f"mean log density {score:.1f}")
    for name, value in dataclasses.asdict(constants).items():
        print(f"{name:<18}", ", ".join(f"{number:.3g}" for number in np.atleast_1d(value)))


if __name__ == "__main__":
    main()
