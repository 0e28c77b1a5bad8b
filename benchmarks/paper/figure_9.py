"""Figure 9: against an image-based result, imported as a hyperspectral picture and judged by the
same measures.

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
import tempfile
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor

from spectrabox.measure.signals.options import JudgeOptions
from spectrabox.measure.signals.picture_judgement import PictureJudgement, judge_picture
from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.radiometry.spectra.named_spectra import relative_response, test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import read_table
from spectrabox.sampling.draw_methods import draw_spectra
from spectrabox.sampling.evaluation.cube_regions import CubeRegion, read_regions
from spectrabox.sampling.evaluation.cubes import open_cube
from spectrabox.sampling.evaluation.scores_by_method import judgement_text
from spectrabox.sampling.prior.libraries import read_library
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior

NM = np.arange(400, 701, 10.0)
TRAINING = ("CES99", "NIST CQS test colours", "CIE 13.3 test colours")
SIDE, NOISE, DARKEST = 40, 0.005, 0.35
OBSERVER, LIGHT = "CIE 1931 2 Degree Standard Observer", "D65"
OPTIONS = JudgeOptions(("D65", "A", "FL11"), samples=2000, seed=0, coefficients=7)


def fine_response() -> np.ndarray:
    """Response (3, 301) of the observer under its light."""
    return relative_response(OBSERVER, LIGHT, visible_grid(1))


def response() -> np.ndarray:
    """Response (3, 61)."""
    return fine_response() @ interpolation_matrix(PRIOR_GRID.nm, visible_grid(1).nm)


def signal_noise() -> np.ndarray:
    """Covariance (3, 3) of the mean of a patch's pixels."""
    return np.eye(3) * (NOISE / SIDE) ** 2


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


def picture(judgement: PictureJudgement, chart: np.ndarray, signals: list[np.ndarray],
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
        mean = judgement.regions[index].mean
        spread = judgement.regions[index].standard_deviation
        measurement = SpectralMeasurement(visible_grid(1), fine_response(), signals[index],
                                          signal_noise())
        draws = draw_spectra(measurement, "prior", OPTIONS.samples, OPTIONS.seed,
                             OPTIONS.coefficients, prior).spectra
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
    averages = {row["method"]: row for row in judgement.means}
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
    folder = data / "flea3_chart"
    truths = read_table(folder / "spectra_averaged.csv")
    names = truths.names[11:35]
    cube = open_cube(folder / "multispectral_images" / "d2_colorChecker30cm_dHyper.mat",
                     np.arange(400, 701, 50.0))
    mask = folder / "colorChecker_labels" / "d2_colorChecker30cm_550nm_labels.png"
    with tempfile.TemporaryDirectory() as scratch:
        toml = Path(scratch) / "regions.toml"
        (Path(scratch) / "labels.png").write_bytes(mask.read_bytes())
        toml.write_text("".join(f'[regions."{name}"]\nmask = "labels.png"\nlabel = {index}\n'
                                for index, name in enumerate(names, 1)))
        regions = read_regions(toml, cube.width, cube.height,
                               lambda path: np.asarray(cv2.imread(str(path), -1)))
    judgement = judge_picture(cube, regions, truths, fine_response(), load_prior(),
                              replace(OPTIONS, white_region=names[18]))
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
        curves = np.concatenate([curves, *(read_library(folder).reflectances
                                           for folder in folders)])
    chart = sets["BabelColor Average"]
    rgb = shaded_picture(chart, rng)
    cube = np.clip(network(curves, rng).predict(rgb.reshape(-1, 3)), 0, 1).reshape(*rgb.shape[:2],
                                                                                   NM.size)
    with tempfile.TemporaryDirectory() as scratch:
        np.save(Path(scratch) / "network.npy", cube.astype(np.float32))
        truth = Path(scratch) / "truth.csv"
        truth.write_text("nm," + ",".join(f"patch {i + 1}" for i in range(24)) + "\n" + "\n".join(
            ",".join(f"{value:.8g}" for value in row)
            for row in zip(PRIOR_GRID.nm, *chart, strict=True)))
        regions = [CubeRegion(f"patch {i + 1}", None, (SIDE * i, 0, SIDE * (i + 1), SIDE),
                              None) for i in range(24)]
        signals = [(rgb[:, SIDE * i:SIDE * (i + 1)] / shading()).mean(axis=(0, 1))
                   for i in range(24)]
        judgement = judge_picture(open_cube(Path(scratch) / "network.npy", NM), regions,
                                  read_table(truth), fine_response(), load_prior(), OPTIONS,
                                  signals=signals, noise=np.full(3, NOISE / SIDE))
    text = judgement_text(judgement.scored + judgement.averages)
    picture(judgement, chart, signals, arguments.out)
    if arguments.json:
        print(json.dumps({"means": {row["method"]: {key: value for key, value in row.items()
                                    if key not in ("region", "method")}
                    for row in judgement.means}, "fitted_on": len(curves),
                          "picture": str(arguments.out)}))
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
