"""Camera sensitivities and training spectra of rawtoaces, in JSON."""
from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats import measurement_table

UNITS = {"relative": ("relative", "relative"), "reflectance": ("reflectance", "1"),
         "irradiance": ("irradiance", "")}


def is_rawtoaces(text: str) -> bool:
    """Whether text is such a JSON object."""
    return text.lstrip().startswith("{") and '"spectral_data"' in text


def read_rawtoaces(content: bytes, path: Path) -> measurement_table.SpectralTable:
    """Every curve of the file, such as R, G and B.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.

    Raises
    ------
    InputError
    """
    try:
        document = json.loads(measurement_table.text_of(content, path.name))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path.name} is damaged JSON ({error}); copy it again") from None
    data = _at(document, "spectral_data", path.name)
    names = _at(_at(data, "index", path.name), "main", path.name, list)
    curves = _at(_at(data, "data", path.name), "main", path.name)
    try:
        points = sorted((float(nm), [float(value) for value in values])
                        for nm, values in curves.items())
    except (TypeError, ValueError, AttributeError, OverflowError):
        raise InputError(f"{path.name}: a wavelength or a value is not a number; copy the file "
                         "again") from None
    nm, rows = np.array([wavelength for wavelength, _ in points]), [row for _, row in points]
    if not rows or any(len(row) != len(names) for row in rows) or not np.all(np.isfinite(rows)):
        raise InputError(f"{path.name}: every wavelength should hold {len(names)} numbers "
                         f"({str(names)[:60]}); copy it again")
    header = document.get("header") if isinstance(document.get("header"), dict) else {}
    source = " ".join(str(header[key]) for key in ("manufacturer", "model", "description")
                      if header.get(key))
    quantity, unit = UNITS.get(str(data.get("units")).lower(), ("", ""))
    facts = {"source": " ".join(source.split()) or path.name,
             **({"quantity": quantity} if quantity else {}), **({"unit": unit} if unit else {})}
    return measurement_table.SpectralTable(
        nm, measurement_table.distinct([str(name) for name in names]),
        np.array(rows).T, facts, path.name)


def _at(value: Any, key: str, name: str, kind: type = dict) -> Any:
    if not isinstance(value, dict) or not isinstance(value.get(key), kind):
        raise InputError(f"{name} has no {key!r} of the kind that rawtoaces writes; copy the file "
                         "again")
    return value[key]
