"""What a stage's result depends on is what its modules import."""
import ast
import functools
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from spectrabox.session import keys
from spectrabox.session.config.session_file import read_session
from spectrabox.session.pipeline import stage_states
from spectrabox.session.stages.order import STAGES
from spectrabox.session.store.stage_code import (
    PACKAGE,
    ImportGraph,
    PackageFiles,
    files_behind,
    imported_files,
    stage_code,
)

ENTRIES = {name: stage.module for name, stage in STAGES.items()}
CONTENTS = dict(PackageFiles(PACKAGE))


def behind(stage):
    return files_behind(ENTRIES[stage], ImportGraph(CONTENTS))


def parsed_imports(source):
    """The same as ``imported_files`` by Python's own parser."""
    tree = ast.parse(source)
    skipped = {id(node) for block in ast.walk(tree) if isinstance(block, ast.If)
               and ast.unparse(block.test) == "TYPE_CHECKING"
               for statement in block.body for node in ast.walk(statement)}
    names = []
    for node in ast.walk(tree):
        if id(node) not in skipped and isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif id(node) not in skipped and isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    files = set()
    for name in names:
        parts = name.split(".")
        if parts[0] == "spectrabox":
            for end in range(1, len(parts) + 1):
                path = "/".join(parts[1:end])
                files |= {f"{path}.py", f"{path}/__init__.py".lstrip("/")} & CONTENTS.keys()
    return files


def test_every_import_that_python_reads_is_read():
    sources = {file: source.decode() for file, source in CONTENTS.items() if file.endswith(".py")}
    assert len(sources) > 100
    missed = {file: parsed_imports(source) - set(imported_files(source, CONTENTS))
              for file, source in sources.items()}
    assert not {file: names for file, names in missed.items() if names}


@pytest.mark.parametrize("source, files", [
    ("from spectrabox.session.report import words\n",
     {"session/report/__init__.py", "session/report/words.py"}),
    ("def f():\n    import spectrabox.session.keys\n", {"session/keys.py"}),
    ("from spectrabox.session.keys import (\n    Key,  # one (of many)\n    as_stored,\n)\n",
     {"session/keys.py"}),
    ("if TYPE_CHECKING:\n    from spectrabox.session.keys import Key\n\nx = 1\n", set()),
    ("# spectrabox.session.keys is only named\n", set())])
def test_every_way_to_import_is_known(source, files):
    around = {"__init__.py", "session/__init__.py"} if files else set()
    assert set(imported_files(source, CONTENTS)) == files | around


@pytest.fixture
def edited(tmp_path, monkeypatch):
    """A function that changes one file of a copy of the package, which the keys are made from."""
    copy = tmp_path / "spectrabox"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(keys, "stage_code", functools.partial(stage_code, package=copy))

    def edit(file):
        with (copy / file).open("ab") as stream:
            stream.write(b"\n# edited\n")
    return edit


@pytest.mark.parametrize("file, stale", [
    ("session/stages/error_budget.py", {"sample"}),
    ("session/report/words.py", set()),
    ("session/commands/session.py", set()),
    ("session/stages/assemble.py", set()),
    ("calibrate/prior/models/rawtoaces39.npz", {"calibrate", "reconstruct", "sample"}),
    ("sampling/prior/models/surface_families.npz", {"calibrate", "reconstruct", "sample"}),
    ("radiometry/records.py", set(STAGES))])
def test_an_edit_makes_stale_what_depends_on_it(finished, edited, file, stale):
    edited(file)
    states = {state.name: state for state in stage_states(read_session(finished))}
    assert {name for name, state in states.items() if state.state == "stale"} == stale
    for name in stale:
        assert states[name].reasons[0].startswith(("code: ", "stages: "))


RUN_ALONE = """
import importlib, json, sys
from pathlib import Path
module, function, folder, stages = *sys.argv[1:3], Path(sys.argv[3]), sys.argv[4:]
run = getattr(importlib.import_module(module), function)
from spectrabox.session.config.session_file import read_session
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.store.store import load_stage
stored = {name: load_stage(folder / "results", name) for name in stages}
(folder / "pictures").mkdir()
run(StageTask(read_session(folder), "cpu", stored, folder / "pictures", lambda *_: None))
print(json.dumps([name for name in sys.modules if name.split(".")[0] == "spectrabox"]))
"""


@pytest.mark.parametrize("stage", STAGES)
def test_every_module_that_a_running_stage_imports_is_known(finished, stage):
    module, function = STAGES[stage].module, STAGES[stage].function
    ran = subprocess.run([sys.executable, "-c", RUN_ALONE, module, function,
                          str(finished), *STAGES], capture_output=True, text=True, check=True,
                         cwd=Path(__file__).parent.parent)
    loaded = {file for name in json.loads(ran.stdout.splitlines()[-1])
              for path in ["/".join(name.split(".")[1:])]
              for file in (f"{path}.py", f"{path}/__init__.py".lstrip("/")) if file in CONTENTS}
    # The reader of session.toml is left out: what it reads is in the key by value.
    reader = files_behind("spectrabox.session.config.session_file", ImportGraph(CONTENTS))
    assert f"{module.removeprefix('spectrabox.').replace('.', '/')}.py" in loaded
    assert loaded <= behind(stage) | reader
