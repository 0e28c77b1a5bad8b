"""Linear images in EXR and TIFF, in and out, and pictures as PNG (OpenImageIO).

Camera raws do not pass here: this library opens a DNG as a grey TIFF.
"""
from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from spectrabox.capture.photo.noise import photon_transfer
from spectrabox.radiometry.appearance import decode_srgb
from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.files import require_utf8_name, sha256_of, whole_file
from spectrabox.radiometry.records import LinearImage, PhotoKind
from spectrabox.radiometry.system.words import reason_of

# Not of TIFF: those may begin a camera raw.
PICTURE_STARTS = (b"\x76\x2f\x31\x01", b"\x89PNG", b"\xff\xd8\xff")
TIFF_STARTS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
PNG_END = b"IEND\xaeB`\x82"
IMAGE_SUFFIXES = (".exr", ".tif", ".tiff", ".png", ".jpg", ".jpeg")
LINEAR_FORMATS = ("openexr", "tiff")
FULL_SCALE = {"uint8": 255, "uint16": 65535}  # of integer files
FLOATS = ("half", "float", "double")          # hold the signal itself
CLIP_FRACTION = 0.98
NOT_BANDS = ("A", "ALPHA", "Z", "DEPTH")
VARIANCE, SATURATED = "variance.", "saturated."  # channels of a developed photo, of each band
MAX_PICTURE_BYTES = 4_000_000_000   # of a picture that is held whole
MAX_SIGNAL = 1e9                    # its square is a variance, which single precision must hold
NO_DATE = "0000:00:00 00:00:00"     # unknown, as EXIF has it: the same image is the same file


# By the first bytes, and those from the ninth on where the kind of a container stands there.
PROCESSED_STARTS = {b"GIF8": "a GIF", b"8BPS": "a Photoshop document", b"%PDF": "a PDF",
                    b"BM": "a BMP"}
PROCESSED_CONTAINERS = {b"WEBP": "a WebP", b"avif": "an AVIF", b"avis": "an AVIF",
                        **dict.fromkeys((b"heic", b"heix", b"hevc", b"mif1", b"msf1"), "a HEIC")}
RAW_INSTEAD = ("give the camera's raw file, or a linear EXR or 16-bit TIFF; on a phone use the RAW "
               "or ProRAW setting (iPhone: Settings > Camera > Formats > Apple ProRAW, then RAW "
               "in the camera; Android: RAW in the Pro or Expert mode of the camera app)")
NOT_LINEAR_GIVES = ("--not-linear of flat and develop, and not_linear of a session, decode it as "
                    "sRGB all the same: good for a first look, but what is measured on it has "
                    "errors that nobody states")


class NotLinearError(InputError):
    """A photo's values are not proportional to light."""


def processed_error(name: str, what: str, decoded: bool) -> NotLinearError:
    """The refusal of a photo that the camera processed.

    Parameters
    ----------
    name : str
        Of its file.
    what : str
        It is: "a JPEG", say.
    decoded : bool
        Whether it can be taken all the same.
    """
    return NotLinearError(f"photo {name} is {what}, processed by the camera: its values are not "
                          f"proportional to light; {RAW_INSTEAD}"
                          + (f". {NOT_LINEAR_GIVES}" if decoded else ""))


def require_no_processed_file(path: Path) -> None:
    """Refuse pictures of formats that hold no linear values and that are not decoded.

    Parameters
    ----------
    path : Path

    Raises
    ------
    NotLinearError
        Of a HEIC, say.
    """
    if not path.is_file():
        return
    with path.open("rb") as file:
        start = file.read(12)
    container = start.startswith(b"RIFF") or start[4:8] == b"ftyp"
    what = PROCESSED_CONTAINERS.get(start[8:12]) if container else \
        next((name for begin, name in PROCESSED_STARTS.items() if start.startswith(begin)), None)
    if what is not None:
        raise processed_error(path.name, what, decoded=False)


def require_linear_file(path: Path) -> None:
    """Refuse, by its header, a photo whose values are not proportional to light.

    Parameters
    ----------
    path : Path

    Raises
    ------
    NotLinearError
    InputError
        If a picture is missing or damaged.
    """
    if is_image_file(path):
        file = _opened(path)
        full_scale(path, file.spec(), file.format_name())
    else:
        require_no_processed_file(path)


def is_image_file(path: Path) -> bool:
    """Whether a file is for this module: by its suffix, else by what it begins with.

    Parameters
    ----------
    path : Path
    """
    if path.suffix.lower() in IMAGE_SUFFIXES:
        return True
    if not path.is_file():
        return False
    return _first_bytes(path).startswith(PICTURE_STARTS)


def _first_bytes(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(8)


def read_linear_file(path: str | os.PathLike[str]) -> LinearImage:
    """Read a linear EXR or TIFF; 16-bit values are taken as fractions of 65535.

    Bands named R, G, B come in that order, all others as the file has them; alpha and depth are
    dropped. Saturated are values from 0.98 of full scale in integer files, and in float files whose
    values all lie up to 1; a float file that goes beyond 1 states no clip point, and nothing is
    marked. The variance comes from the picture (noise.py).

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        If the file is missing or damaged, does not hold linear values or integers of a known full
        scale, has fewer than 3 bands, or has NaN pixels.
    """
    path = Path(path)
    pixels, spec, file_format = _read(path)
    if any(name.startswith(VARIANCE) for name in channel_names(path, spec)):
        return _developed(path, spec)
    scale, kind = full_scale(path, spec, file_format), str(spec.format)
    pixels *= np.float32(1 / scale)
    if scale > 1:
        return _linear_image(path, pixels, spec, clip=CLIP_FRACTION, quantum=1 / scale)
    clip = CLIP_FRACTION if pixels.max() <= 1 else np.inf
    # relative rounding of half and single precision
    step = 2.0**-11 if kind == "half" else 2.0**-24
    return _linear_image(path, pixels, spec, clip=clip, quantum=step * float(np.abs(pixels).max()))


def picture_size(path: str | os.PathLike[str]) -> tuple[int, int]:
    """Width and height of the photo behind a picture, from its header alone.

    Of a developed one, whose pixels are tiles of colour filters, in pixels of the sensor.

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        If it is no picture.
    """
    spec = _opened(Path(path)).spec()
    step = spec.get_float_attribute("spectrabox:sensor_step", 1.0)
    return round(spec.width * step), round(spec.height * step)


def stated_orientation(path: str | os.PathLike[str]) -> int:
    """Orientation of a picture, 1 to 8 as EXIF numbers them; 1 where its header states none.

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        If it is no picture.
    """
    stated = _opened(Path(path)).spec().get_int_attribute("Orientation", 1)
    return stated if 1 <= stated <= 8 else 1


def stated_bands(path: Path) -> tuple[str, ...]:
    """Names of an EXR's bands, capitals, in the order in which they are read; none of other files.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If it is damaged.
    """
    if not path.is_file() or not _first_bytes(path).startswith(PICTURE_STARTS[0]):
        return ()
    names = [name for name in channel_names(path, _opened(path).spec())
             if not name.startswith((VARIANCE, SATURATED))]
    return tuple(names[index].split(".")[-1].upper() for index in band_order(names))


def full_scale(path: Path, spec: oiio.ImageSpec, file_format: str) -> int:
    """What white of the format reads in a file of linear values: 1 for floats.

    Parameters
    ----------
    path : Path
        For the message.
    spec : oiio.ImageSpec
    file_format : str
        As OpenImageIO names it.

    Raises
    ------
    NotLinearError
        If the values are not proportional to light.
    InputError
        If nobody states their full scale.
    """
    kind = str(spec.format)
    tagged_encoded = "srgb" in _words(spec, "oiio:ColorSpace").lower() and kind in FULL_SCALE
    if file_format not in LINEAR_FORMATS or kind == "uint8" or tagged_encoded:
        bits = "an 8-bit" if file_format == "tiff" and kind == "uint8" else "a"
        what = f"{bits} {file_format.upper()}" + (" tagged sRGB" if file_format == "tiff"
                                                   and tagged_encoded else "")
        raise processed_error(path.name, what, decoded=True)
    if kind not in (*FULL_SCALE, *FLOATS):
        raise InputError(f"photo {path.name} holds {kind} values, whose full scale nobody states; "
                         "export it as a linear EXR or a 16-bit TIFF")
    return FULL_SCALE.get(kind, 1)


def read_encoded_file(path: str | os.PathLike[str]) -> LinearImage:
    """A JPEG, PNG or TIFF decoded as sRGB: good for detecting a chart, never for measuring.

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        If the file is missing or damaged, or has fewer than 3 bands.
    """
    path = Path(path)
    pixels, spec, _ = _read(path)
    full_scale = FULL_SCALE.get(str(spec.format), 1)
    encoded = np.clip(pixels / np.float32(full_scale), 0, 1)
    return _linear_image(path, decode_srgb(encoded).astype(np.float32), spec, clip=CLIP_FRACTION,
                         quantum=1 / full_scale / 12.92, kind=PhotoKind.PROCESSED)


def read_plane(path: str | os.PathLike[str]) -> tuple[np.ndarray, float | None, str]:
    """Values (H, W) as stored in a file of one band, its exposure in s and its camera.

    Parameters
    ----------
    path : path
        Such as the mosaic of an industrial camera.

    Raises
    ------
    InputError
        If the file is missing or damaged, has several bands, or holds anything but 8 or 16-bit
        integers.
    """
    path = Path(path)
    stored, spec, _ = _stored(path)
    if stored.shape[2] != 1 or str(spec.format) not in FULL_SCALE:
        raise InputError(f"{path.name} has {stored.shape[2]} bands of {spec.format} values; a "
                         "mosaic is one band of 8 or 16-bit integers: save the raw frame without "
                         "demosaicing")
    make, model = (_words(spec, name) for name in ("Make", "Model"))
    return (np.ascontiguousarray(stored[..., 0]), _positive(spec, "ExposureTime"),
            f"{make} {model}".strip())


def open_channels(path: str | os.PathLike[str]) -> tuple[list[str], int, int,
                                                         Callable[[int, int], np.ndarray]]:
    """Channel names of a picture, its height and width, and a function that reads rows.

    The function takes the first and the last row (exclusive) and gives (rows, W, C).

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        If the file is missing or damaged.
    """
    path = Path(path)
    file = open_as_stored(path) if path.is_file() else None
    if file is None:
        raise InputError(f"picture {path} is missing or no readable image ({reason_of(oiio)}); "
                         "give an EXR")
    spec = file.spec()

    def rows(first: int, last: int) -> np.ndarray:
        top = spec.y
        read = file.read_scanlines(first + top, last + top, 0, 0, spec.nchannels, "float")
        if read is None or file.has_error:
            raise InputError(f"picture {path.name} cannot be read ({reason_of(file)}); save "
                             "it as scan lines")
        return np.asarray(read).reshape(last - first, spec.width, spec.nchannels)

    return channel_names(path, spec), spec.height, spec.width, rows


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
    names = (["R", "G", "B"] if bands == 3
             else [f"band{number:03d}" for number in range(1, bands + 1)])
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


def _developed(path: Path, spec: oiio.ImageSpec) -> LinearImage:
    """A photo that ``write_linear_exr`` wrote, its variance and saturation as stated there."""
    stored, _, _ = _stored(path)
    names = channel_names(path, spec)
    bands = [name for name in names if not name.startswith((VARIANCE, SATURATED))]
    bands = ([band for band in "RGB" if band in bands]
             + [band for band in bands if band not in ("R", "G", "B")])
    missing = [prefix + band for prefix in (VARIANCE, SATURATED) for band in bands if prefix
               + band not in names]
    if missing:
        raise InputError(f"developed photo {path.name} lacks the channels {', '.join(missing)}; "
                         "develop it again")
    signal, variance, saturated = (
        np.ascontiguousarray(stored[..., [names.index(prefix + band) for band in bands]],
                             dtype=np.float32) for prefix in ("", VARIANCE, SATURATED))
    require_finite(path, signal)
    _require_variance(path, variance)
    kind = _words(spec, "spectrabox:kind")
    return LinearImage(
        signal=signal, variance=variance, saturated=saturated > 0.5,
        sensor_step=spec.get_float_attribute("spectrabox:sensor_step", 1.0),
        exposure_s=_positive(spec, "ExposureTime"),
        iso=_positive(spec, "Exif:PhotographicSensitivity"), f_number=_positive(spec, "FNumber"),
        kind=PhotoKind.__members__.get(kind, PhotoKind.LINEAR_FILE),
        camera=_words(spec, "spectrabox:camera"),
        source=_words(spec, "spectrabox:source") or path.name, sha256=sha256_of(path))


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
        spec.attribute("ICCProfile", oiio.TypeDesc(f"uint8[{len(icc_profile)}]"),
                       np.frombuffer(icc_profile, np.uint8))
    _write(Path(path), np.ascontiguousarray(picture, dtype=np.uint16), spec)


def _write_for_screen(path: Path, rgb8: np.ndarray, attributes: Mapping[str, int | str]) -> None:
    spec = oiio.ImageSpec(rgb8.shape[1], rgb8.shape[0], rgb8.shape[2], oiio.UINT8)
    for name, value in attributes.items():
        spec.attribute(name, value)
    _write(path, np.ascontiguousarray(rgb8, dtype=np.uint8), spec)


def _read(path: Path) -> tuple[np.ndarray, oiio.ImageSpec, str]:
    """All bands (H, W, K) float32 as stored, in the order to use them; integers are not scaled."""
    stored, spec, file_format = _stored(path)
    names = channel_names(path, spec)
    pixels = stored[..., band_order(names)].astype(np.float32)
    if pixels.shape[2] < 3:
        raise InputError(f"photo {path.name} has {pixels.shape[2]} band(s) "
                         f"({', '.join(names)}); at least 3 are needed")
    return pixels, spec, file_format


def _opened(path: Path) -> oiio.ImageInput:
    """The file, of which nothing but its header has been read."""
    if not path.is_file():
        raise InputError(f"photo {path} does not exist; correct its name")
    file = open_as_stored(path)
    if file is None:
        raise InputError(f"photo {path.name} is no readable image ({reason_of(oiio)}); "
                         "give a camera raw, or a linear EXR or TIFF")
    return file


def open_as_stored(path: Path) -> oiio.ImageInput | None:
    """A picture's open file; None where it is no EXR, TIFF, PNG or JPEG, or is damaged.

    Parameters
    ----------
    path : Path
    """
    require_utf8_name(path)
    # OpenImageIO would try all its formats, some of which read gigabytes to their end
    if not _first_bytes(path).startswith((*PICTURE_STARTS, *TIFF_STARTS)):
        return None
    as_stored = oiio.ImageSpec()
    # else a TIFF's bands come multiplied by its alpha
    as_stored.attribute("oiio:UnassociatedAlpha", 1)
    return oiio.ImageInput.open(os.fspath(path), as_stored)


def _stored(path: Path) -> tuple[np.ndarray, oiio.ImageSpec, str]:
    """All channels (H, W, C) in the type and order of the file."""
    file = _opened(path)
    spec = file.spec()
    if spec.image_bytes(True) > MAX_PICTURE_BYTES:
        raise InputError(f"photo {path.name} states {spec.width} x {spec.height} pixels of "
                         f"{spec.nchannels} channels, {spec.image_bytes(True) / 1e9:.0f} GB; "
                         f"{MAX_PICTURE_BYTES / 1e9:.0f} GB is the limit")
    # in the type of the file: asking for floats would scale integers
    stored = file.read_image("unknown")
    failed, trouble = file.has_error, reason_of(file)
    file.close()
    if stored is None or failed:
        raise InputError(f"photo {path.name} cannot be read to its end ({trouble}); copy or "
                         "export it again")
    return stored, spec, file.format_name()


def band_order(names: Sequence[str]) -> list[int]:
    """Indices of the bands to use, R, G and B first; alpha and depth are left out.

    Parameters
    ----------
    names : sequence of str
        Of the channels.
    """
    plain = [name.split(".")[-1].upper() for name in names]
    bands = [index for index, name in enumerate(plain) if name not in NOT_BANDS]
    if not {"R", "G", "B"} <= set(plain):
        return bands
    named = [plain.index(name) for name in "RGB"]
    return named + [index for index in bands if index not in named]


def _linear_image(path: Path, signal: np.ndarray, spec: oiio.ImageSpec, clip: float,
                  quantum: float, kind: PhotoKind = PhotoKind.LINEAR_FILE) -> LinearImage:
    require_finite(path, signal)
    saturated = signal >= clip
    variance = photon_transfer(signal, saturated, quantum, path.name).variance(signal)
    for array in (signal, saturated, variance):
        array.flags.writeable = False  # the record then keeps them without a copy
    make, model = (_words(spec, name) for name in ("Make", "Model"))
    return LinearImage(
        signal=signal, variance=variance, saturated=saturated, sensor_step=1.0,
        exposure_s=_positive(spec, "ExposureTime"),
        iso=_positive(spec, "Exif:PhotographicSensitivity")
        or _positive(spec, "Exif:ISOSpeedRatings"), f_number=_positive(spec, "FNumber"),
        kind=kind, camera=f"{make} {model}".strip(), source=path.name,
        sha256=sha256_of(path))


def require_finite(path: Path, signal: np.ndarray) -> None:
    """Raise where a signal (H, W, K) holds values that are no numbers, or too large to square.

    Parameters
    ----------
    path : Path
        For the message.
    signal : (H, W, K) array

    Raises
    ------
    InputError
    """
    bad = np.count_nonzero(~np.isfinite(signal))
    if bad:
        raise InputError(f"photo {path.name} has {bad} of {signal.size} values that are NaN or "
                         "infinite; export it again without them, nothing is guessed in their "
                         "place")
    largest = float(np.abs(signal).max(initial=0))
    if largest > MAX_SIGNAL:
        raise InputError(f"photo {path.name} holds values up to {largest:.2g}, beyond "
                         f"{MAX_SIGNAL:.0e}; scale it so that white is near 1")


def _require_variance(path: Path, variance: np.ndarray) -> None:
    bad = np.count_nonzero(~((variance >= 0) & (variance <= MAX_SIGNAL**2)))
    if bad:
        raise InputError(f"developed photo {path.name} states a variance that is negative, NaN or "
                         f"too large at {bad} of {variance.size} values; develop it again")


def channel_names(path: Path, spec: oiio.ImageSpec) -> list[str]:
    """Names of a picture's channels.

    Parameters
    ----------
    path : Path
        For the message.
    spec : oiio.ImageSpec

    Raises
    ------
    InputError
        If they are no text.
    """
    try:
        return list(spec.channelnames)
    except UnicodeDecodeError:
        raise InputError(f"photo {path.name} has channels whose names are no text; export it "
                         "again") from None


def _words(spec: oiio.ImageSpec, name: str) -> str:
    try:
        text: str = spec.get_string_attribute(name)
    except UnicodeDecodeError:      # a name of a camera in another alphabet decides nothing
        return ""
    return text


def _positive(spec: oiio.ImageSpec, name: str) -> float | None:
    value = spec.get_float_attribute(name, 0.0)
    return value if value > 0 else None


def _write(path: Path, pixels: np.ndarray, spec: oiio.ImageSpec) -> None:
    require_utf8_name(path)
    with whole_file(path) as unfinished:
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


def unwritten(path: Path, writer: Any) -> EnvironmentProblem:
    """The error for a picture that cannot be written, with the writer's reason."""
    return EnvironmentProblem(f"{path} cannot be written ({reason_of(writer)}); is the disk full?")
