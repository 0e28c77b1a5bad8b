"""Gels and lamps that most people can have, and how to expose with them.

What to do next of everything that can be asked: flat samples, scenes, signals.

Every action is forecast by the functions that find the spectra now. Of common gels and lamps the
best is the one that brings most where the band is widest; of those that somebody says are at hand
all are weighed, and pairs of the best gels.
"""


from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from spectrabox.measure.advice import advice as advice_kinds
from spectrabox.measure.advice import flat_actions, further
from spectrabox.measure.advice import forecast as forecasting
from spectrabox.measure.captured import Capture, FlatCapture
from spectrabox.measure.estimate import Estimate
from spectrabox.measure.more_bands import filter_fit, joined_errors
from spectrabox.measure.records import CaptureRecords
from spectrabox.measure.signals.options import SampleOptions
from spectrabox.measure.surfaces.surface_signals import alone
from spectrabox.radiometry import error_model, errors, grid
from spectrabox.radiometry.records import spectra
from spectrabox.radiometry.records.calibration import Filter
from spectrabox.radiometry.spectra import filters, named_spectra
from spectrabox.sampling.prior import mixture, signal_posterior
from spectrabox.sampling.summary import next_measurement_nm

STOPS = 0.05                # of exposure: less is not said
# of gels for stage lamps, every 50 nm
GEL_NM = np.arange(400.0, 701.0, 50.0)
GELS = {"a magenta gel": (0.14, 0.47, 0.04, 0.002, 0.002, 0.02, 0.87),
        "an orange gel": (0.15, 0.10, 0.01, 0.02, 0.66, 0.88, 0.93)}
LAMPS = {"daylight": "D65", "a halogen lamp": "A", "a cold white LED lamp": "LED-B5",
         "an RGB LED lamp": "LED-RGB1"}


def usual_at_hand() -> filter_fit.AtHand:
    """Common lamps, and two kinds of gels."""
    lamps = {words: named_spectra.light(name, grid.FINE_GRID) for words, name in LAMPS.items()}
    gels = {words: filters.stated_filter(
        words, np.clip(grid.pchip(GEL_NM, np.array(values), grid.FINE_GRID.nm),
                       filters.MIN_TRANSMITTANCE, 1)) for words, values in GELS.items()}
    return {**lamps, **gels}


def exposure(photos: Sequence[filter_fit.FurtherPhoto]) -> tuple[list[float], list[int]]:
    """Stops to add to the exposure of photos, none where no photo needs any, and numbers of the
    further bands, from 1, that they leave dark.

    Parameters
    ----------
    photos : sequence of FurtherPhoto
    """
    stops = [float(photo.stops) for photo in photos]
    dark = [number * len(photo.white) + int(band) + 1
            for number, photo in enumerate(photos) for band in photo.dark]
    return stops if max(map(abs, stops)) >= STOPS else [], dark


# ---- what to do next of everything that can be asked: flat samples, scenes, signals --------------

TO_FINE = grid.interpolation_matrix(mixture.PRIOR_GRID.nm, grid.FINE_GRID.nm)
LIKELY = 0.1                # probability of matt from which stating it is worth a thought
PAIRED = 4                  # best gels at hand, of which every pair is tried
# draws that reproduce the signal
SEEN = (spectra.Outcome.FAMILIAR, spectra.Outcome.UNFAMILIAR, spectra.Outcome.BEYOND_LEARNT,
        spectra.Outcome.UNSAID)


def advice_on_capture(capture: Capture, records: CaptureRecords,
                      hand: filter_fit.AtHand | None = None) -> advice_kinds.Advised:
    """What to do next of flat samples or a scene that were measured.

    Parameters
    ----------
    capture : Capture
    records : CaptureRecords
        Of all steps.
    hand : mapping, optional
        From names to lamps (301,) and filters; common lamps and gels by default.
    """
    surfaces = {name: _surface_of(capture, records, index)
                for index, name in enumerate(records.signals.names)
                if not records.signals.known[index]
                and records.spectra[name].draws.outcome in SEEN}
    considered: dict[str, list[advice_kinds.Advice]] = {name: [] for name in surfaces}
    if isinstance(capture, FlatCapture):
        sample = flat_actions.FlatPhotos(capture, records)
        for name, surface in surfaces.items():
            considered[name] += _of_flat_sample(sample, surface)
    for name, surface in surfaces.items():
        considered[name].append(_of_reading(surface))
    fit = records.calibrate.chart
    if fit is not None and fit.patch_error is not None:
        calibration = records.calibrations(capture.views)[0]
        fitted = joined_errors.ChartFitted(calibration, capture.lit_chart.reflectances,
                                     float(fit.patch_error[0]))
        for name, more in _of_photos(surfaces, *filter_fit.curves_and_light(calibration), fitted,
                                     hand or usual_at_hand(), all_of_them=hand is not None).items():
            considered[name] += more
    return advice_kinds.advised(considered,
                                {name: surface.found for name, surface in surfaces.items()})


def _surface_of(capture: Capture, records: CaptureRecords, index: int) -> forecasting.Unknown:
    signals = alone(records.signals, index)
    name = signals.names[0]
    summary, stated = records.spectra[name], capture.surfaces[name]
    beyond = summary.draws.outcome in (spectra.Outcome.BEYOND_LEARNT, spectra.Outcome.UNSAID)
    prior = mixture.smoothness_prior() if beyond \
        else mixture.of_families(mixture.load_prior(), stated.families)
    variables = np.zeros(0) if summary.states is None else summary.states.mean
    return forecasting.Unknown(
        prior, summary.level, signals, summary.draws.spectra.mean(axis=0), variables,
        forecasting.outlook_of_answer(summary.draws, summary.lower, summary.upper),
        forecasting.outlook_of_signals(prior, summary.level, signals), summary.next_measurement_nm,
        stated.surface,
        0.0 if summary.states is None else summary.states.shares.get("matt", 0.0))


def _of_flat_sample(sample: flat_actions.FlatPhotos,
                    surface: forecasting.Unknown) -> list[advice_kinds.Advice]:
    """White card, chart nearer, flat field, lamp moved, and that it is matt."""
    capture, name = sample.capture, surface.signals.names[0]

    def after(signals: spectra.SurfaceSignals) -> np.ndarray:
        return forecasting.outlook_after(surface, signals)

    forecasts: dict[str, Callable[[], np.ndarray]] = {
        advice_kinds.CHART_NEARER: lambda: after(sample.signals(name, place=flat_actions.NEARER))}
    if not sample.known:
        forecasts[advice_kinds.WHITE_CARD] = lambda: after(sample.signals(name, card=True))
    if not capture.flat_fields:
        forecasts[advice_kinds.FLAT_FIELD] = lambda: after(sample.signals(name, flat_field=True))
    if not capture.lamp_moved:
        forecasts[advice_kinds.LAMP_MOVED] = lambda: forecasting.outlook_after(
            flat_actions.with_level(surface), flat_actions.with_lamp_moved(sample, name))
    if surface.stated is None and surface.matt > LIKELY:
        forecasts[advice_kinds.MATT] = lambda: forecasting.outlook_of_signals(
            surface.prior, surface.level, sample.signals(name, surface="matt"))
    advised = []
    for action, forecast in forecasts.items():
        # with smaller errors than now, a known region may contradict the chart: nobody is told to
        # do what would end in a refusal
        with contextlib.suppress(errors.CheckError):
            advised.append(surface.advice(action, forecast()))
    return advised


def _of_reading(surface: forecasting.Unknown) -> advice_kinds.Advice:
    """A reading at the wavelength where it tells most."""
    nm = surface.reading_nm
    return surface.advice(advice_kinds.READING, forecasting.outlook_after(
        surface, further.with_reading(surface, nm)), f"{nm:.0f} nm")


def advice_on_signal(measured: spectra.SpectralMeasurement, prior: mixture.LogitMixture,
                     level: float = SampleOptions.level, *,
                     found: np.ndarray | None = None,
                     curves: np.ndarray | None = None, present: np.ndarray | None = None,
                     hand: filter_fit.AtHand | None = None) -> tuple[advice_kinds.Advice, ...]:
    """What to do next of a surface of which signals are known, and what they err by; further photos
    err by noise alone.

    Parameters
    ----------
    measured : SpectralMeasurement
        Whose first bands are the camera's under the present light.
    prior : LogitMixture
        On reflectances.
    level : float
        Of the band.
    found : (2,) array, optional
        Its outlook as an answer states it (``outlook_of_answer``), so that the advice states
        the same; in closed form by default.
    curves : (K, 301) array, optional
        Sensitivities of the camera; without them no lamp is tried, only gels.
    present : (301,) array, optional
        The light.
    hand : mapping, optional
        From names to lamps (301,) and filters; common lamps and gels by default.
    """
    posterior = signal_posterior.solve_posterior(prior, measured)
    if posterior.outcome not in SEEN:
        return ()
    bands = spectra.default_band_names(measured.signal.size)
    estimate = TO_FINE @ posterior.mean
    solved = forecasting.outlook_of(posterior, level)
    surface = forecasting.Unknown(
        posterior.prior, level,
        spectra.SurfaceSignals(
            ("signal",), (False,), measured.grid, estimate[None], bands,
            np.zeros(measured.signal.size, int), measured.relative_response, measured.signal[None],
            {error_model.PHOTO_NOISE: measured.noise_covariance[None]},
            () if measured.states is None else (measured.states,)), posterior.mean,
        np.zeros(0) if posterior.states is None else posterior.states.mean,
        solved if found is None else found, solved,
        next_measurement_nm(mixture.PRIOR_GRID, posterior.covariance))
    known = hand or usual_at_hand()
    if curves is None or present is None:
        curves, present = measured.relative_response / grid.FINE_GRID.weights_nm, np.ones(
            grid.FINE_GRID.nm.size)
        known = {name: each for name, each in known.items() if isinstance(each, Filter)}
    each = _of_photos({"": surface}, curves, present, None, known, all_of_them=hand is not None)
    return advice_kinds.ranked([_of_reading(surface), *each.get("", [])])


def advice_on_estimate(estimate: Estimate) -> tuple[advice_kinds.Advice, ...]:
    """What to do next of a surface whose spectrum was estimated from a signal; nothing without the
    learnt prior.

    Parameters
    ----------
    estimate : Estimate
    """
    if estimate.prior is None or estimate.measurement is None or estimate.summary is None:
        return ()
    return advice_on_signal(estimate.measurement, estimate.prior, estimate.summary.level,
                            found=stated_outlook(estimate))


def stated_outlook(estimate: Estimate) -> np.ndarray | None:
    """Outlook (2,) that an estimate states of its spectrum; None where it has no draws.

    Parameters
    ----------
    estimate : Estimate
    """
    if estimate.samples is None or estimate.summary is None:
        return None
    return forecasting.outlook_of_answer(estimate.samples, estimate.summary.lower,
                                         estimate.summary.upper)


def _of_photos(surfaces: Mapping[str, forecasting.Unknown], curves: np.ndarray, present: np.ndarray,
               fitted: joined_errors.ChartFitted | None, hand: filter_fit.AtHand, *,
               all_of_them: bool) -> dict[str, list[advice_kinds.Advice]]:
    """A photo more through the best of the gels, and under the best of the lamps; or through and
    under each of them, and through pairs of the best gels.
    """
    white = filter_fit.white_of_bands(curves, present)
    may = {name: surface for name, surface in surfaces.items()
           if further.may_add_photos(surface, len(white), fitted)}
    if not may:
        return {}

    def left(surface: forecasting.Unknown,
             photos: Sequence[filter_fit.FurtherPhoto]) -> np.ndarray | None:
        after = further.with_photos(surface, photos, white, fitted)
        return None if after is None else forecasting.outlook_after(surface, after)

    photos = filter_fit.photos_at_hand(curves, present, hand)
    # where the band is widest a photo counts most
    widest = max(may.values(), key=lambda surface: surface.found[forecasting.WIDTH])
    outlooks = {photo.name: outlook for photo in photos
                for outlook in [left(widest, [photo])] if outlook is not None}
    best = sorted((photo for photo in photos if photo.name in outlooks),
                  key=lambda photo: outlooks[photo.name][forecasting.WIDTH])
    gels = [photo for photo in best if photo.filter is not None]
    lamps = [photo for photo in best if photo.filter is None]
    pairs = [[first, second] for number, first in enumerate(gels[:PAIRED])
             for second in gels[number + 1:PAIRED]] if all_of_them else []
    count = None if all_of_them else 1
    chosen = [*((advice_kinds.GEL, [photo]) for photo in gels[:count]),
              *((advice_kinds.TWO_GELS, pair) for pair in pairs),
              *((advice_kinds.SECOND_LAMP, [photo]) for photo in lamps[:count])]
    each: dict[str, list[advice_kinds.Advice]] = {name: [] for name in may}
    for action, some in chosen:
        for name, surface in may.items():
            after = outlooks[some[0].name] if surface is widest and len(some) == 1 \
                else left(surface, some)
            if after is not None:
                each[name].append(surface.advice(action, after, " and ".join(
                    photo.name for photo in some), *exposure(some)))
    return each
