"""Bands without draws against bands of draws, both against truths drawn from the prior itself.

The prior is taken as it is, without its calibrated factors, so that bands which are right hold
every level of truths that are drawn from it. Below and above are the shares of wavelengths at which
the truth lies beyond either end; half of what the level leaves is right for each.
"""
from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from spectrabox.radiometry.records import Outcome, SpectralMeasurement
from spectrabox.sampling.prior.draws import prior_spectra
from spectrabox.sampling.prior.mixture import GRID, LogitMixture, load_prior, reflectance
from spectrabox.sampling.prior.summaries import summaries
from spectrabox.session.signals.signal_options import response_of_names

CAMERA, LIGHT = "CIE 1931 2 Degree Standard Observer", "D65"
LEVELS = (0.5, 0.8, 0.95)
NOISES = (0.0, 0.003, 0.01)     # of white
DRAWS = 2000


def truths(prior: LogitMixture, count: int, rng: np.random.Generator) -> np.ndarray:
    """Reflectances (n, 61) drawn from a prior."""
    components = rng.choice(len(prior.weights), size=count, p=prior.weights)
    return reflectance(np.array([rng.multivariate_normal(prior.means[index],
                                                         prior.covariances[index])
                                 for index in components]))


def beyond(truth: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> tuple[float, float]:
    """Percent of wavelengths below and above the band."""
    return 100 * float(np.mean(truth < lower)), 100 * float(np.mean(truth > upper))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--truths", type=int, default=200)
    count = parser.parse_args().truths
    shipped = load_prior()
    prior = replace(shipped, band_factors=np.ones_like(shipped.band_factors), width_power=0.0,
                    familiar_surprise=np.inf)
    response, rng = response_of_names(CAMERA, LIGHT), np.random.default_rng(0)
    print(f"{'noise':>5} {'level':>5} {'without draws: below, above':>29} "
          f"{'of draws: below, above':>24} {'differences / sd, rms':>22}")
    for noise in NOISES:
        curves = truths(prior, count, rng)
        signals = curves @ response.T + noise * rng.standard_normal((count, 3))
        R = noise**2 * np.eye(3)
        causes = {"photo noise": np.tile(R, (count, 1, 1))}
        drawn = [prior_spectra(SpectralMeasurement(GRID, response, signal, R), DRAWS, seed, prior)
                 for seed, signal in enumerate(signals)]
        familiar = np.array([one.outcome is Outcome.FAMILIAR for one in drawn])
        spectra = np.array([one.spectra for one in drawn])[familiar]
        spread = spectra.std(axis=1)
        for level in LEVELS:
            quick = summaries(prior, response, signals, causes, level)
            ends = np.quantile(spectra, [(1 - level) / 2, (1 + level) / 2], axis=1)
            mine = [quick.lower[familiar], quick.upper[familiar]]
            rms = [float(np.sqrt(np.mean(((own - drawn_end) / spread)**2)))
                   for own, drawn_end in zip(mine, ends, strict=True)]
            without, of_draws = beyond(curves[familiar], *mine), beyond(curves[familiar], *ends)
            print(f"{noise:5.3f} {level:5.2f} {without[0]:20.1f} % {without[1]:5.1f} %"
                  f" {of_draws[0]:15.1f} % {of_draws[1]:5.1f} % {rms[0]:13.3f} {rms[1]:8.3f}",
                  flush=True)


if __name__ == "__main__":
    main()
