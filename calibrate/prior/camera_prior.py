"""The prior on a camera's curves: a mixture of Gaussians, its covariances and its file.

The curves of one camera are one vector, band after band. Every component of the mixture has a mean
and a level; a level says how far cameras of that kind depart from such a mean:

    covariance = family x (variation within families)
                 + database x (variation between all cameras) + departures

The departures are what no measured camera shows: Matern-correlated functions of wavelength, added
to every band, multiplied with every band, and multiplied with all bands alike (a filter in front of
the sensor). ``learnt_prior`` makes such a mixture from measured cameras, ``smooth_prior`` one for
cameras of which only smoothness is known.
"""
from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated
from zipfile import BadZipFile

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.shaped import Record

SHIPPED = "rawtoaces39.npz"


@dataclass(frozen=True, eq=False)
class CameraPrior(Record):
    """Mixture of Gaussians on curves stacked band after band: D = K P; F components; L levels.

    Columns of ``departures``: standard deviation and length (nm) of what is added to each band (a
    share of the largest value), multiplied with each band, and multiplied with all bands together
    (shares of the last component's mean). ``widening`` multiplies the standard deviations after the
    fit: a covariance that was learnt from few makers is itself uncertain, and the fit cannot know
    by how much.
    """

    nm: Annotated[np.ndarray, "P"]
    weights: Annotated[np.ndarray, "F"]
    means: Annotated[np.ndarray, "F D"]
    level: Annotated[np.ndarray, "F"]               # index into the rows below
    shares: Annotated[np.ndarray, "L 2"]            # of the variance within families, and between
    departures: Annotated[np.ndarray, "L 6"]
    widening: Annotated[np.ndarray, "L"]
    within: Annotated[np.ndarray, "D Q"]            # within @ within.T: covariance within families
    between: Annotated[np.ndarray, "D B"]           # the same between all cameras
    members: tuple[str, ...]                        # cameras of each component, joined by ", "
    source: str
    licence: str
    jitter_sd: float = 1e-3                         # of the means' largest: stays invertible

    @property
    def bands(self) -> int:
        return self.means.shape[1] // self.nm.size

    def covariances(self) -> np.ndarray:
        """Covariance (L, D, D) of every level.

        Relative departures are shares of the last component's mean.
        """
        top, size = self.means.max(), self.means.shape[1]
        each, together = np.eye(self.bands), np.ones((self.bands, self.bands))
        inside, across = self.within @ self.within.T, self.between @ self.between.T
        relative = np.outer(self.means[-1], self.means[-1])
        covariances = np.empty((len(self.shares), size, size))
        for index, (add_sd, add_nm, each_sd, each_nm, all_sd, all_nm) in enumerate(self.departures):
            share_inside, share_across = self.shares[index]
            covariances[index] = (share_inside * inside + share_across * across
                            + np.kron(each, (add_sd * top) ** 2 * matern(self.nm, add_nm, 1.5))
                            + relative * (np.kron(each, each_sd**2 * matern(self.nm, each_nm, 2.5))
                                          + np.kron(together,
                                                    all_sd**2 * matern(self.nm, all_nm, 2.5)))
                            + (self.jitter_sd * top) ** 2 * np.eye(size))
        return covariances


def matern(nm: np.ndarray, length_nm: float, smoothness: float) -> np.ndarray:
    """Matern correlation (P, P) [Rasmussen & Williams 2006, Eqs. 4.16, 4.17].

    Parameters
    ----------
    nm : (P,) array
    length_nm : float
        Length scale, > 0.
    smoothness : float
        1.5 or 2.5.
    """
    distance = np.sqrt(2 * smoothness) * np.abs(nm[:, None] - nm) / length_nm
    polynomial = 1 + distance if smoothness == 1.5 else 1 + distance + distance**2 / 3
    return polynomial * np.exp(-distance)


def save_prior(path: Path, prior: CameraPrior) -> None:
    """Write a prior as an .npz without pickled objects, means in single precision.

    Parameters
    ----------
    path : Path
        Ends in .npz.
    prior : CameraPrior
    """
    np.savez_compressed(path, nm=prior.nm, weights=prior.weights,
                        means=prior.means.astype(np.float32), level=prior.level,
                        shares=prior.shares, departures=prior.departures, widening=prior.widening,
                        within=prior.within.astype(np.float32),
                        between=prior.between.astype(np.float32), members=np.array(prior.members),
                        source=np.array(prior.source), licence=np.array(prior.licence))


def load_prior(path: Path) -> CameraPrior:
    """Read a prior that ``save_prior`` wrote.

    Parameters
    ----------
    path : Path
        An .npz that ``save_prior`` wrote.

    Raises
    ------
    InputError
        If the file is missing or is not such a prior.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            return CameraPrior(stored["nm"], stored["weights"], stored["means"].astype(float),
                               stored["level"], stored["shares"], stored["departures"],
                               stored["widening"], stored["within"].astype(float),
                               stored["between"].astype(float),
                               tuple(str(name) for name in stored["members"]),
                               str(stored["source"]), str(stored["licence"]))
    except FileNotFoundError:
        raise InputError(f"{path} is missing; make a prior with 'spectrabox camera prior FOLDER "
                         "--out FILE'") from None
    except (ValueError, KeyError, OSError, EOFError, TypeError, AttributeError, BadZipFile):
        raise InputError(f"{path.name} is not a camera prior, or is damaged; "
                         "make one with 'spectrabox camera prior FOLDER --out FILE'") from None


def shipped_prior() -> CameraPrior:
    """The prior that comes with the project; ``models/rawtoaces39.txt`` names its source."""
    with resources.as_file(resources.files("spectrabox.calibrate.prior") / "models"
                           / SHIPPED) as path:
        return load_prior(path)
