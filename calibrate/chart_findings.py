"""What is found of a chart once camera and light are fitted to it: rules, from records to findings.

Of which edition it is and how this copy departs from it; how well each patch is predicted by a
calibration without it; patches that others contradict.
"""
from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scipy.special import ndtri

from spectrabox.calibrate.chart_copy import COPY_ERROR
from spectrabox.radiometry import appearance, chart
from spectrabox.radiometry.findings import Finding, Severity, graded
from spectrabox.radiometry.records.calibration import ChartCopy, HeldOutPatches

CHANCE = 0.02           # of naming anything of a chart of which nothing is wrong
# The same of a colour, if errors were Gaussian. Colours of copies have wider tails: in scenes that
# state the light on each patch 8.0 ± 1.9 % of faultless charts were named at .02, 3.3 ± 1.2 % at
# .003. Of 120 fresh charts 5.8 ± 2.1 % are named at .003, in scenes and beside samples
# (benchmarks/bench_chart_alarms.py).
COLOUR_CHANCE = 0.003
WHITE_CHANCE = 0.5      # share of it for white, which dirt and yellowing change first
LARGE_DEPARTURE = 0.03  # of a patch from copies of its edition, that matters
CERTAIN = 2.0           # standard errors, from which a departure is named
POOR = 0.85             # of a patch's band: below it a reason is given
DARK = 0.12             # mean reflectance below which glare may be what changes a patch's level
NEAR = 1.0              # standard errors: a level that is nearer explains nothing
# Nats from which an edition is told: beyond it 95 of 100 simulated charts are of the edition named,
# and beyond more no larger a share (benchmarks/bench_editions.py).
TOLD = 2.0
# Of patches left out: share of wavelengths that the band should hold and does not, and mean
# CIEDE2000. Of 80 faultless simulated shoots one exceeds .007 (.018, through a gel) and none 1.8;
# the tests' small photos reach .022. Of a soiled white .02 to .06 are missing, a tone curve is off
# by 2.6 to 3.5.
LEFT_OUT_SHORT, LEFT_OUT_COLOUR = 0.03, 2.0
AT_FAULT = {"patches.unusual", "patches.glare", "patches.unlike-reference",
            "patches.unlike-reference-or-light"}
CHART_LIMITS = (0.03, 0.10)   # rms of (photo - predicted) / photo: passes up to, fails beyond


# ---- the copy of the chart -----------------------------------------------------------------------

def evidence_since(copy: ChartCopy) -> float | None:
    """Nats by which a photo speaks for a chart made since November 2014 against one made before;
    None where only one edition could be meant.

    Parameters
    ----------
    copy : ChartCopy
    """
    return None if chart.COPIES_BEFORE_2014 not in copy.evidence or len(copy.evidence) == 1 \
        else copy.evidence[chart.COPIES_SINCE_2014] - copy.evidence[chart.COPIES_BEFORE_2014]


def edition_told(copy: ChartCopy) -> str | None:
    """When a chart was made, as its photo alone tells: ``SINCE_2014`` or ``BEFORE_2014``; None
    where it tells too little.

    Parameters
    ----------
    copy : ChartCopy
    """
    nats = evidence_since(copy)
    if nats is None or abs(nats) < TOLD:
        return None
    return chart.SINCE_2014 if nats > 0 else chart.BEFORE_2014


def edition(copy: ChartCopy) -> Finding:
    """Of which edition a chart is taken to be, and what the photo says of that.

    Parameters
    ----------
    copy : ChartCopy
    """
    return Finding("copy.edition", Severity.INFO, values={
        "reference": copy.edition, "made": copy.made, "told": edition_told(copy),
        "nats": evidence_since(copy), "needed": TOLD})


def departures(copy: ChartCopy, names: Sequence[str], light: str = "") -> list[Finding]:
    """Patches whose level or tint certainly departs from the mean of copies of the chart's edition,
    by enough to matter.

    The fit has taken a departure into account, and copies do differ: it is evidence of a fault only
    where it is larger than such departures and its error are by chance. That happens to one
    faultless chart in fifty at most, half of them by their whites.

    Parameters
    ----------
    copy : ChartCopy
    names : sequence of I str
    light : str
        The one that was stated, which tints may be off by as well; empty where it is unknown.
    """
    white = int(copy.reflectances.mean(axis=1).argmax())
    count = len(names)
    chance = np.full(count, CHANCE * (1 - WHITE_CHANCE) / max(count - 1, 1))
    chance[white] = CHANCE * WHITE_CHANCE
    of_copies = -ndtri(chance / 4)      # two readings of each patch, to either side
    usual: list[dict[str, Any]] = []
    beyond: list[dict[str, Any]] = []
    for reading, size, error, spread in (
            ("level", copy.level, copy.level_error, copy.level_spread),
            ("tint", copy.tint, copy.tint_error, copy.tint_spread)):
        # of all patches but white, the worst of all is named only beyond its error by chance
        certain = np.where(np.arange(count) == white, CERTAIN, -ndtri(CHANCE / 2 / count))
        named = np.flatnonzero((np.abs(size) > LARGE_DEPARTURE) & (np.abs(size) > certain * error))
        for patch in named.tolist():
            row = {"patch": names[patch], "reading": reading, "size": float(size[patch]),
                   "error": float(error[patch]), "spread": float(spread[patch])}
            unlike = abs(size[patch]) > of_copies[patch] * np.hypot(spread[patch], error[patch])
            (beyond if unlike else usual).append(row)
    findings = []
    if beyond:
        findings.append(Finding("copy.unlike", Severity.WARN, values={
            "patches": beyond,
            "light": light if any(row["reading"] == "tint" for row in beyond) else ""}))
    if usual:
        findings.append(Finding("copy.departs", Severity.INFO, values={"patches": usual}))
    return findings


# ---- patches left out ----------------------------------------------------------------------------

def patch_differences(patches: HeldOutPatches) -> np.ndarray:
    """CIEDE2000 (I,) between the estimated spectrum of each patch and its reference, under D65.

    Parameters
    ----------
    patches : HeldOutPatches
    """
    return appearance.ciede2000(*(appearance.reflectance_to_lab(patches.grid.nm, one)
                       for one in (patches.mean, patches.reference)))


def held_out(patches: HeldOutPatches, names: Sequence[str]) -> list[Finding]:
    """How well each patch is predicted by a calibration without it.

    Parameters
    ----------
    patches : HeldOutPatches
    names : sequence of I str
    """
    rmse, inside, expected = patches.means
    short = expected - inside > LEFT_OUT_SHORT
    findings = [Finding("patches.held-out-short" if short else "patches.held-out",
                        Severity.WARN if short else Severity.INFO, values={
                            "value": inside, "expected": expected, "rmse": rmse,
                            "level": patches.level, "poor": poor_patches(patches, names)})]
    saturated = [names[patch] for patch in np.flatnonzero(~patches.judged).tolist()]
    if saturated:
        findings.append(Finding("patches.saturated", Severity.WARN, values={
            "value": len(saturated), "names": saturated}))
    return findings


def colours(patches: HeldOutPatches) -> Finding:
    """How far the colours of the estimated spectra of all patches are from the reference:
    ``mean``, ``median``, ``percentile_90`` and ``largest`` CIEDE2000 of the patches that count.

    Parameters
    ----------
    patches : HeldOutPatches
    """
    each = patch_differences(patches)[patches.counted]
    mean = float(each.mean())
    code, severity = ("patches.colours-off", Severity.WARN) if mean > LEFT_OUT_COLOUR \
        else ("patches.colours", Severity.INFO)
    return Finding(code, severity, values={
        "mean": mean, "median": float(np.median(each)),
        "percentile_90": float(np.percentile(each, 90)), "largest": float(each.max()),
        "value": mean, "passes": LEFT_OUT_COLOUR})


def at_fault(patches: HeldOutPatches, names: Sequence[str], light: str = "") -> list[Finding]:
    """What is wrong with the chart itself: patches whose level or colour is not what the others
    make of it, by more than chance; nothing where none is but those that were kept out of the fit.

    A level that is off by less than 3 % does no harm. A colour alone is no evidence: under a stated
    light those of faultless copies are off by as much as those of soiled ones.

    Parameters
    ----------
    patches : HeldOutPatches
    names : sequence of I str
    light : str
        As of ``departures``.
    """
    fitted = ~patches.excluded.astype(bool)
    level, colour = _beyond_chance(patches) & fitted, _other_colour(patches) & fitted
    named = np.flatnonzero(level | colour).tolist()
    if not named:
        return []
    values = {"patches": [patch_reason(patches, patch, names) for patch in named], "light": light}
    if not any(abs(_brighter(patches, patch)[0]) > LARGE_DEPARTURE
               for patch in np.flatnonzero(level).tolist()):
        return [Finding("patches.unusual", Severity.NOTE, values=values)]
    code = "patches.unlike-reference"
    if all(level[patch] and _brighter(patches, patch)[0] > 0 for patch in named):
        code = "patches.glare"
    elif light and colour.any():
        code = "patches.unlike-reference-or-light"
    return [Finding(code, Severity.WARN, values=values)]


def of_patches(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Those of ``at_fault``, or that took their place when their cause was looked for.

    Parameters
    ----------
    findings : iterable of Finding
    """
    return tuple(one for one in findings
                 if AT_FAULT & {one.code, *one.values.get("doubts", ())})


def poor_patches(patches: HeldOutPatches, names: Sequence[str]) -> list[dict[str, Any]]:
    """Patches whose band holds less than 85 % of the reference, the worst first, each with its
    likely reason as `patch_reason` gives it.

    Parameters
    ----------
    patches : HeldOutPatches
    names : sequence of I str
    """
    if patches.brighter is None:
        return []
    poor = np.flatnonzero(patches.counted & (patches.inside < POOR))
    return [patch_reason(patches, int(patch), names)
            for patch in poor[np.argsort(patches.inside[poor], kind="stable")]]


def patch_reason(patches: HeldOutPatches, patch: int, names: Sequence[str]) -> dict[str, Any]:
    """Why one patch is not as it is expected, as values of a finding.

    Returns
    -------
    dict
        ``patch`` (name), ``reason`` ("level": off in all bands beyond chance; "colour": not that of
        the reference; "spectrum": unusual for its signals, from ``low_nm`` to ``high_nm``),
        ``brighter`` and its standard ``error`` (relative; ``brighter`` is None where it explains
        nothing), and whether the patch is ``dark``.
    """
    brighter, error = _brighter(patches, patch)
    values: dict[str, Any] = {
        "patch": names[patch], "reason": "spectrum", "brighter": brighter, "error": error,
        "dark": bool(patches.reference[patch].mean() < DARK)}
    if _beyond_chance(patches)[patch]:
        return values | {"reason": "level"}
    if _other_colour(patches)[patch]:
        return values | {"reason": "colour"}
    outside = patches.grid.nm[(patches.reference[patch] < patches.lower[patch])
                              | (patches.reference[patch] > patches.upper[patch])]
    return values | {"brighter": brighter if abs(brighter) > NEAR * error else None,
                     "low_nm": float(outside[0]), "high_nm": float(outside[-1])}


def _brighter(patches: HeldOutPatches, patch: int) -> tuple[float, float]:
    assert patches.brighter is not None and patches.brighter_error is not None
    return float(patches.brighter[patch]), float(patches.brighter_error[patch])


def _beyond_chance(patches: HeldOutPatches) -> np.ndarray:
    """Whether the level of each patch (I,) is off by more than the worst of I is by chance."""
    if patches.brighter is None or patches.brighter_error is None:
        return np.zeros(len(patches.mean), bool)
    limit = -ndtri(CHANCE / 2 / len(patches.mean))
    return np.asarray(patches.judged & (np.abs(patches.brighter) > limit * patches.brighter_error))


def _other_colour(patches: HeldOutPatches) -> np.ndarray:
    """Whether the colour of each patch (I,) is off by more than the worst of I is by chance."""
    if patches.colour_chance is None:
        return np.zeros(len(patches.mean), bool)
    return np.asarray(patches.judged & (patches.colour_chance < COLOUR_CHANCE / len(patches.mean)))


# ---- residuals -----------------------------------------------------------------------------------

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


def chart_residual(residuals: np.ndarray, stated: bool) -> list[Finding]:
    """How well a calibration reproduces its chart; nothing where no residual is known.

    Parameters
    ----------
    residuals : array
        (photo - predicted) / photo; NaN where one is not known.
    stated : bool
        As of ``chart_limits``.
    """
    value, (passes, fails) = root_mean_square(residuals), chart_limits(stated)
    return [] if value is None else [Finding(
        "calibration.chart-residual", graded(value, passes, fails),
        values={"value": value, "passes": passes, "fails": fails})]


def root_mean_square(values: np.ndarray | None) -> float | None:
    """Root mean square of the finite values, None where there are none."""
    finite = np.empty(0) if values is None else values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite ** 2))) if finite.size else None
