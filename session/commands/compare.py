"""Commands that compare finished sessions."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.session.command_line import Answer, CommonOptions, Outside, command

if TYPE_CHECKING:
    from spectrabox.measure.comparison import (
        ControlVerdict,
        LastingShift,
        SessionQuantities,
        SurfacePair,
    )


def register(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    for function in (compare, catalogue):
        app.command()(function)


@dataclass(frozen=True, kw_only=True)
class CompareRequest(CommonOptions):
    """Options of ``spectrabox compare``."""

    folders: Annotated[tuple[Path, ...], typer.Argument(
        metavar="DIR...", show_default=False, help="Finished sessions, two or more, in the order "
        "in which they were taken.")]
    allow_outside: Outside = False


@command
def compare(request: CompareRequest) -> Answer:
    """What changed between sessions: camera, light, chart, and surfaces of one name."""
    from spectrabox.measure.comparison import control_chart, lasting_shifts, surface_pairs
    from spectrabox.session.compare.quantities import session_quantities
    if len(request.folders) < 2:
        raise InputError("one session cannot be compared; name two or more")
    sessions = [session_quantities(folder, request.allow_outside) for folder in request.folders]
    verdicts, pairs = control_chart(sessions), surface_pairs(sessions)
    shifts = lasting_shifts(sessions)
    return Answer(_facts(sessions, verdicts, shifts, pairs),
                  _text(sessions, verdicts, shifts, pairs))


@dataclass(frozen=True, kw_only=True)
class CatalogueRequest(CommonOptions):
    """Options of ``spectrabox catalogue``."""

    root: Annotated[Path, typer.Argument(
        metavar="DIR", show_default=False, help="Folder of sessions.")]
    out: Annotated[Path | None, typer.Option(
        "--out", "-o", metavar="FILE.sqlite", help="Where to write it: DIR/sessions.sqlite by "
        "default.")] = None
    allow_outside: Outside = False


@command
def catalogue(request: CatalogueRequest) -> Answer:
    """Every session under a folder, made anew as an SQLite file, and those that are out of line."""
    from spectrabox.measure.comparison import control_chart, lasting_shifts
    from spectrabox.radiometry.files import writable
    from spectrabox.session.compare.catalogue import write_catalogue
    from spectrabox.session.compare.quantities import find_sessions, session_quantities
    path = request.out or request.root / "sessions.sqlite"
    if path.suffix != ".sqlite":
        raise InputError(f"{path} is no name of a catalogue; give one that ends in .sqlite")
    sessions, skipped = [], []
    for folder in find_sessions(request.root):
        try:
            sessions.append(session_quantities(folder, request.allow_outside))
        except SpectraboxError as error:
            skipped.append(f"{folder.relative_to(request.root)} is left out: {error}")
    if not sessions:
        raise InputError("\n".join([f"{request.root} holds no session with results", *skipped]))
    verdicts = control_chart(sessions)
    with writable(path.parent):
        write_catalogue(path, request.root, sessions, verdicts)
    shifts = lasting_shifts(sessions)
    facts = {**_facts(sessions, verdicts, shifts, []), "file": str(path), "skipped": skipped}
    return Answer(facts, "\n".join([_text(sessions, verdicts, shifts, []), *skipped,
                                    f"wrote {path}: {len(sessions)} sessions"]))


def _facts(sessions: Sequence[SessionQuantities], verdicts: Sequence[ControlVerdict],
           shifts: Sequence[LastingShift], pairs: Sequence[SurfacePair]) -> dict[str, Any]:
    return {"sessions": [{"folder": str(one.folder), "name": one.name, "camera": one.camera,
                          "light": one.light, "finished": one.finished,
                          "quantities": {name: {"value": each.value,
                                                "standard_error": each.standard_error}
                                         for name, each in one.quantities.items()}}
                         for one in sessions],
            "out": [{"folder": str(sessions[one.session].folder), "quantity": one.quantity,
                     "value": one.value, "middle": one.middle, "limit": one.limit}
                    for one in verdicts if one.out],
            "shifts": [{"quantity": one.quantity, "from": str(sessions[one.first].folder),
                        "size": one.size, "standard_error": one.standard_error,
                        "before": one.before, "after": one.after} for one in shifts],
            "surfaces": [{"surface": one.surface, "folders": [str(sessions[one.first].folder),
                                                              str(sessions[one.second].folder)],
                          "delta_e00": one.delta_e00, "rms": one.rms,
                          "share_out": one.share_out, "disagree": one.disagree}
                         for one in pairs]}


def _text(sessions: Sequence[SessionQuantities], verdicts: Sequence[ControlVerdict],
          shifts: Sequence[LastingShift], pairs: Sequence[SurfacePair]) -> str:
    from spectrabox.measure.comparison import control_sentence, shift_sentence
    lines = [f"{one.folder}  {one.finished}  {one.camera or 'no chart photo'}, {one.light}"
             for one in sessions]
    for one in pairs:
        names = f"{sessions[one.first].folder} and {sessions[one.second].folder}"
        lines.append(f"{one.surface}: {names} differ by {one.delta_e00:.1f} CIEDE2000 (rms "
                     f"{one.rms:.3f}), " + (f"beyond both errors at {one.share_out:.0%} of the "
                                            "wavelengths" if one.disagree
                                            else "within their errors"))
    out = [one for one in verdicts if one.out]
    lines += [control_sentence(one, str(sessions[one.session].folder)) for one in out]
    lines += [shift_sentence(one, str(sessions[one.first].folder)) for one in shifts]
    if not verdicts:
        lines.append("no two of these sessions have one camera under one light: brightness and "
                     "colour balance are not compared")
    elif not out and not shifts:
        lines.append("camera, light and chart are as before, within photo-to-photo repeatability")
    return "\n".join(lines)
