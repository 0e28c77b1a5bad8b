"""How well a calibration knows what the camera will read: of white, and of colours relative to
white.

Leave one camera out over a folder of measured cameras: it photographs the 24 BabelColor patches in
known geometry under LED-B3, with noise that nobody states. The fit's light scale and curves then
predict what the camera reads of a white surface (error stated: that of the light scale) and of the
CES99 test colours (that, and the covariance of the curves). The table has the median absolute
error, its rms in stated standard errors, and how often 95 % intervals hold.
"""
from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from spectrabox.calibrate.calibration import (
    CalibrationOptions,
    ChartCalibration,
    ChartPhoto,
    calibrate_chart,
)
from spectrabox.calibrate.prior.camera_database import CameraDatabase, read_camera_database
from spectrabox.radiometry.chart import chart_reflectances, patch_centres_uv
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import PatchSamples, Quantity, Spectrum
from spectrabox.radiometry.spectra.named_spectra import light, test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import on_grid

from benchmarks.bench_calibration import others

GRID = visible_grid()
NOISES = (0.005, 0.01, 0.02)
SCALE = 3.7
NORMAL_95 = 1.96


def photographed(database: CameraDatabase, camera: int, noise: float, power: np.ndarray,
                 rng: np.random.Generator) -> tuple[np.ndarray, ChartCalibration]:
    """True curves (K, P) and the calibration from one photo."""
    truth = on_grid(database.nm, database.curves[camera], GRID, database.names[camera])
    truth /= truth.max()
    reflectances = chart_reflectances("BabelColor Average", GRID)
    irradiance = 0.05 * (1 + 0.2 * patch_centres_uv()[:, 0])
    signal = SCALE * reflectances @ (truth * power * GRID.weights_nm).T * (irradiance / np.pi)[:,
                                                                                               None]
    signal *= 1 + noise * rng.standard_normal(signal.shape)
    bands = signal.shape[1]
    samples = PatchSamples(signal, np.zeros((24, bands, bands)), np.ones(24), 0 * signal,
                           0 * signal)
    lamp = Spectrum(GRID, power, Quantity.RADIANCE, "lamp")
    return truth, calibrate_chart([ChartPhoto(samples, reflectances, lamp, irradiance)], GRID,
                                  CalibrationOptions(
                                      prior=others(database, camera, by_brand=False)))


def errors_of(truth: np.ndarray, made: ChartCalibration, power: np.ndarray,
              surfaces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Relative errors of the signals (S, K) of surfaces (S, P), and their stated standard
    errors.
    """
    fit, weight = made.calibration.sensitivity, power * GRID.weights_nm
    assert fit.basis is not None and fit.covariance is not None
    assert made.scale.standard_error is not None
    seen = made.scale.value * surfaces @ (fit.curves * weight).T
    white = made.scale.value * fit.curves @ weight
    blocks = fit.covariance.reshape(len(white), fit.basis.shape[1], len(white), -1)
    variance = np.empty(seen.shape)
    for band in range(len(white)):
        contrast = (surfaces - seen[:, band, None]
                    / white[band]) * weight @ fit.basis * made.scale.value
        variance[:, band] = np.einsum("sn,nm,sm->s", contrast, blocks[band, :, band],
                                      contrast) / seen[:, band] ** 2
    relative = made.scale.standard_error / made.scale.value
    return seen / (SCALE * surfaces @ (truth * weight).T) - 1, np.sqrt(variance + relative**2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with cameras/")
    database = read_camera_database(parser.parse_args().data / "cameras")
    power = light("LED-B3", GRID)
    surfaces = np.vstack([np.ones(GRID.nm.size), test_reflectances(GRID)["CES99"]])
    rng = np.random.default_rng(20)
    print(f"{'noise':<8}{'white: error':>14}{'rms / stated':>14}{'95 % hold':>11}"
          f"{'colours: error':>17}{'rms / stated':>14}{'95 % hold':>11}")
    for noise in NOISES:
        photos = [photographed(database, camera, noise, power,
                               rng) for camera in range(len(database.names))]
        found = [errors_of(truth, made, power, surfaces) for truth, made in photos]
        error, stated = (np.array(part) for part in zip(*found, strict=True))
        cells = "".join(f"{np.median(np.abs(error[:, rows])):{width}.2%}"
                        f"{np.sqrt(np.mean((error[:, rows] / stated[:, rows]) ** 2)):14.2f}"
                        f"{np.mean(np.abs(error[:, rows]) < NORMAL_95 * stated[:, rows]):11.1%}"
                        for rows, width in ((slice(0, 1), 14), (slice(1, None), 17)))
        print(f"{noise:<8.1%}{cells}", flush=True)


if __name__ == "__main__":
    main()
