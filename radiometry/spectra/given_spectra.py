"""Spectra as callers hold them: files, numbers, arrays, spectra of colour-science, records."""
from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra import spectrum_files


class ColourScienceSpectra(Protocol):
    """A SpectralDistribution of colour-science, or several of one grid (MultiSpectralDistributions)
    """

    @property
    def wavelengths(self) -> Any:
        """(Q,) in nm."""

    @property
    def values(self) -> Any:
        """(Q,), or (Q, K) of several."""


# wavelengths (Q,) in nm and values (Q,) or (K, Q), or a spectrum of colour-science
Curves = tuple[ArrayLike, ArrayLike] | ColourScienceSpectra
# one number for all wavelengths may come with its standard error
KnownSpectrum = str | Path | float | tuple[float, float] | Spectrum | Curves


def typed_reflectance(word: str) -> tuple[float, ...]:
    """A reflectance as people type it, 0.94 or 94%, and its standard error, if "+-" says one.

    Raises
    ------
    ValueError
        If it is none.
    """
    parts = [part.strip() for part in word.replace("±", "+-").split("+-", 1)]
    return tuple(float(part[:-1]) / 100 if part.endswith("%") else float(part) for part in parts)


def as_samples(given: object, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths (Q,) and values (Q,) or (K, Q) of arrays, or of a spectrum of colour-science.

    Parameters
    ----------
    given : (nm, values), SpectralDistribution or MultiSpectralDistributions
    name : str
        What it is of, for the message.

    Raises
    ------
    InputError
        If it is none of these, or its shapes do not go together.
    """
    if hasattr(given, "wavelengths") and hasattr(given, "values"):
        parts: Any = (given.wavelengths, np.asarray(given.values).T)
    else:
        parts = given
    try:
        nm, values = (np.asarray(part, dtype=float) for part in parts)
    except (TypeError, ValueError):
        raise InputError(f"{name}: {type(given).__name__} is no spectrum; give a file, "
                         "wavelengths and values (nm, values), or a SpectralDistribution of "
                         "colour-science") from None
    if nm.ndim != 1 or values.shape[-1:] != nm.shape or nm.size < 2 or np.any(np.diff(nm) <= 0):
        raise InputError(f"{name}: wavelengths of shape {nm.shape} and values of shape "
                         f"{values.shape} were given; wavelengths rise, and each has one value")
    return nm, values


def as_reflectance(known: KnownSpectrum, name: str) -> np.ndarray:
    """A known reflectance (P,) on the working grid, as of ``as_known``."""
    return as_known(known, name).values


def as_known(known: KnownSpectrum, name: str) -> Spectrum:
    """A known reflectance on the working grid, with its standard error if one is stated: a number,
    (number, its standard error), a file, a spectrum, or (nm, values).

    Parameters
    ----------
    known : float, (float, float), str, Path, Spectrum or (nm, values)
    name : str
        Of the surface, for messages.

    Raises
    ------
    InputError
        If the file cannot be read, the values do not cover the grid, a spectrum is no reflectance,
        or a number is no fraction of 1.
    """
    if isinstance(known, Spectrum):
        if known.quantity is not Quantity.REFLECTANCE:
            raise InputError(f"{name} is given as {known.quantity.name.lower()}; a reflectance is "
                             "needed")
        return _on_working_grid(known)
    if isinstance(known, str | Path):
        return _on_working_grid(spectrum_files.read_spectrum(Path(known),
                                                             role=Quantity.REFLECTANCE))
    numbers = known if isinstance(known, tuple) else (known,)
    if all(isinstance(number, int | float) for number in numbers):
        for number in numbers:
            spectrum_files.require_fraction(number, name)      # type: ignore[arg-type]
        value, *error = (np.full(FINE_GRID.nm.size, number, float) for number in numbers)
        return Spectrum(FINE_GRID, value, Quantity.REFLECTANCE, "given", *error)
    nm, values = as_samples(known, name)
    on_working_grid = spectrum_files.on_grid(nm, values, FINE_GRID, "reflectance")
    spectrum_files.check_reflectance(on_working_grid, FINE_GRID.nm, name)
    return Spectrum(FINE_GRID, on_working_grid, Quantity.REFLECTANCE, "given")


def _on_working_grid(known: Spectrum) -> Spectrum:
    """The same at every wavelength of the working grid, which it must cover."""
    values, error = spectrum_files.spectrum_on_grid(known, FINE_GRID), known.standard_error
    return Spectrum(FINE_GRID, values, known.quantity, known.source, None if error is None
                    else np.interp(FINE_GRID.nm, known.grid.nm, error))


def as_reflectance_at(nm: np.ndarray, given: KnownSpectrum | ArrayLike, name: str) -> np.ndarray:
    """A reflectance at wavelengths (P,): as ``as_reflectance``, or an array (P,) of them.

    Parameters
    ----------
    nm : (P,) array
    given : as of ``as_reflectance``, or (P,) array
    name : str
        Of the surface, for messages.

    Raises
    ------
    InputError
        As ``as_reflectance``, or if an array has another number of values.
    """
    if isinstance(given, np.ndarray | list):
        values = np.asarray(given, dtype=float)
        if values.shape != nm.shape:
            raise InputError(f"{name}: {values.shape} values were given for the {nm.size} "
                             f"wavelengths from {nm[0]:g} to {nm[-1]:g} nm; give one for each, or "
                             "(nm, values)")
        spectrum_files.check_reflectance(values, nm, name)
        return values
    return np.interp(nm, FINE_GRID.nm, as_reflectance(given, name))   # type: ignore[arg-type]
