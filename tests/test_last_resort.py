"""What the installed command does with errors that nobody foresaw, with signals, and with words
that a terminal would obey.
"""
import json
import os
import signal
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

import pytest
from typer.main import get_command

from spectrabox.session.cli import app
from spectrabox.session.terminal.command_line import (
    reported_errors,
)

from tests.session_runs import call

ROOT = Path(__file__).resolve().parent.parent
COMMAND = Path(sysconfig.get_path("scripts")) / "spectrabox"
# Stands before the standard library's own: an error that no code of ours can foresee.
FAULT = """
class TOMLDecodeError(ValueError): pass
def loads(text): raise {error}
"""


def installed(*arguments, fault=None, folder=None, **environment):
    """The command as an operator's shell starts it."""
    if not COMMAND.exists():
        pytest.skip("spectrabox is not installed as a command here: run 'make setup'")
    paths = [str(ROOT)]
    if fault is not None:
        (folder / "faults").mkdir(exist_ok=True)
        (folder / "faults" / "tomllib.py").write_text(FAULT.format(error=fault))
        paths.insert(0, str(folder / "faults"))
    return subprocess.run([COMMAND, *map(str, arguments)], capture_output=True, text=True,
                          check=False, timeout=60,
                          env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)} | environment)


@pytest.fixture
def session(tmp_path):
    (tmp_path / "session.toml").write_text("[photos]\n")
    return tmp_path


LONG = "in [/x] \x1b[31m" + 5000 * "y"


def test_an_error_that_nobody_foresaw_is_one_sentence_of_the_command(session):
    ended = installed("status", session, "--json", fault=f"ZeroDivisionError({LONG!r})",
                      folder=session)
    one_sentence(ended.returncode, ended.stdout, ended.stderr, 1, "unexpected ZeroDivisionError")


def one_sentence(exit_code, out, error, code, said):
    assert exit_code == code, error
    (line,) = error.splitlines()
    assert said in line and "\x1b" not in line and len(line) < 3000
    answer = json.loads(out)
    assert answer["exit_code"] == code and said in answer["error"]


@pytest.mark.parametrize("fault, code, said", [
    (ZeroDivisionError(LONG), 1, "unexpected ZeroDivisionError"),
    (RecursionError(), 3, "session.toml is not valid TOML"), (MemoryError(), 7, "memory ran out"),
    (type("Panic", (BaseException,), {})("of Rust"), 1, "unexpected Panic: of Rust"),
    (KeyboardInterrupt(), 130, "interrupted"),
    (PermissionError(13, "Permission denied", "a/b.csv"), 3,
     "a/b.csv cannot be read or written (Permission denied)")])
def test_an_error_that_nobody_foresaw_is_one_sentence(session, monkeypatch, capsys, fault, code,
                                                      said):
    def loads(_):
        raise fault
    monkeypatch.setattr("tomllib.loads", loads)
    with pytest.raises(SystemExit) as left, reported_errors(as_json=True, debug=False):
        get_command(app)(["status", str(session), "--json"], prog_name="spectrabox")
    one_sentence(left.value.code, *capsys.readouterr(), code, said)


def test_debug_shows_the_traceback_of_an_unforeseen_error(session):
    ended = installed("status", session, "--debug", fault="ZeroDivisionError(1)", folder=session)
    assert ended.returncode == 1
    assert "Traceback" in ended.stderr and "ZeroDivisionError: 1" in ended.stderr


def by_shell(words, **environment):
    """What a shell's line of words after the command's name gives."""
    return subprocess.run(["bash", "-c", f"'{COMMAND}' {words}"], capture_output=True, text=True,
                          check=False, timeout=60,
                          env=os.environ | {"PYTHONPATH": str(ROOT)} | environment)


@pytest.mark.parametrize("words, lines", [
    ("--help", 0), ("camera list --json", 0), ("status /nowhere --json", 1)])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_command_whose_reader_left_ends_quietly(words, lines, unbuffered):
    ended = by_shell(f"{words} | true", PYTHONUNBUFFERED=unbuffered)
    assert len(ended.stderr.splitlines()) == lines, ended.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_disk_under_the_output_is_one_sentence(session):
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run([COMMAND, "--version"], stdout=full, stderr=subprocess.PIPE,
                               text=True, check=False, timeout=60,
                               env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert ended.returncode == 7
    assert ended.stderr == ("spectrabox: the output cannot be written: free space, then run again "
                            "(No space left on device)\n")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_run_as_an_interrupt_does(captured, number):
    running = subprocess.Popen([COMMAND, "run", captured, "--device", "cpu"], text=True,
                               stderr=subprocess.PIPE, stdout=subprocess.PIPE,
                               env=os.environ | {"PYTHONPATH": str(ROOT)})
    deadline = time.monotonic() + 60
    while not (captured / "results" / ".chart.new").exists():
        assert time.monotonic() < deadline and running.poll() is None
        time.sleep(0.01)
    running.send_signal(number)
    try:
        _, errors = running.communicate(timeout=60)
    finally:
        running.kill()      # a command that hears nothing would outlive the tests
    assert running.returncode == 130
    assert "interrupted: finished stages are kept" in errors.splitlines()[-1]
    assert "Traceback" not in errors
    assert [path.name for path in (captured / "results").iterdir()
            if path.name.endswith(".new")] == []


def test_a_signal_that_is_ignored_stays_ignored():
    from spectrabox.session.terminal.progress_display import SIGNALS, stop_on_signals
    before = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        stop_on_signals()   # as under nohup
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


STARTING = """
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
mi = start_mitsuba("cpu")
import drjit as dr
assert dr.all(dr.minimum(mi.Float([1.0, 2.0]), 1.5) == mi.Float([1.0, 1.5]))
"""


@pytest.mark.parametrize("home", [None, "/nowhere", "/proc"])
def test_the_renderer_starts_without_a_home(home):
    """Dr.Jit would abort the process: cron and systemd give no HOME."""
    environment = {name: value for name, value in os.environ.items() if name != "HOME"}
    environment |= {"PYTHONPATH": str(ROOT)} | ({} if home is None else {"HOME": home})
    subprocess.run([sys.executable, "-c", STARTING], env=environment, check=True, timeout=60)


def test_leaving_is_no_error():
    with pytest.raises(SystemExit) as left, reported_errors(as_json=False, debug=False):
        raise SystemExit(4)
    assert left.value.code == 4
    with pytest.raises(FileNotFoundError), reported_errors(as_json=False, debug=True):
        Path("/nowhere").read_text()


@pytest.mark.parametrize("number", ["9" * 5000, "²", "٣"])
def test_no_whole_number_is_a_sentence(session, number):
    (session / "a.csv").write_text("nm,white\n400,0.8\n700,0.8\n")
    (session / "patches.csv").write_text("R,G,B\n" + 24 * "0.1,0.2,0.3\n")
    for words in (("spectrum", "show", session / "a.csv", "--column", number),
                  ("camera", "fit", "--patches", session / "patches.csv", "--light", "D65",
                   "--leave-out", number)):
        ended = call(*words)
        assert ended.exit_code == 3 and "unexpected" not in ended.stderr, ended.stderr


def test_a_wrong_ending_is_quoted_without_what_a_terminal_obeys(session):
    ended = call("meter", "replay", session / "a", "--plot", "\x1b[2J" + 200 * "a")
    assert ended.exit_code == 2 and "\x1b" not in ended.stderr, ended.stderr
    assert "does not end in" in " ".join(ended.stderr.split())
