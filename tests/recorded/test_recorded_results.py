"""Records notice what moves, and only that."""
import ast
import json
from pathlib import Path

import numpy as np
import pytest
from recorded_results import FOLDER, Record, leaves, moved

RNG = np.random.default_rng(3)
MANY = RNG.standard_normal(200)


def _said(before, now, rtol=1e-6):
    return moved(dict(leaves(before)), dict(leaves(now)), rtol)


@pytest.mark.parametrize("before, now", [
    (1.0, 1.0 + 1e-5), (1, 2), ("a wall", "a floor"), (True, False), (None, 0.0),
    ("worst 1.30", "worst 1.35"), ("3 of 4", "4 of 4"), ((1.0, 2.0), (2.0, 1.0)),
    ([1.0], [1.0, 1.0]),
    ({"R": 1.0}, {"G": 1.0}), (MANY, MANY[::-1]), (MANY, MANY * (1 + 1e-4)),
    (MANY, MANY.reshape(20, 10)), (MANY.reshape(20, 10), MANY.reshape(20, 10)[:, ::-1]),
    (MANY, np.where(MANY > 2, np.nan, MANY)), (np.arange(3.0), np.arange(3.0)[::-1])])
def test_what_moves_is_said(before, now):
    assert _said(before, now)


@pytest.mark.parametrize("before, now", [
    (1.0, 1.0 + 1e-8), (MANY, MANY * (1 + 1e-9)), ("worst 1.30", "worst 1.31"), (3, 3.0),
    (np.array([1.0, 1e-9]), np.array([1.0, 2e-9])), (MANY, MANY + 1e-9)])
def test_what_another_machine_changes_is_not_said(before, now):
    assert not _said(before, now)


def test_any_one_number_of_many_is_noticed():
    for place in range(0, MANY.size, 7):
        other = MANY.copy()
        other[place] += 1e-3
        assert _said(MANY, other), place


def test_what_no_record_keeps_is_refused():
    with pytest.raises(TypeError, match="which no record keeps"):
        dict(leaves({"a": object()}))


def test_a_record_is_written_and_then_held(tmp_path):
    file = tmp_path / "test_recorded_x.json"
    Record(file, "test_a", True)({"white": MANY})
    Record(file, "test_b", True)("a sentence")
    Record(file, "test_a", False)({"white": MANY})
    with pytest.raises(AssertionError, match="not as recorded"):
        Record(file, "test_a", False)({"white": MANY + 1})
    with pytest.raises(AssertionError, match="nothing is recorded"):
        Record(file, "test_c", False)({"white": MANY})


def test_every_record_has_its_test():
    for file in FOLDER.glob("*.json"):
        tree = ast.parse((Path(__file__).parent / f"{file.stem}.py").read_text(encoding="utf-8"))
        tests = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
        names = {name.partition("/")[0].partition("[")[0]
                 for name in json.loads(file.read_text(encoding="utf-8"))}
        assert names <= tests, file
