"""Multispectral capture: photos behind different filters or under different lights as one image."""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.photos import LinearImage

WELL_EXPOSED_PERCENTILE = 99.0
# of the strongest channel under one filter or lamp: what lies below is mostly glare and black level
DARK_CHANNEL = 0.03


def stack_bands(images: Sequence[LinearImage], names: Sequence[str],
                channels: Sequence[int] | None = None,
                exposures_s: Sequence[float] | None = None) -> LinearImage:
    """One image of K bands, in the order of the photos.

    Parameters
    ----------
    images : sequence of LinearImage
        A photo for each band, of one camera that did not move.
    names : sequence of K str
        What makes each band: "450 nm", "blue LED".
    channels : sequence of K int or None
        Which channel of each photo to take; None for the one that sees most light.
    exposures_s : sequence of K float or None
        Exposure to bring each band to; None leaves each at its own, which a calibration takes up as
        a gain of the band, provided it is the same for all scenes.

    Raises
    ------
    InputError
        If the photos differ in size or camera, or their number is not that of the names; where
        exposures are asked for, also if a photo does not state its own, or the photos differ in ISO
        or f-number.
    """
    if len(images) != len(names) or not images:
        raise InputError(f"{len(images)} photos and {len(names)} band names were given; one name "
                         "per photo is needed")
    first = images[0]
    for image, name in zip(images, names, strict=True):
        if image.signal.shape[:2] != first.signal.shape[:2] or image.camera != first.camera:
            raise InputError(f"band {name}: photo {image.source} differs from {first.source} in "
                             "size or camera; the bands of a multispectral image come from one "
                             "camera that does not move")
    chosen = [strongest_channel(image) for image in images] if channels is None else list(channels)
    scales = [1.0] * len(images) if exposures_s is None else \
        [wanted / _exposure_like(image, first, name)
         for wanted, image, name in zip(exposures_s, images, names, strict=True)]
    pick = list(zip(images, chosen, scales, strict=True))
    exposures = {image.exposure_s for image in images} if exposures_s is None else set(exposures_s)
    return dataclasses.replace(
        first,
        signal=np.stack([image.signal[..., channel] * np.float32(scale)
                         for image, channel, scale in pick], -1),
        variance=np.stack([image.variance[..., channel] * np.float32(scale**2)
                           for image, channel, scale in pick], -1),
        saturated=np.stack([image.saturated[..., channel] for image, channel, _ in pick], -1),
        exposure_s=exposures.pop() if len(exposures) == 1 else None,
        source="; ".join(f"{name}: {image.source}"
                         for name, image in zip(names, images, strict=True)))


def _exposure_like(image: LinearImage, first: LinearImage, name: str) -> float:
    """Exposure time of a band whose signal differs from the first one's by that time alone."""
    if image.exposure_s is None:
        raise InputError(f"band {name}: photo {image.source} states no exposure time, so that it "
                         "cannot be brought to another; give photos that do")
    ours, theirs = (
        " and ".join(f"{name}{'unknown' if value is None else f'{value:g}'}" for name, value in
                     (("ISO ", photo.iso), ("f/", photo.f_number))) for photo in (image, first))
    if ours != theirs:
        raise InputError(f"band {name}: photo {image.source} was taken at {ours}, {first.source} "
                         f"at {theirs}; change the exposure time alone from band to band")
    return image.exposure_s


def only_channels(image: LinearImage, channels: Sequence[int] | None) -> LinearImage:
    """The photo with some of its channels, in their order; all where none are named.

    Parameters
    ----------
    image : LinearImage
    channels : sequence of int or None
    """
    if channels is None or list(channels) == list(range(image.signal.shape[2])):
        return image
    chosen = list(channels)
    return dataclasses.replace(image, signal=image.signal[..., chosen],
                               variance=image.variance[..., chosen],
                               saturated=image.saturated[..., chosen])


def bright_channels(image: LinearImage) -> tuple[int, ...]:
    """The channels that see more than ``DARK_CHANNEL`` of what the strongest sees, in order.

    Parameters
    ----------
    image : LinearImage
    """
    bright = _brightest(image)
    return tuple(np.flatnonzero(bright > DARK_CHANNEL * bright.max()).tolist()) \
        or (strongest_channel(image),)


def strongest_channel(image: LinearImage) -> int:
    """The channel that sees most light in the bright parts of the photo.

    Parameters
    ----------
    image : LinearImage
    """
    return int(np.argmax(_brightest(image)))


def _brightest(image: LinearImage) -> np.ndarray:
    """Signal (K,) of each channel in the bright parts of a photo."""
    stride = max(1, int(np.sqrt(image.signal[..., 0].size / 100_000)))
    return np.asarray(np.percentile(image.signal[::stride, ::stride], WELL_EXPOSED_PERCENTILE,
                                    axis=(0, 1)))
