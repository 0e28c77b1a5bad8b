"""What a second photo under another lamp or through a filter would bring, from those at hand.

Linear-Gaussian, as in planner.py: the photo's bands are new rows on the covariance of the draws. A
second photo is taken to be as noisy as the first and to err independently of it. Where the light of
a session is unknown, the camera's own curves are the products over the light's posterior mean.
"""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.records import Calibration, WavelengthGrid
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_curves, spectrum_on_grid
from spectrabox.sampling.further.planner import (
    PHOTO_ERROR,
    PHOTO_MINUTES,
    Candidate,
    PlannedStep,
    photo_candidate,
    ranked,
)

COMMON = ("D65", "A", "LED-B1", "LED-B5", "LED-RGB1", "LED-V1", "FL11")
DARK = 1e-3             # of the brightest: no curve is divided by a light below it
FINE = visible_grid(1)


@dataclass(frozen=True)
class LampsAtHand:
    """Lamps, and filters for the present light, by name or file."""

    lamps: tuple[str, ...]
    filters: tuple[str, ...]


def lamps_at_hand(lamps: str | None, filters: str | None) -> LampsAtHand:
    """Lamps and filters of two options, separated by commas; common lamps where neither is given.

    Raises
    ------
    InputError
        If an option names nothing.
    """
    chosen = [None if words is None else tuple(word.strip() for word in words.split(",")
                                               if word.strip()) for words in (lamps, filters)]
    if () in chosen:
        raise InputError("no lamp or filter was named; give --lamps D65,A,my.csv or --filters "
                         "yellow.csv")
    return LampsAtHand(chosen[0] or (COMMON if chosen[1] is None else ()), chosen[1] or ())


def lamp_candidates(curves: np.ndarray, present: np.ndarray, grid: WavelengthGrid,
                    hand: LampsAtHand, *, standard_error: float = PHOTO_ERROR,
                    minutes: float = PHOTO_MINUTES) -> list[Candidate]:
    """A second photo under each lamp and through each filter.

    Parameters
    ----------
    curves : (K, 301) array
        Sensitivities at 400, 401 ... 700 nm.
    present : (301,) array
        The light that filters are used under.
    grid : WavelengthGrid
        Of the draws.
    hand : LampsAtHand
    standard_error : float
        Of a photo's signal, of white.
    minutes : float
        Of a photo.
    """
    to_draws = interpolation_matrix(grid.nm, FINE.nm)
    lights = [(name, named_spectra.light(name, FINE)) for name in hand.lamps]
    lights += [(name, present * _transmittance(name)) for name in hand.filters]
    candidates = []
    for name, light in lights:
        rows = curves * light * FINE.weights_nm
        total = rows.sum(axis=1, keepdims=True)
        if np.any(total <= 0):
            raise InputError(f"a band of the camera sees nothing with {name}; leave it out")
        candidates.append(photo_candidate(name, rows / total @ to_draws, minutes, standard_error))
    return candidates


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
    curves, present = _camera(calibrations_of(config, stored)[0])
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


def _camera(calibration: Calibration) -> tuple[np.ndarray, np.ndarray]:
    """Sensitivities (K, 301) and the light (301,) of a calibration."""
    fit = calibration.sensitivity
    curves = on_grid(fit.grid.nm, np.maximum(fit.curves, 0), FINE, "the camera's curves")
    if calibration.light_posterior is None:
        return curves, spectrum_on_grid(calibration.light, FINE)
    known = calibration.light_posterior
    light = on_grid(known.grid.nm, known.mean, FINE, "the light's posterior")
    light = np.maximum(light, DARK * light.max())
    return curves / light, light


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
