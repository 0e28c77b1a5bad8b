"""Which column of a table is which band of a camera, by the names of both."""
from __future__ import annotations

from collections.abc import Sequence

from spectrabox.radiometry.errors import InputError

COLOURS = {"red": "r", "green": "g", "blue": "b"}
WELL_KNOWN = ({"r", "g", "b"}, {"x", "y", "z"})     # neither stands for the other


def columns_of_bands(header: Sequence[str], bands: Sequence[str], name: str) -> list[int]:
    """Columns of a table in the order of a camera's bands.

    They are those of the bands' names, whatever their capitals, "red" being R; where no column has
    such a name, the order of the columns is taken for that of the bands.

    Parameters
    ----------
    header : sequence of str
        Names of the columns.
    bands : sequence of K str
        Of the camera.
    name : str
        Of the table, for the message.

    Raises
    ------
    InputError
        If some columns are named as bands and others are not, or they are named R, G, B and the
        bands X, Y, Z.
    """
    columns, known = [_plain(each) for each in header], [_plain(each) for each in bands]
    if sorted(columns) == sorted(known):
        return [columns.index(band) for band in known]
    if set(columns) & set(known) or (set(columns) in WELL_KNOWN and set(known) in WELL_KNOWN):
        raise InputError(f"{name} has columns named {', '.join(header)}, and the camera's bands "
                         f"are {', '.join(bands)}: name each column as the band that it holds")
    return list(range(len(header)))


def _plain(name: str) -> str:
    word = name.strip().casefold()
    return COLOURS.get(word, word)
