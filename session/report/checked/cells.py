"""Which number of the data an element of the page shows, and whether it still does.

An element says so by a JSON pointer (RFC 6901) in its attribute ``data-of``.
"""
from __future__ import annotations

import math
import re
from typing import Any

from markupsafe import Markup, escape

UNKNOWN = ("", "–", "not measured", "not stated", "not determined")
SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
# left out of every text: browsers and parsers keep spaces and control characters differently
BLANK = re.compile("[\\x00-\\x20\\x7f-\\xa0\\u1680\\u2000-\\u200f\\u2028\\u2029\\u202f\\u205f"
                   "\\u3000\\ufeff]+")
NUMBER = re.compile(r"(1/)?([-+]?\d+)(?:\.(\d+))?(?: × 10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?(?:e([-+]\d+))?( %)?")


def of(*parts: str | int | list[str | int]) -> Markup:
    """The attribute that names a number of the data.

    Parameters
    ----------
    parts : str, int or list of them
        Keys and indices that lead to it.
    """
    flat = [step for part in parts for step in (part if isinstance(part, list) else [part])]
    steps = "".join("/" + str(step).replace("~", "~0").replace("/", "~1") for step in flat)
    return Markup(' data-of="{}"').format(escape(steps))


def value_at(content: Any, pointer: str) -> Any:
    """The value that a JSON pointer leads to.

    Raises
    ------
    KeyError
        If it leads nowhere.
    """
    for part in pointer.split("/")[1:]:
        key = part.replace("~1", "/").replace("~0", "~")
        try:
            content = content[int(key)] if isinstance(content, list) else content[key]
        except (KeyError, IndexError, ValueError, TypeError):
            raise KeyError(pointer) from None
    return content


def shows(text: str, value: Any) -> bool:
    """Whether a text shows a value: the same words, or the number as far as its digits go.

    Parameters
    ----------
    text : str
        As it stands on the page.
    value : str, bool, number or None
        Of the data.
    """
    if isinstance(value, str):
        return _words(text) == _words(value)
    if value is None:
        return text.strip() in UNKNOWN
    found = NUMBER.search(text.strip().replace("−", "-"))
    if found is None or not math.isfinite(value):
        return False
    inverse, whole, decimals, power, exponent, percent = found.groups()
    unit = 10.0 ** (int((power or "0").translate(SUPERSCRIPTS)) + int(exponent or 0)
                    - len(decimals or "") - (2 if percent else 0))
    shown = int(whole + (decimals or "")) * unit
    wanted = 1 / value if inverse and value else value
    # half of the last digit, with room for the round-off of the division by it
    return abs(shown - wanted) <= 0.5 * unit * (1 + 1e-6) + 1e-12 * abs(wanted)


def _words(text: str) -> str:
    return BLANK.sub("", text.encode("utf-8", "backslashreplace").decode())
