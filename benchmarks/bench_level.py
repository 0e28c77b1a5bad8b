"""What the prior does to the level of a surface: bias and coverage by level, each prior.

Greys, and spectra that colour-science ships or a library holds (``--library FOLDER``), rescaled so
that their largest reflectance is the level asked for, under a light whose strength is known to
3 %, each band besides to 0.5 %. "own level" is the same prior with the levels of its families.
"""
from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.spectra.named_spectra import relative_response, test_reflectances
from spectrabox.sampling.prior.libraries import read_library
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, load_prior
from spectrabox.sampling.prior.summaries import summaries

LEVELS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.97)
OWN = 0.005                     # relative error of a band
SEEN = PRIOR_GRID.nm >= 430
LARGEST = 0.99


def lightness(reflectances: np.ndarray, luminous: np.ndarray) -> np.ndarray:
    """CIE 1976 L* (n,) of reflectances (n, 61)."""
    y = reflectances @ luminous
    return np.where(y > (6 / 29)**3, 116 * np.cbrt(y) - 16, (29 / 3)**3 * y)


def row(prior: LogitMixture, response: np.ndarray, truth: np.ndarray, light_error: float,
        luminous: np.ndarray) -> str:
    """Bias and coverage of one set of surfaces, as cells of a table."""
    rng = np.random.default_rng(1)
    exact = truth @ response.T
    light = light_error * rng.standard_normal((len(truth), 1))
    light -= light.mean()
    seen = exact * (1 + light) + OWN * exact * rng.standard_normal(exact.shape)
    noise = light_error**2 * seen[:, :, None] * seen[:, None, :] \
        + np.einsum("tk,kl->tkl", (OWN * seen)**2, np.eye(len(response)))
    found = summaries(prior, response, seen, {"errors": noise}, 0.95)
    bias = ((found.mean - truth) @ response.T).mean()
    held = ((truth >= found.lower) & (truth <= found.upper))[:, SEEN].mean()
    return (f"{bias:+.4f} ({bias / (light_error * exact.mean()):+.2f}), "
            f"{np.mean(lightness(found.mean, luminous) - lightness(truth, luminous)):+.2f}, "
            f"{held:.3f}, {np.mean((found.upper - found.lower)[:, SEEN]):.3f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--library", type=Path, help="folder of measured spectra")
    parser.add_argument("--light-error", type=float, default=0.03)
    parser.add_argument("--count", type=int, default=200, help="of each set")
    parser.add_argument("--sensitivity", default="Nikon 5100 (NPL)")
    arguments = parser.parse_args()
    fine = visible_grid()
    to_prior = interpolation_matrix(PRIOR_GRID.nm, fine.nm)
    response = relative_response(arguments.sensitivity, "D65", fine) @ to_prior
    observer = relative_response("CIE 1931 2 Degree Standard Observer", "D65", fine) @ to_prior
    shipped = np.clip(np.vstack(list(test_reflectances(PRIOR_GRID).values())), 0, 1)
    spectra = read_library(arguments.library) if arguments.library else shipped
    spectra = spectra[np.random.default_rng(0).permutation(len(spectra))[:arguments.count]]
    priors = replace(load_prior(), uniform_level=False), load_prior()
    print("| surfaces | own level: bias of the signal (of its error), L*, held, width | uniform |")
    print("|--|--|--|")
    for name, shapes in (("grey", np.ones((arguments.count, PRIOR_GRID.nm.size))),
                         ("spectra", spectra / spectra.max(axis=1, keepdims=True))):
        for level in LEVELS:
            truth = np.minimum(level * shapes, LARGEST)
            cells = [row(prior, response, truth, arguments.light_error, observer[1])
                     for prior in priors]
            print(f"| {name} {level:g} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
