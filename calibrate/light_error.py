"""How far a light may be from its statement: the terms by which the fit of a camera lets it depart.

Whoever names CIE D55 means some daylight of about that colour temperature: sun and sky in other
shares, through more air, behind glass, beside a wall. So the lamps of its kind (``lamps``) of about
its temperature say how the true light departs from the published one, and the fit of a camera
infers the departure along with the curves. A spectrum from a file is taken as it is: an error of
2 %, as instruments have it, changes curves by nothing that could be measured.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.calibrate.prior.curve_posterior import mixture_moments
from spectrabox.calibrate.prior.prior_fit import CurvePosterior
from spectrabox.calibrate.products.lamps import (
    BY_FORMULA,
    colour_temperatures,
    lamps_like,
    nominal_kind,
)
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import Spectrum, UnknownLight, WavelengthGrid
from spectrabox.radiometry.shaped import Record
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid

MIRED_SD = 20.0              # of the light that shone about the one that was named
KEPT_VARIANCE = 0.995


@dataclass(frozen=True, eq=False)
class LightDeparture(Record):
    """How far the light of a photo is from its statement, as the fit of a camera infers it.

    Sizes are root mean squares over wavelengths of the logarithm.
    """

    source: str                                     # what was stated
    expected: float                                 # size beforehand
    size: float
    size_error: float                               # standard error of the departure, its size
    spectrum: Annotated[np.ndarray, "P"]            # that shone, of mean 1

    @property
    def words(self) -> str:
        """One sentence for an operator."""
        kelvin = float(colour_temperatures(self.spectrum[None])[0])
        return (f"light {self.source} was taken to be right within {self.expected:.0%} (rms over "
                f"wavelengths); the chart makes it {self.size:.0%} ± {self.size_error:.0%} off, "
                f"about {kelvin:.0f} K")


def light_terms(light: Spectrum, grid: WavelengthGrid) -> np.ndarray | None:
    """How the logarithm of the true light departs from that of a stated one.

    Parameters
    ----------
    light : Spectrum
    grid : WavelengthGrid
        Working grid, of P wavelengths.

    Returns
    -------
    (P, J) array or None
        The departure is the sum of J independent unit normals times these. None: a spectrum that
        was measured, or of a lamp whose spectrum its name settles.
    """
    kind = nominal_kind(light.source)
    if kind is None:
        return None
    stated = spectrum_on_grid(light, FINE_GRID)
    lamps = lamps_like(UnknownLight(kind, float(colour_temperatures(stated[None])[0])), MIRED_SD)
    computed = np.array([BY_FORMULA in name for name in lamps.names])  # published are few, and odd
    departures = np.log(lamps.spectra[computed] / stated)
    departures -= departures.mean(axis=1, keepdims=True)    # brightness is the exposure's
    weights = lamps.weights[computed] / lamps.weights[computed].sum()
    # about what was named, not about the mean of such lamps: that is the likeliest single light
    _, sizes, directions = np.linalg.svd(np.sqrt(weights)[:, None] * departures,
                                         full_matrices=False)
    share = np.cumsum(sizes**2) / np.sum(sizes**2)
    kept = int(np.searchsorted(share, KEPT_VARIANCE)) + 1
    return np.array([np.interp(grid.nm, FINE_GRID.nm, size * direction)
                     for size, direction in zip(sizes[:kept], directions[:kept], strict=True)]).T


def light_departures(posterior: CurvePosterior, lights: Sequence[Spectrum],
                     grid: WavelengthGrid) -> tuple[LightDeparture, ...]:
    """What a fit infers of every light that may depart from its statement, each light once.

    Parameters
    ----------
    posterior : CurvePosterior
    lights : sequence of Spectrum
        As stated, of the photos in the order in which the posterior was made.
    grid : WavelengthGrid
        Working grid, every nm from 400 to 700 nm.
    """
    mean, covariance = mixture_moments(posterior.weights, posterior.means, posterior.covariances)
    departures = {}
    for stated, light in zip(lights, posterior.lights, strict=False):   # none where all are exact
        if not light.terms.size or light.own.start in departures:
            continue
        error = light.terms @ covariance[light.own, light.own] @ light.terms.T
        logarithm = light.logarithm(mean)
        spectrum = spectrum_on_grid(stated, grid) * (posterior.basis @ np.exp(logarithm))
        departures[light.own.start] = LightDeparture(
            stated.source, float(np.sqrt(np.mean(np.sum(light.terms**2, axis=1)))),
            float(np.sqrt(np.mean(logarithm**2))), float(np.sqrt(np.trace(error) / len(error))),
            spectrum / spectrum.mean())
    return tuple(departures.values())
