"""Words from files and people made safe for messages and files: short, without anything that a
terminal, an XML reader or a spreadsheet would obey.
"""
from __future__ import annotations

import re
from typing import Any

MAX_VALUE = 120         # characters of a value that a message repeats
MAX_LINE = 2000         # characters of a line of a message
# What steers a terminal, turns the direction of reading, or is not allowed in XML.
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff"
                     r"\ufdd0-\ufdef\ufffe\uffff]")
FORMULA = tuple("=+-@\t\r")


def shortened(value: Any) -> str:
    """``repr`` of a value, without its middle where it is long."""
    return _without_middle(repr(value), MAX_VALUE)


def plain(text: str) -> str:
    """Text without control characters: each becomes its escape sequence, such as ``\\x1b``.

    Parameters
    ----------
    text : str
        Ends of lines and tabs stay.
    """
    return CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def message(text: str) -> str:
    """A message as a terminal gets it: plain, and no line longer than ``MAX_LINE``."""
    return "\n".join(_without_middle(line, MAX_LINE) for line in plain(text).split("\n"))


def cell(text: str) -> str:
    """A word as a spreadsheet gets it: an apostrophe before what it would take for a formula."""
    text = plain(" ".join(text.split()))
    return f"'{text}" if text.startswith(FORMULA) else text


def from_cell(text: str) -> str:
    """Undo ``cell``."""
    return text[1:] if text.startswith("'") and text[1:].startswith(FORMULA) else text


def is_number(text: str) -> bool:
    """Whether ``float`` reads a text."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def is_whole_number(text: str) -> bool:
    """Whether a text is a whole number of at most 18 digits.

    Not ``str.isdigit``, which takes a raised 2 for one; ``int`` refuses more than 4300 digits.
    """
    return text.isascii() and text.isdigit() and len(text) <= 18


def reason_of(source: Any) -> str:
    """The error message of OpenImageIO in one line.

    Parameters
    ----------
    source : file of OpenImageIO, or the module itself
    """
    try:
        return " ".join(source.geterror().split()) or "no reason given"
    except UnicodeDecodeError:      # it quotes the damaged bytes
        return "damaged"


def _without_middle(text: str, characters: int) -> str:
    if len(text) <= characters:
        return text
    return f"{text[:characters * 2 // 3]}...{text[-characters // 4:]} ({len(text)} characters)"
