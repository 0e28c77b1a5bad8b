"""Arguments that are numbers, arrays or mappings, and nothing of ours: checked, or refused."""
from __future__ import annotations

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
