"""IES TM-27 spectral data in XML (.spdx), whatever its namespace; a part that is not a number is
left out.
"""
from __future__ import annotations

from collections.abc import Iterator
from html import escape
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, XMLParser, fromstring

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats import measurement_table
from spectrabox.radiometry.system.words import plain

NAMESPACE = "http://www.ies.org/iestm2714"
QUANTITIES = {"radiance": ("radiance", "W m-2 sr-1 nm-1"),
              "irradiance": ("irradiance", "W m-2 nm-1"),
              "reflectance": ("reflectance", "1"), "transmittance": ("transmittance", "1"),
              "relative": ("relative", "relative"), "absorptance": ("absorptance", "1"),
              "flux": ("flux", "W nm-1"), "intensity": ("intensity", "W sr-1 nm-1"),
              "exitance": ("exitance", "W m-2 nm-1")}
HEADER_KEYS = ("Manufacturer", "CatalogNumber", "Description", "Laboratory", "ReportNumber",
               "ReportDate")


def is_tm27(text: str) -> bool:
    """Whether text is a TM-27 document."""
    start = text[:4000].lower()
    return start.lstrip().startswith("<") and ("iestm27" in start or "<spectraldistribution"
                                               in text.lower())


def read_tm27(content: bytes, path: Path) -> measurement_table.SpectralTable:
    """Every spectral distribution of the document, which must share their wavelengths.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.

    Raises
    ------
    InputError
    """
    root = xml_root(measurement_table.text_of(content, path.name), path.name)
    distributions = list(elements(root, "SpectralDistribution"))
    if not distributions:
        raise InputError(f"{path.name} holds no SpectralDistribution; a TM-27 document is needed")
    pairs = [_pairs(element, path.name) for element in distributions]
    if any(not np.array_equal(nm, pairs[0][0]) for nm, _ in pairs):
        raise InputError(f"{path.name}: its {len(distributions)} distributions have different "
                         "wavelengths; split the file")
    header = {key: (element.text or "").strip()
              for key in HEADER_KEYS for element in elements(root, key)}
    facts = {"source": header.get("Description") or path.name, **_quantity(distributions[0]),
             **{key.lower(): value for key, value in header.items() if value}}
    names = ("value",) if len(distributions) == 1 else tuple(f"distribution {index}"
                                                     for index in range(1, len(distributions) + 1))
    return measurement_table.SpectralTable(pairs[0][0], names,
                                           np.array([values for _, values in pairs]), facts,
                                           path.name)


def spdx_text(nm: np.ndarray, columns: dict[str, np.ndarray], *, quantity: Quantity,
              source: str) -> str:
    """A TM-27-14 document of spectra (P,), nine significant digits.

    Parameters
    ----------
    nm : (P,) array
    columns : dict of (P,) arrays
        By name.
    quantity : Quantity
    source : str
        Stored in the file.
    """
    lines = ['<?xml version="1.0" encoding="UTF-8"?>',
             f'<IESTM2714 xmlns="{NAMESPACE}" version="1.0">', "  <Header>", "    "
             f"<Description>{escape(plain(' '.join(source.split())), quote=False)}</Description>",
             "    <DocumentCreator>spectrabox</DocumentCreator>", "  </Header>"]
    for values in columns.values():
        lines += ["  <SpectralDistribution>", "    "
                  f"<SpectralQuantity>{quantity.name.lower()}</SpectralQuantity>"]
        lines += [f'    <SpectralData wavelength="{wavelength:.9g}">{value:.9g}</SpectralData>'
                  for wavelength, value in zip(nm, values, strict=True)]
        lines.append("  </SpectralDistribution>")
    return "\n".join([*lines, "</IESTM2714>", ""])


def xml_root(text: str, name: str) -> Element:
    """The root of a document without entities: a few bytes of these can expand to gigabytes.

    Parameters
    ----------
    text : str
    name : str
        Of the file, for errors.

    Raises
    ------
    InputError
        If it is damaged, or declares entities.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{name} declares XML entities, which no spectral file needs; it is not "
                         "read")
    try:
        return fromstring(text.encode("utf-8"), XMLParser(encoding="utf-8"))
    except (ParseError, ValueError) as error:
        raise InputError(f"{name} is damaged XML ({error}); export it again") from None


def elements(root: Element, tag: str) -> Iterator[Element]:
    """The element itself and those below it that have a name, whatever its namespace."""
    return (element for element in root.iter() if element.tag.rpartition("}")[2] == tag)


def _quantity(distribution: Element) -> dict[str, str]:
    stated = distribution.findtext("{*}SpectralQuantity", "").strip().lower()
    if stated not in QUANTITIES:
        return {"quantity": stated} if stated and stated not in ("other", "unknown") else {}
    quantity, unit = QUANTITIES[stated]
    return {"quantity": quantity, "unit": unit}


def _pairs(distribution: Element, name: str) -> tuple[np.ndarray, np.ndarray]:
    points = distribution.findall("{*}SpectralData")
    nm = np.array([measurement_table.number(child.get("wavelength", "")) for child in points])
    values = np.array([measurement_table.number(child.text or "") for child in points])
    if not points or not np.all(np.isfinite(nm)):
        raise InputError(f"{name}: {len(points)} SpectralData, of which "
                         f"{int(np.sum(~np.isfinite(nm)))} state no wavelength; export the file "
                         "again")
    return nm, values
