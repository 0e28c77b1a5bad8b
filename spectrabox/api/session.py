"""A session folder, as the command line knows it."""
from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from spectrabox.api import flat, scene
from spectrabox.api.progress import ProgressLike, progress_steps
from spectrabox.measure import captured, estimate, plots
from spectrabox.radiometry.errors import CheckError
from spectrabox.reconstruct.rendering.renderer import threads_given_back
from spectrabox.session import kept_stages, pipeline
from spectrabox.session.config.session_file import read_session
from spectrabox.session.outputs import run_outputs, session_results
from spectrabox.session.problems import check_session
from spectrabox.session.store import locks, rehearsals


class Session(Mapping[str, estimate.Estimate]):
    """A session folder: check it, run it, and look at its surfaces by name.

    Parameters
    ----------
    folder : path
        With a ``session.toml``.
    allow_outside : bool
        Whether ``session.toml`` may name files outside of the folder.

    Raises
    ------
    InputError
        If there is no session, or its file is not right; every fault is named.

    References
    ----------
    The folder: docs/reference/session.md. How to read its report: docs/how-to/report.md.

    Examples
    --------
    >>> session = sb.Session("mybox")
    >>> session.check()
    >>> session.run()
    >>> session["cube"].plot()
    """

    def __init__(self, folder: str | Path, allow_outside: bool = False) -> None:
        self.folder = Path(folder)
        self._allow_outside = allow_outside
        self.config = read_session(self.folder, allow_outside)

    def check(self) -> None:
        """Read every input; run nothing long.

        Raises
        ------
        CheckError
            If anything would stop or spoil a run; its message names everything at once.
        """
        problems = check_session(self.folder, self._allow_outside).problems
        if problems:
            raise CheckError("\n".join(problems))

    @threads_given_back()
    def run(self, *, device: str = "auto", force: bool = False,
            progress: ProgressLike = None) -> Session:
        """Run every stage whose inputs changed, and write report and spectra into the folder.

        Parameters
        ----------
        device : {"auto", "cpu", "cuda"}
            That traces the light.
        force : bool
            Run also what is up to date.
        progress : bool or function, optional
            True shows a bar; a function is called with the share of a stage that is done, and
            what is being done. By default a bar is shown in notebooks and on terminals.

        Returns
        -------
        Session
            This one.

        Raises
        ------
        SpectraboxError
            With the sentences of ``spectrabox run``.
        """
        self.config = read_session(self.folder, self._allow_outside)
        with locks.only_writer(self.config.folder, "Session.run"), \
                progress_steps(progress, "session") as step:
            def show(stage: str, share: float, message: str) -> None:
                step(share, f"{stage} {message}")

            finished = pipeline.run_stages(self.config, device=device, only=None, force=force,
                                           progress=show)
            run_outputs.outputs_of_run(self.config, finished,
                                       ["spectrabox", "run", self.folder.name, "--device", device],
                                       device, show)
        return self

    @property
    def report(self) -> Path:
        """The report of the last run."""
        return self.config.folder / "report.html"

    @property
    def spectra(self) -> flat.FlatSpectra | scene.SceneSpectra:
        """What the last run found, as ``flat`` and ``reconstruct_scene`` return it.

        Raises
        ------
        InputError
            If the session has not been run.
        """
        run = kept_stages.load_finished(self.config)
        pictures = session_results.picture_folder(self.config)
        if isinstance(run.capture, captured.FlatCapture):
            return flat.FlatSpectra(run.capture, run.records, pictures)
        return scene.SceneSpectra(run.capture, run.records,
                                  rehearsals.stored_rehearsal(self.config), pictures,
                                  self.config.folder)

    @property
    def verdict(self) -> str:
        """"pass", "warn" or "fail".

        Raises
        ------
        InputError
            If the session has not been run.
        """
        return self.spectra.verdict

    @property
    def warnings(self) -> list[str]:
        """What the report warns of, in sentences."""
        return list(self.spectra.notes)

    def __getitem__(self, name: str) -> estimate.Estimate:
        return self.spectra[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.config.surfaces)

    def __len__(self) -> int:
        return len(self.config.surfaces)

    def __repr__(self) -> str:
        return (f"<Session {self.folder}: {self.config.session.name}, "
                f"{len(self)} surfaces: {', '.join(self)}>")

    def _repr_html_(self) -> str:
        return plots.spectrum_html(list(self.values()))
