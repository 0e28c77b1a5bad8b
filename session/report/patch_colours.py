"""Chart patches as pairs of swatches: as photographed, and as the calibration predicts them."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from spectrabox.calibrate.trust import chart_colour_differences, chart_colours
from spectrabox.measure.results.capture_result import CaptureResult
from spectrabox.measure.rules import chart_residuals
from spectrabox.radiometry.appearance import encode_srgb, encoded_srgb
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


def hex_colour(srgb: np.ndarray) -> str:
    """Encoded sRGB (3,), 0 to 1, as web pages write it: #rrggbb."""
    return "#" + "".join(f"{round(255 * float(value)):02x}" for value in srgb)


@dataclass(frozen=True)
class SwatchPair:
    """A patch as photographed and as predicted, colours as CSS writes them."""

    patch: int                      # from 0
    name: str
    measured: str
    predicted: str
    delta_e00: float | None         # between both; None without a reference


@dataclass(frozen=True)
class SwatchPairs:
    """Every patch of a chart, the worst first."""

    pairs: tuple[SwatchPair, ...]
    from_others: bool               # predicted from the other patches alone

    @property
    def large(self) -> tuple[SwatchPair, ...]:
        """Those shown large."""
        return self.pairs[:MAX_LARGE]

    @property
    def others(self) -> tuple[SwatchPair, ...]:
        """Those folded away."""
        return self.pairs[MAX_LARGE:]

    @property
    def in_order(self) -> list[SwatchPair]:
        """As printed on the chart."""
        return sorted(self.pairs, key=lambda pair: pair.patch)

    @property
    def differences(self) -> np.ndarray | None:
        """CIEDE2000 of every pair; None without a reference."""
        known = [pair.delta_e00 for pair in self.pairs if pair.delta_e00 is not None]
        return np.array(known) if known else None

    @property
    def worst(self) -> float | None:
        """The largest CIEDE2000; None without a reference."""
        return None if self.differences is None else float(np.nanmax(self.differences))

    @property
    def mean(self) -> float | None:
        """Mean CIEDE2000; None without a reference."""
        return None if self.differences is None else float(np.nanmean(self.differences))

    @property
    def numbers(self) -> dict[str, Any]:
        """For JSON, in the order of the chart but for ``order``: patches from 0, the worst first.
        """
        pairs, known = self.in_order, self.differences is not None
        return {"measured": [pair.measured for pair in pairs],
                "predicted": [pair.predicted for pair in pairs],
                "delta_e00": [pair.delta_e00 for pair in pairs] if known else None,
                "from_others": self.from_others, "order": [pair.patch for pair in self.pairs]}


def swatch_pairs(found: CaptureResult) -> SwatchPairs | None:
    """Colours of every patch as photographed and as predicted, and how far they are apart.

    Predicted from the other patches, where the calibration left each out in turn: a fit would bend
    towards a wrong patch. Signals become colours as for the colour difference of a chart, by the
    linear map that best takes the predicted signals to the tristimulus values of the reference
    under D65; without a reference the camera's own bands are shown, and no difference is said.

    Returns
    -------
    SwatchPairs or None
        None without a chart.
    """
    residuals, chart = chart_residuals(found), found.chart
    if chart is None or residuals is None:
        return None
    held_out = found.calibration.sensitivity.held_out_residuals
    measured = chart.samples.mean
    predicted = measured * (1 - (residuals if held_out is None else held_out))
    difference = None
    if chart.left_out is None:
        colours = _camera_colours(found, measured, predicted)
        off = np.abs(predicted / measured - 1).max(axis=1)
    else:
        patches = (measured, predicted, chart.left_out.reference, chart.left_out.grid)
        colours = [np.array([encoded_srgb(one) for one in xyz]) for xyz in chart_colours(*patches)]
        off = difference = chart_colour_differences(*patches)
    # what was not measured comes first too: it has to be looked at
    order = np.argsort(-np.nan_to_num(off, nan=np.inf), kind="stable").tolist()
    return SwatchPairs(tuple(
        SwatchPair(patch, chart.layout.names[patch], css_colour(colours[0][patch]),
                   css_colour(colours[1][patch]),
                   None if difference is None else float(difference[patch])) for patch in order),
        held_out is not None)


def _camera_colours(found: CaptureResult, measured: np.ndarray,
                    predicted: np.ndarray) -> list[np.ndarray]:
    chosen = display_bands(found.calibration.sensitivity)
    white = np.nanmax(measured, axis=0)[chosen] / WHITE
    return [encode_srgb(signal[:, chosen] / white) for signal in (measured, predicted)]
