"""The picture of the spectra behind signals that ``spectrabox sample --plot`` writes."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import color_sequences, style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from spectrabox.measure import estimate, plots
from spectrabox.radiometry.files import whole_file

SIZE_IN = (8.0, 4.5)


def write_plot(path: Path, estimates: Sequence[estimate.Estimate]) -> None:
    """Draw the mean and the band of every signal.

    Parameters
    ----------
    path : Path
        Ends in .png.
    estimates : sequence of Estimate
    """
    with style.context("default"):      # not as a matplotlibrc of the working folder has it
        figure = Figure(figsize=SIZE_IN, layout="constrained")
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
        with whole_file(path) as unfinished:
            FigureCanvasAgg(figure).print_png(str(unfinished))
