"""Every finding that the product can make has its text, and no text is left over."""
import ast
import re
from pathlib import Path

import numpy as np
import pytest

from spectrabox.measure import texts
from spectrabox.radiometry.findings import Finding, Severity, each_once, graded, worst

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("radiometry", "capture", "calibrate", "reconstruct", "sampling", "measure", "session",
         "spectrabox/api")
CODE = re.compile(r"[a-z]+(\.[a-z0-9-]+)+")


def codes_in_source() -> dict[str, str]:
    """Codes that ``Finding(...)`` is called with, each with the file that does it."""
    codes = {}
    for room in ROOMS:
        for file in sorted((ROOT / room).rglob("*.py")):
            for node in ast.walk(ast.parse(file.read_text("utf-8"))):
                if isinstance(node, ast.Call) and {"Finding", "condition"} & {
                        getattr(node.func, "id", ""), getattr(node.func, "attr", "")}:
                    code = node.args[0] if node.args else next(
                        word.value for word in node.keywords if word.arg == "code")
                    for constant in ast.walk(code):
                        if isinstance(constant, ast.Constant) and isinstance(constant.value, str):
                            codes[constant.value] = str(file.relative_to(ROOT))
    return codes


def test_every_finding_that_is_made_has_a_text():
    without = {code: file for code, file in codes_in_source().items() if code not in texts.TEXTS}
    assert not without, f"add these codes to measure/texts.py: {without}"


def test_codes_are_a_topic_and_what_was_found():
    assert not [code for code in texts.TEXTS if not CODE.fullmatch(code)]


def test_severities_rank_from_harmless_to_worst():
    ranked = [Severity.INFO, Severity.NOTE, Severity.WARN, Severity.FAIL]
    assert sorted(Severity, key=lambda one: one.value) == ranked
    assert worst([]) is Severity.INFO
    assert worst(Finding("a.b", one) for one in ranked) is Severity.FAIL
    assert [graded(value, 1, 2) for value in (1, 1.5, 3)] == [ranked[0], ranked[2], ranked[3]]


def test_equal_findings_are_kept_once_in_their_order():
    first, second = Finding("a.b", Severity.NOTE, "x"), Finding("a.b", Severity.NOTE, "y")
    assert each_once([first, second, Finding("a.b", Severity.NOTE, "x")]) == (first, second)


@pytest.mark.parametrize("template, expected", [
    ("{share:percent} of it", "12 % of it"), ("{share:percent0}", "12 %"),
    ("{names:listed}", "a, b and c"), ("{names:quoted}", "“a”, “b” and “c”"),
    ("{ratio:deviation}", "20 % darker"), ("light{where}", "light in the photo “near”"),
    ("{subject}: {count:d}", "near: 3"), (lambda values: values["names"][0], "a")])
def test_templates_show_shares_names_ratios_and_photos(monkeypatch, template, expected):
    monkeypatch.setitem(texts.TEXTS, "test.code", texts.Text("", template))
    values = {"share": 0.123, "names": ["a", "b", "c"], "ratio": 0.8, "count": 3}
    finding = Finding("test.code", Severity.WARN, "near", values)
    assert texts.sentence(finding) == expected
    assert texts.facts(finding)["values"] == values


def test_a_finding_is_kept_with_its_record():
    from spectrabox.session.store.record_files import pack, unpack
    finding = Finding("chart.clipped", Severity.WARN, "near", {"names": ["white"], "share": 0.5})
    arrays: dict[str, np.ndarray] = {}
    assert unpack(Finding, pack(finding, "", arrays), arrays) == finding
    assert not arrays


# ---- nothing reads a sentence to decide ----------------------------------------------------------

WORDS_OF = {"name", "sentence", "remedy", "says", "shown", "limit", "holds", "fault", "conditions",
            "paragraph", "reasons"}
READ = {"startswith", "endswith", "find", "index", "split", "partition", "count"}


def says_words(node: ast.expr) -> bool:
    """Whether an expression has a sentence of a finding in it."""
    return any((isinstance(one, ast.Call) and isinstance(one.func, ast.Attribute)
               and getattr(one.func.value, "id", "") == "texts" and one.func.attr in WORDS_OF)
               or (isinstance(one, ast.Attribute) and one.attr == "sentence"
               and getattr(one.value, "id", "") != "texts") for one in ast.walk(node))


def decisions_in(tree: ast.AST) -> list[int]:
    """Lines at which something is decided by a sentence: tests, comparisons, searches."""
    lines = []
    for node in ast.walk(tree):
        if isinstance(node, ast.If | ast.IfExp | ast.While | ast.Assert):
            read = says_words(node.test)
        elif isinstance(node, ast.Compare):
            read = any(map(says_words, (node.left, *node.comparators)))
        elif isinstance(node, ast.comprehension):
            read = any(map(says_words, node.ifs))
        else:
            read = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) \
                and node.func.attr in READ and says_words(node.func.value)
        if read:
            lines.append(node.iter.lineno if isinstance(node, ast.comprehension) else node.lineno)
    return lines


@pytest.mark.parametrize("line", [
    "x = 1 if texts.says(one) else 2", "x = texts.sentence(one).startswith('a')",
    "x = 'glare' in texts.says(one)", "x = [one for one in them if texts.limit(one)]",
    "x = 'mirrored' in drift.sentence"])
def test_a_decision_by_a_sentence_is_seen(line):
    assert decisions_in(ast.parse(line)) == [1]


def test_nothing_is_decided_by_a_sentence():
    found = [f"{file.relative_to(ROOT)}:{line}" for room in ROOMS
             for file in sorted((ROOT / room).rglob("*.py"))
             if file.name != "texts.py"
             for line in decisions_in(ast.parse(file.read_text("utf-8")))]
    assert not found, f"decide by the code or the values of the finding: {found}"
