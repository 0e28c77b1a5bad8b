"""What measured cameras say of a camera that nobody has measured: a prior on its sensitivities.

The sensitivities of one camera are one vector, band after band, divided by its mean. Cameras of one maker and
generation lie close together, others far apart, so the prior is a mixture: each family of similar cameras is one
Gaussian about its mean, all of them as wide as cameras lie within families plus a twentieth of the whole variance. A
last, broad Gaussian about the mean of all cameras takes those without relatives; smooth departures that no measured
camera shows widen it, for makers that the database does not know. Each covariance is kept as its leading directions and
a small smooth remainder. Only means and these directions are stored, no camera's own curves.

The constants below were chosen by leave-one-out and brand-out error and coverage over the 40 cameras of the benchmark,
so its figures are optimistic by an amount that has not been measured.
"""
from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated

import numpy as np

from radiometry.errors import InputError
from radiometry.shaped import Record

FAMILIES_PER_CAMERA = 0.33   # 13 families of 39 cameras
FEWEST_FOR_FAMILIES = 12     # fewer cameras make one Gaussian
WIDENING = 0.05              # share of the variance between all cameras that a family may also move by
KEPT_VARIANCE = 0.9995
REMAINDER_SD = 0.005         # of the largest value of the mean curves
REMAINDER_NM = 12.0          # length over which that remainder is smooth
NOVEL_SD = 0.04              # the same for departures of cameras that are like none measured
NOVEL_NM = 30.0
BROAD_WEIGHT = 0.2           # least share of the broad family
FEWEST_CAMERAS = 4
SHIPPED = "rawtoaces39.npz"


@dataclass(frozen=True, eq=False)
class CameraPrior(Record):
    """Mixture of Gaussians on curves stacked band after band: D = K P; F families, the broad one last."""

    nm: Annotated[np.ndarray, "P"]
    weights: Annotated[np.ndarray, "F"]
    means: Annotated[np.ndarray, "F D"]
    factors: Annotated[np.ndarray, "D Q"]           # factors @ factors.T: covariance within a family
    broad_factors: Annotated[np.ndarray, "D B"]     # the same between all cameras
    remainder_sd: float                             # standard deviation of what the directions leave out
    members: tuple[str, ...]                        # names of the cameras of each family, joined by ", "
    source: str
    licence: str

    @property
    def bands(self) -> int:
        return self.means.shape[1] // self.nm.size

    def covariance(self, family: int) -> np.ndarray:
        """Covariance (D, D) of one family."""
        factors = self.broad_factors if family == len(self.weights) - 1 else self.factors
        return factors @ factors.T + self.remainder_sd**2 * np.kron(np.eye(self.bands), smooth_kernel(self.nm))


def smooth_kernel(nm: np.ndarray, length_nm: float = REMAINDER_NM) -> np.ndarray:
    """Correlation (P, P) of a smooth function of wavelength, with a little white so that it can be inverted."""
    return np.exp(-0.5 * ((nm[:, None] - nm) / length_nm) ** 2) + 1e-3 * np.eye(nm.size)


def build_prior(nm: np.ndarray, curves: np.ndarray, names: tuple[str, ...], *, source: str,
                licence: str) -> CameraPrior:
    """Prior learnt from measured cameras.

    Parameters
    ----------
    nm : (P,) array
    curves : (C, K, P) array
        Sensitivities of C cameras, any scale.
    names : tuple of str
        Of the C cameras.
    source, licence : str
        Stored with the prior and shown wherever it is used.

    Raises
    ------
    InputError
        If there are fewer than 4 cameras.
    """
    cameras = len(curves)
    if cameras < FEWEST_CAMERAS:
        raise InputError(f"a prior needs {FEWEST_CAMERAS} measured cameras or more; {cameras} could be read")
    vectors = (curves / curves.mean(axis=(1, 2), keepdims=True)).reshape(cameras, -1)
    groups = _families(vectors)
    means = np.array([vectors[group].mean(axis=0) for group in groups] + [vectors.mean(axis=0)])
    single = cameras - sum(len(group) for group in groups)
    weights = np.array([float(len(group)) for group in groups] + [max(single, BROAD_WEIGHT * cameras)])
    between = (vectors - means[-1]) / np.sqrt(cameras - 1)
    within = [vectors[group] - vectors[group].mean(axis=0) for group in groups]
    freedom = max(sum(len(group) for group in groups) - len(groups), 1)
    inside = np.vstack([*(rows / np.sqrt(freedom) for rows in within), np.sqrt(WIDENING) * between])
    members = (*(", ".join(names[index] for index in group) for group in groups), "a camera unlike those measured")
    top = float(means[-1].max())
    broad = np.hstack([_leading(between * _small_sample(cameras)), _novel(nm, curves.shape[1]) * top])
    return CameraPrior(nm, weights / weights.sum(), means, _leading(inside), broad, REMAINDER_SD * top, members, source,
                       licence)


def save_prior(path: Path, prior: CameraPrior) -> None:
    """Write a prior as an .npz without pickled objects."""
    np.savez_compressed(path, nm=prior.nm, weights=prior.weights, means=prior.means.astype(np.float32),
                        factors=prior.factors.astype(np.float32), broad_factors=prior.broad_factors.astype(np.float32),
                        remainder_sd=prior.remainder_sd, members=np.array(prior.members),
                        source=np.array(prior.source), licence=np.array(prior.licence))


def load_prior(path: Path) -> CameraPrior:
    """Read a prior that ``save_prior`` wrote.

    Raises
    ------
    InputError
        If the file is missing or is not such a prior.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            return CameraPrior(stored["nm"], stored["weights"], stored["means"].astype(float),
                               stored["factors"].astype(float), stored["broad_factors"].astype(float),
                               float(stored["remainder_sd"]), tuple(str(name) for name in stored["members"]),
                               str(stored["source"]), str(stored["licence"]))
    except FileNotFoundError:
        raise InputError(f"{path} is missing; make a prior with 'spectrabox camera prior FOLDER --out FILE'") from None
    except (ValueError, KeyError, OSError, EOFError, TypeError) as error:
        raise InputError(f"{path.name} is not a camera prior ({error}); "
                         "make one with 'spectrabox camera prior FOLDER --out FILE'") from None


def shipped_prior() -> CameraPrior:
    """The prior that comes with the project; ``models/rawtoaces39.txt`` says from what it was made."""
    with resources.as_file(resources.files("calibrate") / "models" / SHIPPED) as path:
        return load_prior(path)


def _families(vectors: np.ndarray) -> list[np.ndarray]:
    """Indices of the members of each family of two or more, by Ward's method."""
    if len(vectors) < FEWEST_FOR_FAMILIES:
        return []
    from scipy.cluster.hierarchy import fcluster, linkage
    label = fcluster(linkage(vectors, "ward"), round(FAMILIES_PER_CAMERA * len(vectors)), "maxclust")
    groups = [np.flatnonzero(label == family) for family in np.unique(label)]
    return [group for group in groups if len(group) > 1]


def _leading(rows: np.ndarray) -> np.ndarray:
    """Factors (D, Q) with the leading directions of ``rows.T @ rows``."""
    _, singular, directions = np.linalg.svd(rows, full_matrices=False)
    share = np.cumsum(singular**2) / np.sum(singular**2)
    kept = int(np.searchsorted(share, KEPT_VARIANCE)) + 1
    return (directions[:kept] * singular[:kept, None]).T


def _novel(nm: np.ndarray, bands: int) -> np.ndarray:
    """Factors (D, B) of smooth departures, the same and independent in every band, for a largest value of 1."""
    variances, directions = np.linalg.eigh(np.exp(-0.5 * ((nm[:, None] - nm) / NOVEL_NM) ** 2))
    kept = variances > 1e-3 * variances[-1]
    return np.kron(np.eye(bands), NOVEL_SD * directions[:, kept] * np.sqrt(variances[kept]))


def _small_sample(cameras: int) -> float:
    """The mean itself is uncertain: a new camera lies sqrt(1 + 1/C) further out."""
    return float(np.sqrt(1 + 1 / cameras))
