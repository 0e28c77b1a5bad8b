"""Layout of a session's chart, and the files that say what is known of it."""
from __future__ import annotations

import os
from pathlib import Path

from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.charts.layouts import chart_layout, layout_name
from spectrabox.radiometry.charts.references import reference_file
from spectrabox.radiometry.files import names_a_file
from spectrabox.session.config.session_schema import SessionConfig


def session_chart(config: SessionConfig) -> Chart:
    """Layout of the session's chart.

    Raises
    ------
    InputError
        If its name is not known, or its file is no layout.
    """
    file = config.chart.layout_file
    return chart_layout(config.chart.layout if file is None else str(config.path(file)))


def chart_files(config: SessionConfig) -> list[str]:
    """Names of the files that layout and reflectances of the chart come from, in the session.

    Raises
    ------
    InputError
        As ``session_chart``.
    """
    folder, file, named = config.folder.resolve(), config.chart.layout_file, config.chart.reference
    reference: Path | None
    if file is None:        # of a chart that is sold, no file says anything but one that is named
        layout_name(config.chart.layout)
        reference = folder / named if named is not None and names_a_file(named) else None
    else:
        reference = reference_file(named, session_chart(config), folder)
    placed = None if reference is None else os.path.relpath(reference, folder)
    return [name for name in (file, placed) if name is not None]
