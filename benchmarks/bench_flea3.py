"""Colour bands of a real industrial camera from a chart with measured patches, under seven
band-pass filters.

A FLIR Flea3 (Bayer, 8 bit) photographed a ColorChecker through seven filters; a spectroradiometer
measured that very chart and the filters. For every filter and colour the response is found by least
squares (patch signal = response x field x filter-weighted reflectance, a quadratic log field) and
compared with ``sensor.mat``, the response map that the authors of the data published; both are
divided by green under the same filter, for their exposures are not comparable. The alternatives are
the same fit without the field; one joint estimate of whole curves from all seven photos with the
prior of measured cameras, this one being none of them ("joint"); and the mean of those cameras,
with no photo at all.
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.io import loadmat
from scipy.optimize import least_squares

from spectrabox.calibrate.chart_equations import ChartEquations, field_terms
from spectrabox.calibrate.prior.camera_prior import shipped_prior
from spectrabox.calibrate.sensitivity import fit_with_prior
from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_table

FILTERS = (400, 450, 500, 550, 600, 650, 700)
FILTER_COLUMNS = ("400 nm", "442 nm", "500 nm", "550 nm", "600 nm", "650 nm", "700 nm")
TILE = {"G": ((0, 0), (1, 1)), "B": ((0, 1),), "R": ((1, 0),)}      # GBRG
MARGIN_PX = 2
READ_NOISE = 1e-3            # of the brightest patch: an 8-bit camera, exposures merged
GRID = visible_grid()


def patch_means(folder: Path, nm: int) -> tuple[np.ndarray, np.ndarray]:
    """Signals (24, 3) in R, G, B and places (24, 2) of the patches under one filter."""
    mosaic = loadmat(folder / "hdr_averaged_images" / f"d2_colorChecker30cm_{nm}nm.mat")["I_raw"]
    labels = cv2.imread(str(folder / "colorChecker_labels"
                            / "d2_colorChecker30cm_550nm_labels.png"), -1)
    signals, places = np.empty((24, 3)), np.empty((24, 2))
    for patch in range(24):
        inside = cv2.erode((labels == patch + 1).astype(np.uint8),
                           np.ones((2 * MARGIN_PX + 1,) * 2)).astype(bool)
        places[patch] = np.argwhere(inside).mean(axis=0)[::-1]
        for band, colour in enumerate("RGB"):
            values = [mosaic[row::2, column::2][inside[row::2, column::2]] for row,
                      column in TILE[colour]]
            signals[patch, band] = np.concatenate(values).mean()
    return signals, places


def responses(signals: np.ndarray, weighted: np.ndarray, places: np.ndarray,
              with_field: bool) -> tuple[np.ndarray, np.ndarray]:
    """Response (3,) of each colour and rms residual (3,) as a share of the largest signal."""
    terms = field_terms(places) if with_field else np.zeros((24, 0))
    strongest = signals.max(axis=0)

    def residual(state: np.ndarray) -> np.ndarray:
        lit = weighted * np.exp(terms @ state[3:])
        return ((np.exp(state[:3]) * lit[:, None] - signals) / strongest).ravel()

    start = np.r_[np.log(np.maximum(signals.sum(axis=0) / weighted.sum(), 1e-9)),
                  np.zeros(terms.shape[1])]
    found = least_squares(residual, start)
    return np.exp(found.x[:3]), np.sqrt(np.mean(residual(found.x).reshape(24, 3) ** 2, axis=0))


def joint_responses(photos: list[tuple[np.ndarray, np.ndarray]], chart: np.ndarray,
                    filters: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Responses (F, 3) to each filter (F, P) by the joint estimate and by the mean of the measured
    cameras.

    Also the model error and chi-square of the joint estimate. Patches without signal in a band are
    left out.
    """
    shots = []
    for (signals, places), transmission in zip(photos, filters, strict=True):
        lit = (signals > 0).all(axis=1)
        noise = np.tile(np.eye(3) * (READ_NOISE * signals.max()) ** 2,
                        (np.count_nonzero(lit), 1, 1))
        shots.append(ChartEquations(signals[lit], noise, chart[lit], transmission * GRID.weights_nm,
                                np.full(len(noise), np.pi), field_terms(places)[lit], True))
    prior = shipped_prior()
    found = fit_with_prior(shots, prior, GRID)
    mean = prior.curves(prior.means[-1]).reshape(3, -1) @ interpolation_matrix(prior.nm, GRID.nm).T
    powers = np.array([shot.power for shot in shots])
    return powers @ found.sensitivity.curves.T, powers @ mean.T, found.model_error, found.chi_square


def measure(data: Path) -> dict[str, Any]:
    """One row per filter, and how far photos and joint estimate disagree."""
    folder = data / "flea3_chart"
    table = read_table(folder / "spectra_averaged.csv")
    columns = dict(zip(table.names, table.values, strict=True))
    chart = np.array([values for name, values in columns.items()][9 + 2:9 + 2 + 24])
    published = loadmat(folder / "multispectral_images" / "sensor.mat")["sensor_map"]
    photos = [patch_means(folder, nm) for nm in FILTERS]
    on_visible = on_grid(table.nm, np.vstack([chart, [columns[name] for name in FILTER_COLUMNS]]),
                         GRID, "spectra")
    joint, mean, model_error, chi_square = joint_responses(photos, on_visible[:24],
                                                           np.maximum(on_visible[24:], 0))
    rows = []
    for index, (nm, column) in enumerate(zip(FILTERS, FILTER_COLUMNS, strict=True)):
        visible = (table.nm >= 380) & (table.nm <= 780)
        weighted = chart[:, visible] @ columns[column][visible]
        signals, places = photos[index]
        with_field, error = responses(signals, weighted, places, True)
        without, plain_error = responses(signals, weighted, places, False)
        strong = int(signals.max(axis=0).argmax())
        rows.append({"filter_nm": nm, "ours": (with_field / with_field[1]).tolist(),
                     "joint": (joint[index] / joint[index, 1]).tolist(),
                     "cameras_mean": (mean[index] / mean[index, 1]).tolist(),
                     "without_field": (without / without[1]).tolist(),
                     "published": (published[:, index] / published[1, index]).tolist(),
                     "residual": float(error[strong]),
                     "residual_without_field": float(plain_error[strong])})
    return {"rows": rows, "model_error": model_error, "chi_square": chi_square}


def log_distance(rows: list[dict[str, Any]], name: str) -> float:
    """Rms of log(ratio / published ratio) of red and blue to green over the filters from 450 to 650
    nm.
    """
    ratios = [np.log(row[name][band] / row["published"][band]) for row in rows
              if 450 <= row["filter_nm"] <= 650
              for band in (0, 2)]
    return float(np.sqrt(np.mean(np.square(ratios))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with flea3_chart/")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    figures = measure(arguments.data)
    if arguments.json:
        print(json.dumps(figures))
        return
    print("response relative to green; rms residual of the strongest colour, share of its maximum")
    print(f"{'filter':>7}" + "".join(f"{f'{colour} {name}':>10}" for colour in "RB"
                                     for name in ("sensor", "fitted", "joint", "cameras"))
          + f"{'residual':>10}{'no field':>10}")
    names = ("published", "ours", "joint", "cameras_mean")
    for row in figures["rows"]:
        print(f"{row['filter_nm']:5d}nm" + "".join(f"{row[name][band]:10.3f}" for band in (0, 2)
                                                   for name in names)
              + f"{row['residual']:10.3f}{row['residual_without_field']:10.3f}")
    for name in names[1:]:
        print(f"{name:<13}rms of log(ratio / sensor.mat), 450-650 nm: "
              f"{log_distance(figures['rows'], name):.2f}")
    print(f"joint estimate: photos and model disagree by {figures['model_error']:.1%}, "
          f"chi-square {figures['chi_square']:.1f} per signal")


if __name__ == "__main__":
    main()
