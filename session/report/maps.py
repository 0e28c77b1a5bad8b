"""Maps over the photo: photo and rendering alike stretched, signed residuals, and where each
surface lies.
"""
from __future__ import annotations

import matplotlib
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_hex, to_rgb
from matplotlib.ticker import FuncFormatter

from spectrabox.radiometry.appearance import encode_srgb
from spectrabox.radiometry.records import Reconstruction, SensitivityFit
from spectrabox.session.report.svg import figure, inline_svg, plain_line

PANEL_PX = 320  # at least, of each picture of a comparison
WIDTH_IN = 9.6  # a figure as wide as the page
NICE = np.array([0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0])  # ends of the residual scale
UNUSED = "#eceef1"


def display_bands(fit: SensitivityFit) -> list[int]:
    """The bands shown as red, green and blue: longest, middle and shortest mean wavelength.

    Returns
    -------
    list of int
        Rows of ``fit.curves``, that of the longest mean wavelength first.
    """
    weights = np.clip(fit.curves, 0, None) * fit.grid.weights_nm
    order = np.argsort(weights @ fit.grid.nm / weights.sum(axis=1))
    return [int(order[-1]), int(order[len(order) // 2]), int(order[0])]


def comparison_rgb8(made: Reconstruction, fit: SensitivityFit) -> np.ndarray:
    """Photo, rendering and signed residual side by side (h, w, 3) as 8-bit sRGB.

    Photo and rendering are stretched alike; the residual is the mean over the bands on a scale of
    its own, red where the photo is brighter, grey where a pixel was not used.
    """
    photo, rendering = _stretched(made, display_bands(fit))
    residuals = residual_maps(made)
    used = np.isfinite(residuals).all(axis=2)
    mean = np.where(used, np.where(used[..., None], residuals, 0).mean(axis=2), 0)
    limit = residual_limit(residuals)
    coloured = matplotlib.colormaps["RdBu_r"](0.5 + 0.5 * np.clip(mean / limit, -1, 1))[..., :3]
    coloured[~used] = to_rgb(UNUSED)
    enlarged = -(-PANEL_PX // photo.shape[1])
    strip = np.concatenate([photo, rendering, coloured], axis=1)
    return np.round(255 * strip).astype(np.uint8).repeat(enlarged, axis=0).repeat(enlarged, axis=1)


def _stretched(made: Reconstruction, chosen: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Photo and rendering (H, W, 3) divided by white, stretched by one factor and encoded for the
    screen.
    """
    photo, rendering = (image[..., chosen] / made.white_signal[chosen] for image in (made.measured,
                                                                                     made.rendered))
    seen = photo[np.isfinite(photo)]
    stretch = max(float(np.percentile(seen, 99)), 1e-12) if seen.size else 1.0
    return encode_srgb(np.nan_to_num(photo) / stretch), encode_srgb(np.nan_to_num(rendering)
                                                                      / stretch)


def pair_figure(name: str, made: Reconstruction, fit: SensitivityFit,
                bands: tuple[str, ...]) -> Markup:
    """Photo and rendering side by side, divided by white and stretched by one common factor.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    fit : SensitivityFit
        Its curves say which bands are shown as red, green and blue.
    bands : tuple of str
        K names.
    """
    chosen = display_bands(fit)
    height, width = made.used.shape
    drawing = figure(WIDTH_IN, _panel_height(WIDTH_IN / 2, height, width) + 0.3)
    titles = ("Photo", "Rendering")
    for axes, image, title in zip(drawing.subplots(1, 2), _stretched(made, chosen), titles,
                                  strict=True):
        axes.imshow(image)
        _bare(axes, title)
    shown = ", ".join(bands[k] for k in chosen)
    return inline_svg(drawing, name, "Photo and rendering",
                      f"Bands {shown} shown as red, green and blue.")


def residual_maps(made: Reconstruction) -> np.ndarray:
    """(photo - rendering) / photo (H, W, K), NaN where a pixel was not used."""
    usable = made.used[..., None] & (made.measured > 0)
    return np.where(usable, 1 - made.rendered / np.where(usable, made.measured, 1.0), np.nan)


def residual_limit(residuals: np.ndarray) -> float:
    """End of the common colour scale: the next round number above 98 % of all |residuals|.

    Parameters
    ----------
    residuals : (H, W, K) array
        Of ``residual_maps``; not a number where a pixel was not used.
    """
    seen = np.abs(residuals[np.isfinite(residuals)])
    reach = float(np.percentile(seen, 98)) if seen.size else 0.0
    return float(NICE[min(int(np.searchsorted(NICE, reach)), NICE.size - 1)])


def _signed_percent(value: float, _: int) -> str:
    return f"{100 * value:+g} %".replace("-", "−") if value else "0"


def residual_figure(name: str, made: Reconstruction, bands: tuple[str, ...]) -> Markup:
    """One signed residual map per band, all on one scale; pixels that were not used are hatched.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    bands : tuple of str
        K names.
    """
    residuals = residual_maps(made)
    limit = residual_limit(residuals)
    columns = min(len(bands), 3 if len(bands) != 4 else 4)
    rows = -(-len(bands) // columns)
    panel = _panel_height(WIDTH_IN / columns, *made.used.shape) + 0.3
    drawing = figure(WIDTH_IN, rows * panel + 0.7)
    grid = drawing.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[len(bands):]:
        axes.set_axis_off()
    for k, axes in enumerate(grid[:len(bands)]):
        axes.patch.set(facecolor=UNUSED, hatch="/////")
        image = axes.imshow(residuals[..., k], cmap="RdBu_r", vmin=-limit, vmax=limit)
        _bare(axes, f"Band {plain_line(bands[k], 24)}")
    bar = drawing.colorbar(image, ax=list(grid), location="bottom", aspect=50, fraction=0.05,
                           extend="both", format=FuncFormatter(_signed_percent))
    bar.set_label("(photo − rendering) / photo:   blue, photo darker;   red, photo brighter;   "
                  "hatched, not used")
    bar.outline.set_visible(False)
    return inline_svg(drawing, name, "Residual maps",
                      "Signed relative difference of photo and rendering per band.")


def surface_colours(count: int) -> list[str]:
    """One light colour per surface."""
    base = [*matplotlib.color_sequences["Set3"], *matplotlib.color_sequences["Pastel1"]]
    return [to_hex(base[s % len(base)]) for s in range(count)]


def surface_figure(name: str, made: Reconstruction) -> Markup:
    """Surfaces in false colour, each with its number; pixels of none are grey."""
    count = len(made.agreement.names)
    height, width = made.surface.shape
    drawing = figure(WIDTH_IN * 0.55, _panel_height(WIDTH_IN * 0.55, height, width) + 0.1)
    axes = drawing.add_subplot()
    colours = ListedColormap([UNUSED, *surface_colours(count)])
    axes.imshow(made.surface, cmap=colours, vmin=-1.5, vmax=count - 0.5)
    for s in range(count):
        if (made.surface == s).any():
            row, column = _middle(made.surface == s)
            axes.text(column, row, str(s + 1), ha="center", va="center", fontsize=9,
                      fontweight="bold")
    _bare(axes, "")
    return inline_svg(drawing, name, "Surfaces", "Where each surface of the scene lies in the "
                      "photo, numbered.")


def _middle(mask: np.ndarray) -> tuple[float, float]:
    """The middle of what is left of a mask just before its border has eaten it up, so the number
    stands on its own surface.
    """
    left = np.pad(mask, 1)
    while True:
        inner = left[1:-1, 1:-1] & left[:-2, 1:-1] & left[2:, 1:-1] & left[1:-1, :-2] & left[1:-1,
                                                                                             2:]
        if not inner.any():
            break
        left = np.pad(inner, 1)
    rows, columns = np.nonzero(left[1:-1, 1:-1])
    nearest = np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2)
    return float(rows[nearest]), float(columns[nearest])


def _panel_height(width_in: float, height: int, width: int) -> float:
    return float(np.clip(width_in * height / width, 0.8, 7.0))


def _bare(axes: Axes, title: str) -> None:
    axes.set(xticks=[], yticks=[], title=title)
    for spine in axes.spines.values():
        spine.set_visible(False)
