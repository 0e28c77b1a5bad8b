"""A photo's regions with their light transport, as the samplers of a whole scene take them."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.radiometry.records import LightTransport
from spectrabox.radiometry.shaped import Record
from spectrabox.reconstruct.fit.traced_fit import TracedView, weighed_regions
from spectrabox.reconstruct.fit.transport_fit import FitPriors, TransportFit

DOUBTED = 0.5  # weight of a region in the robust fit below which the samplers leave it out


@dataclass(frozen=True, eq=False)
class RegionTransport(Record):
    """R regions of one photo: what they show, how surely, and how light reaches them."""

    transport: LightTransport                       # for reflectances and a light spectrum of 1
    signal: Annotated[np.ndarray, "R K"]            # NaN where the fit does not trust the region
    # independent: photo, Monte Carlo, unevenness within a surface
    standard_error: Annotated[np.ndarray, "R K"]
    surface: Annotated[np.ndarray, "R"]             # index into the scene's surfaces
    colour_error: float                             # relative, of each surface in each band
    brightness_error: float                         # relative, of each surface in all bands alike


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
