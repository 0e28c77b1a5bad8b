"""A folder from a stranger, entered and worked in: nothing that lies in it is run, and what it holds
of too much is refused before memory is taken for it.
"""
import contextlib
import os
import shutil
import subprocess
import sys
import urllib.parse
from pathlib import Path

import pytest
from batch_sessions import write_session
from served_page import asked, wait_for

COMMAND = Path(sys.executable).parent / "spectrabox"
# of ours, of others', of Python's own: whatever a child may ask for first
PLANTED = ("numpy.py", "spectrabox/__init__.py", "lazy_loader.py", "typer.py", "tomllib.py",
           "json/__init__.py", "multiprocessing/__init__.py", "mitsuba/__init__.py",
           "sitecustomize.py", "distributed/__init__.py", "cloudpickle.py", "uvicorn/__init__.py")
MARKING = "import os, sys\nopen(os.environ['MARK'], 'a').write(f'{__file__} {sys.argv}\\n')\n"
LIBRARY = r"""
#include <stdio.h>
#include <stdlib.h>
__attribute__((constructor)) static void mark(void) {
    FILE *file = fopen(getenv("MARK"), "a");
    if (file) { fputs("a library\n", file); fclose(file); }
}
"""
PLUGINS = ("path", "diffuse", "perspective", "independent", "specfilm", "rectangle", "scene")


def plant(folder):
    """Modules, and libraries named as plug-ins of Mitsuba where a compiler is there."""
    for name in PLANTED:
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(MARKING)
    compiler = shutil.which("cc")
    if compiler:
        (folder / "plugins").mkdir(exist_ok=True)
        source, library = folder / "mark.c", folder / "plugins" / "library.so"
        source.write_text(LIBRARY)
        subprocess.run([compiler, "-shared", "-fPIC", source, "-o", library], check=True)
        for name in PLUGINS:
            shutil.copyfile(library, library.with_stem(name))
    return folder


@pytest.fixture
def typed(tmp_path, monkeypatch):
    """A function that types words in a folder, as its user would, and says what came of it."""
    if not COMMAND.exists():
        pytest.skip("the command is not installed beside this Python")
    mark = tmp_path / "mark"
    monkeypatch.setenv("MARK", str(mark))
    for name in ("PYTHONPATH", "PYTHONSAFEPATH"):
        monkeypatch.delenv(name, raising=False)

    def type_in(folder, *words, command=(COMMAND,), code=0):
        done = subprocess.run([*map(str, (*command, *words))], cwd=folder, text=True, check=False,
                              capture_output=True, stdin=subprocess.DEVNULL, timeout=300)
        assert done.returncode == code, done.stdout + done.stderr
        assert not mark.exists(), mark.read_text()
        return done
    yield type_in
    assert not mark.exists(), mark.read_text()


def test_the_planted_files_would_leave_their_mark(tmp_path, monkeypatch):
    """Or the other tests here could not fail."""
    mark = tmp_path / "mark"
    monkeypatch.setenv("MARK", str(mark))
    folder = plant(tmp_path)
    subprocess.run([sys.executable, "-c", "import numpy, spectrabox"], cwd=folder, check=True)
    assert mark.read_text().count("\n") >= 2
    if (folder / "plugins").exists():
        import ctypes
        ctypes.CDLL(str(folder / "plugins" / "diffuse.so"))
        assert "a library" in mark.read_text()


@pytest.mark.parametrize("words", [("doctor",), ("check", "."), ("run", ".", "-q"),
                                   ("status", "."), ("report", ".")])
def test_a_command_in_a_strangers_folder_runs_nothing_of_it(captured, finished, typed, words):
    typed(plant(finished if words[0] == "report" else captured), *words)


def test_workers_run_nothing_of_the_folder_that_a_batch_is_started_in(typed, tmp_path):
    folders = [write_session(tmp_path / name) for name in ("a", "b")]
    typed(plant(tmp_path), "batch", *(each.name for each in folders), "--workers", "2")


def test_workers_of_a_cluster_run_nothing_of_the_folder_that_it_is_started_in(typed, tmp_path):
    pytest.importorskip("distributed")
    write_session(tmp_path / "a")
    typed(plant(tmp_path), "batch", "a", "--cluster", "local", "--workers", "1")


def test_python_itself_looks_for_nothing_but_the_package_in_the_folder(typed, tmp_path):
    """``python -m``: a spectrabox/ in the folder is what was asked for, anything else is not."""
    plant(tmp_path)
    shutil.rmtree(tmp_path / "spectrabox")
    for words in ((sys.executable, "-m", "spectrabox"), (sys.executable, "-mspectrabox"),
                  (sys.executable, "-P", "-m", "spectrabox")):
        typed(tmp_path, "--version", command=words)
        typed(tmp_path, "doctor", command=words)


def test_the_commands_script_takes_no_module_from_the_folder_that_it_lies_in(typed, tmp_path):
    plant(tmp_path)
    shutil.rmtree(tmp_path / "spectrabox")
    shutil.copy(COMMAND, tmp_path / "spectrabox")
    typed(Path.home(), "doctor", command=(tmp_path / "spectrabox",))


def test_opening_a_folder_runs_nothing_of_it(typed, tmp_path):
    folder = plant(write_session(tmp_path / "s"))
    with open_page(folder) as (address, token):
        # the page begins to calibrate by itself
        wait_for(lambda: asked(address + "/api/state", None, token)[1]["live"]["ready"], 120)


@contextlib.contextmanager
def open_page(folder):
    """Address and token of ``spectrabox open .``, typed in a folder."""
    with subprocess.Popen([COMMAND, "open", ".", "--no-browser"], cwd=folder, text=True,
                          env=os.environ, stdout=subprocess.PIPE,
                          stderr=subprocess.DEVNULL) as process:
        try:
            parts = urllib.parse.urlsplit(process.stdout.readline().strip())
            yield f"http://{parts.netloc}", urllib.parse.parse_qs(parts.query)["token"][0]
        finally:
            process.terminate()
