"""What ``spectrabox camera preflight`` answers: errors of curves and of spectra before a photo."""
from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from spectrabox.calibrate.chart_consistency import light_power
from spectrabox.calibrate.preflight import preflight
from spectrabox.calibrate.prior.camera_prior import CameraPrior, load_camera_prior, shipped_prior
from spectrabox.calibrate.prior.plain_priors import prior_of_curves
from spectrabox.measure.camera import light_words
from spectrabox.measure.expected_spectra import Expectation, Shoot, expected_spectra
from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.charts.references import reference_reflectances
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import Spectrum, UnknownLight
from spectrabox.radiometry.spectra.named_spectra import light as named_light
from spectrabox.radiometry.spectra.named_spectra import stated_light
from spectrabox.radiometry.spectra.spectrum_files import read_curves
from spectrabox.session.camera.camera_files import read_layout, read_measured_curves
from spectrabox.session.commands.requests import CameraPreflightRequest
from spectrabox.session.signals.plan_answer import exposure_words, read_lamps_at_hand, step_facts

SECOND_LIGHTS = ("A", "D65", "FL2", "FL11", "LED-B1", "LED-B3", "LED-B5", "LED-RGB1", "LED-V1")
CURVES_ERROR = 0.02         # relative, of measured curves: as [sensitivity] takes it by default


def preflight_answer(asked: CameraPreflightRequest) -> tuple[dict[str, Any], str]:
    """JSON object and text.

    Raises
    ------
    InputError
        If the light, the chart's reference or a file cannot be read.
    """
    light, chart = stated_light(asked.light, FINE_GRID), read_layout(asked.layout)
    reflectances = reference_reflectances(asked.reference, chart, FINE_GRID)
    cameras, hand = _cameras(asked), read_lamps_at_hand(asked.lamps, asked.filters)
    facts, lines = _of_curves(asked, chart, light, cameras, reflectances)
    if asked.surfaces:
        shoot = Shoot(light, cameras, reflectances, chart.centres_uv, asked.noise)
        expectation = expected_spectra(shoot, hand, surfaces=asked.surfaces)
        facts["spectra"] = _facts(expectation)
        lines += _lines(expectation, light, asked)
    return facts, "\n".join(lines)


def _cameras(asked: CameraPreflightRequest) -> CameraPrior:
    if asked.curves is not None:
        _, names, _ = read_curves(asked.curves)
        return prior_of_curves(FINE_GRID, read_measured_curves(asked.curves, len(names), FINE_GRID),
                               CURVES_ERROR)
    return shipped_prior() if asked.prior_file is None else load_camera_prior(asked.prior_file)


def _of_curves(asked: CameraPreflightRequest, chart: Chart, light: Spectrum | UnknownLight,
               cameras: CameraPrior, reflectances: np.ndarray) -> tuple[dict[str, Any], list[str]]:
    """What becomes of the curves by themselves, which only a stated light tells."""
    names = ("expected_error", "expected_error_unlike", "half_width", "condition_number",
             "unlit_nm", "checks", "second_lights")
    if isinstance(light, UnknownLight):
        return {"wavelengths_nm": FINE_GRID.nm.tolist()} | dict.fromkeys(names), [
            f"{light.words}: the photo tells products of sensitivity and light, not the curves by "
            "themselves"]
    power, unseen = light_power(light, FINE_GRID)
    second = {name: named_light(name, FINE_GRID) for name in SECOND_LIGHTS if name != asked.light}
    expected = preflight(cameras, reflectances, power, FINE_GRID, relative_error=asked.noise,
                         positions=chart.centres_uv, second=second)
    facts = [expected.expected_error.tolist(), expected.unlike_error.tolist(),
             expected.half_width.tolist(), expected.condition_number,
             [list(pair) for pair in expected.unlit_nm], list(unseen),
             [{"light": name, "expected_error": error} for name, error in expected.second_lights]]
    best, error = expected.second_lights[0]
    return {"wavelengths_nm": FINE_GRID.nm.tolist()} | dict(zip(names, facts, strict=True)), [
        "expected error of the curves: "
        + ", ".join(f"{value:.1%}" for value in expected.expected_error)
        + f" at {asked.noise:.1%} a patch (condition number {expected.condition_number:.4g})",
        f"of a camera unlike those measured: {expected.unlike_error.mean():.1%}", *unseen,
        f"a second photo under {best} would bring the mean to {error:.1%}"]


def _facts(expectation: Expectation) -> dict[str, Any]:
    return {"families": [asdict(one) for one in expectation.families],
            "mean": {name: value for name, value in asdict(expectation.mean).items()
                     if name != "family"},
            "rmse_daylight": expectation.rmse_daylight, "will_do": not expectation.doubts,
            "doubts": list(expectation.doubts),
            "second_photos": [{"lamp": step.name, **step_facts(step)}
                              for step in expectation.second]}


def _lines(expectation: Expectation, light: Spectrum | UnknownLight,
           asked: CameraPreflightRequest) -> list[str]:
    lines = [f"spectra of surfaces beside the chart ({light_words(light)}, {asked.noise:.1%} a "
             "patch; in brackets: camera, lamp and white known exactly)"]
    lines += [f"  {one.family:<8} RMSE {one.rmse:.3f} ({one.rmse_known:.3f}), 95 % band "
              f"{one.width:.3f} wide ({one.width_known:.3f})" for one in (*expectation.families,
                                                                         expectation.mean)]
    best = expectation.second[0]
    lines.append(f"further photos with {best.name} would take the error to about "
                 if len(best.stops) > 1 else
                 f"a second photo with {best.name} would take the error to about ")
    lines[-1] += f"{best.rmse_after / best.rmse_before:.0%} of this{exposure_words(best)}"
    mean = expectation.mean
    return [*lines, *(expectation.doubts or (
        f"this lamp and this chart will do: RMSE {mean.rmse:.3f}, of which camera, lamp and white, "
        f"known exactly, would leave {mean.rmse_known:.3f}",))]
