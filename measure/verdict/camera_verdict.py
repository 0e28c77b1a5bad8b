"""The verdict on a camera that was fitted by itself: what was fitted, how surely, and what speaks
against it, in one sentence.
"""
from __future__ import annotations

from typing import TYPE_CHECKING

from spectrabox.calibrate.camera_curves import LEVEL
from spectrabox.measure.results.chart_words import chart_copy_notes
from spectrabox.measure.verdict.calibration_criteria import (
    DOUBTS,
    chart_limits,
    held_out_of_chart,
    root_mean_square,
)
from spectrabox.measure.verdict.criterion import (
    Criterion,
    Status,
    Verdict,
    graded,
    outcome_criterion,
)
from spectrabox.measure.words import percent
from spectrabox.radiometry.records.spectra import UnknownLight

if TYPE_CHECKING:
    from spectrabox.measure.camera import CameraFit


def camera_verdict(fit: CameraFit) -> Verdict:
    """Verdict on a fit of a camera: PASS, WARN or FAIL, the worst of its criteria.

    Parameters
    ----------
    fit : CameraFit
    """
    criteria = tuple(_criteria(fit))
    status = max((criterion.status for criterion in criteria), key=lambda one: one.value)
    what = f"{_fitted(fit)}, {_how_surely(fit)}"
    if status in (Status.WARN, Status.FAIL):
        first, *others = dict.fromkeys(
            criterion.sentence for criterion in criteria if criterion.status is status)
        more = f"; and {len(others)} more, above" if others else ""
        return Verdict(status, f"{what}; but {first.rstrip('.')}{more}.", criteria)
    use = "for photos under this light, and for no other" \
        if fit.chart.calibration.products else "for photos under any light"
    return Verdict(Status.PASS, f"{what}: {use}.", criteria)


def _fitted(fit: CameraFit) -> str:
    bands, count, light = ", ".join(fit.bands), len(fit.photos), fit.photos[0].light
    photos = "one photo" if count == 1 else f"{count} photos"
    if isinstance(light, UnknownLight):
        stated = f"a light stated as {light.stated}" if light.stated else "an unknown light"
        return f"Products of {bands} with the light, from {photos} under {stated}"
    curves = "Curves" if fit.band is not None else "Measured curves"
    under = "the given light" if fit.light == "given" else fit.light
    return f"{curves} of {bands}, from {photos} under {under}"


def _how_surely(fit: CameraFit) -> str:
    error = f"chart patches left out within CIEDE2000 {fit.chart.held_out_delta_e.mean():.1f}"
    if fit.band is None:
        return f"chart patches within CIEDE2000 {fit.chart.delta_e.mean():.1f}"
    half = percent(float((fit.band.upper - fit.band.lower).mean()) / 2, 0)
    noise = "" if fit.chart.prior_fit is not None else " of noise alone"
    return f"known within {half} of the highest peak ({percent(LEVEL, 0)} band{noise}), {error}"


def _criteria(fit: CameraFit) -> list[Criterion]:
    """Causes before symptoms: the first is the one that is said."""
    calibration, first = fit.chart.calibration, fit.photos[0]
    names = first.chart.names
    rows = [Criterion(DOUBTS[doubt], None, "doubtful", "no doubt", Status.WARN, doubt.value)
            for doubt in calibration.doubts]
    copy = () if fit.chart.copy is None else chart_copy_notes(fit.chart.copy, names)
    rows += [Criterion("Chart against copies of its edition", None, "departs", "within copies",
                       Status.INFO, note) for note in copy]
    rows += held_out_of_chart(fit.held_out, names)
    off = 1 - fit.chart.predicted / first.samples.mean
    residual = root_mean_square(off[~first.samples.clipped])
    assert residual is not None, "a chart that was fitted shows patches"
    rows.append(graded("Chart residual, rms over patches and bands", residual,
                       chart_limits(not first.editions),
                       f"the chart is reproduced within {percent(residual)} rms."))
    return [*rows, outcome_criterion("Sensitivity fit", fit.sensitivity.outcome)]
