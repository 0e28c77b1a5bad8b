"""Gloss: what bands hold of surfaces that mirror a share of the lamp's light, by what is stated.

A Nikon 5100 before daylight, without and with one or two gels (three, six, nine bands), camera and
light known, level to 2 %, .5 % of noise a band; the 99 colours of CES99 or those of ``--library``.
Every surface of a row has the same gloss. Printed are RMSE, share that the 95 % band holds, its
width, and what the signals say of the gloss; first with a symmetric error of .8 % of white in
gloss's place (``error``), then stated matt, then with nothing stated. ``--greys`` prints the bias
of dark greys whose gloss is what is stated.
"""
from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from spectrabox.measure.surfaces.surface_signals import measurement
from spectrabox.radiometry.error_model import PHOTO_NOISE, SAMPLE_PLANE, proportional_covariance
from spectrabox.radiometry.gloss import KINDS, gloss_states
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import SurfaceSignals
from spectrabox.radiometry.spectra.named_spectra import light as named_light
from spectrabox.radiometry.spectra.named_spectra import sensitivities, test_reflectances
from spectrabox.sampling.evaluation.identification import read_spectral_libraries
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.prior.signal_posterior import solve_posterior

CAMERA, LEVEL, NOISE, SEED = "Nikon 5100 (NPL)", 0.02, 0.005, 7
GLOSSES = (0.0, 0.015, 0.03)
ERROR = "error"                 # in place of a gloss: symmetric, .8 % of white
# transmittance at 400 ... 700 nm of a magenta and of an orange gel
GELS = ((0.14, 0.47, 0.04, 0.0, 0.0, 0.02, 0.87), (0.15, 0.10, 0.01, 0.02, 0.66, 0.88, 0.93))
GREYS = (0.02, 0.03, 0.05, 0.1)


def response(photos: int) -> np.ndarray:
    """Response (3 photos, P) of the camera, rows summing to 1."""
    bare = sensitivities(CAMERA, FINE_GRID) * named_light("D65", FINE_GRID) * FINE_GRID.weights_nm
    gels = [np.interp(FINE_GRID.nm, np.linspace(400, 700, len(gel)), gel) for gel in GELS]
    whole = np.vstack([bare, *(bare * gel for gel in gels[:photos - 1])])
    return np.asarray(whole / whole.sum(axis=1, keepdims=True))


def photographed(truth: np.ndarray, photos: int, gloss: np.ndarray | float,
                 stated: str | None) -> SurfaceSignals:
    """Signals of surfaces (n, P) of a gloss (n,), or of one, of which so much is stated."""
    rng, rows = np.random.default_rng(SEED), response(photos)
    clean = truth @ rows.T
    signal = clean * (1 + LEVEL * rng.standard_normal((len(truth), 1))) \
        + np.broadcast_to(gloss, len(truth))[:, None] \
        + NOISE * clean * rng.standard_normal(clean.shape)
    bands = len(rows)
    noise = ((NOISE * signal)**2 + 0.001**2)[:, :, None] * np.eye(bands)
    causes = {PHOTO_NOISE: noise, SAMPLE_PLANE: proportional_covariance(
        signal, np.full((bands, bands), LEVEL**2))}
    if stated == ERROR:
        causes[PHOTO_NOISE] = noise + 0.008**2
    states = () if stated == ERROR else (gloss_states(stated, ["lamp"] * bands),) * len(truth)
    return SurfaceSignals(
        tuple(map(str, range(len(truth)))), (False,) * len(truth), FINE_GRID, truth,
        tuple(map(str, range(bands))), np.repeat(np.arange(photos), 3), rows, signal,
        causes, states)


def rows(truth: np.ndarray) -> Iterator[str]:
    """A line for each number of photos, gloss, and statement."""
    prior, coarse = load_prior(), truth[:, np.searchsorted(FINE_GRID.nm, PRIOR_GRID.nm)]
    for photos in (1, 2, 3):
        for gloss in GLOSSES:
            for stated in (ERROR, "matt", None):
                signals = photographed(truth, photos, gloss, stated)
                started, figures, found = time.process_time(), [], []
                for index, own in enumerate(coarse):
                    solved = solve_posterior(prior, measurement(signals, index))
                    lower, upper = solved.band(0.95)
                    figures.append((np.mean((solved.mean - own)**2),
                                    np.mean((lower <= own) & (own <= upper)),
                                    np.mean(upper - lower)))
                    if solved.states is not None:
                        found.append(solved.states.mean[0])
                took = (time.process_time() - started) / len(truth)
                square, holds, width = np.mean(figures, axis=0)
                said = f", gloss found {np.mean(found):.3f}" if found else ""
                yield (f"{3 * photos} bands, gloss {gloss:.3f}, {stated or 'unstated':8s}: RMSE "
                       f"{square**0.5:.4f}, holds {holds:.3f}, width {width:.3f}{said}; "
                       f"{1000 * took:.0f} ms a surface")


def biases(draws: int) -> Iterator[str]:
    """Of dark greys, the mean error of the mean over wavelength, in per cent of white."""
    rng = np.random.default_rng(SEED)
    for stated, kind in KINDS.items():
        for level in GREYS:
            gloss = np.maximum(kind.mean + kind.deviation * rng.standard_normal(draws), 0)
            truth = np.full((draws, FINE_GRID.nm.size), level)
            signals = photographed(truth, 1, gloss, stated)
            errors = [solve_posterior(load_prior(), measurement(signals, index)).mean.mean() - level
                      for index in range(draws)]
            yield (f"{stated} grey of {level:.2f}: {100 * np.mean(errors):+.2f} +- "
                   f"{100 * np.std(errors) / draws**0.5:.2f} % of white")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--library", type=Path, help="measured reflectances, of any format that "
                        "match reads")
    parser.add_argument("--every", type=int, default=1, help="take every so many-th spectrum")
    parser.add_argument("--greys", action="store_true")
    chosen = parser.parse_args()
    if chosen.greys:
        lines = biases(50)
    elif chosen.library is not None:
        lines = rows(read_spectral_libraries([str(chosen.library)],
                                             FINE_GRID).spectra[::chosen.every])
    else:
        lines = rows(test_reflectances(FINE_GRID)["CES99"][::chosen.every])
    for line in lines:
        print(line, flush=True)


if __name__ == "__main__":
    main()
