"""Do the bands hold the truth on your own spectra? Coverage of the prior, level by level and
library by library.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.judge.scores import (
    LIGHTS,
    coverage,
    coverage_error,
    curve_coverage,
    delta_e00_under,
    rmse,
    spectral_angle,
    winkler_score,
)
from spectrabox.sampling.prior.libraries import ReflectanceLibrary
from spectrabox.sampling.prior.mixture import GRID, LogitMixture
from spectrabox.sampling.prior.posterior import (
    calibrated_band,
    central_band,
    mean_and_spread,
    posterior,
)

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
    sharpness: float            # mean width of the 50 % band, whatever the truth is
    winkler: float
    delta_e00: dict[str, float]  # mean CIEDE2000 of mean and truth, by light
    unfamiliar: float           # share of signals that the prior would refuse
    trained_on: bool            # the prior was learnt on a library of this name

    @property
    def verdict(self) -> str:
        """One sentence."""
        held = self.coverage[0.95]
        if self.trained_on:
            return (f"The 95 % bands held {100 * held:.1f} % of wavelengths, but the prior was "
                    "learnt on this library: that says nothing of other spectra.")
        if held >= CERTIFIED:
            return (f"The 95 % bands held {100 * held:.1f} % of wavelengths: they may be trusted "
                    "on spectra like these.")
        return (f"The 95 % bands held only {100 * held:.1f} % of wavelengths: they are too narrow "
                "for spectra like these; train a prior that includes some of them.")


def certify(prior: LogitMixture, library: ReflectanceLibrary, relative_response: np.ndarray,
            noise: float = 0.0,
            seed: int = 0, lights: tuple[str, ...] = LIGHTS) -> Certificate:
    """Bands for the signals of every curve of a library, against the curve.

    Parameters
    ----------
    relative_response : (K, 61)
        Rows summing to 1.
    noise : float
        Relative standard error of the signals, also drawn into them.
    lights : names
        Of the colour differences.

    Raises
    ------
    InputError
        For fewer than ten curves.
    """
    truth = library.reflectances
    if len(truth) < FEWEST:
        raise InputError(f"{library.name} holds {len(truth)} usable curves; a certificate needs at "
                         f"least {FEWEST}")
    rng = np.random.default_rng(seed)
    mean = np.empty_like(truth)
    bands = {level: (np.empty_like(truth), np.empty_like(truth)) for level in LEVELS}
    curve = (np.empty_like(truth), np.empty_like(truth))
    surprise = np.empty(len(truth))
    for start in range(0, len(truth), BATCH):
        rows = slice(start, start + BATCH)
        clean = truth[rows] @ relative_response.T
        covariance = np.einsum("tk,kl->tkl", (noise * clean)**2, np.eye(len(relative_response)))
        signals = clean * (1 + noise * rng.standard_normal(clean.shape))
        mixture = posterior(prior, relative_response, signals, covariance)
        mean[rows], surprise[rows] = mean_and_spread(mixture)[0], mixture.surprise
        for level in LEVELS:
            raw = central_band(mixture, level)
            bands[level][0][rows], bands[level][1][rows] = calibrated_band(prior, mean[rows], *raw,
                                                                           prior.band_factor(level))
        curve[0][rows], curve[1][rows] = calibrated_band(prior, mean[rows], *raw,
                                                         prior.curve_factor)
    lower, upper = bands[0.95]
    differences = delta_e00_under(lights, GRID, mean, truth)
    return Certificate(
        library.name, len(truth), library.left_out, noise, float(rmse(mean, truth).mean()),
        float(spectral_angle(mean, truth).mean()),
        {level: coverage(*bands[level], truth) for level in LEVELS},
        coverage_error((truth >= lower) & (truth <= upper)), curve_coverage(*curve, truth),
        float(np.mean(upper - lower)), float(np.mean(bands[0.5][1] - bands[0.5][0])),
        winkler_score(lower, upper, truth), {light: float(values.mean()) for light,
                                             values in differences.items()},
        float(np.mean(surprise > prior.familiar_surprise)), f"{library.name} (" in prior.source)


def certificate_page(certificates: list[Certificate], prior: LogitMixture, camera: str) -> str:
    """The certificate as a page of Markdown."""
    lights = list(certificates[0].delta_e00)
    head = (f"# Coverage certificate\n\nPrior learnt on: {prior.source}. Camera and light: "
            f"{camera}. Signals were computed from each curve, noise added as stated, and the 95 % "
            "bands compared with the curve. The standard error of a coverage treats curves as "
            "independent; sharpness is the mean width of the 50 % band, angles are in radians, "
            "colour differences CIEDE2000 of the mean spectrum.\n\n")
    columns = ["library", "curves", "noise", "RMSE", "angle", *(f"dE00 {light}"
                                                                for light in lights),
               "coverage 50 / 80 / 90 / 95 %", "error", "whole curves", "width", "sharpness",
               "Winkler", "unfamiliar"]
    rows = [columns, ["--"] * len(columns)]
    rows += [_cells(certificate, lights) for certificate in certificates]
    table = "\n".join(f"| {' | '.join(cells)} |" for cells in rows)
    verdicts = "\n".join(f"- {certificate.name}: {certificate.verdict}"
                         for certificate in certificates)
    return f"{head}{table}\n\n{verdicts}\n"


def _cells(result: Certificate, lights: list[str]) -> list[str]:
    return [result.name, str(result.curves), f"{100 * result.noise:g} %", f"{result.rmse:.4f}",
            f"{result.spectral_angle:.3f}", *(f"{result.delta_e00[light]:.2f}" for light in lights),
            " / ".join(f"{result.coverage[level]:.3f}" for level in LEVELS),
            f"{result.coverage_error:.3f}", f"{result.curve_coverage:.3f}", f"{result.width:.3f}",
            f"{result.sharpness:.3f}", f"{result.winkler:.3f}", f"{result.unfamiliar:.3f}"]
