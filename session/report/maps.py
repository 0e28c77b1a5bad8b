"""Maps over the photo: photo and rendering alike stretched, signed residuals, where each surface
lies, and where lamp and cameras were stated to be and where they were found.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from spectrabox.measure.pictures import shown_photo
from spectrabox.radiometry.appearance import encode_srgb
from spectrabox.radiometry.records import calibration, scenes
from spectrabox.session.report import pictures, svg

PANEL_PX = 320  # at least, of each picture of a comparison
WIDE, GAP, TITLE = 691.0, 8.0, 14.0     # in points: a figure across the page, between its panels
BAR_WIDTH, BAR_HEIGHT, BAR_SHADES = 440.0, 9.0, 65      # of the scale of residuals
PHOTO_WIDTH = 446.0             # in points, of the photo beside the spectra
GEOMETRY_WIDTH, MAX_SIDE_PX = 338.0, 480    # in points; pixels of the photo behind the edges
GREEN, RED = "#16a34a", "#dc2626"
NICE = np.array([0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0])  # ends of the residual scale
UNUSED, HATCH = "#eceef1", "#9aa1ab"
# of surfaces in false colour, light enough for a number: "Set3" and "Pastel1" of ColorBrewer
LIGHT_COLOURS = ("#8dd3c7", "#ffffb3", "#bebada", "#fb8072", "#80b1d3", "#fdb462", "#b3de69",
                 "#fccde5", "#d9d9d9", "#bc80bd", "#ccebc5", "#ffed6f", "#fbb4ae", "#b3cde3",
                 "#ccebc5", "#decbe4", "#fed9a6", "#ffffcc", "#e5d8bd", "#fddaec", "#f2f2f2")


def display_bands(fit: calibration.SensitivityFit) -> list[int]:
    """The bands shown as red, green and blue: longest, middle and shortest mean wavelength.

    Returns
    -------
    list of int
        Rows of ``fit.curves``, that of the longest mean wavelength first.
    """
    weights = np.clip(fit.curves, 0, None) * fit.grid.weights_nm
    order = np.argsort(weights @ fit.grid.nm / weights.sum(axis=1))
    return [int(order[-1]), int(order[len(order) // 2]), int(order[0])]


def comparison_rgb8(made: scenes.Reconstruction, fit: calibration.SensitivityFit) -> np.ndarray:
    """Photo, rendering and signed residual side by side (h, w, 3) as 8-bit sRGB.

    Photo and rendering are stretched alike; the residual is the mean over the bands on a scale of
    its own, red where the photo is brighter, grey where a pixel was not used.
    """
    photo, rendering = _stretched(made, display_bands(fit))
    residuals = residual_maps(made)
    used = np.isfinite(residuals).all(axis=2)
    mean = np.where(used, np.where(used[..., None], residuals, 0).mean(axis=2), 0)
    limit = residual_limit(residuals)
    residual = pictures.coloured(0.5 + 0.5 * mean / limit, pictures.SIGNED)
    residual[~used] = pictures.rgb_of(UNUSED)
    enlarged = -(-PANEL_PX // photo.shape[1])
    strip = np.concatenate([photo, rendering, residual], axis=1)
    return np.round(255 * strip).astype(np.uint8).repeat(enlarged, axis=0).repeat(enlarged, axis=1)


def _stretched(fit: scenes.Reconstruction, chosen: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Photo and rendering (H, W, 3) divided by white, stretched by one factor and encoded for the
    screen.
    """
    photo, rendering = (image[..., chosen] / fit.white_signal[chosen] for image in (fit.measured,
                                                                                     fit.rendered))
    seen = photo[np.isfinite(photo)]
    stretch = max(float(np.percentile(seen, shown_photo.BRIGHTEST)), 1e-12) if seen.size else 1.0
    return encode_srgb(np.nan_to_num(photo) / stretch), encode_srgb(np.nan_to_num(rendering)
                                                                      / stretch)


@svg.figure("photo and rendering")
def pair_figure(name: str, made: scenes.Reconstruction, fit: calibration.SensitivityFit,
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
    panels, height = _panels(2, 2, made.used.shape)
    plot = _sheet(name, height)
    for (left, top, right, bottom), image, title in zip(
            panels, _stretched(made, chosen), ("Photo", "Rendering"), strict=True):
        plot.picture((left, top, right, bottom), pictures.pixels_data_uri(image))
        plot.words((left + right) / 2, top - 4, title, 8.5)
    shown = ", ".join(bands[k] for k in chosen)
    return plot.drawn("Photo and rendering", f"Bands {shown} shown as red, green and blue.")


@svg.figure("the photo")
def linked_photo(name: str, made: scenes.Reconstruction, of_photo: calibration.Calibration,
                 links: Mapping[str, tuple[str, int]]) -> Markup:
    """The photo alone, in the colours of its calibration where it has three bands; every surface
    leads to the card of its material.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    of_photo : Calibration
        Its curves say which bands are shown as red, green and blue of a camera of others.
    links : mapping
        From the name of a material.
    """
    height, width = made.surface.shape
    plot = svg.Plot(name, PHOTO_WIDTH, _panel_height(PHOTO_WIDTH, height, width),
                    (-0.5, width - 0.5), (height - 0.5, -0.5), (0, 0, 0, 0))
    look = shown_photo.scene_look(of_photo, made.measured)
    if look is None:
        photo, _ = _stretched(made, display_bands(of_photo.sensitivity))
    else:
        photo = encode_srgb(look.linear(np.nan_to_num(made.measured), np.arange(width),
                                        np.arange(height)))
    plot.picture((-0.5, -0.5, width - 0.5, height - 0.5), pictures.pixels_data_uri(photo))
    for s, material in enumerate(made.agreement.materials):
        rows, columns = np.nonzero(np.diff(np.pad(made.surface == s, ((0, 0), (1, 1))).astype(int)))
        starts, ends = columns[::2], columns[1::2]      # of each run of pixels in a row
        if len(starts):
            runs = zip(plot.x(starts - 0.5).tolist(), plot.x(ends - 0.5).tolist(),
                       plot.y(rows[::2] - 0.5).tolist(), plot.y(rows[::2] + 0.5).tolist(),
                       strict=True)
            plot.linked(
                "".join(f"M{x0:.1f} {y0:.1f}H{x1:.1f}V{y1:.1f}H{x0:.1f}z"
                        for x0, x1, y0, y1 in runs), svg.plain_line(material), *links[material])
    return plot.drawn("Photo", "The photo; each surface leads to the card of its material.")


def residual_maps(fit: scenes.Reconstruction) -> np.ndarray:
    """(photo - rendering) / photo (H, W, K), NaN where a pixel was not used."""
    usable = fit.used[..., None] & (fit.measured > 0)
    return np.where(usable, 1 - fit.rendered / np.where(usable, fit.measured, 1.0), np.nan)


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


def _signed_percent(value: float) -> str:
    return f"{100 * value:+g} %".replace("-", "−") if value else "0"


@svg.figure("the residuals")
def residual_figure(name: str, fit: scenes.Reconstruction, bands: tuple[str, ...]) -> Markup:
    """One signed residual map per band, all on one scale; pixels that were not used are hatched.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    bands : tuple of str
        K names.
    """
    residuals = residual_maps(fit)
    limit = residual_limit(residuals)
    columns = min(len(bands), 3 if len(bands) != 4 else 4)
    panels, height = _panels(len(bands), columns, fit.used.shape)
    plot = _sheet(name, height + 46)
    for k, (left, top, right, bottom) in enumerate(panels):
        used = np.isfinite(residuals[..., k])
        if not used.all():
            plot.hatched((left, top, right, bottom), UNUSED, HATCH)
        shown = pictures.coloured(0.5 + 0.5 * np.where(used, residuals[..., k], 0) / limit,
                                  pictures.SIGNED)
        plot.picture((left, top, right, bottom), pictures.pixels_data_uri(np.dstack([shown, used])))
        plot.words((left + right) / 2, top - 4, f"Band {svg.plain_line(bands[k], 24)}", 8.5)
    start, end = (WIDE - BAR_WIDTH) / 2, (WIDE + BAR_WIDTH) / 2
    shades = pictures.coloured(np.linspace(0, 1, BAR_SHADES)[None], pictures.SIGNED)
    plot.picture((start, height + 6, end, height + 6 + BAR_HEIGHT),
                 pictures.pixels_data_uri(shades), smooth=True)
    for share in (-1.0, -0.5, 0.0, 0.5, 1.0):
        plot.words(start + (0.5 + 0.5 * share) * BAR_WIDTH, height + 26,
                   _signed_percent(share * limit))
    plot.words(WIDE / 2, height + 40, "(photo − rendering) / photo: blue, photo darker; red, photo "
               "brighter; hatched, not used", 8)
    return plot.drawn("Residual maps", "Signed relative difference of photo and rendering per "
                      "band.")


def surface_colours(count: int) -> list[str]:
    """One light colour per surface."""
    return [LIGHT_COLOURS[s % len(LIGHT_COLOURS)] for s in range(count)]


@svg.figure("the surfaces")
def surface_figure(name: str, fit: scenes.Reconstruction) -> Markup:
    """Surfaces in false colour, each with its number; pixels of none are grey."""
    count, (height, width) = len(fit.agreement.names), fit.surface.shape
    size = 0.55 * WIDE
    plot = svg.Plot(name, size, _panel_height(size, height, width), (-0.5, width - 0.5),
                (height - 0.5, -0.5), (0, 0, 0, 0))
    colours = np.array([pictures.rgb_of(colour) for colour in (UNUSED, *surface_colours(count))])
    plot.picture((-0.5, -0.5, width - 0.5, height - 0.5), pictures.pixels_data_uri(
        colours[np.clip(fit.surface, -1, count - 1) + 1]))
    for s in range(count):
        if (fit.surface == s).any():
            row, column = _middle(fit.surface == s)
            plot.words(column, row + 3.2 * width / size, str(s + 1), 9, rim="#fff")
    return plot.drawn("Surfaces", "Where each surface of the scene lies in the photo, numbered.")


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


def _panel_height(panel_width: float, height: int, width: int) -> float:
    return float(np.clip(panel_width * height / width, 58.0, 504.0))


def _panels(count: int, columns: int, shape: tuple[int, ...]
            ) -> tuple[list[tuple[float, float, float, float]], float]:
    """Left, upper, right and lower edges of pictures of a shape (H, W) beside and below each other,
    each below its title, and the height of all, in points.
    """
    width = (WIDE - GAP * (columns - 1)) / columns
    height = _panel_height(width, *shape)
    panels = []
    for row, column in (divmod(number, columns) for number in range(count)):
        left, top = column * (width + GAP), TITLE + row * (height + TITLE + GAP)
        panels.append((left, top, left + width, top + height))
    return panels, panels[-1][3] + 2


def _sheet(name: str, height: float) -> svg.Plot:
    """A figure across the page whose coordinates are points."""
    return svg.Plot(name, WIDE, height, (0, WIDE), (height, 0), (0, 0, 0, 0))


def geometry_section(placements: tuple[scenes.Placement, ...],
                     marked_views: Sequence[scenes.MarkedView], previews: Mapping[str, Path]
                     ) -> tuple[tuple[scenes.Placement, ...], list[tuple[str, Markup]]] | None:
    """What of a scene was estimated, and names of views with the edges as their cameras see them;
    None where nothing was estimated.

    Parameters
    ----------
    placements : tuple of Placement
    marked_views : sequence of MarkedView
    previews : mapping
        PNG of each photo by the name of its view.
    """
    if not placements:
        return None
    return placements, [(view.name, _marks_figure(number, view, previews[view.name]))
                        for number, view in enumerate(marked_views, start=1)]


@svg.figure("the marks on the photo")
def _marks_figure(number: int, view: scenes.MarkedView, preview: Path) -> Markup:
    """The photo with the scene's edges, rings where corners were marked, crosses where the camera
    sees them.
    """
    width, height = pictures.png_size(preview)
    plot = svg.Plot(f"geometry-{number}", GEOMETRY_WIDTH, GEOMETRY_WIDTH * height / width, (0, 1),
                (1, 0), (0, 0, 0, 0))
    plot.picture((0, 0, 1, 1), pictures.picture_data_uri(preview, MAX_SIDE_PX), smooth=True)
    plot.lines(view.edges, RED, 0.6)
    plot.dots(view.marked[:, 0], view.marked[:, 1], GREEN, 3.0, open_=True)
    plot.crosses(view.seen[:, 0], view.seen[:, 1], RED)
    worst = int(np.argmax(view.residuals_px)) if len(view.residuals_px) else None
    said = "no corner is marked in it" if worst is None else (
        f"{len(view.corners)} corners marked, {svg.plain_line(view.corners[worst])} is off by "
        f"{view.residuals_px[worst]:.2f} pixels")
    return plot.drawn(f"Edges over the photo {svg.plain_line(view.name)}".strip(), said)
