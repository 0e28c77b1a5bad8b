"""Fit photos whose light transport has been traced: noise, robust weights, and several photos in
one fit.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from spectrabox.reconstruct.fit.band_system import compress, huber_weight
from spectrabox.reconstruct.fit.photo_terms import PhotoTerms
from spectrabox.reconstruct.fit.transport_fit import (
    FitPriors,
    SpectrumModel,
    TransportFit,
    fit_photos,
)
from spectrabox.reconstruct.problem import InverseProblem, MaterialSpec
from spectrabox.reconstruct.scene.regions import region_means
from spectrabox.reconstruct.tracer.transport import TracedTransport

LAMP_SHARE = 1e-3  # of a region's light straight from a lamp: above, its edge runs through a pixel
ROBUST_ROUNDS = 2        # times that pixels beyond HUBER sigma are weighed anew


@dataclass(frozen=True)
class TracedView:
    """One photo and its light transport by regions."""

    problem: InverseProblem
    traced: TracedTransport
    region: np.ndarray              # (H, W)
    group: np.ndarray               # (R,) surface of each region

    @property
    def model(self) -> SpectrumModel:
        """What the transport's products stand for; one response for each light that was traced
        apart.
        """
        problem, apart = self.problem, self.traced.passes.shape[2] > 1
        return SpectrumModel(self.traced.exponents, problem.responses if apart
                             else problem.responses[:1], problem.basis, {index: material.reflectance
                                                                         for index, material
                                                                         in enumerate(
                                                                             problem.materials)
                                                                         if material.reflectance
                                                                         is not None})


def unknown_materials(problems: Sequence[InverseProblem]) -> tuple[MaterialSpec, ...]:
    """The materials that are looked for in any of the photos, each once."""
    return tuple({material.bsdf: material for problem in problems
                  for material in problem.unknown}.values())


def fit_traced(views: Sequence[TracedView], priors: Sequence[FitPriors]) -> TransportFit:
    """Fit the regions; those that no spectrum explains lose weight round by round, those that see
    the lamp count none.

    Parameters
    ----------
    views : V photos
    priors : one for each photo; that of the spectra is the first's
    """
    # the matrices are small: several threads would take longer than one
    with threadpool_limits(1, "blas"):
        weighed = [_Weighed(view, prior) for view, prior in zip(views, priors, strict=True)]
        names = [material.bsdf for material in unknown_materials([view.problem for view in views])]
        places = [tuple(names.index(material.bsdf) for material in view.problem.unknown)
                  for view in views]
        spectra = priors[0].spectrum(views[0].problem.basis.shape[1])
        fit = fit_photos([photo.terms(None) for photo in weighed], places, spectra)
        for _ in range(ROBUST_ROUNDS):
            terms = [photo.terms(photo.trust(fit, number)) for number, photo in enumerate(weighed)]
            fit = fit_photos(terms, places, spectra, fit.coefficients)
        return fit


def weighed_regions(view: TracedView, priors: FitPriors, fit: TransportFit,
                    number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Signals (R, K) of a view's regions, their variance, and the weight (R,) that the fit gave
    each in the end.
    """
    photo = _Weighed(view, priors)
    seen = photo.weight.max(axis=1) > 0
    return photo.measured, photo.variance, np.where(seen, photo.trust(fit, number).min(axis=1), 0.0)


class _Weighed:
    """Signals of a view's regions with their variance, and the weight of each."""

    def __init__(self, view: TracedView, priors: FitPriors) -> None:
        problem, traced, region = view.problem, view.traced, view.region
        self.view, self.priors, self.model = view, priors, view.model
        self.measured = region_means(problem.measured, region)
        pixels = np.bincount(region[region >= 0])
        rendering = _smoothed(traced.relative_variance, view.group, pixels)
        self.variance = (region_means(problem.variance, region) / pixels[:, None]
                         + (rendering[:, None] + priors.block_error**2) * self.measured**2)
        self.coefficients, self.deviations = traced.coefficients, traced.deviations
        direct = self.coefficients[:, ::len(traced.exponents)].sum(axis=1)
        lamp = direct > LAMP_SHARE * self.coefficients.sum(axis=1)
        self.weight = np.where(lamp[:, None], 0.0, 1 / self.variance)

    def terms(self, trust: np.ndarray | None) -> PhotoTerms:
        """The photo's part of the cost, its regions weighed by ``trust`` (R, 1)."""
        weight = self.weight if trust is None else trust * self.weight
        return PhotoTerms(compress(self.coefficients, self.measured, weight, self.view.group,
                                   self.deviations), self.model, self.priors)

    def trust(self, fit: TransportFit, number: int) -> np.ndarray:
        """Huber weight (R, 1) of each region at the solution."""
        found = fit.views[number]
        gain = np.array([found.gains.get(name, np.ones(self.measured.shape[1]))
                         for name in self.view.group.tolist()])
        predicted = found.scale * gain * (self.coefficients @ found.signals)
        return huber_weight(self.measured - predicted, np.sqrt(self.variance))


def _smoothed(relative_variance: np.ndarray, group: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Monte Carlo variance (R,) of each region, half its own and half its surface's: few passes
    know it only roughly.

    Regions differ in size, so what they share is the variance of one pixel's paths.
    """
    of_pixel = relative_variance * pixels
    pooled = np.bincount(group, of_pixel) / np.maximum(np.bincount(group), 1)
    return 0.5 * (of_pixel + pooled[group]) / pixels
