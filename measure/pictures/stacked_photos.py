"""Photos of one flat sample under several lights or filters, as one photo of all their bands.

Each photo has its own white, field of light and clipped pixels. Photos of one response are
averaged, as `measure/regions/flat_signals.py` averages their regions, and errors that photos
under one lamp have in common are those of regions.
"""
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from spectrabox.measure.pictures import illumination, lit_photo, pixel_errors, pixel_spectra
from spectrabox.measure.pictures.shown_bands import shown_bands
from spectrabox.measure.regions import flat_signals
from spectrabox.measure.regions.white import FlatErrors, FlatPhoto, white_at_regions
from spectrabox.radiometry import error_model, gloss, grid
from spectrabox.radiometry.covariance import block_diagonal
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture

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
        shown=shown_bands(
            image, glare, photo_of_band,
            np.concatenate([
                flat_signals.dark_bands(part.white[0]) | photos[number].lost_bands
                for number, part in zip(distinct, parts, strict=True)
            ])))


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
