"""What an inversion of scenes finds, and where lamps and cameras stand."""
from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records.calibration import LightScale
from spectrabox.radiometry.records.spectra import Outcome, WavelengthGrid
from spectrabox.radiometry.shaped import Record

SCENE_UNIT, MM = "scene's unit", "mm"


@dataclass(frozen=True, eq=False)
class LearntSpectra(Record):
    """A prior on every unknown reflectance, from the measured spectra that sampling knows."""

    nm: Annotated[np.ndarray, "P"]
    mean: Annotated[np.ndarray, "P"]
    covariance: Annotated[np.ndarray, "P P"]


@dataclass(frozen=True, eq=False)
class RegionTransport(Record):
    """R regions of one photo: what they show, how surely, and how light reaches them.

    Light transport is a polynomial in the reflectances: for reflectances and a light spectrum of 1,
    the signal of region r is the sum over e of coefficients[r, e] times the product of reflectances
    that ``exponents[e]`` names.
    """

    materials: tuple[str, ...]
    exponents: Annotated[np.ndarray, "E M"]         # how often a path encounters each material
    coefficients: Annotated[np.ndarray, "R E"]
    signal: Annotated[np.ndarray, "R K"]            # NaN where the fit does not trust the region
    standard_error: Annotated[np.ndarray, "R K"]    # independent: photo, Monte Carlo, unevenness
    surface: Annotated[np.ndarray, "R"]             # index into the scene's surfaces
    material: Annotated[np.ndarray, "R"]            # index into ``materials``
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
class KnownLight(Record):
    """The light on a scene by its surfaces of known spectrum."""

    materials: tuple[str, ...]                      # that are known and seen
    level: float | None                     # against what chart, positions and exposures give ...
    expected_error: float | None            # ... whose relative standard error this is
    surfaces_error: float                           # relative, of what the known surfaces say
    level_error: float                              # relative, of both together
    colour: Annotated[np.ndarray, "K"]              # of the light in each band, against the chart's
    colour_error: Annotated[np.ndarray, "K"]        # relative

    @property
    def contradiction(self) -> float:
        """How many standard errors known surfaces and chart differ by in the level of the light; 0
        where only one of them tells it.
        """
        if self.level is None or self.expected_error is None:
            return 0.0
        return float(abs(np.log(self.level)) / np.hypot(self.expected_error, self.surfaces_error))


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
    findings: tuple[Finding, ...] = ()              # of the fit: what is data and what is prior
    misfits: tuple[Finding, ...] = ()               # of its surfaces, worst first
    known_light: KnownLight | None = None           # None where no known surface tells of it


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
    # by light that the scene does not hold, by cause: standard error relative to each material's
    # signal, which bands of a photo share
    stray_light: dict[str, Annotated[np.ndarray, "M J"]] = field(default_factory=dict)
    lamps: tuple[str, ...] = ()     # of each view, alike under one in one place; () each its own
    # what is stated of the surfaces of materials that may mirror light, of gloss.KINDS; None:
    # nothing. Those that are not named mirror what the scene says
    gloss: dict[str, str | None] = field(default_factory=dict)

    def __repr__(self) -> str:
        return (f"<JointReconstruction of {', '.join(self.materials)} from "
                f"{len(self.views)} photos: {self.views[0].outcome.name}>")


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
