"""The instruments by name."""
from __future__ import annotations

from spectrabox.capture.meter.instruments.cr30 import Cr30
from spectrabox.capture.meter.instruments.cr250 import Cr250
from spectrabox.capture.meter.instruments.cs2000 import Cs2000
from spectrabox.capture.meter.instruments.interface import Instrument
from spectrabox.capture.meter.instruments.jeti import Specbos1211, Specbos2501
from spectrabox.capture.meter.instruments.pr650 import Pr650
from spectrabox.capture.meter.instruments.pr655 import Pr655
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.words import nearest_names

DRIVERS: dict[str, type[Instrument]] = {
    driver.name: driver for driver in (Cs2000, Cr250, Pr655, Pr650, Specbos1211, Specbos2501,
                                       Cr30)}
ALIASES = {"cs2000a": "cs2000", "cr300": "cr250", "pr670": "pr655", "spectrocal": "specbos1211",
           "specbos1201": "specbos1211",
           "spectraval": "specbos2501", "spectraval1501": "specbos2501",
           "spectraval1511": "specbos2501"}


def driver_named(name: str) -> type[Instrument]:
    """The driver for an instrument as people write it: "CS-2000A", "pr 670".

    Parameters
    ----------
    name : str

    Raises
    ------
    InputError
        Naming the known ones and the nearest.
    """
    key = "".join(letter for letter in name.lower() if letter.isalnum())
    driver = DRIVERS.get(ALIASES.get(key, key))
    if driver is None:
        near = nearest_names(key, [*DRIVERS, *ALIASES], shown=1)
        raise InputError(f"there is no driver for {name!r}; known are "
                         f"{', '.join([*DRIVERS, *ALIASES])}"
                         + (f" (did you mean {near[0]}?)" if near else ""))
    return driver
