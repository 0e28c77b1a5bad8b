"""Numbers, phrases and tables as the report and the terminal write them."""
from __future__ import annotations

import math
from typing import Any

import numpy as np

MOST_LISTED = 6         # items that a phrase names
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def percent(share: float | None, decimals: int | None = None) -> str:
    """A share as per cent, two significant digits unless ``decimals`` is given.

    Parameters
    ----------
    share : float or None
        1 is 100 %.
    """
    if share is None or not math.isfinite(share):
        return "not measured"
    value = 100 * float(share)
    if decimals is None:
        near_all = 99 < value < 100 and value != round(value)  # 99.9 % must not read 100 %
        decimals = 1 if near_all else 0 if abs(value) >= 9.95 else 1 if abs(
            value) >= 0.095 or value == 0 else 2
    return f"{value:.{decimals}f} %".replace("-", "−")


def signed_percent(share: float | None) -> str:
    """A signed share as per cent with one decimal."""
    if share is None or not math.isfinite(share):
        return "not measured"
    return f"{100 * float(share):+.1f} %".replace("-", "−")


def number(value: float | None, digits: int = 4) -> str:
    """A number with significant digits, or that it is not known."""
    if value is None or not math.isfinite(value):
        return "not measured"
    text = f"{float(value):.{digits}g}"
    mantissa, _, exponent = text.partition("e")
    return text if not exponent else f"{mantissa} × 10{str(int(exponent)).translate(SUPERSCRIPT)}"


def fixed(value: float | None, decimals: int = 3) -> str:
    """A number with a fixed count of decimals, or that it is not known."""
    return "not measured" if value is None or not math.isfinite(
        value) else f"{float(value):.{decimals}f}"


def lab(values: Any) -> str:
    """L*, a*, b* (3,), or their standard errors, with one decimal."""
    return " ".join(f"{float(value):.1f}".replace("-", "−") for value in values)


def exposure(seconds: float | None) -> str:
    """Exposure time as photographers write it."""
    if seconds is None:
        return "not stated"
    return f"1/{1 / seconds:.0f} s" if 0 < seconds < 0.3 else f"{seconds:g} s"


def fact(value: Any) -> str:
    """Any fact of an input or of the machine, on one line."""
    if value is None:
        return "not stated"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        return number(float(value), 6)
    if isinstance(value, dict):
        return ", ".join(f"{key} {fact(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(fact(item) for item in value)
    return str(value)


def deviation_words(ratio: float) -> str:
    """"12 % brighter" for photo / rendering = 1.12."""
    return f"{percent(abs(ratio - 1))} {'brighter' if ratio >= 1 else 'darker'}"


def listed(items: list[str]) -> str:
    """Items as a phrase, the rest of a long list counted."""
    more = len(items) - MOST_LISTED
    shown = [*items[:MOST_LISTED], f"{more} more"] if more > 0 else items
    return shown[0] if len(shown) == 1 else ", ".join(shown[:-1]) + " and " + shown[-1]
