"""Words from files and people made safe for messages, and names that are not known answered with
the nearest.

Words from files and people made safe for messages and files: short, without anything that a
terminal, an XML reader or a spreadsheet would obey; and the rule for names that people give to
sessions, materials, views, regions, bands and measurements, with the files that are named after
them.
"""


from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable
from typing import Any

MAX_CHARACTERS = 80
MAX_BYTES = 200         # as UTF-8: a file's name holds 255, which the name is only a part of

MAX_VALUE = 120         # characters of a value that a message repeats
MAX_LINE = 2000         # characters of a line of a message
# What steers a terminal, turns the direction of reading, or is not allowed in XML.
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff"
                     r"\ufdd0-\ufdef\ufffe\uffff]")
FORMULA = tuple("=+-@\t\r")


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


def shortened(value: Any) -> str:
    """``repr`` of a value, without its middle where it is long."""
    return _without_middle(repr(value), MAX_VALUE)


def plain(text: str) -> str:
    """Text without control characters: each becomes its escape sequence, such as ``\\x1b``.

    Parameters
    ----------
    text : str
        Ends of lines and tabs stay.
    """
    return CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def message(text: str) -> str:
    """A message as a terminal gets it: plain, and no line longer than ``MAX_LINE``."""
    return "\n".join(_without_middle(line, MAX_LINE) for line in plain(text).split("\n"))


def cell(text: str) -> str:
    """A word as a spreadsheet gets it: an apostrophe before what it would take for a formula."""
    text = plain(" ".join(text.split()))
    return f"'{text}" if text.startswith(FORMULA) else text


def from_cell(text: str) -> str:
    """Undo ``cell``."""
    return text[1:] if text.startswith("'") and text[1:].startswith(FORMULA) else text


def is_number(text: str) -> bool:
    """Whether ``float`` reads a text."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def is_whole_number(text: str) -> bool:
    """Whether a text is a whole number of at most 18 digits.

    Not ``str.isdigit``, which takes a raised 2 for one; ``int`` refuses more than 4300 digits.
    """
    return text.isascii() and text.isdigit() and len(text) <= 18


def reason_of(source: Any) -> str:
    """The error message of OpenImageIO in one line.

    Parameters
    ----------
    source : file of OpenImageIO, or the module itself
    """
    try:
        return " ".join(source.geterror().split()) or "no reason given"
    except UnicodeDecodeError:      # it quotes the damaged bytes
        return "damaged"


def _without_middle(text: str, characters: int) -> str:
    if len(text) <= characters:
        return text
    return f"{text[:characters * 2 // 3]}...{text[-characters // 4:]} ({len(text)} characters)"


# ---- known names ---------------------------------------------------------------------------------

NEAR = 0.4          # of two words, by the share of letters that they have in common
SHOWN = 3
# letters that sound alike; doubled ones, and an h that only lengthens another, count once
SOUNDS = ((r"ph", "f"), (r"gh(?=t|$)", ""), (r"qu", "kw"), (r"x", "ks"), (r"c(?=[eiy])", "s"),
          (r"[cq]", "k"), (r"z", "s"), (r"y", "i"), (r"(?<=[a-z])h", ""), (r"(.)\1+", r"\1"))


def known_name(name: str, names: Iterable[str]) -> str | None:
    """The one of some names that is meant, whatever its capitals, blanks and hyphens, without the
    source in brackets, and of a Nikon without the D; None where none is, or two are.

    Parameters
    ----------
    name : str
    names : iterable of str
    """
    known = list(names)
    if name in known:
        return name
    meant = [each for each in known
             if _plain(name) in (_plain(each), _plain(each.partition(" (")[0]))]
    return meant[0] if len(meant) == 1 else None


def nearest_names(name: str, names: Iterable[str], shown: int = SHOWN,
                  near: float = NEAR) -> list[str]:
    """The names that were perhaps meant, by their letters or by their sound, the nearest first.

    Parameters
    ----------
    name : str
    names : iterable of str
        Capitals and the source in brackets do not count.
    shown : int
        How many, at most.
    near : float
        How much they have to be alike, 0 to 1.
    """
    likeness: dict[str, float] = {}
    for known in names:
        for form in (known, known.partition(" (")[0]):
            for spelling in (_plain, sound):
                alike = difflib.SequenceMatcher(None, spelling(form), spelling(name)).ratio()
                likeness[known] = max(alike, likeness.get(known, 0.0))
    order = sorted(likeness, key=lambda known: -likeness[known])
    return [known for known in order if likeness[known] >= near][:shown]


def nearest_words(name: str, names: Iterable[str]) -> str:
    """The end of a sentence on a name that is not known; empty where none is near.

    Parameters
    ----------
    name : str
    names : iterable of str
    """
    near = nearest_names(name, names)
    return f"; nearest are {', '.join(near)}" if near else ""


def sound(name: str) -> str:
    """About how a name sounds: "phlourescent" as "fluorescent" but for one vowel."""
    heard = _plain(name)
    for written, spoken in SOUNDS:
        heard = re.sub(written, spoken, heard)
    return heard


def _plain(name: str) -> str:
    return re.sub(r"^nikond(?=\d)", "nikon", re.sub(r"[\s_-]+", "", name.casefold()))
