"""Spectra of regions of a flat sample, from one photo with a colour chart in it or beside it."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import hypot
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.api.chart_check import ChartCheck
from spectrabox.api.colour_profile import ColourProfile, profile_of
from spectrabox.api.estimate import SpectrumEstimate, surface_estimate
from spectrabox.api.estimates import SpectrumEstimates
from spectrabox.api.inputs import (
    FilterLike,
    KnownSpectrum,
    LightLike,
    as_chart,
    as_filter,
    as_light,
    as_prior,
    as_reflectance,
    families_of,
    one_blas_thread,
    surfaces_of,
)
from spectrabox.api.photo import Photo, open_photo
from spectrabox.api.progress import ProgressLike, progress_steps
from spectrabox.calibrate.chart_calibration import (
    CalibrationOptions,
    ChartCalibration,
    ChartPhoto,
    calibrate_chart,
    through_filter,
)
from spectrabox.calibrate.prior.camera_prior import load_camera_prior
from spectrabox.capture.chart.detection import find_chart, find_chart_again
from spectrabox.capture.chart.patches import require_unclipped
from spectrabox.capture.chart.quality import ChartVerdict, judge_chart
from spectrabox.capture.photo.binning import thumbnail
from spectrabox.capture.photo.regions import sample_regions
from spectrabox.capture.photo.registration import Edges, find_edges, registered
from spectrabox.measure.chart_check import chart_level_notes, held_out_patches
from spectrabox.measure.flat import flat_signals
from spectrabox.measure.surface_spectra import DrawOptions, learn_from_swatches, sample_surfaces
from spectrabox.measure.white import (
    FlatErrors,
    FlatPhoto,
    PhotoWhite,
    far_notes,
    level_notes,
    white_at_regions,
)
from spectrabox.radiometry.chart import Chart, typical_camera_signals
from spectrabox.radiometry.charts.references import reference_reflectances
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import (
    Calibration,
    ChartDetection,
    Filter,
    LinearImage,
    PatchSamples,
    RegionSamples,
    Spectrum,
    SurfaceSignals,
    SurfaceSpectrum,
    UnknownLight,
    default_band_names,
)
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.session.outputs.assemble import surface_result
from spectrabox.session.outputs.results import ChartResult, FlatEvidence, LitRegions
from spectrabox.session.report.verdict import Verdict, judge
from spectrabox.session.signals.swatch_files import read_swatch_spectra

REPEATS = hypot(0.012, 0.009)       # light and shutter, where chart and samples are two photos
GLARE = 0.005                       # veiling glare, of the picture's mean signal
THUMBNAIL_PX, CHART_THUMBNAIL_PX = 96, 48   # wide: of photos that tell exposure and mean signal

Outline = Sequence[float] | Sequence[Sequence[float]]


class FlatSpectra(SpectrumEstimates):
    """Estimates of the regions of a flat sample, with the calibration that they come from.

    Attributes
    ----------
    calibration : Calibration
        Sensitivities and light, or their products where the light is unknown.
    signals : SurfaceSignals
        Of the regions, relative to white, with their errors by cause.
    light : dict
        Of each region: the light on it relative to the chart's mean, and its relative error.
    notes : tuple of str
        What to beware of, in sentences.

    References
    ----------
    How camera, light and fall-off are estimated: docs/explanation/calibration.md.

    Examples
    --------
    >>> result = sb.flat("painting/photos/painting.dng", {"wall": (986, 462, 1073, 537)})
    >>> result.verdict, result.reasons, result.light["wall"]
    >>> result.to_csv("spectra.csv")
    """

    def __init__(self, estimates: Sequence[SpectrumEstimate], signals: SurfaceSignals,
                 white: PhotoWhite, photo: LinearImage, chart: ChartResult,
                 calibrated: ChartCalibration, spectra: Mapping[str, SurfaceSpectrum],
                 surfaces_stated: bool, notes: tuple[str, ...]) -> None:
        super().__init__(estimates)
        self.calibration: Calibration = calibrated.calibration
        self.signals, self.notes = signals, notes
        self.light = {name: (float(np.exp(level)), float(error)) for name, level, error in zip(
            white.samples.names, white.log_field, white.field_error, strict=True)}
        self._white, self._photo, self._chart, self._spectra = white, photo, chart, spectra
        self._surfaces_stated = surfaces_stated

    @property
    def chart_check(self) -> ChartCheck:
        """The chart's patches, each by a calibration without it."""
        assert self._chart.left_out is not None
        return ChartCheck(self._chart.layout.names, self._chart.left_out)

    def colour_profile(self, families: str | Sequence[str] | None = None) -> ColourProfile:
        """Colours under D50 of what the camera sees under this light, for colour management.

        Parameters
        ----------
        families : str or sequence of str, optional
            What will be photographed: paint, textile, leaves, skin, white, earth or animal.

        Returns
        -------
        ColourProfile

        Raises
        ------
        InputError
            If the camera has other than three bands, or a word names no family.
        """
        return profile_of(self.calibration, families_of(families), self._photo.camera_from_xyz)

    @property
    def verdict(self) -> str:
        """"pass", "warn" or "fail", by the criteria of the report."""
        return self._judged.status.name.lower()

    @property
    def reasons(self) -> list[str]:
        """Why the verdict is no "pass", in sentences; the verdict's one sentence otherwise."""
        worst = [criterion.sentence for criterion in self._judged.criteria
                 if criterion.status is self._judged.status]
        return [self._judged.sentence] if self.verdict == "pass" else worst

    @cached_property
    def _judged(self) -> Verdict:
        """The verdict of the report on the same records."""
        surfaces = [surface_result(self.signals, index, self._spectra.get(name))
                    for index, name in enumerate(self.signals.names)]
        lit = LitRegions("photo", self.light, dict(self._white.level_misfits),
                         dict(zip(self._white.samples.names,
                                  self._white.samples.scatter.max(axis=1).tolist(), strict=True)))
        return judge(FlatEvidence(
            bands=self.signals.bands, chart=self._chart, calibration=self.calibration,
            photo=self._photo, materials=surfaces, photos=[lit],
            surfaces_stated=self._surfaces_stated))


@one_blas_thread
def flat(photo: str | Path | Photo, regions: Mapping[str, Outline], *, light: LightLike = "unknown",
         families: Mapping[str, str | Sequence[str]] | None = None,
         known: Mapping[str, KnownSpectrum] | None = None,
         swatches: Mapping[str, KnownSpectrum] | str | Path | None = None,
         surface: str | Mapping[str, str] | None = None,
         filtered: Mapping[str | Path, FilterLike] | None = None,
         chart_photo: str | Path | Photo | None = None, layout: str | Path | Chart | None = None,
         reference: str | None = None, corners: ArrayLike | None = None,
         camera_prior: str | Path | None = None, draws: int = 4000, level: float = 0.95,
         seed: int = 1, progress: ProgressLike = None) -> FlatSpectra:
    """Spectra of regions of a flat sample: a painting, a print, a leaf.

    Camera, light and its fall-off are estimated from the colour chart; no scene, no renderer and
    no measured lamp are needed.

    Parameters
    ----------
    photo : path or Photo
        With the regions in it, and the chart unless ``chart_photo`` has it.
    regions : mapping
        From names to (x0, y0, x1, y1), two opposite corners, or to corners [(x, y), ...], in
        pixels of the photo.
    light : name, path, (nm, values) or Spectrum
        "unknown" by default.
    families : mapping, optional
        What a surface is, by region: paint, textile, leaves, skin, white, earth or animal.
    known : mapping, optional
        Reflectance of regions that are known, a white card say: a number, a file, or (nm, values).
    swatches : mapping or path, optional
        Measured reflectances of regions of the samples' own material, eight or more, which correct
        the spectra of the others: as ``known``, or a file of spectra with a column for each, named
        as its region.
    surface : str or mapping, optional
        How much the surfaces mirror: "matt", "satin" or "glossy"; of all regions, or by region.
    filtered : mapping, optional
        Further photos of the same view under the same light through a filter before the lens or
        the lamp, each with the chart in it: from the photo to the filter's transmittance, a file,
        (nm, values), or "unknown". Every photo adds three bands. Photos are registered to the
        first; bands that are saturated on a region drop out there.
    chart_photo : path or Photo, optional
        The chart under the same light, by the same camera.
    layout, reference, corners
        As of `find_chart`.
    camera_prior : path, optional
        A prior made by ``spectrabox camera prior``.
    draws, level, seed
        T spectra behind each region, the probability of their band, 0 to 1, and their seed.
    progress : bool or function, optional
        True shows a bar; a function is called with the share that is done, and what is being
        done. By default a bar is shown in notebooks.

    Returns
    -------
    FlatSpectra
        Estimates by region.

    Raises
    ------
    ChartNotFoundError, ClippedPhotoError, CheckError
        If the chart is not found, chart or regions are clipped, a known region contradicts the
        chart's light, or between photos the camera, the chart or a region moved.
    InputError
        If a region leaves the photo, photos differ in size, or the photos do not state how their
        exposures compare.
    CalibrationError
        If chart and light do not determine the camera.

    References
    ----------
    Not in Xia et al. 2025. Camera and light as products: docs/explanation/calibration.md; the
    spectra behind a signal: docs/explanation/sampling.md.

    Examples
    --------
    >>> result = sb.flat("painting/photos/painting.dng", {"wall": (986, 462, 1073, 537)},
    ...                  families={"wall": "paint"})
    >>> result["wall"].plot()
    """
    opened = photo if isinstance(photo, Photo) else open_photo(photo)
    with_chart = opened if chart_photo is None else (
        chart_photo if isinstance(chart_photo, Photo) else open_photo(
            chart_photo, orientation=opened.orientation))
    chart, stated = as_chart(layout), as_light(light)
    of_material = _swatches(swatches, regions)
    for name in (*(families or {}), *(known or {}), *of_material):
        if name not in regions:
            raise InputError(f"there is no region {name!r}; there are {', '.join(regions)}")
    surfaces = surfaces_of(surface, regions, "region")
    with progress_steps(progress, "flat") as step:
        step(0.0, "finding the chart")
        reflectances = reference_reflectances(reference, chart, FINE_GRID)
        detection, quality = _measured_chart(with_chart.image, chart, reflectances, stated, corners)
        patches = quality.samples
        outlines = {name: _outline(one) for name, one in regions.items()}
        samples = sample_regions(opened.image, outlines, without_clipped=bool(filtered))
        first = _FirstPhoto(opened, detection, shows_chart=with_chart is opened)
        others = [_filtered_photo(file, as_filter(through), chart, reflectances, stated, outlines,
                                  first) for file, through in (filtered or {}).items()]
        step(0.2, "fitting sensitivities")
        options = CalibrationOptions(prior=None if camera_prior is None
                                     else load_camera_prior(Path(camera_prior)))
        calibrated = calibrate_chart(
            [ChartPhoto(patches, reflectances, stated, chart=chart), *(
                ChartPhoto(other.patches, reflectances, stated, chart=chart, filter=other.filter)
                for other in others)], FINE_GRID, options)
        assert calibrated.prior_fit is not None
        calibration = calibrated.calibration if isinstance(stated, UnknownLight) else replace(
            calibrated.calibration, light=stated)
        own_chart = with_chart is opened
        small = thumbnail(opened.image, THUMBNAIL_PX)
        shown = FlatPhoto("photo", samples, small,
                          thumbnail(with_chart.image, CHART_THUMBNAIL_PX), own_chart,
                          detection.corners_px, chart, calibrated.prior_fit.photos[0].white,
                          calibration, lamp="lamp")
        through = [FlatPhoto(
            other.name, other.regions, thumbnail(other.image, THUMBNAIL_PX),
            thumbnail(other.image, CHART_THUMBNAIL_PX), True, other.detection.corners_px, chart,
            calibrated.prior_fit.photos[number].white,
            through_filter(calibration, calibrated.prior_fit, number, FINE_GRID), lamp="lamp")
            for number, other in enumerate(others, start=1)]
        errors = FlatErrors(REPEATS, GLARE, calibrated.prior_fit.patch_error, surfaces=surfaces,
                            seed=seed)
        spectra_known = {name: as_reflectance(one, name) for name, one in (known or {}).items()}
        step(0.5, "light over the photo")
        white = white_at_regions(shown, spectra_known, errors)
        assert white is not None
        named = {name: families_of((families or {}).get(name)) for name in regions}
        whites = [white_at_regions(other, spectra_known, errors) for other in through]
        signals = flat_signals([shown, *through], [white, *whites], named,
                               spectra_known | of_material,
                               default_band_names(opened.bands), errors)
        spectra = sample_surfaces(signals, DrawOptions(draws=draws, level=level, seed=seed), named,
                                  lambda share, name: step(0.6 + 0.4 * share, name),
                                  correction=learn_from_swatches(signals, list(of_material), named))
    lit = np.full(len(calibrated.predicted), np.nan)
    lit[~calibrated.excluded] = calibrated.prior_fit.photos[0].field
    held_out = held_out_patches(calibrated, reflectances)
    result = ChartResult(detection, patches, calibrated.predicted, lit / np.nanmax(lit),
                         chart, held_out,
                         calibrated.prior_influence)
    estimates = [surface_estimate(signals, name, spectra, as_prior(None, named[name]),
                                  rendered=False) for name in signals.names]
    return FlatSpectra(estimates, signals, white, small, result,
                       replace(calibrated, calibration=calibration), spectra,
                       all(name in surfaces or name in spectra_known or name in of_material
                           for name in regions),
                       (*opened.notes, *far_notes(white), *level_notes(white),
                        *(f"the chart should be shot again: {reason}"
                          for reason in quality.reasons),
                        *chart_level_notes(held_out, chart.names)))


@dataclass(frozen=True)
class _FirstPhoto:
    """The photo with the regions, without a filter, as further photos are compared with it."""

    photo: Photo
    detection: ChartDetection
    shows_chart: bool           # else the chart was found in a photo of its own

    @cached_property
    def edges(self) -> Edges:
        """Where it has edges."""
        return find_edges(self.photo.image)


@dataclass(frozen=True)
class _FilteredPhoto:
    """A further photo through a filter, with its chart and its regions."""

    name: str
    image: LinearImage
    filter: Filter
    detection: ChartDetection
    patches: PatchSamples
    regions: RegionSamples


def _filtered_photo(file: str | Path, through: Filter, chart: Chart, reflectances: np.ndarray,
                    light: Spectrum | UnknownLight,
                    outlines: Mapping[str, list[tuple[float, float]]],
                    first: _FirstPhoto) -> _FilteredPhoto:
    """A photo through a filter, registered to the first: its chart, and its regions."""
    photo = open_photo(file, orientation=first.photo.orientation)
    if np.array_equal(photo.signal, first.photo.signal):
        raise InputError(f"{file} is the photo without the filter; give the one that was taken "
                         "through it")
    power = spectrum_on_grid(light, FINE_GRID) if isinstance(light, Spectrum) else 1.0
    reference = typical_camera_signals(reflectances, FINE_GRID, power * through.transmittance)
    detection = find_chart_again(photo.image, reference, first.detection, chart)
    patches = judge_chart(photo.image, detection, reference, chart).samples
    require_unclipped(patches, chart.names, photo.image.source, chart.neutrals)
    registration = registered(
        first.edges, find_edges(photo.image), (first.photo.image.source, photo.image.source),
        outlines, (first.detection.corners_px, detection.corners_px) if first.shows_chart else None)
    if registration is not None:
        outlines = {name: registration.moved(np.array(corners)).tolist()
                    for name, corners in outlines.items()}
    return _FilteredPhoto(Path(file).stem, photo.image, through, detection, patches,
                          sample_regions(photo.image, outlines, without_clipped=True))


def _swatches(swatches: Mapping[str, KnownSpectrum] | str | Path | None,
              regions: Mapping[str, Outline]) -> dict[str, np.ndarray]:
    """Reflectances (P,) of the regions that are swatches."""
    if isinstance(swatches, str | Path):
        return {name: spectrum_on_grid(spectrum, FINE_GRID) for name, spectrum
                in read_swatch_spectra(Path(swatches), regions).items()}
    return {name: as_reflectance(one, name) for name, one in (swatches or {}).items()}


def _measured_chart(photo: LinearImage, chart: Chart, reflectances: np.ndarray,
                    light: Spectrum | UnknownLight, corners: ArrayLike | None
                    ) -> tuple[ChartDetection, ChartVerdict]:
    power = spectrum_on_grid(light, FINE_GRID) if isinstance(light, Spectrum) else None
    reference = typical_camera_signals(reflectances, FINE_GRID, power)
    detection = find_chart(photo, reference,
                           None if corners is None else np.asarray(corners, float), chart)
    quality = judge_chart(photo, detection, reference, chart)
    require_unclipped(quality.samples, chart.names, photo.source, chart.neutrals)
    return detection, quality


def _outline(region: Outline) -> list[tuple[float, float]]:
    """Corners (x, y) of a region, going round."""
    points = np.asarray(region, dtype=float)
    if points.shape == (4,):
        x0, y0, x1, y1 = points.tolist()
        return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return [(x, y) for x, y in points.tolist()]
