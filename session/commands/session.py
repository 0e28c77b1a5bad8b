"""Commands that work on a session folder, and the demo and doctor."""
from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spectrabox.radiometry.errors import CheckError, EnvironmentProblem, InputError
from spectrabox.session.commands.finished import finished_session
from spectrabox.session.terminal import command_line

if TYPE_CHECKING:
    from spectrabox.session.config.session_file import SessionConfig
    from spectrabox.session.kept_stages import FinishedRun
    from spectrabox.session.terminal.progress_display import StageProgress

STAGE_NAMES = "chart, photo, calibrate, signals (of a scene reconstruct), sample, picture"


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for function in (demo, new, check, run, status, report, doctor):
        app.command()(function)
    app.command(name="open")(open_page)


@command_line.Command
def demo(
    folder: Annotated[Path | None, typer.Argument(
        metavar="[DIR]", help="Where to write it; by default demo-session, with --flat demo-flat, "
        "with --picture demo-picture.")] = None,
    flat: Annotated[bool, typer.Option(
        "--flat", help="A painting with a chart in one photo, without a scene.")] = False,
    picture: Annotated[bool, typer.Option(
        "--picture", help="A box with painted patterns: a spectrum for every pixel.")] = False,
    seed: Annotated[int, typer.Option(help="Random seed of the synthetic photos.")] = 1,
    device: command_line.Device = "auto",
    verbose: command_line.Verbose = False,
) -> command_line.Answer:
    """Make a synthetic capture session with known truth, run it, write its report."""
    if flat and picture:
        raise InputError("--flat and --picture are two demos; run one after the other")
    from spectrabox.session.demo import make_demo, make_flat_demo, make_picture_demo
    kind = "flat" if flat else "picture" if picture else "session"
    folder = folder or Path(f"demo-{kind}")
    {"flat": make_flat_demo, "picture": make_picture_demo,
     "session": make_demo}[kind](folder, seed)
    return run_session(folder, device=device, verbose=verbose)


@command_line.Command
def new(
    folder: command_line.Folder,
    template: Annotated[str | None, typer.Option(
        metavar="box|flat|turntable|views", help="A filled-in session: a box measured with a tape, "
        "flat samples beside a chart, objects on a turntable, one box under several "
        "lights.")] = None,
) -> command_line.Answer:
    """Start a session folder with a commented session.toml."""
    from spectrabox.radiometry.files import writable
    from spectrabox.session.config.session_file import FILE_NAME
    from spectrabox.session.config.template import template_names, write_template
    if template is not None and template not in template_names():
        raise InputError(f"there is no template {template!r}; take one of "
                         f"{', '.join(template_names())}, or none for a session with every key")
    if (folder / FILE_NAME).exists():
        raise InputError(f"{folder / FILE_NAME} exists already; edit it, or choose another "
                         "folder")
    with writable(folder):
        for name in ("photos", "spectra", "scene"):
            (folder / name).mkdir(parents=True, exist_ok=True)
    written = write_template(folder, template)
    return command_line.Answer({"session": str(written)},
                  f"wrote {written}: fill it in, then run 'spectrabox check {folder}'")


@command_line.Command
def check(folder: command_line.Folder,
          allow_outside: command_line.Outside = False) -> command_line.Answer:
    """Check a session before a run: read every input, and list everything that is wrong."""
    from spectrabox.measure import texts
    from spectrabox.radiometry.spectra.cameras import known_camera_words
    from spectrabox.radiometry.system.archives import free_memory
    from spectrabox.session.problems import check_session
    checked = check_session(folder, allow_outside)
    sentences = [*checked.problems]
    text = "\n".join(f"- {sentence}"
                     for sentence in sentences) or "nothing is wrong: ready to run"
    text = "\n".join(filter(None, [text, *map(texts.says, checked.findings), checked.sentence]))
    if checked.known_camera is not None:
        text += f"\n{known_camera_words(checked.known_camera)}"
    memory = None if checked.tracing_bytes is None else {"tracing_bytes": checked.tracing_bytes,
                                                       "free_bytes": free_memory()}
    exit_code = min(checked.problems.values(), default=0)
    facts = {"ready": not sentences, "problems": sentences, "memory": memory,
             "engine": checked.engine, "seconds": checked.seconds,
             "findings": [texts.facts(one) for one in checked.findings],
             "known_camera": checked.known_camera}
    if sentences:       # the keys that every command answers an error with
        facts |= {"error": "\n".join(sentences), "exit_code": exit_code}
    return command_line.Answer(facts, text, exit_code)


@command_line.Command
def run(
    folder: command_line.Folder,
    allow_outside: command_line.Outside = False,
    only: Annotated[str | None, typer.Option(
        metavar="STAGE,...", help=f"These stages alone: {STAGE_NAMES}.")] = None,
    until: Annotated[str | None, typer.Option(
        metavar="STAGE", help="Run up to this stage, and write no report.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Run also what is up to date.")] = False,
    device: command_line.Device = "auto",
    verbose: command_line.Verbose = False,
    quiet: command_line.Quiet = False,
) -> command_line.Answer:
    """Run every stage whose inputs changed, and write the report."""
    return run_session(folder, allow_outside, only=only, until=until, force=force, device=device,
                       verbose=verbose, quiet=quiet)


@command_line.Command
def status(folder: command_line.Folder,
           allow_outside: command_line.Outside = False) -> command_line.Answer:
    """Show which stages are done, which are out of date, and why."""
    from spectrabox.session.config.session_file import read_session
    from spectrabox.session.kept_stages import stage_names, stage_states, states_without_inputs
    from spectrabox.session.store.record_files import load_stage
    config, fault = read_session(folder, allow_outside), None
    try:
        states = stage_states(config)
    except InputError as error:
        states, fault = states_without_inputs(config), error
    stored = {name: load_stage(config.results_folder, name) for name in stage_names(config)}
    seconds = {name: stage.seconds for name, stage in stored.items() if stage is not None}
    lines = [f"{name:<12} {state:<10} "
             + (f"{seconds[name]:.1f} s" if state == "done" else "; ".join(reasons))
             for name, (state, reasons) in states.items()]
    report = folder / "report.html"
    lines.append(f"{'report':<12} {'written' if report.exists() else 'missing'}")
    facts = {"stages": [{"name": name, "state": state, "reasons": list(reasons),
                         "seconds": seconds.get(name)}
                        for name, (state, reasons) in states.items()],
             "report": str(report) if report.exists() else None}
    if fault is None:
        return command_line.Answer(facts, "\n".join(lines))
    return command_line.Answer(facts | {"error": str(fault), "exit_code": fault.exit_code},
                  "\n".join([*lines, str(fault)]), fault.exit_code)


@command_line.Command
def open_page(
    paths: Annotated[tuple[Path, ...], typer.Argument(
        metavar="[DIR|PHOTO...]", show_default=False, help="A session folder; or photos of flat "
        "samples with a colour chart among them, further ones as of 'spectrabox flat', whose "
        "session is made beside the first. Without any, a page that lists the sessions of the "
        "working folder and takes photos that are dropped on it.")] = (),
    watch: Annotated[Path | None, typer.Option(
        metavar="DIR", show_default=False, help="Judge each new photo that comes into this folder, "
        "as when shooting tethered.")] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes a free one.")] = 0,
    meter_port: Annotated[tuple[str, ...], typer.Option(
        "--meter-port", metavar="PORT", show_default=False, help="Port of an instrument that the "
        "page may open besides those that this computer lists; may be repeated.")] = (),
    browser: Annotated[bool, typer.Option(
        "--browser/--no-browser", help="Open it in the browser.")] = True,
    allow_outside: command_line.Outside = False,
) -> None:
    """Open a photo's or session's page on this machine: point at colours, mark, run, read."""
    import webbrowser

    from spectrabox.session.page import run_control, server, session_page

    run = None
    if paths:
        folder = _folder_to_open(paths).resolve()
        run = run_control.RunControl(folder, ("--allow-outside",) if allow_outside else ())
        if folder != paths[0].resolve() and not (folder / "results").exists():
            run.start("calibrate")      # before the page loads its libraries
    from spectrabox.session.page.start_page import StartPage

    def say(address: str) -> None:
        print(address, flush=True)
        command_line.tell(
            "Ctrl-C ends it. The address holds a token: whoever has it can change this "
            "session from this machine.")
    page: session_page.SessionPage | StartPage = StartPage(Path(), meter_port) if run is None \
        else session_page.SessionPage(run.folder, watch, allow_outside, run, meter_port)
    server.serve(page, port, say, webbrowser.open if browser else None)


def _folder_to_open(paths: tuple[Path, ...]) -> Path:
    """The session folder that is named, or that of photos, made where it is missing."""
    from spectrabox.session.config.session_file import FILE_NAME
    from spectrabox.session.flat import new_session
    first, *others = paths
    if first.is_file() and first.name != FILE_NAME:
        if not (new_session.folder_beside(first) / FILE_NAME).is_file():
            with new_session.new_session(new_session.tables_without_regions(*paths), None):
                pass
        return new_session.folder_beside(first)
    if others:
        raise InputError(f"{first} is no photo; give one session folder, or photos of one sample")
    if not first.is_file() and not (first / FILE_NAME).is_file():
        raise InputError(f"{first} is no session; to start from a photo: spectrabox open PHOTO"
                         if first.exists() else f"{first} is missing; give a session folder, or a "
                         "photo that shows a colour chart")
    return first


@command_line.Command
def report(folder: command_line.Folder,
           allow_outside: command_line.Outside = False) -> command_line.Answer:
    """Rebuild report.html and report.json from stored results."""
    from spectrabox.measure import texts
    from spectrabox.session.outputs.run_outputs import rewritten_outputs
    config, finished, stale = finished_session(folder, allow_outside)
    facts, _, _, failed = rewritten_outputs(config, finished, ["spectrabox", "report"],
                                            "stored results")
    report = facts["report"]
    return command_line.Answer({"report": report, "stale": stale,
                   "failed_extras": facts["failed_extras"]},
                  "\n".join([f"wrote {report}",
                             *(f"note: {texts.says(one)}" for one in failed)]),
                  failed=failed)


@command_line.Command
def doctor(device: command_line.Device = "auto") -> command_line.Answer:
    """Check whether this machine is ready: LLVM, GPU, versions."""
    from spectrabox.session.doctor import examine
    facts = examine(device)
    llvm = facts["llvm"]
    lines = [f"{'ready' if facts['ready'] else 'NOT READY'}: "
             f"{facts['variant'] or 'no renderer'}, LLVM "
             f"{llvm['version'] if llvm else 'none'}, {facts['cores']} cores, Python "
             f"{facts['python']}"]
    lines += [f"{name} {version}" for name, version in facts["versions"].items()]
    lines += [f"- {problem}" for problem in facts["problems"]]
    lines.append("rendering on a GPU (--device cuda) is untested; without it the CPU renders")
    return command_line.Answer(facts, "\n".join(lines),
                               EnvironmentProblem.exit_code if facts["problems"] else 0)


def run_session(folder: Path, allow_outside: bool = False, *, only: str | None = None,
                until: str | None = None, force: bool = False, device: str = "auto",
                verbose: bool = False, quiet: bool = False,
                words: list[str] | None = None) -> command_line.Answer:
    """Run the stages of a session that are asked for, and write its report after the last.

    Parameters
    ----------
    folder, allow_outside, only, until, force, device, verbose, quiet
        As the options of ``spectrabox run``.
    words : list of str, optional
        The command as the operator could type it again, for the report; that of ``run`` by default.
    """
    from spectrabox.session import kept_stages
    from spectrabox.session.config.session_file import read_session
    from spectrabox.session.outputs.run_outputs import outputs_of_run
    from spectrabox.session.store.locks import only_writer
    from spectrabox.session.terminal.progress_display import progress_display, with_time_left

    config = read_session(folder, allow_outside)
    order = kept_stages.stage_names(config)
    wanted = kept_stages.stages_in_order(only, order)
    if until is not None and (only is not None or until not in order):
        raise InputError(f"--until {until}: one of the stages {', '.join(order)} is "
                         "needed, without --only")
    after = None if until is None else dict(pairwise([*order, None]))[until]
    words = words or ["spectrabox", "run", folder.name, "--device", device,
                      *(["--force"] if force else []),
                      *(["--only", only] if only else []),
                      *(["--until", until] if until else [])]
    with only_writer(config.folder, " ".join(words[:2])), \
            progress_display(quiet) as show:
        progress = with_time_left(show)
        all_of_them = wanted == [None] and after is None and not force
        with _with_all_faults(config):
            kept = kept_stages.kept_run(config, device, progress) if all_of_them else None
            finished = kept or _finished_run(config, wanted, after, device, force, progress)
        if wanted[-1] not in (None, "sample") or after is not None:
            seconds = {stage: finished.stored[stage].seconds
                       for stage in (wanted if after is None else finished.stored) if stage}
            return command_line.Answer(
                {"stages": [{"name": stage, "seconds": taken, "state": "run"}
                            for stage, taken in seconds.items()],
                 "report": None, "materials": []},
                "\n".join([*(f"stage {stage} took {taken:.1f} s"
                             for stage, taken in seconds.items()),
                           "run without --only and --until for the report"]))
        finished = kept_stages.load_finished(config) if only is not None else finished
        facts, brief, text, failed = outputs_of_run(config, finished, words, device, progress)
    return command_line.Answer(facts, text if verbose else brief, failed=failed)


def _finished_run(config: SessionConfig, wanted: Sequence[str | None], before: str | None,
                  device: str, force: bool, progress: StageProgress) -> FinishedRun:
    """Run each stage that is wanted, None being all; what makes them is loaded only here."""
    from spectrabox.session.pipeline import run_stages
    for stage in wanted:
        finished = run_stages(config, device=device, only=stage, force=force,
                              progress=progress, before=before)
    return finished


@contextlib.contextmanager
def _with_all_faults(config: SessionConfig) -> Iterator[None]:
    """Where an input is at fault, everything that ``check`` finds is said with it."""
    try:
        yield
    except (InputError, CheckError) as error:
        from spectrabox.session.problems import check_session
        others = check_session(config.folder, config.allow_outside).problems
        raise type(error)(*error.faults, *others) from error
