"""A prior learnt from measured reflectances, and what its bands did on each library left out."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np

from spectrabox.sampling.prior.band_calibration import AT_95, LeftOut, band_figures, train
from spectrabox.sampling.prior.families.family_models import FAMILIES
from spectrabox.sampling.prior.libraries import ReflectanceLibrary
from spectrabox.sampling.prior.mixture import LogitMixture

HEADING = (f"{'left out':<20} {'family':<8} {'curves':>6} {'RMSE':>7} {'95 % holds':>10} "
           f"{'width':>6} | {'stated: RMSE':>12} {'95 % holds':>10} {'width':>6}")


@dataclass(frozen=True)
class BandScores:
    """What the calibrated 95 % bands did on curves that the prior had not seen."""

    rmse: float
    coverage: float
    width: float


@dataclass(frozen=True)
class PartScores:
    """What they did on a library or model left out, its family stated and none stated; the second
    is None where it counts only for a stated family.
    """

    name: str
    family: str
    curves: int
    measured: bool
    stated: BandScores
    unstated: BandScores | None

    def facts(self) -> dict[str, object]:
        """As ``spectrabox prior train --json`` names them."""
        return {"name": self.name, "family": self.family, "curves": self.curves,
                "measured": self.measured, "stated": self.stated,
                **({} if self.unstated is None else asdict(self.unstated))}

    def line(self) -> str:
        """A row of the table under HEADING."""
        free = f"{'only where stated':>25}"
        if self.unstated is not None:
            free = (f"{self.unstated.rmse:7.4f} {self.unstated.coverage:10.3f} "
                    f"{self.unstated.width:6.3f}")
        return (f"{self.name:<20} {self.family:<8} {self.curves:6d} {free} | "
                f"{self.stated.rmse:12.4f} {self.stated.coverage:10.3f} {self.stated.width:6.3f}")


@dataclass(frozen=True)
class TrainedPrior:
    """A prior, what it did on each part left out in turn, and what it was learnt from."""

    prior: LogitMixture
    parts: list[PartScores]
    libraries: Mapping[str, list[ReflectanceLibrary]]

    def facts(self) -> dict[str, object]:
        """As ``spectrabox prior train --json`` names them."""
        prior = self.prior
        factors = {name: {"none stated": prior.band_factors[index, AT_95],
                          "stated": prior.stated_factors[index, AT_95]}
                   for index, name in enumerate(prior.families)}
        return {"left_out_in_turn": [part.facts() for part in self.parts],
                "certificates": prior.certificates, "band_factors_95": factors,
                "curve_factor": prior.curve_factor, "tail": prior.tail, "source": prior.source}

    def text(self) -> str:
        """A table of the parts, and the curves that could not be used."""
        lines = [HEADING, *(part.line() for part in self.parts)]
        lines += [f"{library.name}: left out {count} curves, {reason}"
                  for libraries in self.libraries.values() for library in libraries
                  for reason, count in library.left_out.items()]
        return "\n".join(lines)


def train_prior(libraries: dict[str, list[ReflectanceLibrary]], relative_response: np.ndarray,
                seed: int, *, models: bool = True) -> TrainedPrior:
    """Learn a prior from libraries by the name of their family, each left out in turn.

    Parameters
    ----------
    libraries, relative_response, seed
        As of `sampling.prior.band_calibration.train`.
    models : bool
        Whether it is learnt from the models of skin, leaves, dyes ... too.

    Raises
    ------
    InputError
        For a library that cannot be left out, too few curves, or a family that there is not.
    """
    families = FAMILIES if models else {
        name: replace(family, models={}, stated_components=0, stated_models={})
        for name, family in FAMILIES.items()}
    prior, left_out = train(libraries, relative_response, seed, families)
    return TrainedPrior(prior, [_scores(prior, part) for part in left_out], libraries)


def _scores(prior: LogitMixture, part: LeftOut) -> PartScores:
    def of(kind: str) -> BandScores:
        figures = band_figures(prior, part, kind)
        return BandScores(getattr(part, kind).rmse, figures.coverage, figures.width)

    return PartScores(part.name, part.family, part.curves, part.measured, of("stated"),
                      None if part.unstated is None else of("unstated"))
