"""Planted mistakes as ``benchmarks/planted/*.toml`` lists them."""
from __future__ import annotations

import hashlib
import tomllib
from pathlib import Path
from typing import NamedTuple


class Mistake(NamedTuple):
    """One text of one file that is replaced by another; the old text stands there exactly once."""

    file: str
    old: str
    new: str
    what: str
    blind: bool = True      # written before its writer had looked at the tests that concern it

    @property
    def name(self) -> str:
        """A name that stays as long as file, old and new text stay the same."""
        return hashlib.sha256(repr(self[:3]).encode()).hexdigest()[:12]


def listed_mistakes(lists: str = "*") -> list[Mistake]:
    """Every mistake of the lists whose name fits a pattern."""
    return [Mistake(**each) for path in sorted(Path(__file__).parent.glob(f"{lists}.toml"))
            for each in tomllib.loads(path.read_text(encoding="utf-8"))["mistake"]]
