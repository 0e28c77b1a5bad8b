"""A catalogue of a lab's sessions as an SQLite file, made anew from the folders at any time."""
from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Sequence
from pathlib import Path

from spectrabox.measure.comparison import ControlVerdict, SessionQuantities
from spectrabox.radiometry.files import whole_file

TABLES = """
CREATE TABLE sessions (folder TEXT PRIMARY KEY, name TEXT, camera TEXT, light TEXT, finished TEXT);
CREATE TABLE quantities (folder TEXT REFERENCES sessions, quantity TEXT, value REAL,
  standard_error REAL, middle REAL, control_limit REAL, out INTEGER,
  PRIMARY KEY (folder, quantity));
"""


def write_catalogue(path: Path, root: Path, sessions: Sequence[SessionQuantities],
                    verdicts: Sequence[ControlVerdict]) -> None:
    """Write the catalogue, whole or not at all; nothing in it is not in the folders too.

    Parameters
    ----------
    path : Path
        Replaced where it exists.
    root : Path
        That folders are named from.
    verdicts : sequence of ControlVerdict
        Of these sessions.
    """
    judged = {(one.session, one.quantity): one for one in verdicts}
    # in memory first: SQLite says of a full disk no more than that something is wrong
    with whole_file(path) as unfinished, contextlib.closing(sqlite3.connect(":memory:")) as file:
        file.executescript(TABLES)
        for index, session in enumerate(sessions):
            folder = session.folder.relative_to(root).as_posix()
            file.execute("INSERT INTO sessions VALUES (?, ?, ?, ?, ?)",
                         (folder, session.name, session.camera, session.light, session.finished))
            for name, one in session.quantities.items():
                verdict = judged.get((index, name))
                limits = (None, None, None) if verdict is None else (
                    verdict.middle, verdict.limit, int(verdict.out))
                file.execute("INSERT INTO quantities VALUES (?, ?, ?, ?, ?, ?, ?)",
                             (folder, name, one.value, one.standard_error, *limits))
        file.commit()
        unfinished.write_bytes(file.serialize())
