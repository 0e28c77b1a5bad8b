"""Conformal calibration of the learnt prior's bands, on libraries and models left out in turn.

A part that is left out is judged twice by a prior that has not seen it: with its family stated, and
with none. Its scores are the factors by which the 95 % band, and those of other levels, would have
had to be wider about the mean to hold the truth. Bands are first made wider or narrower for how
wide they are (mixture_posterior.py). Per family and level,

    factor(nm) = s shape(nm)

where the shape is the quantile of the scores in every tenth of wavelengths over that of all, joined
by straight lines, mean of the family's parts; and s is the least at which no part misses more than
1 - level of all. Below 430 nm, where measured libraries begin late or step widely, the shape is at
least what it is in the middle. Of a family with measured libraries those are the parts; models are
then too convenient a judge. Of a family without, what the models left out in turn make is pooled,
none of them may be missed 1.2 times as often as stated, and the factors are bounded: a theory does
not certify itself, and leaving out all petals asks more than petals will. A library of mixed
surfaces judges bands with none stated only.

Models that are fitted only where their family is stated are judged there alone.

With no family stated a signal takes each family's factor by the share that its posterior gives it,
and all of them are widened once more by COMMON, for what no family at hand was left out of.

Bands of signals that are unlike all training data grow with how unlikely they are
(mixture_posterior.tail_growth). How fast is found on such signals: of libraries and models left out
in turn, of families left out whole, and of the most colourful tenth of all curves left out. It is
the least at which the bands of each of the three hold what they state where the signal is beyond
the limit. The families' factors are found before, without it: few of their signals are unlikely.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spectrabox.radiometry.appearance import reflectance_to_lab
from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.prior.families.family_models import FAMILIES, Family
from spectrabox.sampling.prior.family_coverage import FamilyCertificate
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, of_families
from spectrabox.sampling.prior.mixture_posterior import (
    FAMILIAR,
    central_band,
    conformal_scores,
    mean_and_spread,
    posterior,
    tail_growth,
    widened,
    width_factors,
)

from tools.prior_training import (
    LEVELS,
    MIN_CURVES,
    Fitted,
    Library,
    Part,
    fitted_families,
    joined,
    parts_of,
)

JUDGED = 300                    # curves of a part that are judged
TENTHS = 10
MEASURED_LIMITS = (0.7, 2.0)    # of factors
SLACK = 0.2                     # a model is missed no more than this share more often than stated
MODEL_LIMITS = {"stated": (1.0, 1.8), "unstated": (0.75, 1.5)}
# Dyed cloth, plastics and skins of which no library was trained on: at 1.08 the even half of CES99
# is held at 94 % of wavelengths.
COMMON = 1.08
COLOURFUL = 0.9                 # quantile of chroma above which all curves are left out together
FEWEST = 20                     # unlikely signals that the growth of bands is found on
TAILS = np.linspace(0, 4, 401)
AT_95 = int(np.argmin(np.abs(LEVELS - 0.95)))


@dataclass(frozen=True)
class Judgement:
    """How bands did on curves that the mixture had not seen, before calibration."""

    rmse: float
    scores: np.ndarray          # (levels, curves, 61): factors that the bands would have needed
    width: np.ndarray           # (levels, 61): mean width of the bands
    shares: np.ndarray          # (curves, F) of the families
    surprise: np.ndarray        # (curves,)
    families: tuple[str, ...]   # F, of the prior


@dataclass(frozen=True)
class LeftOut:
    """A library or model that was left out, with its family stated and with none."""

    name: str
    family: str
    measured: bool
    mixed: bool                 # of surfaces of several families
    curves: int
    stated: Judgement
    unstated: Judgement | None  # None of a model that counts only where its family is stated


def train(libraries: dict[str, list[Library]], relative_response: np.ndarray,
          seed: int = 0,
          families: dict[str, Family] = FAMILIES) -> tuple[LogitMixture, list[LeftOut]]:
    """Fit the prior to libraries and models, and calibrate it on each of them left out in turn.

    Parameters
    ----------
    libraries : lists of Library by the name of their family, or "mixed"
        At least two of a family that has no models, so that one can be left out.
    relative_response : (K, 61) array
        Of the camera that the calibration is made with, rows summing to 1.
    seed : int
    families : by name
        With their models.

    Raises
    ------
    InputError
        For a library that cannot be left out, too few curves, or a family that there is not.
    """
    names = [f"{name} ({len(reflectances)})"
             for listed in libraries.values() for name, reflectances in listed]
    parts = parts_of(libraries, families, seed, JUDGED)
    fitted = fitted_families(parts, families, seed)
    left_out = []
    for part in parts:
        without = prior_without(part, parts, fitted, families, seed)
        stated = judge(of_families(without, [part.family]), relative_response, part.judged)
        left_out.append(LeftOut(
            part.name, part.family, part.measured, part.mixed, len(part.judged), stated,
            None if part.stated else judge(without, relative_response, part.judged)))
    models = [f"{family}: {part.name}" for family in fitted.plain for part in parts
              if part.family == family and not part.measured]
    prior = calibrated(joined(fitted, families, "; ".join(names + models)), left_out)
    groups = [[one.unstated for one in left_out if one.unstated is not None],
              *([judge(without, relative_response, curves) for without, curves in group]
                for group in (without_families(parts, fitted, families),
                              without_colourful(parts, families, seed)))]
    return replace(prior, certificates=certificates(prior, left_out),
                   tail=tail_of(prior, groups)), left_out


def prior_without(part: Part, parts: Sequence[Part], fitted: Fitted,
                  families: dict[str, Family], seed: int) -> LogitMixture:
    """The prior, not calibrated, that has not seen a part; families were fitted with all of them.

    A model that is its family's only part stays: it is judged on other draws of its own.

    Parameters
    ----------
    part : Part
        What is left out.
    parts : sequence of Part
        All of them.
    fitted : Fitted
        With all parts.
    families : dict of Family
        By name.
    seed : int

    Raises
    ------
    InputError
        For a library that is all there is of its family.
    """
    others = [one for one in parts if one.family == part.family and one is not part]
    if part.measured and not others:
        raise InputError(f"{part.name} is all there is of {part.family}, and one library cannot be "
                         "left out of itself; give at least two folders of its family")
    again = fitted_families(others, {part.family: families[part.family]}, seed)
    return joined(Fitted(fitted.plain | again.plain, fitted.stated | again.stated), families)


def without_families(parts: Sequence[Part], fitted: Fitted, families: dict[str, Family]
                     ) -> list[tuple[LogitMixture, np.ndarray]]:
    """Of each family the prior, not calibrated, that has seen none of it, and its curves (n, 61);
    nothing where there is but one family.

    Parameters
    ----------
    parts : sequence of Part
        All of them.
    fitted : Fitted
        With all parts.
    families : dict of Family
        By name.
    """
    others = [(name, {other: mixture for other, mixture in fitted.plain.items() if other != name})
              for name in fitted.plain]
    return [(joined(Fitted(plain, {}), families),
             np.concatenate([part.judged for part in parts
                             if part.family == name and not part.stated]))
            for name, plain in others if plain]


def without_colourful(parts: Sequence[Part], families: dict[str, Family], seed: int
                      ) -> list[tuple[LogitMixture, np.ndarray]]:
    """The prior, not calibrated, that has seen no curve of the most colourful tenth, and those
    curves (n, 61) of what is judged; nothing where too few curves are left to learn from.

    Parameters
    ----------
    parts : sequence of Part
        All of them.
    families : dict of Family
        By name.
    seed : int
    """
    plain = [part for part in parts if not part.stated]
    limit = np.quantile(chroma(np.concatenate([part.judged for part in plain])), COLOURFUL)
    duller = [replace(part, curves=part.curves[chroma(part.curves) < limit]) for part in plain]
    few = {name for name in families
           if sum(len(part.curves) for part in duller if part.family == name) < MIN_CURVES}
    fitted = fitted_families([part for part in duller if part.family not in few], families, seed)
    left = np.concatenate([part.judged[chroma(part.judged) >= limit] for part in plain])
    return [(joined(fitted, families), left)] if fitted.plain else []


def chroma(reflectances: np.ndarray) -> np.ndarray:
    """Chroma (n,) in CIELAB under D65 of reflectances (n, 61)."""
    return np.asarray(np.hypot(*reflectance_to_lab(PRIOR_GRID.nm, reflectances)[:, 1:].T))


def tail_of(prior: LogitMixture, groups: Sequence[Sequence[Judgement]]) -> float:
    """The least tail at which the 95 % bands of unlikely signals hold what they state, in each
    group that has enough of them; 0 where none has.

    Parameters
    ----------
    prior : LogitMixture
        Calibrated but for its tail.
    groups : sequence of sequences of Judgement
        Of curves that the priors which judged them had not seen.
    """
    tails = [0.0]
    for group in groups:
        if sum(one.surprise.size for one in group) < FEWEST:
            continue
        scores = np.concatenate([one.scores[AT_95] / (one.shares @ prior.band_factors[
            [prior.families.index(name) for name in one.families], AT_95]) for one in group])
        novelty = np.concatenate([one.surprise for one in group]) / prior.familiar_surprise
        far = novelty > 1
        if far.sum() >= FEWEST:
            held = np.array([np.mean(scores[far] <= tail_growth(tail, novelty[far])[:, None])
                             for tail in TAILS])
            tails.append(float(TAILS[np.argmax(held >= LEVELS[AT_95])] if held[-1] >= LEVELS[AT_95]
                               else TAILS[-1]))
    return max(tails)


def judge(prior: LogitMixture, relative_response: np.ndarray,
          reflectances: np.ndarray) -> Judgement:
    """Bands of every level for noise-free signals of reflectances (n, 61), against the truth.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (K, 61) array
        Rows summing to 1.
    reflectances : (n, 61) array
        That the prior has not seen.
    """
    bands = len(relative_response)
    mixture = posterior(prior, relative_response, reflectances @ relative_response.T,
                        np.zeros((bands, bands)))
    mean, spread = mean_and_spread(mixture)
    adapted = width_factors(prior, spread)
    intervals = [widened(mean, *central_band(mixture, level), adapted) for level in LEVELS]
    scores = np.array([conformal_scores(mean, lower, upper, reflectances)
                       for lower, upper in intervals])
    widths = np.array([np.mean(upper - lower, axis=0) for lower, upper in intervals])
    rmse = float(np.sqrt(np.mean((mean - reflectances)**2, axis=1)).mean())
    return Judgement(rmse, scores, widths, prior.shares(mixture.weights),
                     np.asarray(mixture.surprise), prior.families)


def calibrated(prior: LogitMixture, left_out: Sequence[LeftOut]) -> LogitMixture:
    """The prior with band factors from what was left out in turn; see the head of this file.

    Parameters
    ----------
    prior : LogitMixture
    left_out : sequence of LeftOut
    """
    stated, unstated = (np.array([[_factor(judges, index) for index in range(LEVELS.size)]
                                  for judges in _by_family(prior, left_out, kind)])
                        for kind in ("stated", "unstated"))
    unstated *= COMMON
    free = [(one.measured, one.unstated) for one in left_out if one.unstated is not None]
    widest = [(one.scores[AT_95] / (one.shares @ unstated[:, AT_95])).max(axis=1)
              for measured, one in free if measured]
    surprise = np.concatenate([one.surprise for _, one in free])
    return replace(prior, band_factors=unstated, stated_factors=stated,
                   curve_factor=float(np.quantile(np.concatenate(widest), 0.95)),
                   familiar_surprise=float(np.quantile(surprise, FAMILIAR)))


def certificates(prior: LogitMixture,
                 left_out: Sequence[LeftOut]) -> dict[str, FamilyCertificate]:
    """What the calibrated 95 % bands held of every family: of its measured libraries left out in
    turn, or where there are none of what its models make.

    Parameters
    ----------
    prior : LogitMixture
        Calibrated.
    left_out : sequence of LeftOut
    """
    table = {}
    for name in prior.families:
        mine = [part for part in left_out if part.family == name and not part.mixed]
        mine = [part for part in mine if part.measured] or mine
        if mine:
            bands = {kind: [band_figures(prior, part, kind) for part in mine
                            if getattr(part, kind) is not None] for kind in ("stated", "unstated")}
            table[name] = FamilyCertificate(
                mine[0].measured, len(mine) if len(mine) > 1 else 0,
                sum(part.curves for part in mine),
                **{kind: {"coverage": min(coverage for coverage, _ in each),
                          "width": float(np.mean([width for _, width in each]))}
                   for kind, each in bands.items()})
    return table


def band_figures(prior: LogitMixture, part: LeftOut, kind: str) -> tuple[float, float]:
    """Share of wavelengths that the calibrated 95 % bands held of a part left out, its family
    "stated" or "unstated", and their mean width.

    Parameters
    ----------
    prior : LogitMixture
        Calibrated.
    part : LeftOut
    kind : str
        "stated" or "unstated".
    """
    judgement: Judgement = getattr(part, kind)
    factor = prior.stated_factors[prior.families.index(part.family), AT_95] \
        if kind == "stated" else judgement.shares @ prior.band_factors[:, AT_95]
    return (float(np.mean(judgement.scores[AT_95] <= factor)),
            float(np.mean(judgement.width[AT_95] * factor)))


@dataclass(frozen=True)
class _Judges:
    """What sets the factors of one family: scores (levels, n, 61) of groups of curves."""

    groups: list[np.ndarray]            # each to be missed no more often than stated
    models: list[np.ndarray]            # each to be missed no more than SLACK more often
    limits: tuple[float, float]


def _factor(judges: _Judges, index: int) -> np.ndarray:
    """Factor (61,) of one family at one level."""
    level = LEVELS[index]
    tenths = np.array_split(np.arange(PRIOR_GRID.nm.size), TENTHS)
    shape = np.mean([[np.quantile(scores[index][:, tenth], level) for tenth in tenths]
                     / np.quantile(scores[index], level) for scores in judges.groups], axis=0)
    shape[0] = max(shape[0], np.median(shape))
    shape = np.interp(PRIOR_GRID.nm, [PRIOR_GRID.nm[tenth].mean() for tenth in tenths], shape)
    allowed = [(scores, level) for scores in judges.groups] \
        + [(scores, 1 - (1 + SLACK) * (1 - level)) for scores in judges.models]
    enough = max(float(np.quantile(scores[index] / shape, share)) for scores, share in allowed)
    return np.clip(enough * shape, *judges.limits)


def _by_family(prior: LogitMixture, left_out: Sequence[LeftOut], kind: str) -> list[_Judges]:
    judges = []
    for name in prior.families:
        scores = [(one.measured, judgement.scores) for one in left_out
                  if one.family == name and not (one.mixed and kind == "stated")
                  and (judgement := getattr(one, kind)) is not None]
        measured = [values for is_measured, values in scores if is_measured]
        models = [values for is_measured, values in scores if not is_measured]
        judges.append(_Judges(measured, [], MEASURED_LIMITS) if measured else
                     _Judges([np.concatenate(models, axis=1)], models, MODEL_LIMITS[kind]))
    return judges
