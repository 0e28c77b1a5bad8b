"""Colour profiles of measured cameras against the matrices that raw files carry.

Each camera photographs a ColorChecker under one light, noise 1 %; its curves are fitted under a
prior without it (``--unknown``: with the products of curves and light, the light not stated), and a
profile is made of the fit, with its draws. Printed is CIEDE2000 under D50 of surfaces as the
camera's measured curves see them, by LibRaw's matrix of the camera and by the profile's matrix and
table, the median over cameras of mean and 95 %; and how often the true error lies within two
spreads of the stated one.
"""
from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.colour_profile import colour_errors, stated_transform
from spectrabox.calibrate.prior.learnt_prior import CameraDatabase, read_camera_database
from spectrabox.measure.profiles.colour_profile import (
    CHART,
    FRESH,
    MATRIX,
    STATED,
    TABLE,
    colour_profile,
    response_of_calibration,
    response_of_curves,
)
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight
from spectrabox.radiometry.spectra.named_spectra import light, test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import on_grid
from spectrabox.sampling.prior.libraries import read_library
from spectrabox.sampling.prior.mixture import PRIOR_GRID

from benchmarks.bench_colour_matrix import known_matrix
from benchmarks.bench_unknown_makers import NOISE, prior_without

PIGMENTS = "Kremer pigments"


def photographed(database: CameraDatabase, camera: int, lamp: str, unknown: bool
                 ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """True and estimated response (3, 61) of a camera, and draws (T, 3, 61) of the estimate."""
    rng = np.random.default_rng(camera)
    reflectances, zero = chart_reflectances("BabelColor Average", FINE_GRID), np.zeros((24, 3))
    curves = on_grid(database.nm, database.curves[camera], FINE_GRID, database.names[camera])
    power = light(lamp, FINE_GRID)
    signal = reflectances @ (curves * power * FINE_GRID.weights_nm).T
    signal *= 1 + NOISE * rng.standard_normal(signal.shape)
    samples = PatchSamples(signal, np.zeros((24, 3, 3)), np.ones(24), zero, zero)
    stated = UnknownLight() if unknown else Spectrum(FINE_GRID, power, Quantity.RELATIVE, lamp)
    prior = prior_without(database, np.arange(len(database.names)) == camera)
    fit = calibrate_chart([ChartPhoto(samples, reflectances, stated)], FINE_GRID,
                          prior=prior)
    return (response_of_curves(curves, power, FINE_GRID),
            *response_of_calibration(fit.calibration))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True,
                        help="folder with cameras/ and reflectance/kremer_pigments/")
    parser.add_argument("--every", type=int, default=3, help="every so many cameras")
    parser.add_argument("--lamps", nargs="+", default=["D65", "LED-B3", "A"])
    parser.add_argument("--unknown", action="store_true", help="the light is not stated")
    arguments = parser.parse_args()
    database = read_camera_database(arguments.data / "cameras")
    tests = test_reflectances(PRIOR_GRID)
    pigments = read_library(arguments.data / "reflectance" / "kremer_pigments")
    sets = {CHART: tests[CHART], FRESH: tests[FRESH], PIGMENTS: pigments}
    for lamp in arguments.lamps:
        found: dict[tuple[str, str], list[list[float]]] = {}
        inside = []
        for camera in range(0, len(database.names), arguments.every):
            matrix = known_matrix(database.names[camera])
            if matrix is None:
                continue
            truth, estimate, draws = photographed(database, camera, lamp, arguments.unknown)
            profile = colour_profile(estimate, draws)
            transforms = {STATED: stated_transform(matrix), MATRIX: profile.matrix,
                          TABLE: profile.table}
            for by, transform in transforms.items():
                for of, surfaces in sets.items():
                    errors = colour_errors(transform, truth, surfaces, PRIOR_GRID)
                    found.setdefault((by, of), []).append(
                        [float(errors.mean()), float(np.percentile(errors, 95))])
            stated, (true, _) = profile.errors[TABLE][FRESH]["mean"], found[TABLE, FRESH][-1]
            assert stated.standard_deviation is not None
            inside.append(abs(stated.value - true) < 2 * stated.standard_deviation)
        better = [np.mean(np.array(found[TABLE, of])[:, 0] < np.array(found[STATED, of])[:, 0])
                  for of in sets]
        print(f"{lamp}, {len(inside)} cameras; table nearer than own matrix on "
              f"{', '.join(f'{share:.0%}' for share in better)}; true mean of {FRESH} within two "
              f"spreads of the stated one {np.mean(inside):.0%}")
        for (by, of), figures in found.items():
            mean, high = np.median(figures, axis=0)
            worst = np.max(np.array(figures)[:, 0])
            print(f"| {lamp} | {of} | {by} | {mean:.2f} | {high:.2f} | {worst:.2f} |", flush=True)


if __name__ == "__main__":
    main()
