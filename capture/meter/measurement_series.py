"""Repeats of one reading: mean, spread and drift; reflectance as the ratio of two series; readings
of several instruments made comparable.

Readings of several instruments made comparable, each by the calibration of its own instrument.

Two spectroradiometers of one model differ by some per cent, differently at every wavelength: a mean
or a ratio over both is a measurement by neither.
"""


from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.files import names_a_file
from spectrabox.radiometry.findings import Finding, Severity, each_once
from spectrabox.radiometry.grid import grid_from_nm, visible_grid
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra import given_spectra, spectrum_files
from spectrabox.radiometry.spectra.readings import ReadingOutcome, ReadingSeries, SpectralReading
from spectrabox.radiometry.system.words import known_name

POSSIBLE = (0.2, 5.0)       # a factor beyond is a spectrum of something else
Maker = tuple[str, str]     # model and serial number


# serial number of an instrument, and factors by which its readings become those of the common
# standard: unit 1, with their standard error where that is known
MeterCalibration = tuple[str, Spectrum]


def read_calibration(text: str) -> MeterCalibration:
    """A calibration as the operator names it, "65123456=pr655.csv".

    Parameters
    ----------
    text : str

    Raises
    ------
    InputError
        If it names no file, or the file holds no factors near 1.
    """
    serial_number, separator, file = text.partition("=")
    if not (separator and serial_number.strip() and file.strip()):
        raise InputError(f"the calibration {text!r} is not SERIAL=FILE, such as 65123456=pr655.csv")
    factor = spectrum_files.read_spectrum(Path(file.strip()), role=Quantity.RELATIVE)
    if factor.quantity is not Quantity.RELATIVE:
        raise InputError(f"{file} states {factor.quantity.name.lower()}; a calibration is a table "
                         "of factors ('# quantity: relative')")
    low, high = float(factor.values.min()), float(factor.values.max())
    if not POSSIBLE[0] <= low <= high <= POSSIBLE[1]:
        raise InputError(f"{file} holds factors from {low:.3g} to {high:.3g}; a calibration has "
                         f"factors near 1, {POSSIBLE[0]} to {POSSIBLE[1]}")
    return serial_number.strip(), factor


def makers_of(readings: Iterable[SpectralReading]) -> list[Maker]:
    """The instruments of readings that hold a spectrum, each once, in the order they were used.

    Parameters
    ----------
    readings : iterable of SpectralReading
    """
    return list(dict.fromkeys((reading.instrument, reading.serial_number) for reading in readings
                              if reading.spectrum is not None))


def require_comparable(makers: Sequence[Maker], calibrations: Sequence[MeterCalibration],
                       what: str) -> None:
    """Refuse to compare what different instruments read, unless each has its calibration.

    Parameters
    ----------
    makers : sequence of (model, serial number)
    calibrations : sequence of MeterCalibration
    what : str
        Was read, for errors.

    Raises
    ------
    InputError
        Also at a calibration for none of the instruments.
    """
    used = list(dict.fromkeys(makers))
    calibrated = [serial_number for serial_number, _ in calibrations]
    serials = [serial_number for _, serial_number in used]
    if foreign := [number for number in calibrated if number not in serials]:
        raise InputError(f"{what}: there is a calibration for {', '.join(foreign)}, but readings "
                         f"by {named(used)} only")
    distinct = len(set(serials)) == len(serials) and len(set(calibrated)) == len(calibrated)
    if len(used) > 1 and not (distinct and set(serials) == set(calibrated)):
        raise InputError(f"{what}: read by {named(used)}, and their calibrations differ, so that a "
                         "mean or a ratio is a measurement by neither: measure with one of them "
                         "(--again starts a new series), or give the calibration of each with "
                         "--calibration SERIAL=FILE")


def named(makers: Sequence[Maker]) -> str:
    """Instruments as a sentence lists them."""
    return " and ".join(f"{model} {serial_number}" for model, serial_number in makers)


def factors_at(nm: np.ndarray, calibrations: Sequence[MeterCalibration]) -> Mapping[
        str, tuple[np.ndarray, np.ndarray]]:
    """Factors (P,) and their standard errors (P,), zero where not known, by serial number.

    Parameters
    ----------
    nm : (P,) array
    calibrations : sequence of MeterCalibration

    Raises
    ------
    InputError
        If a calibration does not reach from the first to the last wavelength.
    """
    factors = {}
    for serial_number, factor in calibrations:
        if factor.grid.nm[0] > nm[0] or factor.grid.nm[-1] < nm[-1]:
            raise InputError(f"the calibration of {serial_number} covers "
                             f"{factor.grid.nm[0]:g}-{factor.grid.nm[-1]:g} nm; its readings cover "
                             f"{nm[0]:g}-{nm[-1]:g} nm")
        error = (np.zeros(nm.size) if factor.standard_error is None
                 else np.interp(nm, factor.grid.nm, factor.standard_error))
        factors[serial_number] = (np.interp(nm, factor.grid.nm, factor.values), error)
    return factors


# ---- repeats of one reading ----------------------------------------------------------------------

DRIFT_SIGMA = 3.0           # a drift counts where it exceeds its own error by this
DRIFT_RELATIVE = 0.005      # and is larger than this over the series
LOW_SIGNAL = 0.02           # of the standard's largest value: below, a ratio is mostly noise

NO_SPECTRUM = {
    ReadingOutcome.TOO_DARK: "no reading, the light is too weak for this instrument; bring more "
                             "light, a longer exposure or a wider aperture",
    ReadingOutcome.TOO_BRIGHT: "no reading, the light is too strong; use a shorter exposure, a "
                               "smaller aperture or a filter",
    ReadingOutcome.NO_SYNC: "no reading, the instrument could not lock to the light's flicker; "
                            "state its frequency, or switch sync off",
    ReadingOutcome.UNSTEADY: "no reading, the light changed during the measurement; let it warm "
                             "up, then repeat"}


def series_of(readings: Sequence[SpectralReading], name: str,
              calibrations: Sequence[MeterCalibration] = ()) -> ReadingSeries:
    """Mean, spread and drift of the readings that hold a spectrum.

    Parameters
    ----------
    readings : sequence of SpectralReading
        In the order they were taken.
    name : str
        Of what was measured, for errors.
    calibrations : sequence of MeterCalibration
        Of the instruments; needed, of each, where there are several.

    Raises
    ------
    CheckError
        If none holds a spectrum; the sentence is the reason of the last.
    InputError
        If the readings are of different quantities, grids, or instruments without calibration.
    """
    spectra = [reading.spectrum for reading in readings if reading.spectrum is not None]
    if not spectra:
        reason = NO_SPECTRUM[readings[-1].outcome] if readings else "nothing was measured yet"
        raise CheckError(f"{name}: {reason}")
    first = spectra[0]
    if any(s.quantity is not first.quantity or not np.array_equal(s.grid.nm, first.grid.nm)
           for s in spectra):
        raise InputError(f"{name}: the readings are of different quantities or wavelengths; start "
                         "a new series with --again")
    makers = [(reading.instrument, reading.serial_number) for reading in readings
              if reading.spectrum is not None]
    require_comparable(makers, [each for each in calibrations
                                if each[0] in {number for _, number in makers}], name)
    factors = factors_at(first.grid.nm, calibrations)
    unity = (np.ones(first.grid.nm.size), np.zeros(first.grid.nm.size))
    factor, factor_error = np.array([factors.get(serial_number, unity)
                                     for _, serial_number in makers]).swapaxes(0, 1)
    raw = np.array([spectrum.values for spectrum in spectra])
    values = raw * factor
    count = len(spectra)
    # readings of one instrument share its factor's error, those of two do not
    shared = {number: [other == number for _, other in makers] for _, number in makers}
    calibration_error = np.sqrt(sum((raw * factor_error)[of].sum(axis=0) ** 2
                                    for of in shared.values())) / count
    drift, drift_error = _relative_drift(values @ first.grid.weights_nm)
    spread = values.std(axis=0, ddof=1) if count > 1 else np.full(values.shape[1], np.nan)
    return ReadingSeries(first.grid, values.mean(axis=0), spread, drift, drift_error, count,
                         first.quantity, _findings(readings, drift, drift_error), calibration_error)


def series_spectrum(series: ReadingSeries, source: str) -> Spectrum:
    """The mean with its standard error, which is None for a single reading.

    Parameters
    ----------
    series : ReadingSeries
    source : str
        Stored with the spectrum.
    """
    error = None
    if series.readings > 1:
        error = np.hypot(series.spread / np.sqrt(series.readings), series.calibration_error)
    return Spectrum(series.grid, series.mean, series.quantity, source, error)


# Reflectance over 400-700 nm of clean standards without a certificate, and its standard error, by
# data sheets of their makers: sintered PTFE .985 to .993 and pressed barium sulphate .96 to .985.
WHITE_STANDARDS = {"PTFE": (0.99, 0.005), "Spectralon": (0.99, 0.005),
                   "barium sulphate": (0.975, 0.01)}


def white_standard(word: str | None) -> Spectrum:
    """What a white standard reflects, with its standard error.

    Parameters
    ----------
    word : str or None
        A name of ``WHITE_STANDARDS``; a reflectance such as 0.985, or 0.985+-0.005; a file of its
        certificate. None for PTFE.

    Raises
    ------
    InputError
        If it is none of these, or no reflectance of a white standard.
    """
    known = known_name(word or "PTFE", WHITE_STANDARDS)
    if known is not None:
        value, error = WHITE_STANDARDS[known]
        source = known if word else f"{known}, as nothing is stated"
    else:
        try:
            value, error = (*given_spectra.typed_reflectance(word or ""), 0.0)[:2]
        except ValueError:
            if names_a_file(word or ""):
                return spectrum_files.read_spectrum(Path(word or ""), role=Quantity.REFLECTANCE)
            value = error = np.nan
        if not (0.01 <= value <= 1.1 and 0 <= error < 0.5):
            raise InputError(f"--white-reflectance {word!r} is no white standard: give "
                             f"{', '.join(WHITE_STANDARDS)}, a reflectance such as 0.985 or "
                             "0.985+-0.005, or the file of its certificate")
        source = f"{value:g} as stated"
    grid = visible_grid(100)
    return Spectrum(grid, np.full(grid.nm.size, value), Quantity.REFLECTANCE, source,
                    np.full(grid.nm.size, error))


def reflectance_from(target: Spectrum, white: Spectrum, standard: Spectrum,
                     source: str) -> Spectrum:
    """Reflectance of a surface: its radiance over that of a white standard in the same position.

    Parameters
    ----------
    target, white : Spectrum
        Radiances of the surface and of the white standard, by one instrument in one position.
    standard : Spectrum
        Reflectance of the standard, of which the ends are carried on; its standard error is in
        that of every wavelength.
    source : str
        Stored with the spectrum.

    Raises
    ------
    InputError
        If the two do not share wavelengths and quantity.
    CheckError
        If the white is too dark somewhere between 400 and 700 nm.
    """
    if target.quantity is not white.quantity or not np.array_equal(target.grid.nm, white.grid.nm):
        raise InputError("the surface and the white standard were measured in different quantities "
                         "or wavelengths; measure both with the same instrument and settings")
    usable = white.values > LOW_SIGNAL * white.values.max()
    needed = (white.grid.nm >= 400) & (white.grid.nm <= 700)
    if not usable[needed].all():
        dark = white.grid.nm[needed & ~usable]
        raise CheckError(f"the white standard gives almost no light at {dark[0]:g} nm ({dark.size} "
                         "wavelengths between 400 and 700 nm below 2 % of its largest): a ratio "
                         "there is noise; use a light that covers 400-700 nm")
    keep = _run_around(usable, int(np.argmax(white.values)))
    nm, ratio = target.grid.nm[keep], target.values[keep] / white.values[keep]
    of_white = np.interp(nm, standard.grid.nm, standard.values)
    error = None        # of single readings, which do not tell their noise
    if target.standard_error is not None and white.standard_error is not None:
        known_to = 0 if standard.standard_error is None else np.interp(
            nm, standard.grid.nm, standard.standard_error)
        error = np.sqrt((of_white * target.standard_error[keep] / white.values[keep]) ** 2
                        + (of_white * ratio * white.standard_error[keep] / white.values[keep]) ** 2
                        + (ratio * known_to) ** 2)
    return Spectrum(grid_from_nm(nm), of_white * ratio, Quantity.REFLECTANCE,
                    f"{source}; white standard: {standard.source}", error)


def _run_around(usable: np.ndarray, index: int) -> slice:
    holes = np.flatnonzero(~usable)
    below, above = holes[holes < index], holes[holes > index]
    return slice(below[-1] + 1 if below.size else 0, above[0] if above.size else usable.size)


def _relative_drift(integrals: np.ndarray) -> tuple[float, float]:
    """Change over the whole series as a fraction of its mean, and its standard error."""
    count = integrals.size
    if count < 2 or integrals.mean() == 0:
        return float("nan"), float("nan")
    order = np.arange(count) - (count - 1) / 2
    slope = order @ integrals / (order @ order)
    scale = (count - 1) / integrals.mean()
    if count < 3:
        return float(slope * scale), float("nan")
    residual = integrals - integrals.mean() - slope * order
    error = np.sqrt(residual @ residual / (count - 2) / (order @ order))
    return float(slope * scale), float(abs(error * scale))


def _findings(readings: Sequence[SpectralReading], drift: float,
              error: float) -> tuple[Finding, ...]:
    empty = [reading.outcome for reading in readings if reading.spectrum is None]
    low_light = [ReadingOutcome.LOW_LIGHT.finding for reading in readings
                 if reading.outcome is ReadingOutcome.LOW_LIGHT]
    return each_once([
        *drifting(drift, error),
        *(Finding("meter.readings-empty", Severity.WARN, values={
            "empty": empty.count(outcome), "readings": len(readings), "outcome": outcome.value})
          for outcome in ReadingOutcome if outcome in empty),
        *(finding for reading in readings for finding in reading.findings), *low_light])


def drifting(drift: float, error: float) -> list[Finding]:
    """Light that changes over a series by more than chance and half a per cent.

    Parameters
    ----------
    drift : float
        Relative, over the whole series.
    error : float
        Its standard error; NaN where it is not known.
    """
    limit = max(DRIFT_RELATIVE, DRIFT_SIGMA * error)
    if not np.isfinite(error) or abs(drift) <= limit:
        return []
    return [Finding("meter.drift", Severity.WARN, values={
        "drift": drift, "error": error, "limit": limit})]
