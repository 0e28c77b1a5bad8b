"""Figure 9: against an image-based result, a hyperspectral picture judged by the same measures.

The paper compares with MST++, whose weights are not at hand. In its place stands a stated stand-in:
a multilayer perceptron (scikit-learn, 3-64-64-31) that maps an RGB pixel to 31 reflectances, fitted
on measured spectra at random brightness, as such networks are fitted on pictures. It is presumably
weaker than MST++: it sees no neighbours. What the comparison is about holds for both: a picture
alone does not tell shading from reflectance. The scene is a row of shaded patches of the chart. Our
methods see the same pixels divided by their shading, which rendering knows from the geometry.
"""
from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor

from spectrabox.measure.signals.sample import measurement_of_signal
from spectrabox.radiometry.grid import grid_from_nm, interpolation_matrix, visible_grid
from spectrabox.radiometry.spectra.named_spectra import relative_response, test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import on_grid, read_table
from spectrabox.sampling.draw_methods import METHODS, draw_spectra
from spectrabox.sampling.evaluation.metrics import (
    BAND_SCORES,
    ScoredSpectrum,
    judged,
    judgement_text,
)
from spectrabox.sampling.prior.libraries import read_library
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior

NM = np.arange(400, 701, 10.0)
TRAINING = ("CES99", "NIST CQS test colours", "CIE 13.3 test colours")
SIDE, NOISE, DARKEST = 40, 0.005, 0.35
OBSERVER, LIGHT = "CIE 1931 2 Degree Standard Observer", "D65"
LIGHTS = ("D65", "A", "FL11")       # of the colour differences
SAMPLES, SEED, COEFFICIENTS = 2000, 0, 7
KEPT = 2000                         # pixels of a region whose scatter is the picture's band


def fine_response() -> np.ndarray:
    """Response (3, 301) of the observer under its light."""
    return relative_response(OBSERVER, LIGHT, visible_grid(1))


def response() -> np.ndarray:
    """Response (3, 61)."""
    return fine_response() @ interpolation_matrix(PRIOR_GRID.nm, visible_grid(1).nm)


@dataclass(frozen=True)
class Judgement:
    """Regions of a picture: their pixels (n, C), scores by region and method, and averages."""

    pixels: list[np.ndarray]
    scored: list[ScoredSpectrum]
    averages: list[ScoredSpectrum]


def judge_picture(regions: Sequence[np.ndarray], nm: np.ndarray, names: Sequence[str],
                  truths: np.ndarray, signals: Sequence[np.ndarray],
                  noise: np.ndarray | None = None) -> Judgement:
    """The spectra of a picture's regions, and our methods beside them, against the truth.

    Parameters
    ----------
    regions : sequence of (n, C) arrays
        Pixels, as reflectances at ``nm``.
    nm : (C,) array
    names : sequence of str
    truths : (R, 61) array
    signals : sequence of (3,) arrays
        What our methods see of each region.
    noise : (3,) array, optional
        Standard errors of these.
    """
    rng, prior = np.random.default_rng(SEED), load_prior()
    scored = []
    for pixels, name, truth, signal in zip(regions, names, truths, signals, strict=True):
        kept = pixels[np.sort(rng.choice(len(pixels), min(KEPT, len(pixels)), replace=False))]
        imported = on_grid(nm, np.vstack([pixels.mean(axis=0), kept]), grid_from_nm(PRIOR_GRID.nm),
                           name)
        by_method = {"imported picture": (imported[0], imported[1:])}
        measurement = measurement_of_signal(fine_response(), signal, noise=noise)
        for method in tuple(METHODS)[::-1]:
            spectra = draw_spectra(measurement, method, SAMPLES, SEED, COEFFICIENTS, prior).spectra
            by_method[method] = (spectra.mean(axis=0), spectra)
        scored += [(name, method, judged(PRIOR_GRID.nm, truth, mean, LIGHTS, draws))
                   for method, (mean, draws) in by_method.items()]
    return Judgement(list(regions), scored, averaged(scored))


def averaged(rows: Sequence[ScoredSpectrum]) -> list[ScoredSpectrum]:
    """One row a method: its scores averaged over the regions."""
    averages = []
    for method in dict.fromkeys(method for _, method, _ in rows):
        mine = [scores for _, one, scores in rows if one == method]
        means: dict[str, Any] = {
            key: float(np.mean([one[key] for one in mine]))
            for key in ("rmse", "spectral_angle", "rmse_best_scale", *dict(BAND_SCORES))}
        means["delta_e00"] = {light: float(np.mean([one["delta_e00"][light] for one in mine]))
                              for light in LIGHTS}
        averages.append((f"mean of {len(mine)}", method, means))
    return averages


def network(curves: np.ndarray, rng: np.random.Generator) -> MLPRegressor:
    """The stand-in, fitted on mixtures of measured curves (n, 61) at random brightness."""
    share = rng.random((20_000, 1))
    pairs = rng.integers(len(curves), size=(20_000, 2))
    mixed = (share * curves[pairs[:, 0]] + (1 - share) * curves[pairs[:, 1]]) * rng.uniform(DARKEST,
                                                                                            1,
                                                                                            (20_000,
                                                                                             1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)     # 60 rounds are what it gets
        layers = MLPRegressor(hidden_layer_sizes=(64, 64), max_iter=60, random_state=0)
        return layers.fit(mixed @ response().T, mixed[:, ::2])


def shading() -> np.ndarray:
    """Shading (1, 40, 1) of a patch, from light to dark as of a rounded thing."""
    return np.linspace(1, DARKEST, SIDE)[None, :, None]


def shaded_picture(chart: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """RGB (40, 40 n, 3) of shaded patches (n, 61), with the noise of every pixel."""
    lit = shading() * np.ones((SIDE, 1, 1))
    picture = np.concatenate([lit * (curve @ response().T) for curve in chart], axis=1)
    return picture * (1 + NOISE * rng.standard_normal(picture.shape))


def picture(judgement: Judgement, chart: np.ndarray, signals: list[np.ndarray],
            path: Path) -> None:
    """Mean and scatter of the imported picture beside mean, band and draws of the learnt prior, for
    three patches.
    """
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 4, figsize=(13, 3.4))
    prior = load_prior()
    for axis, index in zip(axes, (6, 13, 15), strict=False):
        mean = judgement.pixels[index].mean(axis=0)
        spread = judgement.pixels[index].std(axis=0, ddof=1)
        measurement = measurement_of_signal(fine_response(), signals[index],
                                            noise=np.full(3, NOISE / SIDE))
        draws = draw_spectra(measurement, "prior", SAMPLES, SEED, COEFFICIENTS, prior).spectra
        axis.fill_between(PRIOR_GRID.nm, *np.quantile(draws, [0.025, 0.975], axis=0),
                          color="tab:green",
                          alpha=0.2)
        axis.plot(PRIOR_GRID.nm, draws[:10].T, color="tab:green", linewidth=0.4)
        axis.plot(PRIOR_GRID.nm, draws.mean(axis=0), color="tab:green",
                  label="learnt prior, 95 % and ten draws")
        axis.fill_between(NM, mean - spread, mean + spread, color="tab:orange", alpha=0.2)
        axis.plot(NM, mean, color="tab:orange", label="stand-in network, sd over pixels")
        axis.plot(PRIOR_GRID.nm, chart[index], color="black", label="measured")
        axis.set(title=f"patch {index + 1}", xlabel="wavelength (nm)", ylabel="reflectance",
                 ylim=(0, 1))
    axes[0].legend(fontsize=7)
    averages = {method: scores for _, method, scores in judgement.averages}
    names = list(averages)
    for offset, key in enumerate(("rmse", "rmse_best_scale")):
        axes[3].bar(np.arange(len(names)) + 0.4 * offset,
                    [averages[name][key] for name in names], 0.4, label=("RMSE", "after the "
                                                                               "best scale")[
                        offset])
    axes[3].set_xticks(np.arange(len(names)) + 0.2, ["network", *names[1:]])
    axes[3].set_title("mean of 24 patches")
    axes[3].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path, dpi=80)


def filter_wheel(data: Path) -> str:
    """The real cube of the data folder: a chart behind seven filters, relative to its white
    patch.
    """
    import cv2
    from scipy.io import loadmat
    folder = data / "flea3_chart"
    truths = read_table(folder / "spectra_averaged.csv")
    names = truths.names[11:35]
    cube = loadmat(folder / "multispectral_images" / "d2_colorChecker30cm_dHyper.mat")["I_hyper"]
    labels = cv2.imread(str(folder / "colorChecker_labels"
                            / "d2_colorChecker30cm_550nm_labels.png"), -1)
    known = np.array([truths.values[truths.names.index(name)] for name in names])
    nm, white = np.arange(400, 701, 50.0), 18
    regions = [cube[labels == label].astype(float) for label in range(1, 25)]
    factor = known[white, np.searchsorted(truths.nm, nm)] / regions[white].mean(axis=0)
    on_each_nm = known[:, np.searchsorted(truths.nm, visible_grid(1).nm)]
    judgement = judge_picture([pixels * factor for pixels in regions], nm, names,
                              known[:, np.searchsorted(truths.nm, PRIOR_GRID.nm)],
                              list(on_each_nm @ fine_response().T))
    return judgement_text(judgement.scored + judgement.averages)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="folder with reflectance/ to fit on, and "
                        "flea3_chart, a real picture")
    parser.add_argument("--out", type=Path, default=Path("figure_9.png"))
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    rng, sets = np.random.default_rng(9), test_reflectances(PRIOR_GRID)
    curves = np.concatenate([sets[name] for name in TRAINING])
    if arguments.data is not None:
        folders = sorted(path for path in (arguments.data / "reflectance").iterdir()
                         if path.is_dir())
        curves = np.concatenate([curves, *(read_library(folder) for folder in folders)])
    chart = sets["BabelColor Average"]
    rgb = shaded_picture(chart, rng)
    cube = np.clip(network(curves, rng).predict(rgb.reshape(-1, 3)), 0, 1).reshape(*rgb.shape[:2],
                                                                                   NM.size)
    columns = [slice(SIDE * index, SIDE * (index + 1)) for index in range(24)]
    signals = [(rgb[:, each] / shading()).mean(axis=(0, 1)) for each in columns]
    judgement = judge_picture([cube[:, each].reshape(-1, NM.size) for each in columns], NM,
                              [f"patch {index + 1}" for index in range(24)], chart, signals,
                              np.full(3, NOISE / SIDE))
    text = judgement_text(judgement.scored + judgement.averages)
    picture(judgement, chart, signals, arguments.out)
    if arguments.json:
        print(json.dumps({"means": {method: scores
                                    for _, method, scores in judgement.averages},
                          "fitted_on": len(curves), "picture": str(arguments.out)}))
        return
    print("Paper: the spectra of an image-based network (MST++) are far from the truth. Stand-in "
          f"network, fitted on {len(curves)} spectra:")
    print("\n".join(line for line in text.splitlines() if line.startswith(("region", "mean of"))))
    if arguments.data is None:
        print("missing: measured libraries to fit on and a real picture; give the folder that "
              "holds reflectance/ and flea3_chart/ with --data")
    elif (arguments.data / "flea3_chart").is_dir():
        print("A real picture made elsewhere: a chart behind seven filters (ours: RGB of the "
              "truth, no filters):")
        print("\n".join(line for line in filter_wheel(arguments.data).splitlines()
                        if line.startswith(("region", "mean of"))))


if __name__ == "__main__":
    main()
