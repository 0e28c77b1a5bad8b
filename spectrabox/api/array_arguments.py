"""Arguments that are numbers, arrays or mappings, and nothing of ours: checked, or refused."""
from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.radiometry.errors import InputError


def as_numbers(given: ArrayLike, name: str) -> np.ndarray:
    """An array of numbers.

    Parameters
    ----------
    given : array
    name : str
        What it is, for the message.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        if np.iscomplexobj(given):
            raise TypeError
        return np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        shown = repr(given) if isinstance(given, str) else type(given).__name__
        raise InputError(f"{name}: {shown} is no array of numbers") from None


def as_number(given: float, name: str) -> float:
    """A number.

    Parameters
    ----------
    given : float
    name : str
        What it is, for the message.

    Raises
    ------
    InputError
        If it is none.
    """
    number = as_numbers(given, name)
    if number.ndim:
        raise InputError(f"{name}: {given!r} is no number")
    return float(number)


def as_code_values(given: ArrayLike, name: str) -> tuple[np.ndarray, bool]:
    """sRGB code values (..., 3), 0 to 1, and whether they are rounded to 8 bits.

    Parameters
    ----------
    given : (..., 3) array or str
        Unsigned 8-bit integers, or integers 0 to 255; numbers from 0 to 1; or "#rrggbb".
    name : str
        What it is, for the message.

    Raises
    ------
    InputError
        If it is none of these.
    """
    if isinstance(given, str) and re.fullmatch("#[0-9a-fA-F]{6}", given):
        return np.frombuffer(bytes.fromhex(given[1:]), np.uint8) / 255, True
    values = as_numbers(given, name)
    whole = np.asarray(given).dtype
    most = np.iinfo(np.uint16).max if whole == np.uint16 else 255 if whole.kind in "ui" else 1
    if values.shape[-1:] != (3,) or not values.size or not np.all((values >= 0)
                                                                  & (values <= most)):
        raise InputError(f"{name}: sRGB code values of shape {values.shape} and type {whole} were "
                         "given; give R, G, B as integers from 0 to 255, as numbers from 0 to 1, "
                         "or '#rrggbb'")
    return values / most, most == 255


def as_wavelengths(nm: ArrayLike, name: str) -> np.ndarray:
    """Wavelengths (Q,) in nm.

    Parameters
    ----------
    nm : (Q,) array
    name : str
        Of the argument.

    Raises
    ------
    InputError
        If it is no list of two wavelengths or more.
    """
    wavelengths = as_numbers(nm, name)
    if wavelengths.ndim != 1 or wavelengths.size < 2 or not np.all(wavelengths > 0):
        raise InputError(f"{name} of shape {wavelengths.shape} was given; give wavelengths (Q,) in "
                         "nm")
    return wavelengths


def require_mapping(given: object, argument: str, form: str) -> None:
    """Refuse what is no mapping, such as a list or a name by itself.

    Parameters
    ----------
    given : object
        None where it was left out.
    argument, form : str
        What it is called, and what it should be.

    Raises
    ------
    InputError
    """
    if given is not None and not isinstance(given, Mapping):
        raise InputError(f"{argument}= is a mapping, {form}; {type(given).__name__} was given")
