"""Whether a session can be drawn through its light transport, said before it is traced."""
from __future__ import annotations

from spectrabox.radiometry.errors import InputError


def require_one_transport(photos: int, traced: bool) -> None:
    """Refuse draws through the transport where there is not just one.

    Parameters
    ----------
    photos : int
        Of the session.
    traced : bool
        Whether the engine traces one light transport, for lights of one spectrum.

    Raises
    ------
    InputError
    """
    if photos > 1 or not traced:
        reason = "the session has several photos" if photos > 1 else \
            "the engine kept no light transport, or the lights differ in spectrum"
        raise InputError("sampling.through = \"transport\" takes one photo under lights of one "
                         f"spectrum, fitted by the transport engine, and {reason}; set [sampling] "
                         "through = \"surface\"")
