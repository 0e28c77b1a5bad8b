"""A prior on sensitivities learnt from measured cameras.

Cameras of one maker and generation lie close together, others far apart. Families of similar
cameras (Ward's method) give components of three levels: ``family``, a camera of that family;
``kin``, one like it that another maker built; and ``broad``, about the mean of all cameras, every
maker counting once, for a camera unlike those measured.

How far each level reaches are the constants below. They maximise the density that the prior gives
to the measured curves of cameras it does not know: each left out alone, two thirds of the score,
and with all others of its maker, one third (``benchmarks/bench_calibration_constants.py``). No
chart photo enters.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.radiometry.errors import InputError

FAMILIES_PER_CAMERA = 0.33   # 13 families of 39 cameras
MIN_CAMERAS_FOR_FAMILIES = 12  # fewer cameras make one Gaussian
KEPT_VARIANCE = 0.9999
MIN_CAMERAS = 4
MIN_FREEDOM = 3              # of Student's t: fewer makers say nothing of how makers differ
UNLIKE = "a camera unlike those measured"


@dataclass(frozen=True)
class PriorConstants:
    """Reach of the three levels; departures as in ``CameraPrior``, scaled for family and kin."""

    family_weight: float = 0.32
    kin_weight: float = 0.36
    family_between: float = 0.03     # share of the variance between all cameras
    kin_between: float = 0.37
    family_departure: float = 0.10   # of the standard deviation of the departures below
    kin_departure: float = 0.25
    broad_departure: float = 1.0
    departures: tuple[float, ...] = (0.036, 89.0, 0.20, 21.0, 0.022, 5.7)


CONSTANTS = PriorConstants()


def build_prior(nm: np.ndarray, curves: np.ndarray, names: tuple[str, ...], *, source: str,
                licence: str, constants: PriorConstants = CONSTANTS) -> CameraPrior:
    """Prior learnt from measured cameras.

    Parameters
    ----------
    nm : (P,) array
    curves : (C, K, P) array
        Sensitivities of C cameras, any scale.
    names : tuple of str
        Of the C cameras; the first word is the maker.
    source, licence : str
        Stored with the prior and shown wherever it is used.

    Raises
    ------
    InputError
        If there are fewer than 4 cameras.
    """
    cameras = len(curves)
    if cameras < MIN_CAMERAS:
        raise InputError(f"a prior needs {MIN_CAMERAS} measured cameras or more; {cameras} "
                         "could be read")
    vectors = (curves / curves.mean(axis=(1, 2), keepdims=True)).reshape(cameras, -1)
    groups = families(vectors)
    middle, between = between_makers(vectors, names)
    sizes = np.array([len(group) for group in groups], dtype=float)
    sizes /= max(sizes.sum(), 1.0)
    family, kin = (constants.family_weight, constants.kin_weight) if groups else (0.0, 0.0)
    centres = [vectors[group].mean(axis=0) for group in groups]
    joined = [", ".join(names[index] for index in group) for group in groups]
    reach = np.array([constants.family_departure, constants.kin_departure,
                      constants.broad_departure])
    scales = np.ones((3, 6))
    scales[:, ::2] = reach[:, None]
    widening = _student_widening(names)
    of_kin = (f"another maker's like {members}" for members in joined)
    return CameraPrior(
        nm=nm, weights=np.concatenate([family * sizes, kin * sizes, [1 - family - kin]]),
        means=np.array([*centres, *centres, middle]),
        level=np.repeat([0, 1, 2], [len(groups), len(groups), 1]),
        shares=np.array([[1.0, constants.family_between], [1.0, constants.kin_between],
                         [0.0, 1.0]]),
        departures=scales * constants.departures, widening=np.array([1.0, widening, widening]),
        within=_leading(within_families(vectors, groups)), between=_leading(between),
        members=(*joined, *of_kin, UNLIKE), source=source, licence=licence)


def families(vectors: np.ndarray) -> list[np.ndarray]:
    """Indices of the members of each family of two or more cameras, by Ward's method.

    Parameters
    ----------
    vectors : (C, D) array
        Curves of C cameras, band after band, each camera of mean 1.

    Returns
    -------
    list of int arrays
        Empty where there are fewer than 12 cameras.
    """
    if len(vectors) < MIN_CAMERAS_FOR_FAMILIES:
        return []
    from scipy.cluster.hierarchy import fcluster, linkage
    label = fcluster(linkage(vectors, "ward"), round(FAMILIES_PER_CAMERA * len(vectors)),
                     "maxclust")
    groups = [np.flatnonzero(label == family) for family in np.unique(label)]
    return [group for group in groups if len(group) > 1]


def within_families(vectors: np.ndarray, groups: list[np.ndarray]) -> np.ndarray:
    """Rows (C, D) whose products add up to the pooled covariance within families.

    Parameters
    ----------
    vectors : (C, D) array
    groups : list of int arrays
        From ``families``.
    """
    if not groups:
        return np.zeros((1, vectors.shape[1]))
    freedom = max(sum(len(group) for group in groups) - len(groups), 1)
    return np.vstack([vectors[group] - vectors[group].mean(axis=0) for group in groups]) / np.sqrt(
        freedom)


def between_makers(vectors: np.ndarray, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Mean (D,) in which every maker counts once, and rows of the covariance about it.

    The products of the rows (C, D) add up to the covariance. The mean itself is uncertain: a new
    camera lies further out, by sqrt(1 + 1 / effective number of makers).

    Parameters
    ----------
    vectors : (C, D) array
    names : tuple of str
        Of the C cameras; the first word is the maker.
    """
    makers = [_maker(name) for name in names]
    weights = np.array([1 / makers.count(maker) for maker in makers])
    weights /= weights.sum()
    effective = 1 / np.sum(weights**2)
    middle = weights @ vectors
    factor = np.sqrt(effective / (effective - 1) * (1 + 1 / effective))
    return middle, factor * np.sqrt(weights)[:, None] * (vectors - middle)


def _maker(name: str) -> str:
    return name.split()[0] if name.split() else name


def _student_widening(names: tuple[str, ...]) -> float:
    """Student's t over the normal quantile at 95 %, for a covariance learnt from few makers."""
    from scipy.special import ndtri, stdtrit
    freedom = max(len({_maker(name) for name in names}) - 1, MIN_FREEDOM)
    return float(stdtrit(freedom, 0.95) / ndtri(0.95))


def _leading(rows: np.ndarray) -> np.ndarray:
    """Factors (D, Q) with the leading directions of ``rows.T @ rows``."""
    _, singular, directions = np.linalg.svd(rows, full_matrices=False)
    share = np.cumsum(singular**2) / max(np.sum(singular**2), np.finfo(float).tiny)
    kept = int(np.searchsorted(share, KEPT_VARIANCE)) + 1
    return (directions[:kept] * singular[:kept, None]).T
