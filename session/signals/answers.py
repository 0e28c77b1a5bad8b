"""What ``spectrabox sample`` answers: strings and files in, numbers and a table out."""
from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import (
    Outcome,
    Quantity,
    SpectralMeasurement,
    SpectrumSamples,
    SpectrumSummary,
)
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.spectrum_files import (
    column_index,
    read_table,
    spectrum_of,
    spectrum_on_grid,
)
from spectrabox.sampling.checks import check_measurement
from spectrabox.sampling.error_budget import (
    FLOOR,
    METAMERISM,
)
from spectrabox.sampling.further.more_measurements import MoreMeasurement, doubtful
from spectrabox.sampling.polytope.bounds import bounds_of_many
from spectrabox.sampling.prior.family_coverage import (
    certified_sentence,
    coverage_facts,
    family_coverages,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, load_prior, of_families
from spectrabox.sampling.prior.signal_posterior import describe_outcome
from spectrabox.sampling.prior.summaries import summaries
from spectrabox.sampling.spline_measurement import response_on, spline_operator
from spectrabox.sampling.summary import check_level, summarise
from spectrabox.session.commands.requests import SampleRequest
from spectrabox.session.signals.measurement_file import further_measurements
from spectrabox.session.signals.request_draws import check_options, draws_of
from spectrabox.session.signals.signal_options import (
    GRID_NM,
    causes_of_error,
    measurement_of_signal,
    numbers,
    optional_numbers,
    read_signals,
    relative_to_white,
    signal_and_noise,
)

SHOWN_NM, BASELINE_NM = 25, 50
MAX_SAMPLES = 5_000_000
CURVE_DIGITS = 7        # of curves that are known to 1e-6, so that thousands are written quickly


def sample_answer(request: SampleRequest) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The JSON object and the arrays of the .npz of ``spectrabox sample``.

    Raises
    ------
    InputError, CalibrationError, ConvergenceError
        With what to change.
    """
    check_options(request)
    if not 1 <= request.samples <= MAX_SAMPLES:
        raise InputError(f"{request.samples} samples were asked for; ask for 1 to "
                         f"{MAX_SAMPLES}")
    if (request.signal is None) == (request.signals is None):
        raise InputError("give either --signal v1,v2,v3 or --signals FILE.csv")
    if request.signals is not None and (request.truth or request.photo or request.same
                                        or request.more or request.twice):
        raise InputError("a truth and further measurements belong to one surface; give its "
                         "--signal, not --signals")
    parsed = _parsed(request)
    if request.signal is not None:
        signal = numbers(request.signal, len(parsed.relative_response), "signal")
        facts, draws = _answer(request, parsed, signal)
        return facts, {"spectra": draws.spectra, "coefficients": draws.coefficients,
                       "wavelengths_nm": draws.grid.nm}
    assert request.signals is not None
    signals = read_signals(request.signals, len(parsed.relative_response))
    if request.out is None and may_go_without_draws(request, bool(parsed.more)):
        return {"results": bulk_facts(request, parsed, signals)}, {}
    answers = [_answer(request, parsed, signal) for signal in signals]
    arrays = {"spectra": np.array([draws.spectra for _, draws in answers]),
              "wavelengths_nm": answers[0][1].grid.nm,
              "coefficients": np.array([draws.coefficients for _, draws in answers])}
    return {"results": [facts for facts, _ in answers]}, arrays


def sample_text(facts: dict[str, Any], request: SampleRequest) -> str:
    """The JSON object of `sample_answer` as a text for a person."""
    if "results" not in facts:
        return _text(facts, request)
    return "\n\n".join(f"signal {number}\n{_text(result, request)}"
                       for number, result in enumerate(facts["results"], 1))


def may_go_without_draws(request: SampleRequest, further: bool) -> bool:
    """Whether the answers follow from the mixture: the learnt prior, and nothing that needs draws.

    Parameters
    ----------
    request : SampleRequest
    further : bool
        Whether there are further measurements of the surface.
    """
    return request.method == "prior" and not further and not request.baseline


def bulk_facts(request: SampleRequest, parsed: _Parsed,
               signals: list[np.ndarray]) -> list[dict[str, Any]]:
    """What `sample` answers of each of many signals, without draws but for those that no spectrum
    of the prior gives.

    Parameters
    ----------
    request : SampleRequest
    parsed : _Parsed
    signals : list of (K,) arrays

    Raises
    ------
    InputError, CalibrationError, ConvergenceError
    """
    started, prior = time.perf_counter(), parsed.prior
    assert prior is not None
    check_level(request.level)
    first = measurement_of_signal(parsed.relative_response, signals[0], parsed.white, parsed.noise)
    check_measurement(first)
    y = relative_to_white(np.array(signals), parsed.white)
    photo_noise = np.broadcast_to(first.noise_covariance, (len(y), *first.noise_covariance.shape))
    causes = causes_of_error(y, photo_noise, request.light_error, request.sensitivity_error)
    count = request.coefficients
    bound_lower, bound_upper = bounds_of_many(
        spline_operator(first, count).A, y, np.sum(list(causes.values()), axis=0),
        basis_matrix(PRIOR_GRID.nm, count), request.level)
    found = summaries(prior, response_on(first, PRIOR_GRID), y, causes, request.level)
    seconds = (time.perf_counter() - started) / len(signals)
    results = []
    for row in range(len(signals)):
        if found.outcome[row] is Outcome.TOO_ROUGH:     # draws tell how near one can come
            results.append(_answer(request, parsed, signals[row])[0])
            continue
        shares = dict(zip(prior.families, found.family_shares[row].tolist(), strict=True))
        familiar = found.outcome[row] is Outcome.FAMILIAR
        method = "learnt prior" if familiar else "smoothness prior"
        sentence = describe_outcome(found.outcome[row], prior.stated, shares)
        results.append({
            "wavelengths_nm": PRIOR_GRID.nm.tolist(),
            **{name: getattr(found, name)[row].round(CURVE_DIGITS).tolist()
               for name in ("mean", "standard_deviation", "lower", "upper")},
            "bound_lower": bound_lower[row].tolist(), "bound_upper": bound_upper[row].tolist(),
            "effective_samples": None, "samples": 0, "level": request.level, "method": method,
            "seed": request.seed, "outcome": sentence,
            "conditional_on": f"Conditional on the prior {method}, no draws needed. {sentence}",
            "next_measurement_nm": float(found.next_measurement_nm[row]),
            "bounds_from": "all measurements",
            "error_budget": dict(zip((METAMERISM, *causes, FLOOR), found.budget[row].tolist(),
                                     strict=True)),
            "families": shares, **_certified(prior, shares, familiar), "seconds": seconds})
    return results


@dataclass(frozen=True)
class _Parsed:
    """What the options say, as numbers."""

    relative_response: np.ndarray       # (K, 301)
    white: np.ndarray | None            # (K,)
    noise: np.ndarray | None            # (K,)
    twice: SpectralMeasurement | None
    more: list[MoreMeasurement]
    prior: LogitMixture | None


def _parsed(request: SampleRequest) -> _Parsed:
    relative_response = named_spectra.relative_response(request.sensitivity, request.light,
                                                        visible_grid(GRID_NM))
    bands = len(relative_response)
    white = optional_numbers(request.white, bands, "white")
    more = further_measurements(request.reading, request.photo, request.same, request.more,
                                request.sensitivity, relative_response, white)
    twice = None
    if request.twice is not None:
        signal, noise = signal_and_noise(request.twice, bands, "twice")
        twice = measurement_of_signal(relative_response, signal, white, noise)
    needs_prior = request.method == "prior" or request.prior or more
    return _Parsed(relative_response, white, optional_numbers(request.noise, bands, "noise"), twice,
                   more, of_families(load_prior(request.prior), request.family)
                   if needs_prior else None)


def _answer(request: SampleRequest, parsed: _Parsed,
            signal: np.ndarray) -> tuple[dict[str, Any], SpectrumSamples]:
    started = time.perf_counter()
    prior, more = parsed.prior, parsed.more
    base = measurement_of_signal(parsed.relative_response, signal, parsed.white, parsed.noise)
    causes = causes_of_error(base.signal, base.noise_covariance, request.light_error,
                             request.sensitivity_error)
    base = replace(base, noise_covariance=sum(causes.values(), np.zeros((signal.size,) * 2)))
    draws, measurement, posterior = draws_of(request, base, more, parsed.twice, prior)
    # More measurements than coefficients leave no spline to bound: the signal alone then does, as
    # wide as it may be.
    over_determined = len(measurement.signal) >= draws.coefficients.shape[1]
    bounded = base if over_determined else measurement
    facts = _facts(draws, summarise(draws, bounded, request.level))
    facts["bounds_from"] = ("the signal alone" if over_determined or request.keep
                            else "all measurements")
    if more and prior is not None:
        facts["doubtful"] = doubtful(base, more, prior, request.seed)
    if posterior is not None and not more and parsed.twice is None:
        facts["error_budget"] = posterior.variance_shares(causes)
    if prior is not None and posterior is not None:
        facts["families"] = posterior.family_shares
        facts |= _certified(prior, facts["families"], draws.outcome is Outcome.FAMILIAR)
    if request.baseline or request.truth is not None:
        facts |= _compared(request, base, draws)
    facts["seconds"] = time.perf_counter() - started
    return facts, draws


def _certified(prior: LogitMixture, shares: dict[str, float], familiar: bool) -> dict[str, Any]:
    """What 95 % bands held of the families that a signal allows, as facts and as a sentence."""
    if not familiar:
        return {"certified": [], "certificate": "No certificate: bands of unfamiliar "
                "signals were never judged."}
    families = family_coverages(shares, prior.stated, prior.certificates)
    return {"certified": coverage_facts(families), "certificate": certified_sentence(families)}


def _compared(request: SampleRequest, base: SpectralMeasurement,
              draws: SpectrumSamples) -> dict[str, Any]:
    # colour-science's recovery takes seconds
    from spectrabox.sampling.judge.judgement import baselines, judged

    others = {}
    if request.baseline:
        others = baselines(base, request.samples, request.seed, request.coefficients)
    facts: dict[str, Any] = {}
    if request.baseline:
        # None where the greedy sampler has no draws, as for some signals that can be reached.
        facts["baselines"] = {name: None if other is None else other[0].tolist()
                              for name, other in others.items()}
    if request.truth is not None:
        table = read_table(request.truth)
        column = table.names[column_index(table, request.column)]
        truth = spectrum_on_grid(spectrum_of(table, role=Quantity.REFLECTANCE, column=column),
                                 PRIOR_GRID)
        mine = {request.method: (draws.spectra.mean(axis=0), draws.spectra)}
        facts["judged"] = {name: judged(PRIOR_GRID.nm, truth, other[0], request.delta_light,
                                        other[1])
                           for name, other in (mine | others).items() if other is not None}
    return facts


def _facts(draws: SpectrumSamples, summary: SpectrumSummary) -> dict[str, Any]:
    arrays = {"wavelengths_nm": summary.grid.nm, "mean": summary.mean,
              "standard_deviation": summary.standard_deviation, "lower": summary.lower,
              "upper": summary.upper, "bound_lower": summary.bound_lower,
              "bound_upper": summary.bound_upper}
    return {**{name: values.tolist() for name, values in arrays.items()},
            "effective_samples": draws.effective_samples, "samples": len(draws.spectra),
            "level": summary.level, "method": draws.method, "seed": draws.seed,
            "outcome": draws.sentence, "conditional_on": summary.conditional_on,
            "next_measurement_nm": summary.next_measurement_nm}


def _text(facts: dict[str, Any], request: SampleRequest) -> str:
    lines = [f"{'nm':>5} {'mean':>7} {'sd':>7} {'band':>15} {'bounds':>15}"]
    for index, nm in enumerate(facts["wavelengths_nm"]):
        if nm % SHOWN_NM == 0:
            row = {name: facts[name][index] for name in ("mean", "standard_deviation", "lower",
                                                         "upper", "bound_lower", "bound_upper")}
            lines.append(f"{nm:5.0f} {row['mean']:7.3f} {row['standard_deviation']:7.3f} "
                         f"{row['lower']:7.3f}-{row['upper']:.3f}  "
                         f"{row['bound_lower']:7.3f}-{row['bound_upper']:.3f}")
    if "error_budget" in facts:
        lines.append("variance from: " + ", ".join(f"{name} {100 * share:.1f} %"
                                                   for name, share in facts["error_budget"].items()
                                                   if share > 0))
    lines += facts.get("doubtful", [])
    draws = f"{facts['samples']} draws" if facts["samples"] else "no draws needed"
    lines += [facts["outcome"]] + ([facts["certificate"]] if "certificate" in facts else [])
    lines += [f"{draws}, {facts['method']}; "
              f"{facts['seconds']:.2f} s; the next reading helps most at "
              f"{facts['next_measurement_nm']:.0f} nm"]
    if "judged" in facts:
        from spectrabox.sampling.judge.judgement import judgement_text
        rows = [{"region": "signal", "method": name, **measures} for name,
                measures in facts["judged"].items()]
        lines += ["", judgement_text(rows, request.delta_light)]
    elif "baselines" in facts:
        lines += ["", _baseline_text(facts)]
    return "\n".join(lines)


def _baseline_text(facts: dict[str, Any]) -> str:
    shown = [index for index, nm in enumerate(facts["wavelengths_nm"]) if nm % BASELINE_NM == 0]
    lines = [f"{'nm':<22}" + "".join(f"{facts['wavelengths_nm'][index]:7.0f}" for index in shown)]
    for name, values in {facts["method"]: facts["mean"], **facts["baselines"]}.items():
        cells = "".join(f"{values[index]:7.3f}"
                        for index in shown) if values is not None else " found no spectrum"
        lines.append(f"{name[:22]:<22}{cells}")
    return "\n".join(lines)
