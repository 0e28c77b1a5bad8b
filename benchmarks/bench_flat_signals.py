"""Do the stated errors of flat samples' signals hold, of bright and neutral ones too?

Errors of white and of the curves come from one fit of the chart and are taken as independent. Here
flat photos by cameras and lamps of a folder, the camera's maker left out of the prior, show three
greys and six published test colours; a session is run with the lamp's spectrum stated and curves
from the chart, and with nothing known. Of every signal relative to white: its error over the stated
one, as root mean square and as share within 1.96; the chi-square a band of all bands together, 1
where covariances are right; and how often the band of the spectrum holds.
"""
from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.prior.camera_database import read_camera_database
from spectrabox.calibrate.prior.camera_prior import save_prior
from spectrabox.fixtures.paints import NM
from spectrabox.radiometry.chart import REFERENCES
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import run_stages
from spectrabox.session.stages.stored_records import samples_of, signals_of

from benchmarks.bench_flat import HEAD, REGIONS, SIZE, photograph, regions_toml
from benchmarks.bench_unknown_makers import makers_of, prior_without

GREYS = (0.9, 0.5, 0.15)
LIGHTS = ("stated", "unknown")
GROUPS = {"grey of 0.9": [0], "grey of 0.5": [1], "grey of 0.15": [2],
          "colours": list(range(3, REGIONS))}
NORMAL_95 = 1.96


def judged(folder: Path, surfaces: np.ndarray) -> dict[str, np.ndarray]:
    """Errors over stated ones (R, K), chi-squares a band (R,), and what bands hold (R,)."""
    finished = run_stages(read_session(folder), device="cpu", only=None, force=False,
                          progress=lambda *_: None)
    signals = signals_of(finished.stored)
    truths = np.array([np.interp(signals.grid.nm, NM, each) for each in surfaces])
    off = signals.signal - truths @ signals.response.T
    total = np.sum([error.covariance for error in signals.errors], axis=0)
    held = []
    for name, truth in zip(signals.names, truths, strict=True):
        summary = samples_of(finished.stored, name)[1]
        there = np.interp(summary.grid.nm, signals.grid.nm, truth)
        held.append(np.mean((summary.lower <= there) & (there <= summary.upper)))
    solved = np.linalg.solve(total, off[..., None])[..., 0]
    return {"ratio": off / np.sqrt(np.diagonal(total, axis1=1, axis2=2)),
            "chi_square": np.sum(off * solved, axis=1) / off.shape[1], "held": np.array(held)}


def measure(data: Path, cases: int, seed: int) -> dict[str, Any]:
    """Figures by what is known of the light, and by the kind of surface."""
    rng = np.random.default_rng(seed)
    database = read_camera_database(data / "cameras")
    makers = makers_of(database)
    with np.load(data / "lights" / "lights_for_checks.npz") as stored:
        lamp_nm, lamps = stored["wavelengths_nm"], stored["spectra"]
    sets = test_reflectances(grid_from_nm(NM[20:-30]))
    colours = np.pad(np.vstack([rows for name, rows in sets.items() if name not in REFERENCES]),
                     ((0, 0), (20, 30)), mode="edge")
    found: dict[str, list[dict[str, np.ndarray]]] = {kind: [] for kind in LIGHTS}
    for case in range(cases):
        camera, lamp = int(rng.integers(len(database.names))), int(rng.integers(len(lamps)))
        chosen = colours[rng.choice(len(colours), REGIONS - len(GREYS), replace=False)]
        surfaces = np.vstack([np.outer(GREYS, np.ones(NM.size)), chosen])
        curves = np.array([np.interp(NM, database.nm, row) for row in database.curves[camera]])
        light = np.interp(NM, lamp_nm, lamps[lamp])
        prior = prior_without(database, np.asarray(makers) == np.asarray(makers)[camera])
        with tempfile.TemporaryDirectory() as written:
            for kind in LIGHTS:
                folder = Path(written) / kind
                for part in ("photos", "spectra"):
                    (folder / part).mkdir(parents=True)
                photograph(folder / "photos" / "p.dng", curves, light, surfaces,
                           np.random.default_rng([seed, case]))
                save_prior(folder / "spectra" / "prior.npz", prior)
                (folder / "spectra" / "light.csv").write_text(
                    table_text(NM, {"value": light}, quantity=Quantity.RELATIVE, source="lamp"),
                    encoding="utf-8")
                said = "spectra/light.csv" if kind == "stated" else "unknown"
                (folder / "session.toml").write_text(
                    f'{HEAD}[light]\nspectrum = "{said}"\n[sensitivity]\n'
                    f'prior = "spectra/prior.npz"\n{regions_toml(SIZE[1])}', encoding="utf-8")
                try:
                    found[kind].append(judged(folder, surfaces))
                except CheckError as error:
                    print(f"{case + 1} {kind}: {error}", file=sys.stderr, flush=True)
    return {kind: {group: _figures(rows, indices) for group, indices in GROUPS.items()}
            | {"cases": len(rows)} for kind, rows in found.items()}


def _figures(rows: list[dict[str, np.ndarray]], indices: list[int]) -> dict[str, float]:
    ratio, chi_square, held = (np.array([row[name][indices] for row in rows])
                               for name in ("ratio", "chi_square", "held"))
    return {"rms": float(np.sqrt(np.mean(ratio**2))),
            "within_95": float(np.mean(np.abs(ratio) <= NORMAL_95)),
            "chi_square": float(np.mean(chi_square)),
            "chi_square_median": float(np.median(chi_square)), "held": float(np.mean(held))}


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/ and lights/")
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    figures = measure(asked.data, asked.cases, asked.seed)
    if asked.json:
        print(json.dumps(figures))
        return
    for kind, groups in figures.items():
        print(f"light {kind}, {groups.pop('cases')} photos")
        for group, values in groups.items():
            print(f"  {group:<14}" + "".join(f" {name} {value:.3f}"
                                             for name, value in values.items()))


if __name__ == "__main__":
    main()
