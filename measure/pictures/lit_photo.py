"""A photo with the light on every pixel, as signals relative to white there.

White and light may come from a chart in the photo of a flat sample, or from light traced in a
scene. What surfaces mirror is taken off by its mean. A pixel's errors lie between those of the best
and of the worst known places of the photo, for which its two tables of spectra are computed. A
photo may be several of one sample, stacked; pixels that not all of them show have tables of their
own.
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spectrabox.measure.pictures import (
    illumination,
    pixel_errors,
    pixel_flags,
    pixel_spectra,
)
from spectrabox.radiometry.error_model import Errors
from spectrabox.radiometry.records.photos import LinearImage
from spectrabox.sampling.prior import mixture, mixture_posterior, uplift_table

GREY = 0.3                  # signal by whose error the places of a photo are compared
BEST_KNOWN, WORST_KNOWN = 5, 95     # percentiles of the places of the two tables
SIDE = 17                   # of the tables: noise leaves no finer detail
NOISE_SAMPLES = 20_000      # pixels that tell how noise depends on the signal
DARKEST = 1e-4              # of white: signals are taken for at least as bright
SIGMAS = 4.0                # beyond white: what no reflectance gives
BandSets = tuple[np.ndarray, np.ndarray]    # sets (S, K) bool, and which of them (H, W) pixels have


@dataclass(frozen=True)
class PhotoBlock(pixel_spectra.PixelBlock):
    """The n pixels of some rows of a lit photo; a mid grey stands for those without a spectrum."""

    # (n, K) relative to white, under the typical light of each pixel, less the mean gloss
    measured: np.ndarray
    flags: np.ndarray           # (n,) of pixel_flags.py
    grey_error: np.ndarray      # (n,) relative standard error of a mid grey there
    white: pixel_errors.White | None         # where pixels are computed one by one
    variance: np.ndarray | None     # (n, K) of the photo's noise, likewise

    @property
    def seen(self) -> np.ndarray:
        """Whether a pixel (n,) has a spectrum."""
        return np.asarray(self.flags == pixel_flags.SEEN)

    @property
    def within(self) -> np.ndarray:
        """Signals (n, K) that a reflectance can give."""
        return np.clip(self.measured, DARKEST, uplift_table.MAX_SIGNAL)

    @property
    def beyond_white(self) -> np.ndarray:
        """How much brighter than white (n,) a pixel is; beyond 1 for certain."""
        return np.asarray(np.max(self.measured - uplift_table.MAX_SIGNAL, axis=1)
                          / (SIGMAS * self.grey_error))


@dataclass(frozen=True, eq=False)
class LitPhoto:
    """A part of a photo, and the light on it: a source of pixels' signals."""

    photo: LinearImage          # the part alone
    errors: pixel_errors.PixelErrors
    flags: np.ndarray | None = None     # (H, W) of pixel_flags.py, by the scene or the bands
    highlights: bool = False    # whether what is brighter than white is a highlight: no spectrum
    band_sets: BandSets | None = None   # where some pixels are seen in some bands; of one light

    table_side, error_levels = SIDE, 2

    @property
    def size(self) -> tuple[int, int, int]:
        """Height, width and number of bands."""
        height, width, bands = self.photo.signal.shape
        return height, width, bands

    @property
    def prior(self) -> mixture.LogitMixture:
        """Of the reflectances."""
        return self.errors.prior

    @property
    def responses(self) -> np.ndarray:
        """Relative response (J, K, 61) under the typical lights, or with each of the sets of bands
        that pixels are seen in.
        """
        responses = self.errors.responses
        return responses if self.band_sets is None else np.repeat(
            responses, len(self.band_sets[0]), axis=0)

    def _light_and_bands(self, light: int) -> tuple[int, np.ndarray]:
        """Index of the typical light, and the bands (K,) that are seen, by the index of
        ``responses``.
        """
        return (light, np.ones(self.size[2], bool)) if self.band_sets is None \
            else (0, self.band_sets[0][light])

    @cached_property
    def noise(self) -> np.ndarray:
        """Variance (2, K) of the photo as a constant and a slope by the signal, fitted to some
        pixels.
        """
        stride = max(1, int(np.sqrt(self.photo.signal[..., 0].size / NOISE_SAMPLES)))
        signal, variance = (each[::stride, ::stride].reshape(-1, each.shape[2]).astype(float)
                            for each in (self.photo.signal, self.photo.variance))
        lines = [np.linalg.lstsq(np.column_stack([np.ones(len(x)), x]), y, rcond=None)[0]
                 for x, y in zip(signal.T, variance.T, strict=True)]
        return np.maximum(np.array(lines).T, 0)

    @cached_property
    def grey_variance(self) -> np.ndarray:
        """Relative variance (N,) of a mid grey at the nodes of ``errors``."""
        white = self.errors.white
        signal = GREY * white.signal
        variance = (self.noise[0] + self.noise[1] * (signal + self.errors.glare)) / signal**2
        return np.asarray(np.mean(np.diagonal(white.log, axis1=1, axis2=2) + variance, axis=1))

    def block(self, first: int, last: int, *, direct: bool = False) -> PhotoBlock:
        """The pixels of rows ``first`` to ``last``.

        Parameters
        ----------
        first, last : int
        direct : bool
            Whether with all that errors of single pixels need.
        """
        errors, bands = self.errors, self.photo.signal.shape[2]
        weights = errors.between(first, last)
        white = np.exp(weights @ np.log(errors.white.signal))
        measured = self.photo.signal[first:last].reshape(-1, bands) - errors.glare
        variance = weights @ self.grey_variance
        low, high = np.percentile(self.grey_variance, [BEST_KNOWN, WORST_KNOWN])
        high = max(high, low * (1 + 1e-6))
        light = None
        if self.band_sets is not None:
            light = self.band_sets[1][first:last].ravel()
        elif len(errors.responses) > 1:     # that of the node of most weight
            per_row = weights.nnz // weights.shape[0]
            at = np.argmax(weights.data.reshape(-1, per_row), axis=1)
            light = errors.light.kind[weights.indices.reshape(-1, per_row)[np.arange(at.size), at]]
        signals = illumination.adapted_signals(
            measured / white, errors.light, weights @ errors.light.maps,
            None if self.band_sets is not None else light, errors.moments)
        # without a node there is no light to be known
        grey_error = np.sqrt(np.where(variance > 0, variance, 1.0))
        flags = np.zeros(len(measured), np.uint8) if self.flags is None \
            else self.flags[first:last].ravel().copy()
        if self.band_sets is None:
            clipped = self.photo.saturated[first:last].reshape(-1, bands).any(axis=1)
            flags[(flags == pixel_flags.SEEN) & clipped] = pixel_flags.CLIPPED
            flags[(flags == pixel_flags.SEEN) & (measured <= 0).any(axis=1)] = pixel_flags.DARK
        else:
            signals[~self.band_sets[0][light]] = GREY
        if self.highlights:
            brighter = np.max(signals - uplift_table.MAX_SIGNAL, axis=1) > SIGMAS * grey_error
            flags[(flags == pixel_flags.SEEN) & brighter] = pixel_flags.HIGHLIGHT
        signals = signals - errors.gloss.pattern @ errors.gloss.mean
        seen = flags == pixel_flags.SEEN
        return PhotoBlock(
            np.where(seen[:, None], np.clip(signals, DARKEST, uplift_table.MAX_SIGNAL), GREY),
            None if light is None else np.where(seen, light, 0),
            np.clip((variance - low) / (high - low), 0, 1).astype(np.float32), signals, flags,
            grey_error, errors.white_at(weights) if direct else None,
            self.photo.variance[first:last].reshape(-1, bands) if direct else None)

    def table_errors(self, light: int, signals: np.ndarray) -> list[Errors]:
        """Errors of signals (n, K) under one typical light, or in one set of bands, at the best and
        at the worst known places.
        """
        light, seen = self._light_and_bands(light)
        by_curves = self.errors.by_curves(signals, light, seen)
        near = [self._errors_near(percentile, signals, by_curves)
                for percentile in (BEST_KNOWN, WORST_KNOWN)]
        return [Errors(np.where(np.outer(seen, seen), errors.relative, 0.0),
                       pixel_errors.of_seen(errors.absolute, seen)) for errors in near]

    def _errors_near(self, percentile: float, signals: np.ndarray,
                     by_curves: np.ndarray) -> Errors:
        """Errors of signals at a place with more errors than a share of all."""
        order = np.argsort(self.grey_variance)
        node = order[round(percentile / 100 * (order.size - 1))]
        there = self.errors.white.rows(np.full(len(signals), node))
        constant, slope = self.noise
        variance = constant + slope * (signals * there.signal + self.errors.glare)
        return self.errors.errors(signals, there, variance, by_curves)

    def direct(self, block: PhotoBlock, *, coarse: bool = False) -> uplift_table.Uplifted:
        """Spectra of a block, each pixel by itself.

        Parameters
        ----------
        block : PhotoBlock
            With all that errors of single pixels need.
        coarse : bool
            As means of many pixels need it: without the errors of sensitivities and light, and no
            nearer to modes than those need it.
        """
        assert block.white is not None and block.variance is not None
        count, within = len(block.measured), block.within
        shape = count, mixture.PRIOR_GRID.nm.size
        whole = np.empty(shape), np.empty(shape), np.empty(count)
        lights = np.zeros(count, int) if block.light is None else block.light
        for number in np.unique(lights):
            own = np.flatnonzero(lights == number)
            light, seen = self._light_and_bands(number)
            errors = self.errors.errors(
                within[own], block.white.rows(own), block.variance[own],
                None if coarse else self.errors.by_curves(within[own], light, seen))
            part = uplift_table.uplift_signals(
                self.prior, self.responses[number][seen], within[own][:, seen],
                Errors(*(each[:, seen][..., seen] for each in errors)),
                tolerance=pixel_errors.COARSE_TOLERANCE if coarse else mixture_posterior.TOLERANCE)
            for values, of_light in zip(whole, part, strict=True):
                values[own] = of_light
        return whole


def photo_spectra(photo: LitPhoto, layout: pixel_spectra.PictureLayout,
                  tables: pixel_spectra.SpectraTables, block: PhotoBlock) -> uplift_table.Uplifted:
    """Mean (n, P), standard deviation (n, Q) and novelty (n,) of a block's pixels, NaN for those
    without a spectrum; beyond a novelty of 1 the prior was learnt from none like it.

    Parameters
    ----------
    photo : LitPhoto
    layout, tables
        As of ``pixel_spectra.block_spectra``.
    block : PhotoBlock
    """
    mean, deviation, novelty = pixel_spectra.block_spectra(photo, layout, tables, block)
    # no signal beyond white is explained by the prior
    novelty = np.maximum(novelty, block.beyond_white)
    for part in (mean, deviation, novelty):
        part[~block.seen] = np.nan
    return mean, deviation, novelty
