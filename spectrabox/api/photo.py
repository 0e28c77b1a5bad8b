"""Photos as linear camera signal, and the colour chart in them."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.api.arguments import as_chart, as_corners, as_outline
from spectrabox.capture.chart.quality import ChartVerdict
from spectrabox.capture.develop.developed import develop_photos
from spectrabox.capture.photo import image_files, preview
from spectrabox.capture.photo.regions import sample_regions
from spectrabox.measure import camera, captured, chart_patches, plots, texts
from spectrabox.radiometry import errors, files
from spectrabox.radiometry.chart import Chart, excluded_patches
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records import photos

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PREVIEW_PX = 1200       # of the longest side of a plotted photo


@dataclass(frozen=True, eq=False)
class Photo:
    """A photo as linear camera signal.

    Attributes
    ----------
    image : LinearImage
        Signal (H, W, K) as a fraction of (white - black), with its variance.
    findings : tuple of Finding
        What showed while it was developed; ``notes`` are its sentences.
    orientation : int
        How it was turned from what the sensor read, as EXIF numbers it: 1 not at all.

    References
    ----------
    The variance of the signal is the photon-transfer line [Janesick 2007, ch. 5].

    Examples
    --------
    >>> photo = sb.open_photo("painting/photos/painting.dng")
    >>> photo.signal.shape, photo.bands, photo.size_px
    >>> photo.mean((986, 462, 1073, 537)), photo.standard_error((986, 462, 1073, 537))
    >>> photo.plot()
    """

    image: photos.LinearImage
    findings: tuple[Finding, ...] = ()
    orientation: int = preview.AS_READ

    @property
    def signal(self) -> np.ndarray:
        """Signal (H, W, K), black-subtracted, without white balance, as a fraction of white.

        Of a mosaic, one entry for each 2 x 2 cell: half the height and width of ``size_px``.
        """
        return self.image.signal

    @property
    def notes(self) -> tuple[str, ...]:
        """What showed while it was developed, in sentences."""
        return tuple(texts.says(finding) for finding in self.findings)

    @property
    def bands(self) -> int:
        """Number K of camera bands."""
        return int(self.image.signal.shape[2])

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the photo in pixels of the sensor."""
        height, width = self.image.signal.shape[:2]
        return round(width * self.image.sensor_step), round(height * self.image.sensor_step)

    def mean(self, region: Sequence[float] | Sequence[Sequence[float]]) -> np.ndarray:
        """Mean signal (K,) of a region, in pixels of the photo's axes.

        Parameters
        ----------
        region : (x0, y0, x1, y1) or [(x, y), ...]
            Two opposite corners, or three corners or more going round, as `flat` takes them: x to
            the right, y down, in pixels of ``size_px``, whatever ``signal`` has an entry for.

        Returns
        -------
        (K,) array
            Fractions of white; NaN in a band of which more than 1 % of the pixels are saturated.

        Raises
        ------
        InputError
            If the region leaves the photo or holds fewer than 16 pixels.
        ClippedPhotoError
            If every band is saturated there.
        """
        return self._sampled(region)[0]

    def standard_error(self, region: Sequence[float] | Sequence[Sequence[float]]) -> np.ndarray:
        """Standard error (K,) of `mean` by the noise of the pixels.

        Parameters
        ----------
        region : (x0, y0, x1, y1) or [(x, y), ...]
            As of `mean`.

        Returns
        -------
        (K,) array
            Fractions of white.

        Raises
        ------
        InputError, ClippedPhotoError
            As of `mean`.
        """
        return self._sampled(region)[1]

    def _sampled(self, region: Sequence[float] | Sequence[Sequence[float]]
                 ) -> tuple[np.ndarray, np.ndarray]:
        samples = sample_regions(self.image, {"region": as_outline(region)}, without_clipped=True)
        mean, error = samples.mean[0], np.sqrt(np.diagonal(samples.covariance_of_mean[0]))
        unread = np.zeros(len(mean), bool) if samples.clipped is None else samples.clipped[0]
        return np.where(unread, np.nan, mean), np.where(unread, np.nan, error)

    def plot(self, ax: Axes | None = None) -> Axes:
        """The photo, stretched for the screen; the axes count pixels of the sensor.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            To draw into; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        axes = plots.axes_for(ax)
        width, height = self.size_px
        step = -(-max(self.image.signal.shape[:2]) // PREVIEW_PX)
        axes.imshow(preview.signal_rgb8(self.image.signal, step),
                    extent=(-0.5, width - 0.5, height - 0.5, -0.5))
        axes.set(xlabel="pixel", ylabel="pixel")
        return axes

    def __repr__(self) -> str:
        width, height = self.size_px
        exposure = "exposure not stated" if self.image.exposure_s is None \
            else f"{self.image.exposure_s:.4g} s"
        return (f"<Photo {self.image.source}: {self.image.camera or 'camera not stated'}, "
                f"{width} x {height} pixels, {self.bands} bands, {exposure}>")


def open_photo(photo: str | Path | list[str | Path] | np.ndarray, *,
               dark: list[str | Path] | None = None, flat: str | Path | None = None,
               not_linear: bool = False, orientation: int | None = None) -> Photo:
    """Open a photo as linear camera signal, turned upright as other programs show it.

    Parameters
    ----------
    photo : path, list of paths, or (H, W, K) array
        Camera raw, DNG, linear EXR or TIFF; several are an exposure bracket and are merged. An
        array holds linear values: floats, or 16-bit integers as fractions of 65535.
    dark : list of paths, optional
        Dark frames at the photo's exposure and ISO.
    flat : path, optional
        An evenly lit white card in the same place; divides the photo.
    not_linear : bool
        Take JPEG and PNG too, decoded as sRGB.
    orientation : int, optional
        How to turn it, 1 to 8 as EXIF numbers them: 1 leaves it as the sensor read it. By default
        as the first file states.

    Returns
    -------
    Photo

    Raises
    ------
    InputError
        If a file cannot be read, or its values are not proportional to light; if an array has
        other types, or comes with dark frames or a flat field.
    CheckError
        If exposures of a bracket, dark frames or flat field do not fit the photo.

    References
    ----------
    What decoding does, step by step: docs/explanation/decoding.md.

    Examples
    --------
    >>> photo = sb.open_photo("painting/photos/painting.dng")
    """
    if orientation is not None and orientation not in range(1, 9):
        raise errors.InputError(f"orientation={orientation} is none of EXIF's, 1 to 8")
    if isinstance(photo, np.ndarray):
        if dark or flat is not None:
            raise errors.InputError(
                "an array is taken as it is; subtract dark frames and divide by the "
                "flat field before, or give files")
        turn = preview.AS_READ if orientation is None else orientation
        image = image_files.image_of_array(photo)
        return Photo(preview.turned(image, turn), image.findings, turn)
    paths = [Path(one) for one in (photo if isinstance(photo, list) else [photo])]
    if not paths:
        raise errors.InputError("no photo was given; give one, or several exposures of a bracket")
    turn = preview.photo_orientation(paths[0]) if orientation is None else orientation
    image, findings = develop_photos(paths, [Path(one) for one in dark or []],
                                     None if flat is None else Path(flat), not_linear,
                                     orientation=turn)
    return Photo(image, findings, turn)


def as_input_file(photo: str | Path | Photo) -> captured.InputFile:
    """A photo's file, or a photo that is open already, as a capture names it."""
    if isinstance(photo, Photo):
        source = photo.image.source
        return captured.InputFile(source, Path(source), photo.image, photo.findings)
    return captured.InputFile(str(photo), Path(photo))


@dataclass(frozen=True, eq=False)
class ChartInPhoto:
    """A colour chart in a photo, its patches, and whether the photo is good enough.

    Patches are in chart order, row by row as printed, whichever way the chart lies. Positions are
    (x, y) in pixels of the photo: x to the right, y down, (0, 0) the centre of the first pixel; of
    a camera raw in pixels of the whole sensor, as other programs show the photo.

    Attributes
    ----------
    photo : Photo
    layout : Chart
    detection : ChartDetection
    quality : ChartVerdict

    References
    ----------
    How a chart is recognised and judged: docs/explanation/decoding.md.

    Examples
    --------
    >>> chart = sb.find_chart("painting/photos/painting.dng")
    >>> chart.verdict, chart.reasons, chart.names
    >>> chart.centres, chart.corners, chart.angle_deg
    >>> chart.mean, chart.standard_error, chart.spread, chart.clipped
    >>> chart.edition.says
    >>> chart.to_csv("patches.csv")
    >>> chart.plot()
    """

    photo: Photo
    layout: Chart
    detection: photos.ChartDetection
    quality: ChartVerdict
    excluded: np.ndarray | None = None      # (I,) bool: patches left out

    @property
    def verdict(self) -> str:
        """"good" or "re-shoot"."""
        return self.quality.verdict

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why to photograph the chart again, and what to do; empty if the photo is good."""
        return tuple(texts.reasons(self.quality.findings))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All that was found of the photo, as codes and values; faults are its ``reasons``."""
        return self.quality.findings

    @property
    def names(self) -> tuple[str, ...]:
        """Names (I) of the patches."""
        return self.layout.names

    @property
    def corners(self) -> np.ndarray:
        """Corners (I, 4, 2) of the sampled middle of each patch, 0.6 of its sides: as printed top
        left, top right, bottom right, bottom left.
        """
        return self.detection.corners_px

    @property
    def centres(self) -> np.ndarray:
        """Centres (I, 2) of the patches."""
        return chart_patches.centres_px(self.detection)

    @property
    def angle_deg(self) -> float:
        """How far the chart is turned clockwise in the photo, -180 to 180; 0 as printed."""
        return chart_patches.angle_deg(self.detection, self.layout)

    @property
    def mean(self) -> np.ndarray:
        """Linear values (I, K): mean of each patch, black-subtracted, without white balance, as a
        fraction of white.
        """
        return self.samples.mean

    @property
    def standard_error(self) -> np.ndarray:
        """Standard error (I, K) of ``mean`` by the noise of its pixels."""
        return self.samples.standard_error

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation (I, K) of the single pixels of a patch, less light that changes
        evenly across it, dust and glints; of a camera raw a pixel is a cell of the mosaic.
        """
        return self.samples.spread

    @property
    def clipped(self) -> np.ndarray:
        """Whether more than 1 % of the pixels (I, K) are saturated, so that the mean is too low."""
        return self.samples.clipped

    @cached_property
    def edition(self) -> chart_patches.ChartEdition:
        """Whether a ColorChecker was made before or since November 2014: ``edition``, or None where
        the photo does not tell, ``evidence`` in nats and ``says``, a sentence; and ``patches``,
        findings of those that are not as the others make them. Takes about two seconds.
        """
        return chart_patches.edition_in_photo(self.photo.image, self.layout, self.samples,
                                              self.excluded)

    @property
    def samples(self) -> photos.PatchSamples:
        """Mean signals (I, K) of the patches, with their covariance, and the number of pixels."""
        return self.quality.samples

    def columns(self) -> dict[str, np.ndarray]:
        """All this by the names of columns, as ``to_csv`` writes them and a data frame takes them.

        Returns
        -------
        dict
            From names to arrays (I,).
        """
        return chart_patches.patch_columns(self.layout, self.detection, self.samples,
                                           self.quality.excluded)

    def to_csv(self, path: str | Path) -> Path:
        """Write a row for each patch, as ``spectrabox chart --out``; ``camera fit --patches`` reads
        it.

        Parameters
        ----------
        path : path

        Returns
        -------
        Path
            Of the file.

        Raises
        ------
        EnvironmentProblem
            If the file cannot be written; an older one is left as it was.
        """
        files.write_text_whole(files.in_folder(path),
                               chart_patches.table_of_columns(self.columns()))
        return Path(path)

    def plot(self, ax: Axes | None = None) -> Axes:
        """The photo with the sampled quadrilaterals of the patches.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            To draw into; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        axes = self.photo.plot(ax)
        for quad in self.corners:
            axes.plot(*np.vstack([quad, quad[:1]]).T, color="white", lw=1.8)
            axes.plot(*np.vstack([quad, quad[:1]]).T, color="black", lw=0.7)
        axes.set_title(f"{self.layout.name}: {self.verdict}")
        return axes

    def __repr__(self) -> str:
        return (f"<ChartInPhoto {self.layout.name} in {self.photo.image.source}: {self.verdict}, "
                f"{len(self.corners)} patches, confidence {self.detection.confidence:.2f}>")


def find_chart(photo: str | Path | Photo | np.ndarray, *, layout: str | Path | Chart | None = None,
               reference: str | None = None, corners: ArrayLike | None = None,
               leave_out: Sequence[int] = ()) -> ChartInPhoto:
    """Find the colour chart in a photo and judge the photo.

    Parameters
    ----------
    photo : path, Photo, or (H, W, K) array of linear values
        As `open_photo` takes them; of a JPEG or PNG `open_photo` with ``not_linear=True``.
    layout : name, layout file or Chart, optional
        A ColorChecker Classic by default.
    reference : str, optional
        Chart reflectances: a published average by name, or a file of measured ones.
    corners : (4, 2) array, optional
        Of the chart, in pixels: of a ColorChecker the outer corners of the patches at dark
        skin, bluish green, black and white.
    leave_out : sequence of int
        Numbers of patches, from 1, that need not be as the chart's: covered or misprinted ones.

    Returns
    -------
    ChartInPhoto

    Raises
    ------
    ChartNotFoundError
        If there is no chart, or none at the corners.
    CheckError
        If the photo shows the chart mirrored, or its values are not proportional to light.
    InputError
        If a file cannot be read, or the chart's layout is not known.

    References
    ----------
    docs/explanation/decoding.md, "How a chart is recognised".

    Examples
    --------
    >>> chart = sb.find_chart("painting/photos/painting.dng")
    >>> chart.verdict, chart.reasons
    """
    opened = photo if isinstance(photo, Photo) else open_photo(photo)
    chart = as_chart(layout)
    excluded = excluded_patches(leave_out, chart, "leave_out")
    detection, quality = camera.judged_chart(opened.image, chart, reference, as_corners(corners),
                                             excluded)
    return ChartInPhoto(opened, chart, detection, quality, excluded)
