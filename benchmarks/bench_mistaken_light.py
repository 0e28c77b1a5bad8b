"""A chart photo with the spectrum of another lamp: is it refused, does the fit say that something
is wrong, or nothing?

Every second camera of a folder of measured cameras, left out of the prior, photographs the 24
BabelColor patches under one light with 1 % of noise that nobody states, and is fitted as if under
another.
"""
from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from spectrabox.calibrate.chart_equations import chart_equations
from spectrabox.calibrate.prior.camera_database import CameraDatabase, read_camera_database
from spectrabox.calibrate.sensitivity import fit_with_prior
from spectrabox.calibrate.trust import doubts
from spectrabox.radiometry.chart import chart_reflectances, patch_centres_uv
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import PatchSamples
from spectrabox.radiometry.spectra.named_spectra import light
from spectrabox.radiometry.spectra.spectrum_files import on_grid

from benchmarks.bench_calibration import others

GRID = visible_grid()
PAIRS = (("D65", "D65"), ("LED-B3", "LED-B3"), ("LED-B3", "A"), ("LED-B3", "D65"), ("D65", "A"),
         ("A", "LED-B3"), ("LED-B3", "LED-B2"), ("D65", "D50"))
NOISE = 0.01


def judged(database: CameraDatabase, camera: int, true: str, claimed: str,
           rng: np.random.Generator) -> str:
    """``refused``, ``said`` or ``silent``."""
    curves = on_grid(database.nm, database.curves[camera], GRID, database.names[camera])
    reflectances = chart_reflectances("BabelColor Average", GRID)
    signal = reflectances @ (curves * light(true, GRID) * GRID.weights_nm).T
    signal *= 1 + NOISE * rng.standard_normal(signal.shape)
    samples = PatchSamples(signal, np.zeros((24, 3, 3)), np.ones(24), 0 * signal, 0 * signal)
    photo = chart_equations(samples, reflectances, light(claimed, GRID), np.full(24, np.pi), GRID,
                        positions=patch_centres_uv())
    found = fit_with_prior([photo], others(database, camera, by_brand=False), GRID)
    if found.disagrees:
        return "refused"
    return "said" if doubts(found) else "silent"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/")
    database = read_camera_database(parser.parse_args().data / "cameras")
    rng = np.random.default_rng(20)
    print(f"{'light':<10}{'taken for':<12}{'refused':>8}{'said':>8}{'silent':>8}")
    for true, claimed in PAIRS:
        found = [judged(database, camera, true, claimed, rng)
                 for camera in range(0, len(database.names), 2)]
        print(f"{true:<10}{claimed:<12}" + "".join(f"{found.count(verdict):8d}"
                                                   for verdict in ("refused", "said", "silent")),
              flush=True)


if __name__ == "__main__":
    main()
