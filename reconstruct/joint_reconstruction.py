"""Several photos of the same materials as one answer: each photo's own record, and the bands of all
of them stacked.
"""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spectrabox.radiometry.records import (
    JointReconstruction,
    Outcome,
    Reconstruction,
    RegionTransport,
)
from spectrabox.radiometry.response import relative_operator, white_signal
from spectrabox.reconstruct.engines.transport_engine import ViewsAnswer
from spectrabox.reconstruct.fit.identifiability import band_signals, identifiability, sentences
from spectrabox.reconstruct.fit.traced_fit import unknown_materials
from spectrabox.reconstruct.fit.transport_fit import TransportFit
from spectrabox.reconstruct.problem import EngineAnswer, InverseProblem

SAME = 1e-9             # relative: responses closer than this are one
# of white: error given to every stacked signal, so that bands which repeat others stay regular
REDUNDANT = 1e-4


def engine_answers(problems: Sequence[InverseProblem], answer: ViewsAnswer) -> tuple[EngineAnswer,
                                                                                     ...]:
    """What each photo's record needs of a joint fit."""
    fit, unknown = answer.fit, unknown_materials(problems)
    names = [material.bsdf for material in unknown]
    found = identifiability(fit, tuple(material.name for material in unknown),
                            np.vstack([_operator(problem) for problem in problems]))
    outcome = Outcome.ILL_POSED if fit.outcome is Outcome.CONVERGED and any(item.by_prior for item in found) \
        else fit.outcome
    answers = []
    for number, problem in enumerate(problems):
        mine = [names.index(material.bsdf) for material in problem.unknown]
        signals, covariance = band_signals(fit, _operator(problem), len(names))
        view = fit.views[number]
        answers.append(EngineAnswer(
                           fit.coefficients[mine], signals[mine], covariance[mine],
                           answer.rendered[number], fit.cost_history, answer.engines[number],
                           answer.spp[number], outcome,
                           sentences(found) + view.sentences(problem.bands,
                                                             [name for name,
                                                              in problem.light_groups]),
                           (view.scale, view.scale_error)))
    return tuple(answers)


def joint_record(problems: Sequence[InverseProblem], views: Sequence[Reconstruction],
                 fit: TransportFit | None,
                 regions: Sequence[RegionTransport | None] = ()) -> JointReconstruction:
    """The views' records with their bands stacked.

    Parameters
    ----------
    problems, views : V each
    fit : TransportFit or None
        None where an engine of one photo found the answer; its signals are taken as they are.
    regions : of each view
        Left out where a view has none.
    """
    distinct = [number for number, problem in enumerate(problems)
                if not any(_alike(problem, other) for other in problems[:number])]
    shown = {name: (view, place) for view in reversed(views) for place,
             name in enumerate(view.materials)}
    materials = tuple(dict.fromkeys(name for view in views for name in view.materials))
    spectra = np.array([shown[name][0].spectra[shown[name][1]] for name in materials])
    known = tuple(shown[name][0].known[shown[name][1]] for name in materials)
    response = np.vstack([problems[number].response / white_signal(problems[number].response)[:,
                                                                                              None]
                          for number in distinct])
    view_of_band = np.repeat(distinct, [len(problems[number].bands) for number in distinct])
    signal = spectra @ response.T
    covariance = np.zeros((len(materials), len(response), len(response)))
    if fit is None:
        signal, covariance = np.array(views[0].signal), np.array(views[0].signal_covariance)
    else:
        unknown = [material.name for material in unknown_materials(problems)]
        stacked = band_signals(fit, response @ problems[0].basis, len(unknown))
        mine = [materials.index(name) for name in unknown]
        signal[mine], covariance[mine] = stacked
    model = np.zeros_like(covariance)
    for number in distinct:
        bands = np.flatnonzero(view_of_band == number)
        alike = [view for problem, view in zip(problems, views, strict=True) if _alike(problem,
                                                                                       problems[
                                                                                           number])]
        for place, name in enumerate(materials):
            parts = [view.model_covariance[view.materials.index(name)] for view in alike
                     if name in view.materials]
            # the mean, not divided by their number: what is wrong with one is wrong with the other
            if parts:
                model[place][np.ix_(bands, bands)] = np.mean(parts, axis=0)
    return JointReconstruction(
        tuple(views), tuple(problem.name for problem in problems), materials, known,
        problems[0].grid, spectra, tuple(f"{problems[number].name}: {band}" for number in distinct
                                         for band in problems[number].bands), view_of_band,
        response, signal,
        covariance + (REDUNDANT**2 * np.eye(len(response)) if len(problems) > 1 else 0.0), model,
        tuple(one for one in regions if one is not None))


def _operator(problem: InverseProblem) -> np.ndarray:
    return relative_operator(problem.response, problem.basis)


def _alike(problem: InverseProblem, other: InverseProblem) -> bool:
    a, b = (one.response / white_signal(one.response)[:, None] for one in (problem, other))
    return a.shape == b.shape and bool(np.abs(a - b).max() <= SAME * np.abs(b).max())
