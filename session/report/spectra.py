"""Figures over wavelength: the spectra behind one material, sensitivities, light, and the error
budget.
"""
from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.collections import LineCollection, PolyCollection

from spectrabox.measure.plots import (
    MEAN,
    TRUTH,
    band_colours,
    plot_estimate,
    plot_given,
    plot_light,
    plot_sensitivities,
    plot_truth,
)
from spectrabox.measure.results import MaterialResult
from spectrabox.measure.words import percent
from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.records import (
    HeldOutPatches,
    LightPosterior,
    Quantity,
    SensitivityFit,
    Spectrum,
)
from spectrabox.session.report.svg import (
    GRID,
    QUIET,
    Readout,
    framed,
    inline_svg,
    legend_above,
    plain_line,
)

LETTERS, MANY_COLUMNS = 120, 8  # above a row of patches; more columns take smaller letters
LEGEND_LETTERS = 42     # that one row above the error budget holds
LETTER_IN = 0.062       # width of a letter beside the error budget
QUANTITIES = {Quantity.REFLECTANCE: "Reflectance", Quantity.IRRADIANCE: "Irradiance (W m⁻² nm⁻¹)",
              Quantity.RADIANCE: "Radiance (W m⁻² sr⁻¹ nm⁻¹)",
              Quantity.RELATIVE: "Relative spectral power"}


def material_curves(material: MaterialResult,
                    grid_nm: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Wavelengths (P,) and every curve known of one material, each (P,); NaN where a truth was not
    measured.

    Parameters
    ----------
    grid_nm : (P',) array
        Of the material's single spectrum.
    """
    estimate = material.spectrum
    summary = material.summary
    if summary is None:
        assert estimate is not None
        nm, curves = grid_nm, {"given": estimate}
    else:
        nm, level = summary.grid.nm, percent(summary.level)
        curves = {"mean": summary.mean, "standard deviation": summary.standard_deviation,
                  f"{level} band, lower": summary.lower, f"{level} band, upper": summary.upper,
                  "lowest possible": summary.bound_lower, "highest possible": summary.bound_upper}
        if estimate is not None:
            curves["inverse rendering"] = np.interp(nm, grid_nm, estimate)
    if material.truth is not None:
        truth = material.truth
        curves["measured truth"] = np.interp(nm, truth.grid.nm, truth.values, left=np.nan,
                                             right=np.nan)
    return nm, curves


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


def material_figure(name: str, material: MaterialResult, grid_nm: np.ndarray) -> Markup:
    """Draws, band, exact bounds, mean, the spectrum of inverse rendering, and the truth where one
    was measured.
    """
    nm, curves = material_curves(material, grid_nm)
    drawing, axes = framed(5.2, 2.9)
    if material.summary is None:
        plot_given(axes, nm, curves["given"])
    else:
        samples = material.samples
        plot_estimate(axes, material.summary, None if samples is None else samples.spectra,
                      None if samples is None else samples.grid.nm, curves.get("inverse rendering"))
    if "measured truth" in curves:
        plot_truth(axes, nm, curves["measured truth"])
    legend_above(drawing, 4, 1.6, 1.2)
    shown = plain_line(material.name)
    return inline_svg(drawing, name, f"Reflectance of {shown}", f"Reflectance of {shown} over "
                      "wavelength with what is known of its uncertainty; the table below holds the "
                      "numbers.",
                      Readout(axes, nm, curves, "Wavelength", "nm"))


def error_budget_figure(name: str, material: MaterialResult,
                        bands: tuple[str, ...]) -> Markup | None:
    """Relative standard error of the material's signal per cause and band; None where no cause was
    stated.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    bands : tuple of str
        J names, those of ``material.signal``; those that do not show it have no bars.
    """
    budget = material.error_budget
    if not budget:
        return None
    colours = dict(zip(bands, band_colours(bands), strict=True))
    bands = tuple(band for band, value in zip(bands, material.signal, strict=True)
                  if np.isfinite(value))
    causes = list(budget)[::-1]
    height = 0.8 / len(bands)
    names = [plain_line(cause, 26) for cause in causes]
    drawing, axes = framed(3.3, min(8.0, 0.9 + 0.13 * len(causes) * max(len(bands), 3)),
                           0.15 + LETTER_IN * max(map(len, names)))
    for k, band in enumerate(bands):
        at = np.arange(len(causes)) + 0.4 - (k + 0.5) * height
        axes.barh(at, [100 * float(budget[cause][k]) for cause in causes], 0.85 * height,
                  color=colours[band], label=plain_line(band, 24))
    axes.set_yticks(range(len(causes)), names)
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("Relative standard error (%)")
    axes.grid(axis="x")
    columns = max(min(len(bands), LEGEND_LETTERS // (4 + max(len(band) for band in bands))), 1)
    legend_above(drawing, columns, 0.8, 0.9)
    return inline_svg(drawing, name, f"Error budget of {plain_line(material.name)}",
                      "Bars: relative standard error of the signal by cause and camera band.")


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
    nm = fit.grid.nm
    drawing, axes = framed(5.2, 2.9)
    plot_sensitivities(axes, nm, fit.curves, fit.standard_error,
                       [plain_line(band, 24) for band in bands], truth)
    series: dict[str, np.ndarray] = {}
    for k, band in enumerate(bands):
        series[band] = fit.curves[k]
        if fit.standard_error is not None:
            series[f"{band} ± 2 s.e."] = 2 * fit.standard_error[k]
        if truth is not None:
            series[f"{band} measured"] = np.interp(nm, truth[0], truth[1][k], left=np.nan,
                                                   right=np.nan)
    legend_above(drawing, 8, 1.4, 1.2)
    return inline_svg(drawing, name, "Camera sensitivities",
                      "Sensitivity of each camera band over wavelength.",
                      Readout(axes, nm, series, "Wavelength", "nm"))


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
    drawing, axes = framed(5.2, 2.9, 0.8)
    plot_light(axes, nm, values, band, quantity)
    digits = int(np.clip(3 - np.floor(np.log10(max(float(np.abs(values).max()), 1e-30))), 0, 12))
    return inline_svg(drawing, name, "Light spectrum", f"{quantity} over wavelength.",
                      Readout(axes, nm, series, "Wavelength", "nm", digits))


def left_out_figure(name: str, patches: HeldOutPatches, chart: Chart) -> Markup:
    """Every patch's reflectance by a calibration without it: mean, band and reference, as printed
    on the chart.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    patches : HeldOutPatches
    chart : Chart
        Its layout.
    """
    # One pair of axes holds all: every further one takes as long as a figure of its own.
    drawing, axes = framed(9.6, 1.6 * chart.rows, 0.3)
    nm, top = patches.grid.nm, 1.05 * max(1.0, float(patches.upper.max()))
    row, column = np.divmod(np.arange(len(chart.names)), chart.columns)
    place = np.stack([1.08 * (nm[-1] - nm[0]) * column, -1.45 * top * row], axis=1)[:, None]

    def lines(colour: str, width: float, x: Any, y: Any, style: Any = "-") -> None:
        each = place + np.stack(np.broadcast_arrays(x, y), axis=-1)     # (I, Q, 2)
        axes.add_collection(LineCollection(list(each), colors=colour, lw=width, ls=style))

    few = chart.columns <= MANY_COLUMNS
    ticks_nm, values = (450, 550, 650) if few else (550,), (0.0, 0.5, 1.0)
    for at in ticks_nm:
        lines(GRID, 0.6, [at, at], [0, top])
    for value in values:
        lines(GRID if value else QUIET, 0.6, nm[[0, -1]], [value, value])
    around = np.stack(np.broadcast_arrays(np.r_[nm, nm[::-1]], np.c_[
        patches.lower, patches.upper[:, ::-1]]), axis=-1)
    axes.add_collection(PolyCollection(list(place + around), color=MEAN, alpha=0.2, lw=0))
    lines(MEAN, 1.3, nm, patches.mean)
    lines(TRUTH, 1.0, nm, patches.reference, (0, (1, 1.2)))
    for number, (x, y) in enumerate(place[:, 0] + (nm[0], 1.02 * top)):
        kept = ", kept out" if patches.excluded[number] else ""
        axes.text(x, y, f"{number + 1} {plain_line(chart.names[number], LETTERS // chart.columns)}"
                  f"{kept}\n{patches.rmse[number]:.3f}, {percent(patches.inside[number])} inside",
                  fontsize=7 if few else 4, va="bottom")
    axes.set(xlim=(nm[0], place[-1, 0, 0] + nm[-1]), ylim=(place[-1, 0, 1], 1.4 * top))
    axes.set_xticks([x + at for x in place[:chart.columns, 0, 0] for at in ticks_nm],
                    [f"{at}" for at in ticks_nm] * chart.columns)
    axes.set_yticks([y + value for y in place[::chart.columns, 0, 1] for value in values],
                    [f"{value:g}" for value in values] * chart.rows)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    return inline_svg(drawing, name, "Patches left out", "Reflectance of each patch by a "
                      "calibration without it, its band, and the chart's reference.")
