"""The page of a batch: every session's verdict, with a link to its report."""
from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

from spectrabox.radiometry.files import whole_file
from spectrabox.session.batch.manifest import Outcome
from spectrabox.session.batch.table import counts
from spectrabox.session.report.page import style_sheet, templates

FILE = "batch.html"
# the status whose colours a row has
SHOWN = {"pass": "PASS", "warn": "WARN", "fail": "FAIL", "": "FAIL"}


def write_page(out: Path, outcomes: Sequence[Outcome], sessions: int) -> Path:
    """Write ``batch.html`` into the batch's folder, whole or not at all.

    Parameters
    ----------
    outcomes : sequence of Outcome
        In the order in which the sessions were named.
    sessions : int
        All that were named; those without an outcome are still to be run.
    """
    page = out / FILE
    rows = [{"name": each.name, "folder": os.path.relpath(each.folder, out),
             "link": None if each.report is None else link(Path(each.report), out),
             "status": SHOWN[each.verdict], "word": each.word, "seconds": each.seconds,
             "says": each.says.splitlines()} for each in outcomes]
    text = templates().get_template("batch.html.j2").render(
        rows=rows, sessions=sessions, counts=counts(outcomes),
        style=style_sheet())
    with whole_file(page) as unfinished:
        unfinished.write_bytes(text.encode("utf-8", "backslashreplace"))
    return page


def link(file: Path, folder: Path) -> str:
    """A file as a page in a folder links to it; whatever its name, the link is relative."""
    return "./" + quote(os.fsencode(Path(os.path.relpath(file, folder)).as_posix()))
