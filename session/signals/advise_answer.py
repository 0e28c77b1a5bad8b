"""The answers of ``spectrabox advise``: for a finished session, one signal, or before the shoot."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.calibrate.prior.camera_prior import CameraPrior, load_camera_prior, shipped_prior
from spectrabox.calibrate.prior.plain_priors import prior_of_curves
from spectrabox.measure.advice.advice import Advice, Advised
from spectrabox.measure.advice.advise import advice_on_capture, advice_on_signal, stated_outlook
from spectrabox.measure.advice.at_hand import usual_at_hand
from spectrabox.measure.advice.before_shoot import Expectation, Shoot, expected_spectra
from spectrabox.measure.camera import light_words
from spectrabox.measure.more_bands.further_photos import LampsAtHand
from spectrabox.measure.signals.options import SampleOptions
from spectrabox.measure.signals.sample import measurement_of_signal, sample_signals
from spectrabox.measure.signals.signal_estimate import SignalCapture, unstated
from spectrabox.measure.tables import text_table
from spectrabox.radiometry.charts.references import reference_reflectances
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.filters import filters_at_hand
from spectrabox.sampling.further.more_measurements import joined
from spectrabox.sampling.prior.mixture import load_prior
from spectrabox.session.camera.camera_files import read_layout
from spectrabox.session.commands.requests import AdviseRequest
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import load_finished
from spectrabox.session.signals.measurement_file import further_measurements
from spectrabox.session.signals.signal_options import numbers, optional_noise, optional_numbers

CURVES_ERROR = 0.02         # relative, of measured curves: as [sensitivity] takes it by default
PATCH_ERROR = 0.01          # relative, of a patch of a chart that is not photographed yet


def advise_answer(request: AdviseRequest) -> tuple[dict[str, Any], str]:
    """JSON object and text.

    Raises
    ------
    InputError
        If what is asked does not go together, or something cannot be read.
    """
    hand = read_at_hand(request.lamps, request.filters)
    if request.folder is not None:
        if request.sensitivity or request.light or _of_signal(request):
            raise InputError("a session has its own camera, light and signals: give DIR with "
                             "--lamps and --filters alone, or no DIR")
        config = read_session(request.folder, request.allow_outside)
        finished = load_finished(config)
        return _answer(advice_on_capture(finished.capture, finished.records, hand))
    if request.signal is not None:
        return _on_signal(request, hand)
    if request.light is None or _of_signal(request):
        raise InputError("nothing to advise on: give the folder of a finished session, a --signal "
                         "with --sensitivity and --light, or of a shoot that is planned --light "
                         "and, where it is known, --sensitivity")
    return _before_the_shoot(request, hand)


def read_at_hand(lamps: str | None, filters: str | None) -> LampsAtHand | None:
    """Lamps and filters at hand, of two options of names or files separated by commas; None where
    neither is given.

    Raises
    ------
    InputError
        If an option names nothing, or a filter's transmittance is not between 0 and 1.
    """
    chosen = [None if words is None else tuple(word.strip() for word in words.split(",")
                                               if word.strip()) for words in (lamps, filters)]
    if () in chosen:
        raise InputError("no lamp or filter was named; give --lamps D65,A,my.csv or --filters "
                         "yellow.csv")
    if chosen == [None, None]:
        return None
    return LampsAtHand({name: named_spectra.light(name, FINE_GRID) for name in chosen[0] or ()},
                       {name: filter for word in chosen[1] or ()
                        for name, filter in filters_at_hand(Path(word)).items()})


def _of_signal(request: AdviseRequest) -> bool:
    """Whether something is stated that only a signal has."""
    return bool(request.signal or request.white or request.more or request.reading
                or request.signal_under or request.same)


def _on_signal(request: AdviseRequest, hand: LampsAtHand | None) -> tuple[dict[str, Any], str]:
    sensitivity, light = request.sensitivity, request.light
    if sensitivity is None or light is None:
        raise InputError("a signal needs its camera and its light: give --sensitivity and --light")
    response = named_spectra.relative_response(sensitivity, light, FINE_GRID)
    bands = len(response)
    white = optional_numbers(request.white, bands, "white")
    noise = optional_noise(request.noise, bands)
    base = measurement_of_signal(response, numbers(request.signal or "", bands, "signal"), white,
                                 noise)
    taken = further_measurements(request, sensitivity, response, white)
    # so that the width is the one that ``sample`` states: by the same draws
    capture = SignalCapture(response, base.signal[None], ("",), np.ones(bands),
                            np.sqrt(np.diag(base.noise_covariance)), more=taken)
    [estimate] = sample_signals(capture, SampleOptions())
    each = advice_on_signal(joined(base, taken), load_prior(), estimate.level,
                            found=stated_outlook(estimate),
                            curves=named_spectra.sensitivities(sensitivity, FINE_GRID),
                            present=named_spectra.light(light, FINE_GRID), hand=hand)
    facts, text = _answer(Advised(each), taken=[measured.name for measured in taken])
    caveats = unstated(white, noise)
    if caveats:
        facts["caveat"] = "\n".join(caveats)
    return facts, "\n".join([text, *caveats])


def _before_the_shoot(request: AdviseRequest,
                      hand: LampsAtHand | None) -> tuple[dict[str, Any], str]:
    assert request.light is not None
    if request.sensitivity is not None and request.prior_file is not None:
        raise InputError("--sensitivity and --prior both say what the camera is; give one")
    if request.surfaces < 1:
        raise InputError(f"--surfaces {request.surfaces} is too few; give at least 1")
    noise = PATCH_ERROR if request.noise is None else float(numbers(request.noise, 1, "noise")[0])
    if not 0 < noise < 1:
        raise InputError(f"--noise {noise:g} is not between 0 and 1; 0.01 means 1 %")
    light = named_spectra.stated_light(request.light, FINE_GRID)
    chart = read_layout(request.layout)
    shoot = Shoot(light, _cameras(request), reference_reflectances(request.reference, chart,
                                                                   FINE_GRID),
                  chart.centres_uv, noise)
    expectation = expected_spectra(shoot, hand or usual_at_hand(), surfaces=request.surfaces)
    return _answer(Advised(expectation.advice), expectation,
                   title=f"spectra of surfaces beside the chart ({light_words(light)}, {noise:.1%} "
                   "a patch)")


def _cameras(request: AdviseRequest) -> CameraPrior:
    if request.sensitivity is not None:
        return prior_of_curves(FINE_GRID, named_spectra.sensitivities(request.sensitivity,
                                                                      FINE_GRID), CURVES_ERROR)
    return shipped_prior() if request.prior_file is None else load_camera_prior(request.prior_file)


def _answer(advised: Advised, expected: Expectation | None = None, *,
            taken: Sequence[str] = (), title: str = "") -> tuple[dict[str, Any], str]:
    """JSON object and text of lists, and of what is expected of a shoot."""
    facts = {**advised.facts, "taken": list(taken), "expected": None}
    lines = []
    if expected is not None:
        mean = asdict(replace(expected.mean))
        del mean["family"]
        facts["expected"] = {"families": [asdict(one) for one in expected.families], "mean": mean,
                             "rmse_daylight": expected.rmse_daylight,
                             "will_do": not expected.doubts, "doubts": list(expected.doubts)}
        lines.append(title)
        lines.append(text_table(
            ["family", "RMSE", "95 % band", "RMSE, all known", "band, all known"],
            [[one.family, f"{one.rmse:.3f}", f"{one.width:.3f}", f"{one.rmse_known:.3f}",
              f"{one.width_known:.3f}"] for one in (*expected.families, expected.mean)],
            text=["family"]))
        lines += expected.doubts or ("this lamp and this chart will do",)
    single = len(advised.by_surface) == 1
    lines.append(_table(advised.overall, "what to do next"))
    if not single:
        lines += [_table(each, name) for name, each in advised.by_surface.items()]
    return facts, "\n".join(lines)


def _table(each: Sequence[Advice], title: str) -> str:
    """What to do next, the best first."""
    if not each:
        return f"{title}: nothing that is known here brings much"
    return text_table(
        ["what", "cost", "band", "after", "colour, dE00", "after"],
        [[one.says, one.cost, f"{one.width_before:.3f}", f"{one.width_after:.3f}",
          f"{one.colour_before:.1f}", f"{one.colour_after:.1f}"] for one in each],
        text=["what", "cost"], title=title)
