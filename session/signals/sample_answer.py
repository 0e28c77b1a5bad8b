"""The answer of ``spectrabox sample``: options and files in, JSON object, table and arrays out."""
from __future__ import annotations

import time
from dataclasses import fields
from typing import Any

import numpy as np

from spectrabox.measure.judgement import compare_methods
from spectrabox.measure.signals import (
    SampleOptions,
    SignalEstimate,
    measurement_of_signal,
    sample_signals,
)
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.spectrum_files import (
    column_index,
    read_table,
    spectrum_of,
    spectrum_on_grid,
)
from spectrabox.sampling.further.swatch_files import read_swatches
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior, of_families
from spectrabox.session.commands.requests import OBSERVER, SampleRequest
from spectrabox.session.signals.measurement_file import further_measurements
from spectrabox.session.signals.signal_options import (
    numbers,
    optional_noise,
    optional_numbers,
    read_named_signals,
    signal_and_noise,
    srgb_signal,
)
from spectrabox.session.terminal.json_values import to_json

SRGB_CAVEAT = ("an sRGB colour is what a camera's processing or a designer made: these are spectra "
               "of surfaces that would look so in daylight, not of what was photographed")
SHOWN_NM, BASELINE_NM = 25, 50
# left out of the answer where they are None
OPTIONAL = ("doubtful", "error_budget", "families", "certified", "certificate")


def sample_answer(request: SampleRequest) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The JSON object and the arrays of the .npz of ``spectrabox sample``.

    Raises
    ------
    InputError, CalibrationError, ConvergenceError
        With what to change.
    """
    if [request.signal, request.signals, request.srgb].count(None) != 2:
        raise InputError("give one of --signal V1,V2,V3, --signals FILE.csv and --srgb R,G,B")
    if request.signals is not None and (request.truth or request.signal_under or request.same
                                        or request.more or request.twice):
        raise InputError("a truth and further measurements belong to one surface; give its "
                         "--signal, not --signals")
    sensitivity, light = request.sensitivity or OBSERVER, request.light or "D65"
    response = named_spectra.relative_response(sensitivity, light, FINE_GRID)
    bands = len(response)
    white = optional_numbers(request.white, bands, "white")
    twice = None
    if request.twice is not None:
        twice_signal, twice_noise = signal_and_noise(request.twice, bands, "twice")
        twice = measurement_of_signal(response, twice_signal, white, twice_noise)
    more = further_measurements(request, sensitivity, response, white)
    noise = optional_noise(request.noise, bands)
    if request.srgb is not None:
        colour, rounding = srgb_signal(request.srgb)
        named, noise = {"": colour}, rounding if noise is None else noise
    else:
        named = read_named_signals(request.signals, bands) if request.signals is not None \
            else {"": numbers(request.signal or "", bands, "signal")}
    signals, one = np.array(list(named.values())), request.signals is None
    options = SampleOptions(**{field.name: getattr(request, field.name)
                               for field in fields(SampleOptions)})
    started = time.perf_counter()
    estimates = sample_signals(
        response, signals, options, white=white,
        noise=noise, light_error=request.light_error,
        sensitivity_error=request.sensitivity_error,
        prior=of_families(load_prior(request.prior), request.family)
        if options.method == "prior" or request.prior or more else None,
        more=more, twice=twice, swatches=None if request.swatches is None
        else read_swatches(request.swatches, bands),
        with_draws=one or request.baseline
        or (request.out is not None and request.out.suffix.lower() == ".npz"))
    results = [_estimate_facts(estimate) for estimate in estimates]
    if request.baseline or request.truth is not None:
        results = [facts | _comparison(request, estimate, options)
                   for facts, estimate in zip(results, estimates, strict=True)]
    seconds = (time.perf_counter() - started) / len(results)
    results = [{"name": name, **facts, "seconds": seconds} if name else
               {**facts, "seconds": seconds} for name, facts in zip(named, results, strict=True)]
    if request.srgb is not None:
        results[0]["caveat"] = SRGB_CAVEAT
    draws = [estimate.draws for estimate in estimates if estimate.draws is not None]
    arrays = {}
    if len(draws) == len(estimates):
        arrays = {"spectra": np.array([each.spectra for each in draws]),
                  "coefficients": np.array([each.coefficients for each in draws])}
        if one:
            arrays = {name: values[0] for name, values in arrays.items()}
        arrays["wavelengths_nm"] = draws[0].grid.nm
    return (results[0] if one else {"results": results}), arrays


def sample_columns(facts: dict[str, Any]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Wavelengths (P,) and, for each signal, its mean, standard deviation and band, as the columns
    of a table.

    Parameters
    ----------
    facts : dict
        Of ``sample_answer``.
    """
    results = facts.get("results", [facts])
    columns = {f"{each.get('name', '')} {name}".strip(): np.array(each[name]) for each in results
               for name in ("mean", "standard_deviation", "lower", "upper")}
    return np.array(results[0]["wavelengths_nm"]), columns


def _estimate_facts(estimate: SignalEstimate) -> dict[str, Any]:
    shown = [field.name for field in fields(estimate)
             if field.name not in ("draws", "measurement", "causes")]
    return {name: to_json(getattr(estimate, name)) for name in shown
            if name not in OPTIONAL or getattr(estimate, name) is not None}


def _comparison(request: SampleRequest, estimate: SignalEstimate,
                options: SampleOptions) -> dict[str, Any]:
    truth = None
    if request.truth is not None:
        table = read_table(request.truth)
        column = table.names[column_index(table, request.column)]
        truth = spectrum_on_grid(spectrum_of(table, role=Quantity.REFLECTANCE, column=column),
                                 PRIOR_GRID)
    baselines, judged = compare_methods(estimate, options, truth, request.delta_light,
                                        request.baseline)
    return {**({"baselines": to_json(baselines)} if request.baseline else {}),
            **({"judged": judged} if truth is not None else {})}


def sample_text(facts: dict[str, Any], request: SampleRequest) -> str:
    """The JSON object of `sample_answer` as a text for a person."""
    if "results" in facts:
        return "\n\n".join(f"signal {result['name']}\n{sample_text(result, request)}"
                           for result in facts["results"])
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
    lines += [facts["caveat"]] if "caveat" in facts else []
    draws = f"{facts['samples']} draws" if facts["samples"] else "computed in closed form"
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
