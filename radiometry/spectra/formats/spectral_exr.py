"""Spectral OpenEXR (spectral_layers.py): the mean over the picture as a spectrum. OpenImageIO reads
every compression, tiles too; of several parts the first counts.
"""
from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import require_utf8_name
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra import spectral_layers
from spectrabox.radiometry.spectra.formats.measurement_table import MAX_VALUES, SpectralTable
from spectrabox.radiometry.system.words import reason_of

MAGIC = b"\x76\x2f\x31\x01"
PER_NM = (".nm^-1", " nm-1")


def read_spectral_exr(content: bytes, path: Path) -> SpectralTable:
    """Mean over all pixels of each wavelength, with its standard error where there are several.

    Parameters
    ----------
    content : bytes
        Not looked at: OpenImageIO reads the file.
    path : Path

    Raises
    ------
    InputError
    """
    pixels, names, facts, parts = _opened(path)
    kind, layers = spectral_layers.spectral_layers(names, first=spectral_layers.LIGHT)
    if not layers or kind not in (spectral_layers.LIGHT, spectral_layers.REFLECTANCE, ""):
        raise InputError(f"{path.name} is an ordinary EXR picture ({', '.join(names[:4])}), not a "
                         "spectral one; a spectral one has channels such as S0.560nm or T.560nm")
    values = pixels[:, [index for _, index in layers]].astype(float)
    seen = np.isfinite(values).all(axis=1)
    if not seen.any():
        raise InputError(f"{path.name}: none of its {len(seen)} pixels holds numbers at every "
                         "wavelength; render or copy it again")
    notes = [f"{parts} parts; the first one is read"] if parts > 1 else []
    if not seen.all():
        notes.append(f"{len(seen) - seen.sum()} of {len(seen)} pixels hold no numbers and are left "
                     "out")
    return _table(np.array([nm for nm, _ in layers]), values[seen], kind, facts, path.name, notes)


def _opened(path: Path) -> tuple[np.ndarray, list[str], dict[str, str], int]:
    """Pixels (n, C) of the first part, names of its channels, its stated facts, and the parts."""
    import OpenImageIO as oiio

    require_utf8_name(path)
    file = oiio.ImageInput.open(os.fspath(path))
    if file is None:
        raise InputError(f"{path.name} is cut or damaged in its header "
                         f"({reason_of(oiio)}); copy the file again")
    try:
        spec = file.spec()
        if spec.deep:
            raise InputError(f"{path.name} is a deep picture, of several samples a pixel; flatten "
                             "it first")
        if spec.width * spec.height * spec.nchannels > MAX_VALUES:
            raise InputError(f"{path.name}: {spec.width} x {spec.height} pixels in "
                             f"{spec.nchannels} channels are more than is read here; crop it")
        names = list(spec.channelnames)
        facts = {name: spec.get_string_attribute(name) for name in (spectral_layers.UNIT,
                                                                    spectral_layers.QUANTITY)}
        parts = max(spec.get_int_attribute("oiio:subimages", 1), 1)
        pixels = file.read_image("float")
        if pixels is None or file.has_error:
            raise InputError(f"{path.name} is cut or damaged in its pixels ({reason_of(file)}); "
                             "copy the file again")
    except UnicodeDecodeError:
        raise InputError(f"{path.name} has channels or words in its header that are no text; "
                         "copy the file again") from None
    finally:
        file.close()
    return np.asarray(pixels).reshape(spec.width * spec.height, -1), names, facts, parts


def _table(nm: np.ndarray, values: np.ndarray, kind: str, facts: dict[str, str], name: str,
           notes: list[str]) -> SpectralTable:
    pixels = len(values)
    rows, names = [values.mean(axis=0)], ["mean"]
    if pixels > 1:
        rows.append(values.std(axis=0, ddof=1) / np.sqrt(pixels))
        names.append("standard_error")
        notes = [f"the spectrum is the mean over all {pixels} pixels of the picture", *notes]
    stated, notes = _quantity(kind, facts, notes)
    stated["source"] = f"{name}, mean of {pixels} pixels" if pixels > 1 else name
    return SpectralTable(nm, tuple(names), np.array(rows), stated, name, "mean", {}, tuple(notes))


def _quantity(kind: str, facts: dict[str, str],
              notes: list[str]) -> tuple[dict[str, str], list[str]]:
    """Quantity and unit as facts, and the notes with what was taken for granted."""
    units, stated = facts[spectral_layers.UNIT].lower(), facts[spectral_layers.QUANTITY]
    if stated.upper() in Quantity.__members__:
        return {"quantity": stated, "unit": Quantity[stated.upper()].value}, notes
    if stated:
        return {"quantity": stated}, notes
    if kind == spectral_layers.REFLECTANCE:
        return {"quantity": "reflectance", "unit": "1"}, notes
    per_nm = units.endswith(PER_NM)
    plain = next((units.removesuffix(end) for end in PER_NM if units.endswith(end)),
                 units).replace(" ", ".").replace("m-2", "m^-2").replace("sr-1", "sr^-1")
    quantity = next((each for each, unit in spectral_layers.UNITS.items() if unit.lower() == plain),
                    None)
    if quantity is None:
        return ({"unit": units} if units else {}), notes
    if not per_nm:
        notes = [*notes, "the unit is taken per nm, as the layout's authors write it"]
    return {"quantity": quantity.name.lower(), "unit": quantity.value}, notes
