"""Sessions run and edited by tests, and commands typed, in this process."""
from typer.testing import CliRunner

from spectrabox.session.cli import app
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import run_stages


def silent(*_):
    """No progress."""


def run(folder, progress=silent, *, only=None, force=False):
    """Run the stages of a session, on the processor."""
    return run_stages(read_session(folder), device="cpu", only=only, force=force,
                      progress=progress)


def call(*words):
    """Type a command; what it did not foresee is raised."""
    outcome = CliRunner().invoke(app, [str(word) for word in words])
    if outcome.exception is not None and not isinstance(outcome.exception, SystemExit):
        raise outcome.exception
    return outcome


def edit(folder, before, after, name="session.toml"):
    """Replace a text that a file of the session holds."""
    path = folder / name
    text = path.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after), encoding="utf-8")
