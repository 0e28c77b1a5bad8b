"""One region of flat samples at a time: the numbers of a run's stages, without the other regions.

Regions do not influence each other, but for those of known spectrum. So what a run makes of all
can be made of one in a twentieth of a second, once photo and calibration are in memory.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.measure.flat import flat_signals
from spectrabox.measure.surface_signals import measurement
from spectrabox.measure.surface_spectra import DrawOptions, sample_surfaces
from spectrabox.measure.white import FlatErrors, FlatPhoto, white_at_regions
from spectrabox.radiometry.records import RegionSamples, SurfaceSignals, SurfaceSpectrum
from spectrabox.sampling.prior.mixture import load_prior, of_families
from spectrabox.sampling.prior.signal_posterior import SignalPosterior, solve_posterior


@dataclass(frozen=True, eq=False)
class RegionSignal:
    """What the photos tell of one region."""

    signals: SurfaceSignals         # of the region alone
    light: tuple[float, float]      # relative to the chart's mean, and its relative standard error
    scatter: float                  # of pixels beyond noise and even light, in the worst band

    def posterior(self, families: Sequence[str]) -> SignalPosterior:
        """Every spectrum behind it in closed form, for a surface that is said to be of families."""
        return solve_posterior(of_families(load_prior(), families), measurement(self.signals, 0))

    def spectrum(self, families: Sequence[str], options: DrawOptions) -> SurfaceSpectrum:
        """The spectrum as a run draws it, whose seed is that of the run plus the region's index."""
        name = self.signals.names[0]
        return sample_surfaces(self.signals, options, {name: families},
                               lambda done, what: None)[name]


def signal_of_region(photos: Sequence[FlatPhoto], samples: Sequence[RegionSamples | None],
                     families: Sequence[str], known: Mapping[str, np.ndarray],
                     bands: Sequence[str], errors: FlatErrors) -> RegionSignal:
    """The signal of one region with its errors, as a run has it among all regions.

    Parameters
    ----------
    photos : sequence of FlatPhoto
        Their own samples are not looked at.
    samples : sequence of RegionSamples or None
        Of each photo: the region first, then regions of known spectrum; None where a photo does
        not show the region.
    families : sequence of str
        That the region's surface is said to be of; none for any.
    known : mapping
        From names of regions to their known reflectances (P,) on the grid.
    bands : sequence of K str
        Names of the camera's bands.
    errors : FlatErrors

    Raises
    ------
    InputError, CheckError
        As ``white.white_at_regions``.
    """
    whites = [white_at_regions(dataclasses.replace(photo, samples=own), known, errors)
              for photo, own in zip(photos, samples, strict=True)]
    first = next(white for white in whites if white is not None)
    name = first.samples.names[0]
    signals = flat_signals(photos, whites, {name: families}, {}, bands, errors)
    return RegionSignal(signals, (float(np.exp(first.log_field[0])), float(first.field_error[0])),
                        float(first.samples.scatter[0].max()))
