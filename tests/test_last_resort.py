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
    NO_MEMORY,
    NO_PROCESS,
    describe_error,
    last_resort,
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
    with pytest.raises(SystemExit) as left, last_resort(as_json=True, debug=False):
        get_command(app)(["status", str(session), "--json"], prog_name="spectrabox")
    one_sentence(left.value.code, *capsys.readouterr(), code, said)


def test_debug_shows_the_traceback_of_an_unforeseen_error(session):
    ended = installed("status", session, "--debug", fault="ZeroDivisionError(1)", folder=session)
    assert ended.returncode == 1
    assert "Traceback" in ended.stderr and "ZeroDivisionError: 1" in ended.stderr


def by_shell(words):
    """What a shell's line of words after the command's name gives."""
    return subprocess.run(["bash", "-c", f"'{COMMAND}' {words}"], capture_output=True, text=True,
                          check=False, timeout=60, env=os.environ | {"PYTHONPATH": str(ROOT)})


@pytest.mark.parametrize("words, code, lines", [
    ("--help", 0, 0), ("camera list --json", 0, 0), ("status /nowhere --json", 3, 1)])
def test_a_reader_that_left_changes_no_exit_code(words, code, lines):
    ended = by_shell(f"{words} | true; exit ${{PIPESTATUS[0]}}")
    assert ended.returncode == code and len(ended.stderr.splitlines()) == lines, ended.stderr


@pytest.mark.parametrize("closed, code, shown", [
    (">&-", 7, "standard output is closed"), ("2>&-", 3, '{"error": "'),
    ("<&-", 3, '{"error": "'), ("<&- >&- 2>&-", 7, "")])
def test_closed_streams_have_their_sentence_and_code(session, closed, code, shown):
    (session / "session.toml").unlink()
    ended = by_shell(f"status {session} --json {closed}")
    assert ended.returncode == code and "unexpected" not in ended.stderr
    assert shown in ended.stdout + ended.stderr and len(ended.stdout.splitlines()) <= 1


def test_names_that_no_file_can_have_are_inputs_that_are_wrong(session):
    (session / "list").write_bytes(b"a\0b\n")
    (session / "loop").symlink_to("loop")
    for listed in (session / "list", "/dev/zero"):
        ended = call("batch", "--list", listed)
        assert ended.exit_code == 3 and "unexpected" not in ended.stderr, ended.stderr
    ended = installed("batch", session / "loop")    # which the last resort alone understands
    assert ended.returncode == 3 and "unexpected" not in ended.stderr, ended.stderr


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
    assert running.returncode == 128 + number
    assert "interrupted: finished stages are kept" in errors.splitlines()[-1]
    assert "Traceback" not in errors
    assert [path.name for path in (captured / "results").iterdir()
            if path.name.endswith(".new")] == []


def test_a_signal_that_is_ignored_stays_ignored():
    from spectrabox.session.terminal.interruption import SIGNALS, stop_on_signals
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
    with pytest.raises(SystemExit) as left, last_resort(as_json=False, debug=False):
        raise SystemExit(4)
    assert left.value.code == 4
    with pytest.raises(FileNotFoundError), reported_errors(as_json=False, debug=True):
        Path("/nowhere").read_text()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_messages_that_cannot_be_written_change_no_exit_code(session):
    (session / "session.toml").unlink()
    ended = by_shell(f"status {session} --json 2>/dev/full")
    assert ended.returncode == 3 and json.loads(ended.stdout)["exit_code"] == 3


def test_a_folder_that_is_gone_is_an_input_that_is_wrong(session):
    ended = subprocess.run(["bash", "-c", f"cd '{session}' && mkdir a && cd a && rmdir ../a && "
                            f"'{COMMAND}' batch box"], capture_output=True, text=True, check=False,
                           timeout=60, env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert ended.returncode == 3 and "is gone" in ended.stderr, ended.stderr


@pytest.mark.parametrize("error, sentence", [
    (ImportError("libopenblas.so: failed to map segment from shared object"), NO_MEMORY),
    (BlockingIOError(11, "Resource temporarily unavailable"), NO_PROCESS),
    (RuntimeError("Resource temporarily unavailable"), NO_PROCESS)])
def test_what_a_system_refuses_to_give_is_its_problem(error, sentence):
    assert describe_error(error) == (sentence, 7)


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
