"""Simulated shoots of flat samples, as ``spectrabox.flat`` measures them.

Photos by ``fixtures/near_lamps.py``, which shares no model with the inversion: square lamps near
by, microfacets, a camera that looks down. What is photographed is drawn here, and drawn by nothing
that the product learns from or may change:

* the chart is a copy as people own them: one of five tables (charts.npz: two published averages,
  two measured copies, and the average moved to the colours that its maker publishes since 2014),
  each patch off by some per cent of its own and all by some in common;
* lamps are formulas: filaments, daylights, white and mixed LEDs, tubes;
* cameras are measured ones, the maker of each left out of the prior that the product is given;
* surfaces are published test colours, greys, and saturated paints, prints and petals by other
  formulas than those of the prior.

Blocks: ``faultless`` shoots with nothing stated; ``greys`` of .02 to .97; ``saturated`` colours, of
chroma above 60; ``gloss 3 %`` mirrored by satin samples; ``shadow 10 %`` on the samples; ``lamp
moved``, a second photo by the lamp in another place; ``one gel``, a second photo through a filter;
``second lamp``, a second photo under another. The first shoots of each are measured with the light
stated by a file, too: faultless ones by themselves, the others together. Every shoot counts as one
case, with the mean over its nine samples.
"""
from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import spectrabox as sb
from spectrabox.calibrate.prior.camera_prior import save_camera_prior
from spectrabox.calibrate.prior.learnt_prior import build_prior
from spectrabox.fixtures import near_lamps
from spectrabox.fixtures.paints import NM
from spectrabox.radiometry import appearance
from spectrabox.radiometry.chart import REFERENCES
from spectrabox.radiometry.grid import grid_from_nm, visible_grid
from spectrabox.radiometry.published import published_tables
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import on_grid

from benchmarks import other_surfaces
from benchmarks.ledger.task import Task

SEED, DRAWS = 51, 1000
CHARTS = Path(__file__).with_name("charts.npz")
# share of charts in use; the later generation and what was measured of it before the others
OWNED = {"after November 2014": 0.35, "copy of August 2016": 0.25, "used copy": 0.15,
         "BabelColor Average": 0.15, "ColorChecker N Ohta": 0.10}
CHART_LEVEL, PATCH_LEVEL, PATCH_TILT = 0.01, 0.012, 0.01    # by which a copy is off, relative
GREY_LEVELS = (0.02, 0.035, 0.06, 0.12, 0.2, 0.4, 0.65, 0.85, 0.97)
DARK, BRIGHT = 0.2, 0.6         # up to, and from, which a grey is dark or bright
CHROMA = 60.0
SHADOW, GLOSS = 0.10, 0.03
# transmittance of a magenta gel at 400 ... 700 nm
GEL = (0.14, 0.47, 0.04, 0.0, 0.0, 0.02, 0.87)
FIGURES = ("held", "RMSE", "width", "dE00", "L* bias")
# block: shoots, and of how many the light is stated by a file as well
BLOCKS = {"faultless": (20, 8), "greys": (8, 2), "saturated": (9, 2), "gloss 3 %": (9, 2),
          "shadow 10 %": (8, 2), "lamp moved": (6, 2), "one gel": (6, 2), "second lamp": (6, 2)}
ADVISED = 5                     # faultless shoots of which advice is asked, with either light


def tasks(data: Path | None) -> Iterator[Task]:
    """One task for each shoot and what is stated of its light."""
    for block, (shoots, stated) in BLOCKS.items():
        for number in range(shoots):
            yield Task(f"simulated/{block}", f"{number:02d}", shot, (block, number, False))
        for number in range(stated):
            together = "faultless" if block == "faultless" else "others"
            yield Task(f"simulated/{together}, light stated",
                       f"{number:02d}" if block == "faultless" else f"{block} {number:02d}", shot,
                       (block, number, True))


def shot(block: str, number: int, stated: bool) -> dict[str, float]:
    """Figures of one shoot."""
    rng = np.random.default_rng([SEED, list(BLOCKS).index(block), number])
    with tempfile.TemporaryDirectory() as written:
        folder = Path(written)
        maker, shoot = drawn_shoot(block, rng)
        further = photographed(folder, block, shoot, rng)
        prior = prior_without(maker, folder / "prior.npz")
        result = sb.flat(folder / "first.dng", regions(), camera_prior=prior, draws=DRAWS,
                         progress=False, light=folder / "lamp.csv" if stated else "unknown",
                         **further)
        figures = figures_of(result, shoot.surfaces)
        if block == "greys" and not stated:
            figures = greys_of(result, figures)
        elif block == "faultless":
            figures["PASS"] = float(result.verdict == "pass")
            if number < ADVISED:
                figures["advice"] = float(bool(advice_of(result)))
        else:
            figures["false PASS"] = float(result.verdict == "pass" and figures["held"] < 0.9)
    return figures


def advice_of(result: sb.FlatSpectra) -> tuple[Any, ...]:
    """What is advised; nothing where that fails, which is a row of its own."""
    try:
        return tuple(result.advice)
    except Exception:   # noqa: BLE001 - whatever it is, it is no advice
        return ()


def drawn_shoot(block: str, rng: np.random.Generator) -> tuple[str, near_lamps.Shoot]:
    """A camera's maker, and what stands before the camera."""
    cameras = published_tables.all_published(published_tables.CAMERAS)
    name = sorted(cameras)[int(rng.integers(len(cameras)))]
    nm, curves = cameras[name]
    shoot = near_lamps.Shoot(
        np.array([np.interp(NM, nm, curve) for curve in curves]), owned_chart(rng),
        surfaces_of(block, rng), "satin" if block.startswith("gloss") else "matt",
        near_lamps.Place(), near_lamps.Place(), rng.uniform(0, 0.12), rng.uniform(0, 0.012),
        rng.uniform(0.85, 1.0))
    return name.split()[0], shoot


def photographed(folder: Path, block: str, shoot: near_lamps.Shoot,
                 rng: np.random.Generator) -> dict[str, Any]:
    """Write first.dng, lamp.csv and what a block photographs besides.

    Returns
    -------
    dict
        What ``spectrabox.flat`` is told of the further photo.
    """
    place, spectrum, other = near_lamps.drawn_lamp(rng), drawn_light(rng), drawn_light(rng)
    elsewhere, beside = near_lamps.moved(place, rng), near_lamps.drawn_lamp(rng)
    noises = rng.spawn(2)
    if block.startswith("gloss"):
        place = near_lamps.with_gloss(shoot, place, GLOSS)
    shade = SHADOW if block.startswith("shadow") else 0.0
    near_lamps.photograph(folder / "first.dng", shoot, [(place, spectrum)], noises[0], shade=shade)
    np.savetxt(folder / "lamp.csv", np.column_stack([NM, spectrum]), delimiter=",",
               header="wavelength_nm,value", comments="")
    second = folder / "second.dng"
    if block == "lamp moved":
        near_lamps.photograph(second, shoot, [(elsewhere, spectrum)], noises[1])
        return {"also": {second: "moved"}}
    if block == "one gel":
        gel = np.interp(NM, np.linspace(400, 700, len(GEL)), GEL)
        near_lamps.photograph(second, shoot, [(place, spectrum)], noises[1], through=gel)
        return {"filtered": {second: (NM, gel)}}
    if block == "second lamp":
        near_lamps.photograph(second, shoot, [(beside, other)], noises[1])
        return {"also": {second: "unknown"}}
    return {}


def regions() -> dict[str, tuple[float, ...]]:
    """Rectangles of the samples by name."""
    return {f"s{number}": corners for number, corners in enumerate(near_lamps.rectangles())}


def figures_of(result: Mapping[str, sb.SpectrumEstimate], truth: np.ndarray) -> dict[str, float]:
    """FIGURES, means over surfaces (n, P) at NM."""
    rows = [figures_of_one(estimate, spectrum)
            for estimate, spectrum in zip(result.values(), truth, strict=True)]
    return dict(zip(FIGURES, np.mean(rows, axis=0).tolist(), strict=True))


def figures_of_one(estimate: sb.SpectrumEstimate, spectrum: np.ndarray) -> tuple[float, ...]:
    """FIGURES of one surface of true reflectance (P,) at NM."""
    nm, mean = estimate.nm, estimate.mean
    lower, upper = estimate.band(0.95)
    true = np.interp(nm, NM, spectrum)
    weights = appearance.tristimulus_weights(nm, "D65")
    labs = [appearance.lab_from_xyz(np.maximum(one, 0) @ weights.T, weights.sum(axis=1))
            for one in (mean, true)]
    return (float(np.mean((lower <= true) & (true <= upper))),
            float(np.sqrt(np.mean((mean - true)**2))), float(np.mean(upper - lower)),
            float(appearance.ciede2000(*labs)), float(labs[0][0] - labs[1][0]))


def greys_of(result: Mapping[str, sb.SpectrumEstimate],
             figures: dict[str, float]) -> dict[str, float]:
    """Of greys the bias of their mean reflectance by how dark they are, in place of RMSE."""
    levels = np.array(GREY_LEVELS)
    off = np.array([estimate.mean.mean() for estimate in result.values()]) - levels
    parts = {"dark": levels <= DARK, "mid": (levels > DARK) & (levels < BRIGHT),
             "bright": levels >= BRIGHT}
    return {"held": figures["held"], "L* bias": figures["L* bias"]} | {
        f"bias, {name}": float(off[chosen].mean()) for name, chosen in parts.items()}


def surfaces_of(block: str, rng: np.random.Generator) -> np.ndarray:
    """Reflectances (9, P) at NM of a block's samples."""
    count = near_lamps.REGIONS
    if block == "greys":
        return np.repeat(np.array(GREY_LEVELS)[:, None], NM.size, axis=1)
    if block == "saturated":
        return saturated(count, rng)
    sets = test_reflectances(grid_from_nm(NM[20:-30]))
    colours = np.vstack([rows for name, rows in sets.items() if name not in REFERENCES])
    return np.pad(colours[rng.choice(len(colours), count, replace=False)], ((0, 0), (20, 30)),
                  mode="edge")


def saturated(count: int, rng: np.random.Generator) -> np.ndarray:
    """Reflectances (count, P) at NM of paints, prints and petals of a chroma above ``CHROMA``."""
    drawn = np.clip(np.vstack([make(rng, 60) for make in (
        other_surfaces.paint, other_surfaces.prints, other_surfaces.petals)]), 0.01, 0.95)
    weights = appearance.tristimulus_weights(other_surfaces.NM, "D65")
    chroma = [np.hypot(*appearance.lab_from_xyz(one @ weights.T, weights.sum(axis=1))[1:])
              for one in drawn]
    vivid = drawn[np.array(chroma) > CHROMA]
    return np.array([np.interp(NM, other_surfaces.NM, one)
                     for one in vivid[rng.permutation(len(vivid))[:count]]])


def owned_chart(rng: np.random.Generator) -> np.ndarray:
    """Reflectances (24, P) at NM of one copy as somebody owns it."""
    with np.load(CHARTS) as tables:
        table, nm = tables[str(rng.choice(list(OWNED), p=list(OWNED.values())))], tables["nm"]
    copy = np.array([np.interp(NM, nm, patch) for patch in table])
    off = CHART_LEVEL * rng.standard_normal() + PATCH_LEVEL * rng.standard_normal((24, 1)) \
        + PATCH_TILT * rng.standard_normal((24, 1)) * (NM - 550) / 150
    return np.asarray(copy * np.exp(off))


def drawn_light(rng: np.random.Generator) -> np.ndarray:
    """Spectrum (P,) at NM of a lamp, of mean 1."""
    kind = rng.choice(["filament", "daylight", "white LED", "mixed LED", "tube"],
                      p=[0.2, 0.2, 0.35, 0.1, 0.15])
    if kind in ("filament", "daylight"):
        kelvin = rng.uniform(2600, 3300) if kind == "filament" else rng.uniform(4800, 7500)
        light = NM**-5 / np.expm1(1.4388e7 / (NM * kelvin))
        light = light * np.exp(rng.normal(0, 0.05) * ((NM - 550) / 150)**2)
        if kind == "daylight":          # absorption in the air
            light = light * (1 - rng.uniform(0.2, 0.4) * (_peak(431, 3) + _peak(589, 2)) / 3
                             - 0.15 * _peak(688, 4))
    elif kind == "white LED":
        light = _peak(rng.uniform(443, 458), rng.uniform(8, 11)) \
            + rng.uniform(0.35, 0.9) * _peak(rng.uniform(530, 555), rng.uniform(30, 45)) \
            + rng.uniform(0.2, 1.3) * _peak(rng.uniform(595, 635), rng.uniform(35, 50))
    elif kind == "mixed LED":
        light = sum(rng.uniform(0.5, 1.2) * _peak(rng.normal(middle, 5), rng.uniform(9, 14))
                    for middle in (452, 525, 630)) + rng.uniform(0.2, 0.6) * _peak(590, 40)
    else:
        light = sum(rng.uniform(0.7, 1.3) * height * _peak(middle, width) for middle, width, height
                    in ((436, 1.5, 0.8), (453, 22, 0.25), (488, 6, 0.25), (545, 3, 1.3),
                        (587, 5, 0.4), (611, 3, 1.3), (630, 6, 0.2), (578, 2, 0.2)))
    light = light / light.mean() + 0.004
    return np.asarray(light / light.mean())


def prior_without(maker: str, path: Path) -> Path:
    """Write the prior on cameras learnt from those of all other makers."""
    cameras = published_tables.all_published(published_tables.CAMERAS)
    names = tuple(sorted(name for name in cameras if name.split()[0] != maker))
    grid = visible_grid(5)
    curves = np.array([on_grid(*cameras[name], grid, name) for name in names])
    save_camera_prior(path, build_prior(grid.nm, curves, names, source="all makers but one",
                                        licence="Apache-2.0"))
    return path


def _peak(middle_nm: float, deviation_nm: float) -> np.ndarray:
    """Gaussian (P,) of height 1."""
    return np.exp(-0.5 * ((NM - middle_nm) / deviation_nm)**2)
