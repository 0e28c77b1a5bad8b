"""Chart patches as pairs of swatches: as photographed, and as the calibration predicts them."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.calibrate.trust import chart_colour_differences, chart_colours
from spectrabox.measure.verdict.calibration import chart_residuals
from spectrabox.radiometry.appearance import encode_srgb, encoded_srgb
from spectrabox.session.outputs.results import CommonResults
from spectrabox.session.report.maps import display_bands

MAX_LARGE = 24      # pairs shown large; those of a larger chart are folded away
WHITE = 0.9         # reflectance of a white patch, about


def css_colour(srgb: np.ndarray) -> str:
    """Encoded sRGB (3,), 0 to 1, as CSS writes it; grey stripes stand for a colour that was not
    measured.
    """
    if not np.isfinite(srgb).all():
        return "repeating-linear-gradient(45deg,#ccc 0 3px,#fff 3px 6px)"
    return "rgb({}, {}, {})".format(*(round(255 * float(v)) for v in np.clip(srgb, 0, 1)))


def swatch_facts(results: CommonResults) -> dict[str, Any] | None:
    """Colours of every patch as photographed and as predicted, and how far they are apart.

    Predicted from the other patches, where the calibration left each out in turn: a fit would bend
    towards a wrong patch. Signals become colours as for the colour difference of a chart, by the
    linear map that best takes the predicted signals to the tristimulus values of the reference
    under D65; without a reference the camera's own bands are shown, and no difference is said.

    Returns
    -------
    dict or None
        ``measured``, ``predicted`` (I colours as CSS writes them), ``delta_e00`` (I,) or None,
        ``from_others``, ``order`` (patches from 0, the worst first). None without a chart.
    """
    residuals = chart_residuals(results)
    if results.chart is None or residuals is None:
        return None
    held_out = results.calibration.sensitivity.held_out_residuals
    measured = results.chart.samples.mean
    predicted = measured * (1 - (residuals if held_out is None else held_out))
    left_out = results.chart.left_out
    if left_out is None:
        colours, difference = _camera_colours(results, measured, predicted), None
        off = np.abs(predicted / measured - 1).max(axis=1)
    else:
        patches = (measured, predicted, left_out.reference, left_out.grid)
        colours = [np.array([encoded_srgb(one) for one in xyz]) for xyz in chart_colours(*patches)]
        off = difference = chart_colour_differences(*patches)
    return {"measured": [css_colour(one) for one in colours[0]],
            "predicted": [css_colour(one) for one in colours[1]], "delta_e00": difference,
            "from_others": held_out is not None,
            # what was not measured comes first too: it has to be looked at
            "order": np.argsort(-np.nan_to_num(off, nan=np.inf), kind="stable")}


def swatch_section(results: CommonResults) -> dict[str, Any] | None:
    """The same for the page: pairs shown large, and those folded away."""
    facts = swatch_facts(results)
    if facts is None or results.chart is None:
        return None
    difference = facts["delta_e00"]
    pairs = [{"patch": int(p), "name": results.chart.layout.names[p],
              "measured": facts["measured"][p], "predicted": facts["predicted"][p],
              "delta_e00": None if difference is None else float(difference[p])}
             for p in facts["order"]]
    return {"large": pairs[:MAX_LARGE], "others": pairs[MAX_LARGE:],
            "from_others": facts["from_others"],
            "worst": None if difference is None else float(np.nanmax(difference)),
            "mean": None if difference is None else float(np.nanmean(difference))}


def _camera_colours(results: CommonResults, measured: np.ndarray,
                    predicted: np.ndarray) -> list[np.ndarray]:
    chosen = display_bands(results.calibration.sensitivity)
    white = np.nanmax(measured, axis=0)[chosen] / WHITE
    return [encode_srgb(signal[:, chosen] / white) for signal in (measured, predicted)]
