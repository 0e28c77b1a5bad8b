"""Photos as linear camera signal, and the colour chart in them."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.api.arguments import as_chart
from spectrabox.api.notebook import axes_for
from spectrabox.capture.chart.quality import ChartVerdict
from spectrabox.capture.develop.developed import develop_photos
from spectrabox.capture.photo.orientation import AS_READ, photo_orientation
from spectrabox.capture.photo.preview import signal_rgb8
from spectrabox.measure.camera import judged_chart
from spectrabox.measure.captured import InputFile
from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.records.photos import ChartDetection, LinearImage, PatchSamples

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
    notes : tuple of str
        What happened while it was developed.
    orientation : int
        How it was turned from what the sensor read, as EXIF numbers it: 1 not at all.

    References
    ----------
    The variance of the signal is the photon-transfer line [Janesick 2007, ch. 5].

    Examples
    --------
    >>> photo = sb.open_photo("painting/photos/painting.dng")
    >>> photo.signal.shape, photo.bands, photo.size_px
    >>> photo.plot()
    """

    image: LinearImage
    notes: tuple[str, ...] = ()
    orientation: int = AS_READ

    @property
    def signal(self) -> np.ndarray:
        """Signal (H, W, K), black-subtracted, without white balance, as a fraction of white.

        Of a mosaic, one entry for each 2 x 2 cell: half the height and width of ``size_px``.
        """
        return self.image.signal

    @property
    def bands(self) -> int:
        """Number K of camera bands."""
        return int(self.image.signal.shape[2])

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the photo in pixels of the sensor."""
        height, width = self.image.signal.shape[:2]
        return round(width * self.image.sensor_step), round(height * self.image.sensor_step)

    def plot(self, axes: Axes | None = None) -> Axes:
        """The photo, stretched for the screen; the axes count pixels of the sensor.

        Parameters
        ----------
        axes : matplotlib Axes, optional
            To draw into; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_for(axes)
        width, height = self.size_px
        step = -(-max(self.image.signal.shape[:2]) // PREVIEW_PX)
        axes.imshow(signal_rgb8(self.image.signal, step),
                    extent=(-0.5, width - 0.5, height - 0.5, -0.5))
        axes.set(xlabel="pixel", ylabel="pixel")
        return axes

    def __repr__(self) -> str:
        width, height = self.size_px
        exposure = "exposure not stated" if self.image.exposure_s is None \
            else f"{self.image.exposure_s:.4g} s"
        return (f"<Photo {self.image.source}: {self.image.camera or 'camera not stated'}, "
                f"{width} x {height} pixels, {self.bands} bands, {exposure}>")


def open_photo(photo: str | Path | list[str | Path], *, dark: list[str | Path] | None = None,
               flat: str | Path | None = None, not_linear: bool = False,
               orientation: int | None = None) -> Photo:
    """Open a photo as linear camera signal, turned upright as other programs show it.

    Parameters
    ----------
    photo : path, or list of paths
        Camera raw, DNG, linear EXR or TIFF; several are an exposure bracket and are merged.
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
        If a file cannot be read, or its values are not proportional to light.
    CheckError
        If exposures of a bracket, dark frames or flat field do not fit the photo.

    References
    ----------
    What decoding does, step by step: docs/explanation/decoding.md.

    Examples
    --------
    >>> photo = sb.open_photo("painting/photos/painting.dng")
    """
    paths = [Path(one) for one in (photo if isinstance(photo, list) else [photo])]
    turn = photo_orientation(paths[0]) if orientation is None else orientation
    image, notes = develop_photos(paths, [Path(one) for one in dark or []],
                                  None if flat is None else Path(flat), not_linear,
                                  orientation=turn)
    return Photo(image, tuple(notes), turn)


def as_input_file(photo: str | Path | Photo) -> InputFile:
    """A photo's file, or a photo that is open already, as a capture names it."""
    if isinstance(photo, Photo):
        source = photo.image.source
        return InputFile(source, Path(source), photo.image, photo.notes)
    return InputFile(str(photo), Path(photo))


@dataclass(frozen=True, eq=False)
class ChartInPhoto:
    """A colour chart in a photo, its patches, and whether the photo is good enough.

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
    >>> chart.verdict, chart.reasons, chart.corners
    >>> chart.samples.mean
    >>> chart.plot()
    """

    photo: Photo
    layout: Chart
    detection: ChartDetection
    quality: ChartVerdict

    @property
    def verdict(self) -> str:
        """"good" or "re-shoot"."""
        return self.quality.verdict

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why to photograph the chart again, and what to do; empty if the photo is good."""
        return self.quality.reasons

    @property
    def corners(self) -> np.ndarray:
        """Sampled quadrilaterals (I, 4, 2) of the patches, in pixels of the photo."""
        return self.detection.corners_px

    @property
    def samples(self) -> PatchSamples:
        """Mean signals (I, K) of the patches, with their covariance."""
        return self.quality.samples

    def plot(self, axes: Axes | None = None) -> Axes:
        """The photo with the sampled quadrilaterals of the patches.

        Parameters
        ----------
        axes : matplotlib Axes, optional
            To draw into; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        axes = self.photo.plot(axes)
        for quad in self.corners:
            axes.plot(*np.vstack([quad, quad[:1]]).T, color="white", lw=1.8)
            axes.plot(*np.vstack([quad, quad[:1]]).T, color="black", lw=0.7)
        axes.set_title(f"{self.layout.name}: {self.verdict}")
        return axes

    def __repr__(self) -> str:
        return (f"<ChartInPhoto {self.layout.name} in {self.photo.image.source}: {self.verdict}, "
                f"{len(self.corners)} patches, confidence {self.detection.confidence:.2f}>")


def find_chart(photo: str | Path | Photo, *, layout: str | Path | Chart | None = None,
               reference: str | None = None, corners: ArrayLike | None = None) -> ChartInPhoto:
    """Find the colour chart in a photo and judge the photo.

    Parameters
    ----------
    photo : path or Photo
    layout : name, layout file or Chart, optional
        A ColorChecker Classic by default.
    reference : str, optional
        Chart reflectances: a published average by name, or a file of measured ones.
    corners : (4, 2) array, optional
        Of the chart, in pixels: of a ColorChecker the outer corners of the patches at dark
        skin, bluish green, black and white.

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
    detection, quality = judged_chart(opened.image, chart, reference, None if corners is None
                                      else np.asarray(corners, dtype=float))
    return ChartInPhoto(opened, chart, detection, quality)
