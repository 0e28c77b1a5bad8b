"""Exports of Sekonic and UPRTek light meters, read by colour-science.

Importing it takes seconds, which only these files cost. Both state irradiance, Sekonic in W and
UPRTek in mW, as the illuminance that they state beside it shows.
"""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats.measurement_table import SpectralTable, text_of

SEKONIC, UPRTEK = "Sekonic", "UPRTek"
UNITS = {SEKONIC: "W m-2 nm-1", UPRTEK: "mW m-2 nm-1"}
# What colour-science's readers raise on a damaged file, as far as they were driven to it.
DAMAGE = (ValueError, KeyError, IndexError, AttributeError, TypeError, AssertionError, OSError)


def is_sekonic(text: str) -> bool:
    """Whether text is the CSV of a Sekonic meter."""
    return "Spectral Data 380[nm]," in text


def is_uprtek(text: str) -> bool:
    """Whether text is a UPRTek meter's table, which its software calls .xls."""
    return text.lstrip("\ufeff").startswith("Model Name\t") and "\n380nm\t" in text.replace("\r",
                                                                                           "\n")


def read_sekonic(content: bytes, path: Path) -> SpectralTable:
    """The spectrum of a Sekonic file, at its 1 nm samples.

    Raises
    ------
    InputError
        If it is damaged.
    """
    return _read(content, path, SEKONIC,
                 lambda colour: colour.SpectralDistribution_Sekonic(str(path)))


def read_uprtek(content: bytes, path: Path) -> SpectralTable:
    """The spectrum of a UPRTek file.

    Raises
    ------
    InputError
        If it is damaged.
    """
    return _read(content, path, UPRTEK,
                 lambda colour: colour.SpectralDistribution_UPRTek(str(path)))


def _read(content: bytes, path: Path, maker: str,
          opened: Callable[[Any], Any]) -> SpectralTable:
    import colour  # takes a second

    text_of(content, path.name)     # raises where it is no text
    try:
        spectrum = opened(colour).read()
        nm, values = np.asarray(spectrum.wavelengths), np.asarray(spectrum.values)
        model = str(spectrum.header.measurement_equipment or maker)
    except DAMAGE as error:
        raise InputError(f"{path.name} is a {maker} file that colour-science cannot read "
                         f"({type(error).__name__}); export it again") from None
    facts = {"quantity": "irradiance", "unit": UNITS[maker],
             "source": f"{' '.join(model.split())}, {path.name}"}
    return SpectralTable(nm, ("value",), values[None], facts, path.name)
