"""What readers of XML formats share: a document without entities, its elements by name."""
from __future__ import annotations

from collections.abc import Iterator
from xml.etree.ElementTree import Element, ParseError, XMLParser, fromstring

from spectrabox.radiometry.errors import InputError


def parse_xml(text: str, name: str) -> Element:
    """The root of a document.

    Parameters
    ----------
    text : str
    name : str
        Of the file, for errors.

    Raises
    ------
    InputError
        If it is damaged, or declares entities: a few bytes of these can expand to gigabytes.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{name} declares XML entities, which no spectral file needs; it is not "
                         "read")
    try:
        return fromstring(text.encode("utf-8"), XMLParser(encoding="utf-8"))
    except (ParseError, ValueError) as error:
        raise InputError(f"{name} is damaged XML ({error}); export it again") from None


def elements(root: Element, tag: str) -> Iterator[Element]:
    """The element itself and those below it that have a name, whatever its namespace.

    Parameters
    ----------
    root : Element
    tag : str
        Without namespace.
    """
    return (element for element in root.iter() if element.tag.rpartition("}")[2] == tag)
