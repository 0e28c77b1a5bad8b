"""What measured swatches of the samples' material add: RMSE, coverage and width of the 95 % band.

Sixteen real bands: a file of responses and reflectances of one printed material. Of every random
split 24 rows are swatches, from which the bands' curves are fitted too, with smoothness alone, and
others are samples. Compared are the learnt prior with these curves, ridge regression whose strength
leave-one-out chooses, and ``sb.sample`` with ``swatches``. Then simulated materials, seen by curves
fitted to many rows of the file, or by a three-band camera: swatches of one material, samples of the
same and of another, in closed form, the curves being known and every signal off by noise.

    python -m benchmarks.bench_swatches --data pantone560.npz [--splits 12] [--samples 24]
"""
from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

import spectrabox as sb
from spectrabox.calibrate.chart_equations import chart_equations
from spectrabox.calibrate.prior.plain_priors import smooth_prior
from spectrabox.calibrate.sensitivity import PriorFit, fit_with_prior
from spectrabox.radiometry.grid import FINE_GRID, grid_from_nm
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.spectra.named_spectra import relative_response, test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import on_grid
from spectrabox.sampling.further.learnt_swatches import Swatches, correct, learn_correction
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.prior.mixture_posterior import mean_and_spread, posterior

from benchmarks.other_surfaces import leaves, prints, skin, textile

SWATCHES, NOISE, LEVEL_NOISE, BAND_NOISE = 24, 0.002, 0.01, 0.012
LEAST_SIGNAL, NORMAL_95 = 0.02, 1.96
COEFFICIENTS = 21           # of the bounds: more than bands
EVEN = (np.array([380.0, 780.0]), np.ones(2))       # light of 1 at every wavelength
NM = PRIOR_GRID.nm
Scores = tuple[float, float, float]


def curves_from(reflectances: np.ndarray, signals: np.ndarray) -> PriorFit:
    """Curves of the bands from measured samples, with smoothness alone."""
    count, bands = signals.shape
    patches = PatchSamples(signals, np.tile(NOISE**2 * np.eye(bands), (count, 1, 1)),
                           np.full(count, 100), np.zeros((count, bands)), np.zeros((count, bands)))
    equations = chart_equations(patches, fine(reflectances), np.ones(FINE_GRID.nm.size),
                                np.full(count, np.pi), FINE_GRID, positions=None)
    return fit_with_prior([equations], smooth_prior([equations], FINE_GRID), FINE_GRID)


def fine(reflectances: np.ndarray) -> np.ndarray:
    """Spectra (n, 61) on the working grid."""
    return on_grid(NM, reflectances, FINE_GRID, "a spectrum")


def sampled(fit: PriorFit, signals: np.ndarray,
            swatches: tuple[np.ndarray, np.ndarray] | None) -> list[sb.SpectrumEstimate]:
    """Estimates behind signals in the unit of the fit's, with swatches (signals, spectra) or not.
    """
    white = fit.photos[0].white
    given = None if swatches is None else ((swatches[0] - white.glare) / white.level, NM,
                                           swatches[1])
    found = sb.sample((signals - white.glare) / white.level,
                      camera=(FINE_GRID.nm, fit.sensitivity.curves), light=EVEN,
                      noise=NOISE, sensitivity_error=fit.model_error, swatches=given,
                      coefficients=COEFFICIENTS)
    return list(found.values())


def score(estimates: list[sb.SpectrumEstimate], truth: np.ndarray) -> Scores:
    """RMSE, share of the truth in the band, and its width, means over the samples."""
    lower, upper = (np.array(ends) for ends in zip(*(one.band() for one in estimates),
                                                   strict=True))
    mean = np.array([one.mean for one in estimates])
    return (float(np.sqrt(np.mean((mean - truth)**2, axis=1)).mean()),
            float(np.mean((truth >= lower) & (truth <= upper))), float(np.mean(upper - lower)))


def ridge_rmse(known: np.ndarray, spectra: np.ndarray, signals: np.ndarray,
               truth: np.ndarray) -> float:
    """RMSE of linear regression with the strength that predicts swatches left out best."""
    away, target = known - known.mean(axis=0), spectra - spectra.mean(axis=0)
    gram = away.T @ away
    best, fewest = np.zeros((known.shape[1], spectra.shape[1])), np.inf
    for strength in np.trace(gram) / len(gram) * np.geomspace(1e-6, 1, 13):
        gain = np.linalg.solve(gram + strength * np.eye(len(gram)), away.T)
        hat = away @ gain
        off = (target - hat @ target) / (1 - 1 / len(known) - np.diag(hat))[:, None]
        if np.mean(off**2) < fewest:
            best, fewest = gain @ target, np.mean(off**2)
    found = spectra.mean(axis=0) + (signals - known.mean(axis=0)) @ best
    return float(np.sqrt(np.mean((found - truth)**2, axis=1)).mean())


def split_scores(reflectances: np.ndarray, responses: np.ndarray, samples: int,
                 seed: int) -> list[Scores]:
    """Of one random split of the file: prior, ridge regression (RMSE alone), swatches."""
    order = np.random.default_rng(seed).permutation(len(responses))
    known, rest = order[:SWATCHES], order[SWATCHES:SWATCHES + samples]
    fit = curves_from(reflectances[known], responses[known])
    truth = reflectances[rest]
    plain = ridge_rmse(responses[known], reflectances[known], responses[rest], truth)
    return [score(sampled(fit, responses[rest], None), truth), (plain, np.nan, np.nan),
            score(sampled(fit, responses[rest], (responses[known], reflectances[known])), truth)]


def materials(printed: np.ndarray) -> dict[str, np.ndarray]:
    """Reflectances (n, 61) by kind of material; those of the file and others made by formula."""
    rng = np.random.default_rng(5)
    made: dict[str, Callable[[np.random.Generator, int], np.ndarray]] = {
        "textile": textile, "print": prints, "leaves": leaves, "skin": skin}
    return {"file": printed, "CES99": test_reflectances(PRIOR_GRID)["CES99"]} | {
        name: np.clip(make(rng, 80), 0.003, 0.997)
        for name, make in made.items()}


def seen(reflectances: np.ndarray, response: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Signals with noise, errors of level and of each band."""
    signals = reflectances @ response.T
    noisy = signals + NOISE * rng.standard_normal(signals.shape)
    return np.clip(noisy * (1 + LEVEL_NOISE * rng.standard_normal((len(signals), 1))
                            + BAND_NOISE * rng.standard_normal(signals.shape)), 1e-4, None)


def known(signals: np.ndarray, response: np.ndarray) -> tuple[np.ndarray, ...]:
    """Mean and standard deviation (n, 61) that the learnt prior has of surfaces behind signals
    (n, K), and the signals' log evidence (n,).
    """
    level = np.maximum(signals, LEAST_SIGNAL)
    covariance = LEVEL_NOISE**2 * level[:, :, None] * level[:, None, :] \
        + (NOISE**2 + (BAND_NOISE * level[:, :, None])**2) * np.eye(signals.shape[1])
    mixture = posterior(load_prior(), response, signals, covariance)
    return (*mean_and_spread(mixture), mixture.log_evidence)


def simulated(response: np.ndarray, printed: np.ndarray, samples: int,
              seeds: int) -> dict[tuple[str, str], np.ndarray]:
    """By the materials of swatches and samples: scores without swatches and with them (2, 3)."""
    rows: dict[tuple[str, str], list[list[Scores]]] = {}
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        at_hand = {}
        for name, spectra in materials(printed).items():
            order = rng.permutation(len(spectra))
            parts = [spectra[order[:SWATCHES]], spectra[order[SWATCHES:SWATCHES + samples]]]
            at_hand[name] = [(truth, signals, known(signals, response)) for truth, signals in
                             ((part, seen(part, response, rng)) for part in parts)]
        for one, ((spectra, signals, (mean, deviation, _)), _) in at_hand.items():
            correction = learn_correction(Swatches(signals, spectra, mean, deviation))
            for other, (_, (truth, shown, prior)) in at_hand.items():
                after = correct(correction, shown, *prior)
                rows.setdefault((one, other), []).append([
                    gaussian_score(*prior[:2], truth),
                    gaussian_score(after.mean, after.deviation, truth)])
    return {pair: np.mean(scores, axis=0) for pair, scores in rows.items()}


def gaussian_score(mean: np.ndarray, deviation: np.ndarray, truth: np.ndarray) -> Scores:
    """The same figures as of ``score``, of normal distributions (n, 61)."""
    return (float(np.sqrt(np.mean((mean - truth)**2, axis=1)).mean()),
            float(np.mean(np.abs(truth - mean) <= NORMAL_95 * deviation)),
            float(2 * NORMAL_95 * deviation.mean()))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True,
                        help=".npz of reflectance (n, 31) at 400, 410 ... 700 nm and response")
    parser.add_argument("--splits", type=int, default=12)
    parser.add_argument("--samples", type=int, default=24)
    parser.add_argument("--seeds", type=int, default=3, help="of simulated materials")
    chosen = parser.parse_args()
    if not chosen.data.is_file():
        print(f"skipped: {chosen.data} is missing; these measurements do not ship")
        return
    with np.load(chosen.data) as stored:
        responses = stored["response"]
        printed = on_grid(np.arange(400, 701, 10.0), stored["reflectance"],
                          grid_from_nm(NM), "the file")
    splits = np.array([split_scores(printed, responses, chosen.samples, seed)
                       for seed in range(chosen.splits)])
    if chosen.splits:
        print(f"{chosen.splits} splits, {SWATCHES} swatches: RMSE, coverage, width")
        for name, row in zip(("prior", "ridge regression", "swatches"), splits.mean(axis=0),
                             strict=True):
            print(f"  {name:18s}", *(f"{value:.4f}" for value in row))
        better = np.mean(splits[:, 2, 0] <= splits[:, :2, 0].min(axis=1))
        print(f"  swatches at least as good as the better of both in {better:.0%} of the splits")
    bands16 = curves_from(printed[::12], responses[::12]).sensitivity.curves
    coarse = np.maximum([np.interp(NM, FINE_GRID.nm, curve) for curve in bands16], 0)
    three = relative_response("Nikon 5100 (NPL)", "D65", PRIOR_GRID)
    for name, response in (("16 bands", coarse / coarse.sum(axis=1, keepdims=True)),
                           ("3 bands", three)):
        rows = simulated(response, printed, chosen.samples, chosen.seeds)
        for like, words in ((True, "of the same material"), (False, "of another material")):
            figures = np.array([row for (one, other), row in rows.items()
                                if (one == other) == like])
            without, given = figures.mean(axis=0)
            worst = (figures[:, 1, 0] / figures[:, 0, 0]).max()
            print(f"{name}, samples {words}: without", *(f"{value:.4f}" for value in without),
                  "with", *(f"{value:.4f}" for value in given), f"worst RMSE ratio {worst:.2f}")
        for (one, other), row in rows.items():
            print(f"    {one:8s} -> {other:8s}", *(f"{value:.4f}" for value in row.ravel()))


if __name__ == "__main__":
    main()
