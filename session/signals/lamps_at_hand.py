"""``spectrabox plan`` on a session: what a second photo with the lamps at hand would add."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.measure.second_photo import (
    FINE,
    LampsAtHand,
    curves_and_light,
    lamp_candidates,
)
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_curves
from spectrabox.sampling.further.planner import (
    PlannedStep,
    ranked,
)

COMMON = ("D65", "A", "LED-B1", "LED-B5", "LED-RGB1", "LED-V1", "FL11")


def lamps_at_hand(lamp_words: str | None, filter_words: str | None) -> LampsAtHand:
    """Lamps and filters of two options, separated by commas; common lamps where neither is given.

    Raises
    ------
    InputError
        If an option names nothing.
    """
    chosen = [None if words is None else tuple(word.strip() for word in words.split(",")
                                               if word.strip())
              for words in (lamp_words, filter_words)]
    if () in chosen:
        raise InputError("no lamp or filter was named; give --lamps D65,A,my.csv or --filters "
                         "yellow.csv")
    lamps = chosen[0] or (COMMON if chosen[1] is None else ())
    return LampsAtHand({name: named_spectra.light(name, FINE) for name in lamps},
                       {name: _transmittance(name) for name in chosen[1] or ()})


def _transmittance(name: str) -> np.ndarray:
    """Transmittance (301,) of a filter."""
    nm, _, curves = read_curves(Path(name))
    values = on_grid(nm, curves[0], FINE, Path(name).name)
    if values.min() < -0.01 or not 0 < values.max() <= 1.01:
        raise InputError(f"the filter {name} lets {values.min():.3g} to {values.max():.3g} pass; a "
                         "transmittance between 0 and 1 is needed")
    return np.clip(values, 0, 1)


def session_plan(folder: Path, hand: LampsAtHand,
                 allow_outside: bool) -> tuple[dict[str, Any], str]:
    """JSON object and text of ``spectrabox plan`` on a finished session.

    Raises
    ------
    InputError
    """
    from spectrabox.measure.surface_signals import measurement
    from spectrabox.session.config.session_file import read_session
    from spectrabox.session.pipeline import load_finished
    from spectrabox.session.stages.stored_records import calibrations_of, samples_of
    from spectrabox.session.stages.surface_signals import surface_signals

    config = read_session(folder, allow_outside)
    stored = load_finished(config).stored
    signals = surface_signals(config, stored)
    curves, present = curves_and_light(calibrations_of(config, stored)[0])
    surfaces, lines = [], []
    for index, name in enumerate(signals.names):
        if signals.known[index]:
            continue
        draws = samples_of(stored, name)[0]
        error = float(np.sqrt(np.mean(np.diag(measurement(signals, index).noise_covariance))))
        steps = ranked(np.cov(draws.spectra, rowvar=False), lamp_candidates(
            curves, present, draws.grid, hand, standard_error=error))
        surfaces.append({"surface": name, "lamps": [{"lamp": step.name, **step_facts(step)}
                                                    for step in steps]})
        lines += [f"{name}:", *lamp_lines(steps)]
    if not surfaces:
        raise InputError("every surface of this session has a known spectrum: there is nothing to "
                         "plan")
    means = {lamp: _mean(surfaces, lamp) for lamp in (*hand.lamps, *hand.filters)}
    best = min(means, key=lambda lamp: means[lamp]["rmse_after"])
    facts = {"surfaces": surfaces, "best": best,
             "lamps": [{"lamp": lamp, **means[lamp]}
                       for lamp in sorted(means, key=lambda each: means[each]["rmse_after"])]}
    if len(surfaces) > 1:
        lines.append(f"over all surfaces {best} brings most: RMSE "
                     f"{means[best]['rmse_before']:.4f} -> {means[best]['rmse_after']:.4f}")
    return facts, "\n".join(lines)


def _mean(surfaces: list[dict[str, Any]], lamp: str) -> dict[str, float]:
    """Width and RMSE with one lamp, over the surfaces."""
    of_lamp = [step for surface in surfaces for step in surface["lamps"] if step["lamp"] == lamp]
    return {key: float(np.mean([step[key] for step in of_lamp]))
            for key in ("width_before", "width_after", "rmse_before", "rmse_after")}


def step_facts(step: PlannedStep) -> dict[str, float]:
    """Width and RMSE before and after one step."""
    return {"width_before": step.width_before, "width_after": step.width_after,
            "rmse_before": step.rmse_before, "rmse_after": step.rmse_after}


def lamp_lines(steps: list[PlannedStep]) -> list[str]:
    """A line for each lamp or filter, the best first."""
    return [f"  a second photo with {step.name}: band width {step.width_before:.3f} -> "
            f"{step.width_after:.3f}, expected RMSE {step.rmse_before:.4f} -> "
            f"{step.rmse_after:.4f}" for step in steps]
