"""Spectra, sensitivities and lights drawn into Matplotlib axes, as in a notebook."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.ticker import FuncFormatter

from spectrabox.measure.plot_style import (
    DRAWS_SHOWN,
    INK,
    MEAN,
    QUIET,
    RENDERED,
    TRUTH,
    band_colours,
)
from spectrabox.measure.profiles.matrix_comparison import ComparedMatrices
from spectrabox.radiometry.records.spectra import SpectrumSummary

DOTTED = (0, (1, 1.2))


def plot_estimate(axes: Axes, summary: SpectrumSummary, draws: np.ndarray | None = None,
                  draws_nm: np.ndarray | None = None,
                  inverse_rendering: np.ndarray | None = None) -> None:
    """Draw an estimated reflectance: band, exact bounds, mean and some of the draws.

    Parameters
    ----------
    axes : Axes
    summary : SpectrumSummary
    draws : (T, Q) array, optional
        Of which up to 30 are shown, chosen at a fixed seed.
    draws_nm : (Q,) array, optional
        Their wavelengths in nm; those of the summary by default.
    inverse_rendering : (P,) array, optional
        The one spectrum of inverse rendering, on the wavelengths of the summary.
    """
    nm = summary.grid.nm
    if draws is not None:
        chosen = np.random.default_rng(0).choice(len(draws), min(DRAWS_SHOWN, len(draws)),
                                                 replace=False)
        lines_nm = nm if draws_nm is None else draws_nm
        axes.add_collection(LineCollection([np.c_[lines_nm, draw] for draw in draws[chosen]],
                                           colors=QUIET, lw=0.5, alpha=0.3))
        axes.plot([], [], color=QUIET, lw=0.7, alpha=0.6, label=f"{len(chosen)} draws")
    axes.fill_between(nm, summary.lower, summary.upper, color=MEAN, alpha=0.18, lw=0,
                      label=f"{100 * summary.level:.4g} % band")
    axes.plot(nm, summary.bound_lower, color=QUIET, lw=0.9, ls="--", label="exact bounds")
    axes.plot(nm, summary.bound_upper, color=QUIET, lw=0.9, ls="--")
    if inverse_rendering is not None:
        axes.plot(nm, inverse_rendering, color=RENDERED, lw=1.4, label="inverse rendering")
    axes.plot(nm, summary.mean, color=MEAN, lw=1.9, label="mean")
    axes.axvline(summary.next_measurement_nm, color=INK, lw=0.6, ls=":", label="measure here next")
    frame_reflectance(axes, nm, summary.bound_upper)


def plot_given(axes: Axes, nm: np.ndarray, reflectance: np.ndarray) -> None:
    """Draw a reflectance (P,) that is known."""
    axes.plot(nm, reflectance, color=MEAN, lw=1.8, label="given spectrum")
    frame_reflectance(axes, nm, reflectance)


def plot_truth(axes: Axes, nm: np.ndarray, reflectance: np.ndarray) -> None:
    """Draw a measured reflectance (P,) to compare with; NaN where it was not measured."""
    axes.plot(nm, reflectance, color=TRUTH, lw=1.3, ls=DOTTED, label="measured truth")
    if np.isfinite(reflectance).any():
        axes.set_ylim(0, max(axes.get_ylim()[1], 1.02 * float(np.nanmax(reflectance))))


def plot_sensitivities(axes: Axes, nm: np.ndarray, curves: np.ndarray,
                       standard_error: np.ndarray | None, bands: Sequence[str],
                       truth: tuple[np.ndarray, np.ndarray] | None = None) -> None:
    """Draw sensitivities (K, P), shaded to two standard errors either side.

    Parameters
    ----------
    axes : Axes
    nm : (P,) array
    curves, standard_error : (K, P) arrays
        The latter None where it is not stated.
    bands : sequence of K str
    truth : (nm, curves), optional
        Measured curves (K, Q) at wavelengths (Q,), the highest peak of all being 1.
    """
    for k, (band, colour) in enumerate(zip(bands, band_colours(bands), strict=True)):
        if standard_error is not None:
            axes.fill_between(nm, curves[k] - 2 * standard_error[k],
                              curves[k] + 2 * standard_error[k], color=colour, alpha=0.18, lw=0)
        axes.plot(nm, curves[k], color=colour, lw=1.6, label=band)
        if truth is not None:
            axes.plot(truth[0], truth[1][k], color=colour, lw=1.0, ls=DOTTED)
    if truth is not None:
        axes.plot([], [], color=INK, lw=1.0, ls=DOTTED, label="measured curves")
    frame_wavelengths(axes, nm)
    axes.axhline(0, color=QUIET, lw=0.6)
    axes.set_ylabel("Sensitivity (highest peak = 1)")


def plot_light(axes: Axes, nm: np.ndarray, values: np.ndarray,
               band: tuple[np.ndarray, np.ndarray] | None = None,
               quantity: str = "Relative spectral power") -> None:
    """Draw a light spectrum (P,), with its band (lower, upper) where there is one."""
    axes.plot(nm, values, color=INK, lw=1.5)
    if band is not None:
        axes.fill_between(nm, *band, color=QUIET, alpha=0.3, lw=0)
    frame_wavelengths(axes, nm)
    axes.set(ylabel=quantity, ylim=(0, None))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))


def plot_matrices(entries: Axes, errors: Axes, compared: ComparedMatrices) -> None:
    """Draw matrices of one camera side by side: their nine entries, and CIEDE2000 of the chart and
    of fresh surfaces, mean (dot) and high percentile (ring), one standard deviation either side.

    Parameters
    ----------
    entries, errors : Axes
    compared : ComparedMatrices
    """
    colours = (TRUTH, MEAN, RENDERED)[-len(compared.rows):]
    for number, (row, colour) in enumerate(zip(compared.rows, colours, strict=True)):
        aside = 0.22 * (number - (len(compared.rows) - 1) / 2)
        known = row.matrix.standard_deviation
        entries.errorbar(np.arange(9) + aside, np.ravel(row.matrix.value),
                         None if known is None else np.ravel(known), fmt="o", ms=4, lw=1.2,
                         color=colour, label=row.source)
        for face, figures in ((colour, [row.chart[0], row.fresh[0]]),
                              ("none", [row.chart[1], row.fresh[1]])):
            errors.errorbar(np.arange(2) + aside, [float(one.value) for one in figures],
                            [float(one.standard_deviation or 0) for one in figures], fmt="o", ms=6,
                            mfc=face, lw=1.2, color=colour)
    entries.set_xticks(range(9), [f"{band}\u2192{to}" for to in "XYZ" for band in "RGB"])
    entries.axhline(0, color=QUIET, lw=0.6)
    entries.set_ylabel("Entry of the matrix to X, Y, Z under D50")
    handles, labels = entries.get_legend_handles_labels()
    errors.legend(handles, labels, frameon=False, fontsize="small", loc="lower center")
    errors.set_xticks(range(2), ["the chart as\nphotographed",
                                 f"surfaces of no fit, as\nthe {compared.judge} see them"])
    errors.set(xlim=(-0.6, 1.6), ylim=(0, None),
               ylabel="CIEDE2000 (dot: mean, ring: 90th percentile)")


def frame_reflectance(axes: Axes, nm: np.ndarray, highest: np.ndarray) -> None:
    """Axes of a reflectance, from 0 to 1 or to the highest value (P,) that is drawn."""
    frame_wavelengths(axes, nm)
    axes.set(ylim=(0, 1.02 * max(1.0, float(np.nanmax(highest)))), ylabel="Reflectance")


def frame_wavelengths(axes: Axes, nm: np.ndarray) -> None:
    """The wavelength axis, in nm."""
    axes.set(xlim=(float(nm[0]), float(nm[-1])), xlabel="Wavelength (nm)")
    axes.grid(visible=True)
