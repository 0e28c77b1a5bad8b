"""Photos, dark frames, a flat field and a bracket to one linear image (``spectrabox develop``)."""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spectrabox.capture.develop.bands import only_channels
from spectrabox.capture.develop.bracket import merge_exposures
from spectrabox.capture.develop.dark import DarkFrame, common_variance, mean_dark, subtract_dark
from spectrabox.capture.develop.flat_field import divide_by_flat
from spectrabox.capture.photo.image_files import read_encoded_file
from spectrabox.capture.photo.linear import open_photo
from spectrabox.capture.photo.orientation import AS_READ, turned
from spectrabox.capture.photo.processed_photos import NotLinearError
from spectrabox.capture.photo.raw import read_raw
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind, RawFrame

NOT_LINEAR = "NOT LINEAR: decoded as sRGB, colour matrix and tone curve remain"


def develop_photos(photos: Sequence[Path], darks: Sequence[Path], flat: Path | None,
                   not_linear: bool = False, channels: Sequence[int] | None = None,
                   orientation: int = AS_READ) -> tuple[LinearImage, tuple[Finding, ...]]:
    """One linear image from photos of one scene, and what was found of dark frames and exposures.

    Dark frames are averaged by exposure and subtracted from the photos of theirs; photos of several
    exposures are merged; the flat is divided out last.

    Parameters
    ----------
    photos, darks : sequences of Path
        Raw files where dark frames are given, else any photos.
    flat : Path or None
        Photo of a white card in the same position.
    not_linear : bool
        As in ``open_any``.
    channels : sequence of int, optional
        Of the photos, those that the result has: a flat may be too dark in others. All by default.
    orientation : int
        1 to 8, as EXIF numbers them: how the result is turned, whatever the files state. By default
        it is as the sensor read it.

    Raises
    ------
    InputError
        If a file cannot be used, or a photo lacks a dark frame of its exposure while others have
        one.
    CheckError
        If exposures disagree, or the dark frame or the flat is not fit for use.
    """
    by_exposure: dict[float | None, list[RawFrame]] = {}
    for path in darks:
        frame = read_raw(path)
        by_exposure.setdefault(frame.exposure_s, []).append(frame)
    dark_frames = {exposure: mean_dark(frames) for exposure, frames in by_exposure.items()}
    findings = [Finding("dark.hot-pixels", Severity.INFO, dark.source,
                        {"hot": int(dark.hot.sum())}) for dark in dark_frames.values()]
    images = [] if darks else [open_any(path, not_linear) for path in photos]
    sharing: dict[str, list[tuple[RawFrame, DarkFrame]]] = {}
    for path in photos if darks else ():
        frame = read_raw(path)
        only = next(iter(dark_frames.values())) if len(dark_frames) == 1 else None
        # a wrong exposure is refused by name below
        dark = dark_frames.get(frame.exposure_s) or only
        if dark is None:
            raise InputError(f"photo {path.name} was exposed for {frame.exposure_s} s and no dark "
                             "frame was; take one at each exposure of the bracket")
        sharing.setdefault(dark.source, []).append((frame, dark))
    for pairs in sharing.values():
        mean, ratios = merge_exposures([subtract_dark(frame, dark) for frame, dark in pairs])
        # the dark frame's own noise, which no number of photos averages away
        left = (1 - 1 / len(pairs)) * common_variance(*pairs[0])
        images.append(dataclasses.replace(mean, variance=mean.variance + left.astype(np.float32)))
        findings += ratios
    merged, ratios = merge_exposures(images)
    merged = only_channels(merged, channels)
    if flat is not None:
        merged = divide_by_flat(merged, only_channels(open_any(flat, not_linear), channels))
    if any(image.kind is PhotoKind.PROCESSED for image in images):
        findings.append(Finding("photo.not-linear", Severity.WARN))
    return turned(merged, orientation), (*findings, *ratios)


def open_any(path: Path, not_linear: bool = False) -> LinearImage:
    """As ``open_photo``, and where allowed also files that are not linear, marked as such.

    Parameters
    ----------
    path : Path
    not_linear : bool
        Whether to take JPEG, PNG and 8-bit files too, decoded as sRGB.

    Raises
    ------
    InputError
    """
    try:
        return open_photo(path)
    except NotLinearError:
        if not not_linear:
            raise
    image = read_encoded_file(path)
    return dataclasses.replace(image, source=f"{image.source} ({NOT_LINEAR})")
