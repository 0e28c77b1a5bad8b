"""Multispectral capture: photos of one scene, each behind its own filter or under its own light, as one image."""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from radiometry.errors import InputError
from radiometry.records import LinearImage

WELL_EXPOSED_PERCENTILE = 99.0


def stack_bands(images: Sequence[LinearImage], names: Sequence[str], channels: Sequence[int] | None = None,
                exposures_s: Sequence[float] | None = None) -> LinearImage:
    """One image of K bands, in the order of the photos.

    Parameters
    ----------
    images :                   one linear photo per band, of one camera in one place
    names : (K,)               what makes each band: "450 nm", "blue LED"
    channels : (K,)            which channel of each photo to take; None for the one that sees most light
    exposures_s : (K,)         exposure to bring each band to; None leaves each at its own, which a calibration takes up
                               as a gain of the band, provided it is the same for all scenes

    Raises
    ------
    InputError
        If the photos differ in size or camera, or their number is not that of the names.
    """
    if len(images) != len(names) or not images:
        raise InputError(f"{len(images)} photos and {len(names)} band names were given; one name per photo is needed")
    first = images[0]
    for image, name in zip(images, names, strict=True):
        if image.signal.shape[:2] != first.signal.shape[:2] or image.camera != first.camera:
            raise InputError(f"band {name}: photo {image.source} differs from {first.source} in size or camera; the "
                             f"bands "
                             "of a multispectral image come from one camera that does not move")
    chosen = [strongest_channel(image) for image in images] if channels is None else list(channels)
    scales = [1.0] * len(images)
    if exposures_s is not None:
        scales = [wanted / image.exposure_s if image.exposure_s else 1.0
                  for wanted, image in zip(exposures_s, images, strict=True)]
    pick = list(zip(images, chosen, scales, strict=True))
    exposures = {image.exposure_s for image in images}
    return dataclasses.replace(
        first, signal=np.stack([image.signal[..., channel] * np.float32(scale) for image, channel, scale in pick], -1),
        variance=np.stack([image.variance[..., channel] * np.float32(scale**2) for image, channel, scale in pick], -1),
        saturated=np.stack([image.saturated[..., channel] for image, channel, _ in pick], -1),
        exposure_s=exposures.pop() if len(exposures) == 1 else None,
        source="; ".join(f"{name}: {image.source}" for name, image in zip(names, images, strict=True)))


def strongest_channel(image: LinearImage) -> int:
    """The channel that sees most light in the bright parts of the photo."""
    stride = max(1, int(np.sqrt(image.signal[..., 0].size / 100_000)))
    return int(np.argmax(np.percentile(image.signal[::stride, ::stride], WELL_EXPOSED_PERCENTILE, axis=(0, 1))))
