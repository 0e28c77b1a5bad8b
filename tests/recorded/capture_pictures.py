"""Small pictures without symmetry, for recorded tests: no two bands, sides or settings alike."""
import dataclasses
import hashlib
from fractions import Fraction

import numpy as np

from spectrabox.fixtures.dng import PATTERNS, write_dng
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.records import LinearImage, PhotoKind, RawFrame

BLACK = (61.25, 63.5, 64.75, 66.0)
SETTINGS = {"exposure_s": Fraction(1, 60), "f_number": 5.6, "iso": 250, "make": "Maker",
            "model": "Seven", "serial": "A417"}
EXPOSURE = {"exposure_s": 1 / 60, "iso": 250.0, "f_number": 5.6, "camera": "Maker Seven A417",
            "file": "a.dng", "sha256": "ab"}


def scene(height, width, bands=3, top=0.85):
    """Linear signal (H, W, K) that changes in both directions, differently in each band."""
    y, x = np.mgrid[0:height, 0:width]
    v, u = y / height, x / width
    return np.stack([top * (0.9 - 0.13 * band) * (0.04 + (0.3 + 0.1 * band) * u + 0.5 * v**1.5
                                                  + 0.1 * np.sin(5 * u + band))
                     for band in range(bands)], axis=-1).clip(0.002, 1.3)


def counts(height, width, tile, black=BLACK, white=4095, seed=1, electrons=9000.0, top=0.85,
           read_dn=2.5):
    """A mosaic (H, W) uint16 of the scene with shot and read noise."""
    rng = np.random.default_rng(seed)
    signal = scene(height, width, 3, top)
    side = max(round(len(tile) ** 0.5), 1)
    y, x = np.mgrid[0:height, 0:width]
    band = np.array(tile or (1,)).reshape(side, side)[y % side, x % side]
    level = np.resize(np.array(black, float), (2, 2))[y % 2, x % 2] if side == 2 else black[0]
    lit = np.take_along_axis(signal, band[..., None], axis=2)[..., 0]
    collected = rng.poisson(lit * electrons)
    dn = level + (white - level) / electrons * collected + rng.normal(scale=read_dn, size=lit.shape)
    return np.clip(np.rint(dn), 0, white).astype(np.uint16)


def raw_frame(height=96, width=128, pattern="GRBG", white=4095.0, **options):
    """The same as a frame, without a file."""
    tile = PATTERNS[pattern]
    side = max(round(len(tile) ** 0.5), 1)
    black = np.array(BLACK).reshape(2, 2) if side == 2 else np.full((side, side), BLACK[0])
    facts = {key: options.pop(key) for key in list(options) if key in EXPOSURE}
    return RawFrame(counts(height, width, tile, white=white, **options),
                    np.array(tile or (0,)).reshape(side, side), black, white,
                    **{**EXPOSURE, **facts})


def dng(path, pattern="GRBG", height=96, width=128, **options):
    """A DNG of the scene; ``three`` writes pixels of every colour, ``hot`` so many that stand out.
    """
    hot = options.pop("hot", 0)
    if options.pop("three", False):
        rng = np.random.default_rng(3)
        signal = scene(height, width) + 0.004 * rng.standard_normal((height, width, 3))
        pixels = np.clip(np.rint(60 + 4000 * signal), 0, 4095).astype(np.uint16)
    else:
        pixels = counts(height, width, PATTERNS[pattern], black=options.get("black", BLACK),
                        seed=options.pop("seed", 1), top=options.pop("top", 0.85))
        if areas := options.get("masked_areas"):
            cover = (slice(areas[0], areas[2]), slice(areas[1], areas[3]))
            y, x = np.indices(pixels.shape)
            dark = np.reshape(BLACK, (2, 2))[y % 2, x % 2] + 1.5
            dark += 2 * np.random.default_rng(9).standard_normal(pixels.shape)
            pixels[cover] = np.rint(dark)[cover]
    pixels[7, 5:5 + 6 * hot:6] = 3000
    write_dng(path, pixels, **{"pattern": pattern, "white": 4095, "bits": 12, "black": BLACK,
                               **SETTINGS, **options})
    return path


def picture(height=60, width=90, bands=3, seed=4, noise=0.003, top=0.85, **facts):
    """A linear image with noise that grows with the signal, a saturated corner and dark parts."""
    rng = np.random.default_rng(seed)
    signal = scene(height, width, bands, top)
    variance = noise**2 * (0.4 + 3 * signal) * (1 + 0.2 * np.arange(bands))
    signal = signal + np.sqrt(variance) * rng.standard_normal(signal.shape)
    saturated = signal > 0.8
    settings = {"sensor_step": 2.0, "exposure_s": 0.02, "iso": 250.0, "f_number": 5.6,
                "kind": PhotoKind.RAW, "camera": "Maker Seven A417", "source": "a.dng",
                "sha256": "ab"} | facts
    return LinearImage(signal.astype(np.float32), variance.astype(np.float32), saturated,
                       **settings)


def changed(record, **fields):
    return dataclasses.replace(record, **fields)


def outcome(of):
    """What a function gives, or its refusal in words."""
    try:
        return of()
    except (SpectraboxError, ValueError, OverflowError) as error:
        code = getattr(error, "exit_code", None)
        return f"{type(error).__name__} {code}: {error}"


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
