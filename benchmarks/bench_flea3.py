"""Colour bands of a real industrial camera from a chart with measured patches, under seven band-pass filters.

A FLIR Flea3 (Bayer, 8 bit) photographed a ColorChecker through seven filters; a spectroradiometer measured that very
chart and the filters. For every filter and colour the response is found by least squares (patch signal = response x
field x filter-weighted reflectance, a quadratic log field) and compared with ``sensor.mat``, the response map that the
authors of the data published; both are divided by green under the same filter, for their exposures are not comparable.
The alternative is the same fit without the field.
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

from calibrate.chart_photo import field_terms
from radiometry.spectrum_files import read_table

FILTERS = (400, 450, 500, 550, 600, 650, 700)
FILTER_COLUMNS = ("400 nm", "442 nm", "500 nm", "550 nm", "600 nm", "650 nm", "700 nm")
TILE = {"G": ((0, 0), (1, 1)), "B": ((0, 1),), "R": ((1, 0),)}      # GBRG
MARGIN_PX = 2


def patch_means(folder: Path, nm: int) -> tuple[np.ndarray, np.ndarray]:
    """Signals (24, 3) in R, G, B and places (24, 2) of the patches under one filter."""
    mosaic = loadmat(folder / "hdr_averaged_images" / f"d2_colorChecker30cm_{nm}nm.mat")["I_raw"]
    labels = cv2.imread(str(folder / "colorChecker_labels" / "d2_colorChecker30cm_550nm_labels.png"), -1)
    signals, places = np.empty((24, 3)), np.empty((24, 2))
    for patch in range(24):
        inside = cv2.erode((labels == patch + 1).astype(np.uint8), np.ones((2 * MARGIN_PX + 1,) * 2)).astype(bool)
        places[patch] = np.argwhere(inside).mean(axis=0)[::-1]
        for band, colour in enumerate("RGB"):
            values = [mosaic[row::2, column::2][inside[row::2, column::2]] for row, column in TILE[colour]]
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

    start = np.r_[np.log(np.maximum(signals.sum(axis=0) / weighted.sum(), 1e-9)), np.zeros(terms.shape[1])]
    found = least_squares(residual, start)
    return np.exp(found.x[:3]), np.sqrt(np.mean(residual(found.x).reshape(24, 3) ** 2, axis=0))


def measure(data: Path) -> list[dict[str, Any]]:
    """One row per filter."""
    folder = data / "flea3_chart"
    table = read_table(folder / "spectra_averaged.csv")
    columns = dict(zip(table.names, table.values, strict=True))
    chart = np.array([values for name, values in columns.items()][9 + 2:9 + 2 + 24])
    published = loadmat(folder / "multispectral_images" / "sensor.mat")["sensor_map"]
    rows = []
    for index, (nm, column) in enumerate(zip(FILTERS, FILTER_COLUMNS, strict=True)):
        visible = (table.nm >= 380) & (table.nm <= 780)
        weighted = chart[:, visible] @ columns[column][visible]
        signals, places = patch_means(folder, nm)
        with_field, error = responses(signals, weighted, places, True)
        without, plain_error = responses(signals, weighted, places, False)
        strong = int(signals.max(axis=0).argmax())
        rows.append({"filter_nm": nm, "ours": (with_field / with_field[1]).tolist(),
                     "without_field": (without / without[1]).tolist(),
                     "published": (published[:, index] / published[1, index]).tolist(),
                     "residual": float(error[strong]), "residual_without_field": float(plain_error[strong])})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with flea3_chart/")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    rows = measure(arguments.data)
    if arguments.json:
        print(json.dumps({"rows": rows}))
        return
    print("response relative to green: fitted / published; rms residual of the strongest colour, share of its maximum")
    print(f"{'filter':>7}{'R fitted':>10}{'R sensor':>10}{'B fitted':>10}{'B sensor':>10}{'residual':>10}"
          f"{'no field':>10}{'ratio':>7}")
    for row in rows:
        print(f"{row['filter_nm']:5d}nm{row['ours'][0]:10.3f}{row['published'][0]:10.3f}{row['ours'][2]:10.3f}"
              f"{row['published'][2]:10.3f}{row['residual']:10.3f}{row['residual_without_field']:10.3f}"
              f"{row['residual_without_field'] / row['residual']:7.1f}")


if __name__ == "__main__":
    main()
