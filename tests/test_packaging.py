"""What is installed: the wheel by itself, beside packages of other people, and its dependencies."""
from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("radiometry", "capture", "calibrate", "reconstruct", "sampling", "measure", "session",
           "fixtures")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
WITH = {"dask"}         # what an extra brings along
OUTSIDE = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def succeed(*command, cwd):
    done = subprocess.run([str(word) for word in command], cwd=cwd, env=OUTSIDE, text=True,
                          capture_output=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def name_of(requirement):
    return re.split(r"[ ;<>=!~\[]", requirement)[0].lower().replace("_", "-")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    succeed(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=ROOT)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def names(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return archive.namelist()


def test_the_wheel_holds_each_file_of_the_folders_once(names):
    files = {f"spectrabox/{path.relative_to(ROOT).as_posix()}"
             for folder in FOLDERS for path in (ROOT / folder).rglob("*")
             if path.is_file() and "__pycache__" not in path.parts}
    own = {f"spectrabox/{name}" for name in ("__init__.py", "__init__.pyi", "__main__.py",
                                             "py.typed")}
    own |= {path.relative_to(ROOT).as_posix() for path in ROOT.glob("spectrabox/api/**/*.py")}
    assert len(names) == len(set(names))
    assert {name for name in names if ".dist-info/" not in name} == files | own


@pytest.mark.parametrize("name", [
    "spectrabox/py.typed", "spectrabox/calibrate/prior/models/rawtoaces39.npz",
    "spectrabox/sampling/prior/models/surface_families.npz",
    "spectrabox/session/report/templates/report.html.j2"])
def test_the_wheel_holds_what_is_read_at_run_time(names, name):
    assert name in names


def test_the_wheel_carries_its_licence_and_the_sources_of_its_data(names):
    assert {name.split("/")[-1] for name in names if "/licenses/" in name} == {"LICENSE", "NOTICE"}
    notice = (ROOT / "NOTICE").read_text(encoding="utf-8")
    for name in names:      # data and scripts of other people lie in files that are not our code
        if name.startswith("spectrabox/") and (name.endswith((".npz", ".csv"))
                                               or "/vendor/" in name):
            assert name.removeprefix("spectrabox/") in notice


def stand_in_named_fixtures(folder):
    """A wheel with the import name of the registry's ``fixtures``, made without a network."""
    path = folder / "fixtures-4.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("fixtures/__init__.py", "class Fixture: pass\n")
        about = "fixtures-4.0.dist-info"
        archive.writestr(f"{about}/METADATA",
                         "Metadata-Version: 2.1\nName: fixtures\nVersion: 4.0\n")
        archive.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nGenerator: test\n"
                                           "Root-Is-Purelib: true\nTag: py3-none-any\n")
        archive.writestr(f"{about}/RECORD", "".join(f"{name},,\n" for name in (
            "fixtures/__init__.py", f"{about}/METADATA", f"{about}/WHEEL", f"{about}/RECORD")))
    return path


def test_another_package_named_fixtures_can_come_and_go(wheel, tmp_path):
    environment, outside = tmp_path / "environment", tmp_path / "outside"
    outside.mkdir()
    succeed(sys.executable, "-m", "venv", "--without-pip", environment, cwd=tmp_path)
    python = environment / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", python, "--disable-pip-version-check")
    for file in (wheel, stand_in_named_fixtures(tmp_path)):
        succeed(*pip, "install", "-q", "--no-index", "--no-deps", file, cwd=outside)
    # numpy and the like come from this environment; a path here does not read the .pth files
    # there, so that the editable spectrabox stays out.
    link = next(environment.rglob("site-packages")) / "libraries.pth"

    def check(other):
        link.write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
        where = succeed(python, "-c", "import spectrabox.fixtures.paints as paints;"
                        "print(paints.__file__)", cwd=outside)
        assert Path(where.strip()).is_relative_to(environment)
        answer = succeed(environment / "bin" / "spectrabox", "sample", "--json",
                         "--sensitivity", "Nikon 5100 (NPL)", "--light", "D65",
                         "--signal", "0.2,0.3,0.15", "--samples", "1000", cwd=outside)
        assert '"mean"' in answer
        there = "import importlib.util as u; print(u.find_spec('fixtures') is not None)"
        assert succeed(python, "-c", there, cwd=outside).strip() == str(other)
        link.unlink()       # or pip would see the packages there

    check(other=True)
    succeed(*pip, "uninstall", "-q", "-y", "fixtures", cwd=outside)
    check(other=False)


def imported_names():
    for folder in (*FOLDERS, "spectrabox/api", "spectrabox/__init__.py"):
        for path in [ROOT / folder, *(ROOT / folder).rglob("*.py")]:
            if path.is_dir():
                continue
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Import):
                    yield from (alias.name.split(".")[0] for alias in node.names)
                elif isinstance(node, ast.ImportFrom) and node.module:
                    yield node.module.split(".")[0]


def test_dependencies_are_what_is_imported():
    distributions = packages_distributions()
    imported = {name_of(distributions[name][0]) for name in set(imported_names())
                if name not in sys.stdlib_module_names and name != "spectrabox"}
    stated = {name_of(line) for line in PROJECT["project"]["dependencies"]}
    extras = PROJECT["project"]["optional-dependencies"]
    asked_for = WITH | {name_of(line) for name in ("cluster", "zarr", "xarray")
                        for line in extras[name]}
    assert imported - stated - asked_for == set(), (
        "imported, but not among the dependencies of pyproject.toml")
    assert (stated | asked_for) - imported == set(), (
        "a dependency in pyproject.toml that nothing imports")


def locked_in(name):
    """Names and lines of what a file of locked versions holds."""
    lock = (ROOT / name).read_text(encoding="utf-8")
    return {name_of(block): block for block in re.split(r"\n(?=\S)", lock)}


def test_everything_that_is_installed_is_locked_with_its_hashes():
    program, tests = locked_in("requirements.lock"), locked_in("requirements-test.lock")
    extras = PROJECT["project"]["optional-dependencies"]
    needed = (*PROJECT["project"]["dependencies"], *PROJECT["build-system"]["requires"],
              *extras["build"])
    for line in needed:
        assert "--hash=sha256:" in program[name_of(line)], line
    for line in extras["test"]:
        assert "--hash=sha256:" in tests[name_of(line)], line
    assert not program.keys() & tests.keys()    # the demo installs nothing that tests alone need


def test_one_version_is_stated():
    package = (ROOT / "spectrabox" / "__init__.py").read_text(encoding="utf-8")
    version = re.search(r'__version__ = "(.*)"', package)[1]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\n## {version}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


# ---- what make installs, with other programs in place of those that would

def stub(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


def made(target, tmp_path, *words):
    """What make says of a target where no program is found but these."""
    make = shutil.which("make") or pytest.skip("there is no make here")
    return subprocess.run([make, "-s", "-C", ROOT, target, f"VENV={tmp_path / 'venv'}", *words],
                          env={"PATH": str(tmp_path / "programs"), "LOG": str(tmp_path / "log")},
                          capture_output=True, text=True, check=False)


@pytest.fixture
def as_root(tmp_path):
    """An environment that is set up, a user who is root, and an installer that fails."""
    for folder in ("programs", "venv/bin"):
        (tmp_path / folder).mkdir(parents=True)
    stub(tmp_path / "programs" / "id", "echo 0")
    stub(tmp_path / "programs" / "apt-get",
         'echo apt-get "$@" >> "$LOG"; echo progress; echo "E: no such mirror" >&2; exit 100')
    stub(tmp_path / "venv" / "bin" / "python", 'echo python "$@" >> "$LOG"')
    for name in (".ready", ".ready-for-tests"):
        (tmp_path / "venv" / name).touch()
    return tmp_path


def test_make_test_as_root_says_what_it_installs_and_why_it_could_not(as_root):
    done = made("test", as_root)
    log = (as_root / "log").read_text().splitlines()
    assert done.returncode == 0 and "python -m pytest" in log[-1]
    assert [line.split()[-1] for line in log[:-1]] == ["update", "chromium"]
    assert "chromium" in done.stdout and "whole system" in done.stdout
    assert "BROWSER=0" in done.stdout and "progress" not in done.stdout
    assert "no such mirror" in done.stderr and "could not be installed" in done.stderr


@pytest.mark.parametrize("words", [("BROWSER=0",), ()])
def test_make_test_installs_no_browser_where_that_is_left_out_or_there_is_one(as_root, words):
    if not words:
        stub(as_root / "programs" / "chromium", "exit 1")
    assert made("test", as_root, *words).stdout == ""
    assert (as_root / "log").read_text().count("\n") == 1


def test_an_environment_without_venv_is_made_by_a_program_that_is_locked(tmp_path):
    (tmp_path / "programs").mkdir()
    (tmp_path / "programs" / "rm").symlink_to(shutil.which("rm"))
    stub(tmp_path / "programs" / "python3",
         'echo "$@" >> "$LOG"; [ "$1" = -c ] || { echo "no venv here" >&2; exit 1; }')
    done = made(str(tmp_path / "venv" / "bin" / "python"), tmp_path)
    asked = (tmp_path / "log").read_text().splitlines()[-1]
    assert "--require-hashes" in asked and "-r requirements-virtualenv.lock" in asked
    assert done.returncode != 0 and "no venv here" in done.stderr
    assert "apt install python3-venv" in done.stderr
    locked = locked_in("requirements-virtualenv.lock")
    assert "virtualenv" in locked and all("--hash=sha256:" in each for each in locked.values())
