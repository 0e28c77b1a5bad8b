"""What a chart tells of a picture for an archive, beside limits that are published.

The limits are those of ISO 19264-1:2021 (levels A to C) and of the FADGI guidelines of 2023 (4 to 1
stars, bound general collections), as a published comparison tabulates them (``SOURCE``); neither
text was at hand, so nothing here is a test after either. Quantities whose limits are not known to
us stand without any.
"""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from spectrabox.calibrate import colour_profile
from spectrabox.radiometry import appearance
from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.records.photos import PatchSamples

SOURCE = "https://skandalski.pl/tabela-fadgi-iso-metamorfoze/"
ISO, FADGI = "ISO 19264-1:2021", "FADGI 2023"
ISO_LEVELS, STARS = ("level A", "level B", "level C"), ("4 stars", "3 stars", "2 stars", "1 star")
STEP = 1e-4                 # of white: for derivatives of L*
Limits = dict[str, dict[str, float]]      # by guideline, of its grades, strictest first


def _limits(iso: tuple[float, ...], fadgi: tuple[float, ...] = ()) -> Limits:
    """Limits by guideline, strictest first."""
    by_name = {ISO: dict(zip(ISO_LEVELS, iso, strict=True)),
               FADGI: dict(zip(STARS[:len(fadgi)], fadgi, strict=True))}
    return {name: limits for name, limits in by_name.items() if limits}


def _quantity(name: str, value: float, unit: str, measured_on: str,
              limits: Limits) -> dict[str, Any]:
    """A quantity of a picture, as ``spectrabox colour --json`` has it."""
    return {"name": name, "value": value, "unit": unit, "measured_on": measured_on,
            "limits": limits,
            "grades": {guideline: grade(value, own) for guideline, own in limits.items()}}


def grade(value: float, limits: Mapping[str, float]) -> str:
    """The strictest grade whose limit a value keeps."""
    return next((name for name, limit in limits.items() if value <= limit),
                f"beyond {[*limits][-1]}")


def lightness_noise(samples: PatchSamples, signals: np.ndarray, white: np.ndarray,
                    transform: colour_profile.ColourTransform) -> np.ndarray:
    """Standard deviation (I,) of L* from pixel to pixel of a chart's patches.

    Parameters
    ----------
    samples : PatchSamples
    signals : (I, 3) array
        Relative to white.
    white : (I, 3) array
        Signal of a perfect reflector in each patch's place.
    transform : ColourTransform
    """
    slope = np.stack([(transform.lab(signals + STEP * one) - transform.lab(signals - STEP * one))
                      [:, 0] / (2 * STEP) for one in np.eye(3)], axis=1) / white
    variance = np.einsum("ij,ijk,ik->i", slope, samples.covariance_of_mean, slope)
    return np.sqrt(variance * samples.pixels)


def archive_quantities(layout: Chart, lab: np.ndarray, reference: np.ndarray, noise: np.ndarray,
                       light: np.ndarray) -> list[dict[str, Any]]:
    """What the chart tells of the picture, as ``spectrabox colour --json`` has it.

    Parameters
    ----------
    layout : Chart
    lab, reference : (I, 3) arrays
        Of the patches under D50, as pictured and as stated; NaN of those that are clipped.
    noise : (I,) array
        From ``lightness_noise``.
    light : (2, h, w) array
        Over the photo, relative to the chart's mean, and its relative error.
    """
    differences = appearance.ciede2000(lab, reference)
    shown = np.isfinite(differences)
    all_patches = f"all {shown.sum()} patches of the chart, CIEDE2000 under D50 to its reference"
    quantities = [
        _quantity("Colour accuracy, mean", float(differences[shown].mean()), "CIEDE2000",
                  all_patches, _limits((4, 5, 5), (2, 3.5, 5, 6.5))),
        _quantity("Colour accuracy, 90th percentile", float(np.percentile(differences[shown], 90)),
                  "CIEDE2000", all_patches, {}),
        _quantity("Colour accuracy, largest", float(differences[shown].max()), "CIEDE2000",
                  f"the worst patch, {layout.names[int(np.nanargmax(differences))]}",
                  _limits((10, 15, 15)))]
    grey = [patch for patch in layout.neutrals if shown[patch]]
    if grey:
        off = lab[grey] - reference[grey]
        on = f"the worst of {len(grey)} neutral patches"
        quantities += [
            _quantity("White balance", float(np.hypot(off[:, 1], off[:, 2]).max()),
                      "difference in a*, b*", on, _limits((3, 4, 5), (2, 4, 6, 8))),
            _quantity("Tone response", float(np.abs(off[:, 0]).max()), "difference in L*", on,
                      _limits((2, 3, 4), (1.5, 3, 4.5, 6))),
            _quantity("Noise", float(noise[grey].max()), "standard deviation of L*",
                      f"pixels of {on}", {})]
    level, error = light
    return [*quantities,
            _quantity("Unevenness of the light, as lit", float(1 - level.min() / level.max()),
                      "of the brightest place", "estimated over the photo from the chart's patches "
                      "and known regions; no even card was photographed", {}),
            _quantity("Unevenness that may be left in the picture", float(error.max()),
                      "relative standard error", "of that estimate in the worst place, by which "
                      "the picture was divided", {})]
