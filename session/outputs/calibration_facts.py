"""What is said of a chart's patches left out and of the light, to a script and to a person."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from spectrabox.measure.chart_check import poor_patches
from spectrabox.radiometry.records import Calibration, HeldOutPatches, LightPosterior

TWO_SIGMA = 2.0


def light_facts(calibration: Calibration) -> dict[str, Any]:
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


def posterior_facts(light: LightPosterior) -> dict[str, Any]:
    """What a chart says of an unknown light.

    Parameters
    ----------
    light : LightPosterior
    """
    return {"kind": light.kinds[int(light.probabilities.argmax())],
            "kinds": dict(zip(light.kinds, light.probabilities.tolist(), strict=True)),
            "wavelengths_nm": light.grid.nm.tolist(), "mean": light.mean.tolist(),
            "lower": light.lower.tolist(), "upper": light.upper.tolist(), "level": light.level,
            "sentences": list(light.sentences)}


def left_out_facts(patches: HeldOutPatches, names: Sequence[str]) -> dict[str, Any]:
    """The same as plain numbers: ``left_out`` of docs/reference/json.md.

    Parameters
    ----------
    patches : HeldOutPatches
    names : sequence of I str
        Of the patches.
    """
    reasons = poor_patches(patches, names)
    rows = [{"patch": number + 1, "name": names[number], "rmse": float(patches.rmse[number]),
             "inside": float(patches.inside[number]),
             "expected": float(patches.expected[number]),
             "kept_out": bool(patches.excluded[number]),
             "saturated": not patches.judged[number], "reason": reasons.get(names[number])}
            for number in range(len(patches.mean))]
    rmse, inside, expected = patches.means
    return {"rmse_mean": rmse, "coverage_95": inside, "expected_95": expected,
            "level": patches.level, "patches": rows}
