"""Edges inside regions: how often hard ones are named, and even surfaces and textures wrongly.

The regions are simulated apart from how edges are looked for: a near lamp, pixels of one surface
with texture (grain, weave, blotches) and the noise of photons, and a line across that is as sharp
as a lens is. With --data the patches of real charts (folder ``raw_charts``) are regions too, each
alone and in pairs of neighbours.
"""
from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from spectrabox.capture.chart.detection import locate_chart
from spectrabox.capture.photo.linear import open_photo
from spectrabox.capture.photo.region_edges import region_edge
from spectrabox.capture.photo.regions import sample_regions
from spectrabox.measure.camera import chart_signals
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.photos import EdgeKind, RegionEdge

STEP_PX = 2.0       # of the sensor, a side of one pixel


def grain(rng: np.random.Generator, shape: tuple[int, ...], blur: float) -> np.ndarray:
    """A texture (h, w) of rms 1, of one pixel or blurred over several."""
    pad = int(4 * blur) + 1
    noise = rng.standard_normal((shape[0] + 2 * pad, shape[1] + 2 * pad))
    smooth = (gaussian_filter(noise, blur) if blur else noise)[pad:-pad, pad:-pad]
    return smooth / smooth.std()


def canvas(rng: np.random.Generator, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A weave of threads of two to nine pixels that wander a little, of rms 1."""
    turn, pitch = rng.uniform(0, 0.3), rng.uniform(2.2, 9.0)
    wander = 0.3 * grain(rng, x.shape, 2.0)
    along, across = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    threads = [np.sin(2 * np.pi * axis / pitch + rng.uniform(0, 6) + wander)
               for axis in (along, across)]
    return np.asarray(threads[0] + threads[1])


TEXTURES: dict[str, Callable[[np.random.Generator, np.ndarray, np.ndarray], np.ndarray]] = {
    "even": lambda rng, x, y: np.zeros(x.shape),
    "grain": lambda rng, x, y: rng.uniform(0.01, 0.04) * grain(rng, x.shape, 0),
    "coarse grain": lambda rng, x, y: rng.uniform(0.005, 0.02) * grain(rng, x.shape,
                                                                       rng.uniform(0.5, 2)),
    "canvas": lambda rng, x, y: rng.uniform(0.01, 0.05) * canvas(rng, x, y),
    "blotches": lambda rng, x, y: rng.uniform(0.003, 0.01) * grain(
        rng, x.shape, rng.uniform(0.05, 0.15) * max(x.shape))}


def region(rng: np.random.Generator, texture: str, step: Sequence[float] | None = None,
           bands: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Signal (h, w, K) of one region and its pixels' variance (K,); across a line in its middle
    three fifths the bands step by factors (K,).
    """
    long = int(np.exp(rng.uniform(np.log(36), np.log(160))))
    height, width = rng.permutation([long, int(long / rng.uniform(1, 2))])
    y, x = np.mgrid[:height, :width].astype(float)
    distance, (lamp_x, lamp_y) = rng.uniform(0.8, 4) * long, rng.uniform(-1, 2, 2) * long
    light = (1 + ((x - lamp_x) ** 2 + (y - lamp_y) ** 2) / distance**2) ** -1.5
    surface = np.exp(TEXTURES[texture](rng, x, y))
    signal = ((light / light.mean() * surface)[..., None]
              * np.exp(rng.uniform(np.log(0.05), np.log(0.9), bands)))
    if step is not None:
        share = 0.0
        while not 0.2 < share < 0.8:
            angle = rng.uniform(0, np.pi)
            along = x * np.cos(angle) + y * np.sin(angle)
            beyond = along - rng.uniform(along.min(), along.max())
            share = np.mean(beyond > 0)
        signal *= np.asarray(step) ** np.clip(beyond / rng.uniform(0.5, 2) + 0.5, 0, 1)[..., None]
    electrons = np.exp(rng.uniform(np.log(4e3), np.log(4e4)))
    variance = signal.mean(axis=(0, 1)) / electrons + 1e-7
    return rng.normal(signal, np.sqrt(signal / electrons + 1e-7)), variance


def edge_of(signal: np.ndarray, variance: np.ndarray) -> RegionEdge | None:
    """The edge of a region (h, w, K) whose pixels have a variance (K,)."""
    y, x = np.mgrid[:signal.shape[0], :signal.shape[1]]
    return region_edge(signal.reshape(-1, signal.shape[2]), variance, x.ravel(), y.ravel(),
                       STEP_PX)


def edges_of_charts(folder: Path) -> tuple[int, int, int, int]:
    """Edges named in patches of real charts, of how many, and across neighbours, of how many."""
    alone = patches = across = pairs = 0
    for path in sorted(folder.glob("*.dng")):
        photo = open_photo(path)
        found = locate_chart(photo, chart_signals(CLASSIC, None, visible_grid()), None, CLASSIC)
        inner = found.corners_px
        rows = [patch for patch in range(len(inner) - 1) if (patch + 1) % CLASSIC.columns]
        joined = [np.array([(inner[one][0] + inner[one][1]) / 2,
                            (inner[one + 1][0] + inner[one + 1][1]) / 2,
                            (inner[one + 1][2] + inner[one + 1][3]) / 2,
                            (inner[one][2] + inner[one][3]) / 2]) for one in rows]
        for outlines in (list(inner), joined):
            edges = sample_regions(photo, {str(index): outline.tolist() for index, outline
                                           in enumerate(outlines)}, without_clipped=True).edges
            if outlines is joined:
                across, pairs = across + len(edges), pairs + len(joined)
            else:
                alone, patches = alone + len(edges), patches + len(inner)
    return alone, patches, across, pairs


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--regions", type=int, default=500, help="of each kind and texture")
    parser.add_argument("--data", type=Path, help="folder with raw_charts")
    arguments = parser.parse_args(argv)
    print("| texture | even: named | shadow of 10 %: named, as a shadow | one band steps by 25 %, "
          "one by 10 %: named, as two paints |\n|---|---|---|---|")
    for texture in TEXTURES:
        rng = np.random.default_rng(7)
        cells = []
        for step, kind in ((None, None), ((0.9,) * 3, EdgeKind.SHADOW),
                           ((1.0, 0.9, 0.75), EdgeKind.PAINTS)):
            found = [edge_of(*region(rng, texture, None if step is None else rng.permutation(step)))
                     for _ in range(arguments.regions)]
            named = [edge.kind for edge in found if edge is not None]
            cells.append(f"{len(named) / len(found):.1%}" + (
                "" if kind is None else f", {named.count(kind) / max(len(named), 1):.0%}"))
        print(f"| {texture} | {' | '.join(cells)} |", flush=True)
    if arguments.data is not None:
        alone, patches, across, pairs = edges_of_charts(arguments.data / "raw_charts")
        print(f"real charts: {alone} of {patches} patches, {across} of {pairs} pairs of neighbours")


if __name__ == "__main__":
    main()
