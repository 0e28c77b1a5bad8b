"""The command that opens a session's local page."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from spectrabox.session.command_line import DebugOption, Folder, Outside, command, tell


def register(app: typer.Typer) -> None:
    """Add this command to the command line."""
    app.command(name="open")(open_page)


@dataclass(frozen=True, kw_only=True)
class OpenRequest(DebugOption):
    """Options of ``spectrabox open``."""

    folder: Folder
    watch: Annotated[Path | None, typer.Option(
        metavar="DIR", show_default=False, help="Judge each new photo that comes into this folder, "
        "as when shooting tethered.")] = None
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes a free one.")] = 0
    browser: Annotated[bool, typer.Option(
        "--browser/--no-browser", help="Open it in the browser.")] = True
    allow_outside: Outside = False


@command
def open_page(request: OpenRequest) -> None:
    """Open a session's page on this machine: mark photos, run, read the report, judge new shots."""
    from spectrabox.session.page.server import SessionPage, serve

    def say(address: str) -> None:
        print(address, flush=True)
        tell("Ctrl-C ends it. The address holds a token: whoever has it can change this "
             "session from this machine.")
        if request.browser:
            import webbrowser
            webbrowser.open(address)
    serve(SessionPage(request.folder, request.watch, request.allow_outside), request.port, say)
