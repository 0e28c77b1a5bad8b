"""Calibration, light, chart and left-out patches as plain numbers, for JSON and the report."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spectrabox.calibrate import chart_findings
from spectrabox.measure import texts
from spectrabox.radiometry.findings import Finding, faults
from spectrabox.radiometry.records import calibration as calibration_records

TWO_SIGMA = 2.0
CURVE_DECIMALS = 5      # of reflectances among plain numbers


def checks(findings: Sequence[Finding]) -> list[str]:
    """What was found, a sentence or two each."""
    return [texts.says(one) for one in findings]


def doubts(calibration: calibration_records.Calibration) -> list[str]:
    """What makes a calibration doubtful, a sentence or two each."""
    return checks(faults(calibration.findings))


def copy_facts(copy: calibration_records.ChartCopy | None,
               names: Sequence[str]) -> dict[str, object] | None:
    """The copy of a chart as plain numbers: ``chart_generation`` of docs/reference/json.md.

    Parameters
    ----------
    copy : ChartCopy or None
        None where reflectances were stated.
    names : sequence of I str
        Of the patches.
    """
    if copy is None:
        return None
    columns = (copy.level, copy.level_error, copy.tint, copy.tint_error, copy.level_spread,
               copy.tint_spread)
    rows = [{"name": name, "level": level, "level_error": level_error, "tint": tint,
             "tint_error": tint_error, "level_spread": level_spread, "tint_spread": tint_spread}
            for name, level, level_error, tint, tint_error, level_spread, tint_spread in zip(
                names, *(column.tolist() for column in columns), strict=True)]
    return {"reference": copy.edition, "probability": copy.probability,
            "edition": chart_findings.edition_told(copy),
            "says": texts.says(chart_findings.edition(copy)), "log_evidence": copy.evidence,
            "notes": checks(chart_findings.departures(copy, names)), "patches": rows}


def light_facts(calibration: calibration_records.Calibration) -> dict[str, object]:
    """What is known of the light by itself: kind, wavelengths, mean and band, as plain numbers.

    Parameters
    ----------
    calibration : Calibration
    """
    if calibration.light_posterior is not None:
        return posterior_facts(calibration.light_posterior)
    light = calibration.light
    error = np.zeros(light.grid.nm.size) if light.standard_error is None else light.standard_error
    return {"kind": "stated", "wavelengths_nm": light.grid.nm.tolist(),
            "mean": light.values.tolist(), "lower": (light.values - TWO_SIGMA * error).tolist(),
            "upper": (light.values + TWO_SIGMA * error).tolist()}


def posterior_facts(light: calibration_records.LightPosterior) -> dict[str, object]:
    """What a chart says of an unknown light.

    Parameters
    ----------
    light : LightPosterior
    """
    return {"kind": light.kinds[int(light.probabilities.argmax())],
            "kinds": dict(zip(light.kinds, light.probabilities.tolist(), strict=True)),
            "wavelengths_nm": light.grid.nm.tolist(), "mean": light.mean.tolist(),
            "lower": light.lower.tolist(), "upper": light.upper.tolist(), "level": light.level,
            "sentences": checks(light.findings)}


def held_out_facts(patches: calibration_records.HeldOutPatches,
                   names: Sequence[str]) -> dict[str, object]:
    """Patches left out as plain numbers: ``left_out`` of docs/reference/json.md.

    Parameters
    ----------
    patches : HeldOutPatches
    names : sequence of I str
        Of the patches.
    """
    reasons = poor_patches(patches, names)
    differences = chart_findings.patch_differences(patches)
    colours = chart_findings.colours(patches).values
    curves = {"estimate": patches.mean, "lower": patches.lower, "upper": patches.upper,
              "reference": patches.reference}
    rows = [{"patch": number + 1, "name": names[number],
             "delta_e00": float(differences[number]), "rmse": float(patches.rmse[number]),
             "inside": float(patches.inside[number]),
             "expected": float(patches.expected[number]),
             "kept_out": bool(patches.excluded[number]),
             "saturated": not patches.judged[number], "reason": reasons.get(names[number]),
             **{name: np.round(curve[number], CURVE_DECIMALS).tolist()
                for name, curve in curves.items()}}
            for number in range(len(patches.mean))]
    rmse, inside, expected = patches.means
    return {"rmse_mean": rmse, "coverage_95": inside, "expected_95": expected,
            "level": patches.level,
            "delta_e00": {name: colours[name]
                          for name in ("mean", "median", "percentile_90", "largest")},
            "wavelengths_nm": patches.grid.nm.tolist(), "patches": rows}


def poor_patches(patches: calibration_records.HeldOutPatches,
                 names: Sequence[str]) -> dict[str, str]:
    """Patches whose band holds less than 85 % of the reference, each with its likely reason, the
    worst first.

    Parameters
    ----------
    patches : HeldOutPatches
    names : sequence of I str
    """
    return {row["patch"]: texts.patch_reason(row)
            for row in chart_findings.poor_patches(patches, names)}
