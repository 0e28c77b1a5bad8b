"""Plots of estimates, as every picture of the project is drawn."""
from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from spectrabox.radiometry.appearance import reflectance_to_srgb
from spectrabox.radiometry.records.spectra import SpectrumSummary

if TYPE_CHECKING:   # Matplotlib takes a while to import
    from matplotlib.axes import Axes

    from spectrabox.measure.estimate import Estimate
    from spectrabox.measure.profiles.camera_profile import MatrixComparison


INK, QUIET = "#22262b", "#6b7280"
MEAN, RENDERED, TRUTH = "#1f4e8c", "#d0661a", "#1a1a1a"
NATURAL = {"R": "#c2352b", "G": "#2c8a4b", "B": "#2b5fb8"}
# Matplotlib's "tab10", and those of it that are close to the natural ones
DISTINCT = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f",
            "#bcbd22", "#17becf")
LIKE_NATURAL = {"#1f77b4", "#2ca02c", "#d62728"}
DRAWS_SHOWN = 30


def band_colours(bands: Sequence[str]) -> list[str]:
    """One colour per camera band: red, green and blue where the band is named so, otherwise ten
    distinct ones.
    """
    taken = LIKE_NATURAL if NATURAL.keys() & set(bands) else set()
    spare = itertools.cycle([colour for colour in DISTINCT if colour not in taken])
    return [NATURAL[band] if band in NATURAL else next(spare) for band in bands]


# ---- plots ---------------------------------------------------------------------------------------

DOTTED = (0, (1, 1.2))
WIDTH, HEIGHT = 150, 36     # of the small plot, in pixels


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
        axes.plot(lines_nm, draws[chosen].T, color=QUIET, lw=0.5, alpha=0.3)
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


def plot_matrices(entries: Axes, errors: Axes, compared: MatrixComparison) -> None:
    """Draw matrices of one camera side by side: their nine entries, and CIEDE2000 of the chart and
    of fresh surfaces, mean (dot) and high percentile (ring), one standard deviation either side.

    Parameters
    ----------
    entries, errors : Axes
    compared : MatrixComparison
    """
    rows = compared.facts()
    for number, (row, colour) in enumerate(zip(rows, (TRUTH, MEAN, RENDERED)[-len(rows):],
                                               strict=True)):
        aside = 0.22 * (number - (len(rows) - 1) / 2)
        known = row["matrix"].standard_deviation
        entries.errorbar(np.arange(9) + aside, np.ravel(row["matrix"].value),
                         None if known is None else np.ravel(known), fmt="o", ms=4, lw=1.2,
                         color=colour, label=row["source"])
        for face, figures in zip((colour, "none"), zip(row["chart"].values(), row["fresh"].values(),
                                                       strict=True), strict=True):
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


def axes_for(axes: Axes | None, inches: tuple[float, float] | None = None) -> Axes:
    """The given axes, or new ones in a figure of that size."""
    import matplotlib.pyplot as plt  # commands draw without it
    return plt.subplots(figsize=inches, layout="constrained")[1] if axes is None else axes


def spectrum_html(estimates: Sequence[Estimate]) -> str:
    """A table with one row a surface, and below it what was not stated of their signals."""
    rows = Markup("").join(_row(estimate) for estimate in estimates)
    table = Markup("<table><thead><tr><th>surface</th><th>colour</th><th>400 to 700 nm, 0 to 1</th>"
                   "<th>band width</th></tr></thead><tbody>{}</tbody></table>")
    caveats = dict.fromkeys(caveat for estimate in estimates for caveat in estimate.caveats)
    return str(table.format(rows) + Markup("").join(Markup("<p>{}</p>").format(caveat)
                                                    for caveat in caveats))


def _row(estimate: Estimate) -> Markup:
    nm = estimate.nm
    red, green, blue = (round(255 * float(value)) for value
                        in reflectance_to_srgb(nm, np.clip(estimate.mean, 0, 1)))
    width = "given" if estimate.given is not None else f"{estimate.band_width:.3f}"
    return Markup('<tr><td>{}</td><td><span style="display:inline-block;width:2.5em;height:1.4em;'
                  'background:rgb({},{},{})"></span></td><td>{}</td><td>{}</td></tr>').format(
                      estimate.name, red, green, blue, _small_plot(estimate), width)


def _small_plot(estimate: Estimate) -> Markup:
    nm = estimate.nm
    x = (nm - nm[0]) / (nm[-1] - nm[0]) * WIDTH
    lower, upper = estimate.band()
    step = max(len(nm) // 60, 1)

    def points(values: np.ndarray, order: slice) -> str:
        return " ".join(f"{a:.1f},{HEIGHT * (1 - min(float(b), 1.0)):.1f}"
                        for a, b in zip(x[::step][order], values[::step][order], strict=True))

    forward, backward = slice(None), slice(None, None, -1)
    return Markup('<svg width="{}" height="{}" role="img" aria-label="mean and band of {}">'
                  '<polygon points="{} {}" fill="#1f4e8c" fill-opacity=".18"/><polyline '
                  'points="{}" fill="none" stroke="#1f4e8c" stroke-width="1.5"/></svg>').format(
                      WIDTH, HEIGHT, estimate.name, points(upper, forward),
                      points(lower, backward), points(estimate.mean, forward))


def curves_html(nm: np.ndarray, curves: np.ndarray, bands: Sequence[str],
                said: Sequence[str]) -> str:
    """A small plot of curves (K, P), and sentences on them."""
    top = float(curves.max())
    x = (nm - nm[0]) / (nm[-1] - nm[0]) * 2 * WIDTH
    step = max(len(nm) // 60, 1)
    lines = Markup("").join(
        Markup('<polyline points="{}" fill="none" stroke="{}" stroke-width="1.5"/>').format(
            " ".join(f"{a:.1f},{2 * HEIGHT * (1 - max(float(b), 0.0) / top):.1f}"
                     for a, b in zip(x[::step], curve[::step], strict=True)), colour)
        for curve, colour in zip(curves, band_colours(bands), strict=True))
    items = Markup("").join(Markup("<li>{}</li>").format(sentence) for sentence in said)
    return str(Markup('<svg width="{}" height="{}" role="img" aria-label="sensitivities">{}</svg>'
                      "<ul>{}</ul>").format(2 * WIDTH, 2 * HEIGHT, lines, items))
