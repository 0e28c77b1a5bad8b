"""How often a chart at which nothing is wrong is said to be unusual, or not as its reference says.

Charts are drawn as copies depart from each other (``fixtures.paints.chart_copy``), photographed by
cameras whose maker the prior does not hold under the lamps of the folder, with patches that are
off and glare: lying beside samples, in light that falls off, or in a scene that states the light on
each patch. Printed is the share of charts of which ``chart_findings.at_fault`` names a patch.

    python -m benchmarks.bench_chart_alarms --data FOLDER
"""
from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from spectrabox.calibrate import chart_findings
from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_equations import field_terms
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.fixtures.paints import NM, chart_copy
from spectrabox.measure.held_out_spectra import held_out_patches
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.charts.references import editions
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight
from spectrabox.radiometry.spectra.spectrum_files import on_grid

from benchmarks.bench_unknown_light import FIELD_SD, MAX_GLARE
from benchmarks.bench_unknown_makers import (
    GRID,
    makers_of,
    prior_without,
    read_camera_database,
)

BANDS_OFF, PATCH_OFF = 0.001, 0.004     # relative: of each band of a patch, and of a patch
KINDS = ("beside samples, light stated", "beside samples, light unknown", "in a stated scene")


def photographed(curves: np.ndarray, power: np.ndarray, kind: str,
                 rng: np.random.Generator) -> ChartPhoto:
    """A photo by curves (K, P) of a copy of the chart under a lamp (P,)."""
    surfaces = np.array([np.interp(GRID.nm, NM, patch) for patch in chart_copy(rng)])
    signal = surfaces @ (curves * power * GRID.weights_nm).T
    if kind != KINDS[2]:
        terms = field_terms(CLASSIC.centres_uv)
        signal *= np.exp(terms @ (FIELD_SD * rng.standard_normal(terms.shape[1])))[:, None]
    off = BANDS_OFF * rng.standard_normal(signal.shape) + PATCH_OFF * rng.standard_normal((24, 1))
    signal = signal / signal.max() * (1 + off) + rng.uniform(0, MAX_GLARE)
    zero, of = np.zeros(signal.shape), editions(CLASSIC)
    photo = ChartPhoto(PatchSamples(signal, np.zeros((24, 3, 3)), np.ones(24), zero, zero),
                       of[0].mean, Spectrum(GRID, power, Quantity.RELATIVE, "lamp"),
                       np.full(24, np.pi) if kind == KINDS[2] else None, editions=of)
    return replace(photo, light=UnknownLight()) if kind == KINDS[1] else photo


def main() -> None:
    """Print a row for each kind of photo."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/, lights/")
    parser.add_argument("--charts", type=int, default=120, help="of each kind")
    parser.add_argument("--seed", type=int, default=44)
    arguments = parser.parse_args()
    database = read_camera_database(arguments.data / "cameras")
    makers = makers_of(database)
    stored = np.load(arguments.data / "lights" / "lights_for_checks.npz")
    for kind in KINDS:
        codes: Counter[str] = Counter()
        for number in range(arguments.charts):
            rng, camera = np.random.default_rng([number, arguments.seed]), number % len(makers)
            curves = database.curves[camera]
            truth = on_grid(database.nm, curves / curves.max(), GRID, database.names[camera])
            power = np.interp(GRID.nm, stored["wavelengths_nm"],
                              stored["spectra"][rng.integers(len(stored["spectra"]))])
            made = calibrate_chart(
                [photographed(truth, power, kind, rng)], GRID,
                prior=prior_without(database, makers == makers[camera]))
            patches = held_out_patches(made, made.reflectances)
            codes.update(one.code for one in chart_findings.at_fault(patches, CLASSIC.names))
        share = sum(codes.values()) / arguments.charts
        error = np.sqrt(share * (1 - share) / arguments.charts)
        print(f"{kind}: {share:.1%} ± {error:.1%} of {arguments.charts} named {dict(codes)}",
              flush=True)


if __name__ == "__main__":
    main()
