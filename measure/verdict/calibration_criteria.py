"""Criteria of the calibration: doubts, chart patches, residuals."""
from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from spectrabox.calibrate.chart_copy import COPY_ERROR
from spectrabox.measure import texts
from spectrabox.measure.results.chart_words import held_out_sentence, poor_patches
from spectrabox.measure.verdict.criterion import Criterion, Status, graded, limit_words
from spectrabox.measure.words import percent
from spectrabox.radiometry.findings import faults
from spectrabox.radiometry.records.calibration import Calibration, CalibrationDoubt, HeldOutPatches

if TYPE_CHECKING:
    from spectrabox.measure.results.capture_result import CaptureResult

CHART_LIMITS = (0.03, 0.10)   # rms of (photo - predicted) / photo
# of wavelengths of patches left out, that the band should hold and does not: simulated charts of
# cameras and lamps outside the prior stay below it (benchmarks/bench_patch_errors.py)
LEFT_OUT_SHORT = 0.03
DOUBTS = {CalibrationDoubt.UNLIKE_CAMERAS: "Calibration like that of measured cameras",
          CalibrationDoubt.WRONG_LIGHT: "Stated light against the chart",
          CalibrationDoubt.COLOUR_MATRIX: "Curves against the colour matrix in the photo's file",
          CalibrationDoubt.TWO_LIGHTS: "Colour of the light over the chart",
          CalibrationDoubt.VEIL: "Veiling glare on the chart",
          CalibrationDoubt.BANDS: "Bands against the chart"}


def calibration_doubts(found: CaptureResult) -> list[Criterion]:
    """Whether the calibrations were made with doubts, each a criterion of its own; of further
    photos those alone that are doubtful.

    Nothing is known to contradict products of an unknown light with a camera, and where the light
    on each patch is given no drift over the chart is looked for. A veil and bands that disagree are
    named where they are.
    """
    calibration, rows = found.calibration, []
    for doubt, name in DOUBTS.items():
        given = (calibration.light_scale is not None if doubt is CalibrationDoubt.TWO_LIGHTS
                 else calibration.products)
        if doubt not in calibration.doubts and not given \
                and doubt not in (CalibrationDoubt.VEIL, CalibrationDoubt.BANDS):
            rows.append(Criterion(name, None, "no doubt", "no doubt", Status.PASS,
                                  "No sign of two kinds of light." if doubt
                                  is CalibrationDoubt.TWO_LIGHTS
                                  else "No sign of a wrong light spectrum."))
    return rows + [
        Criterion(DOUBTS[doubt] + where_of(view), None, "doubtful", "no doubt", Status.WARN,
                  sentence)
        for view, made in {"": calibration, **found.other_calibrations}.items()
        for doubt, sentence in zip(made.doubts, doubt_sentences(made, view), strict=True)]


def doubt_sentences(calibration: Calibration, view: str) -> list[str]:
    """What makes a calibration doubtful, a sentence each.

    Parameters
    ----------
    calibration : Calibration
    view : str
        Name of the first photo that it is of; "" the first of the capture.
    """
    return [f"Calibration{where_of(view)}: "
            + next((check for check in calibration.checks if check.startswith(doubt.value)),
                   doubt.value) + "." for doubt in calibration.doubts]


def where_of(view: str) -> str:
    """Which photo a sentence is about, after a name; nothing of the first."""
    return view and f" in the photo “{view}”"


def chart_photos(found: CaptureResult) -> list[Criterion]:
    """Whether each chart photo is good, as ``spectrabox chart`` says it of the same photo."""
    rows = []
    for view, findings in found.chart_findings.items():
        reasons = [texts.says(finding) for finding in faults(findings)]
        sentence = f"Shoot the chart{where_of(view)} again. {' '.join(reasons)}" if reasons \
            else f"The photo of the chart{where_of(view)} is good."
        rows.append(Criterion(f"Photo of the chart{where_of(view)}", float(len(reasons)),
                              "re-shoot" if reasons else "good", "good",
                              Status.WARN if reasons else Status.PASS, sentence))
    return rows


def held_out_criteria(found: CaptureResult) -> list[Criterion]:
    """How well each chart patch is predicted by a calibration without it; nothing without a chart.

    Parameters
    ----------
    found : CaptureResult
    """
    chart = found.chart
    if chart is None or chart.left_out is None:
        return []
    return [row for view, patches in {"": chart.left_out, **chart.others}.items()
            for row in held_out_of_chart(patches, chart.layout.names, where_of(view))]


def held_out_of_chart(patches: HeldOutPatches, names: Sequence[str],
                      where: str = "") -> list[Criterion]:
    """How well each patch of one chart is predicted by a calibration without it.

    Parameters
    ----------
    patches : HeldOutPatches
    names : sequence of I str
    where : str
        Which photo it is of, as the end of a name; empty of the first.
    """
    _, held, expected = patches.means
    short = expected - held > LEFT_OUT_SHORT
    sentence = f"{held_out_sentence(patches).capitalize()}."
    for name, reason in poor_patches(patches, names).items():
        sentence += f" Patch {name}: {reason}."
    if short:
        sentence += (" Less means that signals or their errors are off: the chart is not that of "
                     "its reference or soiled, light glares on it, or the light is not the stated "
                     "one.")
    rows = [Criterion(f"Chart patches left out, inside the band{where}", held, percent(held),
                      f"{percent(expected)} expected", Status.WARN if short else Status.INFO,
                      sentence)]
    saturated = [names[patch] for patch in np.flatnonzero(~patches.judged).tolist()]
    if saturated:
        rows.append(Criterion(
            f"Saturated chart patches{where}", float(len(saturated)), ", ".join(saturated), "none",
            Status.WARN, f"Saturated and left out of the fit: {', '.join(saturated)}. The light is "
            "known less well without; the calibration's checks say by how much. Expose less."))
    return rows


def chart_limits(stated: bool) -> tuple[float, float]:
    """Residuals of a chart up to which it passes, and beyond which it fails.

    Where nobody stated its reflectances, it departs from the mean of copies by what they differ by.

    Parameters
    ----------
    stated : bool
        Whether its reflectances were.
    """
    copied = 0.0 if stated else COPY_ERROR
    return float(np.hypot(CHART_LIMITS[0], copied)), float(np.hypot(CHART_LIMITS[1], copied))


def chart_agreement(found: CaptureResult) -> list[Criterion]:
    """How well each calibration reproduces the first chart that it was fitted to."""
    name, chart = "Chart residual, rms over patches and bands", found.chart
    residuals = chart_residuals(found)
    if residuals is not None and chart is not None:
        residuals = residuals[~chart.samples.clipped]
    each = {"": root_mean_square(residuals)}
    if each[""] is None:
        return [Criterion(name, None, "no chart", limit_words(CHART_LIMITS), Status.INFO,
                          "Sensitivities were read from a file; no chart photo tests them.")]
    for view, made in found.other_calibrations.items():
        assert chart is not None and made.sensitivity.residuals is not None
        each[view] = root_mean_square(made.sensitivity.residuals[chart.others[view].judged])
    limits = chart_limits(found.stated.chart_stated)
    return [graded(name + where_of(view), value, limits, f"The calibration{where_of(view)} "
                   f"reproduces the chart within {percent(value)} rms.")
            for view, value in each.items() if value is not None]


def chart_residuals(found: CaptureResult) -> np.ndarray | None:
    """(photo - predicted) / photo of the patches (I, K), or None where no chart was used."""
    residuals = found.calibration.sensitivity.residuals
    if residuals is None and found.chart is not None:
        measured = found.chart.samples.mean
        return (measured - found.chart.predicted) / measured
    return residuals


def root_mean_square(values: np.ndarray | None) -> float | None:
    """Root mean square of the finite values, None where there are none."""
    finite = np.empty(0) if values is None else values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite ** 2))) if finite.size else None
