"""What to do next: of a finished session, or of a signal given as options."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.measure import tables, texts
from spectrabox.measure.advice import advice, advise
from spectrabox.measure.more_bands.filter_fit import AtHand
from spectrabox.measure.signals import options, sample, signal_capture
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.filters import filters_at_hand
from spectrabox.sampling.further.more_measurements import joined
from spectrabox.sampling.prior import mixture
from spectrabox.session.commands.requests import MeasuredSignal
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import load_finished
from spectrabox.session.signals import measurement_file, signal_options


def advise_answer(measured: MeasuredSignal, sensitivity: str | None, light: str | None,
                  lamps: str | None, filters: str | None, folder: Path | None, allow_outside: bool
                  ) -> tuple[dict[str, Any], str]:
    """JSON object and text of the options of ``spectrabox advise``.

    Raises
    ------
    InputError
        If what is asked does not go together, or something cannot be read.
    """
    hand = read_at_hand(lamps, filters)
    if folder is not None:
        if sensitivity or light or _is_stated(measured):
            raise InputError("a session has its own camera, light and signals: give DIR with "
                             "--lamps and --filters alone, or no DIR")
        config = read_session(folder, allow_outside)
        finished = load_finished(config)
        return _answer(advise.advice_on_capture(finished.capture, finished.records, hand))
    if measured.signal is not None:
        return _on_signal(measured, sensitivity, light, hand)
    raise InputError("nothing to advise on: give the folder of a finished session, or a --signal "
                     "with --sensitivity and --light")


def read_at_hand(lamps: str | None, filters: str | None) -> AtHand | None:
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
    return {**{name: named_spectra.light(name, FINE_GRID) for name in chosen[0] or ()},
            **{name: filter for word in chosen[1] or ()
               for name, filter in filters_at_hand(Path(word)).items()}}


def _is_stated(measured: MeasuredSignal) -> bool:
    """Whether something is stated that only a signal has."""
    return bool(measured.signal or measured.white or measured.more or measured.reading
                or measured.signal_under or measured.same)


def _on_signal(measured: MeasuredSignal, sensitivity: str | None, light: str | None,
               hand: AtHand | None) -> tuple[dict[str, Any], str]:
    if sensitivity is None or light is None:
        raise InputError("a signal needs its camera and its light: give --sensitivity and --light")
    response = named_spectra.relative_response(sensitivity, light, FINE_GRID)
    bands = len(response)
    white = signal_options.optional_numbers(measured.white, bands, "white")
    noise = signal_options.optional_noise(measured.noise, bands)
    base = sample.measurement_of_signal(response,
                                        signal_options.numbers(measured.signal or "", bands,
                                                               "signal"),
                                        white, noise)
    taken = measurement_file.further_measurements(measured, sensitivity, response, white)
    # so that the width is the one that ``sample`` states: by the same draws
    capture = signal_capture.SignalCapture(response, base.signal[None], ("",), np.ones(bands),
                                           np.sqrt(np.diag(base.noise_covariance)), more=taken)
    [estimate] = sample.sample_signals(capture, options.SampleOptions())
    each = advise.advice_on_signal(joined(base, taken), mixture.load_prior(),
                                   found=advise.stated_outlook(estimate),
                                   curves=named_spectra.sensitivities(sensitivity, FINE_GRID),
                                   present=named_spectra.light(light, FINE_GRID), hand=hand)
    facts, text = _answer(advice.Advised(each), taken=[name for name, _ in taken])
    caveats = [*map(texts.says, signal_capture.unstated(white, noise))]
    if caveats:
        facts["caveat"] = "\n".join(caveats)
    return facts, "\n".join([text, *caveats])


def _answer(advised: advice.Advised, taken: Sequence[str] = ()) -> tuple[dict[str, Any], str]:
    """JSON object and text of lists."""
    facts = {**advised.facts, "taken": list(taken)}
    single = len(advised.by_surface) == 1
    lines = [_table(advised.overall, "what to do next")]
    if not single:
        lines += [_table(each, name) for name, each in advised.by_surface.items()]
    return facts, "\n".join(lines)


def _table(each: Sequence[advice.Advice], title: str) -> str:
    """What to do next, the best first."""
    if not each:
        return f"{title}: nothing that is known here brings much"
    return tables.text_table(
        ["what", "cost", "band", "after", "colour, dE00", "after"],
        [[one.says, one.cost, f"{one.width_before:.3f}", f"{one.width_after:.3f}",
          f"{one.colour_before:.1f}", f"{one.colour_after:.1f}"] for one in each],
        text=["what", "cost"], title=title)
