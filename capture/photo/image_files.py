"""Photos in EXR and TIFF read as linear images, those of other formats for a first look."""
from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np

from spectrabox.capture.photo import clipping, noise, processed_photos, stored_images
from spectrabox.radiometry import appearance, files, findings
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind
from spectrabox.radiometry.records.spectra import default_band_names

CLIP_FRACTION = 0.98
HALF_STEP, SINGLE_STEP = 2.0**-11, 2.0**-24     # relative rounding of floats
HALVES = ("half", "float16")
MIN_BANDS = 3
ARRAY = "array"         # the source of what a program holds
# A converted colour space: a pixel lit by at least a share of the brightest, negative beyond its
# noise and by a share of its largest band, in a share of the picture.
BRIGHT_PERCENTILE, LIT, NEGATIVE_SIGMA, NEGATIVE, MIN_NEGATIVE_SHARE = 99.0, 0.05, 5.0, 0.005, 0.002


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
    if stored_images.is_image_file(path):
        stored_images.read_header(path).full_scale()
    else:
        processed_photos.require_no_processed_file(path)


def read_linear_file(path: str | os.PathLike[str]) -> LinearImage:
    """Read a linear EXR or TIFF; 16-bit values are taken as fractions of 65535.

    Bands named R, G, B come in that order, all others as the file has them; alpha and depth are
    dropped. Black and white levels that a TIFF states are applied. Saturated are values from 0.98
    of full scale, or of the white level, in integer files, and of 1 in float files whose values all
    lie up to it; and, in any file, bands from 0.98 of where their bright pixels pile up
    (clipping.py). The variance comes from the picture (noise.py).

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        If the file is missing or damaged, does not hold linear values or integers of a known full
        scale, has fewer than 3 bands, or has NaN pixels.
    """
    header = stored_images.read_header(Path(path))
    developed = any(name.startswith(stored_images.VARIANCE) for name in header.names)
    if not developed:
        header.full_scale()         # what is refused by its header is not decoded
        _require_bands(header)
    values, header = stored_images.stored_values(Path(path), stored_images.LINEAR_BYTES)
    if developed:
        return _developed(values, header)
    signal = _bands(values, header)
    del values      # a photo may fill half of the memory
    if header.levels is None:
        signal *= np.float32(1 / header.full_scale())
        clip, step = _clip_and_step(signal, header.kind)
        return _linear_image(signal, header, np.full(signal.shape[2], clip), step)
    # what is at 0.98 of the white level is clipped, as in a raw
    black_tile, white = header.levels
    black = black_tile.mean(axis=(0, 1))
    clips = (CLIP_FRACTION * white - black) / (white - black)
    stored_images.apply_levels(signal, black_tile, white)
    step = _clip_and_step(signal, header.kind)[1] * header.full_scale() / (white - black).min() \
        if header.kind in stored_images.FULL_SCALE else _clip_and_step(signal, header.kind)[1]
    return _linear_image(signal, header, clips, step)


def _bands(values: np.ndarray, header: stored_images.PictureHeader) -> np.ndarray:
    """The bands (H, W, K) float32 in the order to use them; integers are not scaled."""
    return values[..., header.bands].astype(np.float32)


def _require_bands(header: stored_images.PictureHeader) -> None:
    bands = len(header.bands)
    if bands < MIN_BANDS:
        raise InputError(f"photo {header.path.name} has {bands} band(s) "
                         f"({', '.join(header.names)}); at least {MIN_BANDS} are needed")


def _clip_and_step(signal: np.ndarray, kind: str) -> tuple[float, float]:
    """The clip point of values of a type, which are fractions by now, and one step of them."""
    if kind in stored_images.FULL_SCALE:
        return CLIP_FRACTION, 1 / stored_images.FULL_SCALE[kind]
    step = HALF_STEP if kind in HALVES else SINGLE_STEP
    return (CLIP_FRACTION if signal.max() <= 1 else np.inf), step * float(np.abs(signal).max())


def _clipped_and_noise(signal: np.ndarray, clips: np.ndarray, quantum: float, name: str,
                       piles: bool = True
                       ) -> tuple[np.ndarray, np.ndarray, tuple[findings.Finding, ...]]:
    """Which pixels (H, W, K) are saturated, above a clip point (K,) or where a band piles up below
    it, their variance, as they tell it themselves, and what is found of bands that are rolled off.
    """
    saturated = signal >= clips.astype(np.float32)
    found = clipping.clip_levels(signal, quantum, name, saturated) if piles else []
    for band, clip in enumerate(found):
        if clip is not None:
            saturated[..., band] |= signal[..., band] >= CLIP_FRACTION * clip.level
    variance = noise.variance_of(signal, *noise.photon_transfer(signal, saturated, quantum, name))
    for array in (signal, saturated, variance):
        array.flags.writeable = False  # the record then keeps them without a copy
    return saturated, variance, clipping.rolled_off(found)


def converted_colours(signal: np.ndarray, variance: np.ndarray) -> tuple[findings.Finding, ...]:
    """Pixels that are negative in a band beyond their noise while others of their bands see light:
    no sensor does that, a matrix to another colour space does.

    Parameters
    ----------
    signal, variance : (H, W, K) arrays
    """
    stride = max(1, int(np.sqrt(signal[..., 0].size / 250_000)))
    shown, noise = signal[::stride, ::stride], variance[::stride, ::stride]
    largest = shown.max(axis=2)
    bright = float(np.percentile(largest, BRIGHT_PERCENTILE))
    seen = largest > LIT * bright
    negative = seen[..., None] & (shown < -NEGATIVE_SIGMA * np.sqrt(noise)) \
        & (shown < -NEGATIVE * largest[..., None])
    shares = negative.mean(axis=(0, 1))
    if shares.max() < MIN_NEGATIVE_SHARE:
        return ()
    band = int(shares.argmax())
    return (findings.Finding("file.converted-colours", findings.Severity.WARN, values={
        "band": default_band_names(shares.size)[band], "share": float(shares[band]),
        "lowest": float(np.percentile(shown[..., band][negative[..., band]], 1) / bright)}),)


def _linear_image(signal: np.ndarray, header: stored_images.PictureHeader, clips: np.ndarray,
                  quantum: float, kind: PhotoKind = PhotoKind.LINEAR_FILE) -> LinearImage:
    """A photo whose noise and saturation its own pixels tell."""
    stored_images.require_finite(header.path.name, signal)
    linear = kind is PhotoKind.LINEAR_FILE
    saturated, variance, soft = _clipped_and_noise(signal, clips, quantum, header.path.name, linear)
    findings = (*header.findings, *soft, *converted_colours(signal, variance)) if linear else ()
    return LinearImage(
        signal=signal, variance=variance, saturated=saturated, sensor_step=1.0,
        exposure_s=header.positive("ExposureTime"),
        iso=header.positive("Exif:PhotographicSensitivity")
        or header.positive("Exif:ISOSpeedRatings"), f_number=header.positive("FNumber"),
        kind=kind, camera=header.camera, source=header.path.name,
        sha256=files.sha256_of(header.path), findings=findings)


def _developed(values: np.ndarray, header: stored_images.PictureHeader) -> LinearImage:
    """A photo that ``write_linear_exr`` wrote, its variance and saturation as stated there."""
    bands = [header.names[index] for index in header.bands]
    missing = [
        prefix + band for prefix in (stored_images.VARIANCE, stored_images.SATURATED)
        for band in bands if prefix + band not in header.names
    ]
    if missing:
        raise InputError(f"developed photo {header.path.name} lacks the channels "
                         f"{', '.join(missing)}; develop it again")
    signal, variance, saturated = (np.ascontiguousarray(
        values[..., [header.names.index(prefix + band) for band in bands]],
        dtype=np.float32) for prefix in ("", stored_images.VARIANCE, stored_images.SATURATED))
    stored_images.require_finite(header.path.name, signal)
    bad = np.count_nonzero(~((variance >= 0) & (variance <= stored_images.MAX_SIGNAL**2)))
    if bad:
        raise InputError(f"developed photo {header.path.name} states a variance that is negative, "
                         f"NaN or too large at {bad} of {variance.size} values; develop it again")
    return LinearImage(
        signal=signal, variance=variance, saturated=saturated > 0.5,
        sensor_step=header.spec.get_float_attribute("spectrabox:sensor_step", 1.0),
        exposure_s=header.positive("ExposureTime"),
        iso=header.positive("Exif:PhotographicSensitivity"), f_number=header.positive("FNumber"),
        kind=header.photo_kind,
        camera=header.words("spectrabox:camera"),
        source=header.words("spectrabox:source") or header.path.name,
        sha256=files.sha256_of(header.path))


def image_of_array(values: np.ndarray) -> LinearImage:
    """Linear values that a program holds as a photo; saturation and noise as of a file of them.

    Parameters
    ----------
    values : (H, W, K) array
        Floats, or 16-bit integers, which are taken as fractions of 65535.

    Raises
    ------
    InputError
        If they are of other types or of fewer than 3 bands, or some are NaN.
    """
    if values.ndim != 3 or values.shape[2] < MIN_BANDS or not values.size:
        raise InputError(f"an array of shape {values.shape} is no photo; give (height, width, "
                         f"bands) with at least {MIN_BANDS} bands")
    kind = values.dtype.name
    if kind == "uint8":
        raise InputError("an array of 8-bit values is hardly proportional to light; decode it "
                         "first (of sRGB: colour.cctf_decoding(values / 255)), or divide values "
                         "that are proportional by 255")
    if kind not in stored_images.FULL_SCALE and values.dtype.kind != "f":
        raise InputError(f"an array of {kind} values has no known full scale; divide it by what "
                         "the sensor can hold")
    scale = stored_images.FULL_SCALE.get(kind, 1)
    signal = (values / np.float32(scale)).astype(np.float32)
    stored_images.require_finite(ARRAY, signal)
    clip, step = _clip_and_step(signal, kind)
    saturated, variance, soft = _clipped_and_noise(signal, np.full(signal.shape[2], clip), step,
                                                   ARRAY)
    return LinearImage(signal=signal, variance=variance, saturated=saturated, sensor_step=1.0,
                       exposure_s=None, iso=None, f_number=None, kind=PhotoKind.LINEAR_FILE,
                       camera="", source=ARRAY, sha256=hashlib.sha256(signal.tobytes()).hexdigest(),
                       findings=(*soft, *converted_colours(signal, variance)))


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
    encoded, header = _encoded(Path(path))
    return _linear_image(appearance.decode_srgb(encoded).astype(np.float32), header,
                         clips=np.full(encoded.shape[2], CLIP_FRACTION),
                         quantum=1 / stored_images.FULL_SCALE.get(header.kind, 1) / 12.92,
                         kind=PhotoKind.PROCESSED)


def read_encoded_values(path: str | os.PathLike[str]) -> np.ndarray:
    """Code values (H, W, 3), 0 to 1, of a JPEG, PNG or TIFF in R, G and B.

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        If the file is missing or damaged, or has other than 3 bands.
    """
    encoded, header = _encoded(Path(path))
    if encoded.shape[2] != 3:
        raise InputError(f"picture {header.path.name} has {encoded.shape[2]} bands; sRGB has R, G "
                         "and B")
    stored_images.require_finite(header.path.name, encoded)
    return encoded


def _encoded(path: Path) -> tuple[np.ndarray, stored_images.PictureHeader]:
    _require_bands(stored_images.read_header(path))
    values, header = stored_images.stored_values(path, stored_images.ENCODED_BYTES)
    scale = stored_images.FULL_SCALE.get(header.kind, 1)
    return np.clip(_bands(values, header) / np.float32(scale), 0, 1), header
