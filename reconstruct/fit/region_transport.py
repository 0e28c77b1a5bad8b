"""A photo's regions with their light transport, as the samplers of a whole scene take them."""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.records import LightTransport, RegionTransport
from spectrabox.reconstruct.fit.traced_fit import TracedView, weighed_regions
from spectrabox.reconstruct.fit.transport_fit import FitPriors, TransportFit

DOUBTED = 0.5  # weight of a region in the robust fit below which the samplers leave it out


def region_transport(view: TracedView, priors: FitPriors, fit: TransportFit,
                     number: int) -> RegionTransport | None:
    """The regions of view ``number`` of a fit; None where lights were traced apart: their spectra
    differ.
    """
    traced = view.traced
    if traced.passes.shape[2] > 1:
        return None
    measured, variance, weight = weighed_regions(view, priors, fit, number)
    signal = np.where(weight[:, None] >= DOUBTED, measured, np.nan)
    return RegionTransport(
        LightTransport(tuple(material.name for material in view.problem.materials),
                       np.array(traced.exponents), np.array(traced.coefficients), None),
        signal, np.sqrt(variance), np.array(view.group), priors.gain_error, priors.brightness_error)
