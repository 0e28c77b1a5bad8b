"""Spectra of any part of calibrated photos at once: what a page shows while somebody points at it.

Photos stay open and the calibration is made; from then on a region's signal and spectrum take the
very functions of the steps.
"""
from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spectrabox.capture.photo import preview, regions, registration
from spectrabox.measure import captured, opened_photos, texts
from spectrabox.measure.pictures import shown_photo
from spectrabox.measure.records import CaptureRecords, PhotoRecords
from spectrabox.measure.regions import flat_signals, white
from spectrabox.measure.steps.photos import PHOTO_THUMBNAIL_WIDTH as THUMBNAIL_WIDTH
from spectrabox.measure.steps.photos import outlines_in, registration_of
from spectrabox.measure.steps.signals import flat_errors, flat_photos
from spectrabox.measure.surfaces import surface_signals, surface_spectra
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.records.photos import LinearImage, RegionSamples, Registration
from spectrabox.radiometry.records.spectra import SpectrumSummary, SurfaceSignals
from spectrabox.sampling.prior import mixture
from spectrabox.sampling.prior.signal_posterior import SignalPosterior, solve_posterior


def pointed_sample(capture: captured.FlatCapture, records: CaptureRecords,
                   images: Mapping[str, LinearImage]) -> PointedSample:
    """Photos that are open and records of their calibration, put together.

    Parameters
    ----------
    capture : FlatCapture
    records : CaptureRecords
        Of charts and calibration; those of the photos are made here.
    images : mapping
        Photos by view.
    """
    records.photo = PhotoRecords({name: preview.thumbnail(image, THUMBNAIL_WIDTH)
                                  for name, image in images.items()}, {}, {},
                                 opened_photos.OpenPhotos(capture).bands(images[""]), ())
    first, *others = capture.views
    edges = {
        view.name: registration.find_edges(images[view.name])
        for view in capture.views if others
    }
    registrations = {view.name: registration_of(records.charts, first, view, edges[""],
                                                edges[view.name]) for view in others
                     if view.photo != first.photo}
    return PointedSample(capture, flat_photos(capture, records), dict(images), records,
                         capture.band_names(records.photo.bands), registrations)


@dataclass(frozen=True, eq=False)
class PointedSample:
    """Calibrated photos with what is stated of their regions now, which may have been others when
    the calibration was made.
    """

    capture: captured.FlatCapture
    photos: list[white.FlatPhoto]
    images: Mapping[str, LinearImage]       # whole, by view
    records: CaptureRecords                 # of charts and calibration, the same while these are
    bands: tuple[str, ...]
    registrations: Mapping[str, Registration | None]    # of further photos to the first

    @cached_property
    def errors(self) -> white.FlatErrors:
        """What is stated of errors."""
        return flat_errors(self.capture, self.records)

    @cached_property
    def _known_samples(self) -> dict[str, RegionSamples | None]:
        """Of each view: its regions of known spectrum."""
        return {view.name: self._sampled(self.capture, view, self._known)
                for view in self.capture.views}

    @cached_property
    def doubted_known(self) -> dict[str, str]:
        """Regions of known spectrum of which nothing is concluded, and what is wrong with each:
        they cannot be read, or contradict the light of the chart, or those before them.
        """
        unread = {}
        for name in self.capture.known:
            try:
                for view in self.capture.views:
                    self._sampled(self.capture, view, (name,))
            except CheckError as error:
                unread[name] = str(error)
        known = {name: spectrum for name, spectrum in self.capture.known.items()
                 if name not in unread}
        _, left_out = white.agreeing_known(
            [replace(photo, samples=self._sampled(self.capture, view, known)) for view, photo
             in zip(self.capture.views, self.photos, strict=True)], known, self.errors)
        return unread | {finding.subject: texts.says(finding) for finding in left_out}

    @property
    def _known(self) -> dict[str, np.ndarray]:
        """Reflectances of the known regions that agree with the light."""
        return {name: spectrum for name, spectrum in self.capture.known.items()
                if name not in self.doubted_known}

    @cached_property
    def looks(self) -> dict[str, shown_photo.PhotoLook]:
        """Of each view whose photo has colours of its own: how it is shown in them."""
        looks = {}
        for view, photo in zip(self.capture.views, self.photos, strict=True):
            look = shown_photo.calibrated_look(
                replace(photo, samples=self._known_samples[view.name]), self._known,
                self.errors)
            if look is not None:
                looks[view.name] = look
        return looks

    def _sampled(self, capture: captured.FlatCapture, view: captured.View,
                 names: Iterable[str]) -> RegionSamples | None:
        wanted = {*names}
        outlines = {name: outline for name, outline in outlines_in(
            capture, view, self.registrations.get(view.name)).items() if name in wanted}
        return regions.sample_regions(self.images[view.name], outlines,
                                      without_clipped=len(capture.views) > 1,
                                      known=capture.known) if outlines else None

    def signal(self, name: str,
               region: captured.Surface) -> tuple[SurfaceSignals, list[white.PhotoWhite]]:
        """The signal of a region, which need not be one of the capture, with its errors, as a run
        has it among all regions; and white in each photo that shows it, the region being the first
        there.

        Parameters
        ----------
        name : str
        region : Surface

        Raises
        ------
        InputError, CheckError
            As ``white.white_at_regions``.
        """
        alone = replace(self.capture, regions={name: region})
        samples = [joined_samples(self._sampled(alone, view, (name,)),
                                  self._known_samples[view.name]) for view in alone.views]
        errors = replace(self.errors, surfaces={name: region.surface} if region.surface else {})
        whites = [white.white_at_regions(replace(photo, samples=own), self._known, errors)
                  for photo, own in zip(self.photos, samples, strict=True)]
        signals = flat_signals.flat_signals(self.photos, whites, {name: region.families}, {},
                                            self.bands, errors)
        return signals, [each for each in whites if each is not None]

    def drawn(self, name: str) -> tuple[list[white.PhotoWhite], SpectrumSummary]:
        """White at a region of the capture and its spectrum, as a report has them: drawn by the
        seed of the run plus the region's index.

        Parameters
        ----------
        name : str
        """
        capture, region = self.capture, self.capture.regions[name]
        signals, whites = self.signal(name, region)
        seed = capture.seed + list(capture.regions).index(name)
        return whites, surface_spectra.sample_surfaces(
            signals, capture.sampling, seed, {name: region.families}, lambda done, what: None)[name]

    def pointed(self, region: captured.Surface
                ) -> tuple[SurfaceSignals, list[white.PhotoWhite], SignalPosterior]:
        """Signal of any part of a photo, white there, and the spectrum in closed form.

        Parameters
        ----------
        region : Surface
        """
        signals, whites = self.signal("pointer", region)
        prior = mixture.of_families(mixture.load_prior(), region.families)
        return signals, whites, solve_posterior(prior, surface_signals.measurement(signals, 0))


def joined_samples(own: RegionSamples | None, known: RegionSamples | None
                   ) -> RegionSamples | None:
    """A region's samples, and after them those of regions of known spectrum."""
    if own is None or known is None:
        return own
    clipped = None if own.clipped is None and known.clipped is None else np.concatenate(
        [np.zeros(each.mean.shape, bool) if each.clipped is None else each.clipped
         for each in (own, known)])
    mean, covariance, pixels, scatter, points = (
        np.concatenate([getattr(own, name), getattr(known, name)])
        for name in ("mean", "covariance_of_mean", "pixels", "scatter", "points_px"))
    return RegionSamples((*own.names, *known.names), mean, covariance, pixels, scatter, points,
                         clipped, own.edges)
