"""Photos of one flat sample under several lights or filters, as one photo of all their bands.

Each photo has its own white, field of light and clipped pixels, and is left out where it is clipped
or dark. Photos of one response are averaged, as `measure/regions/flat_signals.py` averages their
regions, and errors that photos under one lamp have in common are those of regions.
"""
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from spectrabox.measure.pictures import (
    illumination,
    lit_photo,
    pixel_errors,
    pixel_flags,
    pixel_spectra,
)
from spectrabox.measure.regions import flat_signals
from spectrabox.measure.regions.white import FlatErrors, FlatPhoto, white_at_regions
from spectrabox.radiometry import error_model, gloss, grid
from spectrabox.radiometry.covariance import block_diagonal
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture

MAX_SETS = 4        # of bands, the most frequent; each costs a table of spectra
Between = Callable[[int, int], csr_array]   # weights (n, N) of the nodes at pixels of some rows


@dataclass(frozen=True, eq=False)
class _PhotoAtNodes:
    """A photo, or several of one response as one, with white and its errors at N nodes."""

    image: LinearImage
    white: np.ndarray               # (N, K) signal
    log: np.ndarray                 # (N, K, K), as of pixel_errors.White
    log_and_glare: np.ndarray       # (N, K, K)
    glare: np.ndarray               # (K,) signal
    glare_covariance: np.ndarray    # (K, K)
    causes: Mapping[str, np.ndarray]    # (N, K, K) relative covariance of white by cause


def stack_photos(photos: Sequence[FlatPhoto], images: Sequence[LinearImage],
                 nodes_px: Sequence[np.ndarray], between: Between,
                 known: Mapping[str, np.ndarray], errors: FlatErrors, surface: str | None,
                 prior: LogitMixture) -> lit_photo.LitPhoto:
    """All bands of some photos with the light on every pixel, as a source of pixels' signals.

    Parameters
    ----------
    photos : sequence of FlatPhoto
        Each of which shows a region.
    images : sequence of LinearImage
        Of each the part that the picture shows, in the pixels of the first.
    nodes_px : sequence of (N, 2) arrays
        Nodes over that part, in the pixels of each photo itself.
    between : function of (first row, last row)
        Weights (n, N) of the nodes at the pixels of some rows.
    known : mapping
        From names of regions to their known reflectances (P,) on the grid.
    errors : FlatErrors
    surface : str or None
        What is stated of the surfaces, of gloss.KINDS.
    prior : LogitMixture
        Of the reflectances.

    Raises
    ------
    InputError, CheckError
        As ``white.white_at_regions``.
    """
    of_photo = flat_signals.first_of_response([photo.response for photo in photos])
    distinct = sorted(set(of_photo))
    parts = [_averaged([_at_nodes(photo, image, at_px, known, errors) for photo, image, at_px, first
                        in zip(photos, images, nodes_px, of_photo, strict=True)
                        if first == number], between)
             for number in distinct]
    nodes, bands = parts[0].white.shape
    lamps = np.repeat([flat_signals.lamp_of(photos, number) for number in distinct],
                      bands).astype(object)
    white = np.ones(len(lamps))

    log = _blocks([part.log for part in parts])
    for cause in dict.fromkeys(cause for part in parts for cause in part.causes):
        none = np.zeros((nodes, bands, bands))
        log += [
            flat_signals.common_to_photos(cause, node, white, lamps, errors.disagreement)
            for node in _blocks([part.causes.get(cause, none) for part in parts])
        ]
    disagreement = block_diagonal(*[errors.disagreement.among_bands(bands)] * len(parts))
    relative = disagreement + flat_signals.common_to_photos(
        error_model.DISAGREEMENT, disagreement, white, lamps, errors.disagreement)
    response = np.vstack([photos[number].response for number in distinct])
    glare, photo_of_band = np.concatenate([part.glare for part in parts]), np.repeat(distinct,
                                                                                     bands)
    image = _stacked([part.image for part in parts])
    band_sets, flags = shown_bands(image, glare, photo_of_band, np.concatenate([
        flat_signals.dark_bands(part.white[0]) | photos[number].lost_bands
        for number, part in zip(distinct, parts, strict=True)]))
    return lit_photo.LitPhoto(
        image,
        pixel_errors.PixelErrors(
            between,
            pixel_errors.White(np.hstack([part.white for part in parts]), log,
                               _blocks([part.log_and_glare for part in parts])),
            illumination.even_light(
                response @ grid.interpolation_matrix(PRIOR_GRID.nm, grid.FINE_GRID.nm),
                nodes), glare, block_diagonal(*(part.glare_covariance for part in parts)),
            gloss.gloss_states(surface, lamps.tolist()), relative,
            [[photo.calibration for photo in photos]], photo_of_band, response[None], prior),
        flags, band_sets=band_sets)


def _at_nodes(photo: FlatPhoto, image: LinearImage, nodes_px: np.ndarray,
              known: Mapping[str, np.ndarray], errors: FlatErrors) -> _PhotoAtNodes:
    """White of one photo and its errors at the nodes."""
    white = white_at_regions(photo, known, errors, nodes_px)
    assert white is not None, "the photo shows a region"
    bands, first = white.glare.size, len(white.samples.names) - len(nodes_px)
    nodes = range(first, len(white.samples.names))          # they stand after the regions
    covariance = np.array([white.white_and_glare(node) for node in nodes])
    by_cause = [white.errors(node, np.ones(bands)) for node in nodes]
    typical = nodes[np.argsort(white.white[first:, 0])[len(nodes) // 2]]
    return _PhotoAtNodes(
        image, white.white[first:], covariance[:, :bands, :bands], covariance[:, :bands,
                                                                                   bands:],
        white.glare + white.mean[white.glare_part], covariance[0, bands:, bands:]
        + flat_signals.stray_light(photo, white, typical, errors),
        {cause: np.array([causes[cause] for causes in by_cause])
         for cause in by_cause[0]})


def _averaged(parts: Sequence[_PhotoAtNodes], between: Between) -> _PhotoAtNodes:
    """Photos of one response as one, in the units of the first: each pixel is the mean of those
    that are not clipped there; noise is averaged, other errors are taken as common.
    """
    if len(parts) == 1:
        return parts[0]
    first = parts[0]
    gains = [first.white / part.white for part in parts]        # (N, K) each
    typical = [gain.mean(axis=0) for gain in gains]
    shape = first.image.signal.shape
    signal, variance = np.empty(shape, np.float32), np.empty(shape, np.float32)
    saturated = np.empty(shape, bool)
    for start, end in pixel_spectra.row_blocks(*shape[:2]):
        weights = between(start, end)
        clipped = np.array([part.image.saturated[start:end].any(axis=2, keepdims=True)
                            for part in parts])
        used = ~clipped | clipped.all(axis=0)
        total, noise = np.zeros((2, end - start, *shape[1:]))
        for part, gain, use in zip(parts, gains, used, strict=True):
            over = (weights @ gain).reshape(total.shape)
            total += use * over * (part.image.signal[start:end] - part.glare)
            noise += use * over**2 * part.image.variance[start:end]
        count = used.sum(axis=0)
        signal[start:end] = total / count + first.glare
        variance[start:end] = noise / count**2
        saturated[start:end] = clipped.all(axis=0)

    def mean(values: Sequence[np.ndarray]) -> np.ndarray:
        return np.asarray(np.mean(values, axis=0))

    none = np.zeros_like(first.log)
    return _PhotoAtNodes(
        _with_pixels(first.image, signal, variance, saturated), first.white,
        mean([part.log for part in parts]),
        mean([part.log_and_glare * gain for part, gain in zip(parts, typical, strict=True)]),
        first.glare,
        mean([np.outer(gain, gain) * part.glare_covariance
              for part, gain in zip(parts, typical, strict=True)]),
        {cause: mean([part.causes.get(cause, none) for part in parts])
         for cause in dict.fromkeys(cause for part in parts for cause in part.causes)})


def shown_bands(photo: LinearImage, glare: np.ndarray, photo_of_band: np.ndarray,
                silent: np.ndarray) -> tuple[lit_photo.BandSets | None, np.ndarray | None]:
    """The bands that each pixel of a stack is seen in, and what pixels are flagged for (H, W);
    neither where all of them are seen or none.

    A photo whose bands are not all seen at a pixel is left out there. Pixels with the same photos
    have one set of bands, and its own table of spectra; of rare sets the pixels take the largest
    common set within theirs.

    Parameters
    ----------
    photo : LinearImage
        The stack, of K bands.
    glare : (K,) array
        Signal.
    photo_of_band : (K,) int array
        The photo that each band is of; the first is 0.
    silent : (K,) bool array
        Bands that say nothing anywhere, since their light is too dark.
    """
    photos = np.unique(photo_of_band)
    clipped = np.zeros(photo.saturated.shape[:2], bool)
    code = np.zeros(clipped.shape, np.int64)
    for bit, number in enumerate(photos):
        bands = np.flatnonzero((photo_of_band == number) & ~silent)
        saturated = photo.saturated[..., bands].any(axis=2)
        seen = ~saturated & (photo.signal[..., bands] > glare[bands]).all(axis=2)
        code |= seen.astype(np.int64) << bit
        clipped |= saturated
    codes, count = np.unique(code, return_counts=True)
    if not codes.any() or (not silent.any() and set(codes.tolist()) <= {0, (1 << len(photos)) - 1}):
        return None, None
    of_code = (codes[:, None] >> np.arange(len(photos))) & 1 == 1           # (C, photos)
    frequent = [each for each in np.argsort(-count, kind="stable") if codes[each]][:MAX_SETS]
    frequent.sort(key=lambda each: -int(of_code[each].sum()))
    index, known = np.zeros(codes.size, np.uint8), np.zeros(codes.size, bool)
    for each, own in enumerate(codes):
        within = [number for number, one in enumerate(frequent) if codes[one] & ~own == 0]
        if within and own:
            index[each], known[each] = within[0], True
    at = np.searchsorted(codes, code)
    flags = np.where(known[at], pixel_flags.SEEN,
                     np.where(clipped, pixel_flags.CLIPPED, pixel_flags.DARK)).astype(np.uint8)
    sets = of_code[frequent][:, np.searchsorted(photos, photo_of_band)] & ~silent
    return (sets, index[at]), flags


def _stacked(images: Sequence[LinearImage]) -> LinearImage:
    """The bands of all images as one."""
    if len(images) == 1:
        return images[0]
    return _with_pixels(images[0], *(
        np.concatenate([getattr(image, name) for image in images], axis=2)
        for name in ("signal", "variance", "saturated")))


def _with_pixels(image: LinearImage, signal: np.ndarray, variance: np.ndarray,
                 saturated: np.ndarray) -> LinearImage:
    for array in (signal, variance, saturated):
        array.flags.writeable = False       # records then keep it without a copy
    return replace(image, signal=signal, variance=variance, saturated=saturated)


def _blocks(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Matrices (N, K, K) of each photo as (N, J, J), zeros between photos."""
    return np.array([block_diagonal(*node) for node in zip(*parts, strict=True)])
