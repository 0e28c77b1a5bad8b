"""The files that a run reads, as they were when it first looked at them."""
from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import FileState, file_state
from spectrabox.radiometry.spectra.formats.csvw import envi_partner, metadata_path
from spectrabox.session.config.session_file import SessionConfig


class InputFiles:
    """States of a session's files, each taken once.

    Parameters
    ----------
    config : SessionConfig
    """

    def __init__(self, config: SessionConfig) -> None:
        self._config = config
        self.folder = config.folder
        self._states: dict[str, FileState] = {}

    def digests(self, *names: str | None) -> dict[str, str]:
        """SHA-256 of files by name, and of what lies beside them: the other half
        of a spectral library, the metadata of a table.

        Parameters
        ----------
        names : str or None
            As session.toml gives them; None is passed over.

        Raises
        ------
        InputError
            If a file is missing, cannot be read, or lies outside the session folder.
        """
        digests = {}
        for name in self._with_partners(names):
            if name not in self._states:
                self._states[name] = file_state(self._path(name))
            digests[name] = self._states[name].sha256
        return digests

    def require_unchanged(self, names: Iterable[str]) -> None:
        """Refuse results of files that were written to or replaced since their digest was taken.

        Parameters
        ----------
        names : iterable of str
            Of files whose digests were taken.

        Raises
        ------
        InputError
            With the name of the first that is not as it was.
        """
        for name in names:
            if file_state(self._path(name)) != self._states[name]:
                raise InputError(f"{name} was changed or replaced while it was read; leave the "
                                 "files of a session alone while it runs, and run again")

    def _with_partners(self, names: tuple[str | None, ...]) -> Iterable[str]:
        for name in names:
            if name is not None:
                yield name
                path = self._path(name)
                for partner in (envi_partner(path), metadata_path(path)):
                    if partner is not None and partner.is_file():
                        yield str(Path(name).with_name(partner.name))

    def _path(self, name: str) -> Path:
        return self._config.path(name)
