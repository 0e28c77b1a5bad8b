"""How far a light may be from its statement: the terms by which the fit of a camera lets it depart.

Whoever names CIE D55 means some daylight of about that colour temperature: sun and sky in other
shares, through more air, behind glass, beside a wall. So the lamps of its kind (``lamps``) of about
its temperature say how the true light departs from the published one, and the fit of a camera
infers the departure along with the curves. A spectrum from a file is taken as it is: an error of
2 %, as instruments have it, changes curves by nothing that could be measured.
"""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spectrabox.calibrate.chart_equations import DARK_SHARE, field_terms
from spectrabox.calibrate.prior import curve_posterior, prior_fit
from spectrabox.calibrate.products import lamps as known_lamps
from spectrabox.radiometry import findings
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import photos, spectra
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid

MIRED_SD = 20.0              # of the light that shone about the one that was named
KEPT_VARIANCE = 0.995


# what a fit infers of a stated light: how far it is from its statement, and the spectrum (P,) that
# shone, of mean 1
Departure = tuple[findings.Finding, np.ndarray]


def light_terms(light: spectra.Spectrum, grid: spectra.WavelengthGrid) -> np.ndarray | None:
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
    kind = known_lamps.nominal_kind(light.source)
    if kind is None:
        return None
    stated = spectrum_on_grid(light, FINE_GRID)
    lamps = known_lamps.lamps_like(
        spectra.UnknownLight(kind, float(known_lamps.colour_temperatures(stated[None])[0])),
                                   MIRED_SD)
    # published are few, and odd
    computed = np.array([known_lamps.BY_FORMULA in name for name in lamps.names])
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


def light_departures(posterior: prior_fit.CurvePosterior, lights: Sequence[spectra.Spectrum],
                     grid: spectra.WavelengthGrid) -> tuple[Departure, ...]:
    """What a fit infers of every light that may depart from its statement, each light once.

    Sizes are root mean squares over wavelengths of the logarithm: that expected beforehand, that
    inferred, and its standard error.

    Parameters
    ----------
    posterior : CurvePosterior
    lights : sequence of Spectrum
        As stated, of the photos in the order in which the posterior was made.
    grid : WavelengthGrid
        Working grid, every nm from 400 to 700 nm.
    """
    mean, covariance = curve_posterior.mixture_moments(posterior.weights, posterior.means,
                                                       posterior.covariances)
    departures = {}
    for stated, light in zip(lights, posterior.lights, strict=False):   # none where all are exact
        if not light.terms.size or light.own.start in departures:
            continue
        error = light.terms @ covariance[light.own, light.own] @ light.terms.T
        logarithm = light.logarithm(mean)
        spectrum = spectrum_on_grid(stated, grid) * (posterior.basis @ np.exp(logarithm))
        spectrum /= spectrum.mean()
        departures[light.own.start] = findings.Finding(
            "light.departs", findings.Severity.INFO, values={
                "stated": stated.source,
                "expected": float(np.sqrt(np.mean(np.sum(light.terms**2, axis=1)))),
                "size": float(np.sqrt(np.mean(logarithm**2))),
                "size_error": float(np.sqrt(np.trace(error) / len(error))),
                "kelvin": float(known_lamps.colour_temperatures(spectrum[None])[0])}), spectrum
    return tuple(departures.values())


# ---- lights of two photos ------------------------------------------------------------------------
# How far the lights of two photos of one chart differ, as one camera tells them apart.
#
# Under one light the signals of a patch in two photos differ by exposure and by the field of the
# light, which all bands have in common. What is left of their logarithms is a difference of
# spectra. Of the pairs of 181 measured lamps, one in two differs by more than 21 %, and one in a
# thousand by less than 1.4 %; within 1 % are lamps that are one but for their name.

SAME_LIGHT = 0.01           # of the signals: a second photo averages noise, and adds no band
OTHER_LIGHT = 0.03          # beyond it no lamp is one that was switched off and on, or grew warm


def light_difference(first: photos.PatchSamples, other: photos.PatchSamples,
                     positions: np.ndarray) -> float:
    """Relative difference (standard deviation over bands and patches) that no field and exposure
    explain.

    Patches that are dark or clipped in a band of either photo say nothing, and noise is taken off.

    Parameters
    ----------
    first, other : PatchSamples
        Of one chart, by one camera.
    positions : (I, 2) array
        Of the patches on the chart.
    """
    bright = ~(first.clipped | other.clipped).any(axis=1)
    for samples in (first, other):
        bright &= (samples.mean > DARK_SHARE * samples.mean.max(axis=0)).all(axis=1)
    difference = np.log(other.mean[bright] / first.mean[bright])
    noise = sum(np.diagonal(samples.covariance_of_mean, axis1=1, axis2=2)[bright]
                / samples.mean[bright] ** 2 for samples in (first, other))
    patches, bands = difference.shape
    terms = np.column_stack([np.ones(patches), field_terms(positions)[bright]])
    in_common = difference.mean(axis=1)
    own = difference - in_common[:, None]
    # of each patch one value in ``bands`` goes to what all bands have in common
    spread = np.mean(own**2) * bands / (bands - 1) - np.mean(noise)
    off_field = in_common - terms @ np.linalg.lstsq(terms, in_common, rcond=None)[0]
    of_field = np.sum(off_field**2) / max(patches - terms.shape[1], 1) - np.mean(noise) / bands
    return float(np.sqrt(max(spread, 0.0) + max(of_field, 0.0)))
