"""What an instrument computed from its own spectrum, held against the spectrum that it sent.

Luminance, chromaticity, power and mean wavelength weigh a spectrum differently: a spectrum that was
shifted, reversed, cut or scaled on its way agrees with some of them and not with the others.

Tolerances: over 181 measured lamps (gas discharges included) seen through 5 and 8 nm wide bands,
sums over grids of 2 and 4 nm differ from those over 1 nm by at most 0.3 % in luminance, and by
0.0003 in x and y where the band is as wide as an instrument's of that step; 0.001 at worst.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.capture.meter.instruments.instrument_errors import UntrustedReadingError
from spectrabox.radiometry import appearance, grid

LUMINANCE_RTOL = 0.01           # up to 4 nm
LUMINANCE_PER_NM = 0.003        # of a wider step: 3 % at 10 nm
POWER_RTOL = 0.01
CHROMATICITY_PER_NM = 0.0005    # of the grid's step: 0.0005 at 1 nm, 0.002 at 4 nm
MEAN_PER_NM = 0.5               # of the grid's step: less than a shift by one channel
PHOTON_J_NM = 1.98644586e-16    # h c: energy of a photon times its wavelength
STUCK_VALUES = 12               # in a row: no light is the same to four digits over so many bands
STUCK_LEVEL = 0.01              # of the largest value; below, digits may run out
ADVICE = "measure again, and check the instrument's observer (2 degrees) and units (SI)"


# a number as an instrument prints it, and its rounding: half a unit of its last digit
Printed = tuple[float, float]


@dataclass(frozen=True)
class Stated:
    """Figures of a spectrum as the instrument states them; None where it states none."""

    luminance: Printed | None = None        # cd m-2, or lx
    x: Printed | None = None                # chromaticity, CIE 1931 2 degrees
    y: Printed | None = None
    power: Printed | None = None            # W m-2 sr-1, or W m-2
    mean_nm: Printed | None = None          # of the wavelength, each weighted by its power


def printed(text: str) -> Printed:
    """A number with the rounding of its digits: "1.83e+00" is 1.83 within 0.005.

    Parameters
    ----------
    text : str
        A decimal number, already known to be one.
    """
    mantissa, _, exponent = text.strip().lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return float(text), 0.5 * 10.0 ** (int(exponent or 0) - decimals)


def stated_by_xyz(cells: Sequence[str], power: Printed | None = None,
                  mean_nm: Printed | None = None) -> Stated:
    """Figures of a spectrum from X, Y and Z as an instrument prints them.

    Parameters
    ----------
    cells : sequence of three str
        Y in cd m-2 or lx.
    power, mean_nm : Printed, optional
    """
    values, roundings = zip(*(printed(cell) for cell in cells), strict=True)
    luminance, total = (values[1], roundings[1]), sum(values)
    if total <= 0:
        return Stated(luminance, power=power, mean_nm=mean_nm)
    # x = X / (X + Y + Z): its own rounding, and that of the sum times x, which is below 1
    rounding = (max(roundings) + sum(roundings)) / total
    x, y = ((value / total, rounding) for value in values[:2])
    return Stated(luminance, x, y, power, mean_nm)


def mean_wavelength(power: Printed, photons: Printed) -> Printed | None:
    """Mean wavelength of a light from its power in W and its photons per second.

    None where the two cannot be of one visible light: the instrument counts in another unit.

    Parameters
    ----------
    power, photons : Printed
    """
    watts, rounding = power
    count, rounding_of_count = photons
    if watts <= 0 or count <= 0:
        return None
    mean = count * PHOTON_J_NM / watts
    relative = rounding / watts + rounding_of_count / count
    return (mean, mean * relative) if 100 < mean < 3000 else None


def check_stated(nm: np.ndarray, values: np.ndarray, stated: Stated, name: str) -> None:
    """Refuse a spectrum from which the instrument cannot have computed its figures.

    Parameters
    ----------
    nm, values : (P,) arrays
        W m-2 sr-1 nm-1, or W m-2 nm-1.
    stated : Stated
    name : str
        Of the line, for errors.

    Raises
    ------
    UntrustedReadingError
        If luminance, chromaticity, power or mean wavelength do not agree, or if many values in a
        row are one number.
    """
    _refuse_stuck(nm, values, name)
    step = float(np.diff(nm).max())
    xyz = appearance.tristimulus_of(nm, values)
    # Some instruments weigh the first and last value by half, some do not.
    sums = [weights * values for weights in (grid.trapezoid_weights_nm(nm), step)]
    powers = [float(part.sum()) for part in sums]

    def compare(what: str, ours: list[float], theirs: Printed, tolerance: float, form: str,
                unit: str = "") -> None:
        value, rounding = theirs
        allowed = tolerance + rounding
        if not min(ours) - allowed <= value <= max(ours) + allowed:
            raise UntrustedReadingError(
                f"{name}: the spectrum's {what} is {ours[0]:{form}}{unit}, the instrument reports "
                f"{value:{form}}; they must agree within {allowed:.2g}: {ADVICE}")
    if stated.luminance is not None:
        compare("luminance", [float(xyz[1])], stated.luminance,
                max(LUMINANCE_RTOL, LUMINANCE_PER_NM * step if step > 4 else 0.0)
                * abs(stated.luminance[0]), ".4g", " cd/m2 (or lx)")
    if xyz.sum() > 0:
        for axis, theirs, index in (("x", stated.x, 0), ("y", stated.y, 1)):
            if theirs is not None:
                compare(f"chromaticity {axis}", [float(xyz[index] / xyz.sum())], theirs,
                        CHROMATICITY_PER_NM * step, ".4f")
    if stated.power is not None:
        compare("sum", powers, stated.power, POWER_RTOL * abs(stated.power[0]), ".4g",
                " W/m2 (or W/m2/sr)")
    if stated.mean_nm is not None and min(powers) > 0:
        compare("mean wavelength", [float(nm @ part / part.sum()) for part in sums],
                stated.mean_nm, MEAN_PER_NM * step, ".1f", " nm")


def _refuse_stuck(nm: np.ndarray, values: np.ndarray, name: str) -> None:
    changes = np.flatnonzero(np.diff(values)) + 1
    starts, ends = np.append(0, changes), np.append(changes, values.size)
    for start, end in zip(starts, ends, strict=True):
        if end - start >= STUCK_VALUES and values[start] > STUCK_LEVEL * values.max():
            raise UntrustedReadingError(
                f"{name}: {end - start} values in a row, from {nm[start]:g} nm, are the same "
                f"{values[start]:.4g}, which no light is; measure again, and have the instrument "
                "looked at")
