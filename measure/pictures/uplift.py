"""The spectra behind the pixels of an image relative to white: mean and standard deviation.

What is in memory does not grow with the image's height, where it is read and its spectra are used
some rows at a time.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spectrabox.capture.photo.image_rows import rows_of_array
from spectrabox.measure.pictures import pixel_spectra
from spectrabox.measure.signals.options import PIXEL_NOISE
from spectrabox.radiometry import appearance, error_model, errors, findings, grid
from spectrabox.radiometry.system import strips
from spectrabox.sampling.prior import mixture, mixture_posterior, uplift_table
from spectrabox.sampling.spectral_measurement import check_bands

MAX_COLOUR_ERROR = 0.5      # CIEDE2000: up to here a spectrum has the colour of its pixel
MAX_TABLE_ERROR = 1.0       # CIEDE2000 between spectra of the table and those computed one by one
CHECKED = 200               # signals by which a table is judged
CHECK_LIGHTS = ("D65", "A")
STEPS = 12                  # of Newton's method, at most
FOUND = 1e-7                # of white: a signal that is met
LOGIT_STEP = 2.0            # at most, at once
MAX_NOISE = 0.5     # relative: beyond, a signal says next to nothing


class PixelSpectra(tuple[np.ndarray, np.ndarray]):
    """The reflectance behind every pixel of an image (H, W), at 400, 405 ... 700 nm; as a tuple
    (mean, standard deviation).

    Attributes
    ----------
    mean : (H, W, P) array
        Single floats.
    standard_deviation : (H, W, P) array
        Likewise.
    delta_e00 : (H, W) array
        CIEDE2000 under D65 between the colour of the mean and that of the pixel. Of an image in
        sRGB the latter is known; of a camera's it is the colour of the mean and of what this leaves
        of the signal, by the linear estimate. Large where no reflectance that is known to occur has
        the signal.

    References
    ----------
    That of `uplift`.

    Examples
    --------
    >>> import numpy as np
    >>> pixels = sb.uplift(np.full((2, 2, 3), 0.5), encoded=True)
    >>> pixels.mean.shape, pixels.delta_e00.shape
    ((2, 2, 61), (2, 2))
    """

    mean: np.ndarray
    standard_deviation: np.ndarray
    delta_e00: np.ndarray

    def __new__(cls, mean: np.ndarray, standard_deviation: np.ndarray,
                delta_e00: np.ndarray) -> PixelSpectra:
        self = super().__new__(cls, (mean, standard_deviation))
        self.mean, self.standard_deviation, self.delta_e00 = mean, standard_deviation, delta_e00
        return self

    def __getnewargs__(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.mean, self.standard_deviation, self.delta_e00


@dataclass(frozen=True)
class ImageSource:
    """An image of signals under one light, each band with its own independent relative error."""

    size: tuple[int, int, int]      # height, width and number of bands
    read: strips.ReadRows           # signals of rows
    white: np.ndarray               # (K,)
    relative_response: np.ndarray   # (K, 61), rows summing to 1
    prior: mixture.LogitMixture
    noise: float                    # relative standard error of every band
    table_side: int

    error_levels = 1

    def __post_init__(self) -> None:
        if not 0 <= self.noise < MAX_NOISE:
            raise errors.InputError(
                f"the noise of a pixel, {self.noise:g}, is relative to its signal: 0 "
                f"to {MAX_NOISE:g} is needed, and 0.01 is 1 %")
        if self.white.shape != (len(self.relative_response),):
            raise errors.InputError(f"white of shape {self.white.shape} was given for "
                             f"{len(self.relative_response)} bands; give what a perfect white "
                             "reads in each")
        if not np.all(self.white > 0):
            raise errors.InputError(
                f"the white {self.white.tolist()} is not positive in every band; give "
                "what a perfect white reads")

    @property
    def responses(self) -> np.ndarray:
        """Relative response (1, K, 61)."""
        return self.relative_response[None]

    def block(self, first: int, last: int) -> pixel_spectra.PixelBlock:
        """The pixels of rows ``first`` to ``last``."""
        signals = self.read(first, last) / self.white
        return pixel_spectra.PixelBlock(signals.reshape(-1, self.size[2]), None, None)

    def table_errors(self, light: int, signals: np.ndarray) -> list[error_model.Errors]:
        """Errors of signals (n, K)."""
        return [uplift_table.relative_errors(signals, self.noise)]

    def direct(self, block: pixel_spectra.PixelBlock) -> uplift_table.Uplifted:
        """Spectra of a block, each pixel by itself."""
        signals = np.clip(block.signals, 0, 1).astype(float)
        return uplift_table.uplift_signals(self.prior, self.relative_response, signals,
                              uplift_table.relative_errors(signals, self.noise))


def uplift_image(image: np.ndarray, relative_response: np.ndarray, prior: mixture.LogitMixture,
                 noise: float = PIXEL_NOISE, *, white: np.ndarray | None = None,
                 side: int = uplift_table.SIDE, encoded: bool = False,
                 progress: uplift_table.Progress = lambda share: None,
                 map_parts: uplift_table.MapParts = map) -> PixelSpectra:
    """The spectrum behind every pixel of an image in memory.

    Parameters
    ----------
    image : (H, W, K) array
        Linear signal.
    relative_response : (K, 61) array
        Of the bands under the light, on the prior's wavelengths; rows sum to 1.
    prior : LogitMixture
    noise : float
        Relative standard error of every band.
    white : (K,) array, optional
        Signal of a perfect white; 1 by default.
    side : int
        Points of the table along each axis, odd and at least 3.
    encoded : bool
        Whether the signals are colours under D65, which the mean then has.
    progress : function of the share of the table that is done
    map_parts : function of (function, iterable), optional
        As of ``spectra_tables``.

    Returns
    -------
    PixelSpectra
        Mean (H, W, 61) and standard deviation (H, W, 61); signals outside 0 to 1 are taken at the
        edge.

    Raises
    ------
    InputError
        If image and response have other bands, or for a side without a grey.
    """
    height, width, bands = image.shape
    require_bands(bands, relative_response)
    require_side(side)
    source = ImageSource(
        *rows_of_array(image),
        np.ones(bands, np.float32) if white is None else white.astype(np.float32),
        relative_response, prior, noise, side)
    blocks = pixel_spectra.row_blocks(height, width)
    points, sample, _, above = pixel_spectra.survey(source)
    pixel_spectra.require_below_white(above, height * width,
                                      "Give what a perfect white reads (white=)")
    layout = pixel_spectra.PictureLayout(5, full=True)
    tables = pixel_spectra.spectra_tables(source, layout, points, sample, progress, map_parts)
    made = of_colours(source, layout, tables, encoded=encoded)
    parts = zip(*(made(source.block(*rows)) for rows in blocks), strict=True)
    mean, deviation, apart = (np.concatenate(part, dtype=np.float32).reshape(height, width, -1)
                              for part in parts)
    return PixelSpectra(mean, deviation, apart[..., 0])


def of_colours(source: ImageSource, layout: pixel_spectra.PictureLayout,
               tables: pixel_spectra.SpectraTables, *, encoded: bool
               ) -> Callable[[pixel_spectra.PixelBlock],
                             tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """A function from a block of n pixels to their mean (n, P), standard deviation (n, Q) and, as
    of `PixelSpectra`, how far they are from their colours (n, 1).

    Parameters
    ----------
    source : ImageSource
    layout, tables
        As of ``pixel_spectra.block_spectra``.
    encoded : bool
        Whether the signals are colours under D65, which the mean then has.
    """
    nm = layout.nm[0]
    response = source.relative_response @ grid.interpolation_matrix(nm, mixture.PRIOR_GRID.nm)
    if encoded:
        observer, to_colour = response, np.eye(3)
    else:
        observer = _observer(nm)
        covariance = mixture.reflectance_moments(source.prior)[1]
        full = source.relative_response
        to_colour = np.linalg.solve(mixture_posterior.with_floor(full @ covariance @ full.T),
                                    full @ covariance @ _observer(mixture.PRIOR_GRID.nm).T).T

    def made(block: pixel_spectra.PixelBlock) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        mean, deviation, _ = pixel_spectra.block_spectra(source, layout, tables, block)
        if encoded:
            mean = with_colours(mean, block.signals, response)
        left = block.signals - mean @ response.T
        colour = mean @ observer.T
        apart = appearance.ciede2000(
            appearance.lab_from_xyz(colour, np.ones(3)),
            appearance.lab_from_xyz(colour + left @ to_colour.T, np.ones(3)))
        return mean, deviation, apart[:, None]

    return made


def _observer(nm: np.ndarray) -> np.ndarray:
    weights = appearance.tristimulus_weights(nm, "D65")
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def with_colours(mean: np.ndarray, signals: np.ndarray,
                 response: np.ndarray) -> np.ndarray:
    """Spectra (n, P) changed as little as smooth responses allow, in their logits, so that they
    have the colours of their pixels, or are nearer to them where no reflectance has them.

    Parameters
    ----------
    mean : (n, P) array
        Reflectances, 0 to 1.
    signals : (n, 3) array
        X, Y, Z of the pixels over those of white.
    response : (3, P) array
        Of the observer under the light, at the wavelengths of ``mean``; rows sum to 1.
    """
    wanted = appearance.lab_from_xyz(signals.astype(float), np.ones(3))

    def colour_errors(spectra: np.ndarray, some: np.ndarray) -> np.ndarray:
        return np.asarray(appearance.ciede2000(appearance.lab_from_xyz(
            spectra @ response.T, np.ones(3)), wanted[some]))

    result = mean.astype(float)
    errors = colour_errors(result, np.arange(len(result)))
    rows = np.flatnonzero(errors > MAX_COLOUR_ERROR / 4)
    inside = np.clip(result[rows], 1e-6, 1 - 1e-6)
    logits = np.log(inside / (1 - inside))
    products = (response[:, None] * response[None]).reshape(9, -1).T
    active = np.arange(rows.size)
    for _ in range(STEPS):
        spectra = 1 / (1 + np.exp(-logits[active]))
        left = signals[rows[active]] - spectra @ response.T
        missing = np.abs(left).max(axis=1) > FOUND
        active, left, slope = active[missing], left[missing], (spectra * (1 - spectra))[missing]
        if not active.size:
            break
        gram = (slope @ products).reshape(-1, 3, 3)
        floor = 1e-9 * np.trace(gram, axis1=1, axis2=2) + 1e-15
        gram += floor[:, None, None] * np.eye(3)
        change = np.linalg.solve(gram, left[..., None])[..., 0]
        logits[active] += np.clip(change @ response, -LOGIT_STEP, LOGIT_STEP)
    spectra = 1 / (1 + np.exp(-logits))
    nearer = colour_errors(spectra, rows) < errors[rows]
    result[rows[nearer]] = spectra[nearer]
    return result.astype(mean.dtype)


def table_error(source: ImageSource, layout: pixel_spectra.PictureLayout,
                tables: pixel_spectra.SpectraTables,
                sample: pixel_spectra.PixelBlock, *, encoded: bool) -> findings.Finding | None:
    """How far, in CIEDE2000 under D65 and A, spectra of a picture's table are from those computed
    by themselves, at some of its signals that are not darker than the table; None where there are
    none, or each pixel was computed by itself.

    Parameters
    ----------
    source : ImageSource
    layout, tables
        As of ``pixel_spectra.block_spectra``.
    sample : PixelBlock
        As of ``pixel_spectra.survey``.
    encoded : bool
        As of `of_colours`.

    Returns
    -------
    Finding
        WARN where the largest is beyond ``limit``; ``beyond`` is the share of the picture's pixels
        that are, each signal standing for those that are next to it in order.
    """
    if not tables:
        return None
    signals, counts = np.unique(np.clip(sample.signals, 0, 1), axis=0, return_counts=True)
    bright = signals.min(axis=1) >= uplift_table.MIN_ROOT**3
    if not bright.any():
        return None
    first = np.arange(0, np.count_nonzero(bright), -(-np.count_nonzero(bright) // CHECKED))
    pixels = np.add.reduceat(counts[bright], first)
    block = pixel_spectra.PixelBlock(signals[bright][first], None, None)
    nm, _ = layout.nm
    table, own = (np.clip(of_colours(source, layout, each, encoded=encoded)(block)[0], 0, 1)
                  for each in (tables, ()))
    apart = np.max([appearance.ciede2000(appearance.reflectance_to_lab(nm, own, light),
                                         appearance.reflectance_to_lab(nm, table, light))
                    for light in CHECK_LIGHTS], axis=0)
    beyond = float(pixels[apart > MAX_TABLE_ERROR].sum() / counts.sum())
    return findings.Finding(
        "uplift.table", findings.graded(float(apart.max()), MAX_TABLE_ERROR), values={
            "median": float(np.median(apart)), "largest": float(apart.max()), "beyond": beyond,
            "limit": MAX_TABLE_ERROR, "side": source.table_side,
            "larger_side": 2 * source.table_side - 1})


def colours_off(pixels: int, of_pixels: int) -> findings.Finding:
    """How many pixels of a picture in sRGB have spectra without their colour.

    Parameters
    ----------
    pixels, of_pixels : int
        Those beyond MAX_COLOUR_ERROR, and all.
    """
    return findings.Finding(
        "uplift.colours-off", findings.Severity.WARN if pixels else findings.Severity.INFO,
        values={"pixels": pixels, "of_pixels": of_pixels, "limit": MAX_COLOUR_ERROR})


def require_bands(bands: int, relative_response: np.ndarray) -> None:
    """Refuse an image whose bands are not those of the camera, or of which two respond alike.

    Raises
    ------
    InputError
    """
    if bands != len(relative_response):
        raise errors.InputError(f"the image has {bands} bands and the sensitivities "
                         f"{len(relative_response)}")
    check_bands(relative_response)


def require_side(side: int) -> None:
    """Refuse a table without a grey.

    Raises
    ------
    InputError
    """
    if side < 3 or side % 2 == 0:
        raise errors.InputError(f"--side {side} is not odd and at least 3")
