"""The stage that turns photographed regions into signals relative to white, with every error."""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from spectrabox.calibrate.chart_equations import PatchError
from spectrabox.measure.surface_signals import with_errors
from spectrabox.radiometry.error_model import (
    DISAGREEMENT,
    DRIFT_OF_COLOUR,
    GLARE,
    LIGHT_SPECTRUM,
    PHOTO_NOISE,
    SENSITIVITIES,
    added_covariance,
    drift_covariance,
    glare_signal,
    light_covariance,
    proportional_covariance,
    sensitivity_covariance,
)
from spectrabox.radiometry.grid import interpolation_matrix
from spectrabox.radiometry.light_scale import drift_between
from spectrabox.radiometry.records import Calibration, LightDrift, SurfaceSignals
from spectrabox.radiometry.response import response_matrix, white_signal
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture, load_prior, of_families
from spectrabox.sampling.prior.mixture_posterior import mean_and_spread, posterior
from spectrabox.session.config.session_schema import FIRST_PHOTO, SessionConfig, ViewInputs
from spectrabox.session.flat.white_at_regions import (
    PhotoWhite,
    far_notes,
    level_notes,
    light_map,
    white_at_regions,
    with_known,
)
from spectrabox.session.stages.inputs import GRID, band_names, read_reflectance
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import (
    calibrations_of,
    chart_of,
    photo_of,
    reference_signals,
)

SAME = 1e-9             # relative: responses closer than this are one
GUESSED = 0.01          # of white: error of the signals whose spectra the errors are evaluated at


def find_signals(task: StageTask) -> dict[str, Any]:
    """Signals of regions, charts and calibrations to signals relative to white.

    Returns
    -------
    dict
        "signals", a SurfaceSignals; of every photo the "light" (R, 2) on its regions, relative to
        that on the chart, with its relative error, and both over the photo as "light map" (2, h,
        w), None where it shows no region, and how far the levels of its known regions are from the
        light's as "level misfits", in standard errors; the "drift" of the light, a LightDrift or
        None; "notes".

    Raises
    ------
    InputError
        If chart and samples were exposed differently and do not say how.
    CheckError
        If a region of known spectrum shows another light than the chart.
    """
    config = task.config
    calibrations, drift = calibrations_of(config, task.stored), drift_of(task)
    known = _known_spectra(config)
    responses = [response_of(calibration) for calibration in calibrations]
    model = model_error(task)
    records: dict[str, Any] = {"drift": drift, "notes": ()}
    found: list[PhotoWhite | None] = []
    for number, view in enumerate(config.all_views):
        task.progress(number / len(config.all_views), view.photo_files[0])
        white = white_of_photo(task, view, responses[number], drift)
        if white is not None:
            records["notes"] += far_notes(white) + level_notes(white)
        found.append(white)
    records["signals"] = _stacked(task, calibrations, responses, found, known, model, drift)
    if drift is not None:
        records["notes"] += (drift.sentence,)
    for view, white in zip(config.all_views, found, strict=True):
        records[view.record("level misfits")] = None if white is None else np.array(
            list(white.level_misfits.values()))
        records[view.record("light")] = None if white is None else _light_on_regions(white)
        records[view.record("light map")] = None if white is None else light_map(
            task, view, _chart_view(config, view))
    return records


def white_of_photo(task: StageTask, view: ViewInputs, response: np.ndarray,
                   drift: LightDrift | None,
                   nodes_px: np.ndarray | None = None) -> PhotoWhite | None:
    """White at the regions of a photo, with what its regions of known spectrum say of it.

    Parameters
    ----------
    view : ViewInputs
    response : (K, P) array
        Of the view's bands, rows summing to 1.
    drift : LightDrift or None
        From the first chart photo to the first photo of samples.
    nodes_px : (N, 2) array, optional
        As of ``white_at_regions``.
    """
    white = white_at_regions(task, view, _chart_view(task.config, view),
                             None if view.name else drift, nodes_px)
    if white is None:
        return None
    signals = {name: response @ spectrum for name, spectrum in _known_spectra(task.config).items()
               if name in white.samples.names}
    model = model_error(task)
    return with_known(white, signals, {name: _model_covariance(signal, model)
                                       for name, signal in signals.items()})


def _known_spectra(config: SessionConfig) -> dict[str, np.ndarray]:
    return {name: spectrum_on_grid(read_reflectance(config, section.known), GRID)
            for name, section in config.regions.items() if section.known is not None}


def model_error(task: StageTask) -> PatchError:
    """By what the patches of the chart and the model of the photo disagree."""
    own, common = task.stored["calibrate"].record(np.ndarray, "model error")
    return PatchError(float(own), float(common))


def drift_of(task: StageTask) -> LightDrift | None:
    """Change of the light from the first chart photo to the first photo of samples, where both
    show references.
    """
    chart = chart_of(task.stored)
    if not task.config.drift.chart_px or chart is None:
        return None
    return drift_between(chart[2], reference_signals(task.stored["chart"]), photo_of(task.stored),
                         reference_signals(task.stored["photo"]), task.config.drift.relative_error)


def _chart_view(config: SessionConfig, view: ViewInputs) -> ViewInputs:
    """The view whose chart photo shows the light of a view."""
    return view if view.chart else config.all_views[0]


def response_of(calibration: Calibration) -> np.ndarray:
    """Response (K, P) of the bands to reflectances; rows sum to 1."""
    matrix = response_matrix(GRID, calibration.sensitivity.curves,
                             spectrum_on_grid(calibration.light, GRID))
    return matrix / white_signal(matrix)[:, None]


def _stacked(task: StageTask, calibrations: Sequence[Calibration], responses: list[np.ndarray],
             found: list[PhotoWhite | None], known: dict[str, np.ndarray], model: PatchError,
             drift: LightDrift | None) -> SurfaceSignals:
    """Signals of all regions in the bands of all photos; photos of one response are averaged."""
    config, views = task.config, task.config.all_views
    of_view = [next(other for other in range(number + 1)
                    if _same(responses[other], responses[number])) for number in range(len(views))]
    distinct = sorted(set(of_view))
    bands = band_names(config, len(responses[0]))
    names, count = tuple(config.regions), len(bands)
    labels = tuple(f"{views[number].name or FIRST_PHOTO}: {band}" if len(views) > 1 else band
                   for number in distinct for band in bands)
    signal = np.full((len(names), len(labels)), np.nan)
    causes: dict[str, np.ndarray] = {}
    for index, name in enumerate(names):
        for block, number in enumerate(distinct):
            shown = [(white, white.samples.names.index(name), views[other])
                     for other, white in enumerate(found)
                     if of_view[other] == number and white is not None
                     and name in white.samples.names]
            if not shown:
                continue
            own = slice(block * count, (block + 1) * count)
            signal[index, own] = np.mean([white.signal[row] for white, row, _ in shown], axis=0)
            for cause, covariance in _errors(task, config, shown, model, drift).items():
                whole = causes.setdefault(cause, np.zeros((len(names), *(2 * [len(labels)]))))
                whole[index, own, own] = covariance
    response = np.vstack([responses[number] for number in distinct])
    spectra = np.array([known[name] if name in known else _guess(
        config, load_prior(), name, response, signal[index]) for index, name in enumerate(names)])
    signals = SurfaceSignals(names, tuple(name in known for name in names), GRID, spectra, labels,
                             np.repeat(distinct, count), response, signal, ())
    filled = dataclasses.replace(signals, signal=np.nan_to_num(signal))
    causes[SENSITIVITIES] = sensitivity_covariance(calibrations, filled)
    causes[LIGHT_SPECTRUM] = light_covariance(calibrations, filled)
    return with_errors(signals, causes)


def _errors(task: StageTask, config: SessionConfig,
            shown: list[tuple[PhotoWhite, int, ViewInputs]], model: PatchError,
            drift: LightDrift | None) -> dict[str, np.ndarray]:
    """Covariance (K, K) by cause of a region's mean signal over photos of one response.

    Noise is averaged; the other errors are taken as common to the photos.
    """
    noise = np.sum([white.noise(row) for white, row, _ in shown], axis=0) / len(shown) ** 2
    parts: list[dict[str, np.ndarray]] = []
    for white, row, view in shown:
        signal = white.signal[row]
        veil = glare_signal(config.stray_light.glare, photo_of(task.stored, view).signal.mean(
            axis=(0, 1))) / white.white[row]
        parts.append({**white.errors(row), GLARE: added_covariance(veil),
                      DISAGREEMENT: _model_covariance(signal, model)})
        if drift is not None and not view.name:
            parts[-1][DRIFT_OF_COLOUR] = proportional_covariance(signal, drift_covariance(drift))
    causes = dict.fromkeys(cause for part in parts for cause in part)
    zero = np.zeros_like(noise)
    return {PHOTO_NOISE: noise, **{
        cause: np.mean([part.get(cause, zero) for part in parts], axis=0) for cause in causes}}


def _model_covariance(signal: np.ndarray, model: PatchError) -> np.ndarray:
    """Covariance (K, K) by what patches and model disagree."""
    return proportional_covariance(signal, model.among_bands(signal.size))


def _guess(config: SessionConfig, prior: LogitMixture, name: str, response: np.ndarray,
           signal: np.ndarray) -> np.ndarray:
    """The spectrum (P,) that the learnt prior expects behind a signal (J,)."""
    seen = np.isfinite(signal)
    coarse = response[seen] @ interpolation_matrix(PRIOR_GRID.nm, GRID.nm)
    mixture = posterior(of_families(prior, config.regions[name].families), coarse,
                        signal[None, seen], GUESSED**2 * np.eye(int(seen.sum())))
    return np.interp(GRID.nm, PRIOR_GRID.nm, mean_and_spread(mixture)[0][0])


def _light_on_regions(white: PhotoWhite) -> np.ndarray:
    """Light (R, 2) on the regions relative to the chart's mean, and its relative error."""
    bands, regions = white.glare.size, len(white.samples.names)
    own = slice(2 * bands, 2 * bands + regions)
    return np.column_stack([np.exp(white.elsewhere.field + white.mean[own]),
                            np.sqrt(np.diag(white.covariance)[own])])


def _same(response: np.ndarray, other: np.ndarray) -> bool:
    """Whether two responses (K, P) are the same within round-off."""
    return response.shape == other.shape and bool(
        np.abs(response - other).max() <= SAME * np.abs(other).max())
