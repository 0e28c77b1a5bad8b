"""What a chart photo says of its light by itself: kinds of lamps, mean, band, and how surely."""
from __future__ import annotations

import numpy as np

from spectrabox.calibrate.products.product_posterior import ProductPosterior
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.records import LightPosterior, WavelengthGrid
from spectrabox.radiometry.spectra.light_words import LIGHT_KINDS

LEVEL = 0.9
NORMAL_QUANTILE = 1.6449
# of the evidence for a kind: a photo's lamp is none of the prior's, and the best of few components
# decides. Least log loss over daylights by a model of the atmosphere and published lamps that are
# left out in turn, under cameras of makers that are left out
# (benchmarks/bench_light_kinds.py --probabilities --published)
EVIDENCE_POWER = 0.65
SURE, OPEN = 0.9, 0.25      # probability of a kind: from there one kind is named, or two
NARROWED = 0.75             # width of the band over the prior's: above, the photo says little


def light_posterior(posterior: ProductPosterior, grid: WavelengthGrid) -> LightPosterior:
    """The light behind the products.

    Parameters
    ----------
    posterior : ProductPosterior
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    prior = posterior.prior
    basis = interpolation_matrix(prior.nm, grid.nm)
    # the lamp of each component moves with its products: one gain for all
    kind = prior.lamps.kind[prior.lamp]
    shares = np.zeros(len(LIGHT_KINDS))
    mean, square = np.zeros(prior.nm.size), np.zeros(prior.nm.size)
    for hypothesis in posterior.hypotheses:
        shares += hypothesis.share * np.bincount(kind, hypothesis.weights,
                                                 minlength=len(LIGHT_KINDS))
        lamps = prior.components[:, prior.light] + (
            hypothesis.seen @ hypothesis.projected[prior.light].T)
        lamps = np.maximum(lamps, 0)
        own = np.maximum(np.diag(hypothesis.covariance)[prior.light], 0)
        mean += hypothesis.share * (hypothesis.weights @ lamps)
        square += hypothesis.share * (hypothesis.weights @ lamps**2 + own)
    total = sum(hypothesis.share for hypothesis in posterior.hypotheses)
    mean, square = mean / total, square / total
    of_prior = np.bincount(kind, prior.weights, minlength=len(LIGHT_KINDS))
    shares = of_prior**(1 - EVIDENCE_POWER) * shares**EVIDENCE_POWER
    shares = shares / shares.sum()
    half = NORMAL_QUANTILE * np.sqrt(np.maximum(square - mean**2, 0))
    every_lamp = prior.components[:, prior.light]
    before = NORMAL_QUANTILE * np.sqrt(
        prior.weights @ (every_lamp - prior.weights @ every_lamp) ** 2)
    fine = mean @ basis.T
    scale = 1 / fine.mean()
    lower, upper = np.maximum(mean - half, 0) @ basis.T, (mean + half) @ basis.T
    return LightPosterior(grid, LIGHT_KINDS, shares, fine * scale, lower * scale, upper * scale,
                          LEVEL, _sentences(shares, half, before, mean))


def _sentences(shares: np.ndarray, half: np.ndarray, before: np.ndarray,
               mean: np.ndarray) -> tuple[str, ...]:
    order = np.argsort(-shares)
    first, second = (LIGHT_KINDS[index] for index in order[:2])
    if shares[order[0]] >= SURE:
        sentences = [f"the chart's light is {first} ({shares[order[0]]:.0%})"]
    elif shares[order[1]] >= OPEN:
        sentences = [f"the chart cannot tell two kinds of light apart: {first} "
                     f"({shares[order[0]]:.0%}) and {second} ({shares[order[1]]:.0%})"]
    else:
        sentences = [f"the chart's light is likely {first} ({shares[order[0]]:.0%}), else {second} "
                     f"({shares[order[1]]:.0%})"]
    width = float(np.mean(half) / np.mean(mean))
    sentences.append(f"its spectrum by itself is known within {width:.0%} of its mean "
                     f"({LEVEL:.0%} band); your spectra do not need the lamp alone, so they are "
                     "far better")
    if np.mean(half) > NARROWED * np.mean(before):
        sentences.append("the chart says little of the light by itself: relighting from under it, "
                         "or another camera under it, needs its measured spectrum")
    return tuple(sentences)
