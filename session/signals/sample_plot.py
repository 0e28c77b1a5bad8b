"""The picture of the spectra behind signals that ``spectrabox sample --plot`` writes."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import color_sequences
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from spectrabox.measure.plots import frame_reflectance
from spectrabox.radiometry.files import whole_file

SIZE_IN = (8.0, 4.5)


def write_plot(path: Path, facts: dict[str, Any]) -> None:
    """Draw the mean and the band of every signal.

    Parameters
    ----------
    path : Path
        Ends in .png.
    facts : dict
        Of ``sample_answer``.
    """
    results = facts.get("results", [facts])
    figure = Figure(figsize=SIZE_IN, layout="constrained")
    axes = figure.add_subplot()
    for number, each in enumerate(results):
        nm, colour = np.array(each["wavelengths_nm"]), color_sequences["tab10"][number % 10]
        axes.fill_between(nm, each["lower"], each["upper"], color=colour, alpha=0.25, lw=0)
        axes.plot(nm, each["mean"], color=colour, lw=1.6,
                  label=each.get("name", f"mean and {each['level']:.0%} band"))
    frame_reflectance(axes, nm, np.max([each["upper"] for each in results], axis=0))
    axes.legend(frameon=False, fontsize="small")
    with whole_file(path) as unfinished:
        FigureCanvasAgg(figure).print_png(str(unfinished))
