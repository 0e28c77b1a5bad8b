"""The answers of ``spectrabox plan``: for one signal, and for surfaces of a finished session."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.measure.captured import Capture
from spectrabox.measure.more_bands.further_photos import (
    LampsAtHand,
    curves_and_light,
    photos_at_hand,
    white_of_bands,
)
from spectrabox.measure.more_bands.joined_errors import Surface
from spectrabox.measure.more_bands.planning import (
    next_reading_candidates,
    plan_signal,
    rank_photos,
)
from spectrabox.measure.more_bands.second_photo import KnownSurface, SecondPhoto
from spectrabox.measure.records import CaptureRecords
from spectrabox.measure.signals.sample import measurement_of_signal
from spectrabox.measure.surfaces.surface_signals import FEW_BANDS, measurement
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.filters import filters_at_hand
from spectrabox.radiometry.spectra.spectrum_files import on_grid
from spectrabox.sampling.further.more_measurements import joined
from spectrabox.sampling.further.planner import PlannedStep
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior, of_families
from spectrabox.sampling.spectral_measurement import without_states
from spectrabox.session.commands.requests import PlanRequest
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import load_finished
from spectrabox.session.signals.measurement_file import further_measurements
from spectrabox.session.signals.signal_options import (
    numbers,
    optional_noise,
    optional_numbers,
    response_of_names,
)

COMMON = ("D65", "A", "LED-B1", "LED-B5", "LED-RGB1", "LED-V1", "FL11")


def plan_answer(request: PlanRequest) -> tuple[dict[str, Any], str]:
    """JSON object and text of ``spectrabox plan``.

    Raises
    ------
    InputError
    """
    stated = (request.sensitivity, request.light, request.signal)
    if request.folder is not None:
        if any(stated) or request.more or request.reading or request.signal_under or request.same:
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
                                 optional_noise(request.noise, bands))
    taken = further_measurements(request, sensitivity, response, white)
    others = {f"photo under {name}": response_of_names(sensitivity, name)
              for name in request.second_light}
    others |= {f"photo by {name}": response_of_names(name, light)
               for name in request.second_camera}
    curves = named_spectra.sensitivities(sensitivity, FINE_GRID)
    present = named_spectra.light(light, FINE_GRID)
    chosen, photos, outcome = plan_signal(
        joined(base, taken),
        next_reading_candidates(others, reading_minutes=request.reading_minutes,
                                photo_minutes=request.photo_minutes,
                                spot_minutes=request.spot_minutes),
        photos_at_hand(curves, present, read_lamps_at_hand(request.lamps, request.filters)),
        white_of_bands(curves, present), request.steps, request.seed)
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
    finished = load_finished(config)
    capture, records = finished.capture, finished.records
    signals = records.signals
    curves, present = curves_and_light(records.calibrations(capture.views)[0])
    surfaces = {name: _known_surface(capture, records, index)
                for index, name in enumerate(signals.names) if not signals.known[index]}
    if not surfaces:
        raise InputError("every surface of this session has a known spectrum: there is nothing to "
                         "plan")
    rankings, averages = rank_photos(surfaces, photos_at_hand(curves, present, second),
                                     white_of_bands(curves, present))
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


def _known_surface(capture: Capture, records: CaptureRecords, index: int) -> KnownSurface:
    """What a finished session knows of one surface."""
    signals, fit = records.signals, records.calibrate.chart
    name, calibration = signals.names[index], records.calibrations(capture.views)[0]
    draws = records.sample.spectra[name].samples
    surface = None
    first = signals.view_of_band == signals.view_of_band[0]
    seen = np.isfinite(signals.signal[index])
    # of more bands a measurement holds a choice, whose first are not the first photo's
    if fit is not None and fit.patch_error is not None and seen[first].all() \
            and np.count_nonzero(seen) <= FEW_BANDS:
        surface = Surface(signals, index, calibration, capture.lit_chart.reflectances,
                          float(fit.patch_error[0]))
    return KnownSurface(of_families(load_prior(), capture.surfaces[name].families),
                        without_states(measurement(signals, index)),
                        on_grid(draws.grid.nm, draws.spectra, PRIOR_GRID, name), surface)


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
                       {name: filter for word in chosen[1] or ()
                        for name, filter in filters_at_hand(Path(word)).items()})


def step_facts(step: PlannedStep) -> dict[str, Any]:
    """Width and RMSE before and after one step; of photos the exposure to add, and dark bands."""
    facts: dict[str, Any] = {"width_before": step.width_before, "width_after": step.width_after,
                             "rmse_before": step.rmse_before, "rmse_after": step.rmse_after}
    if isinstance(step, SecondPhoto):
        facts |= {"stops": list(step.stops), "dark_bands": list(step.dark_bands)}
    return facts


def _photo_lines(steps: Sequence[SecondPhoto]) -> list[str]:
    """A line for each lamp, filter or pair of filters, the best first."""
    return [f"  a further photo with {step.name}: band width {step.width_before:.3f} -> "
            f"{step.width_after:.3f}, expected RMSE {step.rmse_before:.4f} -> "
            f"{step.rmse_after:.4f}{exposure_words(step)}" for step in steps]


def exposure_words(step: SecondPhoto) -> str:
    """Exposure to add to further photos and the bands that they leave dark, as an answer says it.
    """
    words = ""
    if any(abs(stops) >= 0.05 for stops in step.stops):
        words += f"; expose {' and '.join(f'{stops:+.1f}' for stops in step.stops)} stops"
    if step.dark_bands:
        words += f"; dark: band {', '.join(map(str, step.dark_bands))} of the further bands"
    return words
