"""Copies the published tables from colour-science, and measured cameras and charts from folders.

``python -m spectrabox.radiometry.published.make_tables [cameras | copies | trade FOLDER]``; the
folders hold the cameras of rawtoaces-data; the measured copies of the Classic,
``spectra_averaged.csv`` and ``beyondrgb_cc_classic.csv``; and BeyondRGB's other reference data. The
same sources give the same files, byte for byte.
"""
from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np

from spectrabox.radiometry.published import published_tables

ALIASES = ("babel_average", "cc_ohta")  # second names of charts
# charts of which colours alone are published, and one whose colours others are compared with
COLOURED = ("ColorCheckerSG - After November 2014", "ColorChecker24 - Before November 2014",
            "ColorChecker24 - After November 2014")
# measured copies of the ColorChecker Classic, and the files of them
COPIES_OF_CLASSIC = {"copy of August 2016": "spectra_averaged.csv",
                     "used copy": "beyondrgb_cc_classic.csv"}
KEPT_NM = (380.0, 730.0)
# Charts of BeyondRGB by the names of its files: what its references are called here
TRADE_NAMES = {"CCSG": "BeyondRGB Digital SG", "NGT": "BeyondRGB NGT", "APT": "BeyondRGB APT"}
LEFT_OUT = ("Nikon D5100",)     # colour-science has its curves, and the demos photograph with them


def tables_of_colour_science() -> dict[str, np.ndarray]:
    """Every table by kind and name: (1 + K, P), wavelengths in nm first; of colours X, Y, Z."""
    import colour

    tables = {}
    for name, curves in {**colour.MSDS_CMFS, **colour.MSDS_CAMERA_SENSITIVITIES}.items():
        tables[f"{published_tables.OBSERVERS}/{name}"] = np.vstack(
            [curves.wavelengths, curves.values.T])
    for name, curve in {**colour.SDS_LIGHT_SOURCES, **colour.SDS_ILLUMINANTS}.items():
        tables[f"{published_tables.LIGHTS}/{name}"] = np.vstack([curve.wavelengths, curve.values])
    for name, patches in {**colour.SDS_COLOURCHECKERS}.items():
        if name not in ALIASES:
            curves = list(patches.values())
            tables[f"{published_tables.CHARTS}/{name}"] = np.vstack([curves[0].wavelengths,
                                                    *(patch.values for patch in curves)])
    for name in COLOURED:
        chart = colour.CCS_COLOURCHECKERS[name]
        tables[f"{published_tables.COLOURS}/{name}"] = colour.xyY_to_XYZ(
            np.array(list(chart.data.values()))).T
    return tables


def tables_of_rawtoaces(folder: Path) -> dict[str, np.ndarray]:
    """Every camera of a folder by kind and name: (1 + K, P), wavelengths in nm first."""
    tables = {}
    for path in sorted(folder.glob("*.json")):
        stored = json.loads(path.read_text(encoding="utf-8"))
        name = f"{stored['header']['manufacturer']} {stored['header']['model']}"
        rows = stored["spectral_data"]["data"]["main"]
        if name not in LEFT_OUT:
            tables[f"{published_tables.CAMERAS}/{name}"] = np.vstack([[float(nm) for nm in rows],
                                                     np.transpose(list(rows.values()))])
    return tables


def tables_of_copies(folder: Path) -> dict[str, np.ndarray]:
    """Every measured copy of a chart by kind and name: (1 + I, P), wavelengths in nm first.

    Parameters
    ----------
    folder : Path
        That holds the files of ``COPIES_OF_CLASSIC``; patches from the column "dark skin" on.
    """
    tables = {}
    for name, file in COPIES_OF_CLASSIC.items():
        with (folder / file).open(encoding="utf-8", newline="") as stored:
            header, *rows = csv.reader(stored)
        first = header.index("dark skin")
        values = np.array(rows, float)
        kept = values[(values[:, 0] >= KEPT_NM[0]) & (values[:, 0] <= KEPT_NM[1])]
        tables[f"{published_tables.COPIES}/{name}"] = np.column_stack(
            [kept[:, 0], kept[:, first:first + 24]]).T
    return tables


def tables_of_beyondrgb(folder: Path) -> dict[str, np.ndarray]:
    """Every chart of a folder by kind and name: (1 + I, P), wavelengths in nm first, then the
    patches row by row; in the files, a letter for the column comes before the number of the row.
    """
    tables = {}
    for short, name in TRADE_NAMES.items():
        path = next(folder.glob(f"*{short}_Reflectance_Data.csv"))
        (_, *names), *rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
        values = np.array([[float(value) for value in row[:len(names) + 1]] for row in rows]).T
        row_by_row = sorted(range(len(names)), key=lambda index: (
            int(names[index].partition(":")[2]), names[index]))
        tables[f"{published_tables.TRADE}/{name}"] = np.vstack([values[0], values[1:][row_by_row]])
    return tables


if __name__ == "__main__":
    if sys.argv[1:]:
        file, tables_of = {"cameras": (published_tables.CAMERAS_FILE, tables_of_rawtoaces),
                           "copies": (published_tables.COPIES_FILE, tables_of_copies),
                           "trade": (published_tables.TRADE_FILE, tables_of_beyondrgb)}[sys.argv[1]]
        np.savez_compressed(file, **tables_of(Path(sys.argv[2])))  # type: ignore[arg-type]
    else:
        np.savez_compressed(published_tables.FILE, **tables_of_colour_science())  # type: ignore[arg-type]
