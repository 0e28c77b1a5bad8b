"""Priors on a camera's curves: mixtures of Gaussians with their file, and plain ones that need no
database.

The prior on a camera's curves: a mixture of Gaussians, its covariances and its file.

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

Priors on curves that need no database of cameras: smoothness alone, or measured curves.

Of multispectral bands and unusual sensors only smoothness is known. Every band is a Gaussian
process of wavelength about a constant: the level that the photo itself shows. How far it departs
from that level, and over how many nanometres, are the components of the mixture; the evidence of
the photo weighs them. Bands are independent; exposure, illumination field, glare and model error
are joint, as with any prior.
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import resources
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np

from spectrabox.radiometry import errors, files, shaped
from spectrabox.radiometry.records.spectra import WavelengthGrid
from spectrabox.radiometry.system.archives import DamagedArchiveError, opened_npz

if TYPE_CHECKING:
    from spectrabox.calibrate.chart_equations import ChartEquations

SHIPPED = "rawtoaces39.npz"
NOT_LOCALISED = (0.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class CameraPrior(shaped.Record):
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
    with files.whole_file(path) as unfinished, unfinished.open("wb") as file:
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
        raise errors.InputError(
            f"{path} is missing; make a prior with 'spectrabox camera prior FOLDER "
            "--out FILE'") from None
    except (OSError, DamagedArchiveError):
        raise errors.InputError(
            f"{path.name} is not a camera prior, is of an earlier version, or is "
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


LENGTHS_NM = (15.0, 25.0, 40.0, 70.0)
# standard deviation over mean: a narrow band is far from its mean nearly everywhere
DEPARTURES = (1.5, 3.0)
FEW_BANDS = 4                # more bands take coarser wavelengths, to stay within seconds
STEP_NM, COARSE_STEP_NM = 5.0, 10.0
SMOOTH_SOURCE = "smooth curves, no measured camera"
MEASURED_LENGTH_NM = 40.0    # over which the error of a measured curve changes
ADDED = 0.2                  # of the relative error: what is added to a curve, of the largest value


def smooth_prior(photos: list[ChartEquations], grid: WavelengthGrid) -> CameraPrior:
    """Prior for the camera of some photos, knowing only the level of each band.

    Parameters
    ----------
    photos : list of ChartEquations
        The first gives the level of each band.
    grid : WavelengthGrid
        Its range is that of the prior.
    """
    first = photos[0]
    bands = first.signal.shape[1]
    nm = np.arange(grid.nm[0], grid.nm[-1] + 1, STEP_NM if bands <= FEW_BANDS else COARSE_STEP_NM)
    unit_signal = (first.reflectances * first.power * (first.irradiance / np.pi)[:, None]).sum(1)
    # of patches that can be read in the band; of all where none can
    counted = first.readable | ~first.readable.any(axis=0)
    mean = np.repeat((counted * first.signal).sum(axis=0) / (unit_signal @ counted), nm.size)
    kinds = list(product(DEPARTURES, LENGTHS_NM))
    departures = np.array([[0.0, 1.0, sd, length, 0.0, 1.0] for sd, length in kinds])
    return CameraPrior(nm, np.full(len(kinds), 1 / len(kinds)), np.tile(mean, (len(kinds), 1)),
                       np.arange(len(kinds)), np.zeros((len(kinds), 2)), departures,
                       np.ones(len(kinds)), np.zeros((mean.size, 0)), np.zeros((mean.size, 0)),
                       tuple(f"curves smooth over {length:g} nm" for _, length in kinds),
                       SMOOTH_SOURCE, "none")


def prior_of_curves(grid: WavelengthGrid, curves: np.ndarray, relative_error: float) -> CameraPrior:
    """Prior about measured curves, so that a chart fit gives white, field and glare.

    Parameters
    ----------
    grid : WavelengthGrid
        Of the curves, P wavelengths.
    curves : (K, P) array
    relative_error : float
        Standard deviation of each curve, relative to it.
    """
    return prior_about(grid, curves, (ADDED * relative_error, MEASURED_LENGTH_NM, relative_error,
                                      MEASURED_LENGTH_NM, 0.0, 1.0), "measured curves from a file")


def prior_about(grid: WavelengthGrid, curves: np.ndarray, departures: tuple[float, ...],
                source: str) -> CameraPrior:
    """Prior of one Gaussian about given curves.

    Parameters
    ----------
    grid : WavelengthGrid
        Of the curves, P wavelengths.
    curves : (K, P) array
    departures : tuple of six float
        As ``CameraPrior.departures``.
    source : str
        Stored with the prior.
    """
    nm = np.arange(grid.nm[0], grid.nm[-1] + 1, STEP_NM)
    means = np.array([np.interp(nm, grid.nm, curve) for curve in curves]).reshape(1, -1)
    none = np.zeros((means.size, 0))
    return CameraPrior(nm, np.ones(1), means, np.zeros(1, int), np.zeros((1, 2)),
                       np.array([departures]), np.ones(1), none, none, ("measured curves",),
                       source, "none")
