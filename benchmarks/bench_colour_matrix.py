"""The colour matrices that LibRaw knows of measured cameras, against their curves: spread, alarms.

A raw file of a few grey pixels is written in each camera's name and read back, so that LibRaw adds
the matrix it has for that camera. Printed are the mean and the standard deviation of the departure
from what the measured curves predict (``TYPICAL`` and ``SPREAD`` of
``calibrate/doubts.py``), and how many cameras are called doubtful when a chart photo under
one light, noise 1 %, is fitted under the right or another light, the camera left out of the prior.
Threshold and table were found on these same cameras.
"""
from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.doubts import DOUBTFUL, matrix_deviation, matrix_doubt
from spectrabox.calibrate.prior.learnt_prior import CameraDatabase, read_camera_database
from spectrabox.capture.photo.raw import read_raw
from spectrabox.fixtures.dng import write_dng
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.named_spectra import light
from spectrabox.radiometry.spectra.spectrum_files import on_grid

from benchmarks.bench_unknown_makers import GRID, NOISE, prior_without

TAKEN_FOR = (("D65", "D65"), ("LED-B3", "LED-B3"), ("LED-B3", "LED-B2"), ("D65", "D50"),
             ("LED-B3", "D65"), ("A", "LED-B3"))


def known_matrix(name: str) -> np.ndarray | None:
    """What LibRaw knows of a camera by its name, maker first."""
    maker, model = name.split(" ", 1)
    grey = np.full((64, 64), 2000, np.uint16)
    with tempfile.TemporaryDirectory() as folder:
        write_dng(Path(folder) / "grey.dng", grey, make=maker, model=model,
                  camera_from_xyz=None)
        return read_raw(Path(folder) / "grey.dng").camera_from_xyz


def fitted_curves(database: CameraDatabase, camera: int, true: str, taken: str) -> np.ndarray:
    """Curves (3, P) from a chart under the light ``true`` that is taken for ``taken``."""
    rng = np.random.default_rng(camera)
    reflectances, zero = chart_reflectances("BabelColor Average", GRID), np.zeros((24, 3))
    truth = on_grid(database.nm, database.curves[camera], GRID, database.names[camera])
    signal = reflectances @ (truth * light(true, GRID) * GRID.weights_nm).T
    signal *= 1 + NOISE * rng.standard_normal(signal.shape)
    samples = PatchSamples(signal, np.zeros((24, 3, 3)), np.ones(24), zero, zero)
    spectrum = Spectrum(GRID, light(taken, GRID), Quantity.RELATIVE, taken)
    prior = prior_without(database, np.arange(len(database.names)) == camera)
    made = calibrate_chart([ChartPhoto(samples, reflectances, spectrum)], GRID,
                           prior=prior)
    return made.calibration.sensitivity.curves


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/")
    parser.add_argument("--every", type=int, default=2, help="fit every so many cameras")
    arguments = parser.parse_args()
    database = read_camera_database(arguments.data / "cameras")
    matrices = {camera: matrix for camera, name in enumerate(database.names)
                if (matrix := known_matrix(name)) is not None}
    departures = np.array([
        matrix_deviation(matrix, on_grid(database.nm, database.curves[camera], GRID, ""), GRID)
        for camera, matrix in matrices.items()])
    print(f"{len(matrices)} cameras; typical and spread:")
    print(np.round(departures.mean(axis=0), 3).tolist())
    print(np.round(departures.std(axis=0), 3).tolist())
    for true, taken in TAKEN_FOR:
        doubts, refused = [], 0
        for camera in list(matrices)[::arguments.every]:
            try:
                curves = fitted_curves(database, camera, true, taken)
            except CheckError:
                refused += 1
                continue
            doubts.append(matrix_doubt(matrices[camera], curves, GRID))
        print(f"{true:<8}taken for {taken:<8}median {np.median(doubts):6.1f}  doubtful "
              f"{np.sum(np.array(doubts) > DOUBTFUL)} of {len(doubts)}, refused {refused}")


if __name__ == "__main__":
    main()
