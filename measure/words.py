"""Numbers, phrases and tables as the report and the terminal write them."""
from __future__ import annotations

import math
from typing import Any

import numpy as np

from spectrabox.radiometry.records.scenes import SurfaceAgreement

OFF = 0.05              # a surface further off than this is named and highlighted
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


def disagreement(agreement: SurfaceAgreement, bands: tuple[str, ...]) -> str:
    """Where photo and rendering disagree and by how much, in plain words.

    Parameters
    ----------
    bands : tuple of str
        K names, of the columns of ``agreement.ratio``.
    """
    ratio = agreement.ratio
    measured = np.isfinite(ratio).all(axis=1)
    if not measured.any():
        return ("No surface could be compared, so nothing is known of how well the rendering fits "
                "the photo.")
    deviation = np.where(measured[:, None], np.abs(ratio - 1), 0.0).max(axis=1)
    off = np.flatnonzero(deviation > OFF)
    missing = [agreement.names[s] for s in np.flatnonzero(~measured)]
    unknown = f" Not compared in every band: {listed(missing)}." if missing else ""
    if not off.size:
        return (f"On all {measured.sum()} compared surfaces photo and rendering agree within "
                f"{percent(float(deviation.max()))} in every band.{unknown}")
    order = off[np.argsort(-deviation[off])]
    where = listed([f"“{agreement.names[s]}” ({_bands_off(ratio[s], bands)})" for s in order])
    return (f"On {measured.sum() - off.size} of {measured.sum()} compared surfaces photo and "
            f"rendering agree within {percent(OFF, 0)} in every band. They disagree on {where}. "
            f"{_shape_of(agreement, int(order[0]))}{unknown}")


def _bands_off(ratio: np.ndarray, bands: tuple[str, ...]) -> str:
    worst = int(np.argmax(np.abs(ratio - 1)))
    return f"photo {deviation_words(float(ratio[worst]))} in {bands[worst]}"


def _shape_of(agreement: SurfaceAgreement, surface: int) -> str:
    """What the pattern over bands hints at for the worst surface."""
    name, ratio = f"“{agreement.names[surface]}”", agreement.ratio[surface]
    if np.ptp(ratio) < 0.3 * np.abs(ratio - 1).max():
        return (f"On {name} all bands are off by the same factor: geometry, light position or "
                "shadow is the first suspect, not the spectrum.")
    return (f"On {name} the bands differ: the spectrum of this surface, or of the light it gets, "
            "is the first suspect.")
