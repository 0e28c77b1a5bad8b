"""Do the bands hold the truth, library by library, and how far is the mean: the learnt prior
against other methods.

Every training library is judged by a prior that was not trained on it; the sets that colour-science
ships were never trained on. Otsu, Smits, Mallett and Jakob see the same tristimulus values (CIE
1931, D65); the uniform prior is drawn exactly at N = 7. Noise rows add Gaussian noise to the
signals and state it.
"""
from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from spectrabox.radiometry.colour_science import upsampled
from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.radiometry.spectra.named_spectra import relative_response, test_reflectances
from spectrabox.sampling.evaluation.metrics import (
    coverage,
    coverage_error,
    curve_coverage,
    rmse,
    winkler_score,
)
from spectrabox.sampling.polytope.tilted_rejection import sample_polytope
from spectrabox.sampling.prior.families.family_models import FAMILIES
from spectrabox.sampling.prior.libraries import read_library, without_near_duplicates
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, load_prior
from spectrabox.sampling.prior.mixture_posterior import (
    calibrated_bands,
    posterior,
    surprise_limit,
    widened,
)
from spectrabox.sampling.spectral_measurement import spline_operator
from spectrabox.sampling.uniform import into_reach

from tools.prior_calibration import AT_95, judge, prior_without
from tools.prior_training import Library, enriched, fit_mixture, fitted_families, parts_of

TRAINING = {"cassava": "earth", "kremer_pigments": "paint", "ntu_watercolour": "paint",
            "rawtoaces190": "mixed", "usgs_minerals": "earth"}      # and their families
PEERS = ("Otsu 2018", "Smits 1999", "Mallett 2019")
BATCH = 200


@dataclass(frozen=True)
class Certificate:
    """What the 95 % bands did on one library; ``unfamiliar`` is the share of signals that are said
    to be unlike what the prior was learnt from.
    """

    name: str
    curves: int
    noise: float
    rmse: float
    coverage: float
    error: float
    width: float
    curve_coverage: float
    winkler: float
    unfamiliar: float


def certify(prior: LogitMixture, name: str, truth: np.ndarray, response: np.ndarray,
            noise: float = 0.0, seed: int = 0) -> Certificate:
    """Bands for the signals of every curve of a library, against the curve.

    Parameters
    ----------
    name : str
        Of the library.
    truth : (n, 61)
        Its reflectances.
    response : (K, 61)
        Rows summing to 1.
    noise : float
        Relative standard error of the signals, also drawn into them.
    """
    errors = noise * np.random.default_rng(seed).standard_normal((len(truth), len(response)))
    mean, lower, upper = (np.empty_like(truth) for _ in range(3))
    surprise = np.empty(len(truth))
    for start in range(0, len(truth), BATCH):
        rows = slice(start, start + BATCH)
        clean = truth[rows] @ response.T
        covariance = np.einsum("tk,kl->tkl", (noise * clean)**2, np.eye(len(response)))
        mixture = posterior(prior, response, clean * (1 + errors[rows]), covariance)
        mean[rows], ((lower[rows], upper[rows]),) = calibrated_bands(prior, mixture, (0.95,))
        surprise[rows] = mixture.surprise
    curve = widened(mean, lower, upper, prior.curve_factor)
    return Certificate(
        name, len(truth), noise, float(rmse(mean, truth).mean()),
        coverage(lower, upper, truth), coverage_error((truth >= lower) & (truth <= upper)),
        float(np.mean(upper - lower)), curve_coverage(*curve, truth),
        winkler_score(lower, upper, truth),
        float(np.mean(surprise > surprise_limit(prior, len(response)))))


def response_of(camera: str, light: str) -> np.ndarray:
    """Response (K, 61)."""
    fine = visible_grid(1)
    return relative_response(camera, light, fine) @ interpolation_matrix(PRIOR_GRID.nm, fine.nm)


def eight_bands() -> np.ndarray:
    """Response (8, 61) of Gaussian bands of 15 nm, every 40 nm."""
    bands = np.exp(-0.5 * ((PRIOR_GRID.nm - np.arange(410, 700, 40)[:, None]) / 15)**2) \
        * PRIOR_GRID.weights_nm
    return bands / bands.sum(axis=1, keepdims=True)


def left_out_priors(libraries: Sequence[Library]) -> dict[str, LogitMixture]:
    """For every library the prior trained on the others, with the factors of the shipped one."""
    shipped = load_prior()
    by_family: dict[str, list[Library]] = {}
    for library in libraries:
        by_family.setdefault(TRAINING[library[0]], []).append(library)
    parts = parts_of(by_family, FAMILIES, 0, 1)
    fitted = fitted_families(parts, FAMILIES, 0)
    return {part.name: replace(prior_without(part, parts, fitted, FAMILIES, 0),
                               band_factors=shipped.band_factors,
                               stated_factors=shipped.stated_factors,
                               curve_factor=shipped.curve_factor,
                               familiar_surprise=shipped.familiar_surprise)
            for part in parts if part.measured}


def in_domain(libraries: Sequence[Library], response: np.ndarray) -> Certificate:
    """Random thirds: trained on one, calibrated on another, judged on the last; near-duplicates
    removed first.
    """
    rng = np.random.default_rng(0)
    pooled = np.concatenate([without_near_duplicates(curves)[:600] for _, curves in libraries])
    first, second, third = np.array_split(pooled[rng.permutation(len(pooled))], 3)
    prior = fit_mixture(enriched(first))
    judged = judge(prior, response, second)
    # Within one population the plain quantile is the calibration; the slack is for libraries never
    # seen.
    factors = np.array([np.quantile(scores, level)
                        for scores, level in zip(judged.scores, prior.levels, strict=True)])
    flat = factors[None, :, None] * np.ones(PRIOR_GRID.nm.size)
    widest = np.quantile(judged.scores[AT_95].max(axis=1), 0.95) / factors[AT_95]
    exact = replace(prior, band_factors=flat, stated_factors=flat, curve_factor=float(widest))
    return certify(exact, "in-domain third", third, response)


def uniform_row(reflectances: np.ndarray, response: np.ndarray) -> tuple[float, float]:
    """RMSE of the mean and 95 % coverage of exact uniform draws at N = 7."""
    from spectrabox.radiometry.grid import basis_matrix

    basis = basis_matrix(PRIOR_GRID.nm, 7)
    errors, held = [], []
    for curve in reflectances:
        measured = SpectralMeasurement(PRIOR_GRID, response, response @ curve, np.zeros((3, 3)))
        operator, _ = into_reach(spline_operator(measured, 7))
        spectra = sample_polytope(operator, 1000, 0)[0] @ basis.T
        lower, upper = np.quantile(spectra, [0.025, 0.975], axis=0)
        errors.append(np.sqrt(np.mean((spectra.mean(axis=0) - curve)**2)))
        held.append(np.mean((curve >= lower) & (curve <= upper)))
    return float(np.mean(errors)), float(np.mean(held))


def peers(reflectances: np.ndarray, observer: np.ndarray) -> dict[str, float]:
    """RMSE of other authors' single spectra."""
    return {method: float(np.mean([rmse(upsampled(observer @ curve, PRIOR_GRID, method),
                                        curve) for curve in reflectances])) for method in PEERS}


def some(curves: np.ndarray, most: int) -> np.ndarray:
    """At most ``most`` curves, at random."""
    return curves[np.random.default_rng(1).permutation(len(curves))[:most]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path,
                        help="folder with reflectance/; without it only the shipped sets")
    parser.add_argument("--library", type=Path, action="append", default=[],
                        help="a folder of measured reflectances of your own, judged as well")
    parser.add_argument("--most", type=int, default=300,
                        help="curves of one library that are judged")
    parser.add_argument("--peers", type=int, default=25,
                        help="curves of one library given to the other methods")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    arguments = parser.parse_args()
    response, prior = response_of("CIE 1931 2 Degree Standard Observer", "D65"), load_prior()
    priors: dict[str, LogitMixture] = {}
    libraries = []
    if arguments.data is not None:
        libraries = [(name, read_library(arguments.data / "reflectance" / name))
                     for name in TRAINING]
        priors = left_out_priors(libraries)
    never = [(name, values[np.all((values >= 0) & (values <= 1), axis=1)])
             for name, values in test_reflectances(PRIOR_GRID).items()]
    never += [(folder.resolve().name, read_library(folder)) for folder in arguments.library]
    rows = []
    for name, curves in (*libraries, *never):
        judged = some(curves, arguments.most)
        row = asdict(certify(priors.get(name, prior), name, judged, response))
        few = judged[:arguments.peers]
        row["uniform_rmse"], row["uniform_coverage"] = uniform_row(few, response)
        row["peers"] = peers(few, response)
        row["rmse_of_those"] = float(certify(priors.get(name, prior), "", few, response).rmse)
        rows.append(row)
    noisy = [{**asdict(certify(prior, name, some(values, arguments.most), matrix, noise)),
              "bands": len(matrix)}
             for name, values in (("BabelColor Average",
                                   test_reflectances(PRIOR_GRID)["BabelColor Average"]),
                                  ("NIST CQS test colours",
                                   test_reflectances(PRIOR_GRID)["NIST CQS test colours"]))
             for matrix in (response, eight_bands()) for noise in (0.0, 0.003, 0.01, 0.03)]
    inside = asdict(in_domain(libraries, response)) if libraries else None
    if arguments.json:
        print(json.dumps({"libraries": rows, "noise": noisy, "in_domain": inside}))
        return
    print(f"{'library (not trained on)':<26} {'n':>4} {'RMSE':>7} {'95 % holds':>11} {'width':>6} "
          f"{'curves':>7} {'Winkler':>8} | like for like: "
          f"{'ours':>6} " + " ".join(f"{name:>12}" for name in PEERS) + f" {'uniform N=7':>12} "
          f"{'its 95 %':>9}")
    for row in rows:
        print(f"{row['name']:<26} {row['curves']:4d} {row['rmse']:7.4f} "
              f"{row['coverage']:6.3f}+-{row['error']:.3f} {row['width']:6.3f} "
              f"{row['curve_coverage']:7.3f} {row['winkler']:8.3f} | {row['rmse_of_those']:21.4f} "
              + " ".join(f"{row['peers'][name]:12.4f}" for name in PEERS) + " "
              f"{row['uniform_rmse']:12.4f} {row['uniform_coverage']:9.3f}")
    wins = sum(row["rmse_of_those"] < row["peers"]["Otsu 2018"] for row in rows)
    print(f"mean width {np.mean([row['width'] for row in rows]):.3f}; below Otsu on {wins} of "
          f"{len(rows)} sets")
    if inside:
        print(f"in-domain third: {inside['coverage']:.3f} +- {inside['error']:.3f} of wavelengths, "
              f"whole curves {inside['curve_coverage']:.3f}, width {inside['width']:.3f}, RMSE "
              f"{inside['rmse']:.4f}")
    print(f"\n{'set':<26} {'K':>2} {'noise %':>8} {'RMSE':>7} {'95 % holds':>11} {'width':>6}")
    for row in noisy:
        print(f"{row['name']:<26} {row['bands']:2d} {100 * row['noise']:8.1f} {row['rmse']:7.4f} "
              f"{row['coverage']:6.3f}+-{row['error']:.3f} {row['width']:6.3f}")


if __name__ == "__main__":
    main()
