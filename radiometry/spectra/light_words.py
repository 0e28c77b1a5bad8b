"""Words for a light whose spectrum nobody stated. Imports nothing heavy: session files use it."""
from __future__ import annotations

from spectrabox.radiometry.errors import InputError

UNKNOWN = "unknown"
DELTA_LIGHTS = ("D65", "A", "FL11")     # daylight, incandescent, narrow bands
LIGHT_KINDS = ("daylight", "halogen", "led", "fluorescent")
SAME_KIND = {"tungsten": "halogen", "incandescent": "halogen", "bulb": "halogen",
             "sun": "daylight", "sunlight": "daylight", "sky": "daylight",
             "leds": "led", "tube": "fluorescent", "tubes": "fluorescent"}
CCT_KELVIN = (1500.0, 25000.0)      # candles to blue sky


def vague_words(word: str) -> tuple[str | None, float | None] | None:
    """Kind and correlated colour temperature (K) of a light whose spectrum is not stated, each None
    where it is not known; None if the word states a spectrum.

    Parameters
    ----------
    word : str

    Raises
    ------
    InputError
        If it is a temperature that no lamp has.
    """
    plain = SAME_KIND.get(word.strip().lower(), word.strip().lower())
    if plain == UNKNOWN:
        return None, None
    if plain in LIGHT_KINDS:
        return plain, None
    if plain.removesuffix("k").strip().replace(".", "", 1).isdigit():
        cct, (low, high) = float(plain.removesuffix("k")), CCT_KELVIN
        if not low <= cct <= high:
            raise InputError(f"a light of {cct:g} K: correlated colour temperatures run from "
                             f"{low:g} to {high:g} K")
        return None, cct
    return None
