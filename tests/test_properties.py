"""Laws of names, words, tables and stored records, on values that nobody would think of."""
import json
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats.delimited import read_delimited, table_text
from spectrabox.radiometry.spectra.formats.tm27 import read_tm27, spdx_text
from spectrabox.radiometry.system.words import (
    cell,
    file_stem,
    from_cell,
    message,
    name_fault,
    plain,
    sharing_a_file,
    shortened,
)
from spectrabox.reconstruct.scene.scene_xml import materials_xml
from spectrabox.session.config.session_file import try_read_session
from spectrabox.session.store.record_files import load_stage, save_stage, stage_folder

few = settings(max_examples=60, deadline=None, derandomize=True, database=None)
NM = np.array([400.0, 500.0, 600.0])
words = st.text(st.characters(), max_size=100)
values = arrays(np.float64, 3, elements=st.floats(-1e30, 1e30, allow_subnormal=False))


@few
@given(words)
def test_a_good_name_is_a_file_of_its_own_inside_its_folder(name):
    if name_fault(name) is None:
        path = Path("/session/spdx") / f"{file_stem(name)}.spdx"
        assert path.parent == Path("/session/spdx") and not path.name.startswith(".")
        assert plain(name) == name and len(path.name.encode()) <= 255
        assert tomllib.loads(f"[{json.dumps(name, ensure_ascii=False)}]") == {name: {}}


@few
@given(st.lists(words, unique=True))
def test_names_that_share_no_file_have_files_of_their_own(names):
    shared = {second for _, second in sharing_a_file(names)}
    left = [file_stem(name).casefold() for name in names if name not in shared]
    assert len(set(left)) == len(left)


@few
@given(words)
def test_no_word_steers_a_terminal_and_none_is_lost(text):
    assert all(sign in "\n\t" or not 0 <= ord(sign) < 32 for sign in plain(text))
    plain(text).encode()
    assert plain(plain(text)) == plain(text) and message(text) == plain(text)
    assert len(shortened(text * 50)) < 200 and len(message(text * 1000)) < 10_000 * (
        1 + text.count("\n"))
    ET.fromstring(f"<a>{plain(text).translate({38: None, 60: None, 62: None})}</a>")


@few
@given(words)
def test_no_cell_is_a_formula_and_its_word_comes_back(text):
    once = plain(" ".join(text.split()))
    assert not cell(text).startswith(tuple("=+-@"))
    assert from_cell(cell(text)) == once or once.startswith("'")


@few
@given(st.lists(words.map(lambda text: "a" + " ".join(plain(text).split())), min_size=1,
                max_size=4, unique=True), values)
def test_a_table_comes_back_as_it_was_written(names, column):
    text = table_text(NM, dict.fromkeys(names, column), quantity=Quantity.RELATIVE, source="s")
    table = read_delimited(text.encode(), Path("a.csv"))
    assert table.names == tuple(names)
    np.testing.assert_allclose(table.values, np.tile(column, (len(names), 1)), rtol=1e-8)


@few
@given(words, values)
def test_xml_is_well_formed_whatever_a_name_holds(name, column):
    text = spdx_text(NM, {name: column}, quantity=Quantity.REFLECTANCE, source=name)
    np.testing.assert_allclose(read_tm27(text.encode(), Path("a.spdx")).values[0], column,
                               rtol=1e-8)
    ET.fromstring(materials_xml({name: np.clip(column, 0, 1)}, (400, 600)))


@few
@given(st.binary(max_size=200))
def test_any_bytes_as_session_toml_are_a_session_or_sentences(content):
    with TemporaryDirectory() as folder:
        (Path(folder) / "session.toml").write_bytes(content)
        config, problems = try_read_session(Path(folder))
        assert (config is None) == bool(problems)


@few
@given(st.dictionaries(st.text("abcdefg .", min_size=1, max_size=8), st.one_of(
    arrays(np.float64, st.tuples(st.integers(0, 3), st.integers(1, 3))), st.lists(words).map(tuple),
    st.none(), st.integers(-2**53, 2**53)), max_size=4), st.integers(0, 200))
def test_stored_records_come_back_or_are_known_as_damaged(records, at):
    with TemporaryDirectory() as folder:
        with stage_folder(Path(folder), "photo") as new:
            save_stage(new, {"settings": {}}, records, 1.0, {})
        stored = load_stage(Path(folder), "photo")
        assert stored.damage is None
        for name, value in records.items():
            kind = np.ndarray if isinstance(value, np.ndarray) else tuple[str, ...]
            back = stored.read(kind if not isinstance(value, int) else int, name)
            np.testing.assert_equal(back, value)
        path = Path(folder) / "photo" / ("arrays.npz" if at % 2 else "facts.json")
        content = path.read_bytes()
        path.write_bytes(content[:at % len(content)])
        assert load_stage(Path(folder), "photo").damage == path.name


def test_the_widest_table_is_refused_before_it_is_split():
    text = "nm" + ",a" * 25_000 + "\n400" + ",1" * 25_000 + "\n"
    with pytest.raises(InputError, match="25001 columns; 20000 is the limit"):
        read_delimited(text.encode(), Path("a.csv"))
