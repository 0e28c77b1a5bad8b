"""Layout of a session's chart, and the files that say what is known of it."""
from __future__ import annotations

import os

from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.charts.layouts import chart_layout
from spectrabox.radiometry.charts.references import reference_file
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
    """Names of the files that layout and reflectances of the chart come from, in the session."""
    folder = config.folder.resolve()
    reference = reference_file(config.chart.reference, session_chart(config), folder)
    named = None if reference is None else os.path.relpath(reference, folder)
    return [name for name in (config.chart.layout_file, named) if name is not None]
