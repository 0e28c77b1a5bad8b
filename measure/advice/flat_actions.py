"""Flat samples after an action: the same regions as another photo would show them.

Every function gives the signal of one region with the errors that it would have, by the functions
that find it now: only what the action changes is another.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from spectrabox.measure import captured, records
from spectrabox.measure.advice import forecast
from spectrabox.measure.regions import white as white_reference
from spectrabox.measure.regions.flat_signals import flat_signals
from spectrabox.measure.regions.moved_lamp import LEVEL
from spectrabox.measure.steps.signals import flat_errors, flat_photos, known_of_signals
from spectrabox.radiometry import error_model, grid
from spectrabox.radiometry.records import photos, spectra

CARD = 0.9                  # reflectance of a white card
BESIDE = 0.2                # lengths of the chart from the edge of a sample to the middle of a card
GAP = 0.1                   # lengths of the chart from its patches to a sample right beside it
MOVED = "moved lamp"
BESIDE_IT, NEARER = "card beside ", "nearer "      # names of places, before that of their region


class FlatPhotos:
    """Photos of flat samples with what is stated of them, as the step "signals" has them.

    Parameters
    ----------
    capture : FlatCapture
    records : CaptureRecords
        Of the steps up to the signals.
    """

    def __init__(self, capture: captured.FlatCapture, records: records.CaptureRecords) -> None:
        self.capture = capture
        self.known = known_of_signals(capture, records)     # regions that tell of the light
        self.photos, self.errors = flat_photos(capture, records), flat_errors(capture, records)
        self.bands = capture.band_names(records.photo.bands)

    @cached_property
    def whites(self) -> list[white_reference.PhotoWhite | None]:
        """Of each photo what white reads by the chart at its regions, at cards beside them, and
        where they would lie right beside the chart.
        """
        return [_at_places(photo, self.errors) for photo in self.photos]

    @cached_property
    def whites_by_flat_field(self) -> list[white_reference.PhotoWhite | None]:
        """The same of photos that were divided by that of a white card, which leaves no fall-off on
        the chart; what lies there reflects what it does now.
        """
        return [None if now is None else _divided(photo, now, replace(self.errors, flat_field=True))
                for photo, now in zip(self.photos, self.whites, strict=True)]

    def signals(self, name: str, *, place: str = "", card: bool = False, flat_field: bool = False,
                surface: str | None = None, moved: bool = False) -> spectra.SurfaceSignals:
        """The signal of one region.

        Parameters
        ----------
        name : str
            Of the region.
        place : str
            NEARER for one that lies right beside the chart.
        card : bool
            Whether a white card lies beside it.
        flat_field : bool
            Whether photos were divided by that of a white card.
        surface : str, optional
            What is stated of it; by default what the capture states.
        moved : bool
            Whether there is one photo more, under the first lamp in another place.
        """
        region = place + name
        photos, known = self.photos, dict(self.known)
        whites = self.whites_by_flat_field if flat_field else self.whites
        if moved:
            photos = [*photos, replace(photos[0], name=MOVED, lamp=MOVED, moved=True)]
            whites = [*whites, whites[0]]
        if card:
            known[BESIDE_IT + name] = np.full(grid.FINE_GRID.nm.size, CARD)
        stated = surface or self.errors.surfaces.get(name)
        errors = replace(self.errors, surfaces={} if stated is None else {region: stated},
                         known={**self.errors.known, BESIDE_IT + name: captured.READ_ERROR})
        told = [_told(photo, white, (region, *known), known, errors)
                for photo, white in zip(photos, whites, strict=True)]
        return flat_signals(photos, told, {region: self.capture.families[name]}, {}, self.bands,
                            errors)


def with_lamp_moved(sample: FlatPhotos, name: str) -> spectra.SurfaceSignals:
    """A region with one photo more, under the first lamp in another place.

    The light on it is taken to be as usual in both places: that one is off is rare.
    """
    after = sample.signals(name, moved=True)
    states = after.states[0]
    level = [name.startswith(LEVEL) for name in states.names]
    usual = (states.means[:, level] == 0).all(axis=1)
    weights = states.weights[usual]
    return replace(after, states=(replace(
        states, kinds=tuple(np.array(states.kinds)[usual].tolist()),
        weights=weights / weights.sum(), means=states.means[usual],
        covariances=states.covariances[usual]),))


def with_level(unknown: forecast.Unknown) -> forecast.Unknown:
    """The same with the level of the light in the sample's plane as a variable of the capture, as
    it is between two places of a lamp, in place of an error; a surface that reads black in every
    band is as it was, since no level changes it.

    Parameters
    ----------
    unknown : Unknown
        Under a lamp that was not moved.
    """
    now = unknown.signals
    signal, states = np.nan_to_num(now.signal[0]), now.states[0]
    if not (signal > 0).any():
        return unknown
    plane = now.errors[error_model.SAMPLE_PLANE][0]
    variance = float((np.diag(plane)[signal > 0] / signal[signal > 0]**2).max())
    level = spectra.CaptureStates((LEVEL,), (error_model.SAMPLE_PLANE,), signal[:, None],
                                  np.full(1, -1.0), ("",), np.ones(1), np.zeros((1, 1)),
                                  np.full((1, 1, 1), variance))
    seen = np.isfinite(now.signal[0])
    level_mean = variance * signal[seen] @ np.linalg.solve(
        forecast.total_covariance(now)[np.ix_(seen, seen)], forecast.left_errors(unknown)[seen])
    return replace(unknown, variables=np.r_[unknown.variables, level_mean], signals=replace(
        now, states=(spectra.independent_states(states, level),),
        errors={cause: covariance for cause, covariance in now.errors.items()
                if cause != error_model.SAMPLE_PLANE}))


def _told(photo: white_reference.FlatPhoto, white: white_reference.PhotoWhite | None,
          names: Sequence[str], known: Mapping[str, np.ndarray],
          errors: white_reference.FlatErrors) -> white_reference.PhotoWhite | None:
    """White at some places of a photo, the first of which it must show, as known ones tell."""
    if white is None or names[0] not in white.samples.names:
        return None
    own = white.of_regions(_rows(white.samples, [name for name in names
                                                if name in white.samples.names]))
    return white_reference.white_told_by(photo, own, known, errors)


def _rows(samples: photos.RegionSamples, names: Sequence[str]) -> photos.RegionSamples:
    """The samples of some places."""
    chosen = [samples.names.index(name) for name in names]
    return photos.RegionSamples(
        tuple(names), samples.mean[chosen], samples.covariance_of_mean[chosen],
        samples.pixels[chosen], samples.scatter[chosen], samples.points_px[chosen],
        None if samples.clipped is None else samples.clipped[chosen])


def _at_places(photo: white_reference.FlatPhoto,
               errors: white_reference.FlatErrors) -> white_reference.PhotoWhite | None:
    """White at regions, then at cards beside them, then where they would lie beside the chart; a
    card reads what it reflects, and a region reflects there what it does now.
    """
    samples = photo.samples
    if samples is None:
        return None
    count = len(samples.names)
    mean, covariance, pixels, scatter = (np.concatenate(3 * [values]) for values in (
        samples.mean, samples.covariance_of_mean, samples.pixels, samples.scatter))
    places = photos.RegionSamples(
        (*samples.names, *(BESIDE_IT + name for name in samples.names),
         *(NEARER + name for name in samples.names)), mean, covariance, pixels, scatter,
        np.concatenate([samples.points_px, _beside(photo), _by_the_chart(photo)]),
        None if samples.clipped is None else np.concatenate(3 * [samples.clipped]))
    white = white_reference.white_by_chart(replace(photo, samples=places), errors)
    assert white is not None
    here, beside, nearer = np.split(white.white, 3)
    mean = np.concatenate([samples.mean, CARD * beside + white.glare,
                           (samples.mean - white.glare) * nearer / here + white.glare])
    covariance[count:2 * count] *= (mean[count:2 * count].max(axis=1)
                                    / samples.mean.max(axis=1))[:, None, None]
    clipped = white.samples.clipped
    if clipped is not None:         # a card is exposed well, in all bands that the chart tells of
        clipped = clipped.copy()
        clipped[count:2 * count] = photo.lost_bands
    return replace(white, samples=replace(white.samples, mean=mean, covariance_of_mean=covariance,
                                          clipped=clipped))


def _divided(photo: white_reference.FlatPhoto, now: white_reference.PhotoWhite,
             errors: white_reference.FlatErrors) -> white_reference.PhotoWhite:
    """White at the places of a photo once that was divided by one of a white card."""
    even = replace(photo, samples=now.samples, lost=None, white=replace(
        photo.white, field=np.zeros_like(photo.white.field)))
    white = white_reference.white_by_chart(even, errors)
    assert white is not None
    reads = (now.samples.mean - now.glare) / now.white * white.white + white.glare
    return replace(white, samples=replace(white.samples, mean=reads))


def _beside(photo: white_reference.FlatPhoto) -> np.ndarray:
    """Points (R, Q, 2) of cards beside the regions of a photo, towards its middle."""
    assert photo.samples is not None
    points = photo.samples.points_px
    size = np.array(photo.image.signal.shape[1::-1]) * photo.image.sensor_step
    away = np.ptp(points, axis=1).max(axis=1) + BESIDE * _length(photo)
    inward = size / 2 - points.mean(axis=1)
    along_x = np.abs(inward[:, 0]) > np.abs(inward[:, 1])
    turned = np.where(along_x[:, None], [1.0, 0.0], [0.0, 1.0]) * np.where(inward < 0, -1.0, 1.0)
    return np.asarray(points + (away[:, None] * turned)[:, None])


def _by_the_chart(photo: white_reference.FlatPhoto) -> np.ndarray:
    """Points (R, Q, 2) of the regions of a photo if they lay right beside its chart."""
    assert photo.samples is not None
    points, patches = photo.samples.points_px, photo.patches_px.reshape(-1, 2)
    half = np.ptp(points, axis=1) / 2 + GAP * _length(photo)
    middle = points.mean(axis=1)
    nearest = np.clip(middle, patches.min(axis=0) - half, patches.max(axis=0) + half)
    return np.asarray(points + (nearest - middle)[:, None])


def _length(photo: white_reference.FlatPhoto) -> float:
    """Length of the chart in pixels."""
    return float(np.ptp(photo.patches_px.reshape(-1, 2), axis=0).max())
