"""Figures over wavelength, and pairs of swatches of the chart's patches."""


from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from spectrabox.calibrate.trust import chart_colour_differences, chart_colours
from spectrabox.measure import plots, rules, words
from spectrabox.measure.results import capture_result, surface_result
from spectrabox.radiometry.appearance import encode_srgb, encoded_srgb
from spectrabox.radiometry.records import calibration, spectra
from spectrabox.session.report import maps, svg

WIDTH, HEIGHT = 374.0, 209.0    # of a figure, in points
QUANTITIES = {
    spectra.Quantity.REFLECTANCE: "Reflectance", spectra.Quantity.IRRADIANCE:
    "Irradiance (W m⁻² nm⁻¹)", spectra.Quantity.RADIANCE: "Radiance (W m⁻² sr⁻¹ nm⁻¹)",
    spectra.Quantity.RELATIVE: "Relative spectral power"
}


def surface_curves(surface: surface_result.SurfaceResult) -> dict[str, np.ndarray]:
    """Every curve known of one surface, each (P,) at its wavelengths; NaN where a truth was not
    measured.
    """
    nm, summary = surface.nm, surface.summary
    if summary is None:
        curves = {"given": surface.mean}
    else:
        level = words.percent(summary.level)
        curves = {"mean": summary.mean, "standard deviation": summary.standard_deviation,
                  f"{level} band, lower": summary.lower, f"{level} band, upper": summary.upper,
                  "lowest possible": summary.bound_lower, "highest possible": summary.bound_upper}
        if surface.spectrum is not None:
            curves["inverse rendering"] = np.interp(nm, surface.grid.nm, surface.spectrum)
    if surface.truth is not None:
        curves["measured truth"] = np.interp(nm, surface.truth.grid.nm, surface.truth.values,
                                             left=np.nan, right=np.nan)
    return curves


def every_10_nm(nm: np.ndarray, curves: dict[str, np.ndarray]) -> list[list[float]]:
    """Rows of wavelength and curve values at the multiples of 10 nm.

    Parameters
    ----------
    nm : (P,) array
    curves : dict
        Of (P,) arrays by name.

    Returns
    -------
    list of list of float
        One row a wavelength: nm, then the curves in their order.
    """
    at = np.arange(np.ceil(nm[0] / 10) * 10, nm[-1] + 1e-6, 10.0)
    return [[float(v) for v in row]
            for row in np.c_[at, *[np.interp(at, nm, y)[:, None] for y in curves.values()]]]


@svg.figure("the spectrum")
def spectrum_figure(name: str, surface: surface_result.SurfaceResult) -> Markup:
    """Draws, band, exact bounds, mean, the spectrum of inverse rendering, and the truth where one
    was measured.
    """
    nm, curves = surface.nm, surface_curves(surface)
    summary, samples, truth = surface.summary, surface.samples, curves.get("measured truth")
    highest = [curves["given"] if summary is None else summary.bound_upper]
    if truth is not None and np.isfinite(truth).any():
        highest.append(truth)
    top = 1.02 * max(1.0, *(float(np.nanmax(values)) for values in highest))
    plot = _over_wavelengths(name, nm, (0, top), "Reflectance")
    if summary is None:
        plot.line(nm, curves["given"], plots.MEAN, 1.8, label="given spectrum")
    else:
        if samples is not None:
            chosen = np.random.default_rng(0).choice(
                len(samples.spectra), min(plots.DRAWS_SHOWN, len(samples.spectra)), replace=False)
            plot.lines([np.c_[samples.grid.nm, draw] for draw in samples.spectra[chosen]],
                       plots.QUIET, 0.5, opacity=0.3, label=f"{len(chosen)} draws")
        plot.areas(nm, summary.lower, summary.upper, plots.MEAN, 0.18,
                   label=f"{100 * summary.level:.4g} % band")
        plot.line(nm, summary.bound_lower, plots.QUIET, 0.9, svg.DASHED, "exact bounds")
        plot.line(nm, summary.bound_upper, plots.QUIET, 0.9, svg.DASHED)
        if "inverse rendering" in curves:
            plot.line(nm, curves["inverse rendering"], plots.RENDERED, 1.4,
                      label="inverse rendering")
        plot.line(nm, summary.mean, plots.MEAN, 1.9, label="mean")
        plot.upright(summary.next_measurement_nm, plots.INK, 0.6, svg.DOTTED, "measure here next")
    if truth is not None:
        plot.line(nm, truth, plots.TRUTH, 1.3, svg.DOTTED, "measured truth")
    shown = svg.plain_line(surface.name)
    plot.readout(nm, curves, "Wavelength", "nm")
    return plot.drawn(f"Reflectance of {shown}", f"Reflectance of {shown} over "
                      "wavelength with what is known of its uncertainty; the table below holds the "
                      "numbers.")


@svg.figure("the sensitivities")
def sensitivity_figure(name: str, fit: calibration.SensitivityFit, bands: tuple[str, ...],
                       truth: tuple[np.ndarray, np.ndarray] | None) -> Markup:
    """Sensitivities with two standard errors either side, and the measured curves where given.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    bands : tuple of str
        K names.
    truth : (nm, curves) or None
        Measured curves (K, P) at nm (P,), the highest peak of all being 1.
    """
    nm, error = fit.grid.nm, fit.standard_error
    spread = 0.0 if error is None else 2 * error
    ends = [float(np.nanmin(fit.curves - spread)), float(np.nanmax(fit.curves + spread)), 0.0]
    if truth is not None:
        ends += [float(np.nanmin(truth[1])), float(np.nanmax(truth[1]))]
    margin = 0.04 * (max(ends) - min(ends))
    plot = _over_wavelengths(name, nm, (min(ends) - margin, max(ends) + margin),
                             "Sensitivity (highest peak = 1)")
    plot.level(0, plots.QUIET, 0.6)
    for k, (band, colour) in enumerate(zip(bands, plots.band_colours(bands), strict=True)):
        if error is not None:
            plot.areas(nm, fit.curves[k] - 2 * error[k], fit.curves[k] + 2 * error[k], colour, 0.18)
        plot.line(nm, fit.curves[k], colour, 1.6, label=svg.plain_line(band, 24))
        if truth is not None:
            plot.line(truth[0], truth[1][k], colour, 1.0, svg.DOTTED)
    if truth is not None:
        plot.line([], [], plots.INK, 1.0, svg.DOTTED, "measured curves")
    series: dict[str, np.ndarray] = {}
    for k, band in enumerate(bands):
        series[band] = fit.curves[k]
        if fit.standard_error is not None:
            series[f"{band} ± 2 s.e."] = 2 * fit.standard_error[k]
        if truth is not None:
            series[f"{band} measured"] = np.interp(nm, truth[0], truth[1][k], left=np.nan,
                                                   right=np.nan)
    plot.readout(nm, series, "Wavelength", "nm")
    return plot.drawn("Camera sensitivities", "Sensitivity of each camera band over wavelength.")


@svg.figure("the light")
def light_figure(name: str, light: spectra.Spectrum,
                 posterior: calibration.LightPosterior | None = None) -> Markup:
    """The light spectrum, with two standard errors either side where they are stated; what the
    chart says of it, with its band, where nobody stated it.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    light : Spectrum
    posterior : LightPosterior or None
    """
    if posterior is not None:
        nm, values, quantity = posterior.grid.nm, posterior.mean, "Relative spectral power"
        band: tuple[np.ndarray, np.ndarray] | None = (posterior.lower, posterior.upper)
        series = {"mean": values, "lower": posterior.lower, "upper": posterior.upper}
    else:
        nm, values, quantity = light.grid.nm, light.values, QUANTITIES[light.quantity]
        series, band = {quantity.partition(" (")[0].lower(): values}, None
        if light.standard_error is not None:
            series["± 2 s.e."] = 2 * light.standard_error
            band = (values - 2 * light.standard_error, values + 2 * light.standard_error)
    highest = float(np.nanmax(values if band is None else band[1]))
    plot = _over_wavelengths(name, nm, (0, 1.05 * highest if highest > 0 else 1.0), quantity, 58)
    if band is not None:
        plot.areas(nm, *band, plots.QUIET, 0.3)
    plot.line(nm, values, plots.INK, 1.5)
    digits = int(np.clip(3 - np.floor(np.log10(max(float(np.abs(values).max()), 1e-30))), 0, 12))
    plot.readout(nm, series, "Wavelength", "nm", digits)
    return plot.drawn("Light spectrum", f"{quantity} over wavelength.")


def _over_wavelengths(name: str, nm: np.ndarray, limits: tuple[float, float], quantity: str,
                      left: float = svg.LEFT) -> svg.Plot:
    """Empty axes over the wavelengths (P,)."""
    plot = svg.Plot(name, WIDTH, HEIGHT, (float(nm[0]), float(nm[-1])), limits, (left, 9, 31, 9))
    plot.x_axis("Wavelength (nm)", svg.nice_ticks(float(nm[0]), float(nm[-1]), 7))
    plot.y_axis(quantity, svg.nice_ticks(*limits, 7))
    return plot


# ---- chart patches as pairs of swatches ----------------------------------------------------------

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


@dataclass(frozen=True, eq=False)
class SwatchPairs:
    """Every patch of a chart as photographed and as predicted."""

    measured: list[str]             # colours as CSS writes them
    predicted: list[str]
    delta_e00: np.ndarray | None    # between both; None without a reference
    order: list[int]                # patches from 0, the worst first
    from_others: bool               # predicted from the other patches alone

    @property
    def large(self) -> list[int]:
        """Patches that are shown large."""
        return self.order[:MAX_LARGE]

    @property
    def others(self) -> list[int]:
        """Those folded away."""
        return self.order[MAX_LARGE:]

    @property
    def worst(self) -> float | None:
        """The largest CIEDE2000; None without a reference."""
        return None if self.delta_e00 is None else float(np.nanmax(self.delta_e00))

    @property
    def mean(self) -> float | None:
        """Mean CIEDE2000; None without a reference."""
        return None if self.delta_e00 is None else float(np.nanmean(self.delta_e00))


def swatch_pairs(result: capture_result.CaptureResult) -> SwatchPairs | None:
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
    residuals, chart, photo = rules.chart_residuals(result), result.chart, result.measured_chart
    if chart is None or photo is None or residuals is None:
        return None
    held_out = result.calibration.sensitivity.held_out_residuals
    measured = photo.samples.mean
    predicted = measured * (1 - (residuals if held_out is None else held_out))
    difference = None
    if chart.left_out is None:
        colours = _camera_colours(result, measured, predicted)
        off = np.abs(predicted / measured - 1).max(axis=1)
    else:
        patches = (measured, predicted, chart.left_out.reference, chart.left_out.grid)
        colours = [np.array([encoded_srgb(one) for one in xyz]) for xyz in chart_colours(*patches)]
        off = difference = chart_colour_differences(*patches)
    # what was not measured comes first too: it has to be looked at
    order = np.argsort(-np.nan_to_num(off, nan=np.inf), kind="stable").tolist()
    shown, foreseen = ([css_colour(colour) for colour in each] for each in colours)
    return SwatchPairs(shown, foreseen, difference, order, held_out is not None)


def _camera_colours(result: capture_result.CaptureResult, measured: np.ndarray,
                    predicted: np.ndarray) -> list[np.ndarray]:
    chosen = maps.display_bands(result.calibration.sensitivity)
    white = np.nanmax(measured, axis=0)[chosen] / WHITE
    return [encode_srgb(signal[:, chosen] / white) for signal in (measured, predicted)]
