"""Regions of flat samples in a file of their own, for photos that were framed alike."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from spectrabox.radiometry.checked_tables import ListOf, Table, checked, read_toml

ADVICE = "write [regions.NAME] and rect = [x0, y0, x1, y1] for each region"


class RegionTable(Table):
    """A region: what ``[regions.NAME]`` of a session may say of it in words, numbers and files."""

    rect: Annotated[ListOf[float], Field(min_length=4, max_length=4)]
    family: str | ListOf[str] | None = None
    surface: Literal["matt", "satin", "glossy"] | None = None
    known: float | str | None = None
    truth: str | None = None


class RegionsFile(Table):
    """A file of regions."""

    regions: dict[str, RegionTable] = Field(min_length=1)


@dataclass(frozen=True)
class StatedRegions:
    """What is said of regions, by their names: as the options of ``spectrabox flat`` say it."""

    rects: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    families: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    surfaces: Mapping[str, str] = field(default_factory=dict)
    known: Mapping[str, str] = field(default_factory=dict)      # a number, or a file
    truths: Mapping[str, str] = field(default_factory=dict)     # files


def read_regions(path: Path) -> StatedRegions:
    """The regions of a TOML file; files that it names lie beside it.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If it cannot be read, or a key is unknown or of another kind.
    """
    tables = checked(RegionsFile, read_toml(path, ADVICE), path.name).regions

    def given(key: str) -> dict[str, str]:
        values = {name: getattr(table, key) for name, table in tables.items()}
        return {name: str(path.parent / value) if isinstance(value, str) else str(value)
                for name, value in values.items() if value is not None}
    families = {name: (table.family,) if isinstance(table.family, str) else table.family
                for name, table in tables.items() if table.family is not None}
    return StatedRegions(
        {name: table.rect for name, table in tables.items()}, families,
        {name: table.surface for name, table in tables.items() if table.surface is not None},
        given("known"), given("truth"))
