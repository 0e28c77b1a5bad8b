"""What a chart says of camera and light: curves, light scale, filters, their errors."""
from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records import spectra
from spectrabox.radiometry.shaped import Record


@dataclass(frozen=True, eq=False)
class Filter(Record):
    """A filter before lens or lamp: its transmittance is that of ``transmittance`` times
    ``calibrate.chart_equations.passed`` of modes @ e, with e normal about 0: as it was stated, or
    as chart photos with and without it know it, together with the camera's curves.
    """

    name: str
    transmittance: Annotated[np.ndarray, "P"]       # at 400, 401 ... 700 nm; its level is free
    modes: Annotated[np.ndarray, "P E"]             # relative errors
    covariance: Annotated[np.ndarray, "E E"]        # of e
    # of e with the curves' coefficients; None of a filter as stated: none
    with_curves: Annotated[np.ndarray, "E D"] | None = None


@dataclass(frozen=True, eq=False)
class SensitivityFit(Record):
    """Camera sensitivities on the working grid, the largest value of all bands being 1."""

    grid: spectra.WavelengthGrid
    curves: Annotated[np.ndarray, "K P"]
    # What follows up to the outcome is None where the curves were measured and read from a file.
    basis: Annotated[np.ndarray, "P N"] | None
    coefficients: Annotated[np.ndarray, "K N"] | None
    covariance: Annotated[np.ndarray, "D D"] | None             # D = K N, band after band
    standard_error: Annotated[np.ndarray, "K P"] | None
    residuals: Annotated[np.ndarray, "I K"] | None              # (photo - fit) / photo
    held_out_residuals: Annotated[np.ndarray, "I K"] | None     # each patch left out of its fit
    condition_number: float | None
    method: str
    outcome: spectra.Outcome


@dataclass(frozen=True, eq=False)
class LightScale(Record):
    """Factor from a rendered signal, of sensitivities peaking at 1, to that of the photo."""

    value: float
    standard_error: float | None                    # of any one band, ``common_errors`` included
    residuals: Annotated[np.ndarray, "R K"] | None  # (photo - scale x rendered) / photo
    source: str
    # that all bands of a photo share, by cause: relative standard error
    common_errors: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class LightPosterior(Record):
    """What a chart says of a light by itself whose spectrum nobody stated; of mean 1."""

    grid: spectra.WavelengthGrid
    kinds: tuple[str, ...]                          # Q of light_words.LIGHT_KINDS
    probabilities: Annotated[np.ndarray, "Q"]
    mean: Annotated[np.ndarray, "P"]
    lower: Annotated[np.ndarray, "P"]               # pointwise band at ``level``
    upper: Annotated[np.ndarray, "P"]
    level: float
    findings: tuple[Finding, ...]                   # which kind it is, how well it is known


@dataclass(frozen=True, eq=False)
class ChartWhite(Record):
    """What a perfect white would read in place of the chart, and beyond it, in one chart photo.

    signal = level exp(terms @ field) x relative signal + glare, with the ``terms`` (E,) of a
    position from ``calibrate.chart_equations.field_terms``.
    """

    level: Annotated[np.ndarray, "K"]               # signal, where the terms of the field are 0
    field: Annotated[np.ndarray, "E"]               # of the logarithm; E = 0 where light is even
    glare: Annotated[np.ndarray, "K"]               # signal
    covariance: Annotated[np.ndarray, "Z Z"]        # of log level, field, glare: Z = 2 K + E

    @property
    def glare_error(self) -> np.ndarray:
        """Standard error (K,) of the glare."""
        return np.sqrt(np.diag(self.covariance)[-len(self.glare):])


def share_inside(lower: np.ndarray, upper: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Share (I,) of wavelengths at which bands (I, P) hold the truth."""
    return np.asarray(((lower <= truth) & (truth <= upper)).mean(axis=1))


@dataclass(frozen=True, eq=False)
class ChartCopy(Record):
    """What photos say of the copy of a chart whose reflectances nobody stated: of which edition it
    is, and how its patches depart from the mean of that edition. Logarithms, with standard errors.
    """

    edition: str                                    # name of its reference
    made: str                                       # as `ChartCopies.made` of that edition
    probability: float                              # of that edition
    evidence: dict[str, float]                      # of each edition, nats over the usual one
    level: Annotated[np.ndarray, "I"]               # of each patch, from 430 nm on
    level_error: Annotated[np.ndarray, "I"]
    tint: Annotated[np.ndarray, "I"]                # blue less red: negative where it is yellower
    tint_error: Annotated[np.ndarray, "I"]
    reflectances: Annotated[np.ndarray, "I P"]      # of this copy, most likely
    level_spread: Annotated[np.ndarray, "I"]        # standard deviation among its copies
    tint_spread: Annotated[np.ndarray, "I"]


@dataclass(frozen=True, eq=False)
class HeldOutPatches(Record):
    """Reflectance of each patch of a chart from its own signal and a calibration without it."""

    grid: spectra.WavelengthGrid
    mean: Annotated[np.ndarray, "I P"]
    lower: Annotated[np.ndarray, "I P"]             # pointwise band at ``level``
    upper: Annotated[np.ndarray, "I P"]
    reference: Annotated[np.ndarray, "I P"]         # of the chart, taken as the truth
    excluded: Annotated[np.ndarray, "I"]            # bool: excluded from every fit
    expected: Annotated[np.ndarray, "I"]            # as ``inside``, had nothing erred
    level: float
    # how much brighter than by the other patches the photo shows each, relative, and the standard
    # error of that; and how likely a colour that is at least as far off is by chance
    brighter: Annotated[np.ndarray, "I"] | None = None
    brighter_error: Annotated[np.ndarray, "I"] | None = None
    colour_chance: Annotated[np.ndarray, "I"] | None = None
    saturated: Annotated[np.ndarray, "I"] | None = None     # bool: its own signal is not known

    @property
    def judged(self) -> np.ndarray:
        """Whether each patch (I,) has a signal of its own to be judged by."""
        return np.ones(len(self.mean), bool) if self.saturated is None \
            else ~self.saturated.astype(bool)

    @property
    def counted(self) -> np.ndarray:
        """Those (I,) of them that the operator did not leave out: all, where none is left."""
        counted = self.judged & ~self.excluded.astype(bool)
        return counted if counted.any() else self.judged

    @property
    def rmse(self) -> np.ndarray:
        """Root mean square error (I,) of each patch over wavelengths."""
        return np.asarray(np.sqrt(np.mean((self.mean - self.reference) ** 2, axis=1)))

    @property
    def inside(self) -> np.ndarray:
        """Share (I,) of wavelengths at which the band holds the reference."""
        return share_inside(self.lower, self.upper, self.reference)

    @property
    def means(self) -> tuple[float, float, float]:
        """Mean of ``rmse``, ``inside`` and ``expected`` over the patches that count."""
        return (float(self.rmse[self.counted].mean()), float(self.inside[self.counted].mean()),
                float(self.expected[self.counted].mean()))


@dataclass(frozen=True, eq=False)
class Calibration(Record):
    """All that turns rendered spectra into camera signal, and the error of predicted signals."""

    sensitivity: SensitivityFit
    light: spectra.Spectrum
    light_scale: LightScale | None                  # None: a known material of the scene tells it
    relative_covariance: Annotated[np.ndarray, "K K"]   # of (photo - predicted) / photo
    findings: tuple[Finding, ...]                   # of light, chart and fit; from WARN on doubts
    # Where the light is unknown ``sensitivity`` holds the products of sensitivity and light,
    # ``light`` is 1 at every wavelength, and this says what is known of the light by itself, if the
    # bands are those of measured cameras.
    light_posterior: LightPosterior | None = None
    products: bool = False                          # whether the light is unknown
    # Of a photo through a filter: ``light`` is then the light that the filter lets pass.
    filter: Filter | None = None
