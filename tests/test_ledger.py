"""The ledger's judgements, what it keeps, and that what is recorded is whole."""
import itertools
import os
import re
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import table_ages
from benchmarks.ledger import __main__ as ledger
from benchmarks.ledger import planted, recorded, rows, speed, table, task

CASES = [f"{number:02d}" for number in range(12)]
DRAWN = {kind: one for kind, one in rows.KINDS.items() if one.better and not one.certain}


def numbers(mean, spread, seed, names=CASES):
    """Numbers by case of exactly this mean and standard deviation."""
    drawn = np.random.default_rng(seed).standard_normal(len(names))
    drawn = (drawn - drawn.mean()) / drawn.std(ddof=1)
    return dict(zip(names, (mean + spread * drawn).tolist(), strict=True))


def plus(cases, others):
    return {name: value + others[name] for name, value in cases.items()}


def worse(kind, by):
    """A change of a positive mean that is a loss."""
    return -by if kind.better == "more" else by


@pytest.mark.parametrize("name", DRAWN)
def test_a_loss_beyond_its_paired_error_fails_and_one_within_it_does_not(name):
    kind = rows.KINDS[name]
    before = numbers(100 * kind.floor, 50 * kind.floor, 1)      # cases differ far more
    for errors, word in ((2.1, "worse"), (1.9, "same"), (-1.9, "same"), (-2.1, "better")):
        # a change of 4 floors, whose standard error over the cases makes it so many errors
        change = 4 * kind.floor * np.sign(errors)
        spread = abs(change / errors) * np.sqrt(len(CASES))
        found = plus(before, numbers(worse(kind, change), spread, 2))
        judgement = rows.judged(kind, found, before)
        assert judgement.word == word and judgement.fails == (word == "worse")
        assert judgement.loss == pytest.approx(change)
        assert judgement.error == pytest.approx(abs(change / errors))


@pytest.mark.parametrize("name", DRAWN)
def test_less_than_the_floor_is_nothing_however_sure_it_is(name):
    kind = rows.KINDS[name]
    before = numbers(100 * kind.floor, kind.floor, 1)
    for share, word in ((0.9, "same"), (1.1, "worse"), (-1.1, "better")):
        found = plus(before, dict.fromkeys(CASES, worse(kind, share * kind.floor)))
        assert rows.judged(kind, found, before).word == word


@pytest.mark.parametrize("name", DRAWN)
def test_few_cases_are_judged_by_the_larger_floor_alone(name):
    kind, names = rows.KINDS[name], CASES[:rows.FEWEST_DRAWN - 1]
    before = numbers(100 * kind.few, kind.few, 1, names)
    for share, word in ((0.9, "same"), (1.1, "worse")):
        off = numbers(worse(kind, share * kind.few), 10 * kind.few, 3, names)
        assert rows.judged(kind, plus(before, off), before).word == word


@pytest.mark.parametrize("name", [name for name, kind in rows.KINDS.items() if kind.certain])
def test_one_answer_that_is_lost_fails(name):
    kind, before = rows.KINDS[name], dict.fromkeys(CASES, 1.0)
    assert rows.judged(kind, before | {"03": 0.0}, before).fails
    assert rows.judged(kind, before, before | {"03": 0.0}).word == "better"
    assert not rows.judged(kind, before | {"03": 0.0}, before | {"03": 0.0}).fails


@pytest.mark.parametrize("name", [name for name, kind in rows.KINDS.items()
                                  if kind.better == "nearer zero"])
def test_of_a_bias_the_distance_from_zero_counts(name):
    kind = rows.KINDS[name]
    size = 20 * kind.floor
    for sign, other in itertools.product((-1, 1), repeat=2):
        before, found = (numbers(mean, kind.floor, 1) for mean in (sign * size, 2 * other * size))
        assert rows.judged(kind, found, before).word == "worse"
        assert rows.judged(kind, before, found).word == "better"
        mirrored = {case: -value for case, value in before.items()}
        assert rows.judged(kind, mirrored, before).word == "same"


@pytest.mark.parametrize("name", [name for name, kind in rows.KINDS.items() if not kind.better])
def test_what_is_printed_never_fails(name):
    for factor in (1e-3, 1e3):
        found = numbers(factor, factor, 2)
        assert not rows.judged(rows.KINDS[name], found, numbers(1, 1, 1)).fails


def test_what_is_missing_new_or_no_number_fails_and_what_was_not_asked_for_does_not():
    kind, before = rows.KINDS["RMSE"], numbers(0.03, 0.01, 1)
    without = {case: value for case, value in before.items() if case != "07"}
    assert "07" in rows.judged(kind, without, before).says
    for found, known in ((without, before), ({}, before), (before, without), (before, None),
                         (before | {"07": np.nan}, before), ({}, None)):
        assert rows.judged(kind, found, known).fails
    assert not rows.judged(kind, None, before).fails


def test_every_kind_is_known_by_the_end_of_a_name():
    for name, kind in rows.KINDS.items():
        assert rows.kind_of(f"simulated/box, two lamps/{name}") is kind
        assert rows.kind_of(f"real/box/{name}, neutral 3.5") is kind
    with pytest.raises(KeyError):
        rows.kind_of("real/box/colour")


def test_recorded_rows_come_back_as_they_were_written(tmp_path):
    path, name = tmp_path / "ledger.toml", 'simulated/a "row", with L*/RMSE'
    kept = recorded.record({}, name, numbers(0.03, 0.01, 1), "7c330ef8", "as it is",
                           rows.Judgement("not recorded"))
    kept = recorded.record(kept, name, numbers(0.05, 0.01, 2), "ab330ef8", "glare is harder now",
                           rows.Judgement("worse"))
    recorded.write_recorded(kept, path)
    assert recorded.read_recorded(path) == kept
    assert kept[name].reasons == ("7c330ef8: as it is", "ab330ef8: worse: glare is harder now")
    assert kept[name].value == pytest.approx(0.05)
    assert not recorded.read_recorded(tmp_path / "none.toml")


@pytest.fixture
def measured(tmp_path, monkeypatch):
    """A ledger of one row of six cases, in a folder of its own: set what is measured."""
    cases = {f"{number}": 0.03 + 0.001 * number for number in range(6)}
    now = SimpleNamespace(rows={"simulated/shoots/RMSE": dict(cases)}, faults={})
    tasks = [task.Task("simulated/shoots", case, dict) for case in cases]
    monkeypatch.setattr(ledger, "FILES", (SimpleNamespace(tasks=lambda data: iter(tasks)),))
    monkeypatch.setattr(task, "measure_all", lambda tasks, workers: task.Measured(
        {name: dict(one) for name, one in now.rows.items()}, dict(now.faults)))
    monkeypatch.setattr(recorded, "FILE", tmp_path / "ledger.toml")
    monkeypatch.setattr(table, "PAGE", tmp_path / "ledger.md")
    monkeypatch.setattr(ledger, "LAST", tmp_path / "build" / "ledger.json")
    monkeypatch.delenv("SPECTRABOX_DATA", raising=False)
    table.PAGE.write_text(f"# By hand\n\n{table.BEGIN}\nold\n")
    return now


def test_a_worse_row_ends_in_4_until_it_is_recorded_with_a_reason(measured, capsys):
    assert ledger.main([]) == 4                                 # never recorded
    assert ledger.main(["--record", "*", "--reason", "as it is"]) == 0
    assert ledger.main([]) == 0
    measured.rows["simulated/shoots/RMSE"] = {
        case: value + 0.002 for case, value in measured.rows["simulated/shoots/RMSE"].items()}
    assert ledger.main([]) == 4
    assert "worse: simulated/shoots/RMSE: 0.0020 ± 0.0000 worse" in capsys.readouterr().out
    assert "**worse**" in table.PAGE.read_text()
    with pytest.raises(SystemExit) as ended:
        ledger.main(["--record", "simulated/shoots/RMSE"])      # without a reason
    assert ended.value.code == 2
    assert ledger.main(["--record", "simulated/shoots/*", "--reason", "harder shoots"]) == 0
    assert ledger.main([]) == 0
    kept = recorded.read_recorded(recorded.FILE)["simulated/shoots/RMSE"]
    assert kept.reasons[-1].endswith(": worse: harder shoots")
    text = table.PAGE.read_text()
    assert text.startswith("# By hand\n") and "old" not in text and "simulated" in text


def test_what_the_last_run_measured_is_recorded_without_measuring_again(measured, monkeypatch):
    with pytest.raises(SystemExit):
        ledger.main(["--last"])                                 # there is none
    measured.faults["simulated/shoots", "9"] = "ValueError: no light"
    assert ledger.main([]) == 4
    monkeypatch.delattr(task, "measure_all")
    assert ledger.main(["--last", "--record", "*", "--reason", "as it is"]) == 0
    assert ledger.main(["--last"]) == 0
    kept = recorded.read_recorded(recorded.FILE)["simulated/shoots/RMSE"]
    assert kept.cases == pytest.approx(measured.rows["simulated/shoots/RMSE"], rel=1e-5)
    assert task.Measured.stored(ledger.LAST).faults == measured.faults


def test_an_answer_that_is_lost_ends_in_4_and_says_why(measured, capsys):
    assert ledger.main(["--record", "*", "--reason", "as it is"]) == 0
    del measured.rows["simulated/shoots/RMSE"]["4"]
    measured.faults["simulated/shoots", "4"] = "ValueError: zero-size array"
    assert ledger.main([]) == 4
    said = capsys.readouterr().out
    assert "simulated/shoots, case 4: ValueError: zero-size array" in said
    assert "incomplete: simulated/shoots/RMSE: no value of case 4" in said
    assert ledger.main(["--record", "*", "--reason", "such shoots are refused"]) == 0
    assert ledger.main([]) == 0
    kept = recorded.read_recorded(recorded.FILE)["simulated/shoots/RMSE"]
    assert kept.reasons[-1].endswith(": worse: such shoots are refused")


def test_a_row_that_is_measured_no_more_ends_in_4(measured, capsys):
    assert ledger.main(["--record", "*", "--reason", "as it is"]) == 0
    kept = recorded.read_recorded(recorded.FILE)
    recorded.write_recorded(kept | {"simulated/gone/RMSE": kept["simulated/shoots/RMSE"]},
                            recorded.FILE)
    assert ledger.main(["--only", "simulated/shoots"]) == 0
    assert ledger.main([]) == 4
    assert "simulated/gone/RMSE: it was not measured" in capsys.readouterr().out


def test_rows_of_other_blocks_stay_as_they_are_recorded(measured):
    assert ledger.main(["--record", "*", "--reason", "as it is"]) == 0
    kept = recorded.read_recorded(recorded.FILE)
    recorded.write_recorded(kept | {"real/box/RMSE, green": kept["simulated/shoots/RMSE"]},
                            recorded.FILE)
    assert ledger.main([]) == 0                                 # real is not measured without data
    assert ledger.main(["--only", "simulated"]) == 0
    with pytest.raises(SystemExit):
        ledger.main(["--only", "nothing"])


def test_tasks_are_measured_apart_and_one_that_fails_takes_no_other_with_it():
    done = task.measure_all([task.Task("simulated/a", "0", dict, ([("held", 0.9)],)),
                             task.Task("simulated/a", "1", dict, (7,)),
                             task.Task("simulated/a", "2", os._exit, (1,)),
                             task.Task("simulated/b", "0", dict, ([("held", 0.8)],))], 1)
    assert done.rows == {"simulated/a/held": {"0": 0.9}, "simulated/b/held": {"0": 0.8}}
    assert list(done.faults) == [("simulated/a", "1"), ("simulated/a", "2")]
    assert done.faults["simulated/a", "1"].startswith("TypeError: ")


def test_what_is_recorded_is_whole():
    kept = recorded.read_recorded(recorded.FILE)
    text = recorded.FILE.read_text(encoding="utf-8")
    assert kept
    for name, row in kept.items():
        assert rows.kind_of(name) and row.cases and row.commit and row.reasons, name
        assert np.all(np.isfinite(list(row.cases.values()))), name
        stated = re.search(rf'^\["{re.escape(name)}"\]\nvalue = (\S+)$', text, re.MULTILINE)
        assert float(stated[1]) == pytest.approx(row.value, rel=1e-5, abs=1e-9), name
    assert set(table.GOALS) <= set(kept)


def test_the_page_shows_every_recorded_row_with_its_value_and_commit():
    page = table.PAGE.read_text(encoding="utf-8")
    for name, row in recorded.read_recorded(recorded.FILE).items():
        line = next(line for line in page.splitlines()
                    if line.startswith(f"| {name.split('/', 1)[1]} |"))
        cells = [cell.strip() for cell in line.split("|")]
        assert cells[3:5] == [table.number(name, row.cases), row.commit]


def test_every_reason_for_a_worse_row_stands_in_the_changelog():
    changes = " ".join((recorded.ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split())
    for name, row in recorded.read_recorded(recorded.FILE).items():
        for reason in row.reasons:
            if ": worse: " in reason:
                assert reason.split(": worse: ", 1)[1] in changes, f"{name}: {reason}"


def test_lines_of_code_are_those_without_blanks_comments_and_docstrings():
    source = ('"""Words."""\n\n# more\ndef one():\n    """Two\n    lines."""\n    return (1,\n'
              '            2)   # yes\n\n\nTEXT = """a\n\nb"""\n')
    assert speed.lines_of(source) == 6


def test_every_table_of_results_says_its_last_run():
    assert all(each.commit and each.folders for each in table_ages.all_tables())
    assert all((table_ages.ROOT / folder).is_dir()
               for each in table_ages.all_tables() for folder in each.folders)


def test_the_last_run_belongs_to_the_table_above_it():
    text = ("| a |\n|--|\n| 1 |\n\nLast run: `make x`, commit `0123abcd`; rests on measure, "
            "spectrabox/api.\n\nWords.\n\n| b |\n|--|\n\nMore words.\n\nLast run: by hand, commit "
            "`0123abce`; rests on measure.\n")
    first, second = table_ages.tables_of("page.md", text)
    assert (first.line, first.command, first.commit) == (1, "make x", "0123abcd")
    assert first.folders == ("measure", "spectrabox/api")
    assert (second.line, second.commit) == (9, "")


def test_every_mistake_can_still_be_planted_and_its_blocks_are_measured():
    blocks = {one.block for file in ledger.FILES for one in file.tasks(None)}
    for mistake, wanted in planted.listed():
        text = (recorded.ROOT / mistake.file).read_text(encoding="utf-8")
        assert text.count(mistake.old) == 1 and mistake.new != mistake.old, mistake.what
        assert set(wanted) <= blocks
