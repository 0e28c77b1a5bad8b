"""A picture of a photo with the pixels of the photo on its axes, to read regions from."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.capture.photo.binning import bin_image
from spectrabox.capture.photo.preview import signal_rgb8
from spectrabox.radiometry.records.photos import LinearImage

WIDTH_PX, WIDTH_IN = 1400, 14.0


def write_picture(image: LinearImage, picture: Path,
                  patches_px: np.ndarray | None = None) -> tuple[int, int]:
    """Write a PNG of a photo with axes that count its pixels.

    Parameters
    ----------
    image : LinearImage
    picture : Path
        Ends in .png.
    patches_px : (I, 4, 2) array, optional
        Of the chart, in pixels of the photo: they are drawn.

    Returns
    -------
    tuple of int
        Width and height of the photo in pixels.
    """
    from matplotlib import style
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import MultipleLocator
    rows, columns = image.signal.shape[:2]
    width, height = round(columns * image.sensor_step), round(rows * image.sensor_step)
    if columns > WIDTH_PX:
        image = bin_image(image, WIDTH_PX, round(WIDTH_PX * rows / columns))
    with style.context("default"):      # not as a matplotlibrc of the working folder has it
        drawing = Figure(figsize=(WIDTH_IN, WIDTH_IN * height / width), layout="constrained")
        axes = drawing.add_subplot()
        axes.imshow(signal_rgb8(image.signal), extent=(-0.5, width - 0.5, height - 0.5, -0.5))
        for quad in () if patches_px is None else patches_px:
            for colour, line_width in (("white", 2.0), ("black", 0.7)):
                axes.fill(*quad.T, fill=False, edgecolor=colour, linewidth=line_width)
        step = 10.0 ** np.floor(np.log10(width / 4))
        axes.xaxis.set_major_locator(MultipleLocator(step))
        axes.yaxis.set_major_locator(MultipleLocator(step))
        axes.grid(color="white", alpha=0.5, linewidth=0.5)
        axes.tick_params(labeltop=True, labelright=True)
        FigureCanvasAgg(drawing).print_png(str(picture))
    return width, height
