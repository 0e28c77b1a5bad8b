"""Units of a spectral file's axis and values, as header cells, unit rows and preambles state them.

An axis is brought to nm by its unit alone: frequencies, wavenumbers and photon energies become
vacuum wavelengths; no refractive index of air is applied. A unit that is stated and not understood
is returned as it stands, so that the reader can refuse it by its name.
"""
from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

from spectrabox.radiometry.errors import InputError

SPEED_OF_LIGHT_NM_THZ = 299_792.458     # c, exact in SI
PLANCK_EV_NM = 1_239.841984             # h c / e (CODATA 2018)

TO_NM: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "nm": lambda axis: axis, "um": lambda axis: axis * 1e3, "mm": lambda axis: axis * 1e6,
    "m": lambda axis: axis * 1e9, "angstrom": lambda axis: axis / 10,
    "cm-1": lambda axis: 1e7 / axis, "Hz": lambda axis: SPEED_OF_LIGHT_NM_THZ * 1e12 / axis,
    "GHz": lambda axis: SPEED_OF_LIGHT_NM_THZ * 1e3 / axis,
    "THz": lambda axis: SPEED_OF_LIGHT_NM_THZ / axis,
    "PHz": lambda axis: SPEED_OF_LIGHT_NM_THZ / 1e3 / axis,
    "eV": lambda axis: PLANCK_EV_NM / axis, "meV": lambda axis: 1e3 * PLANCK_EV_NM / axis}
AXIS_WORDS = {
    "nm": "nm", "nanometer": "nm", "nanometers": "nm", "nanometre": "nm", "nanometres": "nm",
    "um": "um", "micron": "um", "microns": "um", "micrometer": "um", "micrometers": "um",
    "micrometre": "um", "micrometres": "um", "mm": "mm", "m": "m", "meters": "m", "metres": "m",
    "a": "angstrom", "å": "angstrom", "angstrom": "angstrom", "angstroms": "angstrom",
    "ångström": "angstrom", "ångstrom": "angstrom", "angström": "angstrom",
    "angstroem": "angstrom", "cm-1": "cm-1",
    "1/cm": "cm-1", "/cm": "cm-1", "cm^-1": "cm-1", "cm^(-1)": "cm-1", "cm**-1": "cm-1",
    "cm⁻¹": "cm-1", "cm⁻1": "cm-1", "cm−1": "cm-1", "cm–1": "cm-1", "inverse cm": "cm-1",
    "reciprocal centimeters": "cm-1", "reciprocal centimetres": "cm-1", "kayser": "cm-1",
    "kaysers": "cm-1", "wavenumber": "cm-1", "wavenumbers": "cm-1", "hz": "Hz", "hertz": "Hz",
    "ghz": "GHz", "gigahertz": "GHz", "thz": "THz", "terahertz": "THz", "phz": "PHz",
    "petahertz": "PHz", "ev": "eV", "electronvolt": "eV", "electronvolts": "eV",
    "electron volts": "eV", "mev": "meV"}
SHORT = {"a", "m"}              # a unit in brackets alone: elsewhere they are words
WAVELENGTH = re.compile(r"(?:wave|wvl|wl\b|wl_|lambda|λ|nm\b|nanomet|micromet|micron\b|frequency"
                        r"|energy|photon energy)", re.IGNORECASE)
IS_WAVELENGTH = re.compile(r"wave(?!\s*n)|wvl|wl\b|wl_|lambda|λ|nm\b", re.IGNORECASE)
# what a wavelength may be said to be measured in without a unit
MEDIA = {"air", "in air", "vac", "vacuum", "in vacuum"}
# Axes that are no wavelengths, as whole header cells.
OTHER_AXES = {"pixel", "pixels", "pixel number", "channel", "channels", "time", "seconds",
              "temperature", "angle", "m/z", "2theta", "frequency", "energy", "photon energy"}
BRACKETS = re.compile(r"[(\[{]\s*([^()\[\]{}]*(?:\([^()]*\))?[^()\[\]{}]*?)\s*[)\]}]")

PERCENT, FRACTION, COUNTS, RELATIVE = "percent", "1", "counts", "relative"
VALUE_WORDS = {
    "%": PERCENT, "percent": PERCENT, "per cent": PERCENT, "pct": PERCENT, "percentage": PERCENT,
    "0-100": PERCENT, "0..100": PERCENT, "0 to 100": PERCENT, "0–100": PERCENT,
    "1": FRACTION, "fraction": FRACTION, "0-1": FRACTION, "0..1": FRACTION, "0 to 1": FRACTION,
    "unitless": FRACTION, "dimensionless": FRACTION, "ratio": FRACTION, "counts": COUNTS,
    "count": COUNTS, "cts": COUNTS,
    "dn": COUNTS, "digital number": COUNTS, "digital numbers": COUNTS, "adu": COUNTS,
    "a.u.": RELATIVE, "a.u": RELATIVE, "au": RELATIVE, "arb. units": RELATIVE, "arb": RELATIVE,
    "arb.": RELATIVE, "arb. u.": RELATIVE, "arbitrary": RELATIVE, "arbitrary units": RELATIVE,
    "relative": RELATIVE, "rel.": RELATIVE}
# Units in brackets of a column's name that are units, though none of a spectrum that is wanted here
OTHER_UNITS = re.compile(r"mol|photon|‰|per ?mille?|pp[mb]\b|absorb|\babs\b|log"
                         r"|^(?:[mu]?v|lux|lx|db|od|cd|w|lm|k|nit)\b", re.IGNORECASE)
QUANTITIES = ("reflectance", "transmittance", "absorbance", "irradiance", "radiance",
              "absorptance")
SYNONYMS = {"transmission": "transmittance", "reflection": "reflectance", "reflect.":
            "reflectance", "reflectivity": "reflectance", "spectral irradiance": "irradiance",
            "absolute irradiance": "irradiance", "spectral radiance": "radiance",
            "spectral reflectance": "reflectance", "log(1/r)": "absorbance",
            "kubelka-munk": "kubelka-munk"}
POWER = {"w": 1.0, "watt": 1.0, "watts": 1.0, "mw": 1e-3, "uw": 1e-6, "nw": 1e-9, "uwatt": 1e-6,
         "mwatt": 1e-3, "kw": 1e3}
# spectral flux of a lamp, without an area or an angle: the shape of its spectrum
FLUX = re.compile(rf"(?:{'|'.join(POWER)})(?:(?: |/| / | per )nm(?:\^?-1)?)?")
AREAS = {"m": 1.0, "cm": 1e4, "mm": 1e6}
STEPS = {"nm": 1.0, "um": 1e-3, "a": 10.0}


def to_nm(axis: np.ndarray, unit: str) -> np.ndarray:
    """Wavelengths in nm of an axis (P,) in one of the units of ``TO_NM``; NaN where it is not
    positive.
    """
    with np.errstate(over="ignore"):
        return np.round(TO_NM[unit](np.where(axis > 0, axis, np.nan)), 9)


def axis_in_nm(axis: np.ndarray, stated: str | None, said: str | None,
               name: str) -> np.ndarray:
    """As ``to_nm``, by the unit that a file states, else by what is said of it, else in nm.

    Parameters
    ----------
    axis : (P,) array
    stated : str or None
        Of ``TO_NM``.
    said : str or None
        What the caller says of a file that states none, or none that is understood.
    name : str
        Of the file, for errors.

    Raises
    ------
    InputError
        If the two contradict each other.
    """
    if stated is not None and said not in (None, stated):
        raise InputError(f"{name} states its wavelength axis in {stated}; it cannot be read in "
                         f"{said}: leave --unit {said} out")
    return to_nm(axis, stated or said or "nm")


def remedy(unit: str) -> str:
    """How a person says what a file does not state."""
    return f"spectrabox spectrum convert FILE --unit {unit} -o NEW.csv"


def said_units(words: Sequence[str]) -> tuple[str | None, str | None]:
    """The unit of an axis and that of values that a person says; None of what is not said.

    Parameters
    ----------
    words : sequence of str
        Such as "percent", "1/cm" or "uW/cm2/nm".

    Raises
    ------
    InputError
        If one is not understood, or two are said of the same.
    """
    axis: str | None = None
    values: str | None = None
    for word in words:
        of_axis, of_values = axis_unit(word), _value_unit(_plain(word))
        if of_axis is None and (of_values is None or value_factor(of_values) is None):
            raise InputError(f"the unit {word!r} is not understood; of wavelengths "
                             f"{', '.join(TO_NM)} are, of values {PERCENT}, fraction, {RELATIVE} "
                             "and those of light, such as uW/cm2/nm")
        if (axis if of_axis else values) not in (None, of_axis or of_values):
            raise InputError(f"two units are said of {'the axis' if of_axis else 'the values'}: "
                             f"{' and '.join(words)}")
        axis, values = (of_axis, values) if of_axis else (axis, of_values)
    return axis, values


def axis_unit(text: str) -> str | None:
    """The unit of ``TO_NM`` that a text names; None where it names none that is understood."""
    return AXIS_WORDS.get(_plain(text).strip(" .,:;"))


def stated_axis(text: str, *, is_unit: bool = False) -> tuple[str | None, str | None]:
    """The unit of an axis that a header cell or a line "X Units: ..." states, and what it states
    that is not understood; both None where it states no unit.

    Parameters
    ----------
    text : str
        Such as "Wavelength (Angstrom)", "wavelength_nm", "Frequency [THz]" or "cm-1".
    is_unit : bool
        The text stands where a unit is stated, so that an unknown word is one.
    """
    plain = _plain(text)
    if not plain:
        return None, None
    if "raman" in plain or "shift" in plain:
        return None, " ".join(text.split())
    in_brackets = [found for found in BRACKETS.findall(text) if found]
    if in_brackets:
        stated = in_brackets[-1]
        if (unit := axis_unit(stated)) is not None:
            return unit, None
        if _plain(stated) not in MEDIA:
            return None, stated
        text = BRACKETS.sub(" ", text)
        plain = _plain(text)
    known = axis_unit(plain)
    if known is not None and plain not in SHORT | {"wavenumber", "wavenumbers"}:
        return known, None
    for word, unit in sorted(AXIS_WORDS.items(), key=lambda item: -len(item[0])):
        if word not in SHORT and re.search(rf"[\s_/,:;.\-]{re.escape(word)}$", plain):
            return unit, None
    if plain in OTHER_AXES:
        return None, " ".join(text.split())
    if known is not None:
        return known, None
    if is_unit and not WAVELENGTH.match(plain):
        return None, " ".join(text.split())
    return None, None


def stated_values(text: str, *, is_unit: bool = False) -> tuple[str | None, str | None]:
    """The quantity and the unit of a column that its header cell, its cell of the unit row or a
    line "Y Units: ..." states; None of what it does not state.

    Parameters
    ----------
    text : str
        Such as "Reflectance (percent)", "Reflect. %", "[counts]" or "uW/cm2/nm".
    is_unit : bool
        The text stands where a unit is stated, so that an unknown word is one.
    """
    plain = _plain(text)
    stated = [found for found in BRACKETS.findall(plain) if found]
    name = re.sub(r"\s+", " ", BRACKETS.sub(" ", plain).strip(" ,:;_"))
    unit: str | None = None
    for candidate in [*reversed(stated), *([plain.strip("[](){} ")] if is_unit else [])]:
        unit = _value_unit(candidate)
        if unit is not None:
            break
        if OTHER_UNITS.search(candidate) and candidate not in QUANTITIES and (
                is_unit or candidate != plain):
            unit = candidate
            break
    name, in_name = _without_percent(name)
    unit = unit or (PERCENT if in_name else None)
    if unit is None and re.search(r"(?:^|[\s.])dn\b", name):
        unit = COUNTS
    quantity = SYNONYMS.get(name, name if name in QUANTITIES else None)
    if is_unit and unit is None and quantity is None and plain.strip("[](){} "):
        unit = text.strip("[](){} ")
    return quantity, unit


def light_unit(unit: str) -> tuple[str, float] | None:
    """Whether a unit is of irradiance or radiance, and its factor to SI per nm; None of others.

    Parameters
    ----------
    unit : str
        Such as "W m-2 nm-1", "uW/cm^2/nm" or "µWatt/cm²/nm".
    """
    text = re.sub(r"[()\[\]]", "", _plain(unit)).replace("²", "2").replace("⁻", "-")
    text = re.sub(r"\bper\b", "/", text.replace("¹", "1").replace("**", "^"))
    parts = [part for part in re.split(r"[\s/*·.]+", text) if part]
    if not parts or parts[0] not in POWER:
        return None
    factor, kinds = POWER[parts[0]], []
    for part in parts[1:]:
        match = re.fullmatch(r"(cm|mm|m|sr|nm|um|a)\^?(-?\d)?", part)
        if match is None:
            return None
        base, power = match[1], abs(int(match[2] or 1))
        if base in AREAS and power == 2:
            factor *= AREAS[base]
            kinds.append("area")
        elif base == "sr" and power == 1:
            kinds.append("sr")
        elif base in STEPS and power == 1:
            factor *= STEPS[base]
            kinds.append("step")
        else:
            return None
    if sorted(kinds) == ["area", "step"]:
        return "irradiance", factor
    return ("radiance", factor) if sorted(kinds) == ["area", "sr", "step"] else None


def value_factor(unit: str) -> float | None:
    """Factor of values in a unit to fractions of 1 or SI per nm; None of a unit that is not known.
    """
    if unit.strip() in (FRACTION, RELATIVE):
        return 1.0
    if VALUE_WORDS.get(_plain(unit)) == PERCENT:
        return 0.01
    light = light_unit(unit)
    return None if light is None else light[1]


def _value_unit(text: str) -> str | None:
    plain = re.sub(r"\s+", " ", text.strip(" .")) or text
    if plain in VALUE_WORDS or text in VALUE_WORDS:
        return VALUE_WORDS.get(plain, VALUE_WORDS.get(text))
    if light_unit(plain) is not None:
        return plain
    if FLUX.fullmatch(plain):
        return RELATIVE
    name, is_percent = _without_percent(plain)
    return PERCENT if is_percent and (name in SYNONYMS or name in QUANTITIES or name in (
        "", "r", "t")) else None


def _without_percent(name: str) -> tuple[str, bool]:
    """A name without the sign or the word of per cent at its start or end, and whether it had."""
    match = re.fullmatch(r"(?:(%|percent\b|per cent\b)[\s_]*)?(.*?)(?:[\s_]*(%|[\s_]percent|"
                         r"[\s_]per cent|[\s_]pct))?", name)
    if match is None or not (match[1] or match[3]):
        return name, False
    return match[2].strip(" _,"), True


def _plain(text: str) -> str:
    return re.sub(r"\s+", " ", text.strip().lower().replace("µ", "u").replace("μ", "u"))
