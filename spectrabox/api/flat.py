"""Spectra of regions of a flat sample, from one photo with a colour chart in it or beside it."""
from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from spectrabox.api import arguments, estimates, shoot_arguments
from spectrabox.api.chart_check import ChartCheck
from spectrabox.api.photo import Photo
from spectrabox.api.progress import ProgressLike, progress_steps
from spectrabox.calibrate import chart_findings
from spectrabox.capture.photo.preview import photo_orientation
from spectrabox.measure.captured import FIRST_PHOTO, FlatCapture
from spectrabox.measure.profiles.colour_profile import ColourProfile, profile_of
from spectrabox.measure.records import CaptureRecords, PictureRecords
from spectrabox.measure.results.flat_result import flat_result
from spectrabox.measure.steps.measurement import MemoryKeeper, measure
from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.given_spectra import KnownSpectrum
from spectrabox.radiometry.system.threads import one_blas_thread

SAME_LAMP, MOVED_LAMP = "same", "moved"
# what is done of the whole when a step begins
BEGIN = {"chart": 0.0, "photo": 0.15, "calibrate": 0.2, "signals": 0.5, "sample": 0.6,
         "picture": 0.8, "": 1.0}

OutlineLike = Sequence[float] | Sequence[Sequence[float]]


class FlatSpectra(estimates.MeasuredSpectra):
    """Estimates of the regions of a flat sample, with the calibration that they come from.

    Attributes
    ----------
    picture : PictureRecords or None
        The files of a picture of spectra, where one was asked for.
    light : dict
        Of each region: the light on it relative to the chart's mean, and its relative error.

    References
    ----------
    How camera, light and fall-off are estimated: docs/explanation/calibration.md.

    Examples
    --------
    >>> result = sb.flat("painting/photos/painting.dng", {"wall": (986, 462, 1073, 537)})
    >>> result.verdict, result.reasons, result.light["wall"]
    >>> result.to_csv("spectra.csv")
    """

    def __init__(self, capture: FlatCapture, records: CaptureRecords,
                 picture_folder: str = "") -> None:
        result = flat_result(capture, records, picture_folder)
        super().__init__(result, records.signals)
        self.picture: PictureRecords | None = records.picture
        self.light: dict[str, tuple[float, float]] = result.light

    @property
    def chart_check(self) -> ChartCheck:
        """The chart's patches, each by a calibration without it."""
        chart = self.found.chart
        assert chart is not None and chart.left_out is not None
        return ChartCheck(self.found.layout.names, chart.left_out, chart_findings.of_patches(
            one for one in self.found.findings if not one.subject))

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
        return profile_of(self.calibration, arguments.families_of(families),
                          self.found.photo.camera_from_xyz)


@one_blas_thread()
def flat(photo: str | Path | Photo, regions: Mapping[str, OutlineLike], *,
         light: arguments.LightLike = "unknown",
         families: Mapping[str, str | Sequence[str]] | None = None,
         known: Mapping[str, KnownSpectrum] | None = None,
         surface: str | Mapping[str, str] | None = None,
         truth: Mapping[str, KnownSpectrum] | None = None,
         filtered: Mapping[str | Path, arguments.FilterLike] | None = None,
         also: Mapping[str | Path, arguments.LightLike] | None = None,
         chart_photo: str | Path | Photo | None = None, layout: str | Path | Chart | None = None,
         reference: str | None = None, corners: ArrayLike | None = None,
         camera_prior: str | Path | None = None, flat_field: str | Path | None = None,
         picture: str | Path | None = None, draws: int = shoot_arguments.SAMPLING.draws,
         level: float = shoot_arguments.SAMPLING.level, seed: int = shoot_arguments.SESSION.seed,
         progress: ProgressLike = None) -> FlatSpectra:
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
        Reflectance of regions that are known, a white card say: a file, (nm, values), a number, or
        (number, its standard error). A number without an error is taken to be known to 3 %.
    surface : str or mapping, optional
        How much the surfaces mirror: "matt", "satin" or "glossy"; of all regions, or by region.
    truth : mapping, optional
        Measured reflectance of regions to compare with, by region: a file, or (nm, values).
    filtered : mapping, optional
        Further photos of the same view under the same light through a filter before the lens or
        the lamp, each with the chart in it: from the photo to the filter's transmittance, a file,
        (nm, values), or "unknown". Every photo adds three bands. Photos are registered to the
        first; bands that are saturated on a region drop out there.
    also : mapping, optional
        Further photos of the same view, each with the chart in it, by their light: "same" for the
        first photo's lamp, "moved" for that lamp in another place, which measures what the samples
        mirror and whether light and plane are those of the chart, else as ``light``. Every photo
        under another light adds its bands.
    flat_field : path, optional
        An evenly lit white card in the samples' place, which every photo is divided by.
    picture : path, optional
        A folder that takes the spectrum of every pixel, with maps.
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
        done. By default a bar is shown in notebooks and on terminals.

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
    for argument, given, form in (
            ("regions", regions, "from names to (x0, y0, x1, y1)"),
            ("families", families, 'such as {"wall": "paint"}'), ("known", known, '{"card": 0.9}'),
            ("truth", truth, '{"wall": "wall.csv"}'),
            ("filtered", filtered, '{"gel.dng": "gel.csv"}'), ("also", also, '{"led.dng": "led"}')):
        arguments.require_mapping(given, argument, form)
    for name in (*(families or {}), *(known or {}), *(truth or {})):
        if name not in regions:
            raise InputError(f"there is no region {name!r}; there are {', '.join(regions)}")
    surfaces = arguments.surfaces_of(surface, regions, "region")
    stated = shoot_arguments.Arguments()
    capture = stated.capture({
        "session": {"name": "", "seed": seed},
        "photos": {"object": stated.photo(photo), "chart": stated.photo(chart_photo),
                   "flat": stated.photo(flat_field),
                   "orientation": photo.orientation if isinstance(photo, Photo)
                   else photo_orientation(Path(photo))},
        "light": {"spectrum": stated.light(light)},
        "views": _views(stated, filtered or {}, also or {}),
        "regions": {name: stated.outline(outline, name) | stated.surface(
            name, families, surfaces, known or {}, truth or {})
            for name, outline in regions.items()},
        "chart": stated.chart(layout, reference, corners),
        "sensitivity": stated.camera_prior(camera_prior),
        "sampling": arguments.sampling_of(draws=draws, level=level),
        "picture": None if picture is None else {}})
    assert isinstance(capture, FlatCapture)
    with progress_steps(progress, "flat") as show:
        keeper = MemoryKeeper(
            lambda step, share, message: show(_share(step, share), message),
            pictures=None if picture is None else arguments.folder_for_pictures(picture))
        return FlatSpectra(capture, measure(capture, keeper),
                           "" if picture is None else Path(picture).as_posix())


def _share(step: str, share: float) -> float:
    """What is done of the whole."""
    names = list(BEGIN)
    after = BEGIN[names[names.index(step) + 1]]
    return BEGIN[step] + share * (after - BEGIN[step])


def _views(stated: shoot_arguments.Arguments, filtered: Mapping[str | Path, arguments.FilterLike],
           also: Mapping[str | Path, arguments.LightLike]) -> dict[str, dict[str, Any]]:
    """Photos through filters, and those under the same or other lamps."""
    views: dict[str, dict[str, Any]] = {}
    for file, through in filtered.items():
        views[_name(file, views)] = {"photo": stated.photo(file), "same_light_as": FIRST_PHOTO,
                                     "filter": stated.filter(through, file)}
    for file, lamp in also.items():
        said: dict[str, Any] = {"same_light_as": FIRST_PHOTO}
        if isinstance(lamp, str) and lamp == MOVED_LAMP:
            said["lamp"] = "moved"
        elif not (isinstance(lamp, str) and lamp == SAME_LAMP):
            said = {"light": stated.light(lamp)}
        views[_name(file, views)] = {"photo": stated.photo(file), **said}
    return views


def _name(file: str | Path, views: Collection[str]) -> str:
    """What a further photo is called: as its file, numbered where there are two of the name."""
    stem = Path(file).stem
    return next(name for name in (stem, *(f"{stem} {number}" for number in range(2, 1000)))
                if name not in views and name != FIRST_PHOTO)
