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


def frame_reflectance(axes: Axes, nm: np.ndarray, highest: np.ndarray) -> None:
    """Axes of a reflectance, from 0 to 1 or to the highest value (P,) that is drawn."""
    frame_wavelengths(axes, nm)
    axes.set(ylim=(0, 1.02 * max(1.0, float(np.nanmax(highest)))), ylabel="Reflectance")


def frame_wavelengths(axes: Axes, nm: np.ndarray) -> None:
    """The wavelength axis, in nm."""
    axes.set(xlim=(float(nm[0]), float(nm[-1])), xlabel="Wavelength (nm)")
    axes.grid(visible=True)
