"""What the options of ``spectrabox sample`` say was measured, as a capture."""
from __future__ import annotations

import numpy as np

from spectrabox.measure.signals.estimate import SignalCapture
from spectrabox.measure.signals.sample import measurement_of_signal
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.spectrum_files import (
    column_index,
    read_table,
    spectrum_of,
    spectrum_on_grid,
)
from spectrabox.sampling.further.swatch_files import read_swatches
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior, of_families
from spectrabox.session.commands.requests import OBSERVER, SampleRequest
from spectrabox.session.signals.measurement_file import further_measurements
from spectrabox.session.signals.signal_options import (
    numbers,
    optional_noise,
    optional_numbers,
    read_named_signals,
    signal_and_noise,
    srgb_signal,
)

SRGB_CAVEAT = ("an sRGB colour is what a camera's processing or a designer made: these are spectra "
               "of surfaces that would look so in daylight, not of what was photographed")


def signal_capture(request: SampleRequest) -> SignalCapture:
    """Signals and what is stated of them, read from options and files.

    Raises
    ------
    InputError
        If options do not go together, or a file cannot be read.
    """
    if [request.signal, request.signals, request.srgb].count(None) != 2:
        raise InputError("give one of --signal V1,V2,V3, --signals FILE.csv and --srgb R,G,B")
    if request.signals is not None and (request.truth or request.signal_under or request.same
                                        or request.more or request.twice):
        raise InputError("a truth and further measurements belong to one surface; give its "
                         "--signal, not --signals")
    sensitivity, light = request.sensitivity or OBSERVER, request.light or "D65"
    response = named_spectra.relative_response(sensitivity, light, FINE_GRID)
    bands = len(response)
    white = optional_numbers(request.white, bands, "white")
    twice = None
    if request.twice is not None:
        twice_signal, twice_noise = signal_and_noise(request.twice, bands, "twice")
        twice = measurement_of_signal(response, twice_signal, white, twice_noise)
    more = further_measurements(request, sensitivity, response, white)
    noise = optional_noise(request.noise, bands)
    if request.srgb is not None:
        colour, rounding = srgb_signal(request.srgb)
        named, noise = {"": colour}, rounding if noise is None else noise
    elif request.signals is not None:
        named = read_named_signals(request.signals, bands)
    else:
        named = {"": numbers(request.signal or "", bands, "signal")}
    return SignalCapture(
        response, np.array(list(named.values())), tuple(named), white, noise, request.light_error,
        request.sensitivity_error, of_families(load_prior(request.prior), request.family), more,
        twice, None if request.swatches is None else read_swatches(request.swatches, bands),
        None if request.srgb is None else SRGB_CAVEAT)


def stated_truth(request: SampleRequest) -> np.ndarray | None:
    """The measured reflectance (61,) of the surface; None where none is given."""
    if request.truth is None:
        return None
    table = read_table(request.truth)
    column = table.names[column_index(table, request.column)]
    return spectrum_on_grid(spectrum_of(table, role=Quantity.REFLECTANCE, column=column),
                            PRIOR_GRID)
