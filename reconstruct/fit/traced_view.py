"""Views whose light has been traced: noise, robust weights, and several views in one fit."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spectrabox.radiometry.records.scenes import KnownLight, LightTransport, RegionTransport
from spectrabox.reconstruct.fit.spectrum_prior import SpectrumPrior
from spectrabox.reconstruct.fit.transport_fit import TransportFit, fit_views
from spectrabox.reconstruct.fit.view_terms import (
    Nuisances,
    SpectrumModel,
    ViewFit,
    ViewTerms,
    compress,
    huber_weight,
)
from spectrabox.reconstruct.scene.surfaces import region_means
from spectrabox.reconstruct.tracer.transport import TracedTransport
from spectrabox.reconstruct.view import PhotoView, unknown_materials

LAMP_SHARE = 1e-3  # of a region's light straight from a lamp: above, its edge runs through a pixel
ROBUST_ROUNDS = 2        # times that pixels beyond HUBER sigma are weighed anew
DOUBTED = 0.5  # weight of a region in the robust fit below which the samplers leave it out


@dataclass(frozen=True, eq=False)
class TracedView:
    """One view with its light transport by R regions, and the weight of each region."""

    view: PhotoView
    traced: TracedTransport
    region: np.ndarray              # (H, W)
    group: np.ndarray               # (R,) surface of each region
    nuisances: Nuisances
    known_light: KnownLight | None = None   # by which the view's photo and light scale are tied

    @cached_property
    def measured(self) -> np.ndarray:
        """Signal (R, K)."""
        return region_means(self.view.measured, self.region)

    @cached_property
    def variance(self) -> np.ndarray:
        """Variance (R, K) of the signal against the rendering."""
        pixels = np.bincount(self.region[self.region >= 0])
        rendering = smoothed_variance(self.traced.relative_variance, self.group, pixels)
        return self.photo_variance + rendering[:, None] * self.measured**2

    @cached_property
    def photo_variance(self) -> np.ndarray:
        """Variance (R, K) of the signal against a rendering without noise."""
        pixels = np.bincount(self.region[self.region >= 0])
        return np.asarray(region_means(self.view.variance, self.region) / pixels[:, None]
                          + self.nuisances.block_error**2 * self.measured**2)

    @cached_property
    def weight(self) -> np.ndarray:
        """Inverse variance (R, K), 0 for the regions that see a lamp."""
        coefficients = self.traced.coefficients
        direct = coefficients[:, ::len(self.traced.exponents)].sum(axis=1)
        lamp = direct > LAMP_SHARE * coefficients.sum(axis=1)
        return np.where(lamp[:, None], 0.0, 1 / self.variance)

    def terms(self, coefficients: int, trust: np.ndarray | None = None) -> ViewTerms:
        """The view's part of the cost.

        Parameters
        ----------
        coefficients : int
            N of every spectrum.
        trust : (R, 1) array, optional
            Factor on the weight of each region, 0 to 1.
        """
        weight = self.weight if trust is None else trust * self.weight
        system = compress(self.traced.coefficients, self.measured, weight, self.group,
                          self.traced.deviations)
        view, responses = self.view, self.view.responses
        known = {index: material.reflectance
                 for index, material in enumerate(view.scene_materials)
                 if material.reflectance is not None}
        # a response for each light that was traced separately
        model = SpectrumModel(self.traced.exponents,
                              responses if self.traced.passes.shape[2] > 1 else responses[:1],
                              view.basis(coefficients), known)
        return ViewTerms(system, model, self.nuisances)

    def trust(self, fit: ViewFit) -> np.ndarray:
        """Huber weight (R, 1) of each region at the solution, in (0, 1].

        Parameters
        ----------
        fit : ViewFit
            Of this view.
        """
        gain = np.array([fit.gains.get(surface, np.ones(self.measured.shape[1]))
                         for surface in self.group.tolist()])
        predicted = fit.scale * gain * (self.traced.coefficients @ fit.signals)
        return huber_weight(self.measured - predicted, np.sqrt(self.variance))

    def regions(self, fit: ViewFit) -> RegionTransport | None:
        """The regions as the samplers of a whole scene take them.

        None where lights were traced separately, since their spectra differ.

        Parameters
        ----------
        fit : ViewFit
            Of this view; regions that it weighs below ``DOUBTED`` are left out.
        """
        traced = self.traced
        if traced.passes.shape[2] > 1:
            return None
        seen = self.weight.max(axis=1) > 0
        weight = np.where(seen, self.trust(fit).min(axis=1), 0.0)
        names = tuple(material.name for material in self.view.scene_materials)
        material = np.array([names.index(name) for name in self.view.surface_materials])[self.group]
        return RegionTransport(
            LightTransport(names, np.array(traced.exponents), np.array(traced.coefficients)),
            np.where(weight[:, None] >= DOUBTED, self.measured, np.nan), np.sqrt(self.variance),
            np.array(self.group), material, self.nuisances.surface_error,
            self.nuisances.brightness_error)


def fit_traced(views: Sequence[TracedView], priors: Sequence[SpectrumPrior],
               start: np.ndarray | None = None) -> TransportFit:
    """Most probable spectra of all views, fitted robustly.

    Regions that no spectrum explains lose weight round by round. Regions that see the lamp count
    nothing.

    Parameters
    ----------
    views : V views
    priors : U of SpectrumPrior
        In the order of ``unknown_materials``.
    start : (U, N) array, optional
        Coefficients from which the fit sets out.
    """
    bsdfs = [material.bsdf for material in unknown_materials([view.view for view in views])]
    materials = [tuple(bsdfs.index(material.bsdf) for material in view.view.unknown)
                 for view in views]
    count = priors[0].mean.size
    fit = fit_views([view.terms(count) for view in views], materials, priors, start)
    for _ in range(ROBUST_ROUNDS):
        terms = [view.terms(count, view.trust(solution))
                 for view, solution in zip(views, fit.views, strict=True)]
        fit = fit_views(terms, materials, priors, fit.coefficients)
    return fit


def smoothed_variance(relative_variance: np.ndarray, group: np.ndarray,
                      pixels: np.ndarray) -> np.ndarray:
    """Monte Carlo variance (R,) of each region, half its own and half its surface's.

    Few passes know it only roughly. Regions differ in size, so what they share is the variance of
    one pixel's paths.

    Parameters
    ----------
    relative_variance : (R,) array
    group : (R,) int
        Surface of each region.
    pixels : (R,) int
        Of each region.
    """
    of_pixel = relative_variance * pixels
    pooled = np.bincount(group, of_pixel) / np.maximum(np.bincount(group), 1)
    return 0.5 * (of_pixel + pooled[group]) / pixels
