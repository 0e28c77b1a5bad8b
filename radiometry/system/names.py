"""Names that people give to sessions, materials, views, regions, bands and measurements: one rule,
and the files that are named after them.
"""
from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

MAX_CHARACTERS = 80
MAX_BYTES = 200         # as UTF-8: a file's name holds 255, which the name is only a part of


def name_fault(name: str) -> str | None:
    """Check a name.

    Parameters
    ----------
    name : str
        Such as "white paint", "B/W 50%" or "été 2".

    Returns
    -------
    str or None
        The rule that it breaks, as the end of a sentence.
    """
    if not name or not name[0].isalnum():
        return "a name begins with a letter or a digit"
    if name.endswith((" ", ".")):
        return "a name does not end in a space or a dot"
    if not name.isprintable():
        return "a name is one line of printable characters"
    if len(name) > MAX_CHARACTERS or len(name.encode()) > MAX_BYTES:
        return f"a name has at most {MAX_CHARACTERS} characters"
    return None


def file_stem(name: str) -> str:
    """Name of the file for something called ``name``, without the suffix.

    Letters, digits, spaces, "-", "_" and "." stay; anything else becomes "-".
    """
    return re.sub(r"[^\w .-]", "-", unicodedata.normalize("NFC", name))


def sharing_a_file(names: Iterable[str]) -> list[tuple[str, str]]:
    """Pairs of names that would get the same file, also where capitals do not count."""
    owners: dict[str, str] = {}
    shared = []
    for name in names:
        first = owners.setdefault(file_stem(name).casefold(), name)
        if first != name:
            shared.append((first, name))
    return shared
