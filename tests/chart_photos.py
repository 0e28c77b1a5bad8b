"""Synthetic photos of charts that people own, for tests: their measures written once more."""
from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from spectrabox.fixtures.chart_scene import card_scene
from spectrabox.fixtures.paints import NM, random_paints
from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.charts.layouts import chart_layout
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind

HEIGHT, WIDTH = 600, 840
UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
GRID = visible_grid()
NOISE = 0.002               # of full scale, each pixel


@dataclass(frozen=True)
class Printed:
    """Edges of the patches of a printed chart, and their sides."""

    left: np.ndarray
    top: np.ndarray
    side: tuple[float, float]

    @property
    def extent(self) -> np.ndarray:
        return np.array([self.left[-1] + self.side[0], self.top[-1] + self.side[1]])

    def corners(self, degrees: float = 0.0, height: float = 480.0) -> np.ndarray:
        """Outer corners (4, 2) of the patches in pixels, turned about the middle of the photo."""
        centred = (UNIT - 0.5) * self.extent * height / self.extent[1]
        angle = np.deg2rad(degrees)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        return centred @ turn + np.array([WIDTH, HEIGHT]) / 2


PRINTED = {
    "ColorChecker Digital SG": Printed(15.175 * np.arange(14), 15.25 * np.arange(10),
                                       (12.675, 12.75)),
    "SpyderCheckr 24": Printed(102.0 * np.arange(4), 102.0 * np.arange(6), (88.5, 88.5)),
    "SpyderCheckr 48": Printed(np.r_[49.0 * np.arange(4), 263.0 + 49.0 * np.arange(4)],
                               50.0 * np.arange(6), (42.0, 42.0)),
    "three rows of five": Printed(25.0 * np.arange(5), 30.0 * np.arange(3), (20.0, 24.0)),
}
LAYOUT_TEXT = """\
name = "three rows of five"
rows = 3
columns = 5
patch = [20.0, 24.0]
pitch = [25.0, 30.0]
neutrals = ["A1", "B1", "C1", "D1"]
reference = "spectra.csv"
"""


def layout_named(name: str, folder) -> Chart:
    """The layout of a chart of ``PRINTED``; that of three rows of five from a file in ``folder``.
    """
    if name != "three rows of five":
        return chart_layout(name)
    (folder / "chart.toml").write_text(LAYOUT_TEXT, encoding="utf-8")
    return chart_layout(str(folder / "chart.toml"))


def true_reflectances(chart: Chart, seed: int = 0) -> np.ndarray:
    """Reflectances (I, P) of one such chart: imagined paints, its neutrals grey."""
    paints = random_paints(len(chart.names), np.random.default_rng(seed))
    greys = np.geomspace(0.9, 0.03, len(chart.neutrals))
    paints[list(chart.neutrals)] = greys[:, None] * (1 + 0.01 * np.sin(NM / 90))
    return paints[:, (GRID.nm[0] <= NM) & (GRID.nm[-1] >= NM)]


def photograph(printed: Printed, signals: np.ndarray, corners_px: np.ndarray, seed: int = 0,
               background: float | np.ndarray = 0.3) -> LinearImage:
    """A linear photo of a chart with these signals (I, K), light falling off by a quarter stop."""
    scene = card_scene(HEIGHT, WIDTH, signals, corners_px, printed.left, printed.top, printed.side,
                       border=0.1 * printed.extent[1], background=background, gradient_stops=0.25)
    return noisy(scene, seed)


def noisy(scene: np.ndarray, seed: int = 0) -> LinearImage:
    """A linear photo of a scene (H, W, K)."""
    noise = NOISE * np.random.default_rng(seed).standard_normal(scene.shape).astype(np.float32)
    return LinearImage(scene + noise, np.full_like(scene, NOISE**2), np.zeros(scene.shape, bool),
                       1.0, 0.01, 100.0, 8.0, PhotoKind.RAW, "synthetic", "chart.exr", "0" * 64)


def turned(image: LinearImage) -> LinearImage:
    """The photo as a mirror shows it."""
    return dataclasses.replace(image, signal=image.signal[:, ::-1],
                               variance=image.variance[:, ::-1],
                               saturated=image.saturated[:, ::-1])
