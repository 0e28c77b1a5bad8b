"""What an operator says of a light: a file, a CIE name, a kind of lamp, 3200K, or "unknown"."""
from __future__ import annotations

from pathlib import Path

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import names_a_file
from spectrabox.radiometry.records import Quantity, Spectrum, UnknownLight, WavelengthGrid
from spectrabox.radiometry.spectra.light_words import LIGHT_KINDS, UNKNOWN, vague_words
from spectrabox.radiometry.spectra.named_spectra import light as named_light
from spectrabox.radiometry.spectra.spectrum_files import read_spectrum


def stated_light(word: str, grid: WavelengthGrid) -> Spectrum | UnknownLight:
    """The light that a word of the command line means.

    Parameters
    ----------
    word : str
        A spectral file, a CIE name, a temperature such as 3200K, a kind of lamp, or unknown.
    grid : WavelengthGrid
        Of the spectrum of a name.

    Raises
    ------
    InputError
        If there is neither such a file nor such a name.
    """
    vague = vague_light(word)
    if vague is not None:
        return vague
    return read_spectrum(Path(word), role=Quantity.RELATIVE) if names_a_file(word) else \
        spectrum_of_name(word, grid)


def spectrum_of_name(name: str, grid: WavelengthGrid) -> Spectrum:
    """The published spectrum of a CIE name.

    Parameters
    ----------
    name : str
    grid : WavelengthGrid

    Raises
    ------
    InputError
        If no published light has this name.
    """
    try:
        return Spectrum(grid, named_light(name, grid), Quantity.RELATIVE, f"CIE {name}")
    except InputError as error:
        raise InputError(f"{error}; a light may also be {UNKNOWN}, 3200K or one of "
                         f"{', '.join(LIGHT_KINDS)}") from None


def vague_light(word: str) -> UnknownLight | None:
    """What a word says of a light whose spectrum is not stated; None if the word states one.

    Parameters
    ----------
    word : str

    Raises
    ------
    InputError
        If it is a temperature that no lamp has.
    """
    stated = vague_words(word)
    return None if stated is None else UnknownLight(*stated)
