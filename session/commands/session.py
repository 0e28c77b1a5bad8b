"""Commands that work on a session folder, and the demo and doctor."""
from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from spectrabox.radiometry.errors import InputError
from spectrabox.session.command_line import (
    Debug,
    Device,
    Folder,
    Json,
    Outside,
    Quiet,
    answer,
    check_device,
    check_ending,
    command,
    tell,
)

STAGE_NAMES = "chart, photo, calibrate, reconstruct, sample"


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for function in (demo, new, check, run, status, report, relight, doctor):
        app.command()(function)


def demo(folder: Annotated[Path | None, typer.Argument(
             metavar="[DIR]", help="Where to write it: demo-session, demo-flat or "
             "demo-picture.")] = None,
         flat: Annotated[bool, typer.Option("--flat", help="A painting with a chart in one photo, "
                                            "without a scene.")] = False,
         picture: Annotated[bool, typer.Option("--picture", help="A box with painted patterns: a "
                                               "spectrum for every pixel.")] = False,
         seed: Annotated[int, typer.Option(help="Of the synthetic photos.")] = 1,
         device: Device = "auto", as_json: Json = False, debug: Debug = False) -> None:
    """Make a synthetic capture session with known truth, run it, write its report."""
    with command(as_json, debug):
        check_device(device)
        if flat and picture:
            raise InputError("--flat and --picture are two demos; run one after the other")
        from spectrabox.session.demo import make_demo, make_flat_demo, make_picture_demo
        kind = "flat" if flat else "picture" if picture else "session"
        folder = folder or Path(f"demo-{kind}")
        {"flat": make_flat_demo, "picture": make_picture_demo,
         "session": make_demo}[kind](folder, seed)
        execute(folder, only=None, force=False, device=device, allow_outside=False, as_json=as_json)


def new(folder: Folder,
        template: Annotated[str | None, typer.Option(
            metavar="box|flat|turntable|views", help="A filled-in session: a box measured with a "
            "tape, flat samples beside a chart, objects on a turntable, one box under several "
            "lights.")] = None,
        as_json: Json = False, debug: Debug = False) -> None:
    """Start a session folder with a commented session.toml."""
    with command(as_json, debug):
        from spectrabox.radiometry.files import writable
        from spectrabox.session.config.session_schema import FILE_NAME
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
        answer(as_json, {"session": str(written)},
               f"wrote {written}: fill it in, then run 'spectrabox check {folder}'")


def check(folder: Folder, allow_outside: Outside = False, as_json: Json = False,
          debug: Debug = False) -> None:
    """Read every input, run nothing long, say everything that is wrong at once."""
    with command(as_json, debug):
        from spectrabox.radiometry.system.free_memory import free_memory
        from spectrabox.session.check import preflight_check
        found = preflight_check(folder, allow_outside)
        problems = found.problems
        sentences = [problem.sentence for problem in problems]
        text = "\n".join(f"- {sentence}"
                         for sentence in sentences) or "nothing is wrong: ready to run"
        text += f"\n{found.sentence}" if found.sentence else ""
        memory = None if found.tracing_bytes is None else {"tracing_bytes": found.tracing_bytes,
                                                           "free_bytes": free_memory()}
        answer(as_json, {"ready": not problems, "problems": sentences, "memory": memory}, text)
        if problems:
            raise typer.Exit(min(problem.exit_code for problem in problems))


def run(folder: Folder,
        only: Annotated[str | None, typer.Option(
            metavar="STAGE,...", help=f"These stages alone: {STAGE_NAMES}.")] = None,
        force: Annotated[bool, typer.Option("--force",
                                            help="Run also what is up to date.")] = False,
        device: Device = "auto", allow_outside: Outside = False, quiet: Quiet = False,
        as_json: Json = False, debug: Debug = False) -> None:
    """Run every stage whose inputs changed, and write the report."""
    with command(as_json, debug):
        check_device(device)
        execute(folder, only=only, force=force, device=device, allow_outside=allow_outside,
                as_json=as_json, quiet=quiet)


def status(folder: Folder, allow_outside: Outside = False, as_json: Json = False,
           debug: Debug = False) -> None:
    """What is done, what is stale and why."""
    with command(as_json, debug):
        from spectrabox.session.config.session_file import read_session
        from spectrabox.session.pipeline import stage_states
        states = stage_states(read_session(folder, allow_outside))
        lines = [f"{state.name:<12} {state.state:<10} "
                 + (f"{state.seconds:.1f} s" if state.state == "done" and state.seconds is not None
                    else "; ".join(state.reasons)) for state in states]
        report = folder / "report.html"
        lines.append(f"{'report':<12} {'written' if report.exists() else 'missing'}")
        answer(as_json,
               {"stages": [{"name": state.name, "state": state.state,
                            "reasons": list(state.reasons), "seconds": state.seconds}
                           for state in states],
                "report": str(report) if report.exists() else None}, "\n".join(lines))


def report(folder: Folder,
           compare: Annotated[bool, typer.Option(
               "--check", help="Write nothing; say whether the report that is there agrees with "
               "its data, the input files and the stored results.")] = False,
           allow_outside: Outside = False, as_json: Json = False, debug: Debug = False) -> None:
    """Rebuild report.html and report.json from stored results, or check those that are there."""
    with command(as_json, debug):
        from spectrabox.session.config.session_file import read_session
        config = read_session(folder, allow_outside)
        if compare:
            from spectrabox.session.report.check import check_report
            found = check_report(config)
            text = "\n".join(f"- {fault}" for fault in found.faults) or (
                f"report and data agree: {found.shown} numbers and sentences of the page, "
                f"{found.files} files, and the numbers made again from the stored results")
            answer(as_json, {"agrees": not found.faults, "faults": list(found.faults),
                             "shown": found.shown, "files": found.files}, text)
            if found.faults:
                raise typer.Exit(4)
            return
        from spectrabox.session.pipeline import load_finished, stale_stages
        from spectrabox.session.run_outputs import rewritten_outputs
        finished = load_finished(config)
        stale, said = stale_stages(config)
        if said:
            tell(f"warning: {said}")
        facts = rewritten_outputs(config, finished, ["spectrabox", "report"],
                                  "stored results").facts
        answer(as_json, {"report": facts["report"], "stale": stale}, f"wrote {facts['report']}")


def relight(folder: Folder,
            light: Annotated[str | None, typer.Option(
                help="A CIE illuminant such as D65 or FL11, or a file; the session's own by "
                "default.")] = None,
            observer: Annotated[str | None, typer.Option(
                help="Colour-matching functions by name or file; CIE 1931 2 degrees by "
                "default.")] = None,
            out: Annotated[Path | None, typer.Option(
                "--out", "-o", metavar="PNG", help="DIR/relit LIGHT.png by default; the same as "
                "EXR lies beside it.")] = None,
            width: Annotated[int, typer.Option(min=16, max=4096, help="In pixels.")] = 480,
            spp: Annotated[int, typer.Option(min=1, max=65536, help="Paths per pixel.")] = 64,
            device: Device = "auto", allow_outside: Outside = False, as_json: Json = False,
            debug: Debug = False) -> None:
    """Render the scene with the recovered spectra under any light, and say how far its colours are
    known there.
    """
    with command(as_json, debug):
        check_device(device)
        check_ending(out, {".png": "a picture; its X, Y, Z go to an EXR beside it"})
        from spectrabox.capture.photo.image_files import write_exr, write_png
        from spectrabox.session.config.session_file import read_session
        from spectrabox.session.pipeline import load_finished, stale_stages
        from spectrabox.session.relight import OBSERVER
        from spectrabox.session.relight import relight as render_under
        from spectrabox.session.run_outputs import require_results
        from spectrabox.session.stages.scenes import read_session_scene
        from spectrabox.session.store.made_from import digests_of
        from spectrabox.session.store.session_lock import outputs_writer
        config = read_session(folder, allow_outside)
        scene = read_session_scene(config)
        size = (width, max(round(width * scene.height / scene.width), 1))
        finished = load_finished(config)
        stale, said = stale_stages(config)
        if said:
            tell(f"warning: {said}")
        digests = digests_of(finished)
        made = render_under(config, finished, light=light, observer=observer or OBSERVER, size=size,
                            spp=spp, device=device)
        label = re.sub(r"[^\w.-]", "-", Path(light or "session").stem)
        png = out or folder / f"relit {label}.png"
        with outputs_writer(config.folder):     # two pictures that belong together
            require_results(finished, digests, "spectrabox relight")
            write_png(png, made.picture)
            write_exr(png.with_suffix(".exr"), made.xyz, ("X", "Y", "Z"))
        lines = [f"{colour.name:<16} L* {colour.lab[0]:5.1f}  a* {colour.lab[1]:6.1f}  b* "
                 f"{colour.lab[2]:6.1f}"
                 + ("   given" if colour.delta_e00_95 is None else
                    f"   draws within dE00 {colour.delta_e00_median:.2f} (half), "
                    f"{colour.delta_e00_95:.2f} (95 %)")
                 for colour in made.colours]
        answer(as_json, {"png": str(png), "exr": str(png.with_suffix(".exr")),
                         "light": light or "session",
                         "colours": [vars(colour) for colour in made.colours],
                         "notes": list(made.notes), "stale": stale},
               "\n".join([*lines, *made.notes, f"picture: {png}"]))


def doctor(device: Device = "auto", as_json: Json = False, debug: Debug = False) -> None:
    """Is this machine ready: LLVM, GPU, versions?"""
    with command(as_json, debug):
        check_device(device)
        from spectrabox.session.doctor import examine
        facts = examine(device)
        llvm = facts["llvm"]
        lines = [f"{'ready' if facts['ready'] else 'NOT READY'}: "
                 f"{facts['variant'] or 'no renderer'}, LLVM "
                 f"{llvm['version'] if llvm else 'none'}, {facts['cores']} cores, Python "
                 f"{facts['python']}"]
        lines += [f"{name} {version}" for name, version in facts["versions"].items()]
        lines += [f"- {problem}" for problem in facts["problems"]]
        answer(as_json, facts, "\n".join(lines))
        if facts["problems"]:
            raise typer.Exit(7)


def execute(folder: Path, *, only: str | None, force: bool, device: str, allow_outside: bool,
            as_json: bool, quiet: bool = False) -> None:
    """Run a session and tell the operator what came of it."""
    from spectrabox.session.config.session_file import read_session
    from spectrabox.session.pipeline import load_finished, run_stages
    from spectrabox.session.progress_display import progress_display, with_time_left
    from spectrabox.session.run_outputs import outputs_of_run
    from spectrabox.session.stages.order import all_stages, stages_in_order, stages_of
    from spectrabox.session.store.session_lock import only_writer

    config = read_session(folder, allow_outside)
    wanted = stages_in_order(only, list(stages_of(config.flat)))
    with only_writer(config.folder, all_stages(), "spectrabox run"), \
            progress_display(quiet) as show:
        progress = with_time_left(show)
        for stage in wanted:
            finished = run_stages(config, device=device, only=stage, force=force,
                                  progress=progress)
        if wanted[-1] not in (None, "sample"):
            took = [(stage, finished.stored[stage].seconds) for stage in wanted if stage]
            answer(as_json, {"stages": [{"name": stage, "seconds": seconds, "state": "run"}
                                        for stage, seconds in took],
                             "report": None, "materials": []},
                   "\n".join([*(f"stage {stage} took {seconds:.1f} s"
                                for stage, seconds in took),
                              "run without --only for the report"]))
            return
        finished = load_finished(config) if only is not None else finished
        command_line = ["spectrabox", "run", folder.name, "--device", device,
                        *(["--force"] if force else []), *(["--only", only] if only else [])]
        outputs = outputs_of_run(config, finished, command_line, device, progress)
    answer(as_json, outputs.facts, outputs.text)
