"""Flat samples photographed with real-life faults: what the bands hold, and what the verdict says.

Cameras and lamps of a folder, the camera's maker left out of the prior, nine published test colours
in two rows beside the chart: each photo once as it should be, and once with each fault. Gloss adds
a share of white to every sample; a shadow takes a tenth of their light; a brightener makes papers
of them that emit in the blue; chart or samples are turned by 10 degrees out of the plane, to any
side; a lamp of another kind shines from the other side. "Passed wrongly" counts sessions with the
verdict PASS whose bands hold less than 90 %.
"""
from __future__ import annotations

import argparse
import json
import sys
import tempfile
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

import spectrabox
from spectrabox.calibrate.prior.camera_prior import save_camera_prior
from spectrabox.calibrate.prior.learnt_prior import CameraDatabase, read_camera_database
from spectrabox.fixtures.flat_sample import (
    box,
    chart_corners,
    lamplight,
    surface_signals,
    vignetting,
    write_photo,
)
from spectrabox.fixtures.paints import NM, chart_copy
from spectrabox.radiometry.chart import REFERENCES
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.spectra.named_spectra import test_reflectances

from benchmarks.bench_unknown_makers import makers_of, prior_without

FAULTS = ("none", "gloss 1.5 %", "gloss 3 %", "shadow 10 %", "brightener", "chart tilted 10 deg",
          "samples tilted 10 deg", "two kinds of lamps")
SIZE, REGIONS = (400, 600), 9
CHART, TABLE = (0.28, 0.19, 0.44), (0.25, 0.165, 0.75, 0.505)   # its grid; what lies in its plane
SQUARE, ABOVE, BELOW = 0.10, (0.22, 0.37, 0.52, 0.67), (0.20, 0.33, 0.46, 0.59, 0.72)
TILT = np.radians(10.0)
INSET = 0.02                # of a sample's outline, in widths of the picture


def places() -> list[np.ndarray]:
    """Outlines (4, 2) of the samples, in widths of the picture."""
    corners = [(x, 0.04) for x in ABOVE] + [(x, 0.53) for x in BELOW]
    return [box(x, y, x + SQUARE, y + SQUARE) for x, y in corners]


def papers(rng: np.random.Generator) -> np.ndarray:
    """Total radiance factors (REGIONS, P) of papers with a brightener, which absorbs below 410 nm
    and emits about 440 nm.
    """
    base = rng.uniform(0.75, 0.88, (REGIONS, 1)) + rng.uniform(-0.03, 0.03, (REGIONS, 1)) * (
        NM - 550) / 150
    absorbed = 1 - rng.uniform(0.3, 0.8, (REGIONS, 1)) / (1 + np.exp((NM - 405) / 6))
    emitted = np.where(NM < 440, np.exp(-0.5 * ((NM - 440) / 12) ** 2),
                       np.exp(-0.5 * ((NM - 440) / 28) ** 2))
    return base * absorbed + rng.uniform(0.08, 0.3, (REGIONS, 1)) * emitted


def photograph(path: Path, fault: str, curves: np.ndarray, lamp: np.ndarray, other: np.ndarray,
               surfaces: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Write the photo of one case with one fault.

    Returns
    -------
    (REGIONS, P) array
        The true spectra.
    """
    draws = np.random.default_rng(rng.integers(2**31))     # of what a fault alone needs
    lamps = [(*rng.uniform(-0.6, 1.6, 2), rng.uniform(1.6, 3.0), 1.0),
             (*rng.uniform(-0.6, 1.6, 2), rng.uniform(1.6, 3.0), rng.uniform(0, 0.6))]
    ambient, corner, chart = rng.uniform(0, 0.15), rng.uniform(0.85, 1), chart_copy(rng)
    truth = papers(draws) if fault == "brightener" else surfaces
    seen = truth + (float(fault.split()[1]) / 100 if fault.startswith("gloss") else 0.0)
    round_about = draws.uniform(0, 2 * np.pi)
    turned = (np.sin(TILT) * np.cos(round_about), np.sin(TILT) * np.sin(round_about), np.cos(TILT))
    lens = vignetting(SIZE, corner)

    def light(what: str) -> np.ndarray:
        tilted = fault == f"{what} tilted 10 deg"
        even = lamplight(SIZE, lamps, ambient, turned if tilted else (0.0, 0.0, 1.0)) * lens
        return even * (0.9 if (fault, what) == ("shadow 10 %", "samples") else 1.0)

    areas = list(zip(places(), seen, strict=True))
    arguments = chart, chart_corners(*CHART), areas, np.full(NM.size, 0.2)
    y, x = np.mgrid[:SIZE[0], :SIZE[1]] / SIZE[1]
    on_chart = (x > TABLE[0]) & (y > TABLE[1]) & (x < TABLE[2]) & (y < TABLE[3])
    irradiance = np.where(on_chart, light("chart"), light("samples"))
    picture = surface_signals(SIZE, curves * lamp, *arguments) * irradiance[..., None]
    if fault == "two kinds of lamps":
        mixed = draws.uniform(0.4, 0.9) * (0.5 + draws.choice([-1, 1]) * (x - 0.5))
        picture = picture * (1 - mixed)[..., None] + surface_signals(
            SIZE, curves * other, *arguments) * (irradiance * mixed)[..., None]
    write_photo(path, picture, Fraction(1, 60), rng)
    return truth


def one_case(path: Path, truth: np.ndarray, prior: Path, **stated: Any) -> dict[str, Any]:
    """Figures of one photo, by the function that users call."""
    regions = {f"s{number}": tuple(float(round(value * SIZE[1])) for value in np.r_[
        place[0] + INSET, place[2] - INSET]) for number, place in enumerate(places())}
    result = spectrabox.flat(path, regions, camera_prior=prior, draws=1000, progress=False,
                             **stated)
    error, inside, width = [], [], []
    for estimate, spectrum in zip(result.values(), truth, strict=True):
        lower, upper = estimate.band(0.95)
        at_nm = np.interp(estimate.nm, NM, spectrum)
        error.append(np.sqrt(np.mean((estimate.mean - at_nm) ** 2)))
        inside.append(np.mean((lower <= at_nm) & (at_nm <= upper)))
        width.append(np.mean(upper - lower))
    return {"rmse": float(np.mean(error)), "inside": float(np.mean(inside)),
            "width": float(np.mean(width)), "verdict": result.verdict}


def measure(data: Path, cases: int, seed: int, faults: tuple[str, ...],
            **stated: Any) -> dict[str, list[dict[str, Any]]]:
    """Figures of every case by fault; a photo that is refused has its sentence alone.

    Parameters
    ----------
    data : Path
        With cameras/ and lights/.
    cases, seed : int
    faults : tuple of str
        Of FAULTS.
    stated
        What ``spectrabox.flat`` is told of the surfaces.
    """
    database, rng = read_camera_database(data / "cameras"), np.random.default_rng(seed)
    makers = np.asarray(makers_of(database))
    with np.load(data / "lights" / "lights_for_checks.npz") as stored:
        lamps = np.array([np.interp(NM, stored["wavelengths_nm"], row)
                          for row in stored["spectra"]])
    sets = test_reflectances(grid_from_nm(NM[20:-30]))
    colours = np.vstack([rows for name, rows in sets.items() if name not in REFERENCES])
    padded = np.pad(colours, ((0, 0), (20, 30)), mode="edge")
    rows: dict[str, list[dict[str, Any]]] = {fault: [] for fault in faults}
    with tempfile.TemporaryDirectory() as written:
        for case in range(cases):
            camera, (lamp, other) = int(rng.integers(len(makers))), rng.choice(len(lamps), 2, False)
            surfaces = padded[rng.choice(len(padded), REGIONS, replace=False)]
            curves = np.array([np.interp(NM, database.nm, row) for row in database.curves[camera]])
            prior = _prior_without(database, makers, makers[camera], Path(written))
            for fault in faults:
                path = Path(written) / "photo.dng"
                truth = photograph(path, fault, curves, lamps[lamp], lamps[other], surfaces,
                                   np.random.default_rng([seed, case]))
                try:
                    rows[fault].append(one_case(path, truth, prior, **stated))
                except SpectraboxError as error:
                    rows[fault].append({"refused": str(error)})
            print(f"{case + 1}/{cases} {database.names[camera]}", file=sys.stderr, flush=True)
    return rows


def _prior_without(database: CameraDatabase, makers: np.ndarray, maker: str, folder: Path) -> Path:
    path = folder / f"{maker}.npz".replace(" ", "_")
    if not path.exists():
        save_camera_prior(path, prior_without(database, makers == maker))
    return path


def table(rows: dict[str, list[dict[str, Any]]]) -> str:
    """A line for every fault; the error is that of the mean over cases."""
    lines = [f"{'fault':24s} inside        rmse    width   pass  passed wrongly  warn  refused"]
    for fault, each in rows.items():
        done = [row for row in each if "refused" not in row]
        inside = np.array([row["inside"] for row in done])
        passed = np.array([row["verdict"] == "pass" for row in done], bool)
        error = inside.std(ddof=1) / np.sqrt(len(done)) if len(done) > 1 else np.nan
        rmse, width = (np.mean([row[name] for row in done]) for name in ("rmse", "width"))
        lines.append(
            f"{fault:24s} {inside.mean():.3f} +-{error:.3f} {rmse:.4f}  {width:.4f}  "
            f"{passed.sum():4d}  {np.sum(passed & (inside < 0.9)):14d}  {np.sum(~passed):4d}  "
            f"{len(each) - len(done):7d}")
    return "\n".join(lines)


def main() -> None:
    """Print a table of the faults."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/ and lights/")
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--faults", nargs="*", default=list(FAULTS), choices=FAULTS)
    parser.add_argument("--surface", help="what is stated of the samples: matt, satin or glossy")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    rows = measure(asked.data, asked.cases, asked.seed, tuple(asked.faults), surface=asked.surface)
    print(json.dumps(rows) if asked.json else table(rows))


if __name__ == "__main__":
    main()
