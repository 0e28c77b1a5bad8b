"""The answers of ``spectrabox plan``: for one signal, and for surfaces of a finished session."""
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.measure.planning import (
    mean_over_surfaces,
    next_reading_candidates,
    plan_signal,
    rank_second_photos,
)
from spectrabox.measure.second_photo import LampsAtHand, curves_and_light, lamp_candidates
from spectrabox.measure.signals import measurement_of_signal
from spectrabox.measure.surface_signals import measurement
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_curves
from spectrabox.sampling.further.more_measurements import joined
from spectrabox.sampling.further.planner import PlannedStep
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.session.commands.requests import PlanRequest
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import load_finished
from spectrabox.session.signals.measurement_file import further_measurements
from spectrabox.session.signals.signal_options import numbers, optional_numbers, response_of_names

COMMON = ("D65", "A", "LED-B1", "LED-B5", "LED-RGB1", "LED-V1", "FL11")


def plan_answer(request: PlanRequest) -> tuple[dict[str, Any], str]:
    """JSON object and text of ``spectrabox plan``.

    Raises
    ------
    InputError
    """
    stated = (request.sensitivity, request.light, request.signal)
    if request.folder is not None:
        if any(stated) or request.more or request.reading or request.photo or request.same:
            raise InputError("a session has its own camera, light and signals: give DIR with "
                             "--lamps and --filters alone, or no DIR")
        return _plan_session(request)
    sensitivity, light, signal = stated
    if sensitivity is None or light is None or signal is None:
        raise InputError("nothing to plan for: give the folder of a finished session, or "
                         "--sensitivity, --light and --signal")
    minutes = (request.reading_minutes, request.photo_minutes, request.spot_minutes)
    if any(each is not None and not 0.001 <= each <= 1e6 for each in minutes):     # also of nan
        raise InputError("the minutes of a measurement must lie between 0.001 and 1,000,000")
    response = named_spectra.relative_response(sensitivity, light, FINE_GRID)
    bands = len(response)
    white = optional_numbers(request.white, bands, "white")
    base = measurement_of_signal(response, numbers(signal, bands, "signal"), white,
                                 optional_numbers(request.noise, bands, "noise"))
    taken = further_measurements(request, sensitivity, response, white)
    others = {f"photo under {name}": response_of_names(sensitivity, name)
              for name in request.second_light}
    others |= {f"photo by {name}": response_of_names(name, light)
               for name in request.second_camera}
    chosen, photos, outcome = plan_signal(
        joined(base, taken),
        next_reading_candidates(others, reading_minutes=request.reading_minutes,
                                photo_minutes=request.photo_minutes,
                                spot_minutes=request.spot_minutes),
        lamp_candidates(named_spectra.sensitivities(sensitivity, FINE_GRID),
                                named_spectra.light(light, FINE_GRID), PRIOR_GRID,
                                read_lamps_at_hand(request.lamps, request.filters),
                                minutes=request.photo_minutes),
        request.steps, request.seed)
    facts = {"steps": [{"measurement": step.name, **step_facts(step), "minutes": step.minutes,
                        "fall_per_minute": step.fall_per_minute} for step in chosen],
             "lamps": [{"lamp": step.name, **step_facts(step)} for step in photos],
             "taken": [measured.name for measured in taken], "outcome": outcome}
    lines = [f"{step.name}: mean width of the 95 % band {step.width_before:.3f} -> "
             f"{step.width_after:.3f} in {step.minutes:g} min" for step in chosen]
    return facts, "\n".join([*lines, *_photo_lines(photos), outcome])


def _plan_session(request: PlanRequest) -> tuple[dict[str, Any], str]:
    assert request.folder is not None
    second = read_lamps_at_hand(request.lamps, request.filters)
    config = read_session(request.folder, request.allow_outside)
    records = load_finished(config).records
    signals = records.signals
    curves, present = curves_and_light(records.calibrations(config)[0])
    rankings: dict[str, list[PlannedStep]] = {}
    for index, name in enumerate(signals.names):
        if not signals.known[index]:
            draws = records.sample.spectra[name].samples
            rankings[name] = rank_second_photos(draws.spectra, draws.grid,
                                                measurement(signals, index), curves, present,
                                                second)
    if not rankings:
        raise InputError("every surface of this session has a known spectrum: there is nothing to "
                         "plan")
    averages = mean_over_surfaces(list(rankings.values()))
    best = averages[0]
    facts = {"surfaces": [{"surface": name, "lamps": [{"lamp": step.name, **step_facts(step)}
                                                      for step in steps]}
                          for name, steps in rankings.items()],
             "best": best.name,
             "lamps": [{"lamp": step.name, **step_facts(step)} for step in averages]}
    lines = [line for name, steps in rankings.items() for line in (f"{name}:",
                                                                   *_photo_lines(steps))]
    if len(rankings) > 1:
        lines.append(f"over all surfaces {best.name} brings most: RMSE {best.rmse_before:.4f} -> "
                     f"{best.rmse_after:.4f}")
    return facts, "\n".join(lines)


def read_lamps_at_hand(lamps: str | None, filters: str | None) -> LampsAtHand:
    """Lamps and filters at hand, of two options of names or files separated by commas; common
    lamps where neither is given.

    Raises
    ------
    InputError
        If an option names nothing, or a filter's transmittance is not between 0 and 1.
    """
    chosen = [None if words is None else tuple(word.strip() for word in words.split(",")
                                               if word.strip()) for words in (lamps, filters)]
    if () in chosen:
        raise InputError("no lamp or filter was named; give --lamps D65,A,my.csv or --filters "
                         "yellow.csv")
    names = chosen[0] or (COMMON if chosen[1] is None else ())
    return LampsAtHand({name: named_spectra.light(name, FINE_GRID) for name in names},
                        {name: _transmittance(name) for name in chosen[1] or ()})


def _transmittance(name: str) -> np.ndarray:
    """Transmittance (301,) of a filter."""
    nm, _, curves = read_curves(Path(name))
    values = on_grid(nm, curves[0], FINE_GRID, Path(name).name)
    if values.min() < -0.01 or not 0 < values.max() <= 1.01:
        raise InputError(f"the filter {name} lets {values.min():.3g} to {values.max():.3g} pass; a "
                         "transmittance between 0 and 1 is needed")
    return np.clip(values, 0, 1)


def step_facts(step: PlannedStep) -> Mapping[str, float]:
    """Width and RMSE before and after one step."""
    return {"width_before": step.width_before, "width_after": step.width_after,
            "rmse_before": step.rmse_before, "rmse_after": step.rmse_after}


def _photo_lines(steps: list[PlannedStep]) -> list[str]:
    """A line for each lamp or filter, the best first."""
    return [f"  a second photo with {step.name}: band width {step.width_before:.3f} -> "
            f"{step.width_after:.3f}, expected RMSE {step.rmse_before:.4f} -> "
            f"{step.rmse_after:.4f}" for step in steps]
