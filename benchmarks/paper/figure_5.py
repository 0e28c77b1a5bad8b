"""Figure 5: refining the basis against sampling the fine basis directly, over the 24 chart colours.

Read literally (Eq. 16) one lifted solution gets residual draws ("as published"); "refined" gives
every coarse draw its own. Only nested knots.
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from spectrabox.radiometry.grid import basis_matrix, visible_grid
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.radiometry.spectra.named_spectra import relative_response, test_reflectances
from spectrabox.sampling.polytope.refinement import sample_refined
from spectrabox.sampling.polytope.tilted_rejection import sample_polytope
from spectrabox.sampling.published.baselines import refined_as_published
from spectrabox.sampling.spectral_measurement import spline_operator
from spectrabox.sampling.uniform import into_reach

FINE = visible_grid(1)
NM = FINE.nm[::5]


SHOWN = 1       # of the chart: light skin


def picture(shown: dict[str, np.ndarray], truth: np.ndarray, path: Path) -> None:
    """Mean and 95 % band of every way to the finest basis, for one colour."""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(shown), figsize=(3.2 * len(shown), 3.2), sharey=True)
    for axis, (name, spectra) in zip(axes, shown.items(), strict=True):
        lower, upper = np.quantile(spectra, [0.025, 0.975], axis=0)
        axis.fill_between(NM, lower, upper, color="0.85", label="95 % of draws")
        axis.plot(NM, spectra.mean(axis=0), color="tab:green", label="mean")
        axis.plot(NM, truth, color="black", label="measured")
        axis.set(title=name, xlabel="wavelength (nm)", ylim=(0, 1))
    axes[0].set_ylabel("reflectance")
    axes[0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=80)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", nargs="+", default=["5:9", "7:11", "7:15"], help="coarse:fine")
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--out", type=Path, default=Path("figure_5.png"))
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    response = relative_response("CIE 1931 2 Degree Standard Observer", "D65", FINE)
    truths = test_reflectances(FINE)["BabelColor Average"]
    table = []
    for pair in arguments.pairs:
        shown: dict[str, np.ndarray] = {}
        coarse, fine = (int(part) for part in pair.split(":"))
        found: dict[str, list[tuple[float, float, float]]] = {"coarse": [], "as published": [],
                                                              "refined": [],
                                                              "fine": []}
        for index, truth in enumerate(truths):
            exact = SpectralMeasurement(FINE, response, response @ truth, np.zeros((3, 3)))
            measured = {count: into_reach(spline_operator(exact, count))[0]
                        for count in (coarse, fine)}
            draws = {"coarse": sample_polytope(measured[coarse], arguments.draws, 0)[0],
                     "as published": refined_as_published(exact, coarse, fine, arguments.draws, 0),
                     "refined": sample_refined(exact, measured[coarse], fine, arguments.draws, 0),
                     "fine": sample_polytope(measured[fine], arguments.draws, 0)[0]}
            for name, c in draws.items():
                spectra = c @ basis_matrix(NM, c.shape[1]).T
                if index == SHOWN:
                    shown[f"{name}, N = {c.shape[1]}"] = spectra
                lower, upper = np.quantile(spectra, [0.025, 0.975], axis=0)
                held = np.mean((truth[::5] >= lower) & (truth[::5] <= upper))
                error = np.sqrt(np.mean((spectra.mean(axis=0) - truth[::5])**2))
                found[name].append((float(error), float(held), float(np.mean(upper - lower))))
        for name, values in found.items():
            rmse, held, width = np.mean(values, axis=0)
            table.append({"pair": pair, "sampled": name, "rmse": rmse, "coverage_95": held,
                          "width": width})
    picture(shown, truths[SHOWN][::5], arguments.out)
    if arguments.json:
        print(json.dumps({"rows": table, "picture": str(arguments.out)}))
        return
    print("Paper: refining the basis improves on sampling the fine basis directly.")
    print(f"{'pair':<6} {'sampled':<12} {'RMSE':>7} {'95 % holds':>11} {'width':>6}")
    for row in table:
        print(f"{row['pair']:<6} {row['sampled']:<12} {row['rmse']:7.4f} "
              f"{row['coverage_95']:11.3f} {row['width']:6.3f}")


if __name__ == "__main__":
    main()
