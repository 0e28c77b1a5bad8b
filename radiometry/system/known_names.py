"""Names that people write of cameras, lights, charts and files' keys, and those that are known: the
one that is meant, and the nearest where none is.
"""
from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

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
