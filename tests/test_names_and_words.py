import pytest

from spectrabox.measure.captured import View
from spectrabox.radiometry.records.spectra import UnknownLight
from spectrabox.radiometry.system.words import name_fault
from spectrabox.session.config.session_file import try_read_session

from tests.test_session_file import GOOD


def problems_of(tmp_path, text):
    (tmp_path / "session.toml").write_text(text, encoding="utf-8")
    return try_read_session(tmp_path)[1]


@pytest.mark.parametrize("name", ["white", "B/W 50%", "été 2", "7", "a:b", "FL3.15", "x" * 80])
def test_a_name_of_a_person_is_taken(name):
    assert name_fault(name) is None


@pytest.mark.parametrize("name, why", [
    ("", "begins with"), (" ", "begins with"), (" a", "begins with"), ("a ", "end in a space"),
    ("a.", "end in a space"), ("..", "begins with"), ("/etc", "begins with"), ("-o", "begins with"),
    ("=cmd|' /C calc'!A0", "begins with"), ("a\x1b[31m", "printable"), ("a\nb", "printable"),
    ("a\u202eb", "printable"), ("x" * 81, "80 characters"), ("\U0001d400" * 60, "80 characters")])
def test_a_name_that_harms_is_refused(name, why):
    assert why in name_fault(name)


@pytest.mark.parametrize("table", [
    '[views."{}"]\nphoto = "photos/b.dng"\n', '[materials."{}"]\nbsdf = "b"\n',
    '[session]\nname = "{}"\n'])
@pytest.mark.parametrize("name", [" ", "", "a ", r"\u001b[2J"])
def test_one_rule_holds_for_all_that_has_a_name(tmp_path, table, name):
    (problem,) = problems_of(tmp_path, GOOD + table.format(name))
    assert "a name" in problem


@pytest.mark.parametrize("table", ['[views."{}"]\nphoto = "photos/b.dng"\n',
                                   '[materials."{}"]\nbsdf = "{}"\n'])
@pytest.mark.parametrize("pair", [("a/b", "a:b"), ("paint", "PAINT"), ("e\u0301", "é")])
def test_two_names_that_share_a_file_are_refused(tmp_path, table, pair):
    text = GOOD + "".join(table.format(name, index) for index, name in enumerate(pair))
    (problem,) = problems_of(tmp_path, text)
    assert "files would be named alike" in problem


def test_no_name_of_a_view_replaces_the_record_of_another():
    first, named = (View(name, {}, {}, UnknownLight(), "unknown") for name in ("", " "))
    assert first.label("preview") != named.label("preview")
