"""Do the bands hold the truth on your own spectra? Coverage of the prior, level by level and library by library."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radiometry.errors import InputError
from sampling.logit_mixture import LogitMixture
from sampling.mixture_posterior import calibrated_band, central_band, mean_and_spread, posterior
from sampling.reflectance_libraries import ReflectanceLibrary
from sampling.scores import coverage, coverage_error, curve_coverage, rmse, spectral_angle, winkler_score

LEVELS = (0.5, 0.8, 0.9, 0.95)
CERTIFIED = 0.93            # of wavelengths within the 95 % band
FEWEST = 10
BATCH = 200


@dataclass(frozen=True)
class Certificate:
    """What the bands did on one library; coverages at LEVELS, everything else at 95 %."""

    name: str
    curves: int
    left_out: dict[str, int]
    noise: float
    rmse: float
    spectral_angle: float
    coverage: dict[float, float]
    coverage_error: float
    curve_coverage: float
    width: float
    winkler: float
    unfamiliar: float           # share of signals that the prior would refuse

    @property
    def verdict(self) -> str:
        """One sentence."""
        held = self.coverage[0.95]
        if held >= CERTIFIED:
            return f"The 95 % bands held {100 * held:.1f} % of wavelengths: they may be trusted on spectra like these."
        return (f"The 95 % bands held only {100 * held:.1f} % of wavelengths: they are too narrow for spectra like "
                "these; train a prior that includes some of them.")


def certify(prior: LogitMixture, library: ReflectanceLibrary, response: np.ndarray, noise: float = 0.0,
            seed: int = 0) -> Certificate:
    """Bands for the signals of every curve of a library, against the curve.

    Parameters
    ----------
    response : (K, 61)
        Rows summing to 1.
    noise : float
        Relative standard error of the signals, also drawn into them.

    Raises
    ------
    InputError
        For fewer than ten curves.
    """
    truth = library.reflectances
    if len(truth) < FEWEST:
        raise InputError(f"{library.name} holds {len(truth)} usable curves; a certificate needs at least {FEWEST}")
    rng = np.random.default_rng(seed)
    mean = np.empty_like(truth)
    bands = {level: (np.empty_like(truth), np.empty_like(truth)) for level in LEVELS}
    curve = (np.empty_like(truth), np.empty_like(truth))
    surprise = np.empty(len(truth))
    for start in range(0, len(truth), BATCH):
        rows = slice(start, start + BATCH)
        clean = truth[rows] @ response.T
        covariance = np.einsum("tk,kl->tkl", (noise * clean)**2, np.eye(len(response)))
        found = posterior(prior, response, clean * (1 + noise * rng.standard_normal(clean.shape)), covariance)
        mean[rows], surprise[rows] = mean_and_spread(found)[0], found.surprise
        for level in LEVELS:
            raw = central_band(found, level)
            bands[level][0][rows], bands[level][1][rows] = calibrated_band(prior, mean[rows], *raw,
                                                                           prior.band_factor(level))
        curve[0][rows], curve[1][rows] = calibrated_band(prior, mean[rows], *raw, prior.curve_factor)
    lower, upper = bands[0.95]
    return Certificate(
        library.name, len(truth), library.left_out, noise, float(rmse(mean, truth).mean()),
        float(spectral_angle(mean, truth).mean()), {level: coverage(*bands[level], truth) for level in LEVELS},
        coverage_error((truth >= lower) & (truth <= upper)), curve_coverage(*curve, truth),
        float(np.mean(upper - lower)), winkler_score(lower, upper, truth),
        float(np.mean(surprise > prior.familiar_surprise)))


def certificate_page(certificates: list[Certificate], prior: LogitMixture, camera: str) -> str:
    """The certificate as a page of Markdown."""
    head = ("# Coverage certificate\n\n"
            f"Prior learnt on: {prior.source}. Camera and light: {camera}. "
            "Signals were computed from each curve, noise added as stated, and the 95 % bands compared with the curve. "
            "The standard error of a coverage treats curves as independent.\n\n"
            "| library | curves | noise | RMSE | angle | coverage 50 / 80 / 90 / 95 % | error | whole curves | width | "
            "Winkler | unfamiliar |\n|--|--|--|--|--|--|--|--|--|--|--|\n")
    rows = [f"| {one.name} | {one.curves} | {100 * one.noise:g} % | {one.rmse:.4f} | {one.spectral_angle:.3f} | "
            + " / ".join(f"{one.coverage[level]:.3f}" for level in LEVELS)
            + f" | {one.coverage_error:.3f} | {one.curve_coverage:.3f} | {one.width:.3f} | {one.winkler:.3f} | "
              f"{one.unfamiliar:.3f} |" for one in certificates]
    verdicts = [f"- {one.name}: {one.verdict}" for one in certificates]
    return head + "\n".join(rows) + "\n\n" + "\n".join(verdicts) + "\n"
