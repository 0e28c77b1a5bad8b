"""Decoding against ``rawpy.postprocess`` (time, memory), noise against the truth, a 7-band
capture.

The 7-band capture is the folder ``flea3_chart`` under --data; without it that part is left out.
"""
from __future__ import annotations

import argparse
import csv
import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.capture.chart.chart_agreement import TYPICAL_SIGNALS
from spectrabox.capture.chart.detection import find_chart
from spectrabox.capture.chart.patches import sample_patches
from spectrabox.capture.develop.bracket import merge_exposures
from spectrabox.capture.develop.dark import mean_dark, subtract_dark
from spectrabox.capture.develop.developed import bright_channels, stack_bands, strongest_channel
from spectrabox.capture.photo.linear import open_photo
from spectrabox.fixtures.chart_scene import GRID_MM, chart_scene, mosaic
from spectrabox.fixtures.dng import BAYER_TILES, write_dng
from spectrabox.measure.held_out_spectra import held_out_patches
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import UnknownLight

from benchmarks.mosaic_file import read_mosaic

UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
CAMERA_GAIN = np.array([0.4, 0.7, 0.5])
BLACK, WHITE, ELECTRONS, READ_DN = np.array([512.0, 510.25, 514.5, 516.0]), 16383, 20000, 4.0
NANOMETRES = range(400, 701, 50)
# to either side of the name of a filter; beyond it the measured filter curves hold noise only
PASS_NM = 40
DARKEST_SHARE, FIELD_STEPS = 0.3, 20
PEAK_OF_DECODING = """
import resource, sys, numpy
from spectrabox.capture.photo.linear import open_photo
import spectrabox.capture.develop.bracket
with open("/proc/self/clear_refs", "w") as file: file.write("5")
def peak():
    lines = open("/proc/self/status")
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024
before = peak(); image = open_photo(sys.argv[1]); print(before, peak())
"""


def decoding(folder: Path, megapixels: float, repeats: int) -> dict[str, Any]:
    """Seconds of decoding to signal, noise and saturation, and of postprocess, in turn; peak memory
    of decoding.
    """
    import rawpy
    height = int(np.sqrt(megapixels * 1e6 / 1.5) / 2) * 2
    width = int(height * 1.5 / 2) * 2
    rng = np.random.default_rng(1)
    shade = np.linspace(600, 15000, width)[None] + rng.normal(scale=40, size=(height, width))
    path = folder / "large.dng"
    write_dng(path, np.clip(shade, 0, WHITE).astype(np.uint16))
    ours, theirs = [], []
    for _ in range(repeats):
        start = time.perf_counter()
        open_photo(path)
        ours.append(time.perf_counter() - start)
        start = time.perf_counter()
        with rawpy.imread(str(path)) as raw:
            raw.postprocess()
        theirs.append(time.perf_counter() - start)
    before, peak = map(float, subprocess.run([sys.executable, "-c", PEAK_OF_DECODING, str(path)],
                                             check=True, text=True,
                                             capture_output=True).stdout.split())
    mosaic_mb = 2 * width * height / 2**20
    path.unlink()
    return {"megapixels": width * height / 1e6, "seconds": float(np.median(ours)),
            "postprocess_seconds": float(np.median(theirs)),
            "ratio": float(np.median(theirs) / np.median(ours)), "peak_mb": peak - before,
            "mosaic_mb": mosaic_mb, "peak_over_mosaic": (peak - before) / mosaic_mb}


def noise_accuracy(folder: Path) -> dict[str, Any]:
    """Stated variance / true variance in flat shades, over four tile orders and four bit depths;
    patch chi-square.
    """
    ratios, worst_mean_dn, distances = [], 0.0, []
    for index, (pattern, bits) in enumerate(zip(BAYER_TILES, (10, 12, 14, 16), strict=True)):
        white = 2**bits - 1
        black, read_dn = BLACK * white / WHITE, max(READ_DN * white / WHITE, 0.6)
        rng = np.random.default_rng([5, index])
        scene = np.repeat(np.linspace(0.02, 0.85, 1200)[None, :, None], 800,
                          axis=0) * np.array([0.6, 1.0, 0.8])
        counts = mosaic(scene, pattern, black, white, ELECTRONS, read_dn, rng)
        write_dng(folder / "ramp.dng", counts, pattern=pattern, black=black, white=white, bits=bits)
        image = open_photo(folder / "ramp.dng")
        scale = white - black.mean()
        for band, share in ((0, 1.0), (1, 0.5), (2, 1.0)):
            signal = scene[0, ::2, band]
            truth = share * (signal / ELECTRONS + (read_dn**2 + 1 / 12) / scale**2)
            stated = image.variance[..., band].mean(axis=0)
            ratios.append(float(np.mean(stated / truth)))
        distances.append(_patch_distance(folder, pattern, bits, white, black, read_dn, rng))
        worst_mean_dn = max(worst_mean_dn, _noiseless_error_dn(folder, pattern, bits, white, black))
    total, freedom = sum(distances), 72 * len(distances)
    return {"variance_ratio": ratios,
            "worst_variance_error": float(np.max(np.abs(np.array(ratios) - 1))),
            "worst_patch_mean_error_dn": worst_mean_dn, "chi_square": float(total),
            "degrees_of_freedom": freedom,
            "p_value": float(2 * min(chi2.cdf(total, freedom), chi2.sf(total, freedom)))}


def _chart_photo(folder: Path, pattern: str, bits: int, white: int, black: np.ndarray,
                 counts: np.ndarray) -> Any:
    write_dng(folder / "chart.dng", counts, pattern=pattern, black=black, white=white, bits=bits)
    image = open_photo(folder / "chart.dng")
    return sample_patches(image, find_chart(image, TYPICAL_SIGNALS))


def _patch_distance(folder: Path, pattern: str, bits: int, white: int, black: np.ndarray,
                    read_dn: float,
                    rng: np.random.Generator) -> float:
    scene, signals = _scene()
    samples = _chart_photo(folder, pattern, bits, white, black,
                           mosaic(scene, pattern, black, white, ELECTRONS, read_dn, rng))
    return float(sum(error @ np.linalg.solve(covariance, error) for error, covariance
                     in zip(samples.mean - signals, samples.covariance_of_mean, strict=True)))


def _noiseless_error_dn(folder: Path, pattern: str, bits: int, white: int,
                        black: np.ndarray) -> float:
    scene, signals = _scene()
    counts = np.empty(scene.shape[:2])
    for position, band in enumerate(BAYER_TILES[pattern]):
        tile = (slice(position // 2, None, 2), slice(position % 2, None, 2))
        counts[tile] = black[position] + scene[(*tile, band)] * (white - black[position])
    samples = _chart_photo(folder, pattern, bits, white, black, np.rint(counts).astype(np.uint16))
    return float(np.abs(samples.mean - signals).max() * (white - black.min()))


def _scene() -> tuple[np.ndarray, np.ndarray]:
    signals = CAMERA_GAIN * TYPICAL_SIGNALS
    corners = (UNIT - 0.5) * GRID_MM * 560 / GRID_MM[0] + np.array([500, 360])
    return chart_scene(720, 1000, signals, corners), signals


def seven_bands(folder: Path) -> dict[str, Any]:
    """Patch signals of a 7-band capture against filter-weighted measured reflectances, as shares of
    the maximum.
    """
    captured = folder / "captured_images"
    darks: dict[float, list[Any]] = {}
    for path in sorted((captured / "dark_frames").iterdir()):
        frame = _flea_frame(path)
        darks.setdefault(frame.exposure_s, []).append(frame)
    dark = {exposure: mean_dark(frames, cut_off_dn=0.5) for exposure, frames in darks.items()}
    noise = np.full(3, 1 / 255**2 / 12), np.full(3, 1e-5)  # 8 bits: rounding rules
    images = []
    for nm in NANOMETRES:
        frames = [_flea_frame(path) for path in
                  sorted((captured / "images_filtered_light"
                          / "color_checker").glob(f"*_{nm}nm_*"))]
        images.append(merge_exposures([subtract_dark(frame, dark[frame.exposure_s],
                                                     noise) for frame in frames], spills=True)[0])
    image = stack_bands(images, [f"{nm} nm" for nm in NANOMETRES])
    nm, filters, reflectances = _measured(folder / "spectra_averaged.csv")
    predicted = _filter_weighted(nm, filters, reflectances)
    detection = find_chart(image, predicted)
    means, centres = sample_patches(image, detection).mean, detection.corners_px.mean(axis=1)
    rms, largest, without = [], [], []
    for band in range(len(images)):
        pick = slice(band, band + 1)
        gain = float((means[:, band] @ predicted[:, band])
                     / (predicted[:, band] @ predicted[:, band]))
        residual = (means[:, band] - gain * predicted[:, band]) / means[:, band].max()
        left = _residuals_of_field(means[:, pick], predicted[:, pick], centres)
        rms.append(float(np.sqrt(np.mean(left**2))))
        largest.append(float(np.abs(left).max()))
        without.append(float(np.sqrt(np.mean(residual**2))))
    return {"nm": list(NANOMETRES), "channel": [strongest_channel(one) for one in images],
            "rms_of_maximum": rms, "largest_of_maximum": largest, "rms_without_field": without,
            "spectra": spectra_of_patches(images[1:], np.array(
                [np.interp(FINE_GRID.nm, nm, patch) for patch in reflectances.T]))}


def spectra_of_patches(images: list[Any], reflectances: np.ndarray) -> dict[str, Any]:
    """Every channel of photos under a light that nobody measured: RMSE of each patch's reflectance
    by a calibration without it, and what its 95 % band holds and should hold.
    """
    pick = [(image, channel) for image in images for channel in bright_channels(image)]
    image = stack_bands([one for one, _ in pick], [str(number) for number in range(len(pick))],
                        [channel for _, channel in pick])
    samples = sample_patches(image, find_chart(image, TYPICAL_SIGNALS))
    facts = {"bands": len(pick)}
    for name, surfaces in (("measured", reflectances),
                           ("published", chart_reflectances("BabelColor Average", FINE_GRID))):
        found = calibrate_chart([ChartPhoto(samples, surfaces, UnknownLight())], FINE_GRID)
        check = held_out_patches(found, surfaces)
        facts[name] = [*check.means, float(check.rmse.max())]
    return facts


def _residuals_of_field(signals: np.ndarray, predicted: np.ndarray,
                        centres: np.ndarray) -> np.ndarray:
    """(signal - fit) / largest signal (24, 1) after a gain and a quadratic log field of the light.

    Gauss-Newton on relative errors, dark patches counting less.
    """
    x, y = ((centres - centres.mean(axis=0)) / np.ptp(centres)).T
    design = np.column_stack([np.ones(x.size), x, y, x**2, x * y, y**2])
    weights = (predicted / (predicted + DARKEST_SHARE * predicted.max())).ravel()
    parameters = np.zeros(design.shape[1])
    parameters[0] = np.log(signals.sum() / predicted.sum())
    for _ in range(FIELD_STEPS):
        fitted = np.exp(design @ parameters) * predicted.ravel()
        error = (signals.ravel() - fitted) / fitted
        parameters += np.linalg.lstsq(design * weights[:, None], error * weights, rcond=None)[0]
    fitted = np.exp(design @ parameters)[:, None] * predicted
    return (signals - fitted) / signals.max()


def _flea_frame(path: Path) -> Any:
    match = re.search(r"_(\d+)ms_", path.name)
    exposure_s = int(match[1]) / 1000 if match else None
    return read_mosaic(path, "GBRG", white_level=255, exposure_s=exposure_s, camera="Flea3")


def _measured(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Wavelengths (W,), and at them the filters (W, 7) and the chart (W, 24)."""
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    table, first = np.array(rows[1:], float), rows[0].index("dark skin")
    return table[:, 0], table[:, 1:8], table[:, first:first + 24]


def _filter_weighted(nm: np.ndarray, filters: np.ndarray, reflectances: np.ndarray) -> np.ndarray:
    """Reflectances (24, 7) of the chart, weighted by the measured filters."""
    passed = np.abs(nm[:, None] - np.array(NANOMETRES)) <= PASS_NM
    weights = filters * passed
    return reflectances.T @ weights / weights.sum(axis=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--megapixels", type=float, nargs="+", default=[24.0, 60.0])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--data", type=Path, help="folder of measured data that holds flea3_chart")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the tables")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        facts: dict[str, Any] = {
            "decoding": [decoding(folder, megapixels, arguments.repeats)
                         for megapixels in arguments.megapixels],
            "noise": noise_accuracy(folder)}
    if arguments.data is not None:
        facts["seven_bands"] = seven_bands(arguments.data / "flea3_chart")
    if arguments.json:
        print(json.dumps(facts))
        return
    print(f"{'megapixels':>10}{'ours s':>9}{'postprocess s':>15}{'ratio':>7}{'peak MB':>9}"
          f"{'mosaic MB':>11}"
          f"{'peak/mosaic':>13}")
    for row in facts["decoding"]:
        print(f"{row['megapixels']:>10.1f}{row['seconds']:>9.2f}"
              f"{row['postprocess_seconds']:>15.2f}{row['ratio']:>7.1f}"
              f"{row['peak_mb']:>9.0f}{row['mosaic_mb']:>11.0f}{row['peak_over_mosaic']:>13.1f}")
    noise = facts["noise"]
    print(f"variance: stated / true - 1 at most {noise['worst_variance_error']:.1%} over 4 tile "
          "orders, 10 to 16 bits; noiseless patch means off by at most "
          f"{noise['worst_patch_mean_error_dn']:.2f} DN; chi-square {noise['chi_square']:.1f} of "
          f"{noise['degrees_of_freedom']} (p = {noise['p_value']:.2f})")
    if "seven_bands" in facts:
        bands = facts["seven_bands"]
        spectra = bands.pop("spectra")
        print(f"{'band nm':>10}{'channel':>9}{'rms / max':>11}{'largest':>9}{'without field':>15}")
        for row in zip(*bands.values(), strict=True):
            print(f"{row[0]:>10}{'RGB'[row[1]]:>9}{row[2]:>11.1%}{row[3]:>9.1%}{row[4]:>15.1%}")
        for name in ("measured", "published"):
            rmse, inside, expected, worst = spectra[name]
            print(f"{spectra['bands']} bands from 450 nm, light unknown, {name} chart: each patch "
                  f"from the others RMSE {rmse:.3f} (worst {worst:.3f}), {inside:.3f} inside, "
                  f"{expected:.3f} expected")


if __name__ == "__main__":
    main()
