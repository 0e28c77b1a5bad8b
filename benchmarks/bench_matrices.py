"""Matrices of cameras by measured curves, by curves from a chart photo, and by the chart alone.

Each camera of rawtoaces-data photographs a ColorChecker, noise 1 %, patches off by 1 % in common;
its curves are fitted under a prior without its maker. Printed are CIEDE2000 under D50 of surfaces
that no matrix was fitted to, as the measured curves see them: the mean over cameras of mean and
90th percentile; how far the matrices lie apart; and how often an entry lies within two of its
standard deviations of that by the measured curves. ``--figure`` draws one camera.
"""
from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.prior.learnt_prior import CameraDatabase, read_camera_database
from spectrabox.measure.plots import plot_matrices
from spectrabox.measure.profiles.camera_profile import MatrixComparison, compare_matrices
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.named_spectra import light
from spectrabox.radiometry.spectra.spectrum_files import on_grid

from benchmarks.bench_unknown_makers import NOISE, makers_of, prior_without

PATCH_ERROR = 0.01          # of the level of a patch, one chart against another


def compared(database: CameraDatabase, camera: int, lamp: str) -> MatrixComparison:
    """The matrices of a camera under a lamp whose spectrum is stated."""
    rng = np.random.default_rng(camera)
    reflectances, zero = chart_reflectances("BabelColor Average", FINE_GRID), np.zeros((24, 3))
    curves = on_grid(database.nm, database.curves[camera], FINE_GRID, database.names[camera])
    power = light(lamp, FINE_GRID)
    signal = reflectances @ (curves * power * FINE_GRID.weights_nm).T
    signal *= np.exp(NOISE * rng.standard_normal(signal.shape)
                     + PATCH_ERROR * rng.standard_normal((len(signal), 1)))
    samples = PatchSamples(signal, np.zeros((24, 3, 3)), np.ones(24), zero, zero)
    photo = ChartPhoto(samples, reflectances, Spectrum(FINE_GRID, power, Quantity.RELATIVE,
                                                       f"measured {lamp}"))
    makers = np.asarray(makers_of(database))
    prior = prior_without(database, makers == makers[camera])
    fit = calibrate_chart([photo], FINE_GRID, prior=prior)
    return compare_matrices(fit, photo, curves)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/")
    parser.add_argument("--every", type=int, default=2, help="every so many cameras")
    parser.add_argument("--lamps", nargs="+", default=["D55", "LED-B3", "A"])
    parser.add_argument("--figure", type=Path, help="draw --camera under the first lamp")
    parser.add_argument("--camera", default="Nikon D810", help="of the figure")
    arguments = parser.parse_args()
    database = read_camera_database(arguments.data / "cameras")
    if arguments.figure is not None:
        found = compared(database, database.names.index(arguments.camera), arguments.lamps[0])
        figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
        plot_matrices(*axes, found)
        figure.suptitle(f"{arguments.camera}, {arguments.lamps[0]}")
        figure.savefig(arguments.figure, dpi=110)
        print(found)
        return
    for lamp in arguments.lamps:
        every = [compared(database, camera, lamp)
                 for camera in range(0, len(database.names), arguments.every)]
        for source in every[0].matrices:
            fresh = np.array([one.fresh[source] for one in every])      # (cameras, 1 + T, 2)
            value = fresh[:, 0].mean(axis=0)
            deviation = fresh[:, 1:].std(axis=1, ddof=1).mean(axis=0)
            apart = np.mean([one.apart[source] for one in every])
            held = np.mean([np.abs(one.matrices[source][0] - one.matrices[one.judge][0])
                            < 2 * one.matrices[source][1:].std(axis=0, ddof=1) for one in every])
            print(f"{lamp}, {source}, {len(every)} cameras: mean {value[0]:.2f} ± "
                  f"{deviation[0]:.2f}, 90th percentile {value[1]:.2f} ± {deviation[1]:.2f}, "
                  f"apart {apart:.2f}, within 2 standard deviations {held:.0%}")


if __name__ == "__main__":
    main()
