"""The instruments by name."""
from __future__ import annotations

from spectrabox.capture.meter.instruments import cr30, cr250, cs2000, interface, jeti, pr650, pr655
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.system.words import nearest_names

DRIVERS: dict[str, type[interface.Instrument]] = {
    driver.name: driver for driver in (cs2000.Cs2000, cr250.Cr250, pr655.Pr655, pr650.Pr650,
                                       jeti.Specbos1211, jeti.Specbos2501, cr30.Cr30)}
ALIASES = {"cs2000a": "cs2000", "cr300": "cr250", "pr670": "pr655", "spectrocal": "specbos1211",
           "specbos1201": "specbos1211",
           "spectraval": "specbos2501", "spectraval1501": "specbos2501",
           "spectraval1511": "specbos2501"}


def driver_named(name: str) -> type[interface.Instrument]:
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
