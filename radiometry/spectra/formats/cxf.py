"""Colour exchange format CxF3 in XML (.cxf), as i1Profiler and ColorPort export measured charts.

Its namespace is left aside: writers differ in it. Read here rather than by the library colour-cxf,
which needs half a second to import, refuses Python 3.14 and resolves XML entities.
"""
from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats.measurement_table import (
    SpectralTable,
    distinct,
    number,
    text_of,
)
from spectrabox.radiometry.spectra.formats.xml_elements import elements, parse_xml


def is_cxf(text: str) -> bool:
    """Whether text is a CxF document."""
    return text.lstrip().startswith("<") and "colorexchangeformat.com" in text[:4000].lower()


def read_cxf(content: bytes, path: Path) -> SpectralTable:
    """Every object that has a reflectance spectrum, one column each.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.

    Raises
    ------
    InputError
        If the XML is damaged, no object has a reflectance spectrum, or two have different
        wavelengths.
    """
    root = parse_xml(text_of(content, path.name), path.name)
    starts, steps = _specifications(root)
    names: list[str] = []
    spectra: list[tuple[np.ndarray, np.ndarray]] = []
    for sample in elements(root, "Object"):
        spectrum = next(elements(sample, "ReflectanceSpectrum"), None)
        if spectrum is None:
            continue
        names.append(sample.get("Name") or sample.get("Id") or f"sample {len(names) + 1}")
        specification = spectrum.get("ColorSpecification", "")
        start = number(spectrum.get("StartWL", starts.get(specification, "")))
        values = np.array([number(word) for word in (spectrum.text or "").split()])
        spectra.append((start + steps.get(specification, np.nan) * np.arange(values.size),
                        values))
    if not spectra:
        raise InputError(f"{path.name} holds no ReflectanceSpectrum; export it with spectral data")
    nm = spectra[0][0]
    for name, (wavelengths, _) in zip(names, spectra, strict=True):
        if not np.array_equal(wavelengths, nm):
            raise InputError(f"{path.name}: {names[0]!r} and {name!r} have different wavelengths, "
                             "or state none; export the file again")
    description = next(((element.text or "").strip()
                        for element in elements(root, "Description")), "")
    return SpectralTable(nm, distinct(names), np.array([values for _, values in spectra]),
                         {"source": description or path.name, "quantity": "reflectance",
                          "unit": "1"}, path.name)


def _specifications(root: Element) -> tuple[dict[str, str], dict[str, float]]:
    """First wavelength and step (nm) of every colour specification that states them."""
    starts, steps = {}, {}
    for specification in elements(root, "ColorSpecification"):
        identity = specification.get("Id", "")
        for limits in elements(specification, "WavelengthRange"):
            if "StartWL" in limits.attrib:
                starts[identity] = limits.attrib["StartWL"]
            if "Increment" in limits.attrib:
                steps[identity] = number(limits.attrib["Increment"])
    return starts, steps
