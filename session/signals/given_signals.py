"""Signals given as options of ``spectrabox sample``: as a capture, and the picture of their
spectra.
"""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spectrabox.measure import estimate, plots
from spectrabox.measure.signals.sample import measurement_of_signal
from spectrabox.measure.signals.signal_capture import SignalCapture, of_colours, of_curves
from spectrabox.radiometry import files, findings, grid
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra import named_spectra, spectrum_files
from spectrabox.radiometry.spectra.cameras import stated_curve_error
from spectrabox.sampling.prior import mixture
from spectrabox.session.commands.requests import MeasuredSignal
from spectrabox.session.signals import measurement_file, signal_options

PLOT_IN = (8.0, 4.5)      # inches


def signal_capture(measured: MeasuredSignal, signals: Path | None, colour: tuple[str, str] | None,
                   sensitivity: str, light: str, *, twice: str | None, light_error: float,
                   sensitivity_error: float, prior: Path | None, family: Sequence[str]
                   ) -> SignalCapture:
    """Signals and what is stated of them, read from options and files.

    Parameters
    ----------
    measured : MeasuredSignal
    signals, sensitivity, light, twice, light_error, sensitivity_error, prior, family
        As the options of ``spectrabox sample``.
    colour : (kind, text) or None
        Which of the options srgb, lab and xyz was given, and what it says.

    Raises
    ------
    InputError
        If an option or a file cannot be read.
    """
    response = named_spectra.relative_response(sensitivity, light, grid.FINE_GRID)
    names, bands = named_spectra.named_curves(sensitivity)[2], len(response)
    white = signal_options.optional_numbers(measured.white, bands, "white")
    reflected = None
    if twice is not None:
        signal, error = signal_options.signal_and_noise(twice, bands, "twice")
        reflected = measurement_of_signal(response, signal, white, error)
    more = measurement_file.further_measurements(measured, sensitivity, response, white)
    noise = signal_options.optional_noise(measured.noise, bands)
    origin: tuple[findings.Finding, ...] = ()
    if colour is not None:
        seen, rounding = signal_options.colour_signal(*colour, light)
        named, noise = {"": seen}, rounding if noise is None else noise
        white = np.ones(bands)      # a colour is relative to white
        stated = signal_options.srgb_values(colour[1]) if colour[0] == "srgb" \
            else signal_options.numbers(colour[1], bands, colour[0])
        origin = of_colours(colour[0], stated)
    elif signals is not None:
        named = signal_options.read_named_signals(signals, names)
    else:
        named = {"": signal_options.numbers(measured.signal or "", bands, "signal")}
    return SignalCapture(response, np.array(list(named.values())), tuple(named), white, noise,
                         light_error, sensitivity_error,
                         mixture.of_families(mixture.load_prior(prior),
                                             tuple(family)), more, reflected,
                         (*origin, *of_curves(stated_curve_error(sensitivity), sensitivity_error)))


def stated_truth(file: Path, column: str | None) -> np.ndarray:
    """The measured reflectance (61,) of the surface.

    Parameters
    ----------
    file : Path
    column : str, optional
        Of the file.
    """
    table = spectrum_files.read_table(file)
    name = table.names[spectrum_files.column_index(table, column)]
    return spectrum_files.spectrum_on_grid(
        spectrum_files.spectrum_of(table, role=Quantity.REFLECTANCE, column=name),
        mixture.PRIOR_GRID)


# ---- the picture of the spectra ------------------------------------------------------------------

def write_plot(path: Path, estimates: Sequence[estimate.Estimate]) -> None:
    """Draw the mean and the band of every signal.

    Parameters
    ----------
    path : Path
        Ends in .png.
    estimates : sequence of Estimate
    """
    from matplotlib import color_sequences, style
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    with style.context("default"):      # not as a matplotlibrc of the working folder has it
        figure = Figure(figsize=PLOT_IN, layout="constrained")
        axes, top = figure.add_subplot(), np.zeros(estimates[0].nm.size)
        for number, one in enumerate(estimates):
            nm, colour = one.nm, color_sequences["tab10"][number % 10]
            summary = one.summary
            assert summary is not None, "behind a signal the spectrum is estimated"
            top = np.maximum(top, summary.upper)
            axes.fill_between(nm, summary.lower, summary.upper, color=colour, alpha=0.25, lw=0)
            axes.plot(nm, one.mean, color=colour, lw=1.6,
                      label=one.name or f"mean and {summary.level:.0%} band")
        plots.frame_reflectance(axes, nm, top)
        axes.legend(frameon=False, fontsize="small")
        with files.whole_file(path) as unfinished:
            FigureCanvasAgg(figure).print_png(str(unfinished))
