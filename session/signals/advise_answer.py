"""Signals given as options: as a capture, what to do next about them, and the picture of their
spectra.
"""


from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import color_sequences, style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from spectrabox.measure.advice import advise
from spectrabox.measure.advice.advice import Advice, Advised
from spectrabox.measure.estimate import Estimate
from spectrabox.measure.more_bands.filter_fit import LampsAtHand
from spectrabox.measure.plots import frame_reflectance
from spectrabox.measure.signals.options import SampleOptions
from spectrabox.measure.signals.sample import measurement_of_signal, sample_signals
from spectrabox.measure.signals.signal_capture import (
    SignalCapture,
    curve_caveats,
    origin_of_colours,
    unstated,
)
from spectrabox.measure.words import text_table
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import whole_file
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra import named_spectra, spectrum_files
from spectrabox.radiometry.spectra.cameras import stated_curve_error
from spectrabox.radiometry.spectra.filters import filters_at_hand
from spectrabox.sampling.further.more_measurements import joined
from spectrabox.sampling.prior import mixture
from spectrabox.session.commands.requests import AdviseRequest, MeasuredSignal
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import load_finished
from spectrabox.session.signals import signal_options
from spectrabox.session.signals.measurement_file import further_measurements


def signal_capture(measured: MeasuredSignal, signals: Path | None, colour: tuple[str, str] | None,
                   sensitivity: str, light: str, *, twice: str | None, light_error: float,
                   sensitivity_error: float, prior: Path | None, family: Sequence[str]
                   ) -> SignalCapture:
    """Signals and what is stated of them, read from options and files.

    Parameters
    ----------
    measured : MeasuredSignal
    signals, sensitivity, light, twice, light_error, sensitivity_error, prior, family
        As the options of ``spectrabox sample``.
    colour : (kind, text) or None
        Which of the options srgb, lab and xyz was given, and what it says.

    Raises
    ------
    InputError
        If an option or a file cannot be read.
    """
    response = named_spectra.relative_response(sensitivity, light, FINE_GRID)
    names, bands = named_spectra.named_curves(sensitivity)[2], len(response)
    white = signal_options.optional_numbers(measured.white, bands, "white")
    reflected = None
    if twice is not None:
        signal, error = signal_options.signal_and_noise(twice, bands, "twice")
        reflected = measurement_of_signal(response, signal, white, error)
    more = further_measurements(measured, sensitivity, response, white)
    noise = signal_options.optional_noise(measured.noise, bands)
    origin = None
    if colour is not None:
        seen, rounding = signal_options.colour_signal(*colour, light)
        named, noise = {"": seen}, rounding if noise is None else noise
        white = np.ones(bands)      # a colour is relative to white
        stated = signal_options.srgb_values(colour[1]) if colour[0] == "srgb" \
            else signal_options.numbers(colour[1], bands, colour[0])
        origin = origin_of_colours(colour[0], stated)
    elif signals is not None:
        named = signal_options.read_named_signals(signals, names)
    else:
        named = {"": signal_options.numbers(measured.signal or "", bands, "signal")}
    return SignalCapture(response, np.array(list(named.values())), tuple(named), white, noise,
                         light_error, sensitivity_error,
                         mixture.of_families(mixture.load_prior(prior),
                                             tuple(family)), more, reflected, origin,
                         curve_caveats(stated_curve_error(sensitivity), sensitivity_error))


def stated_truth(file: Path, column: str | None) -> np.ndarray:
    """The measured reflectance (61,) of the surface.

    Parameters
    ----------
    file : Path
    column : str, optional
        Of the file.
    """
    table = spectrum_files.read_table(file)
    name = table.names[spectrum_files.column_index(table, column)]
    return spectrum_files.spectrum_on_grid(
        spectrum_files.spectrum_of(table, role=Quantity.REFLECTANCE, column=name),
        mixture.PRIOR_GRID)


# ---- the answers of ``spectrabox advise``: for a finished session or one signal ------------------

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
        return _answer(advise.advice_on_capture(finished.capture, finished.records, hand))
    if request.signal is not None:
        return _on_signal(request, hand)
    raise InputError("nothing to advise on: give the folder of a finished session, or a --signal "
                     "with --sensitivity and --light")


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
    white = signal_options.optional_numbers(request.white, bands, "white")
    noise = signal_options.optional_noise(request.noise, bands)
    base = measurement_of_signal(response,
                                 signal_options.numbers(request.signal or "", bands, "signal"),
                                 white, noise)
    taken = further_measurements(request, sensitivity, response, white)
    # so that the width is the one that ``sample`` states: by the same draws
    capture = SignalCapture(response, base.signal[None], ("",), np.ones(bands),
                            np.sqrt(np.diag(base.noise_covariance)), more=taken)
    [estimate] = sample_signals(capture, SampleOptions())
    each = advise.advice_on_signal(joined(base, taken), mixture.load_prior(), SampleOptions.level,
                            found=advise.stated_outlook(estimate),
                            curves=named_spectra.sensitivities(sensitivity, FINE_GRID),
                            present=named_spectra.light(light, FINE_GRID), hand=hand)
    facts, text = _answer(Advised(each), taken=[measured.name for measured in taken])
    caveats = unstated(white, noise)
    if caveats:
        facts["caveat"] = "\n".join(caveats)
    return facts, "\n".join([text, *caveats])


def _answer(advised: Advised, taken: Sequence[str] = ()) -> tuple[dict[str, Any], str]:
    """JSON object and text of lists."""
    facts = {**advised.facts, "taken": list(taken)}
    single = len(advised.by_surface) == 1
    lines = [_table(advised.overall, "what to do next")]
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


# ---- the picture of the spectra behind signals that ``spectrabox sample --plot`` writes ----------

SIZE_IN = (8.0, 4.5)


def write_plot(path: Path, estimates: Sequence[Estimate]) -> None:
    """Draw the mean and the band of every signal.

    Parameters
    ----------
    path : Path
        Ends in .png.
    estimates : sequence of Estimate
    """
    with style.context("default"):      # not as a matplotlibrc of the working folder has it
        figure = Figure(figsize=SIZE_IN, layout="constrained")
        axes, top = figure.add_subplot(), np.zeros(estimates[0].nm.size)
        for number, one in enumerate(estimates):
            nm, colour = one.nm, color_sequences["tab10"][number % 10]
            summary = one.summary
            assert summary is not None, "behind a signal the spectrum is estimated"
            top = np.maximum(top, summary.upper)
            axes.fill_between(nm, summary.lower, summary.upper, color=colour, alpha=0.25, lw=0)
            axes.plot(nm, one.mean, color=colour, lw=1.6,
                      label=one.name or f"mean and {summary.level:.0%} band")
        frame_reflectance(axes, nm, top)
        axes.legend(frameon=False, fontsize="small")
        with whole_file(path) as unfinished:
            FigureCanvasAgg(figure).print_png(str(unfinished))
