"""The report that a session's folder holds: when it was written, its verdict, its files."""
from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

from spectrabox.radiometry import errors, files
from spectrabox.session.config.session_file import FILE_NAME

REPORT, NUMBERS = "report.html", "report.json"


class LastReport:
    """The last report of a session.

    Parameters
    ----------
    folder : Path
        Of the session.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.path = folder / REPORT
        self._verdict: tuple[int | None, dict[str, Any] | None] = None, None

    def stamp(self) -> int | None:
        """When it was written, by which the page notices a new one; None where there is none."""
        try:
            return self.path.stat().st_mtime_ns // 1_000_000
        except OSError:
            return None

    def verdict(self) -> dict[str, Any] | None:
        """Its verdict with the reason, what it rests on, and the digest of the session.toml that
        it was made from; None where there is none.
        """
        stamp = self.stamp()
        if self._verdict[0] != stamp:
            verdict = None
            with contextlib.suppress(errors.SpectraboxError, OSError, ValueError, KeyError,
                                     TypeError, RecursionError):
                numbers = json.loads(files.read_text(self.folder / NUMBERS))
                verdict = {"status": str(numbers["verdict"]["status"]),
                           "says": str(numbers["verdict"]["says"]),
                           "conditions": list(numbers["conditions"]),
                           "session": numbers["made_from"]["session"][FILE_NAME]}
            self._verdict = stamp, verdict
        return self._verdict[1]

    def exports(self) -> dict[str, Path]:
        """Files with spectra that it left, by name in the session."""
        if self.stamp() is None:
            return {}
        paths = [self.folder / "spectra.csv", *sorted((self.folder / "spdx").glob("*.spdx")),
                 *sorted((self.folder / "results" / "picture").glob("*.exr"))]
        return {path.relative_to(self.folder).as_posix(): path for path in paths
                if path.is_file() and path.resolve().is_relative_to(self.folder)}
