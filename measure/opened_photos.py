"""The photos of a capture as linear signal, each developed when a step first asks for it."""
from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping

from spectrabox.capture.develop import developed
from spectrabox.capture.photo.stored_images import stated_bands
from spectrabox.measure import captured
from spectrabox.radiometry.errors import ClippedPhotoError, InputError
from spectrabox.radiometry.findings import Finding, each_once
from spectrabox.radiometry.records import photos, spectra

MAX_CLIPPED = 0.5               # of the object photo
LETTERED = ({*"RGB"}, {*"XYZ"})     # bands of which one cannot be another
Channels = tuple[tuple[int, ...], ...]      # of each photo of a table
LETTERS = {"RED": "R", "GREEN": "G", "BLUE": "B"}       # of bands, by their names


class OpenPhotos:
    """Photos of one capture. The last is kept: chart and samples are often in one photo.

    Parameters
    ----------
    capture : Capture
    """

    def __init__(self, capture: captured.Capture) -> None:
        self._capture = capture
        self._last: tuple[captured.PhotoFiles, photos.LinearImage,
                          tuple[Finding, ...]] | None = None
        self._channels: Channels | None = None

    def developed(self,
                  photo: captured.PhotoFiles) -> tuple[photos.LinearImage, tuple[Finding, ...]]:
        """As ``develop``."""
        if self._last is None or self._last[0] != photo:
            self._last = None           # its memory is needed for the next
            self._last = (photo, *develop(self._capture, photo, self.channels))
        return self._last[1:]

    @property
    def channels(self) -> Channels:
        """As ``channels_of_photos``; none of a colour camera's photos."""
        if self._channels is None:
            self._channels = () if captured.ONE_PHOTO in self._capture.views[0].photo else \
                channels_of_photos(self._capture)
        return self._channels

    def bands(self, photo: photos.LinearImage) -> tuple[str, ...]:
        """Names of the bands of the capture's photos, of which one is given."""
        shown = self._capture.views[0].photo
        if captured.ONE_PHOTO in shown:
            return spectra.default_band_names(photo.signal.shape[2])
        return tuple(_names_of_channels(shown, self.channels))


def develop(capture: captured.Capture, photo: captured.PhotoFiles,
            channels: Channels | None = None) -> tuple[photos.LinearImage, tuple[Finding, ...]]:
    """A photo as linear signal, without dark signal and flat-fielded where there are the frames.

    One of several bands is stacked; its bands are brought to the shortest of their exposures where
    all state one. Findings are what showed on the way: hot pixels, measured exposure ratios, a file
    that is not linear.

    Parameters
    ----------
    capture : Capture
    photo : PhotoFiles
    channels : tuple of tuple of int, optional
        As of ``channels_of_photos``, where they were looked up before.

    Returns
    -------
    image : LinearImage
    findings : tuple of Finding
    """
    several = captured.ONE_PHOTO not in photo
    channels = (channels_of_photos(capture) if channels is None else channels) if several else ()
    images, findings = list[photos.LinearImage](), list[Finding]()
    for number, (band, files) in enumerate(photo.items()):
        image, of_files = _developed_files(capture, band, files,
                                           channels[number] if several else None)
        images.append(image)
        findings += of_files
    if not several:
        return images[0], each_once(findings)
    exposures = [image.exposure_s for image in images]
    shortest = None if None in exposures else min(exposure for exposure in exposures
                                                  if exposure is not None)
    every = [(image, channel) for image in images for channel in range(image.signal.shape[2])]
    stacked = developed.stack_bands([image for image, _ in every],
                                    _names_of_channels(photo, channels),
                                    [channel for _, channel in every],
                                    None if shortest is None else [shortest] * len(every))
    return dataclasses.replace(stacked, exposure_s=shortest), each_once(findings)


def _developed_files(capture: captured.Capture, band: str, files: tuple[captured.InputFile, ...],
                     channels: tuple[int, ...] | None
                     ) -> tuple[photos.LinearImage, tuple[Finding, ...]]:
    """Files of one band: a photo, or a bracket of exposures."""
    if files[0].opened is not None:
        return files[0].opened, files[0].findings
    flat = capture.flat_fields.get(band, capture.flat_fields.get(captured.ONE_PHOTO))
    return developed.develop_photos([file.path for file in files],
                                    [frame.path for frame in capture.dark_frames],
                                    None if flat is None else flat.path, capture.not_linear,
                                    channels, capture.orientation)


def channels_of_photos(capture: captured.Capture) -> Channels:
    """Channels of each photo of a table that see its filter's or lamp's light, the same in all
    photos: a scene of other colours may tip the balance between two. Where curves are stated, one
    for each photo, that is the strongest.
    """
    charts = [view.chart for view in capture.views_with_chart]
    first = charts[0] if charts else capture.views[0].photo
    images = (developed.open_any(files[0].path, capture.not_linear)
              for files in first.values())
    return tuple(developed.bright_channels(image) if capture.sensitivity.curves is None
                 else (developed.strongest_channel(image),) for image in images)


def _names_of_channels(photo: Mapping[str, object], channels: Channels) -> list[str]:
    """Names of the bands of a table of photos: a photo's, with the channel where it has several."""
    return [f"{name} {'RGB'[channel]}" if len(chosen) > 1 else name
            for name, chosen in zip(photo, channels, strict=True) for channel in chosen]


def require_exposed(photo: photos.LinearImage, name: str) -> None:
    """Refuse an object photo of which too little is left to compare with a rendering.

    Parameters
    ----------
    photo : LinearImage
    name : str
        Of the photo's file, for the message.

    Raises
    ------
    ClippedPhotoError
        With the saturated share.
    """
    clipped = photo.clipped_share
    if clipped > MAX_CLIPPED:
        raise ClippedPhotoError(f"{name}: {clipped:.0%} of the photo is saturated; halve the "
                                "exposure until the surfaces are not, the light itself may be")


def require_one_camera(images: Iterable[photos.LinearImage]) -> None:
    """Refuse photos of which two state different cameras; some files leave its serial number out.

    Parameters
    ----------
    images : iterable of LinearImage

    Raises
    ------
    InputError
        Naming both.
    """
    stated = [image for image in images if image.camera]
    for other in stated[1:]:
        first = stated[0]
        short, long = sorted((f"{first.camera} ", f"{other.camera} "), key=len)
        if not long.startswith(short):
            raise InputError(f"{first.source} was taken with {first.camera} and {other.source} "
                             f"with {other.camera}: curves and signals of one camera say nothing "
                             "of another; take all photos, the chart's too, with one camera")


def require_curves_of_bands(capture: captured.Capture) -> None:
    """Refuse measured curves whose names say that they are of other bands than an EXR's channels.

    Raises
    ------
    InputError
        If columns named X, Y, Z are to be the curves of channels R, G, B, say, or stand in another
        order.
    """
    stated = capture.sensitivity
    curves = tuple(LETTERS.get(name.strip().upper(), name.strip().upper())
                   for name in stated.names)
    if stated.curves is None or not curves:
        return
    for view in capture.views:
        for file in view.photo.get(captured.ONE_PHOTO, ()):
            bands = () if file.opened is not None else stated_bands(file.path)
            if bands != curves and {*bands} in LETTERED and {*curves} in LETTERED:
                raise InputError(
                    f"{file.name} has the channels {', '.join(bands)}, and the curves of "
                    f"{stated.source} are named {', '.join(curves)}: give the curves of these "
                    "channels, in their order (sensitivity.columns), or rename the columns")
