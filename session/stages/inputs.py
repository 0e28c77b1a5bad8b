"""Every input of a session, read and checked the same way by ``check`` and ``run``."""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from spectrabox.capture.develop.bands import bright_channels, stack_bands, strongest_channel
from spectrabox.capture.develop.developed import develop_photos, open_any
from spectrabox.capture.photo.image_files import stated_bands
from spectrabox.radiometry.chart import excluded_patches as patches_by_number
from spectrabox.radiometry.charts.references import reference_reflectances
from spectrabox.radiometry.errors import ClippedPhotoError, InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import (
    Filter,
    LinearImage,
    Quantity,
    Spectrum,
    UnknownLight,
    default_band_names,
)
from spectrabox.radiometry.spectra.filters import read_filter as read_filter_file
from spectrabox.radiometry.spectra.filters import unknown_filter
from spectrabox.radiometry.spectra.named_spectra import sensitivities
from spectrabox.radiometry.spectra.spectrum_files import (
    on_grid,
    read_curves,
    read_spectrum,
    spectrum_on_grid,
)
from spectrabox.radiometry.spectra.stated_light import spectrum_of_name, vague_light
from spectrabox.session.config.curve_sources import FilterTable, LightTable, SpectrumTable
from spectrabox.session.config.session_chart import chart_files, session_chart
from spectrabox.session.config.session_schema import ONE_PHOTO, SessionConfig, ViewInputs

MAX_CLIPPED = 0.5               # of the object photo
LETTERED = ({*"RGB"}, {*"XYZ"})     # bands of which one cannot be another
Channels = tuple[tuple[int, ...], ...]      # of each photo of a table
LETTERS = {"RED": "R", "GREEN": "G", "BLUE": "B"}       # of bands, by their names


def read_light(config: SessionConfig, reference: LightTable | None = None
               ) -> Spectrum | UnknownLight:
    """Light spectrum as its file gives it, or what is known of it; the session's own unless another
    is named.

    Raises
    ------
    InputError
        If its file cannot be read, does not cover 400-700 nm or is negative there, or no light has
        its name.
    """
    reference = reference or config.light.spectrum
    if reference.cct is not None:
        return UnknownLight(cct=reference.cct)
    if reference.word is not None:
        return vague_light(reference.word) or spectrum_of_name(reference.word, FINE_GRID)
    assert reference.file is not None
    light = read_spectrum(config.path(reference.file), role=Quantity.RELATIVE,
                          column=reference.column, wavelength_column=reference.wavelength_column)
    values = spectrum_on_grid(light, FINE_GRID)
    if values.max() <= 0 or values.min() < -0.01 * values.max():
        raise InputError(f"{reference.file}: a light spectrum must be positive; "
                         f"it runs from {values.min():.3g} to {values.max():.3g} over 400-700 nm")
    return light


def read_light_of(config: SessionConfig, view: ViewInputs) -> Spectrum | UnknownLight:
    """What lights a view: its lamp through its filter.

    Raises
    ------
    InputError
        As ``read_light``, and if a filter transmits less than nothing or more than all.
    """
    light = read_light(config, view.light)
    if view.filter is None:
        return light
    if view.filter.file is None or isinstance(light, UnknownLight):
        return UnknownLight()
    power = spectrum_on_grid(light, FINE_GRID) * read_filter(config, view.filter).transmittance
    return Spectrum(FINE_GRID, power, Quantity.RELATIVE, f"{light.source} through "
                    f"{view.filter.file}")


def read_filter(config: SessionConfig, reference: FilterTable) -> Filter:
    """A filter of the session, with its error.

    Raises
    ------
    InputError
        If its file cannot be read, does not cover 400-700 nm, or is no transmittance.
    """
    if reference.file is None:
        return unknown_filter()
    return read_filter_file(config.path(reference.file), reference.column,
                            reference.wavelength_column)


def power_of(light: Spectrum | UnknownLight) -> np.ndarray | None:
    """The spectrum (P,) on the working grid; None where it is not known.

    Parameters
    ----------
    light : Spectrum or UnknownLight
    """
    return None if isinstance(light, UnknownLight) else spectrum_on_grid(light, FINE_GRID)


def read_known_light(config: SessionConfig, reference: LightTable | None = None) -> Spectrum:
    """The same where a spectrum is needed.

    Raises
    ------
    InputError
        As ``read_light``, and if the light is not known.
    """
    light = read_light(config, reference)
    if isinstance(light, UnknownLight):
        raise InputError(f"this needs the spectrum of a light and has an {light.words}; measure "
                         "it, or name a CIE illuminant")
    return light


def read_reflectance(config: SessionConfig, reference: SpectrumTable) -> Spectrum:
    """Reflectance that covers 400-700 nm.

    Raises
    ------
    InputError
        If the file cannot be read, or does not cover 400-700 nm.
    """
    spectrum = read_spectrum(config.path(reference.file), role=Quantity.REFLECTANCE,
                             column=reference.column, wavelength_column=reference.wavelength_column)
    spectrum_on_grid(spectrum, FINE_GRID)
    return spectrum


def read_sensitivities(config: SessionConfig) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and measured curves (K, P) on the working grid, scaled to a largest value of 1.

    Raises
    ------
    InputError
        If there are fewer than three curves, or they are negative.
    """
    source = config.sensitivity.source
    if source.file is None:
        on = sensitivities(source.words, FINE_GRID)
        names = default_band_names(len(on))
    else:
        nm, names, curves = read_curves(config.path(source.file), source.columns,
                                        source.wavelength_column)
        on = on_grid(nm, curves, FINE_GRID, source.file)
    if len(names) < 3:
        raise InputError(f"{source.words} holds {len(names)} curves; three or more bands are "
                         "needed")
    if on.max() <= 0 or on.min() < -0.05 * on.max():
        raise InputError(f"{source.words}: sensitivities must be positive; "
                         f"they run from {on.min():.3g} to {on.max():.3g}")
    return names, np.maximum(on, 0.0) / on.max()


def require_curves_of_bands(config: SessionConfig) -> None:
    """Refuse measured curves whose names say that they are of other bands than an EXR's channels.

    Raises
    ------
    InputError
        If columns named X, Y, Z are to be the curves of channels R, G, B, say, or stand in another
        order.
    """
    source = config.sensitivity.source
    if config.sensitivity.from_chart or source.file is None:
        return
    curves = tuple(LETTERS.get(name.strip().upper(), name.strip().upper())
                   for name in read_sensitivities(config)[0])
    for view in config.all_views:
        for name in view.photo.get(ONE_PHOTO, ()):
            bands = stated_bands(config.path(name))
            if bands != curves and {*bands} in LETTERED and {*curves} in LETTERED:
                raise InputError(
                    f"{name} has the channels {', '.join(bands)}, and the curves of {source.file} "
                    f"are named {', '.join(curves)}: give the curves of these channels, in their "
                    "order (sensitivity.columns), or rename the columns")


def read_chart_reference(config: SessionConfig) -> np.ndarray:
    """Reflectances (I, P) of the chart, published or measured."""
    for name in chart_files(config):
        config.path(name)      # refuses what lies outside the session
    return reference_reflectances(config.chart.reference, session_chart(config), FINE_GRID,
                                  config.folder)


def excluded_patches(config: SessionConfig) -> np.ndarray:
    """Whether the operator keeps each patch (I,) of the chart out of every fit.

    Raises
    ------
    InputError
        If the chart has no patch of such a number.
    """
    return patches_by_number(config.chart.leave_out, session_chart(config), "chart.leave_out")


def chart_corners(config: SessionConfig, view: ViewInputs) -> np.ndarray | None:
    """Outer corners (4, 2) of the chart in pixels where the operator gave them, for the first view
    alone.
    """
    given = config.chart.corners_px
    return None if given is None or view.name else np.array(given)


def read_photo(config: SessionConfig, photo: dict[str, tuple[str, ...]],
               channels: Channels | None = None) -> tuple[LinearImage, tuple[str, ...]]:
    """A photo as linear signal, without dark signal and flat-fielded where the session has the
    frames.

    One of several bands is stacked; its bands are brought to the shortest of their exposures where
    all state one. Notes say what was found on the way: hot pixels, measured exposure ratios, a file
    that is not linear.

    Parameters
    ----------
    photo : dict
        Files by band; under ``ONE_PHOTO`` those of a colour camera. Several files are an exposure
        bracket.
    channels : tuple of tuple of int, optional
        As of ``channels_of_photos``, where they were looked up before.

    Returns
    -------
    image : LinearImage
    notes : tuple of str
    """
    darks, flats = [config.path(name) for name in config.photos.dark_files], config.photos.flats
    images, notes = [], []
    several = ONE_PHOTO not in photo
    channels = (channels_of_photos(config) if channels is None else channels) if several else ()
    for number, (band, files) in enumerate(photo.items()):
        flat = flats.get(band, flats.get(ONE_PHOTO))
        image, said = develop_photos([config.path(name) for name in files], darks,
                                     None if flat is None else config.path(flat),
                                     config.photos.not_linear,
                                     channels[number] if several else None,
                                     config.photos.orientation)
        images.append(image)
        notes += [note for note in said if note not in notes]
    if not several:
        return images[0], tuple(notes)
    exposures = [image.exposure_s for image in images]
    shortest = None if None in exposures else min(exposure for exposure in exposures
                                                  if exposure is not None)
    every = [(image, channel) for image in images for channel in range(image.signal.shape[2])]
    stacked = stack_bands([image for image, _ in every], _names_of_channels(photo, channels),
                          [channel for _, channel in every],
                          None if shortest is None else [shortest] * len(every))
    return dataclasses.replace(stacked, exposure_s=shortest), tuple(notes)


def channels_of_photos(config: SessionConfig) -> Channels:
    """Channels of each photo of a table that see its filter's or lamp's light, the same in all
    photos: a scene of other colours may tip the balance between two. Where curves are stated, one
    for each photo, that is the strongest.
    """
    charts = [view.chart for view in config.views_with_chart]
    first = charts[0] if charts else config.all_views[0].photo
    images = (open_any(config.path(files[0]), config.photos.not_linear) for files in first.values())
    return tuple(bright_channels(image) if config.sensitivity.from_chart
                 else (strongest_channel(image),) for image in images)


def _names_of_channels(photo: Mapping[str, object], channels: Channels) -> list[str]:
    """Names of the bands of a table of photos: a photo's, with the channel where it has several."""
    return [f"{name} {'RGB'[channel]}" if len(chosen) > 1 else name
            for name, chosen in zip(photo, channels, strict=True) for channel in chosen]


def require_exposed(photo: LinearImage, name: str) -> None:
    """Refuse an object photo of which too little is left to compare with a rendering.

    Parameters
    ----------
    name : str
        Of the photo's file, for the message.

    Raises
    ------
    ClippedPhotoError
        With the saturated share.
    """
    clipped = float(photo.saturated.any(axis=2).mean())
    if clipped > MAX_CLIPPED:
        raise ClippedPhotoError(f"{name}: {clipped:.0%} of the photo is saturated; halve the "
                                "exposure until the surfaces are not, the light itself may be")


def band_names(config: SessionConfig, photographed: tuple[str, ...]) -> tuple[str, ...]:
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
    if config.sensitivity.from_chart:
        return photographed
    curves = read_sensitivities(config)[0]
    if len(curves) != len(photographed):
        raise InputError(f"{config.sensitivity.source.words} holds {len(curves)} curves, but the "
                         f"photo has {len(photographed)} bands ({', '.join(photographed)}): give "
                         "one curve for each, in this order")
    return curves if ONE_PHOTO in config.all_views[0].photo else photographed


class OpenPhotos:
    """Photos of one run. The last is kept: chart and samples are often in one photo."""

    def __init__(self) -> None:
        self._last: tuple[dict[str, tuple[str, ...]], LinearImage, tuple[str, ...]] | None = None
        self._channels: Channels | None = None

    def developed(self, config: SessionConfig,
                  photo: dict[str, tuple[str, ...]]) -> tuple[LinearImage, tuple[str, ...]]:
        """As ``read_photo``."""
        if self._last is None or self._last[0] != photo:
            self._last = None           # its memory is needed for the next
            self._last = (photo, *read_photo(config, photo, self.channels(config)))
        return self._last[1:]

    def channels(self, config: SessionConfig) -> Channels:
        """As ``channels_of_photos``; none of a colour camera's photos."""
        if self._channels is None:
            self._channels = () if ONE_PHOTO in config.all_views[0].photo else \
                channels_of_photos(config)
        return self._channels

    def bands(self, config: SessionConfig, photo: LinearImage) -> tuple[str, ...]:
        """Names of the bands of the session's photos, of which one is given."""
        shown = config.all_views[0].photo
        return default_band_names(photo.signal.shape[2]) if ONE_PHOTO in shown else \
            tuple(_names_of_channels(shown, self.channels(config)))
