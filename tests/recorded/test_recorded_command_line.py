"""What every command shares, and what stands beside them: errors, progress, scores, rehearsals."""
import dataclasses
import errno
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from report_example import GRID, example_session
from report_variants import a_posterior
from said_by_commands import lines_of
from typer.testing import CliRunner

from spectrabox.radiometry.errors import (
    CheckError,
    EnvironmentProblem,
    InputError,
    SpectraboxError,
)
from spectrabox.session import calibration_facts, command_line, doctor, progress_display, relight
from spectrabox.session import rehearsal as rehearsals
from spectrabox.session.cli import app, with_only
from spectrabox.session.command_line import Stopped, check_device, check_ending, said_of
from spectrabox.session.scores import score

ERRORS = [InputError("a\nsecond"), CheckError("b"), EnvironmentProblem("c"), SpectraboxError("d"),
          MemoryError(), OSError(errno.ENOSPC, "No space left"), OSError(errno.EIO, "I/O error"),
          OSError(errno.ENOENT, "No such file", "x.toml"), PermissionError(13, "denied", "y"),
          OSError(errno.ENOSPC, "No space left", "z"), OSError(errno.EDQUOT, "quota", b"w"),
          ValueError("e"), KeyboardInterrupt(), Stopped(15), Stopped(1), BrokenPipeError()]


def wrapped():
    """An interrupt that a library has wrapped in an error of its own."""
    try:
        try:
            raise Stopped(15)
        except KeyboardInterrupt as error:
            raise RuntimeError("a loop") from error
    except RuntimeError as error:
        return error


def ended(block, capsys):
    """Exit code and output of a block that raises."""
    try:
        block()
        code = None
    except (typer.Exit, SystemExit) as error:
        code = getattr(error, "exit_code", getattr(error, "code", None))
    except BaseException as error:      # noqa: BLE001 -- what goes through is recorded too
        code = f"{type(error).__name__} goes through"
    told = capsys.readouterr()
    return [code, lines_of(told.out), lines_of(told.err)]


@pytest.mark.parametrize("as_json", [True, False])
@pytest.mark.parametrize("debug", [True, False])
def test_how_errors_end_a_command(as_json, debug, capsys, recorded):
    found = {}
    for number, error in enumerate([*ERRORS, wrapped()]):
        def within(error=error):
            with command_line.command(as_json, debug):
                raise error

        def at_last(error=error):
            with command_line.last_resort(as_json, debug):
                raise error
        found[f"{number} {type(error).__name__}"] = [ended(within, capsys), ended(at_last, capsys)]
    recorded(found)


def test_what_errors_are_in_words(recorded):
    recorded([said_of(error) for error in ERRORS])


def test_which_endings_and_devices_are_taken(tmp_path, recorded):
    found = []
    for name in ("a.csv", "a.CSV", "a.npz", "a", None):
        try:
            check_ending(None if name is None else tmp_path / name, {".csv": "one", ".exr": "two"})
            found.append("taken")
        except typer.BadParameter as error:
            found.append([str(error), str(error.param_hint)])
    for device in ("auto", "cpu", "cuda", "gpu", "CPU"):
        try:
            check_device(device)
            found.append("taken")
        except typer.BadParameter as error:
            found.append([str(error), str(error.param_hint)])
    recorded(found)


def test_the_help_lists_every_command_under_its_subject(recorded):
    whole = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "100"}).output.splitlines()
    headings = [line if not line.startswith(" ") else line.split()[0] for line in whole
                if line.strip() and (not line.startswith("   ") or line[2:3].isalpha())]
    recorded(headings)
    only = with_only("status")
    assert [each.callback.__name__ for each in only.registered_commands] == ["status"]
    assert not only.registered_groups
    assert [each.typer_instance.info.name for each in with_only("meter").registered_groups] == [
        "meter"]
    assert with_only("none") is app


def test_how_far_work_has_come(capsys, monkeypatch, recorded):
    now, shown = [10.0], []
    monkeypatch.setattr(progress_display.time, "monotonic", lambda: now[0])
    say = progress_display.with_time_left(lambda *words: shown.append(list(words)))
    for stage, share, message in (("chart", 0.0, ""), ("chart", 0.25, ""), ("chart", 0.5, "half"),
                                  ("chart", 0.8, ""), ("chart", 1.0, ""), ("photo", 0.3, "x"),
                                  ("photo", 0.9, "")):
        now[0] += 7.0
        say(stage, share, message)
    for quiet in (True, False):
        with progress_display.progress_display(quiet) as show:
            for share in (0.0, 0.5, 1.0):
                show("chart", share, "")
                show("photo", share, "read \x1b[1m")
    recorded([shown, capsys.readouterr().err.splitlines()])


def test_scores_of_a_material(tmp_path, recorded):
    first, second, _ = example_session(tmp_path).materials
    for number, material in enumerate((first, second)):
        recorded([score(material.truth.values, spectrum, material.summary, material.samples)
                  for spectrum in (material.spectrum, None)], case=str(number))


def test_facts_of_lights(tmp_path, recorded):
    calibration = example_session(tmp_path).calibration
    bare = dataclasses.replace(calibration.light, standard_error=None)
    recorded([calibration_facts.light_facts(each) for each in (
        calibration, dataclasses.replace(calibration, light=bare),
        dataclasses.replace(calibration, light_posterior=a_posterior()))])


def test_scores_of_rehearsals(recorded):
    rng = np.random.default_rng(3)
    truths = np.clip(0.4 + 0.2 * np.cos(GRID.nm / 60) + rng.normal(0, 0.05, (25, 1)), 0, 1)
    draws = truths[:, None] + rng.normal(0.01, 0.04, (25, rehearsals.DRAWS, 1)) \
        + rng.normal(0, 0.01, (25, rehearsals.DRAWS, GRID.nm.size))
    rows = [rehearsals._scores(each, truth, 0.9) for each, truth in zip(draws, truths, strict=True)]
    made = [rehearsals._gathered("red", rows), rehearsals._gathered("green", rows[:20])]
    recorded(rows[:3], case="rows")
    recorded([rehearsals.facts(made, 0.9, 4), made[0].coverage_error])


def relit(samples):
    """Colours of a mean and of draws about it, under a lamp."""
    power = 0.5 + GRID.nm / 900
    matching = np.array([np.exp(-((GRID.nm - peak) / 40)**2) for peak in (600, 555, 450)])
    mean = samples.spectra.mean(axis=0)
    return [relight._spread("red", mean, each, GRID, power, matching) for each in (samples, None)]


def test_colours_under_another_light(tmp_path, recorded):
    results = example_session(tmp_path)
    calibration = results.calibration
    recorded(relit(results.materials[1].samples), case="spread")
    recorded([relight._own_light(each, GRID) for each in (
        calibration, dataclasses.replace(calibration, light_posterior=a_posterior()))],
        case="light")
    xyz = np.random.default_rng(2).uniform(0, 1.1, (4, 5, 3))
    # 8 bits
    recorded(relight._picture(xyz, np.array([1.05, 1.0, 0.6])), rtol=1e-3, case="picture")


def test_what_relight_says_of_colours(tmp_path, recorded, monkeypatch):
    colours = tuple(relit(example_session(tmp_path).materials[1].samples))
    made = SimpleNamespace(picture=np.full((2, 3, 3), 9, np.uint8), xyz=np.ones((2, 3, 3)),
                           colours=colours, notes=("a note",))
    asked = []

    def rendered(config, finished, **words):
        asked.append(words)
        return made
    for name, value in (("config.session_file.read_session",
                         lambda *words: SimpleNamespace(folder=tmp_path)),
                        ("stages.scenes.read_session_scene",
                         lambda config: SimpleNamespace(width=300, height=200)),
                        ("pipeline.load_finished", lambda config: None),
                        ("pipeline.stale_stages", lambda config: (["sample"], "it is stale")),
                        ("run_outputs.require_results", lambda *words: None),
                        ("store.made_from.digests_of", lambda finished: {}),
                        ("relight.relight", rendered)):
        monkeypatch.setattr(f"spectrabox.session.{name}", value)
    found = []
    for words in ((), ("--light", "my lamp#1.csv", "--observer", "cie_10_1964", "--width", "100",
                       "--spp", "5", "--device", "cpu", "--json"),
                  ("--out", str(tmp_path / "o.png"), "--json")):
        result = CliRunner().invoke(app, ["relight", str(tmp_path), *words])
        found.append([result.exit_code, lines_of(result.stdout, [tmp_path]),
                      lines_of(result.stderr)])
    recorded([found, asked, sorted(path.name for path in tmp_path.glob("*.*"))])


@pytest.mark.parametrize("outcome", [(0, "x\nllvm_ad_rgb\n", ""), (-6, "", "a\nlast words\n"),
                                     (3, "", ""), None])
def test_what_the_doctor_says(outcome, recorded, monkeypatch):
    def run(*words, **more):
        if outcome is None:
            raise doctor.subprocess.TimeoutExpired("x", 1)
        return SimpleNamespace(returncode=outcome[0], stdout=outcome[1], stderr=outcome[2])
    monkeypatch.setattr(doctor.subprocess, "run", run)
    monkeypatch.setattr(doctor, "find_llvm", lambda: (SimpleNamespace(name="libLLVM.so"), 19))
    monkeypatch.setattr(doctor, "versions", lambda: {"a": "1"})
    monkeypatch.setattr(doctor.os, "cpu_count", lambda: 5)
    facts = {name: value for name, value in doctor.examine("cpu").items() if name != "python"}
    result = CliRunner().invoke(app, ["doctor"])
    recorded([facts, result.exit_code, result.stdout.splitlines()[1:]])
