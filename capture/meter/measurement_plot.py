"""A spectrum as characters for a terminal, and as a PNG."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.radiometry.files import whole_file
from spectrabox.radiometry.records.spectra import Spectrum

BLOCKS = " ▁▂▃▄▅▆▇█"
WIDTH, HEIGHT = 72, 12      # characters


def text_plot(spectrum: Spectrum) -> str:
    """A spectrum as columns of block characters; negative values stay empty.

    Parameters
    ----------
    spectrum : Spectrum
        Its largest value fills the height.
    """
    nm, values = spectrum.grid.nm, spectrum.values
    at = np.linspace(nm[0], nm[-1], WIDTH)
    top = float(values.max())
    levels = np.clip(np.interp(at, nm, values) / top, 0, 1) * HEIGHT if top > 0 else np.zeros(WIDTH)
    rows = []
    for row in range(HEIGHT - 1, -1, -1):
        filled = np.clip(np.round((levels - row) * 8), 0, 8).astype(int)
        label = f"{top:9.3g} " if row == HEIGHT - 1 else f"{0:9.3g} " if row == 0 else " " * 10
        rows.append(label + "".join(BLOCKS[level] for level in filled))
    rows.append(f"{'':10}{nm[0]:<8g}{f'{nm[-1]:g} nm':>{WIDTH - 8}}")
    return "\n".join(rows) + f"\n{'':10}{spectrum.quantity.name.lower()}, {spectrum.quantity.value}"


def png_plot(spectrum: Spectrum, path: Path) -> None:
    """Write a picture of the spectrum with its standard error as a band.

    Parameters
    ----------
    spectrum : Spectrum
    path : Path

    Raises
    ------
    EnvironmentProblem
    """
    from matplotlib import style
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with style.context("default"):      # not as a matplotlibrc of the working folder has it
        figure = Figure(figsize=(7, 4), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        axes.plot(spectrum.grid.nm, spectrum.values, lw=1.2)
        if spectrum.standard_error is not None:
            axes.fill_between(spectrum.grid.nm, spectrum.values - 2 * spectrum.standard_error,
                              spectrum.values + 2 * spectrum.standard_error, alpha=0.3, lw=0,
                              label="± 2 standard errors")
            axes.legend()
        axes.set(xlabel="wavelength (nm)", ylabel=f"{spectrum.quantity.name.lower()} "
                 f"({spectrum.quantity.value})", title=spectrum.source)
        with whole_file(path) as unfinished:
            figure.savefig(unfinished, dpi=120, format="png")
