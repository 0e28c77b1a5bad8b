"""Figure 3: what light reflected twice tells of two surfaces that face each other (self- and mutual
reflection).

Analytic: each surface's direct signal, that of light reflected twice off it, and of light reflected
off both, relative to white, with 0.5 % noise. The paper ranks pairs of draws by these (Eq. 10); the
joint posterior obeys them within their noise. Pairs of chart colours; figure 7 does the same
through rendered light transport.
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.records.scenes import RegionTransport
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.radiometry.spectra.named_spectra import relative_response, test_reflectances
from spectrabox.sampling.draw_methods import draw_spectra
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.published.baselines import best_by_signals
from spectrabox.sampling.scene.joint_posterior import joint_problem
from spectrabox.sampling.scene.joint_sampling import sample_joint

FINE = visible_grid(1)
NOISE, DRAWS, KEPT, COEFFICIENTS = 0.005, 20_000, 1_000, 7
# of the chart, from 0
PAIRS = ((12, 14), (13, 14), (12, 15), (6, 7), (5, 16), (3, 8), (9, 10), (4, 11))
PRODUCTS = {"direct": [[1, 0], [0, 1]], "and self": [[1, 0], [0, 1], [2, 0], [0, 2]],
            "and self, mutual": [[1, 0], [0, 1], [2, 0], [0, 2], [1, 1]]}


def measured(truths: np.ndarray, response: np.ndarray,
             rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Signals (5, 3) of all products of two reflectances (2, 61), and their standard errors."""
    exponents = np.array(PRODUCTS["and self, mutual"])
    clean = np.exp(exponents @ np.log(truths)) @ response.T
    return clean * (1 + NOISE * rng.standard_normal(clean.shape)), NOISE * clean


def by_paper(signals: np.ndarray, response: np.ndarray, products: str) -> np.ndarray:
    """Draws (1000, 2, 61) around one solution each; beyond the direct light, pairs ranked by Eq.
    10.
    """
    pair = []
    for seed, signal in enumerate(signals[:2]):
        measurement = SpectralMeasurement(PRIOR_GRID, response, signal, np.zeros((3, 3)))
        pair.append(draw_spectra(measurement, "paper", DRAWS, seed, COEFFICIENTS).spectra)
    both = np.stack(pair, axis=1)
    if products == "direct":
        return both[:KEPT]
    seen = [both[:, 0]**2, both[:, 1]**2] + ([both[:, 0] * both[:, 1]]
                                             if products == "and self, mutual" else [])
    found = np.stack([one @ response.T for one in seen], axis=1)
    return both[best_by_signals(found, signals[2:2 + len(seen)], KEPT)]


def by_posterior(signals: np.ndarray, errors: np.ndarray, response: np.ndarray,
                 products: str) -> np.ndarray:
    """Draws (T, 2, 61) of the joint posterior under the learnt prior."""
    exponents = np.array(PRODUCTS[products])
    count = len(exponents)
    first = np.zeros(count, int)        # the surface of no region counts
    regions = RegionTransport(("one", "other"), exponents, np.eye(count), signals[:count],
                              errors[:count], first, first, 0.0, 0.0)
    return sample_joint(joint_problem(regions, response, load_prior()), 0)[0]


def picture(shown: dict[str, np.ndarray], truths: np.ndarray, path: Path) -> None:
    """Means and bands of both surfaces of the first pair, by method and products."""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(10, 5.4), sharex=True, sharey=True)
    for axis, (name, spectra) in zip(axes.ravel(), shown.items(), strict=True):
        for surface, colour in enumerate(("tab:blue", "tab:red")):
            lower, upper = np.quantile(spectra[:, surface], [0.025, 0.975], axis=0)
            axis.fill_between(PRIOR_GRID.nm, lower, upper, color=colour, alpha=0.2)
            axis.plot(PRIOR_GRID.nm, spectra[:, surface].mean(axis=0), color=colour, linestyle="--")
            axis.plot(PRIOR_GRID.nm, truths[surface], color=colour)
        axis.set(ylim=(0, 1))
        axis.set_title(name, fontsize=9)
    figure.supxlabel("wavelength (nm)")
    figure.supylabel("reflectance: truth (line), mean (dashed), 95 % of draws")
    figure.tight_layout()
    figure.savefig(path, dpi=80)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("figure_3.png"))
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    response = relative_response("CIE 1931 2 Degree Standard Observer", "D65",
                                 FINE) @ interpolation_matrix(PRIOR_GRID.nm, FINE.nm)
    chart = np.clip(test_reflectances(PRIOR_GRID)["BabelColor Average"], 0.002, 0.998)
    found: dict[tuple[str, str], list[tuple[float, ...]]] = {}
    shown: dict[str, np.ndarray] = {}
    for number, pair in enumerate(PAIRS):
        truths = chart[list(pair)]
        signals, errors = measured(truths, response, np.random.default_rng(number))
        for products in PRODUCTS:
            for method, spectra in (("paper", by_paper(signals, response, products)),
                                    ("joint posterior", by_posterior(signals, errors, response,
                                                                     products))):
                lower, upper = np.quantile(spectra, [0.025, 0.975], axis=0)
                error = np.sqrt(np.mean((spectra.mean(axis=0) - truths)**2, axis=1)).mean()
                held = np.mean((truths >= lower) & (truths <= upper))
                found.setdefault((method, products),
                                 []).append((error, held, float(np.mean(upper - lower))))
                if number == 0:
                    first = "direct " if products != "direct" else ""
                    shown[f"{method}, {first}{products}"] = spectra
    table = [{"method": method, "products": products, "pairs": len(rows), **dict(zip(
        ("rmse", "coverage_95", "width"), map(float, np.mean(rows, axis=0)), strict=True))}
        for (method, products), rows in sorted(found.items(), key=lambda row: row[0][0],
                                               reverse=True)]
    picture(dict(sorted(shown.items(), key=lambda one: one[0].startswith("joint"))),
            chart[list(PAIRS[0])], arguments.out)
    if arguments.json:
        print(json.dumps({"rows": table, "picture": str(arguments.out)}))
        return
    print("Paper: self-reflection brings the sampled spectra nearer to the truth.")
    print(f"{'method':<16} {'products':<16} {'RMSE':>7} {'95 % holds':>11} {'width':>6}")
    for row in table:
        print(f"{row['method']:<16} {row['products']:<16} {row['rmse']:7.4f} "
              f"{row['coverage_95']:11.3f} {row['width']:6.3f}")


if __name__ == "__main__":
    main()
