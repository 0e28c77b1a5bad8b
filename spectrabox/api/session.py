"""A session folder, as the command line knows it; what to do next, of results and of signals."""
from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from spectrabox.api import arguments, estimates, flat, scene
from spectrabox.api.progress import ProgressLike, progress_steps
from spectrabox.measure import captured, estimate, plots
from spectrabox.measure.advice.advice import Advice
from spectrabox.measure.advice.advise import advice_on_signal, stated_outlook
from spectrabox.measure.more_bands.filter_fit import AtHand
from spectrabox.radiometry import errors, grid
from spectrabox.radiometry.spectra.filters import filters_at_hand
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.radiometry.system.threads import one_blas_thread
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
        self._finished: kept_stages.FinishedRun | None = None

    def check(self) -> None:
        """Read every input; run nothing long.

        Raises
        ------
        CheckError
            If anything would stop or spoil a run; its message names everything at once.
        """
        problems = check_session(self.folder, self._allow_outside).problems
        if problems:
            raise errors.CheckError("\n".join(problems))

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
        self.config, self._finished = read_session(self.folder, self._allow_outside), None
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
        run = self._finished = kept_stages.load_finished(self.config, self._finished)
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


@one_blas_thread()
def advise(known: estimates.MeasuredSpectra | estimate.Estimate | Session | str | Path, *,
           lamps: Sequence[str] | Mapping[str, arguments.LightLike] | None = None,
           filters: str | Path | Mapping[str, arguments.FilterLike] | None = None,
           camera: arguments.CameraLike | None = None,
           light: arguments.LightLike | None = None) -> tuple[Advice, ...]:
    """What to do next, the best first.

    Parameters
    ----------
    known : result of `flat` or `reconstruct_scene`, Session or its folder, or estimate
    lamps : sequence of names or files, or mapping, optional
        Lamps at hand; where neither they nor filters are given, common ones.
    filters : path or mapping, optional
        Filters at hand: a file, a folder of files, or transmittances by name.
    camera : name, path, CameraEstimate, Calibration or (nm, curves), optional
        That saw the signal of an estimate, so that lamps and filters are weighed for it.
    light : name, path, (nm, values) or Spectrum
        Of that signal, with ``camera``.

    Returns
    -------
    tuple of Advice
        Each with ``says``, ``cost``, ``width_before``, ``width_after``, ``colour_before``,
        ``colour_after`` and ``how_to``.

    Raises
    ------
    InputError
        If a lamp, a filter or a session cannot be read, lamps and filters are asked of one region,
        or ``known`` is none of these.

    References
    ----------
    What each action is, and how it is forecast: docs/how-to/next.md.

    Examples
    --------
    >>> orange = sb.sample([0.53, 0.24, 0.08], camera="Nikon 5100 (NPL)", light="D65", noise=0.003)
    >>> for one in sb.advise(orange, lamps=["A", "FL11"], camera="Nikon 5100 (NPL)", light="D65"):
    ...     print(one.text)
    """
    hand = _at_hand(lamps, filters)
    if isinstance(known, str | Path):
        known = Session(known)
    if isinstance(known, Session):
        known = known.spectra
    if isinstance(known, estimates.MeasuredSpectra):
        if hand is None and known.found.failed_advice is None:
            return known.advice
        return known.found.advise(hand).overall
    if isinstance(known, estimate.Estimate):
        if (camera is None) != (light is None):
            raise errors.InputError(
                "lamps and filters are weighed for a signal by its camera and its "
                "light: give both, camera= and light=")
        if hand is None and camera is None:
            return known.advise() if known.failed_extras else known.advice
        if known.measurement is None or known.prior is None or known.summary is None \
                or known.measurement.states is not None:
            raise errors.InputError(
                f"lamps and filters are weighed for all regions of a photo together: "
                f"give the result that {known.name!r} is of")
        return advice_on_signal(
            known.measurement, known.prior, known.summary.level, found=stated_outlook(known),
            hand=hand, curves=None if camera is None else arguments.as_curves(camera),
            present=None if light is None
            else spectrum_on_grid(arguments.as_spectrum(light), grid.FINE_GRID))
    raise errors.InputError(
        f"advise() takes a result of flat or reconstruct_scene, a session or its "
        f"folder, or an estimate, and got {type(known).__name__}")


def _at_hand(lamps: Sequence[str] | Mapping[str, arguments.LightLike] | None,
             filters: str | Path | Mapping[str, arguments.FilterLike] | None) -> AtHand | None:
    """Lamps and filters by name; None where neither is given."""
    if lamps is None and filters is None:
        return None
    by_name = lamps if isinstance(lamps, Mapping) else {name: name for name in lamps or ()}
    if isinstance(filters, str | Path):
        passed = filters_at_hand(Path(filters))
    else:
        passed = {name: arguments.as_filter(each) for name, each in (filters or {}).items()}
    return {**{name: spectrum_on_grid(arguments.as_spectrum(each), grid.FINE_GRID)
               for name, each in by_name.items()}, **passed}
