"""Names of the channels of a spectral EXR: A. Fichet, R. Pacanowski, A. Wilkie, An OpenEXR Layout
for Spectral Images, JCGT 10(3), 2021.

``T.560,000000nm`` is a reflectance or transmittance, ``S0.560,000000nm`` light; ``S1`` to ``S3``
are its polarisation, and two wavelengths in one name a fluorescence from the first to the second.
"""
from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from spectrabox.radiometry.records.spectra import Quantity

REFLECTANCE, LIGHT = "T", "S0"
NM_PER_METRE = 1e9
LIGHT_SPEED = 299_792_458.0         # m/s
MULTIPLES = {"Y": 1e24, "Z": 1e21, "E": 1e18, "P": 1e15, "T": 1e12, "G": 1e9, "M": 1e6, "k": 1e3,
             "h": 1e2, "da": 1e1, "": 1.0, "d": 1e-1, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9,
             "p": 1e-12}
NUMBER = r"(\d+(?:[,.]\d*)?(?:[eE][-+]?\d+)?)\s?(Y|Z|E|P|T|G|M|k|h|da|d|c|m|u|n|p)?(m|Hz)"
LAYER = re.compile(rf"(?:(.*?)\.)??{NUMBER}")
POLARISED = re.compile(r"(?:.*\.)?S[123]")
# The layout names radiance so, and means it per nanometre of wavelength.
UNITS = {Quantity.RADIANCE: "W.m^-2.sr^-1", Quantity.IRRADIANCE: "W.m^-2"}
VERSION, UNIT, QUANTITY = "spectralLayoutVersion", "emissiveUnits", "spectrabox:quantity"
STANDARD_DEVIATION = "standard deviation"   # as QUANTITY: no spectrum itself


def layer_names(nm: np.ndarray, kind: str = REFLECTANCE) -> list[str]:
    """Names of channels, with six decimals and a comma, as the layout's authors write them.

    Parameters
    ----------
    nm : (P,) array
    kind : {"T", "S0"}
    """
    return [f"{kind}.{wavelength:.6f}nm".replace(".", ",").replace(",", ".", 1)
            for wavelength in nm]


def layout_attributes(quantity: Quantity | str) -> dict[str, str]:
    """What a file's header states: the layout's version, the unit of light, and the quantity.

    Parameters
    ----------
    quantity : Quantity, or str for what is none
    """
    word = quantity.name.lower() if isinstance(quantity, Quantity) else quantity
    unit = UNITS.get(quantity) if isinstance(quantity, Quantity) else None
    return {VERSION: "1.0", QUANTITY: word, **({UNIT: unit} if unit else {})}


def spectral_layers(names: Sequence[str], *, first: str) -> tuple[str, list[tuple[float, int]]]:
    """The kind of layer that a picture is read for, and (nm, index) of its channels, ascending.

    Parameters
    ----------
    names : sequence of str
        Of all channels.
    first : {"T", "S0"}
        Which is meant where a picture holds both.

    Returns
    -------
    kind : str
        "T", "S0", "" where channels are named by wavelengths alone, or another layer's name.
    layers : list
        Empty where no channel is named by a wavelength.
    """
    by_kind: dict[str, list[tuple[float, int]]] = {}
    for index, name in enumerate(names):
        if layer := _layer(name):
            by_kind.setdefault(layer[0], []).append((layer[1], index))
    kind = next((kind for kind in (first, REFLECTANCE, LIGHT, "", *by_kind) if kind in by_kind), "")
    return kind, sorted(by_kind.get(kind, []))


def _layer(name: str) -> tuple[str, float] | None:
    """Kind and wavelength in nm of one channel; none where it is no spectrum's."""
    match = LAYER.fullmatch(name)
    before = (match[1] or "") if match else ""
    if match is None or POLARISED.fullmatch(before) or LAYER.fullmatch(before):
        return None
    value = float(match[2].replace(",", ".")) * MULTIPLES[match[3] or ""]
    if value <= 0:
        return None
    metres = value if match[4] == "m" else LIGHT_SPEED / value
    # rounded: 560 x 1e-9 m comes back as 560 nm
    return before.rpartition(".")[2], round(metres * NM_PER_METRE, 9)
