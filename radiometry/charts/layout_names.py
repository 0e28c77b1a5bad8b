"""Names of the charts whose layouts are known. Imports nothing heavy: session files use it."""
from __future__ import annotations

from spectrabox.radiometry.errors import InputError

LAYOUT_SUFFIX = ".toml"
LAYOUT_NAMES = ("ColorChecker Classic", "ColorChecker Passport", "ColorChecker Nano",
                "ColorChecker Digital SG", "SpyderCheckr 24", "SpyderCheckr 48")


def is_layout_file(layout: str) -> bool:
    """Whether an operator named a file and no chart that is sold."""
    return layout.lower().endswith(LAYOUT_SUFFIX)


def layout_name(written: str) -> str:
    """The one of ``LAYOUT_NAMES`` that is meant.

    Parameters
    ----------
    written : str
        In any case, with or without the first word of a ColorChecker.

    Raises
    ------
    InputError
        If there is none.
    """
    known = {_plain(name): name for name in LAYOUT_NAMES}
    short = {_plain(name.partition(" ")[2]): name for name in LAYOUT_NAMES
             if name.startswith("ColorChecker")}
    name = (short | known).get(_plain(written))
    if name is None:
        raise InputError(f"chart layout {written!r} is not known; known are "
                         f"{', '.join(LAYOUT_NAMES)}, or a layout of your own in a file "
                         f"NAME{LAYOUT_SUFFIX}")
    return name


def _plain(name: str) -> str:
    return "".join(name.lower().replace("-", "").split())
