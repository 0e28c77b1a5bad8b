"""What was photographed, and what is stated of it: the records that every measurement starts from.

They are made from ``session.toml`` or from the arguments of a function of the library. Spectra,
scenes and layouts are read by then; photos are files, or open already.
"""
from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from spectrabox.calibrate.geometry.colmap_model import Picture
from spectrabox.calibrate.geometry.lens import Lens
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.measure.shoot import options
from spectrabox.radiometry import errors, grid
from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records import calibration, photos, spectra
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.reconstruct.scene import box_tables, edit_scene, scene_file

ONE_PHOTO = ""              # the band under which the files of a colour camera's photo are
FIRST_PHOTO = "photo"       # title of the first view, whose name is ""; in session.toml too
# Relative standard errors of a known reflectance that states none: of one that an instrument read,
# by its angle to the light and wear; and of one number for all wavelengths, which nobody read off
# this very card.
READ_ERROR, TYPED_ERROR = 0.005, 0.03
SAME = 1e-9                 # of two reflectances of one number
CURVES_ERROR = 0.02         # relative, of signals predicted from measured curves

Outline = tuple[tuple[float, float], ...]       # corners (x, y) in pixels of a photo, going round


def rectangle(rect: Sequence[float]) -> Outline:
    """The outline of [x0, y0, x1, y1], two opposite corners."""
    x0, y0, x1, y1 = rect
    return (x0, y0), (x1, y0), (x1, y1), (x0, y1)


@dataclass(frozen=True)
class InputFile:
    """A file of a capture."""

    name: str                               # as sentences and keys call it
    path: Path
    opened: photos.LinearImage | None = None  # a photo that is developed already ...
    findings: tuple[Finding, ...] = ()      # ... and what was found meanwhile


# Files of one photo by band, several of a bracket; those of a colour camera under ONE_PHOTO.
PhotoFiles = dict[str, tuple[InputFile, ...]]


@dataclass(frozen=True, eq=False)
class LitChart:
    """The chart of every chart photo."""

    layout: Chart
    reflectances: np.ndarray                # (I, P)
    excluded: np.ndarray                    # (I,) bool: patches that no fit uses
    corners_px: np.ndarray | None = None    # (4, 2) in the first chart photo, where stated
    stated: bool = True                     # whether somebody said which reflectances it has
    measured: bool = False                  # whether they are of this very copy, from a file


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Where the camera's sensitivities come from: the chart, unless curves were measured."""

    curves: np.ndarray | None = None        # (K, P), largest value 1
    names: tuple[str, ...] = ()             # of the curves
    source: str = "chart"                   # of the curves, in words
    method: str = "prior"                   # of a chart's fit
    prior: CameraPrior | None = None
    relative_error: float = CURVES_ERROR    # of signals predicted from measured curves


@dataclass(frozen=True, eq=False)
class View:
    """One photo of the surfaces, and what it was taken in."""

    name: str                               # empty of the first
    photo: PhotoFiles
    chart: PhotoFiles                       # under the same light; empty where no chart is needed
    light: spectra.Spectrum | spectra.UnknownLight          # of its lamp
    light_words: str                        # how the lamp was stated
    lamp: str = FIRST_PHOTO                 # title of the first photo that this lamp lights
    # title of the photo for which its lamp was put elsewhere; empty where it stands as in the first
    moved: str = ""
    filter: calibration.Filter | None = None            # before its lens or lamp
    filter_words: str = ""                  # how the filter was stated
    filter_known: bool = True               # whether its transmittance was stated

    @property
    def title(self) -> str:
        """What it is called in sentences."""
        return self.name or FIRST_PHOTO

    @property
    def photo_names(self) -> tuple[str, ...]:
        return tuple(file.name for file in files_of(self.photo))

    @property
    def chart_names(self) -> tuple[str, ...]:
        return tuple(file.name for file in files_of(self.chart))

    @property
    def shows_chart(self) -> bool:
        """Whether its chart is in the photo of the surfaces itself."""
        return files_of(self.chart) == files_of(self.photo)

    @property
    def light_stated(self) -> bool:
        """Whether the spectrum of its lamp is stated."""
        return isinstance(self.light, spectra.Spectrum)

    @property
    def spectrum_stated(self) -> bool:
        """Whether the spectrum of what lights it, filter included, is stated."""
        return self.light_stated and (self.filter is None or self.filter_known)

    @property
    def place(self) -> str:
        """Its lamp and where that stands: the same for photos of one field of light."""
        return f"{self.lamp}, moved for {self.moved}" if self.moved else self.lamp

    def same_light(self, other: View) -> bool:
        """Whether both are stated to be under one lamp, wherever it stands, through one filter if
        any. Of two filters that nobody measured nothing says that they are one.
        """
        if self.name == other.name:
            return True
        return self.lamp == other.lamp and (self.filter is None) == (other.filter is None) \
            and self.filter_known and self.filter_words == other.filter_words

    @property
    def light_of_fit(self) -> spectra.Spectrum | spectra.UnknownLight:
        """The light that a calibration has of it: its lamp. Its filter is part of the fit."""
        return self.light

    @property
    def filter_of_fit(self) -> calibration.Filter | None:
        """The filter that is part of the fit."""
        return self.filter

    @property
    def power(self) -> np.ndarray | None:
        """Light (P,) that an ordinary camera would see its chart in, as far as it is known."""
        power = spectrum_on_grid(self.light, grid.FINE_GRID) \
            if isinstance(self.light, spectra.Spectrum) \
            else None
        if self.filter is None:
            return power
        return (1.0 if power is None else power) * self.filter.transmittance

    def label(self, kind: str) -> str:
        """The name of a picture of this view."""
        return f"{kind} {self.name}" if self.name else kind


@dataclass(frozen=True, eq=False)
class BoxPhoto:
    """What is stated of a photo of a box that was measured with a tape.

    ``measure.scene.box_camera`` estimates its camera, and makes its scene.
    """

    box: box_tables.BoxTable                           # turned as in the photo
    camera: box_tables.CameraTable                     # measured, or with what it is estimated from
    marked: box_tables.BoxTable  # as it stood when the corners of its camera were marked
    taken: InputFile                        # the photo that its camera was stated of
    lens: Lens | None                       # of the camera, where a file says it
    path: Path                              # where its scene would lie: files are seen from there
    beam: InputFile | None                  # of the lamp
    model: Mapping[str, Picture]            # pictures of COLMAP that its camera is known by
    camera_view: str                        # name of the view whose camera it is
    camera_place: str                       # of the camera's table, as sentences call it
    model_place: str                        # of the COLMAP model's

    @property
    def files(self) -> tuple[Path, ...]:
        """What its scene names."""
        return () if self.beam is None else (self.beam.path,)


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneView(View):
    """One photo of a scene."""

    scene: scene_file.SceneFile | BoxPhoto
    lights_by_id: Mapping[str, spectra.Spectrum] = field(default_factory=dict)
    lens: Lens | None = None                # by which the photo is undistorted
    scale: calibration.LightScale | None = None         # of its light, where it is known beforehand

    @property
    def light_of_fit(self) -> spectra.Spectrum | spectra.UnknownLight:
        """The light that a calibration has of it: its lamp through its filter."""
        if self.filter is None:
            return self.light
        if not self.spectrum_stated:
            return spectra.UnknownLight()
        assert isinstance(self.light, spectra.Spectrum)
        power = spectrum_on_grid(self.light, grid.FINE_GRID) * self.filter.transmittance
        return spectra.Spectrum(grid.FINE_GRID, power, spectra.Quantity.RELATIVE,
                        f"{self.light.source} through {self.filter_words}")

    @property
    def filter_of_fit(self) -> None:
        """None: its filter is part of its light."""
        return None


@dataclass(frozen=True, eq=False)
class Surface:
    """What is stated of a surface: a material of a scene, or a region of a flat sample."""

    families: tuple[str, ...] = ()          # that it is one of; none where nobody said
    surface: str | None = None              # "matt", "satin" or "glossy"
    known: np.ndarray | None = None         # (P,) measured reflectance, which is not estimated
    truth: spectra.Spectrum | None = None           # measured, only compared with
    bsdf: str = ""                          # of a material: id of its BSDF in the scene
    outline: Outline = ()                   # of a region
    photos: tuple[str, ...] = ()            # likewise, titles of views that show it; none for all
    known_error: float = READ_ERROR         # likewise, relative standard error of ``known``


def error_of_known(known: spectra.Spectrum) -> float:
    """Relative standard error of a known reflectance: as it states, else by what it looks like. No
    instrument reads the same number at every wavelength.

    Parameters
    ----------
    known : Spectrum
    """
    if known.standard_error is None:
        return TYPED_ERROR if np.ptp(known.values) < SAME else READ_ERROR
    stated = np.sqrt(np.mean(known.standard_error**2) / np.mean(known.values**2))
    return float(np.hypot(stated, READ_ERROR))


@dataclass(frozen=True, eq=False, kw_only=True)
class Capture(ABC):
    """What flat samples and scenes have in common."""

    name: str = ""                          # of the whole, in sentences
    views: tuple[View, ...]                 # photos of the surfaces, the first of them first
    chart: LitChart | None                  # None where no photo shows one
    dark_frames: tuple[InputFile, ...] = ()     # taken off every photo
    flat_fields: Mapping[str, InputFile] = field(default_factory=dict)      # by band
    not_linear: bool = False                # take JPEG and PNG, decoded as sRGB
    orientation: int = 1                    # how photos are turned, as EXIF numbers it
    sensitivity: Sensitivity = field(default_factory=Sensitivity)
    repeatability: options.Repeatability = field(default_factory=options.Repeatability)
    stray_light: options.StrayLight = field(default_factory=options.StrayLight)
    sampling: options.Sampling = field(default_factory=options.Sampling)
    picture: options.PictureOptions | None = None
    finish: options.Surface = None          # of surfaces of which nothing else is stated
    seed: int

    # light and chart in their positions, where known
    chart_scene: scene_file.SceneFile | None = None

    # whether all photos are from one tripod: what one shows is found in another
    one_tripod: ClassVar[bool] = False
    # whether a chart may be clipped in a band, which is left out then
    bands_may_drop: ClassVar[bool] = False

    @property
    def views_with_chart(self) -> tuple[View, ...]:
        """Views that have a chart photo under their light."""
        return tuple(view for view in self.views if view.chart)

    @property
    def lamp_moved(self) -> bool:
        """Whether photos show one lamp in two places, which tells gloss, plane and shadow."""
        return any(view.moved for view in self.views)

    @property
    def chart_in_photo(self) -> bool:
        """Whether every photo shows its chart."""
        return all(view.shows_chart for view in self.views)

    @property
    def chart_stated(self) -> bool:
        """Whether somebody said which reflectances the chart has, if there is one."""
        return self.chart is None or self.chart.stated

    @property
    def layout(self) -> Chart:
        """Of the chart.

        Raises
        ------
        InputError
            If no photo shows one.
        """
        return self.lit_chart.layout

    @property
    def lit_chart(self) -> LitChart:
        if self.chart is None:
            raise errors.InputError("no photo of a chart is stated, and this needs one")
        return self.chart

    @property
    @abstractmethod
    def surfaces(self) -> Mapping[str, Surface]:
        """What is measured, by name."""

    def regions_in(self, view: View) -> Mapping[str, Surface]:
        """The regions that the photo of a view shows; a scene has none."""
        return {}

    @property
    def known_errors(self) -> Mapping[str, float]:
        """Relative standard errors of the reflectances of known regions; a scene has none."""
        return {}

    @property
    def scenes(self) -> Mapping[str, scene_file.SceneFile | BoxPhoto]:
        """The scenes of photos, by view; flat samples have none."""
        return {}

    @property
    def bsdfs(self) -> dict[str, str]:
        """Id of the BSDF of every surface in those scenes."""
        return {}

    @property
    def families(self) -> dict[str, tuple[str, ...]]:
        """The families that each surface is said to be one of."""
        return {name: surface.families for name, surface in self.surfaces.items()}

    @property
    def surfaces_stated(self) -> bool:
        """Whether it is stated of every estimated surface how much it mirrors."""
        return all(surface.surface is not None or surface.known is not None
                   for surface in self.surfaces.values())

    def band_names(self, photographed: tuple[str, ...]) -> tuple[str, ...]:
        """Names of the camera's bands.

        Parameters
        ----------
        photographed : tuple of str
            Names of the photo's bands.

        Raises
        ------
        InputError
            If the photo and the measured curves differ in the number of bands.
        """
        curves = self.sensitivity
        if curves.curves is None:
            return photographed
        if len(curves.curves) != len(photographed):
            raise errors.InputError(
                f"{curves.source} holds {len(curves.curves)} curves, but the photo "
                f"has {len(photographed)} bands ({', '.join(photographed)}): give one "
                "curve for each, in this order")
        named = curves.names or photographed
        return named if ONE_PHOTO in self.views[0].photo else photographed


@dataclass(frozen=True, eq=False, kw_only=True)
class FlatCapture(Capture):
    """Photos of a flat sample, each with a colour chart or under the light of one that has."""

    regions: Mapping[str, Surface]

    one_tripod: ClassVar[bool] = True
    bands_may_drop: ClassVar[bool] = True

    @property
    def surfaces(self) -> Mapping[str, Surface]:
        return self.regions

    def regions_in(self, view: View) -> dict[str, Surface]:
        """The regions that the photo of a view shows."""
        return {name: region for name, region in self.regions.items()
                if not region.photos or view.title in region.photos}

    @property
    def known(self) -> dict[str, np.ndarray]:
        """Reflectances (P,) of the regions whose spectrum is known."""
        return {name: region.known for name, region in self.regions.items()
                if region.known is not None}

    @property
    def known_errors(self) -> dict[str, float]:
        """Relative standard errors of these."""
        return {name: self.regions[name].known_error for name in self.known}

    @property
    def picture_views(self) -> tuple[View, ...]:
        """Views whose photos a picture of spectra is made from: the first, and those that show a
        region of it in another photo, but for those whose lamp was moved.
        """
        first, *others = self.views
        shown = self.regions_in(first).keys()
        return (first, *(view for view in others if shown & self.regions_in(view).keys()
                         and view.photo != first.photo and not view.moved))


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneCapture(Capture):
    """Photos of a scene whose geometry and lamps are known."""

    views: tuple[SceneView, ...]
    materials: Mapping[str, Surface]
    inversion: options.Inversion = field(default_factory=options.Inversion)
    scale_from_chart: bool = True           # else from a material of known spectrum
    # what comments of scenes in files say that was estimated, by the names of the files
    refinements: Mapping[str, tuple[edit_scene.Refinement, ...]] = field(default_factory=dict)

    @property
    def surfaces(self) -> Mapping[str, Surface]:
        return self.materials

    @property
    def bsdfs(self) -> dict[str, str]:
        return {name: material.bsdf or name for name, material in self.materials.items()}

    @property
    def scenes(self) -> dict[str, scene_file.SceneFile | BoxPhoto]:
        return {view.name: view.scene for view in self.views}


def require_scene(capture: Capture, refusal: str) -> SceneCapture:
    """A capture of a scene.

    Parameters
    ----------
    capture : Capture
    refusal : str
        Sentence for one of flat samples.

    Raises
    ------
    InputError
        With this sentence, where there is no scene.
    """
    if not isinstance(capture, SceneCapture):
        raise errors.InputError(refusal)
    return capture


def files_of(photo: PhotoFiles) -> tuple[InputFile, ...]:
    """Every file of a photo."""
    return tuple(file for files in photo.values() for file in files)
