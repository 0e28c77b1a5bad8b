"""Figure 2: how well B-splines of N = 5 to 21 coefficients in [0, 1] fit measured spectra, library
by library.
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.grid import basis_matrix
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.sampling.evaluation.metrics import rmse
from spectrabox.sampling.prior.libraries import read_library
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.spectral_measurement import nearest_splines

SIZES = (5, 7, 9, 11, 13, 15, 21)
SHOWN = (5, 7, 13)
EXAMPLES = {"NIST CQS test colours": 11, "BabelColor Average": 13, "CES99": 40}


def picture(sets: dict[str, np.ndarray], table: list[dict[str, Any]], path: Path) -> None:
    """Three measured spectra with their fits, and the error of every library against N."""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 4, figsize=(14, 3.4))
    for axis, (name, index) in zip(axes, EXAMPLES.items(), strict=False):
        curve = sets[name][index]
        axis.plot(PRIOR_GRID.nm, curve, color="black", linewidth=2, label="measured")
        for count in SHOWN:
            basis = basis_matrix(PRIOR_GRID.nm, count)
            axis.plot(PRIOR_GRID.nm, basis @ nearest_splines(curve[None], basis)[0],
                      label=f"N = {count}")
        axis.set(title=f"{name}, {index + 1}", xlabel="wavelength (nm)", ylabel="reflectance",
                 ylim=(0, 1))
    axes[0].legend(fontsize=8)
    colours = plt.get_cmap("tab20").colors  # type: ignore[attr-defined]
    for row, colour in zip(table, colours, strict=False):
        axes[3].semilogy(SIZES, [row[f"N={count}"][1] for count in SIZES], marker=".", color=colour,
                         label=row["library"])
    axes[3].set(title="95 % quantile of the RMSE", xlabel="coefficients N", xticks=SIZES)
    axes[3].legend(fontsize=8, loc="center left", bbox_to_anchor=(1.02, 0.5), frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=80)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path,
                        help="folder with reflectance/; without it the shipped sets alone")
    parser.add_argument("--out", type=Path, default=Path("figure_2.png"))
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    sets = dict(test_reflectances(PRIOR_GRID))
    if arguments.data is not None:
        folders = sorted(path for path in (arguments.data / "reflectance").iterdir()
                         if path.is_dir())
        sets = {folder.name: read_library(folder) for folder in folders} | sets
    table: list[dict[str, Any]] = []
    for name, curves in sets.items():
        errors = {count: rmse(nearest_splines(curves, basis) @ basis.T, curves)
                  for count in SIZES for basis in [basis_matrix(PRIOR_GRID.nm, count)]}
        table.append({"library": name, "curves": len(curves),
                      **{f"N={count}": [float(np.median(values)), float(np.quantile(values, 0.95))]
                         for count, values in errors.items()}})
    picture(sets, table, arguments.out)
    if arguments.json:
        print(json.dumps({"rows": table, "picture": str(arguments.out)}))
        return
    print("Paper: more coefficients fit better; paints need fewer than natural spectra. RMSE, "
          "median / 95 % quantile:")
    print(f"{'library':<24} {'n':>5} " + " ".join(f"{'N=' + str(count):>15}" for count in SIZES))
    for row in table:
        print(f"{row['library']:<24} {row['curves']:5d} "
              + " ".join(f"{row[f'N={count}'][0]:7.4f}/{row[f'N={count}'][1]:.4f} "
                         for count in SIZES))
    if arguments.data is None:
        print(
            "missing: the measured libraries; give the folder that holds reflectance/ with --data")


if __name__ == "__main__":
    main()
