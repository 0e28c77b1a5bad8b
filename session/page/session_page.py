"""What the page of one session shows, and what it takes; the last report of its folder."""
from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any

from spectrabox.capture.photo.preview import photo_orientation
from spectrabox.measure.shoot import inputs, shoot
from spectrabox.radiometry import chart, files
from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.radiometry.system.words import plain, shortened
from spectrabox.session.config import session_file
from spectrabox.session.kept_stages import stage_states
from spectrabox.session.meters.page_meter import PageMeter
from spectrabox.session.page import answers, live, marks, written_session
from spectrabox.session.page.photo_views import PhotoFile, PhotoViews
from spectrabox.session.page.run_control import RunControl
from spectrabox.session.page.shooting import PHOTO_SUFFIXES, Shooting

REPORT, NUMBERS = "report.html", "report.json"
MARKED = ("marked.csv", "marked.spdx")      # spectra of what is marked now


class SessionPage:
    """What the page of one session can do.

    Parameters
    ----------
    folder : Path
        With a session.toml.
    watched : Path, optional
        Folder of new photos.
    allow_outside : bool
        Whether the session may name files elsewhere.
    run : RunControl, optional
        Of this session, where one has begun.
    meter_ports : sequence of str
        Of instruments, which the computer does not list.
    """

    def __init__(self, folder: Path, watched: Path | None = None,
                 allow_outside: bool = False, run: RunControl | None = None,
                 meter_ports: Sequence[str] = ()) -> None:
        self.folder = folder.resolve()
        self.photos = PhotoViews()
        self.marks = marks.MarkedSession(self.folder, self.photos, allow_outside)
        self.marks.read()
        self.run = run or RunControl(self.folder, ("--allow-outside",) if allow_outside else ())
        self.live = live.LiveSample(self.run, self.photos)
        self.report = LastReport(self.folder)
        self.meter = PageMeter(self.folder, meter_ports)
        self.shooting = None if watched is None else Shooting(watched.resolve(), self._chart())
        self._allow_outside = allow_outside
        self._states: tuple[Any, list[dict[str, Any]]] = (None, [])
        self._states_lock = threading.Lock()
        self._receiving: set[Path] = set()
        self._readable: shoot.Shoot | None = None  # tables as they were last well written

    def start(self) -> None:
        """Begin what goes on beside the answers."""
        self.live.start()
        if self.shooting is not None:
            self.shooting.start()
        self.state()

    def stop(self) -> None:
        """Ask a run that goes on to end."""
        self.run.stop()

    def close(self) -> None:
        """Watch no longer, and stop a run that goes on."""
        self.live.end()
        if self.shooting is not None:
            self.shooting.end()
        self.meter.close()
        self.run.end()

    def state(self) -> dict[str, Any]:
        """All that the page shows but for pixels."""
        config: session_file.SessionConfig | None = None
        try:
            text, digest = self.marks.read()
        except InputError as error:
            text, digest, problems = "", "", [str(error)]
        else:
            config, problems = session_file.session_of_text(text, self.folder, self._allow_outside)
        self.live.follow(config)
        live = self.live.state()
        tables = written_session.shown_tables(text)
        marks = written_session.marks_of(tables)
        photos = []
        for role, name in written_session.photos_of(self._tables_of_photos(text)).items():
            path = self._inside(name)
            if path is not None:
                photos.append({"role": role, "file": name, "there": path.is_file(),
                               "look": self.photos.look(path)})
        marked: Sequence[str] = ()      # files of what is marked now, which no report need hold
        if live is not None and live["ready"] and marks["regions"]:
            marked = MARKED
        named = tables is not None and "name" in tables.session.model_fields_set
        name = tables.session.name if tables is not None and named else plain(self.folder.name)
        return {
            "name": name, "digest": digest, "problems": problems, "photos": photos, "undo":
            self.marks.can_undo(text), "marks": marks, "corner_names":
            written_session.corner_names(tables), "facts": written_session.facts_of(tables),
            "stages": self._stages(text, config), "run": self.run.state(), "live": live, "report":
            self.report.stamp(), "exports": [*marked, *self.report.exports()
                                             ], "reported": self.report.verdict(), "shooting":
            None if self.shooting is None else self.shooting.state()
        }

    def photo_file(self, role: str) -> PhotoFile:
        """File of a photo by what it is, or of a new shot of the watched folder.

        Raises
        ------
        InputError
            If there is none, or it lies outside the session and the watched folder.
        """
        kind, _, name = role.partition(":")
        if kind == "shot" and self.shooting is not None:
            shot = self.shooting.path(name)
            return PhotoFile(shot, photo_orientation(shot))
        tables = self._tables_of_photos(self.marks.read()[0])
        named = written_session.photos_of(tables)
        if tables is not None and role in named:
            path = self._inside(named[role])
            if path is not None:
                return PhotoFile(path, tables.photos.orientation)
        raise InputError(f"the session has no photo {shortened(role)}; it has {', '.join(named)}")

    @contextlib.contextmanager
    def received(self, name: str) -> Iterator[tuple[IO[bytes], str]]:
        """A file for a photo or a spectrum that comes in, and its name in the session; it counts
        once it is whole, and none is written over.

        Parameters
        ----------
        name : str
            As a browser gives it.

        Raises
        ------
        InputError
            If it is no name of a file.
        """
        safe = answers.safe_name(name)
        part = "photos" if Path(safe).suffix.lower() in PHOTO_SUFFIXES else "spectra"
        folder = self.folder / part
        with files.writable(folder):
            folder.mkdir(exist_ok=True)
        target = answers.unused_path(folder / safe, self._receiving)
        self._receiving.add(target)         # of two that have one name each gets its own
        try:
            with files.writable(folder), files.whole_file(target) as unfinished, \
                    unfinished.open("wb") as file:
                yield file, f"{part}/{target.name}"
        finally:
            self._receiving.discard(target)

    def _tables_of_photos(self, text: str) -> shoot.Shoot | None:
        """Tables that name the photos; while a fault is being mended, those from before it, so that
        the photo is still shown. None where there were none.
        """
        tables = written_session.shown_tables(text)
        if tables is not None:
            self._readable = tables
        return self._readable

    def _inside(self, name: str) -> Path | None:
        """Where a file of the session lies; None where it may not, or where no file can."""
        try:
            path = (self.folder / name).resolve()
            path.is_file()
        except (OSError, ValueError, RuntimeError):     # too long, with a NUL, a link to itself
            return None
        return path if self._allow_outside or path.is_relative_to(self.folder) else None

    def _chart(self) -> chart.Chart:
        config, _ = session_file.session_of_text(self.marks.read()[0], self.folder)
        try:
            return chart.CLASSIC if config is None else inputs.chart_of(config, config.inputs)
        except SpectraboxError:
            return chart.CLASSIC

    def _stages(self, text: str, config: session_file.SessionConfig | None) -> list[dict[str, Any]]:
        """States of the stages, looked at again where something may have changed."""
        now = (text, self.report.stamp(), self.run.running,
               tuple(self.run.state()["lines"][-1:]))
        with self._states_lock:
            if self._states[0] != now:
                states: list[dict[str, Any]] = []
                if config is not None:
                    with contextlib.suppress(SpectraboxError):
                        states = [{"name": name, "state": state, "reasons": list(reasons)}
                                  for name, (state, reasons) in stage_states(config).items()]
                self._states = (now, states)
            return self._states[1]


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
            with contextlib.suppress(SpectraboxError, OSError, ValueError, KeyError,
                                     TypeError, RecursionError):
                numbers = json.loads(files.read_text(self.folder / NUMBERS))
                verdict = {"status": str(numbers["verdict"]["status"]),
                           "says": str(numbers["verdict"]["says"]),
                           "conditions": list(numbers["conditions"]),
                           "session": numbers["made_from"]["session"][session_file.FILE_NAME]}
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
