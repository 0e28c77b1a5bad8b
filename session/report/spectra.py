"""Figures over wavelength: the spectra behind one surface, sensitivities and light."""
from __future__ import annotations

import numpy as np
from markupsafe import Markup

from spectrabox.measure.plot_style import (
    DRAWS_SHOWN,
    INK,
    MEAN,
    QUIET,
    RENDERED,
    TRUTH,
    band_colours,
)
from spectrabox.measure.results.surface_result import SurfaceResult
from spectrabox.measure.words import percent
from spectrabox.radiometry.records.calibration import LightPosterior, SensitivityFit
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.session.report.svg import (
    DASHED,
    DOTTED,
    LEFT,
    Plot,
    Readout,
    figure,
    nice_ticks,
    plain_line,
)

WIDTH, HEIGHT = 374.0, 209.0    # of a figure, in points
QUANTITIES = {Quantity.REFLECTANCE: "Reflectance", Quantity.IRRADIANCE: "Irradiance (W m⁻² nm⁻¹)",
              Quantity.RADIANCE: "Radiance (W m⁻² sr⁻¹ nm⁻¹)",
              Quantity.RELATIVE: "Relative spectral power"}


def surface_curves(surface: SurfaceResult) -> dict[str, np.ndarray]:
    """Every curve known of one surface, each (P,) at its wavelengths; NaN where a truth was not
    measured.
    """
    nm, summary = surface.nm, surface.summary
    if summary is None:
        curves = {"given": surface.mean}
    else:
        level = percent(summary.level)
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


@figure("the spectrum")
def spectrum_figure(name: str, surface: SurfaceResult) -> Markup:
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
        plot.line(nm, curves["given"], MEAN, 1.8, label="given spectrum")
    else:
        if samples is not None:
            chosen = np.random.default_rng(0).choice(
                len(samples.spectra), min(DRAWS_SHOWN, len(samples.spectra)), replace=False)
            plot.lines([np.c_[samples.grid.nm, draw] for draw in samples.spectra[chosen]], QUIET,
                       0.5, opacity=0.3, label=f"{len(chosen)} draws")
        plot.areas(nm, summary.lower, summary.upper, MEAN, 0.18,
                   label=f"{100 * summary.level:.4g} % band")
        plot.line(nm, summary.bound_lower, QUIET, 0.9, DASHED, "exact bounds")
        plot.line(nm, summary.bound_upper, QUIET, 0.9, DASHED)
        if "inverse rendering" in curves:
            plot.line(nm, curves["inverse rendering"], RENDERED, 1.4, label="inverse rendering")
        plot.line(nm, summary.mean, MEAN, 1.9, label="mean")
        plot.upright(summary.next_measurement_nm, INK, 0.6, DOTTED, "measure here next")
    if truth is not None:
        plot.line(nm, truth, TRUTH, 1.3, DOTTED, "measured truth")
    shown = plain_line(surface.name)
    return plot.drawn(f"Reflectance of {shown}", f"Reflectance of {shown} over "
                      "wavelength with what is known of its uncertainty; the table below holds the "
                      "numbers.", Readout(nm, curves, "Wavelength", "nm"))


@figure("the sensitivities")
def sensitivity_figure(name: str, fit: SensitivityFit, bands: tuple[str, ...],
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
    plot.level(0, QUIET, 0.6)
    for k, (band, colour) in enumerate(zip(bands, band_colours(bands), strict=True)):
        if error is not None:
            plot.areas(nm, fit.curves[k] - 2 * error[k], fit.curves[k] + 2 * error[k], colour, 0.18)
        plot.line(nm, fit.curves[k], colour, 1.6, label=plain_line(band, 24))
        if truth is not None:
            plot.line(truth[0], truth[1][k], colour, 1.0, DOTTED)
    if truth is not None:
        plot.line([], [], INK, 1.0, DOTTED, "measured curves")
    series: dict[str, np.ndarray] = {}
    for k, band in enumerate(bands):
        series[band] = fit.curves[k]
        if fit.standard_error is not None:
            series[f"{band} ± 2 s.e."] = 2 * fit.standard_error[k]
        if truth is not None:
            series[f"{band} measured"] = np.interp(nm, truth[0], truth[1][k], left=np.nan,
                                                   right=np.nan)
    return plot.drawn("Camera sensitivities", "Sensitivity of each camera band over wavelength.",
                      Readout(nm, series, "Wavelength", "nm"))


@figure("the light")
def light_figure(name: str, light: Spectrum, posterior: LightPosterior | None = None) -> Markup:
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
        plot.areas(nm, *band, QUIET, 0.3)
    plot.line(nm, values, INK, 1.5)
    digits = int(np.clip(3 - np.floor(np.log10(max(float(np.abs(values).max()), 1e-30))), 0, 12))
    return plot.drawn("Light spectrum", f"{quantity} over wavelength.",
                      Readout(nm, series, "Wavelength", "nm", digits))


def _over_wavelengths(name: str, nm: np.ndarray, limits: tuple[float, float], quantity: str,
                      left: float = LEFT) -> Plot:
    """Empty axes over the wavelengths (P,)."""
    plot = Plot(name, WIDTH, HEIGHT, (float(nm[0]), float(nm[-1])), limits, (left, 9, 31, 9))
    plot.x_axis("Wavelength (nm)", nice_ticks(float(nm[0]), float(nm[-1]), 7))
    plot.y_axis(quantity, nice_ticks(*limits, 7))
    return plot
