"""Figures of the chart and of the convergence, and pictures as data URIs."""
from __future__ import annotations

import base64
import hashlib
import io
from pathlib import Path

import numpy as np
from markupsafe import Markup
from matplotlib import image as raster
from matplotlib.ticker import FuncFormatter

from spectrabox.measure.plots import INK, QUIET, band_colours
from spectrabox.measure.words import SUPERSCRIPT, number
from spectrabox.radiometry.errors import InputError
from spectrabox.session.report.svg import (
    Readout,
    figure,
    framed,
    inline_svg,
    legend_above,
    plain_line,
)

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
MAX_TICKS = 24      # patches numbered along an axis
MAX_SIDE_PX = 1400  # pictures are reduced to this: the page shows no more


def picture_data_uri(path: Path, max_side_px: int = MAX_SIDE_PX) -> str:
    """A PNG file as data URI, reduced by whole factors where it is larger than the page shows.

    Parameters
    ----------
    path : Path
    max_side_px : int
        Of the page.

    Raises
    ------
    InputError
        If the file is missing or not a PNG.
    """
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise InputError(f"picture {path.name} cannot be read ({problem.strerror}); run the stage "
                         "that makes it again") from problem
    if not content.startswith(PNG_SIGNATURE):
        raise InputError(
            f"picture {path.name} is not a PNG file; run the stage that makes it again")
    factor = -(-max(int.from_bytes(content[16:20]), int.from_bytes(content[20:24])) // max_side_px)
    if factor > 1:
        content = _reduced(content, factor)
    return "data:image/png;base64," + base64.b64encode(content).decode("ascii")


def picture_digest(uri: str) -> str:
    """SHA-256 of the picture in a data URI."""
    return hashlib.sha256(base64.b64decode(uri.partition(",")[2])).hexdigest()


def _reduced(content: bytes, factor: int) -> bytes:
    pixels = raster.imread(io.BytesIO(content), format="png")
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    rows, columns = (size // factor * factor for size in pixels.shape[:2])
    blocks = pixels[:rows, :columns].reshape(rows // factor, factor, columns // factor, factor,
                                             -1).mean(axis=(1, 3))
    if blocks.shape[2] < 3:
        blocks = np.repeat(blocks[..., :1], 3, axis=2)
    buffer = io.BytesIO()
    raster.imsave(buffer, np.clip(blocks, 0, 1), format="png")
    return buffer.getvalue()


def chart_residual_figure(name: str, residuals: np.ndarray, held_out: np.ndarray | None,
                          bands: tuple[str, ...],
                          limit: float) -> Markup:
    """Residuals (I, K) of the patches: filled as fitted, open where the patch was left out of its
    own fit.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    residuals, held_out : (I, K) arrays
        (photo - predicted) / photo, chart order; the latter None where nothing was left out.
    limit : float
        Of a chart that is good; drawn as a grey band.
    """
    drawing, axes = framed(9.6, 3.0)
    axes.axhspan(-100 * limit, 100 * limit, color="#eef1f4", lw=0)
    axes.axhline(0, color=QUIET, lw=0.7)
    patches = len(residuals)
    for k, (band, colour) in enumerate(zip(bands, band_colours(bands), strict=True)):
        at = np.arange(1, patches + 1) + 0.5 * ((k + 0.5) / len(bands) - 0.5)
        if held_out is not None:
            axes.plot(at, 100 * held_out[:, k], "o", ms=4.5, mfc="none", mec=colour, mew=0.8)
        axes.plot(at, 100 * residuals[:, k], "o", ms=3.5, color=colour, label=plain_line(band, 24))
    if held_out is not None:
        axes.plot([], [], "o", ms=4.5, mfc="none", mec=INK, mew=0.8,
                  label="left out of its own fit")
    axes.set(xlim=(0.4, patches + 0.6), xlabel="Patch",
             ylabel="(photo − predicted) / photo (%)")
    axes.set_xticks(range(1, patches + 1, -(-patches // MAX_TICKS)))
    axes.grid(axis="y")
    legend_above(drawing, 8, 0.8, 1.2)
    return inline_svg(drawing, name, "Chart residuals",
                      f"Relative residual of the {patches} patches in each band.")


def irradiance_figure(name: str, irradiance: np.ndarray, rows: int) -> Markup:
    """Relative irradiance (I,) over the chart, row by row as printed.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    irradiance : (I,) array
        Relative to the brightest patch, in chart order.
    rows : int
        Of the chart.
    """
    field = 100 * irradiance.reshape(rows, -1)
    drawing = figure(max(0.6 * field.shape[1], 1.6), 0.55 * rows + 0.4)
    axes = drawing.add_subplot()
    axes.imshow(field, cmap="cividis", vmin=min(float(np.nanmin(field)), 80.0), vmax=100)
    low, high = axes.get_images()[0].get_clim()
    for (row, column), value in np.ndenumerate(field):
        text = f"{value:.0f}" if np.isfinite(value) else "?"
        ink = "white" if value < low + 0.55 * (high - low) else "black"
        axes.text(column, row, text, ha="center", va="center", fontsize=8, color=ink)
    axes.set(xticks=[], yticks=[], title="Irradiance, %")      # of how much, the caption says
    for spine in axes.spines.values():
        spine.set_visible(False)
    return inline_svg(drawing, name, "Irradiance over the chart",
                      "Relative irradiance of each patch in per cent.")


def loss_figure(name: str, history: np.ndarray) -> Markup | None:
    """Loss against iteration, logarithmic where all losses are positive; None where there is no
    history.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    history : (I,) array
        Loss after each iteration.
    """
    if history.size < 2:
        return None
    drawing, axes = framed(9.6, 2.7, 0.8)
    steps = np.arange(history.size)
    marks = "o-" if history.size <= 30 else "-"
    axes.plot(steps, history, marks, ms=2.5, color="#1f4e8c", lw=1.3)
    if np.all(history > 0):
        axes.set_yscale("log")
        for axis_format in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
            axis_format(FuncFormatter(lambda value, _: power_of_ten(value) if _is_decade(value)
                                      else ""))
        if history.max() / history.min() < 30:  # too few decades for their labels alone
            axes.yaxis.set_minor_formatter(FuncFormatter(lambda value, _: number(value, 2)))
    axes.set(xlabel="Iteration", ylabel="Loss", xlim=(0, history.size - 1))
    axes.grid(which="major")
    start, end = number(float(history[0]), 3), number(float(history[-1]), 3)
    digits = int(np.clip(4 - np.floor(np.log10(max(float(np.abs(history).min()), 1e-12))), 3, 14))
    return inline_svg(drawing, name, "Loss history", f"The loss fell from {start} to {end}.",
                      Readout(axes, steps.astype(float), {"loss": history}, "Iteration", "",
                              digits))


def power_of_ten(value: float) -> str:
    """A power of ten as a tick label."""
    return "10" + str(round(np.log10(value))).translate(SUPERSCRIPT)


def _is_decade(value: float) -> bool:
    return value > 0 and abs(np.log10(value) - round(np.log10(value))) < 1e-9
