"""Every record that passes between stages, in flow order: read this file first.

Shape letters: H, W pixels; I patches of a chart; P wavelengths; N spline coefficients; K camera
bands (3 or more); M materials; R regions; E products of reflectances; T samples; S surfaces.
"signal" is linear, black-subtracted, without white balance, as a fraction of (white - black).
Wavelengths are in nm. Arrays are read-only.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Annotated

import numpy as np

from spectrabox.radiometry.shaped import Record

CLIPPED_LIMIT = 0.01        # of the samples of a patch: with more its mean is too low

# Callback of long work: the share that is done, 0 to 1, and what is being done.
Progress = Callable[[float, str], None]

MIN_PATCHES = 8         # of a chart: fewer fix no sensitivities
MIN_SWATCHES = 8        # of a material: of fewer, leave-one-out says next to nothing


class Quantity(Enum):
    """What a spectrum is a spectrum of; the value is its unit."""

    REFLECTANCE = "1"
    IRRADIANCE = "W m-2 nm-1"
    RADIANCE = "W m-2 sr-1 nm-1"
    RELATIVE = "relative"


class Outcome(Enum):
    """How a fit or a sampler ended; the value is the sentence that a person needs."""

    CONVERGED = "Converged."
    STEP_LIMIT = "Stopped at the step limit with the loss still falling: allow more iterations."
    ILL_POSED = ("Solved, but the data leave some directions undetermined: trust the uncertainty, "
                 "not the curve alone.")

    # draws of spectra as intended
    EXACT = "Independent draws from the exact distribution."
    FAMILIAR = ("Independent draws from the learnt prior; the signal is like those it was "
                "calibrated on.")
    THROUGH_TRANSPORT = ("Weighted draws from the learnt prior of all materials at once, through "
                         "the traced light transport, interreflection included.")

    # draws of spectra with a reservation
    UNREACHABLE = ("No spectrum of this class reproduces the signal exactly; "
                   "the draws fit it within its stated noise only.")
    MOVED = ("No spectrum of this class gives the signal: it was moved to the nearest that can be "
             "reached.")
    AS_PUBLISHED = "As published: a box around one solution, which under-states the spread."
    RANKED = "Ranked, not conditioned: draws need not agree with what was measured."
    UNFAMILIAR = ("This colour is unlike any in the training data: a wider band of untested "
                  "coverage is shown.")
    TOO_ROUGH = ("Only spectra rougher than any that were measured give the signal: the draws are "
                 "of the smoothness prior and come as near to it as they can; check the "
                 "calibration.")
    OUT_OF_REACH = ("No spectrum between 0 and 1 gives the signal; the draws are of the "
                    "smoothness prior and come as near to it as they can.")
    DISAGREES = ("The picture agrees with no spectra that the prior knows through this light "
                 "transport: the draws come as near as they can; check geometry, light and "
                 "calibration, or state a larger surface error.")


class PhotoKind(Enum):
    """Where the pixels of a photo come from."""

    RAW = "camera raw, decoded without demosaicing"
    LINEAR_FILE = "image file taken as linear"
    PROCESSED = "image processed by the camera, decoded as sRGB"


# ---- spectra -------------------------------------------------------------------------------------

@dataclass(frozen=True, eq=False)
class WavelengthGrid(Record):
    """Wavelengths and the weights that integrate over them (trapezoid rule)."""

    nm: Annotated[np.ndarray, "P"]
    weights_nm: Annotated[np.ndarray, "P"]


@dataclass(frozen=True, eq=False)
class Spectrum(Record):
    """One spectrum on its own grid. ``standard_error`` is None where nobody stated it."""

    grid: WavelengthGrid
    values: Annotated[np.ndarray, "P"]
    quantity: Quantity
    source: str
    standard_error: Annotated[np.ndarray, "P"] | None = None


@dataclass(frozen=True, eq=False)
class Filter(Record):
    """A filter before lens or lamp: its transmittance is that of ``transmittance`` times
    ``calibrate.chart_equations.passed`` of modes @ e, with e standard normal.
    """

    name: str
    transmittance: Annotated[np.ndarray, "P"]       # at 400, 401 ... 700 nm; its level is free
    modes: Annotated[np.ndarray, "P E"]             # relative errors


@dataclass(frozen=True, eq=False)
class FittedFilter(Record):
    """A filter as chart photos with and without it know it, together with the camera's curves."""

    filter: Filter                                  # transmittance: the estimate
    covariance: Annotated[np.ndarray, "E E"]        # of the modes' coefficients
    with_curves: Annotated[np.ndarray, "E D"]       # their covariance with the curves' coefficients


@dataclass(frozen=True, eq=False)
class UnknownLight(Record):
    """A light whose spectrum nobody stated; what is known of it narrows the lamps it may be."""

    kind: str | None = None     # one of light_words.LIGHT_KINDS
    cct: float | None = None    # correlated colour temperature, K

    @property
    def words(self) -> str:
        """What is known of it, as a report says it."""
        if self.cct is not None:
            return f"unknown light of {self.cct:g} K"
        return "unknown light" if self.kind is None else f"unknown light, {self.kind}"


def default_band_names(count: int) -> tuple[str, ...]:
    """Names of bands that nobody named: R, G, B of three, else band 1, band 2 ..."""
    return ("R", "G", "B") if count == 3 else tuple(f"band {band + 1}" for band in range(count))


# ---- capture -------------------------------------------------------------------------------------

@dataclass(frozen=True, eq=False)
class RawFrame(Record):
    """The mosaic as the sensor gave it, in sensor orientation."""

    mosaic: Annotated[np.ndarray, "H W"]            # uint16 DN, visible area
    cfa: Annotated[np.ndarray, "a b"]               # tile from pixel (0, 0): 0 R, 1 G, 2 B
    black_level: Annotated[np.ndarray, "a b"]       # DN at each position of the tile
    white_level: float                              # DN
    exposure_s: float | None
    iso: float | None
    f_number: float | None
    camera: str                                     # make, model and serial number as far as known
    file: str
    sha256: str
    camera_from_xyz: Annotated[np.ndarray, "3 3"] | None = None    # R, G, B of X, Y, Z, any scale
    matrix_of_file: bool = False                    # stated by the file, not known to LibRaw


@dataclass(frozen=True, eq=False)
class LinearImage(Record):
    """Linear camera signal; a pixel covers ``sensor_step`` x ``sensor_step`` of the photo's."""

    signal: Annotated[np.ndarray, "H W K"]          # float32
    variance: Annotated[np.ndarray, "H W K"]        # float32, signal squared
    saturated: Annotated[np.ndarray, "H W K"]       # bool: a sample in it is at the clip point
    sensor_step: float
    exposure_s: float | None                        # None where the file does not say
    iso: float | None
    f_number: float | None
    kind: PhotoKind
    camera: str
    source: str
    sha256: str
    camera_from_xyz: Annotated[np.ndarray, "3 3"] | None = None    # as in the raw frame
    matrix_of_file: bool = False

    @property
    def clipped_share(self) -> float:
        """Share of pixels of which any band is saturated."""
        return float(self.saturated.any(axis=2).mean())


@dataclass(frozen=True, eq=False)
class ChartDetection(Record):
    """Where the I patches lie, in full-resolution pixels; (0, 0) is the centre of the first."""

    corners_px: Annotated[np.ndarray, "I 4 2"]      # sampled quadrilaterals, chart order
    confidence: float                               # 0 to 1: agreement with the reference
    mirrored: bool
    how_found: str


@dataclass(frozen=True, eq=False)
class PatchSamples(Record):
    """Statistics of the I patches of a chart, row by row as printed on it."""

    mean: Annotated[np.ndarray, "I K"]              # signal
    covariance_of_mean: Annotated[np.ndarray, "I K K"]
    pixels: Annotated[np.ndarray, "I"]              # samples used in each patch
    saturated_fraction: Annotated[np.ndarray, "I K"]
    gradient: Annotated[np.ndarray, "I K"]          # relative change across the patch
    camera_from_xyz: Annotated[np.ndarray, "3 3"] | None = None    # where LibRaw knows the camera

    @property
    def clipped(self) -> np.ndarray:
        """Bands (I, K) of which the mean says nothing: too many samples are saturated."""
        return np.asarray(self.saturated_fraction > CLIPPED_LIMIT)

    @property
    def saturated(self) -> np.ndarray:
        """Whether every band of each patch (I,) is clipped, which leaves nothing to read."""
        return np.asarray(self.clipped.all(axis=1))

    @property
    def standard_error(self) -> np.ndarray:
        """Of each patch's mean (I, K), by the noise of its pixels."""
        return np.sqrt(np.diagonal(self.covariance_of_mean, axis1=1, axis2=2))


@dataclass(frozen=True, eq=False)
class RegionSamples(Record):
    """Statistics of R outlined regions of one photo."""

    names: tuple[str, ...]
    mean: Annotated[np.ndarray, "R K"]              # signal
    covariance_of_mean: Annotated[np.ndarray, "R K K"]  # by the noise of the pixels
    pixels: Annotated[np.ndarray, "R"]
    scatter: Annotated[np.ndarray, "R K"]           # relative, beyond noise and a plane
    points_px: Annotated[np.ndarray, "R Q 2"]       # spread over each region, full resolution
    # bool: bands of which the mean says nothing, being saturated; None: none is
    clipped: Annotated[np.ndarray, "R K"] | None = None


# ---- calibrate -----------------------------------------------------------------------------------

@dataclass(frozen=True, eq=False)
class SensitivityFit(Record):
    """Camera sensitivities on the working grid, the largest value of all bands being 1."""

    grid: WavelengthGrid
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
    outcome: Outcome


@dataclass(frozen=True, eq=False)
class CommonError(Record):
    """An error of a light scale that all bands of a photo share."""

    cause: str
    relative: float                                 # standard error


@dataclass(frozen=True, eq=False)
class LightScale(Record):
    """Factor from a rendered signal, of sensitivities peaking at 1, to that of the photo."""

    value: float
    standard_error: float | None                    # of any one band, ``common_errors`` included
    residuals: Annotated[np.ndarray, "R K"] | None  # (photo - scale x rendered) / photo
    source: str
    common_errors: tuple[CommonError, ...] = ()


@dataclass(frozen=True, eq=False)
class LightDrift(Record):
    """Change of the light from the chart photo to the object photo."""

    ratio: Annotated[np.ndarray, "K"]               # object / chart in each band
    standard_error: Annotated[np.ndarray, "K"]
    level: float                                    # common to all bands
    level_error: float
    colour: Annotated[np.ndarray, "K"]              # ratio / level - 1
    colour_changed: bool                            # beyond what the errors explain
    sentence: str


class CalibrationDoubt(Enum):
    """What makes a calibration doubtful that was made all the same; the value says what to do."""

    UNLIKE_CAMERAS = ("the curves are like those of no measured camera: check that the light "
                      "spectrum is that of the photo")
    WRONG_LIGHT = ("the chart contradicts the stated light: correct its spectrum, or state the "
                   "light as \"unknown\"")
    TWO_LIGHTS = ("two kinds of light fall on the chart: its colours drift over it beyond chance; "
                  "use lamps of one kind, keep out daylight and other lamps, and photograph again")
    COLOUR_MATRIX = ("the colour matrix in the photo's file contradicts the curves: check that the "
                     "light spectrum is that of the photo")
    VEIL = ("haze or glare veils the chart: it was estimated and taken off, but a veil is seldom "
            "the same all over a photo: shade the lens, wipe it, and photograph again")
    BANDS = ("the chart's patches disagree with any smooth response of the bands: leave out the "
             "photos that disagree most, and check that lamps and filters did not move")


@dataclass(frozen=True, eq=False)
class LightPosterior(Record):
    """What a chart says of a light by itself whose spectrum nobody stated; of mean 1."""

    grid: WavelengthGrid
    kinds: tuple[str, ...]                          # Q of light_words.LIGHT_KINDS
    probabilities: Annotated[np.ndarray, "Q"]
    mean: Annotated[np.ndarray, "P"]
    lower: Annotated[np.ndarray, "P"]               # pointwise band at ``level``
    upper: Annotated[np.ndarray, "P"]
    level: float
    sentences: tuple[str, ...]                      # how wide it is, whether it has two peaks


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


@dataclass(frozen=True, eq=False)
class PriorInfluence(Record):
    """How much of a camera's curves is a prior's and not a chart's, and whom they are most like."""

    share: Annotated[np.ndarray, "K P"]             # of the prior's standard deviation, left; 0-1
    families: tuple[str, ...]                       # F members, likeliest first
    probabilities: Annotated[np.ndarray, "F"]


def share_inside(lower: np.ndarray, upper: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Share (I,) of wavelengths at which bands (I, P) hold the truth."""
    return np.asarray(((lower <= truth) & (truth <= upper)).mean(axis=1))


@dataclass(frozen=True, eq=False)
class HeldOutPatches(Record):
    """Reflectance of each patch of a chart from its own signal and a calibration without it."""

    grid: WavelengthGrid
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
    def rmse(self) -> np.ndarray:
        """Root mean square error (I,) of each patch over wavelengths."""
        return np.asarray(np.sqrt(np.mean((self.mean - self.reference) ** 2, axis=1)))

    @property
    def inside(self) -> np.ndarray:
        """Share (I,) of wavelengths at which the band holds the reference."""
        return share_inside(self.lower, self.upper, self.reference)

    @property
    def means(self) -> tuple[float, float, float]:
        """Mean of ``rmse``, ``inside`` and ``expected`` over the patches that are judged."""
        return (float(self.rmse[self.judged].mean()), float(self.inside[self.judged].mean()),
                float(self.expected[self.judged].mean()))


@dataclass(frozen=True, eq=False)
class Calibration(Record):
    """All that turns rendered spectra into camera signal, and the error of predicted signals."""

    sensitivity: SensitivityFit
    light: Spectrum
    light_scale: LightScale | None                  # None: a known material of the scene tells it
    relative_covariance: Annotated[np.ndarray, "K K"]   # of (photo - predicted) / photo
    checks: tuple[str, ...]
    doubts: tuple[CalibrationDoubt, ...] = ()
    # Where the light is unknown ``sensitivity`` holds the products of sensitivity and light,
    # ``light`` is 1 at every wavelength, and this says what is known of the light by itself, if the
    # bands are those of measured cameras.
    light_posterior: LightPosterior | None = None
    products: bool = False                          # whether the light is unknown
    # Of a photo through a filter: ``light`` is then the light that the filter lets pass.
    filter: FittedFilter | None = None


# ---- reconstruct ---------------------------------------------------------------------------------

@dataclass(frozen=True, eq=False)
class LearntSpectra(Record):
    """A prior on every unknown reflectance, from the measured spectra that sampling knows."""

    nm: Annotated[np.ndarray, "P"]
    mean: Annotated[np.ndarray, "P"]
    covariance: Annotated[np.ndarray, "P P"]


@dataclass(frozen=True, eq=False)
class LightTransport(Record):
    """Light transport as a polynomial in the reflectances.

    The signal of region r is the sum over e of coefficients[r, e] times the product of reflectances
    that ``exponents[e]`` names.
    """

    materials: tuple[str, ...]
    exponents: Annotated[np.ndarray, "E M"]         # how often a path encounters each material
    coefficients: Annotated[np.ndarray, "R E"]


@dataclass(frozen=True, eq=False)
class RegionTransport(Record):
    """R regions of one photo: what they show, how surely, and how light reaches them."""

    transport: LightTransport                       # for reflectances and a light spectrum of 1
    signal: Annotated[np.ndarray, "R K"]            # NaN where the fit does not trust the region
    standard_error: Annotated[np.ndarray, "R K"]    # independent: photo, Monte Carlo, unevenness
    surface: Annotated[np.ndarray, "R"]             # index into the scene's surfaces
    material: Annotated[np.ndarray, "R"]            # index into the transport's materials
    colour_error: float                             # relative, of each surface in each band
    brightness_error: float                         # relative, of each surface in all bands alike


@dataclass(frozen=True, eq=False)
class SurfaceAgreement(Record):
    """Photo against rendering, surface by surface: the honest part of a reconstruction."""

    names: tuple[str, ...]                          # S names, "white / floor"
    materials: tuple[str, ...]                      # S material names
    pixels: Annotated[np.ndarray, "S"]
    ratio: Annotated[np.ndarray, "S K"]             # photo / rendering, summed over the surface
    spread: Annotated[np.ndarray, "S K"]            # of log(photo / rendering) over blocks


@dataclass(frozen=True, eq=False)
class SurfaceMisfit(Record):
    """A surface on which photo and rendering differ beyond chance and beyond what was stated."""

    surface: str                                    # as ``SurfaceAgreement`` names it
    # largest: photo / rendering - 1 of the surface or of a part beyond noise, or their scatter
    deviation: float
    sentence: str


@dataclass(frozen=True, eq=False)
class Reconstruction(Record):
    """Spectra that explain the photo, and how well they do."""

    materials: tuple[str, ...]
    known: tuple[bool, ...]                         # True: spectrum given, not estimated
    grid: WavelengthGrid
    basis: Annotated[np.ndarray, "P N"]
    coefficients: Annotated[np.ndarray, "M N"]      # NaN rows where known
    spectra: Annotated[np.ndarray, "M P"]
    white_signal: Annotated[np.ndarray, "K"]        # of a reflectance of 1 at all wavelengths
    signal: Annotated[np.ndarray, "M K"]            # of each material, relative to white
    signal_covariance: Annotated[np.ndarray, "M K K"]   # photo noise and Monte Carlo noise
    model_covariance: Annotated[np.ndarray, "M K K"]    # relative: disagreement of photo and model
    measured: Annotated[np.ndarray, "H W K"]        # photo at the render's size
    rendered: Annotated[np.ndarray, "H W K"]
    used: Annotated[np.ndarray, "H W"]              # bool: pixels that entered the fit
    surface: Annotated[np.ndarray, "H W"]           # index into agreement.names, -1 none or mixed
    agreement: SurfaceAgreement
    light_scale: LightScale                         # as used for this photo, exposure included
    loss_history: Annotated[np.ndarray, "I"]
    engine: str
    spp: int
    seed: int
    outcome: Outcome
    notes: tuple[str, ...] = ()                     # what is data and what is prior, in sentences
    misfits: tuple[SurfaceMisfit, ...] = ()         # worst first


@dataclass(frozen=True, eq=False)
class StrayLightError(Record):
    """One cause of light that the scene does not hold, by its standard error."""

    cause: str
    relative: Annotated[np.ndarray, "M J"]          # of each material's signal, bands correlated


@dataclass(frozen=True, eq=False, repr=False)
class JointReconstruction(Record):
    """Spectra that explain V photos, and the signals of J bands: every independent response.

    Two photos that differ in exposure or viewpoint alone have the same response: they make its
    signals surer and add no band.
    """

    views: tuple[Reconstruction, ...]               # of each photo; all with the same spectra
    names: tuple[str, ...]                          # of the views
    materials: tuple[str, ...]                      # M, of all views
    known: tuple[bool, ...]
    grid: WavelengthGrid
    spectra: Annotated[np.ndarray, "M P"]
    bands: tuple[str, ...]                          # J names, "view: band"
    view_of_band: Annotated[np.ndarray, "J"]        # int
    response: Annotated[np.ndarray, "J P"]          # of each band; rows sum to 1
    signal: Annotated[np.ndarray, "M J"]            # of each material, relative to white
    signal_covariance: Annotated[np.ndarray, "M J J"]
    model_covariance: Annotated[np.ndarray, "M J J"]    # relative; independent between views
    regions: tuple[RegionTransport, ...] = ()       # of each view; none by engines without them
    stray_light: tuple[StrayLightError, ...] = ()        # independent of each other

    def __repr__(self) -> str:
        return (f"<JointReconstruction of {', '.join(self.materials)} from "
                f"{len(self.views)} photos: {self.views[0].outcome.name}>")


# ---- what all kinds of sessions end in -----------------------------------------------------------

@dataclass(frozen=True, eq=False)
class SignalError(Record):
    """One cause of error of M surfaces' signals; its covariance holds what bands share."""

    cause: str
    covariance: Annotated[np.ndarray, "M J J"]


@dataclass(frozen=True, eq=False)
class SurfaceSignals(Record):
    """What the photos of a session say of M surfaces, in the J bands of all lights.

    ``signal = response @ reflectance + errors``, relative to a perfect white in the surface's
    position. The errors are independent of each other.
    """

    names: tuple[str, ...]
    known: tuple[bool, ...]                         # True: spectrum given, not estimated
    grid: WavelengthGrid
    spectra: Annotated[np.ndarray, "M P"]           # given, or the estimate about which errors hold
    bands: tuple[str, ...]                          # J names
    view_of_band: Annotated[np.ndarray, "J"]        # int, index of the photo's view
    response: Annotated[np.ndarray, "J P"]          # of each band; rows sum to 1
    signal: Annotated[np.ndarray, "M J"]            # relative to white; NaN where not photographed
    errors: tuple[SignalError, ...]


# ---- sampling ------------------------------------------------------------------------------------

@dataclass(frozen=True, eq=False)
class SpectralMeasurement(Record):
    """What the camera said of one surface: ``signal = relative_response @ reflectance + noise``.

    ``relative_response`` is sensitivity x light x weight in nm, divided by its sum in each band, so
    that every row sums to 1 and a reflectance of 1 gives a signal of 1.
    """

    grid: WavelengthGrid
    relative_response: Annotated[np.ndarray, "K P"]
    signal: Annotated[np.ndarray, "K"]
    noise_covariance: Annotated[np.ndarray, "K K"]


@dataclass(frozen=True, eq=False)
class SpectrumSamples(Record):
    """Draws from all spectra that fit one measurement, all equally likely, and the spline nearest
    to each.
    """

    grid: WavelengthGrid
    spectra: Annotated[np.ndarray, "T P"]
    coefficients: Annotated[np.ndarray, "T N"]      # of the splines, in [0, 1]
    method: str
    effective_samples: float
    seed: int
    outcome: Outcome
    sentence: str                                   # the outcome in words, with its numbers


@dataclass(frozen=True, eq=False)
class SpectrumSummary(Record):
    """What is known of one spectrum, and conditional on what."""

    grid: WavelengthGrid
    mean: Annotated[np.ndarray, "P"]
    standard_deviation: Annotated[np.ndarray, "P"]
    lower: Annotated[np.ndarray, "P"]               # pointwise band at ``level``
    upper: Annotated[np.ndarray, "P"]
    # exact lowest and highest over all spectra of the class
    bound_lower: Annotated[np.ndarray, "P"]
    bound_upper: Annotated[np.ndarray, "P"]
    level: float
    conditional_on: str
    next_measurement_nm: float  # one more reading here would narrow the band most


@dataclass(frozen=True, eq=False)
class SurfaceSpectrum(Record):
    """What is known of the spectrum of one surface."""

    samples: SpectrumSamples
    summary: SpectrumSummary
    # of the variance of a spectrum, by cause; none of draws of all surfaces at once
    variance_shares: dict[str, float]
    family_shares: dict[str, float]     # that the signal allows; none without the learnt prior


# ---- placements ----------------------------------------------------------------------------------
# Where lamp and cameras of a scene stand, as records: apart from what estimates them.

SCENE_UNIT, MM = "scene's unit", "mm"


@dataclass(frozen=True, eq=False)
class Placement(Record):
    """A lamp or camera: its stated position, the one that is used, and how that is known."""

    what: str
    how: str
    unit: str                                               # ``MM`` or ``SCENE_UNIT``
    stated: Annotated[np.ndarray, "3"] | None
    place: Annotated[np.ndarray, "3"] | None
    moved: Annotated[np.ndarray, "3"] | None                # from the stated position
    standard_error: Annotated[np.ndarray, "3"] | None


@dataclass(frozen=True, eq=False)
class MarkedView(Record):
    """A photo with a box's edges and marked corners, in shares of its width and height."""

    name: str                                               # empty of the first
    edges: Annotated[np.ndarray, "m 2 2"]
    corners: tuple[str, ...]
    marked: Annotated[np.ndarray, "n 2"]
    seen: Annotated[np.ndarray, "n 2"]                      # where the camera sees them
    residuals_px: Annotated[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class SceneGeometry(Record):
    """What was estimated of a scene; empty where everything stands as stated."""

    placements: tuple[Placement, ...]
    views: tuple[MarkedView, ...]


# ---- registration --------------------------------------------------------------------------------
# The motion of a photo against another, as a record: apart from what estimates it with OpenCV.

STILL_PX = 0.5              # less than this is no motion


@dataclass(frozen=True, eq=False)
class Registration(Record):
    """From pixels of the first photo to those of another: ``matrix @ (x, y, 1)``."""

    matrix: Annotated[np.ndarray, "2 3"]    # a turn and a shift, full resolution
    shift_px: float                         # of the middle of the photo
    correlation: float                      # of the edges of both photos, 0 to 1
    residual_px: float | None               # median over parts of the photo; None: none tells
    chart_px: float | None                  # rms of the chart's corners; None: not in both photos

    def moved(self, points_px: np.ndarray) -> np.ndarray:
        """Points (..., 2) of the first photo in the pixels of the other."""
        return points_px if self.still else np.asarray(
            points_px @ self.matrix[:, :2].T + self.matrix[:, 2])

    @property
    def still(self) -> bool:
        """Whether the photo moved by less than half a pixel."""
        return self.shift_px < STILL_PX
