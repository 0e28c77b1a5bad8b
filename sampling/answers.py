"""What the commands on signals answer: strings and files in, numbers and a table out."""
from __future__ import annotations

import csv
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from radiometry.bspline import basis_matrix
from radiometry.errors import InputError
from radiometry.grid import visible_grid
from radiometry.named_spectra import relative_response
from radiometry.records import SpectrumSummary
from sampling.conditioning import Reading, condition
from sampling.error_budget import error_budget
from sampling.logit_mixture import GRID, LogitMixture, load_prior
from sampling.methods import METHODS, draw_spectra
from sampling.spectral_samples import SpectralMeasurement, SpectralSamples, summarise_spectra

GRID_NM = 1.0           # of the integration; draws and bands are at every 5 nm
SHOWN_NM = 25
MOST_SAMPLES = 5_000_000


@dataclass(frozen=True)
class SampleRequest:
    """The options of ``spectrabox sample`` as given."""

    sensitivity: str
    light: str
    signal: str | None
    signals: Path | None
    white: str | None
    noise: str | None
    coefficients: int
    method: str
    samples: int
    seed: int
    prior: Path | None
    level: float
    start: str
    readings: tuple[str, ...]
    baseline: bool
    light_error: float
    sensitivity_error: float


def sample_answer(request: SampleRequest) -> tuple[dict[str, Any], str, dict[str, np.ndarray]]:
    """The JSON object, the text and the arrays of the .npz of ``spectrabox sample``.

    Raises
    ------
    InputError, CalibrationError, ConvergenceError
        With what to change.
    """
    if request.method not in METHODS:
        raise InputError(f"the method {request.method!r} is not known; known are {', '.join(METHODS)}")
    if request.start not in ("bounded", "unbounded"):
        raise InputError(f"the start {request.start!r} is not known; known are bounded and unbounded")
    if not 1 <= request.samples <= MOST_SAMPLES:
        raise InputError(f"{request.samples} samples were asked for; ask for 1 to {MOST_SAMPLES}")
    if (request.signal is None) == (request.signals is None):
        raise InputError("give either --signal v1,v2,v3 or --signals FILE.csv")
    prior = load_prior(request.prior) if request.method == "prior" or request.prior else None
    response = relative_response(request.sensitivity, request.light, visible_grid(GRID_NM))
    bands = len(response)
    if request.signal is not None:
        facts, draws = _one(request, response, numbers(request.signal, bands, "signal"), prior)
        return facts, _text(facts), {"spectra": draws.spectra, "coefficients": draws.coefficients,
                                     "wavelengths_nm": draws.grid.nm}
    assert request.signals is not None
    rows = read_signals(request.signals, bands)
    found = [_one(request, response, row, prior) for row in rows]
    text = "\n\n".join(f"signal {index + 1}\n{_text(facts)}" for index, (facts, _) in enumerate(found))
    arrays = {"spectra": np.array([draws.spectra for _, draws in found]), "wavelengths_nm": found[0][1].grid.nm,
              "coefficients": np.array([draws.coefficients for _, draws in found])}
    return {"results": [facts for facts, _ in found]}, text, arrays


def causes_of_error(signal: np.ndarray, noise_covariance: np.ndarray, light_error: float,
                    sensitivity_error: float) -> dict[str, np.ndarray]:
    """Covariances (K, K) of a signal by cause: a light error moves all bands together, a curve's its own band.

    Raises
    ------
    InputError
        For a relative error outside 0 to 0.5.
    """
    for name, error in (("light", light_error), ("sensitivity", sensitivity_error)):
        if not 0 <= error < 0.5:
            raise InputError(f"--{name}-error {error:g} is a relative error; 0 to 0.5 is needed")
    return {"photo noise": noise_covariance, "light": light_error**2 * np.outer(signal, signal),
            "sensitivities": sensitivity_error**2 * np.diag(signal**2)}


def measurement_of_signal(response: np.ndarray, signal: np.ndarray, white: str | None,
                          noise: str | None) -> SpectralMeasurement:
    """The measurement relative to white, from a signal (K,) and the options --white and --noise."""
    bands = len(response)
    whites = np.ones(bands) if white is None else numbers(white, bands, "white")
    if np.any(whites <= 0):
        raise InputError(f"the white {white} is not positive in every band; give what a perfect white reads")
    errors = np.zeros(bands) if noise is None else numbers(noise, bands, "noise")
    if np.any(errors < 0):
        raise InputError(f"the noise {noise} is negative; give standard errors")
    relative = signal / whites
    if np.any(np.abs(relative) > 2):
        raise InputError(f"the signal is {np.abs(relative).max():.3g} times white; give what white reads with --white")
    return SpectralMeasurement(visible_grid(GRID_NM), response, relative, np.diag((errors / whites)**2))


def numbers(text: str, bands: int, name: str) -> np.ndarray:
    """Numbers (K,) of an option such as 0.2,0.3,0.1."""
    try:
        values = np.array([float(part) for part in text.replace(";", ",").split(",")])
    except ValueError:
        raise InputError(f"--{name} {text!r} is not a list of numbers; write v1,v2,v3") from None
    if values.size != bands:
        raise InputError(f"--{name} has {values.size} values; the sensitivities have {bands} bands")
    if not np.all(np.isfinite(values)):
        raise InputError(f"--{name} {text!r} holds a value that is not finite")
    return values


def read_signals(path: Path, bands: int) -> list[np.ndarray]:
    """Signals (K,) of a CSV: a header of band names, one signal per row."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); give a CSV of signals") from None
    except UnicodeDecodeError:
        raise InputError(f"{path.name} is not a text file; give a CSV of signals") from None
    rows = [row for row in csv.reader(lines) if any(map(str.strip, row))]
    if len(rows) < 2:
        raise InputError(f"{path.name} holds no signals; a header of band names and one signal per row are needed")
    return [numbers(",".join(row), bands, f"signals {path.name} row {index + 2}") for index, row in enumerate(rows[1:])]


def parse_reading(text: str) -> Reading:
    """A reading written as NM:REFLECTANCE or NM:REFLECTANCE:ERROR."""
    parts = text.split(":")
    try:
        values = [float(part) for part in parts]
    except ValueError:
        values = []
    if len(values) not in (2, 3):
        raise InputError(f"--reading {text!r} cannot be read; write NM:REFLECTANCE or NM:REFLECTANCE:ERROR")
    return Reading.at_wavelength(values[0], values[1], values[2] if len(values) == 3 else 0.005)


def _one(request: SampleRequest, response: np.ndarray, signal: np.ndarray,
         prior: LogitMixture | None) -> tuple[dict[str, Any], SpectralSamples]:
    started = time.perf_counter()
    measurement = measurement_of_signal(response, signal, request.white, request.noise)
    causes = causes_of_error(measurement.signal, measurement.noise_covariance, request.light_error,
                             request.sensitivity_error)
    measurement = replace(measurement, noise_covariance=sum(causes.values(), np.zeros((len(signal),) * 2)))
    seen_by_camera = measurement
    measurement = condition(measurement, [parse_reading(text) for text in request.readings])
    draws = draw_spectra(measurement, request.method, request.samples, request.seed, request.coefficients, prior,
                         request.start == "unbounded")
    summary = summarise_spectra(draws, measurement, request.level)
    facts = _facts(draws, summary)
    if prior is not None and request.method == "prior" and not request.readings:
        budget = error_budget(prior, seen_by_camera, causes)
        total = float(np.mean(sum(budget.values(), np.zeros(1))))
        facts["error_budget"] = {name: float(np.mean(variance)) / total for name, variance in budget.items()}
    if request.baseline:
        facts["baselines"] = _baselines(seen_by_camera, request)
    facts["seconds"] = time.perf_counter() - started
    return facts, draws


def _baselines(measurement: SpectralMeasurement, request: SampleRequest) -> dict[str, list[float] | None]:
    from sampling.baselines import baseline_spectra, greedy_draws  # colour-science's recovery takes seconds

    found: dict[str, list[float] | None] = {name: spectrum.tolist()
                                            for name, spectrum in baseline_spectra(measurement).items()}
    c, _ = greedy_draws(measurement.operator(request.coefficients), request.samples, request.seed)
    # None where the greedy sampler finds nothing, as it does for some signals that can be reached.
    found["Belcour-style greedy, mean"] = (c.mean(axis=0) @ basis_matrix(GRID.nm, request.coefficients).T).tolist() \
        if len(c) else None
    return found


def _facts(draws: SpectralSamples, summary: SpectrumSummary) -> dict[str, Any]:
    arrays = {"wavelengths_nm": summary.grid.nm, "mean": summary.mean, "standard_deviation": summary.standard_deviation,
              "lower": summary.lower, "upper": summary.upper, "bound_lower": summary.bound_lower,
              "bound_upper": summary.bound_upper}
    return {**{name: values.tolist() for name, values in arrays.items()},
            "effective_samples": draws.effective_samples, "samples": len(draws.spectra), "level": summary.level,
            "method": draws.method, "seed": draws.seed, "outcome": draws.outcome,
            "conditional_on": summary.conditional_on, "next_measurement_nm": summary.next_measurement_nm}


def _text(facts: dict[str, Any]) -> str:
    lines = [f"{'nm':>5} {'mean':>7} {'sd':>7} {'band':>15} {'bounds':>15}"]
    for index, nm in enumerate(facts["wavelengths_nm"]):
        if nm % SHOWN_NM == 0:
            row = {name: facts[name][index] for name in ("mean", "standard_deviation", "lower", "upper", "bound_lower",
                                                         "bound_upper")}
            lines.append(f"{nm:5.0f} {row['mean']:7.3f} {row['standard_deviation']:7.3f} "
                         f"{row['lower']:7.3f}-{row['upper']:.3f}  {row['bound_lower']:7.3f}-{row['bound_upper']:.3f}")
    if "error_budget" in facts:
        lines.append("variance from: " + ", ".join(f"{name} {100 * share:.1f} %"
                                                   for name, share in facts["error_budget"].items() if share > 0))
    lines += [facts["outcome"], f"{facts['samples']} draws, {facts['method']}; {facts['seconds']:.2f} s; "
              f"the next reading helps most at {facts['next_measurement_nm']:.0f} nm"]
    return "\n".join(lines)
