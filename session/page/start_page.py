"""The page from which sessions are opened, and made of photos that are dropped."""
from __future__ import annotations

import contextlib
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any

from spectrabox.capture.photo.linear import photo_size
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import whole_file, writable
from spectrabox.radiometry.system.words import plain, shortened
from spectrabox.session.config.session_file import FILE_NAME
from spectrabox.session.flat import new_session
from spectrabox.session.page import answers, session_page, shooting


class StartPage:
    """Sessions of the working folder, and photos that are dropped to make one.

    Parameters
    ----------
    folder : Path
        In which sessions are listed and made.
    meter_ports : sequence of str
        As of ``SessionPage``.
    """

    def __init__(self, folder: Path, meter_ports: Sequence[str] = ()) -> None:
        self.folder, self._meter_ports = folder.resolve(), meter_ports
        self.mount: Callable[[str, session_page.SessionPage], None] = lambda path, page: None
        self._pages: dict[Path, tuple[str, session_page.SessionPage]] = {}
        self._staging: Path | None = None
        self._lock = threading.Lock()

    def start(self) -> None:
        """Nothing goes on until a session is opened."""

    def stop(self) -> None:
        """Ask runs that go on to end."""
        for _, page in self._pages.values():
            page.stop()

    def close(self) -> None:
        """Close the sessions that were opened, and forget photos that were dropped in vain."""
        for _, page in self._pages.values():
            page.close()
        if self._staging is not None:
            shutil.rmtree(self._staging, ignore_errors=True)

    def sessions(self) -> dict[str, Any]:
        """Names of the session folders, the last one first."""
        files = [path / FILE_NAME for path in self.folder.iterdir()
                 if not path.is_symlink() and (path / FILE_NAME).is_file()]
        files.sort(key=lambda path: -path.stat().st_mtime)
        names = [file.parent.name for file in files]
        return {"folder": plain(str(self.folder)),
                "sessions": [name for name in names if plain(name) == name]}

    @contextlib.contextmanager
    def received(self, name: str) -> Iterator[tuple[IO[bytes], str]]:
        """A file for a photo that comes in, and its name; it counts once it is whole.

        Parameters
        ----------
        name : str
            As a browser gives it.

        Raises
        ------
        InputError
            If it is no name of a photo.
        """
        safe = answers.safe_name(name)
        if Path(safe).suffix.lower() not in shooting.PHOTO_SUFFIXES:
            raise InputError(f"{shortened(name)} is no photo that can be measured; drop a camera "
                             "raw, or a linear EXR or TIFF")
        with self._lock:
            if self._staging is None:
                with writable(self.folder):
                    self._staging = Path(tempfile.mkdtemp(prefix=".dropped-", dir=self.folder))
        with writable(self._staging), whole_file(self._staging / safe) as unfinished, \
                unfinished.open("wb") as file:
            yield file, safe

    def make(self, names: list[str]) -> dict[str, str]:
        """Make a session of photos that were dropped, and open it.

        Parameters
        ----------
        names : list of str
            As the browser gave them, the first photo first.

        Raises
        ------
        InputError
            If one of them is no photo.
        """
        with self._lock:
            folder, self._staging = self._staging, None
        if folder is None:
            raise InputError("drop a photo first")
        try:
            photos = [folder / answers.safe_name(name) for name in names]
            for photo in photos:
                photo_size(photo)       # refuses what is no photo
            target = answers.unused_path(self.folder / new_session.folder_beside(photos[0]).name)
            with new_session.new_session(new_session.tables_without_regions(*photos), target):
                return self.open(target.name)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def open(self, name: str) -> dict[str, str]:
        """Where the page of a session of the folder is.

        Parameters
        ----------
        name : str
            Of the session's folder.

        Raises
        ------
        InputError
            If there is no such session.
        """
        if name not in self.sessions()["sessions"]:
            raise InputError(f"there is no session {shortened(name)} here")
        with self._lock:
            folder = self.folder / name
            if folder not in self._pages:
                page = session_page.SessionPage(folder, meter_ports=self._meter_ports)
                path = f"/s/{len(self._pages) + 1}"
                self.mount(path, page)
                page.start()
                self._pages[folder] = path, page
            return {"address": f"{self._pages[folder][0]}/page"}
