"""What scripts rely on: docs/reference/json.md names every command's keys, and each is there.

The page is read, the commands are run on small inputs, and every documented key must occur in some
answer. Exit codes are those of the page's table.
"""
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from calibrate_cameras import cameras
from flat_example import HEAD, regions_toml, write_flat
from typer.testing import CliRunner

from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.fixtures.meter_transcripts import FOLDER as RECORDINGS
from spectrabox.measure.conditions import CONDITION_FACTS
from spectrabox.measure.results.surface_result import SURFACE_FACTS
from spectrabox.session.cli import app

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "json.md"
CAMERA = ("--sensitivity", "Nikon 5100 (NPL)", "--light", "LED-B3")
SIGNAL = ("--signal", "0.21,0.33,0.14", "--noise", "0.002,0.003,0.0015")
# Names in the text of a cell that are no keys of that command's answer.
IN_PASSING = {"run": {"flat", "picture"}, "flat": {"flat", "size_px"},
              "sample": {"run", "spectra", "coefficients"},
              "camera profile": {"value", "standard_deviation"}}
TOKEN = re.compile(r"`([^`]+)`|(\[?\{)|(\}\]?)")


def documented():
    """{command: nested dictionary of keys} of the page's first table and of that of facts."""
    commands = {}
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        first, _, cell = line.strip("| \n").partition(" | ")
        names = re.findall(r"`([a-z ]+)`", first.partition(", and")[0])
        if line.startswith("| `") and cell and not first.startswith("`schema"):
            keys = keys_of(cell)
            for name in names:
                commands[name] = {key: below for key, below in keys.items()
                                  if key not in IN_PASSING.get(name, ())}
        if line.startswith("| exit code"):
            facts = {fact.name: {} for fact in SURFACE_FACTS}
            commands["run"]["materials"] = {name: {} for name in facts
                                            if name not in ("light", "light_error", "scatter",
                                                            "edge", "lamp_places")}
            commands["flat"]["regions"] = {name: {} for name in facts
                                           # no region has an edge (test_region_edges.py), and no
                                           # lamp was moved (test_moved_lamp.py)
                                           if name not in ("rmse_inverse_rendering", "edge",
                                                           "lamp_places")}
            for command in ("run", "flat"):
                commands[command]["conditions"] = {fact.name: {} for fact in CONDITION_FACTS}
            return commands
    raise AssertionError("the page has no table of exit codes")


def keys_of(cell):
    """The keys that a cell of the table names, as they are nested in braces."""
    root = {}
    stack, last = [root], None
    for name, opening, closing in TOKEN.findall(cell):
        if opening:
            stack.append(stack[-1] if last is None else stack[-1][last])
            last = None
        elif closing and len(stack) > 1:
            stack.pop()
            last = None
        elif name.isidentifier():
            stack[-1].setdefault(name, {})
            last = name
    return root


def missing(keys, answers, path=""):
    """Documented keys that no answer has."""
    found = [answer for answer in answers if isinstance(answer, dict)]
    found += [each for answer in answers if isinstance(answer, list) for each in answer
              if isinstance(each, dict)]
    if found and not any(name in each for name in keys for each in found):
        found = [value for each in found for value in each.values() if isinstance(value, dict)]
    if not found:
        return []           # null, or a list that is empty here; or entries by their names
    absent = [f"{path}{name}" for name in keys if not any(name in each for each in found)]
    for name, below in keys.items():
        absent += missing(below, [each[name] for each in found if name in each], f"{path}{name}.")
    return absent


@pytest.mark.parametrize("facts", [SURFACE_FACTS, CONDITION_FACTS])
def test_facts_are_tabulated_as_they_are_declared(facts):
    rows = "".join(f"| `{fact.name}` | {fact.meaning} |\n" for fact in facts)
    assert f"| fact | what |\n|---|---|\n{rows}\n" in PAGE.read_text(encoding="utf-8")


def test_the_page_is_read_as_it_is_written():
    found = documented()
    assert len(found) > 30 and list(found["status"]["stages"]) == ["name", "state", "reasons",
                                                                   "seconds"]
    assert missing({"a": {"b": {}, "c": {}}}, [{"a": [{"c": 1}]}]) == ["a.b"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A finished session of flat samples, a picture, a table, curves and chart photo."""
    folder = tmp_path_factory.mktemp("contract")
    (folder / "flat").mkdir()
    write_flat(folder / "flat")
    (folder / "flat" / "session.toml").write_text(
        HEAD + regions_toml(("white_wall", "red_wall"), ("white_wall",))
        + "[picture]\nrect = [299.5, 59.5, 317.5, 69.5]\n", encoding="utf-8")
    answer = call(folder, "run", "DIR/flat")
    (folder / "run.json").write_text(json.dumps(answer[1]), encoding="utf-8")
    shutil.copytree(folder / "flat", folder / "again")
    nm = np.arange(400, 701, 10)
    curves = 0.2 + 0.6 / (1 + np.exp((np.array([[500], [600]]) - nm) / 20))
    (folder / "truth.csv").write_text("# quantity: reflectance\nnm,a,b\n" + "".join(
        f"{each},{first:.6f},{second:.6f}\n" for each, first, second in zip(nm, *curves,
                                                                            strict=True)),
        encoding="utf-8")
    (folder / "curves.csv").write_text("nm,R,G,B\n" + "".join(
        f"{each},{','.join(f'{value:.6g}' for value in row)}\n"
        for each, row in zip(np.arange(400, 701, 5), cameras(1, 90)[0].T, strict=True)),
        encoding="utf-8")
    grey = 0.4 + np.random.default_rng(2).normal(0, 0.01, (240, 320, 3))
    write_exr(folder / "grey.exr", grey.astype(np.float32), ["R", "G", "B"])
    write_exr(folder / "p.exr", np.full((3, 4, 3), 0.3, np.float32), ["R", "G", "B"])
    for name, end in (("lamp", 1.0), ("gel", 0.3)):
        (folder / f"{name}.csv").write_text(f"wavelength_nm,value\n400,1\n550,1\n700,{end}\n",
                                            encoding="utf-8")
    (folder / "signals.csv").write_text("R,G,B\n0.2,0.3,0.15\n0.52,0.5,0.41\n", encoding="utf-8")
    return folder


def call(folder, *words):
    """Exit code and answer of a command; DIR in a word stands for the folder."""
    words = [str(word).replace("DIR", str(folder)) for word in words]
    result = CliRunner().invoke(app, [*words, "--json"], env={
        "SPECTRABOX_METER_PACE": "0.01", "SPECTRABOX_CAMERAS": str(folder / "kept cameras")})
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    try:
        return result.exit_code, json.loads(result.stdout)
    except ValueError:
        raise AssertionError(f"{words} gave no JSON: {result.output[-500:]}") from None


CALLS = {
    "check": [("DIR/flat",)],
    "status": [("DIR/flat",)],
    "report": [("DIR/again",)],
    "new": [("DIR/new",)],
    "camera profile": [("DIR/curves.csv", "--camera", "Maker One", "--idt-light", "D60", "--out",
                        "DIR/p.json")],
    "camera add": [("DIR/curves.csv",)],
    "colour": [("DIR/flat", "--out", "DIR/colour")],
    "camera list": [()],
    "filter fit": [("DIR/lamp.csv", "DIR/gel.csv", "--readings", "--out", "DIR/filter.csv")],
    "draws": [("DIR/flat", "-o", "DIR/draws.npz")],
    "sample": [(*CAMERA, *SIGNAL, "--out", "DIR/one.npz", "--truth", "DIR/truth.csv", "--column",
                "a", "--baseline"),
               (*CAMERA, *SIGNAL, "--reading", "550:0.35:0.01"),
               (*CAMERA, "--signals", "DIR/signals.csv"),
               ("--srgb", "200,100,50", "--plot", "DIR/c.png")],
    "match": [("DIR/flat", "DIR/truth.csv")],
    "uplift": [("DIR/p.exr", "-o", "DIR/up", *CAMERA, "--side", "5"),
               ("DIR/p.exr", "-o", "DIR/arrays", *CAMERA, "--side", "5", "--to", "zarr"),
               ("DIR/flat/results/photo/preview.png", "--encoded", "-o", "DIR/seen", "--side",
                "5")],
    "advise": [(*CAMERA, "--signal", "0.2,0.3,0.15", "--lamps", "A"), ("DIR/flat", "--lamps", "A")],
    "chart": [("DIR/flat/photos/sample.dng",)],
    "develop": [("DIR/flat/photos/sample.dng", "-o", "DIR/developed.exr")],
    "meter list": [()],
    "meter replay": [(RECORDINGS / "cs2000.transcript", "--out", "DIR/replayed.csv")],
    "spectrum show": [("DIR/truth.csv",), ("DIR/truth.csv", "--column", "a")],
    "spectrum convert": [("DIR/truth.csv", "-o", "DIR/t.spdx", "--column", "a")],
    "doctor": [("--device", "cpu")],
}
OF_SCENES = {"run": (), "relight": ("--width", "32", "--spp", "4", "-o", "relit.png")}
# Where the same answer is held elsewhere, at the price of a session or an instrument.
ELSEWHERE = {"demo": "test_docs.py", "batch": "test_batch.py",
             "camera fit": "test_calibrate_command.py",
             "rehearse": "test_rehearsal.py", "geometry box": "test_geometry_commands.py",
             "meter identify": "test_instrument_commands.py",
             "meter measure": "test_instrument_commands.py"}


def test_every_command_of_the_page_is_called():
    assert set(documented()) == {*CALLS, *OF_SCENES, *ELSEWHERE, "flat"}


def test_a_session_of_flat_samples_answers_with_the_keys_of_flat(folder):
    answer = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    assert not missing(documented()["flat"], [answer])


@pytest.mark.parametrize("command", OF_SCENES)
def test_a_session_of_a_scene_answers_with_the_keys_of_the_page(command, finished, monkeypatch):
    monkeypatch.chdir(finished)
    code, answer = call(finished, command, "DIR", *OF_SCENES[command])
    assert code == 0 and not missing(documented()[command], [answer])


@pytest.mark.parametrize("command", CALLS)
def test_a_command_answers_with_the_keys_of_the_page(command, folder):
    answers = []
    for words in CALLS[command]:
        code, answer = call(folder, *command.split(), *words)
        assert code == (4 if command == "chart" and answer["verdict"] != "good" else 0), answer
        answers.append(answer)
    assert not missing(documented()[command], answers)


@pytest.mark.parametrize("code, words", [
    (2, ("sample", "--light", "D65")),                          # without --sensitivity
    (2, ("run", "DIR/flat", "--device", "toaster")),
    (2, ("uplift", "DIR/p.exr", "-o", "DIR/x", *CAMERA, "--to", "png")),
    (3, ("run", "DIR/none")), (3, ("sample", *CAMERA)),    # and without a signal
    (3, ("spectrum", "show", "DIR/none.csv")), (3, ("new", "DIR/flat")),
    (3, ("sample", *CAMERA, "--signal", "1,2")),
    (3, ("relight", "DIR/flat")),                               # no scene
    (4, ("chart", "DIR/grey.exr")),
    (5, ("sample", *CAMERA, "--signal", "0.2,0.3,0.1", "--samples", "200")),
    (6, ("meter", "identify", "--port", "/dev/none", "--instrument", "cr250")),
    (7, ("develop", "DIR/flat/photos/sample.dng", "-o", "DIR/p.exr/below.exr"))])
def test_failures_have_the_exit_codes_of_the_page(code, words, folder):
    words = [word.replace("DIR", str(folder)) for word in words]
    result = CliRunner().invoke(app, [*words, "--json"])
    assert result.exit_code == code, result.output
    if code != 2 and words[0] != "chart":       # usage is said in words
        answer = json.loads(result.stdout)
        assert answer["exit_code"] == code and answer["error"]
        assert "Traceback" not in result.output
    table = PAGE.read_text(encoding="utf-8").partition("| exit code")[2]
    assert re.search(rf"^\| {code} \|", table, re.MULTILINE)
