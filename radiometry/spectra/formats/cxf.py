"""CxF3, the Color Exchange Format (ISO 17972-1): the spectra of a file's objects.

Reflectances are factors on an even grid: StartWL stands at the spectrum, the increment in the
colour specification that it names. Custom spectra state the wavelength of each point.
"""
from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats import measurement_table, tm27

SPECTRA: dict[str, dict[str, str]] = {
    "ReflectanceSpectrum": {"quantity": "reflectance", "unit": "1"},
    "TransmittanceSpectrum": {"quantity": "transmittance", "unit": "1"},
    "EmissiveSpectrum": {}, "CustomSpectrum": {}}
MAX_NOTES = 5
ROOT = re.compile(r"<(?:\w+:)?cxf[\s>]", re.IGNORECASE)


def is_cxf(text: str) -> bool:
    """Whether text is a CxF document."""
    return text.lstrip("\ufeff \t\r\n").startswith("<") and ROOT.search(text[:4000]) is not None


def read_cxf(content: bytes, path: Path) -> measurement_table.SpectralTable:
    """Every spectrum of every object, one column each, over all wavelengths that occur.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.

    Raises
    ------
    InputError
        If no object holds a spectrum, or one states no wavelengths.
    """
    root = tm27.xml_root(measurement_table.text_of(content, path.name), path.name)
    specifications = {element.get("Id", ""): element
                      for element in tm27.elements(root, "ColorSpecification")}
    objects = list(tm27.elements(root, "Object"))
    names: list[str] = []
    curves: list[dict[float, float]] = []
    stated: list[dict[str, str]] = []
    notes = []
    without = 0
    for number, each in enumerate(objects, 1):
        spectra = list(_spectra(each))
        without += not spectra
        name = " ".join(each.get("Name", "").split()) or each.get("Id") or f"object {number}"
        for kind, spectrum in spectra:
            points = _points(spectrum, specifications, f"{path.name}: {name!r}")
            if points is None:
                notes.append(f"{name!r} holds a single value, or a wavelength twice with different "
                             "values, and was left out")
                continue
            under = spectrum.get("ColorSpecification", "")
            names.append(name if len(spectra) == 1 else
                         f"{name} {_condition(specifications.get(under), under)}".strip())
            curves.append(points)
            stated.append(SPECTRA[kind])
    if not curves:
        kinds = sorted({_tag(child) for each in objects for values in _children(each, "ColorValues")
                        for child in values})
        raise InputError(f"{path.name} is CxF with {len(objects)} objects and no spectra, only "
                         f"{', '.join(kinds) or 'names'}; export it with spectral data")
    if without:
        notes.insert(0, f"{without} of {len(objects)} objects hold no spectrum and were left out")
    nm = np.array(sorted(set().union(*curves)))
    if nm.size * len(curves) > measurement_table.MAX_VALUES:
        raise InputError(f"{path.name} holds {len(curves)} spectra at {nm.size} wavelengths; split "
                         "the file")
    values = np.array([[points.get(each, np.nan) for each in nm.tolist()] for points in curves])
    distinct = measurement_table.distinct(names)
    description = next((element.text for element in tm27.elements(root, "Description")
                        if element.text), None)
    return measurement_table.SpectralTable(
        nm, distinct, values, {"source": " ".join((description or path.name).split())}, path.name,
        None, {name: facts for name, facts in zip(distinct, stated, strict=True) if facts},
        tuple(notes[:MAX_NOTES]))


def _spectra(each: Element) -> Iterator[tuple[str, Element]]:
    """Kind and element of every spectrum of an object, not of objects within it."""
    for values in _children(each, "ColorValues"):
        for child in values:
            if _tag(child) in SPECTRA:
                yield _tag(child), child


def _children(element: Element, tag: str) -> list[Element]:
    return [child for child in element if _tag(child) == tag]


def _tag(element: Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _points(spectrum: Element, specifications: dict[str, Element],
            what: str) -> dict[float, float] | None:
    """Values by wavelength in nm; None of a single value, or where a wavelength stands twice with
    different ones.
    """
    own = [point for point in spectrum if _tag(point) == "SpectralPoint"]
    if own:
        nm = [measurement_table.number(point.get("WL", "")) for point in own]
        values = [measurement_table.number(point.text or "") for point in own]
    else:
        words = re.split(r"[\s,;]+", "".join(spectrum.itertext()).strip())
        values = [measurement_table.number(word) for word in words]
        start, step = _range(spectrum, specifications, what)
        nm = [round(start + step * index, 9) for index in range(len(values))]
    if not np.all(np.isfinite(nm)):
        raise InputError(f"{what} states a wavelength that is no number; export the file again")
    points = dict(zip(nm, values, strict=True))
    if len(values) < 2 or any(points[at] != value for at, value in zip(nm, values, strict=True)
                              if value == value):
        return None
    return points


def _range(spectrum: Element, specifications: dict[str, Element],
           what: str) -> tuple[float, float]:
    """First wavelength and increment in nm."""
    named = spectrum.get("ColorSpecification", "")
    stated = [spectrum]
    if named in specifications:
        stated += tm27.elements(specifications[named], "WavelengthRange")
    start, step = (next((value for element in stated if np.isfinite(
        value := measurement_table.number(element.get(key, "")))), float("nan"))
        for key in ("StartWL", "Increment"))
    if not np.isfinite(start) or not step > 0:
        raise InputError(f"{what} states no {'StartWL' if not np.isfinite(start) else 'Increment'} "
                         f"of its wavelengths in its colour specification {named!r}; export the "
                         "file again")
    return start, step


def _condition(specification: Element | None, name: str) -> str:
    """How a spectrum of several was measured: its illumination such as M1, else its specification.
    """
    if specification is not None:
        for element in tm27.elements(specification, "DeviceIllumination"):
            if element.text and element.text.strip():
                return element.text.strip()
    return name
