"""The same surfaces in several sessions: do their spectra agree within what each is known to?"""
from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.appearance import delta_e00
from spectrabox.radiometry.records import SpectrumSummary
from spectrabox.session.compare.quantities import SessionQuantities

EXPECTED_OUT = 0.2      # share of wavelengths outside both errors beyond which two disagree
WIDTH = 1.96            # standard deviations


@dataclass(frozen=True)
class SurfacePair:
    """One surface in two sessions."""

    surface: str
    first: int                  # indices of the sessions
    second: int
    delta_e00: float            # of the means under D65
    rms: float                  # of the means' difference
    share_out: float            # of wavelengths at which they differ by more than both errors
    disagree: bool


def surface_pairs(sessions: Sequence[SessionQuantities]) -> list[SurfacePair]:
    """Every surface that two sessions call by one name, whatever camera and light they had.

    Parameters
    ----------
    sessions : sequence of SessionQuantities
    """
    pairs = []
    for (first, one), (second, other) in itertools.combinations(enumerate(sessions), 2):
        for name in one.spectra:
            if name in other.spectra:
                pairs.append(_pair(name, first, second, one.spectra[name], other.spectra[name]))
    return pairs


def _pair(name: str, first: int, second: int, one: SpectrumSummary,
          other: SpectrumSummary) -> SurfacePair:
    nm = one.grid.nm
    mean = np.interp(nm, other.grid.nm, other.mean)
    deviation = np.interp(nm, other.grid.nm, other.standard_deviation)
    off = one.mean - mean
    out = float(np.mean(np.abs(off) > WIDTH * np.hypot(one.standard_deviation, deviation)))
    return SurfacePair(name, first, second, float(delta_e00(nm, one.mean, mean)),
                       float(np.sqrt(np.mean(off**2))), out, out > EXPECTED_OUT)
