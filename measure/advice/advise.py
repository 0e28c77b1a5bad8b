"""What to do next of everything that can be asked: flat samples, scenes, signals.

Every action is forecast by the functions that find the spectra now. Of gels and lamps the best is
looked for among all that are at hand by linear algebra, and only that one is forecast.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.measure.advice.advice import (
    CHART_NEARER,
    FLAT_FIELD,
    GEL,
    LAMP_MOVED,
    MATT,
    READING,
    SECOND_LAMP,
    WHITE_CARD,
    Advice,
    Advised,
    advice,
    advised,
)
from spectrabox.measure.advice.at_hand import usual_at_hand
from spectrabox.measure.advice.flat_actions import (
    FlatPhotos,
    flat_photos_of,
    stated_matt,
    with_chart_nearer,
    with_flat_field,
    with_lamp_moved,
    with_level,
    with_white_card,
)
from spectrabox.measure.advice.forecast import (
    Outlook,
    Unknown,
    outlook_after,
    outlook_now,
    outlook_stated,
)
from spectrabox.measure.advice.further import (
    READING_ERROR,
    ChartFitted,
    may_add_photos,
    with_photos,
    with_reading,
)
from spectrabox.measure.captured import Capture, FlatCapture
from spectrabox.measure.more_bands.further_photos import (
    FurtherPhoto,
    LampsAtHand,
    curves_and_light,
    photos_at_hand,
    white_of_bands,
)
from spectrabox.measure.records import CaptureRecords
from spectrabox.measure.surfaces.surface_signals import alone
from spectrabox.radiometry.appearance import ciede2000, reflectance_to_lab
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.radiometry.records.spectra import Outcome, SurfaceSpectrum
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior, of_families, smoothness_prior

TO_FINE = interpolation_matrix(PRIOR_GRID.nm, FINE_GRID.nm)
LIKELY = 0.1                # probability of matt from which stating it is worth a thought
SEEN = (Outcome.FAMILIAR, Outcome.UNFAMILIAR)       # draws that reproduce the signal
STOPS = 0.05                # of exposure: less is not said


@dataclass(frozen=True, eq=False)
class _Surface:
    """One surface with what was found of it."""

    unknown: Unknown
    found: Outlook              # by its draws
    solved: Outlook             # by the forecast's way
    covariance: np.ndarray      # (61, 61) of its reflectance
    reading_nm: float
    stated: str | None          # how much it mirrors
    matt: float                 # probability of that

    def advice(self, action: str, after: Outlook, subject: str = "", more: str = "") -> Advice:
        """One action, as a ratio to what was found."""
        return advice(action, self.found, Outlook(
            self.found.width * after.width / self.solved.width,
            self.found.colour * after.colour / self.solved.colour), subject, more)


def advice_on_capture(capture: Capture, records: CaptureRecords,
                      hand: LampsAtHand | None = None) -> Advised:
    """What to do next of flat samples or a scene that were measured.

    Parameters
    ----------
    capture : Capture
    records : CaptureRecords
        Of all steps.
    hand : LampsAtHand, optional
        Common lamps and gels by default.
    """
    surfaces = {name: _surface_of(capture, records, index)
                for index, name in enumerate(records.signals.names)
                if not records.signals.known[index]
                and records.sample.spectra[name].samples.outcome in SEEN}
    considered: dict[str, list[Advice]] = {name: [] for name in surfaces}
    if isinstance(capture, FlatCapture):
        sample = flat_photos_of(capture, records)
        for name, surface in surfaces.items():
            considered[name] += _of_flat_sample(sample, surface)
    for name, surface in surfaces.items():
        considered[name].append(_of_reading(surface))
    for name, more in _of_photos(capture, records, surfaces, hand or usual_at_hand()).items():
        considered[name] += more
    return advised(considered, {name: surface.found for name, surface in surfaces.items()})


def _surface_of(capture: Capture, records: CaptureRecords, index: int) -> _Surface:
    signals = alone(records.signals, index)
    name = signals.names[0]
    spectrum: SurfaceSpectrum = records.sample.spectra[name]
    samples, stated = spectrum.samples, capture.surfaces[name]
    prior = of_families(load_prior(), stated.families) if samples.outcome is Outcome.FAMILIAR \
        else smoothness_prior()
    variables = np.zeros(0) if spectrum.states is None else spectrum.states.mean
    unknown = Unknown(prior, spectrum.summary.level, signals, samples.spectra.mean(axis=0),
                      variables)
    colours = reflectance_to_lab(samples.grid.nm, samples.spectra)
    colour = reflectance_to_lab(samples.grid.nm, samples.spectra.mean(axis=0))
    found = Outlook(float(np.mean(spectrum.summary.upper - spectrum.summary.lower)),
                    float(np.sqrt(np.mean(ciede2000(colour, colours)**2))))
    return _Surface(unknown, found, outlook_now(unknown), np.cov(samples.spectra, rowvar=False),
                    spectrum.summary.next_measurement_nm, stated.surface,
                    0.0 if spectrum.states is None else spectrum.states.shares.get("matt", 0.0))


def _of_flat_sample(sample: FlatPhotos, surface: _Surface) -> list[Advice]:
    """White card, chart nearer, flat field, lamp moved, and that it is matt."""
    unknown, capture = surface.unknown, sample.capture
    name = unknown.signals.names[0]
    each = [surface.advice(CHART_NEARER, outlook_after(unknown, with_chart_nearer(sample, name)))]
    if not capture.known:
        each.append(surface.advice(WHITE_CARD, outlook_after(unknown, with_white_card(sample,
                                                                                     name))))
    if not capture.development.flat_fields:
        each.append(surface.advice(FLAT_FIELD, outlook_after(unknown, with_flat_field(sample,
                                                                                     name))))
    if not capture.lamp_moved:
        each.append(surface.advice(LAMP_MOVED, outlook_after(with_level(unknown),
                                                             with_lamp_moved(sample, name))))
    if surface.stated is None and surface.matt > LIKELY:
        each.append(surface.advice(MATT, outlook_stated(unknown, stated_matt(sample, name))))
    return each


def _of_reading(surface: _Surface) -> Advice:
    """A reading at the wavelength where it tells most."""
    nm = surface.reading_nm
    return surface.advice(READING, outlook_after(surface.unknown, with_reading(
        surface.unknown, nm)), f"{nm:.0f} nm")


def _of_photos(capture: Capture, records: CaptureRecords, surfaces: Mapping[str, _Surface],
               hand: LampsAtHand) -> dict[str, list[Advice]]:
    """A photo more through the best of the gels, and under the best of the lamps."""
    fit = records.calibrate.chart
    if fit is None or fit.patch_error is None:
        return {}
    calibration = records.calibrations(capture.views)[0]
    fitted = ChartFitted(calibration, capture.lit_chart.reflectances, float(fit.patch_error[0]))
    curves, present = curves_and_light(calibration)
    white = white_of_bands(curves, present)
    may = {name: surface for name, surface in surfaces.items()
           if may_add_photos(surface.unknown, len(white))}
    if not may:
        return {}
    covariance = np.mean([surface.covariance for surface in may.values()], axis=0)
    each: dict[str, list[Advice]] = {name: [] for name in may}
    at_hand = photos_at_hand(curves, present, hand)
    for action, filtered in ((GEL, True), (SECOND_LAMP, False)):
        photos = [photo for photo in at_hand if (photo.filter is not None) is filtered]
        if not photos:
            continue
        best = min(photos, key=lambda photo: left_by(covariance, photo))
        for name, surface in may.items():
            after = with_photos(surface.unknown, [best], white, fitted, surface.stated)
            if after is not None:
                each[name].append(surface.advice(action, outlook_after(surface.unknown, after),
                                                 best.name, exposure_words([best])))
    return each


def left_by(covariance: np.ndarray, photo: FurtherPhoto) -> float:
    """Mean variance that a photo of little error leaves of a reflectance, by linear algebra.

    Parameters
    ----------
    covariance : (61, 61) array
        Of the reflectance before it.
    photo : FurtherPhoto
    """
    rows = (photo.response @ TO_FINE)[np.isin(np.arange(len(photo.white)), photo.dark,
                                              invert=True)]
    base = covariance @ rows.T
    told = np.linalg.solve(rows @ base + READING_ERROR**2 * np.eye(len(rows)), base.T)
    return float(np.trace(covariance) - np.sum(base * told.T))


def exposure_words(photos: Sequence[FurtherPhoto]) -> str:
    """Exposure to add to photos, and the bands that they leave dark, as a sentence.

    Parameters
    ----------
    photos : sequence of FurtherPhoto
    """
    words = ""
    if any(abs(photo.stops) >= STOPS for photo in photos):
        words += f" Expose {' and '.join(f'{photo.stops:+.1f}' for photo in photos)} stops."
    dark = [str(number * len(photo.white) + int(band) + 1)
            for number, photo in enumerate(photos) for band in photo.dark]
    return words + (f" Dark: band {', '.join(dark)} of the further bands." if dark else "")
