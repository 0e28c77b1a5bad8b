"""The prior on a camera's curves: a mixture of Gaussians, its covariances and its file.

The curves of all bands of one camera, band after band, are one vector. A learnt prior is Gaussian
in their logarithm,

    curve = exp(state) - floor

for a dye, the silicon and the filters in front of it multiply, and makers differ by factors: twice
the sensitivity is as far as half of it, and no curve is negative by more than the floor. The state
of other priors is the curves themselves. Every component of the mixture has a mean and a level; a
level says how far cameras of that kind depart from such a mean:

    covariance = family x (variation within families)
                 + database x (variation between all cameras) + departures

Both variations are those of few cameras: taken as they are, they say that an unknown camera is a
mixture of the known. So a share of each is localised, multiplied entry by entry with a correlation
that falls off with the distance in wavelength and from band to band [as ensemble Kalman filters do:
Houtekamer & Mitchell 2001]: variances stay, and what happens at 420 nm no longer decides what
happens at 650 nm. The departures are what no measured camera shows: Matern-correlated functions of
wavelength, added to every band, multiplied with every band, and multiplied with all bands alike (a
lens, or a filter in front of the sensor). ``learnt_prior`` makes such a mixture from measured
cameras, ``smooth_prior`` one for cameras of which only smoothness is known.
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import whole_file
from spectrabox.radiometry.shaped import Record
from spectrabox.radiometry.system.archives import DamagedArchiveError, opened_npz

SHIPPED = "rawtoaces39.npz"
NOT_LOCALISED = (0.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class CameraPrior(Record):
    """Mixture of Gaussians on states stacked band after band: D = K P; F components; L levels.

    Columns of ``departures``: standard deviation and length (nm) of what is added to each band (a
    share of the largest value), multiplied with each band, and multiplied with all bands together
    (shares of the last component's mean). ``widening`` multiplies the standard deviations after the
    fit: a covariance that was learnt from few makers is itself uncertain, and the fit cannot know
    by how much.
    """

    nm: Annotated[np.ndarray, "P"]
    weights: Annotated[np.ndarray, "F"]
    means: Annotated[np.ndarray, "F D"]             # of the state
    level: Annotated[np.ndarray, "F"]               # index into the rows below
    shares: Annotated[np.ndarray, "L 2"]            # of the variance within families, and between
    departures: Annotated[np.ndarray, "L 6"]
    widening: Annotated[np.ndarray, "L"]
    within: Annotated[np.ndarray, "D Q"]            # within @ within.T: covariance within families
    between: Annotated[np.ndarray, "D B"]           # the same between all cameras
    members: tuple[str, ...]                        # cameras of each component, joined by ", "
    source: str
    licence: str
    floor: float | None = None                      # None: the state is the curves
    # share that is localised, its length (nm), and the correlation of one band with another
    localised: tuple[float, float, float] = NOT_LOCALISED
    jitter_sd: float = 1e-3                         # of the curves' largest: stays invertible

    @property
    def bands(self) -> int:
        return self.means.shape[1] // self.nm.size

    def curves(self, state: np.ndarray) -> np.ndarray:
        """Curves (..., D) of states."""
        return state if self.floor is None else np.exp(state) - self.floor

    def slope(self, state: np.ndarray) -> np.ndarray:
        """Derivative (..., D) of each curve value by its state."""
        return np.ones_like(state) if self.floor is None else np.exp(state)

    def state(self, curves: np.ndarray) -> np.ndarray:
        """State (..., D) of curves above minus the floor."""
        return curves if self.floor is None else np.log(curves + self.floor)

    def covariances(self) -> np.ndarray:
        """Covariance (L, D, D) of the states of every level."""
        size = self.means.shape[1]
        covariances = np.empty((len(self.shares), size, size))
        for level in range(len(covariances)):
            covariances[level] = self.covariance(level)
        return covariances

    def covariance(self, level: int) -> np.ndarray:
        """Covariance (D, D) of the states of one level.

        Relative departures are shares of the last component's mean.
        """
        last, slope = self.curves(self.means[-1]), self.slope(self.means[-1])
        top = self.curves(self.means).max()
        each, together = np.eye(self.bands), np.ones((self.bands, self.bands))
        share, length_nm, coupling = self.localised
        covariance = np.zeros((last.size, last.size))
        for variation, weight in zip((self.within, self.between), self.shares[level], strict=True):
            if variation.size:
                locality = 1 - share + share * np.kron(
                    coupling * together + (1 - coupling) * each, matern(self.nm, length_nm, 2.5))
                covariance += weight * (locality * (variation @ variation.T))
        add_sd, add_nm, each_sd, each_nm, all_sd, all_nm = self.departures[level]
        relative, absolute = np.outer(last / slope, last / slope), 1 / np.outer(slope, slope)
        for scale, bands, shape in (
                (absolute, each, (add_sd * top) ** 2 * matern(self.nm, add_nm, 1.5)),
                (relative, each, each_sd**2 * matern(self.nm, each_nm, 2.5)),
                (relative, together, all_sd**2 * matern(self.nm, all_nm, 2.5))):
            if shape.any():
                covariance += scale * np.kron(bands, shape)
        return np.asarray(covariance + np.diag((self.jitter_sd * top / slope) ** 2))


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


def save_camera_prior(path: Path, prior: CameraPrior) -> None:
    """Write a prior as an .npz without pickled objects, means in single precision.

    Parameters
    ----------
    path : Path
        Ends in .npz.
    prior : CameraPrior
    """
    arrays = {"nm": prior.nm, "weights": prior.weights, "means": prior.means.astype(np.float32),
              "level": prior.level, "shares": prior.shares, "departures": prior.departures,
              "widening": prior.widening, "within": prior.within.astype(np.float32),
              "between": prior.between.astype(np.float32), "members": np.array(prior.members),
              "source": np.array(prior.source), "licence": np.array(prior.licence),
              "floor": np.array(prior.floor), "localised": np.array(prior.localised)}
    with whole_file(path) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def load_camera_prior(path: Path) -> CameraPrior:
    """Read a prior that ``save_camera_prior`` wrote.

    Parameters
    ----------
    path : Path
        An .npz that ``save_camera_prior`` wrote.

    Raises
    ------
    InputError
        If the file is missing or is not such a prior.
    """
    try:
        with opened_npz(path) as stored:
            share, length_nm, coupling = (float(value) for value in stored["localised"])
            return CameraPrior(stored["nm"], stored["weights"], stored["means"].astype(float),
                               stored["level"], stored["shares"], stored["departures"],
                               stored["widening"], stored["within"].astype(float),
                               stored["between"].astype(float),
                               tuple(str(name) for name in stored["members"]),
                               str(stored["source"]), str(stored["licence"]),
                               float(stored["floor"]), (share, length_nm, coupling))
    except FileNotFoundError:
        raise InputError(f"{path} is missing; make a prior with 'spectrabox camera prior FOLDER "
                         "--out FILE'") from None
    except (OSError, DamagedArchiveError):
        raise InputError(f"{path.name} is not a camera prior, is of an earlier version, or is "
                         "damaged; make one with 'spectrabox camera prior FOLDER --out "
                         "FILE'") from None


@cache
def shipped_prior() -> CameraPrior:
    """The prior that comes with the project, read once in a process; its source is named in
    ``models/rawtoaces39.txt``.
    """
    with resources.as_file(resources.files("spectrabox.calibrate.prior") / "models"
                           / SHIPPED) as path:
        return load_camera_prior(path)
