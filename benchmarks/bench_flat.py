"""Flat samples beside a chart, by cameras and lamps never trained on: from DNG to bands.

Every case is a photo of the simulator in ``fixtures/flat_sample.py``: a camera of the folder, its
maker left out of the prior, a lamp of the folder, the chart off the published average by 1 %, light
that falls off over the picture, 1 % of noise in a pixel, and nine published test colours. The
session runs as ``spectrabox flat`` runs it, once with nothing known and once with curves and light
stated as they are. "perfect" is what is left where products, white and the light upon every sample
are known too.
"""
from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.prior.camera_prior import save_camera_prior
from spectrabox.calibrate.prior.learnt_prior import read_camera_database
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
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.interreflection import response_matrix, white_signal
from spectrabox.radiometry.records.spectra import Quantity, SpectralMeasurement, SpectrumSummary
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.sampling.prior.signal_posterior import sample_prior
from spectrabox.sampling.summary import summarise
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import FinishedRun
from spectrabox.session.pipeline import run_stages

from benchmarks.bench_unknown_makers import makers_of, prior_without

SIZE, REGIONS = (400, 600), 9
CHART = (0.05, 0.06, 0.40)
SQUARE, ACROSS, DOWN = 0.11, (0.52, 0.67, 0.82), (0.06, 0.23, 0.40)
KINDS = ("unknown", "known")
PERFECT = 0.002                         # relative error of a signal
HEAD = '[photos]\nobject = "photos/p.dng"\n[sampling]\ndraws = 1000\n'


def places() -> list[np.ndarray]:
    """Outlines (4, 2) of the test colours, in widths of the picture."""
    return [box(x, y, x + SQUARE, y + SQUARE) for y in DOWN for x in ACROSS]


def photograph(path: Path, curves: np.ndarray, lamp: np.ndarray, surfaces: np.ndarray,
               rng: np.random.Generator, size: tuple[int, int] = SIZE) -> float:
    """Write the photo of one case.

    Parameters
    ----------
    curves, lamp : (3, P) and (P,) arrays
        At the wavelengths of the fixtures.
    surfaces : (n, P) array

    Returns
    -------
    float
        Largest over least light of the picture.
    """
    lamps = [(*rng.uniform(-0.6, 1.6, 2), rng.uniform(1.6, 3.0), 1.0),
             (*rng.uniform(-0.6, 1.6, 2), rng.uniform(1.6, 3.0), rng.uniform(0, 0.6))]
    light = lamplight(size, lamps, rng.uniform(0, 0.15)) * vignetting(size, rng.uniform(0.85, 1))
    even = surface_signals(size, curves * lamp, chart_copy(rng), chart_corners(*CHART),
                           list(zip(places(), surfaces, strict=True)), np.full(NM.size, 0.2))
    write_photo(path, even * light[..., None], Fraction(1, 60), rng)
    return float(light.max() / light.min())


def regions_toml(width: int) -> str:
    """[regions.NAME] of all test colours."""
    inner = [np.array([*place[0], *place[2]]) + 0.02 * np.array([1, 1, -1, -1])
             for place in places()]
    return "".join(f"[regions.s{number}]\nrect = {[round(float(v * width)) for v in rect]}\n"
                   for number, rect in enumerate(inner))


def judged(finished: FinishedRun, surfaces: np.ndarray) -> dict[str, float]:
    """RMSE, coverage and width of the bands of one session that was run."""
    return _figures((finished.records.spectra[name], surfaces[int(name[1:])])
                    for name in finished.records.signals.names)


def judged_perfect(responses: np.ndarray, surfaces: np.ndarray) -> dict[str, float]:
    """The same of signals without any error but ``PERFECT``, by true products (K, P) at NM."""
    grid = grid_from_nm(np.arange(400.0, 701.0))
    seen = response_matrix(grid, np.array([np.interp(grid.nm, NM, row) for row in responses]),
                           np.ones(grid.nm.size))
    seen = seen / white_signal(seen)[:, None]
    found = []
    for number, surface in enumerate(surfaces):
        signal = seen @ np.interp(grid.nm, NM, surface)
        measurement = SpectralMeasurement(grid, seen, signal, np.diag((PERFECT * signal) ** 2))
        found.append((summarise(sample_prior(measurement, 1000, number), measurement), surface))
    return _figures(found)


def _figures(found: Iterable[tuple[SpectrumSummary, np.ndarray]]) -> dict[str, float]:
    off, inside, width = [], [], []
    for summary, surface in found:
        truth = np.interp(summary.grid.nm, NM, surface)
        off.append(float(np.sqrt(np.mean((summary.mean - truth) ** 2))))
        inside.append(float(np.mean((summary.lower <= truth) & (truth <= summary.upper))))
        width.append(float(np.mean(summary.upper - summary.lower)))
    return {"rmse": float(np.mean(off)), "inside": float(np.mean(inside)),
            "width": float(np.mean(width))}


@dataclass(frozen=True)
class FlatCase:
    """One photo, and the sessions on it by what is known."""

    camera: str
    products: np.ndarray                # (K, P) sensitivity x light at NM
    surfaces: np.ndarray                # (n, P) at NM
    uneven: float                       # largest over least light of the picture
    runs: dict[str, FinishedRun]        # of KINDS, those that were not refused
    refused: tuple[str, ...]


def flat_cases(data: Path, cases: int, seed: int) -> Iterator[FlatCase]:
    """Photos by cameras and lamps of a folder, each run as sessions of every kind.

    Parameters
    ----------
    data : Path
        With cameras/ and lights/.
    cases, seed : int
    """
    rng = np.random.default_rng(seed)
    database = read_camera_database(data / "cameras")
    makers = makers_of(database)
    with np.load(data / "lights" / "lights_for_checks.npz") as stored:
        lamp_nm, lamps = stored["wavelengths_nm"], stored["spectra"]
    sets = test_reflectances(grid_from_nm(NM[20:-30]))
    colours = np.vstack([rows for name, rows in sets.items() if name not in REFERENCES])
    padded = np.pad(colours, ((0, 0), (20, 30)), mode="edge")
    for case in range(cases):
        camera, lamp = int(rng.integers(len(database.names))), int(rng.integers(len(lamps)))
        surfaces = padded[rng.choice(len(padded), REGIONS, replace=False)]
        curves = np.array([np.interp(NM, database.nm, row) for row in database.curves[camera]])
        light = np.interp(NM, lamp_nm, lamps[lamp])
        runs, refused, fall_off = {}, [], 1.0
        with tempfile.TemporaryDirectory() as written:
            for kind in KINDS:
                folder = Path(written) / kind
                for part in ("photos", "spectra"):
                    (folder / part).mkdir(parents=True)
                fall_off = photograph(folder / "photos" / "p.dng", curves, light, surfaces,
                                      np.random.default_rng([seed, case]))
                (folder / "session.toml").write_text(
                    HEAD + _known(folder, kind, curves, light, database, makers, camera)
                    + regions_toml(SIZE[1]), encoding="utf-8")
                try:
                    runs[kind] = run_stages(read_session(folder), device="cpu", only=None,
                                            force=False, progress=lambda *_: None)
                except CheckError as error:
                    refused.append(f"{kind}: {error}")
            yield FlatCase(database.names[camera], curves * light, surfaces, fall_off, runs,
                           tuple(refused))


def figures_of_case(case: FlatCase) -> dict[str, dict[str, float]]:
    """RMSE, coverage and width by what is known; empty where a session was refused."""
    if set(case.runs) != set(KINDS):
        return {}
    return {kind: judged(run, case.surfaces) for kind, run in case.runs.items()} | {
        "perfect": judged_perfect(case.products, case.surfaces)}


def summary(rows: list[dict[str, dict[str, float]]]) -> dict[str, Any]:
    """Means and standard errors over cases, and the ratio of errors, unknown over known.

    Parameters
    ----------
    rows : list of dicts
        From ``figures_of_case``.
    """
    table = {kind: {figure: np.array([row[kind][figure] for row in rows])
                    for figure in rows[0][kind]} for kind in rows[0]}
    means = {kind: {figure: [float(values.mean()), _error_of_mean(values)]
                    for figure, values in of_kind.items()} for kind, of_kind in table.items()}
    unknown, known = (table[kind]["rmse"] for kind in KINDS)
    ratio = unknown.mean() / known.mean()
    # of a ratio of means over the same cases [Cochran 1977, Eq. 6.13]
    return {"cases": len(rows), **means,
            "ratio": [float(ratio), _error_of_mean(unknown - ratio * known) / float(known.mean())]}


def _error_of_mean(values: np.ndarray) -> float:
    return float(np.std(values, ddof=1) / np.sqrt(values.size)) if values.size > 1 else float("nan")


def measure(data: Path, cases: int, seed: int) -> dict[str, Any]:
    """Figures of some cases with nothing known and everything known."""
    found, refused, uneven = [], [], []
    for number, case in enumerate(flat_cases(data, cases, seed), start=1):
        results = figures_of_case(case)
        refused += case.refused
        if results:
            found.append(results)
            uneven.append(case.uneven)
        print(f"{number}/{cases} {case.camera}: {results}", file=sys.stderr, flush=True)
    return {"refused": refused, "uneven": float(np.mean(uneven)), **summary(found)}


def _known(folder: Path, kind: str, curves: np.ndarray, light: np.ndarray, database: Any,
           makers: np.ndarray, camera: int) -> str:
    if kind == "unknown":
        left_out = np.asarray(makers) == np.asarray(makers)[camera]
        save_camera_prior(folder / "spectra" / "prior.npz", prior_without(database, left_out))
        return ('[light]\nspectrum = "unknown"\n[sensitivity]\nprior = "spectra/prior.npz"\n')
    tables = {"light": {"value": light}, "camera": dict(zip("RGB", curves, strict=True))}
    for name, columns in tables.items():
        (folder / "spectra" / f"{name}.csv").write_text(
            table_text(NM, columns, quantity=Quantity.RELATIVE, source=name), encoding="utf-8")
    return ('[light]\nspectrum = "spectra/light.csv"\n'
            '[sensitivity]\nfrom = "spectra/camera.csv"\nrelative_error = 0.001\n')


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/ and lights/")
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    figures = measure(asked.data, asked.cases, asked.seed)
    print(json.dumps(figures) if asked.json else "\n".join(
        f"{name}: {value}" for name, value in figures.items()))


if __name__ == "__main__":
    main()
