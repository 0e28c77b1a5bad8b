"""The learnt prior: a Gaussian mixture of logit reflectances, and the file it is kept in.

log(rho / (1 - rho)) at 400, 405 ... 700 nm follows sum_c weight_c N(mean_c, covariance_c), so every
draw lies strictly between 0 and 1. Every component belongs to a family of surfaces: paint, skin,
leaves ... ``band_factors`` widen bands so that they held the stated share of reflectances that the
mixture was not fitted to (split conformal calibration), each family having its own;
``curve_factor`` does so for whole curves. `of_families` conditions on the stated families.
"""
from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated

import numpy as np

from spectrabox.radiometry import files, grid, shaped
from spectrabox.radiometry.covariance import is_covariance
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.archives import DamagedArchiveError, opened_npz
from spectrabox.sampling.prior import level
from spectrabox.sampling.prior.families.family_names import WORDS, unknown_families
from spectrabox.sampling.prior.family_coverage import FamilyCertificate

PRIOR_GRID = grid.visible_grid(5)
SHIPPED = Path(__file__).parent / "models" / "surface_families.npz"
EDGE = 0.004            # training reflectances are clipped to 0.004-0.996 before the logit
MOMENT_DRAWS = 20000
SINGLE = 1e-6           # round-off of covariances kept in single precision, with room for products
STATED = "stated_"              # before the names of their arrays
FORMAT = "spectrabox prior 6"
# the first two with the families' own levels, all with tails that nobody calibrated: those of the
# shipped prior, in round figures
PREVIOUS_FORMATS = ("spectrabox prior 3", "spectrabox prior 4", "spectrabox prior 5")
PREVIOUS_TAIL = 1.0
SCALARS = ("curve_factor", "familiar_surprise", "width_power")
COMPONENTS = ("weights", "means", "covariances", "family")
ARRAYS = ("nm", *COMPONENTS, "levels", "band_factors", "stated_factors", *SCALARS)
SINGLE_PRECISION = ("means", "covariances", "band_factors", "stated_factors")


@dataclass(frozen=True, eq=False, repr=False)
class LogitMixture(shaped.Record):
    """A prior of logit reflectances, C components on P wavelengths, and its calibration."""

    nm: Annotated[np.ndarray, "P"]
    weights: Annotated[np.ndarray, "C"]
    means: Annotated[np.ndarray, "C P"]
    covariances: Annotated[np.ndarray, "C P P"]
    families: tuple[str, ...]                   # F of them
    family: Annotated[np.ndarray, "C"]          # index of each component's
    levels: Annotated[np.ndarray, "L"]          # of the bands that were calibrated
    # pointwise bands are this much wider than the mixture's; a signal that several families allow
    # takes each by its share
    band_factors: Annotated[np.ndarray, "F L P"]
    stated_factors: Annotated[np.ndarray, "F L P"]      # where the family is stated
    curve_factor: float             # 95 % of whole curves lay in 95 % bands widened once more by it
    # 99.5 % of calibration signals, of three bands, surprised the mixture less (chi-square)
    familiar_surprise: float
    width_power: float              # of a band's mean width over the usual, in its factor
    source: str                                 # what it was trained on, with licences
    stated: tuple[str, ...] = ()                # families that were stated
    certificates: Mapping[str, FamilyCertificate] = field(default_factory=dict)     # by family
    # of families that have other components where they are stated; weights of each sum to 1
    where_stated: LogitMixture | None = None
    uniform_level: bool = False         # in place of the components' own (level.py)
    tail: float = 0.0                   # by which bands grow (mixture_posterior.tail_growth)

    def __repr__(self) -> str:
        return f"<LogitMixture of {', '.join(self.families)}>"

    @cached_property
    def with_level(self) -> np.ndarray:
        """Covariance (C, P) of each component's logits with their mean over wavelength, its level.
        """
        return self.covariances.mean(axis=2)

    @cached_property
    def level_mean(self) -> np.ndarray:
        """Mean (C,) of each component's level."""
        return self.means.mean(axis=1)

    @cached_property
    def level_variance(self) -> np.ndarray:
        """Variance (C,) of each component's level."""
        return self.with_level.mean(axis=1)

    @cached_property
    def level_weight(self) -> np.ndarray:
        """By which the mixture is multiplied at every level, as of ``level.level_weight``."""
        return level.level_weight(self) if self.uniform_level else np.zeros((3, level.GRID.size))

    def band_factor(self, level: float, weights: np.ndarray) -> np.ndarray:
        """Factors (T, P) by which central bands of ``level`` are widened, for weights (T, C)."""
        return np.asarray(self.shares(weights) @ self.family_factors(level))

    def family_factors(self, level: float) -> np.ndarray:
        """Factors (F, P) of every family, linear between the calibrated levels."""
        above = int(np.clip(np.searchsorted(self.levels, level), 1, self.levels.size - 1))
        low, high = self.levels[above - 1:above + 1]
        part = np.clip((level - low) / (high - low), 0, 1)
        return np.asarray((1 - part) * self.band_factors[:, above - 1]
                          + part * self.band_factors[:, above])

    def shares(self, weights: np.ndarray) -> np.ndarray:
        """Shares (T, F) of the families in weights (T, C) of the components."""
        return np.asarray(weights @ np.eye(len(self.families))[np.asarray(self.family, dtype=int)])


def of_families(prior: LogitMixture, stated: Sequence[str]) -> LogitMixture:
    """The prior of a surface of one of the stated families; of any family where none is stated.

    Parameters
    ----------
    prior : LogitMixture
    stated : sequence of str
        Names of families, or words for them.

    Raises
    ------
    InputError
        For a word that names no family.
    """
    if not stated:
        return prior
    if wrong := unknown_families([word for word in stated if word not in prior.families]):
        raise InputError(wrong)
    names = [WORDS.get(word.lower(), word) for word in stated]
    for word, name in zip(stated, names, strict=True):
        if name not in prior.families:
            raise InputError(f"the prior knows no surfaces of the family {word!r}, only of "
                             f"{', '.join(prior.families)}")
    kept = [index for index, name in enumerate(prior.families) if name in names]
    mine = mixture_where_stated(prior, kept)
    return replace(mine, families=tuple(prior.families[index] for index in kept),
                   family=np.searchsorted(kept, mine.family),
                   band_factors=prior.stated_factors[kept],
                   stated_factors=prior.stated_factors[kept],
                   stated=tuple(prior.families[index] for index in kept), uniform_level=False)


def mixture_where_stated(prior: LogitMixture, kept: Sequence[int]) -> LogitMixture:
    """The mixture of the components of stated families alone, given by their indices.

    Parameters
    ----------
    prior : LogitMixture
    kept : sequence of int
        Indices of the families.
    """
    shares = prior.shares(prior.weights[None])[0]
    other = prior.where_stated
    replaced = set() if other is None else set(other.family.tolist())
    own = np.isin(prior.family, [index for index in kept if index not in replaced])
    parts = [(prior.weights[own], prior.means[own], prior.covariances[own], prior.family[own])]
    if other is not None:
        new = np.isin(other.family, kept)
        weights = other.weights[new] * shares[other.family[new].astype(int)]
        parts.append((weights, other.means[new], other.covariances[new], other.family[new]))
    weights, means, covariances, family = (np.concatenate(each)
                                           for each in zip(*parts, strict=True))
    return replace(prior, weights=weights / weights.sum(), means=means, covariances=covariances,
                   family=family, where_stated=None)


def logit(reflectance: np.ndarray) -> np.ndarray:
    """Logit of reflectances, clipped to 0.004-0.996.

    Parameters
    ----------
    reflectance : array
        Of any shape.
    """
    clipped = np.clip(reflectance, EDGE, 1 - EDGE)
    return np.log(clipped / (1 - clipped))


def reflectance(logits: np.ndarray) -> np.ndarray:
    """Reflectance, strictly between 0 and 1, of logits.

    Parameters
    ----------
    logits : array
        Of any shape.
    """
    return 0.5 * (1 + np.tanh(0.5 * logits))


def reflectance_moments(prior: LogitMixture) -> tuple[np.ndarray, np.ndarray]:
    """Mean (P,) and covariance (P, P) of a prior's reflectances, from draws at a fixed seed.

    Parameters
    ----------
    prior : LogitMixture
    """
    spectra = drawn_reflectances(prior, MOMENT_DRAWS)
    return spectra.mean(axis=0), np.cov(spectra, rowvar=False)


def drawn_reflectances(prior: LogitMixture, draws: int) -> np.ndarray:
    """Reflectances (T, P) of surfaces that are drawn from a prior at a fixed seed.

    Parameters
    ----------
    prior : LogitMixture
    draws : int
        T.
    """
    rng = np.random.default_rng(0)
    levels = level.levels_of(prior) if prior.uniform_level else None
    shares = prior.weights / prior.weights.sum() if levels is None else levels.sum(axis=1)
    counts = rng.multinomial(draws, shares)
    logits = [rng.multivariate_normal(mean, covariance.astype(float), count)
              for mean, covariance, count in zip(prior.means, prior.covariances, counts,
                                                 strict=True)]
    if levels is not None:
        logits = [level.moved_to_level(prior, index, one, rng.choice(
            level.GRID, len(one), p=levels[index] / shares[index]))
                  for index, one in enumerate(logits)]
    return reflectance(np.vstack(logits))


def save_prior(path: Path, prior: LogitMixture) -> None:
    """Write a prior as .npz with covariances in single precision (a relative error of 6e-8).

    Parameters
    ----------
    path : Path
    prior : LogitMixture
    """
    arrays = {name: np.asarray(getattr(prior, name),
                               np.float32 if name in SINGLE_PRECISION else np.float64)
              for name in ARRAYS}
    if prior.where_stated is not None:
        arrays |= {STATED + name: np.asarray(getattr(prior.where_stated, name),
                                             np.float32 if name in SINGLE_PRECISION else np.float64)
                   for name in COMPONENTS}
    # opened here: NumPy would add .npz to a name without it
    with files.whole_file(path) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, format=np.array(FORMAT), source=np.array(prior.source),
                            uniform_level=np.array(prior.uniform_level),
                            tail=np.array(prior.tail),
                            families=np.array(prior.families),
                            certificates=np.array(json.dumps(
                                {name: asdict(one) for name, one in prior.certificates.items()})),
                            **arrays)  # type: ignore[arg-type]


def load_prior(path: Path | None = None) -> LogitMixture:
    """The prior of a file, or the one that ships with the project.

    Parameters
    ----------
    path : Path, optional
        By default the shipped one.

    Raises
    ------
    InputError
        If the file is missing, damaged, holds something else, or was made for other wavelengths.
    """
    return _shipped() if path is None else _read_prior(path)


@cache
def _shipped() -> LogitMixture:
    """The prior that ships with the project, read and checked once in a process."""
    return _read_prior(SHIPPED)


def _read_prior(path: Path) -> LogitMixture:
    try:
        with opened_npz(path) as stored:
            if "format" not in stored or str(stored["format"]) not in (FORMAT, *PREVIOUS_FORMATS):
                raise InputError(f"{path.name} is not a prior of this program; make one "
                                 "with tools/train_prior.py")
            numbers = {name: np.asarray(stored[name], dtype=float) for name in ARRAYS}
            other = {name: np.asarray(stored[STATED + name], dtype=float) for name in COMPONENTS
                     } if STATED + COMPONENTS[0] in stored else {}
            uniform = "uniform_level" in stored and bool(stored["uniform_level"])
            tail = float(stored["tail"]) if "tail" in stored else PREVIOUS_TAIL
            source, families = str(stored["source"]), tuple(stored["families"].tolist())
            certificates = {name: FamilyCertificate(**row)
                            for name, row in json.loads(str(stored["certificates"])).items()}
    except FileNotFoundError:
        raise InputError(f"the prior {path} is missing; give another file or make one with "
                         "tools/train_prior.py") from None
    except (OSError, DamagedArchiveError) as error:
        raise InputError(f"the prior {path.name} is damaged ({error}); train it again") from None
    scalars = {name: float(numbers.pop(name)) for name in SCALARS}
    try:
        prior = LogitMixture(source=source, families=families, certificates=certificates,
                             uniform_level=uniform, tail=tail,
                             **numbers, **scalars)  # type: ignore[arg-type]
        if other:
            prior = replace(prior, where_stated=replace(prior, **other))  # type: ignore[arg-type]
    except (TypeError, ValueError) as error:
        raise InputError(f"the prior {path.name} is damaged ({error}); train it again") from None
    check_prior(prior, path.name)
    return prior


def check_prior(prior: LogitMixture, name: str) -> None:
    """Raise unless a prior is on the grid of 61 wavelengths and its covariances are covariances.

    Parameters
    ----------
    prior : LogitMixture
    name : str
        Of its file, for messages.

    Raises
    ------
    InputError
        With what is wrong.
    """
    if prior.nm.shape != PRIOR_GRID.nm.shape or np.abs(prior.nm - PRIOR_GRID.nm).max() > 1e-6:
        raise InputError(f"the prior {name} is for {prior.nm.size} wavelengths from "
                         f"{prior.nm[0]:g} to {prior.nm[-1]:g} nm; 61 from 400 to 700 nm are "
                         "needed: train it again on this grid")
    other = prior.where_stated
    parts = [prior] if other is None else [prior, other]
    numbers = [prior.levels, prior.band_factors, prior.stated_factors,
               np.array(prior.tail)]
    numbers += [values for part in parts for values in (part.weights, part.means, part.covariances)]
    if not all(np.all(np.isfinite(values)) for values in numbers):
        raise InputError(f"the prior {name} holds numbers that are not finite; train it again")
    if prior.tail < 0:
        raise InputError(f"the tail of the prior {name} is negative; train it again")
    if np.any(prior.weights <= 0) or abs(prior.weights.sum() - 1) > 1e-6:
        raise InputError(f"the weights of the prior {name} are not positive with sum 1; train it "
                         "again")
    if sorted(set(prior.family.tolist())) != list(range(len(prior.families))):
        raise InputError(f"the components of the prior {name} do not belong to its families "
                         f"({', '.join(prior.families)}); train it again")
    if other is not None:
        sums = [other.weights[other.family == index].sum() for index in set(other.family.tolist())]
        if (not np.isin(other.family, prior.family).all() or np.any(other.weights <= 0)
                or np.abs(np.array(sums) - 1).max() > 1e-6):
            raise InputError(f"the components of the stated families in the prior {name} are of "
                             "no family, or their weights are not positive with sum 1; train it "
                             "again")
    for covariance in np.concatenate([part.covariances for part in parts]):
        if not is_covariance(covariance, SINGLE) or np.linalg.eigvalsh(covariance)[0] <= 0:
            raise InputError(f"a covariance of the prior {name} is not symmetric and positive; "
                             "train it again")


# ---- smoothness ----------------------------------------------------------------------------------
# What is believed of a reflectance that is like none measured so far: that its logit is smooth,
# and no more.
#
# A Gaussian process: a level for the whole curve and two squared-exponential terms. Its constants
# maximise the marginal likelihood of the training libraries of the learnt prior, then all standard
# deviations are enlarged by 1.5, for it is called where those libraries do not reach.

MEAN = -1.14
LEVEL, BROAD, NARROW = 0.97, 1.04, 0.23     # standard deviations of the logit
BROAD_NM, NARROW_NM = 81.0, 28.0
ENLARGED = 1.5
INDEPENDENT = 4e-3                          # variance


def smoothness_prior() -> LogitMixture:
    """The prior with one component; its bands carry no conformal calibration (all factors 1)."""
    covariance = ENLARGED**2 * smooth_covariance() + INDEPENDENT * np.eye(PRIOR_GRID.nm.size)
    ones = np.ones((1, 2, PRIOR_GRID.nm.size))
    return LogitMixture(PRIOR_GRID.nm, np.ones(1), np.full((1, PRIOR_GRID.nm.size), MEAN),
                        covariance[None],
                        ("smooth",), np.zeros(1), np.array([0.5, 0.99]), ones, ones, 1.0, np.inf,
                        0.0, "smoothness alone")


def smooth_covariance() -> np.ndarray:
    """Covariance (61, 61) of the logit of measured reflectances that are taken for smooth alone."""
    distance = PRIOR_GRID.nm[:, None] - PRIOR_GRID.nm
    return np.asarray(LEVEL**2 + BROAD**2 * np.exp(-0.5 * (distance / BROAD_NM)**2)
                      + NARROW**2 * np.exp(-0.5 * (distance / NARROW_NM)**2))
