"""Pictures written: EXR, PNG, JPEG and TIFF, each whole or not at all (OpenImageIO)."""
from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from spectrabox.capture.photo.stored_images import SATURATED, VARIANCE
from spectrabox.radiometry import errors, files, profile_files
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.radiometry.system.words import reason_of

PNG_END = b"IEND\xaeB`\x82"
NO_DATE = "0000:00:00 00:00:00"     # unknown, as EXIF has it: the same image is the same file


def write_linear_exr(path: str | os.PathLike[str], image: LinearImage,
                     orientation: int = 1) -> None:
    """Write a linear image with its variance and saturation; ``read_linear_file`` gives it back.

    Parameters
    ----------
    path : path
    image : LinearImage
        As the sensor read it.
    orientation : int
        1 to 8, as EXIF numbers them: how it is to be turned to stand upright.

    Raises
    ------
    EnvironmentProblem
        If the file cannot be written.
    """
    bands = image.signal.shape[2]
    names = ["R", "G", "B"]
    if bands != 3:
        names = [f"band{number:03d}" for number in range(1, bands + 1)]
    pixels = np.concatenate([image.signal, image.variance, image.saturated.astype(np.float32)],
                            axis=2)
    channels = [prefix + name for prefix in ("", VARIANCE, SATURATED) for name in names]
    spec = exr_spec(pixels.shape[0], pixels.shape[1], channels, oiio.FLOAT,
                    {"spectrabox:kind": image.kind.name, "spectrabox:camera": image.camera,
                     "spectrabox:source": image.source})
    for name, value in (("ExposureTime", image.exposure_s),
                        ("Exif:PhotographicSensitivity", image.iso),
                        ("FNumber", image.f_number), ("spectrabox:sensor_step", image.sensor_step)):
        if value is not None:
            spec.attribute(name, float(value))
    spec.attribute("Orientation", orientation)
    _write(Path(path), np.ascontiguousarray(pixels, dtype=np.float32), spec)


def write_exr(path: str | os.PathLike[str], image: np.ndarray, channel_names: Sequence[str],
              exposure_s: float | None = None,
              attributes: Mapping[str, str] | None = None) -> None:
    """Write an image (H, W, C) as float EXR with named channels, whole or not at all.

    Parameters
    ----------
    path : path
    image : (H, W, C) array
    channel_names : sequence of C str
    exposure_s : float or None
        Stated in the file where given.
    attributes : dict, optional
        Words of its header.

    Raises
    ------
    EnvironmentProblem
        If the file cannot be written.
    """
    if image.ndim != 3 or image.shape[2] != len(channel_names):
        raise ValueError(f"image of shape {image.shape} and {len(channel_names)} channel names do "
                         "not fit")
    spec = exr_spec(image.shape[0], image.shape[1], channel_names, oiio.FLOAT, attributes)
    if exposure_s is not None:
        spec.attribute("ExposureTime", float(exposure_s))
    _write(Path(path), np.ascontiguousarray(image, dtype=np.float32), spec)


def exr_spec(height: int, width: int, channel_names: Sequence[str], kind: Any,
             attributes: Mapping[str, str] | None = None) -> oiio.ImageSpec:
    """Header of a compressed EXR that is the same file for the same image.

    Parameters
    ----------
    height, width : int
    channel_names : sequence of str
    kind : oiio.FLOAT or oiio.HALF
    attributes : dict, optional
        Words of the header.
    """
    spec = oiio.ImageSpec(width, height, len(channel_names), kind)
    spec.channelnames = tuple(channel_names)
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", NO_DATE)     # OpenImageIO would put the time of writing there
    for name, words in (attributes or {}).items():
        spec.attribute(name, words)
    return spec


def write_png(path: str | os.PathLike[str], rgb8: np.ndarray) -> None:
    """Write a picture (H, W, 3) uint8, already encoded for the screen, as PNG.

    Parameters
    ----------
    path : path
    rgb8 : (H, W, 3) uint8 array

    Raises
    ------
    EnvironmentProblem
        If the file cannot be written.
    """
    # level 4 of 9: a third of the time of 6, 7 % larger
    _write_for_screen(Path(path), rgb8, {"png:compressionLevel": 4})


def write_jpeg(path: str | os.PathLike[str], rgb8: np.ndarray) -> None:
    """Write a picture (H, W, 3) uint8, already encoded for the screen, as JPEG for the eye alone:
    a twentieth of the time and of the size of a PNG.

    Parameters
    ----------
    path : path
    rgb8 : (H, W, 3) uint8 array

    Raises
    ------
    EnvironmentProblem
        If the file cannot be written.
    """
    # 4:4:4: edges of colours stay where they are
    _write_for_screen(Path(path), rgb8, {"Compression": "jpeg:95", "jpeg:subsampling": "4:4:4"})


def write_tiff16(path: str | os.PathLike[str], picture: np.ndarray,
                 icc_profile: bytes | None) -> None:
    """Write a picture (H, W, 3) uint16 as TIFF with the ICC profile that its values are in.

    Parameters
    ----------
    path : path
    picture : (H, W, 3) uint16 array
    icc_profile : bytes or None
        None for L*, a*, b*, encoded as TIFF 6.0 has it, of which the file says so itself.

    Raises
    ------
    EnvironmentProblem
        If the file cannot be written.
    """
    spec = oiio.ImageSpec(picture.shape[1], picture.shape[0], picture.shape[2], oiio.UINT16)
    spec.attribute("compression", "zip")
    if icc_profile is None:
        spec.attribute("oiio:ColorSpace", "CIELab")     # photometric interpretation 8
    else:
        _tag(spec, icc_profile)
    _write(Path(path), np.ascontiguousarray(picture, dtype=np.uint16), spec)


def _write_for_screen(path: Path, rgb8: np.ndarray, attributes: Mapping[str, int | str]) -> None:
    spec = oiio.ImageSpec(rgb8.shape[1], rgb8.shape[0], rgb8.shape[2], oiio.UINT8)
    for name, value in attributes.items():
        spec.attribute(name, value)
    _tag(spec, profile_files.picture_profile(profile_files.SRGB))
    _write(path, np.ascontiguousarray(rgb8, dtype=np.uint8), spec)


def _tag(spec: oiio.ImageSpec, icc_profile: bytes) -> None:
    spec.attribute("ICCProfile", oiio.TypeDesc(f"uint8[{len(icc_profile)}]"),
                   np.frombuffer(icc_profile, np.uint8))


def _write(path: Path, pixels: np.ndarray, spec: oiio.ImageSpec) -> None:
    files.require_utf8_name(path)
    with files.whole_file(path) as unfinished:
        file = oiio.ImageOutput.create(os.fspath(unfinished))
        if file is None or not file.open(os.fspath(unfinished), spec):
            raise unwritten(path, file or oiio)
        if not (file.write_image(pixels) and file.close() and ends_whole(unfinished)):
            raise unwritten(path, file)


def ends_whole(path: Path) -> bool:
    """Whether a written picture has its end: OpenImageIO does not say that a full disk cut a PNG.

    Parameters
    ----------
    path : Path
    """
    if path.suffix.lower() != ".png":
        return True
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - len(PNG_END), 0))
        return file.read() == PNG_END


def unwritten(path: Path, writer: Any) -> errors.EnvironmentProblem:
    """The error for a picture that cannot be written, with the writer's reason."""
    return errors.EnvironmentProblem(
        f"{path} cannot be written ({reason_of(writer)}); is the disk full?")
