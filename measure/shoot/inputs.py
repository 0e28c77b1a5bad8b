"""The files that a shoot names: where they lie, and what stands in their place."""
from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from spectrabox.measure.shoot.shoot import Shoot
from spectrabox.radiometry import chart, errors, files
from spectrabox.radiometry.charts import layouts, references


@dataclass(frozen=True)
class Inputs:
    """Where the files of a shoot lie.

    Attributes
    ----------
    folder : Path
        From which they are named.
    allow_outside : bool
        Whether they may lie elsewhere.
    given : mapping
        Records in place of files, by the names that the shoot has for them: an ``InputFile`` of a
        photo, a ``Spectrum`` or ``UnknownLight``, a ``Filter``, a ``Chart``.
    """

    folder: Path
    allow_outside: bool = False
    given: Mapping[str, Any] = field(default_factory=dict)

    def path(self, name: str) -> Path:
        """Where a file lies.

        Raises
        ------
        InputError
            If it would leave the folder without having been asked to, or no file can have such a
            name.
        """
        try:
            path = (self.folder / name).resolve()
        except (OSError, ValueError, RuntimeError) as error:    # a zero byte, a link to itself
            raise errors.InputError(f"{name!r} cannot be the name of a file ({error}); correct it"
                             ) from None
        if not self.allow_outside and not path.is_relative_to(self.folder.resolve()):
            raise errors.InputError(f"{name!r} lies outside the session folder; copy it in, "
                             "or allow it with --allow-outside")
        return path

    @property
    def bounds(self) -> Path | None:
        """The folder that no file may leave."""
        return None if self.allow_outside else self.folder


def chart_of(shoot: Shoot, inputs: Inputs) -> chart.Chart:
    """Layout of the chart.

    Raises
    ------
    InputError
        If its name is not known, or its file is no layout.
    """
    if shoot.chart.layout in inputs.given:
        return inputs.given[shoot.chart.layout]
    file = shoot.chart.layout_file
    return layouts.chart_layout(shoot.chart.layout if file is None else str(inputs.path(file)))


def chart_files(shoot: Shoot, inputs: Inputs) -> list[str]:
    """Names of the files that layout and reflectances of the chart come from, as seen from the
    folder.

    Raises
    ------
    InputError
        As ``chart_of``.
    """
    folder, file, named = inputs.folder.resolve(), shoot.chart.layout_file, shoot.chart.reference
    reference: Path | None
    if file is None:        # of a chart that is sold, no file says anything but one that is named
        if shoot.chart.layout not in inputs.given:
            layouts.layout_name(shoot.chart.layout)
        reference = folder / named if named is not None and files.names_a_file(named) else None
    else:
        reference = references.reference_file(named, chart_of(shoot, inputs), folder)
    placed = None if reference is None else os.path.relpath(reference, folder)
    return [name for name in (file, placed) if name is not None]
