"""Do the bands hold the truth on your own spectra? Coverage by library, family, level, wavelength.

A library is judged with no family stated, or with the one that is stated for all of it. With none,
its curves are also told apart by the family that their signals speak for most.
"""
from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.light_words import DELTA_LIGHTS
from spectrabox.sampling.evaluation.metrics import (
    coverage,
    coverage_error,
    curve_coverage,
    delta_e00_under,
    rmse,
    spectral_angle,
    winkler_score,
)
from spectrabox.sampling.prior.family_coverage import CERTIFIED
from spectrabox.sampling.prior.libraries import ReflectanceLibrary
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, condition_on_families
from spectrabox.sampling.prior.mixture_posterior import (
    calibrated_bands,
    posterior,
    surprise_limit,
    widened,
)
from spectrabox.sampling.spectral_measurement import check_seed

LEVELS = (0.5, 0.8, 0.9, 0.95)
FEWEST = 10
MAX_NOISE = 0.5             # relative
BATCH = 200
TENTHS = 10                 # of wavelengths
BRIGHT = 0.6                # reflectances above it are reported apart


@dataclass(frozen=True, repr=False)
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
    by_wavelength: dict[str, float]     # 95 % band, by tenth of wavelengths
    bright: float | None        # 95 % band, reflectances above 0.6; None without any
    # share of the library in each family by its signals, and what the 95 % band held of the curves
    # that speak for it most
    shares: dict[str, float]
    by_family: dict[str, float]
    stated: tuple[str, ...]     # families that were stated
    unfamiliar: float           # share of signals said to be unlike what it was learnt from
    trained_on: bool            # the prior was learnt on a library of this name

    def __repr__(self) -> str:
        return f"<Certificate {self.name}: {self.curves} curves. {self.verdict}>"

    def facts(self) -> dict[str, object]:
        """As ``spectrabox certify --json`` names them."""
        values: dict[str, object] = {each.name: getattr(self, each.name) for each in fields(self)
                                     if each.name not in ("noise", "coverage_error")}
        return values | {"coverage": {f"{level:g}": self.coverage[level] for level in LEVELS},
                         "coverage_standard_error": self.coverage_error, "verdict": self.verdict}

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
            seed: int = 0, lights: tuple[str, ...] = DELTA_LIGHTS) -> Certificate:
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
        For fewer than ten curves, or a noise that cannot be.
    """
    check_seed(seed)
    if not 0 <= noise < MAX_NOISE:
        raise InputError(f"a relative noise of {noise:g} was given; 0 to {MAX_NOISE:g} is needed")
    truth = library.reflectances
    if len(truth) < FEWEST:
        raise InputError(f"{library.name} holds {len(truth)} usable curves; a certificate needs at "
                         f"least {FEWEST}")
    errors = noise * np.random.default_rng(seed).standard_normal((len(truth),
                                                                  len(relative_response)))
    mean = np.empty_like(truth)
    bands = {level: (np.empty_like(truth), np.empty_like(truth)) for level in LEVELS}
    surprise, shares = np.empty(len(truth)), np.empty((len(truth), len(prior.families)))

    with threadpool_limits(1, "blas"):      # threads within small products would only wait
        for start in range(0, len(truth), BATCH):
            rows = slice(start, start + BATCH)
            clean = truth[rows] @ relative_response.T
            covariance = np.einsum("tk,kl->tkl", (noise * clean)**2,
                                   np.eye(len(relative_response)))
            mixture = posterior(prior, relative_response, clean * (1 + errors[rows]), covariance)
            surprise[rows], shares[rows] = mixture.surprise, prior.shares(mixture.weights)
            mean[rows], ends = calibrated_bands(prior, mixture, LEVELS)
            for (lower, upper), of_level in zip(ends, bands.values(), strict=True):
                of_level[0][rows], of_level[1][rows] = lower, upper
    lower, upper = bands[0.95]
    held = (truth >= lower) & (truth <= upper)
    curve = widened(mean, lower, upper, prior.curve_factor)
    differences = delta_e00_under(lights, PRIOR_GRID, mean, truth)
    most = shares.argmax(axis=1)
    tenths = np.array_split(np.arange(PRIOR_GRID.nm.size), TENTHS)
    return Certificate(
        library.name, len(truth), library.left_out, noise, float(rmse(mean, truth).mean()),
        float(spectral_angle(mean, truth).mean()),
        {level: coverage(*bands[level], truth) for level in LEVELS},
        coverage_error(held), curve_coverage(*curve, truth),
        float(np.mean(upper - lower)), float(np.mean(bands[0.5][1] - bands[0.5][0])),
        winkler_score(lower, upper, truth), {light: float(values.mean()) for light,
                                             values in differences.items()},
        {f"{PRIOR_GRID.nm[tenth[0]]:.0f}-{PRIOR_GRID.nm[tenth[-1]]:.0f} nm": float(held[:,
                                                                                        tenth].mean())
         for tenth in tenths},
        float(held[truth > BRIGHT].mean()) if np.any(truth > BRIGHT) else None,
        dict(zip(prior.families, shares.mean(axis=0).tolist(), strict=True)),
        {name: float(held[most == index].mean()) for index, name in enumerate(prior.families)
         if np.any(most == index)}, prior.stated,
        float(np.mean(surprise > surprise_limit(prior, len(relative_response)))),
        any(part.startswith(f"{library.name} (") for part in prior.source.split("; ")))


def certificate_page(certificates: list[Certificate], prior: LogitMixture, camera: str) -> str:
    """The certificate as a page of Markdown."""
    lights = list(certificates[0].delta_e00)
    head = (f"# Coverage certificate\n\nPrior learnt on: {prior.source}. Camera and light: "
            f"{camera}. Signals were computed from each curve, noise added as stated, and the 95 % "
            "bands compared with the curve. The standard error of a coverage treats curves as "
            "independent; sharpness is the mean width of the 50 % band, angles are in radians, "
            "colour differences CIEDE2000 of the mean spectrum. Conditional on "
            f"{condition_on_families(prior)}.\n\n")
    columns = ["library", "curves", "noise", "RMSE", "angle", *(f"dE00 {light}"
                                                                for light in lights),
               "coverage 50 / 80 / 90 / 95 %", "error", "whole curves", "width", "sharpness",
               "Winkler", "unfamiliar"]
    rows = [columns, ["--"] * len(columns)]
    rows += [_cells(certificate, lights) for certificate in certificates]
    table = "\n".join(f"| {' | '.join(cells)} |" for cells in rows)
    spectral = [["library", *certificates[0].by_wavelength, f"above {BRIGHT:g}"]]
    spectral += [["--"] * len(spectral[0])]
    spectral += [[one.name, *(f"{held:.3f}" for held in one.by_wavelength.values()),
                  "none" if one.bright is None else f"{one.bright:.3f}"] for one in certificates]
    families = [["library", *prior.families], ["--"] * (1 + len(prior.families))]
    families += [[one.name, *(f"{100 * one.shares[name]:.0f} %"
                              + (f", holds {one.by_family[name]:.3f}" if name in one.by_family
                                 else "") for name in prior.families)] for one in certificates]
    by_wavelength, by_family = ("\n".join(f"| {' | '.join(cells)} |" for cells in rows)
                                for rows in (spectral, families))
    verdicts = "\n".join(f"- {one.name}: {one.verdict}" for one in certificates)
    return (f"{head}{table}\n\nWhat the 95 % band holds by wavelength, and of bright reflectances:"
            f"\n\n{by_wavelength}\n\nFamilies that the signals speak for, and what the 95 % band "
            f"holds of the curves that speak for each most:\n\n{by_family}\n\n{verdicts}\n")


def _cells(result: Certificate, lights: list[str]) -> list[str]:
    return [result.name, str(result.curves), f"{100 * result.noise:g} %", f"{result.rmse:.4f}",
            f"{result.spectral_angle:.3f}", *(f"{result.delta_e00[light]:.2f}" for light in lights),
            " / ".join(f"{result.coverage[level]:.3f}" for level in LEVELS),
            f"{result.coverage_error:.3f}", f"{result.curve_coverage:.3f}", f"{result.width:.3f}",
            f"{result.sharpness:.3f}", f"{result.winkler:.3f}", f"{result.unfamiliar:.3f}"]
