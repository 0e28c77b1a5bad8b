import json

import numpy as np
import pytest

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.files import sha256_of, write_text_whole
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import (
    Calibration,
    LightScale,
    Outcome,
    Quantity,
    SensitivityFit,
    Spectrum,
    SurfaceAgreement,
)
from spectrabox.session.store.record_files import pack, unpack
from spectrabox.session.store.store import (
    fingerprint,
    load_stage,
    save_stage,
    stage_folder,
    why_stale,
)

GRID = visible_grid(10)


def calibration():
    curves = np.random.default_rng(2).uniform(size=(3, GRID.nm.size))
    fit = SensitivityFit(GRID, curves, None, None, None, None, None, None, 12.5, "m",
                         Outcome.ILL_POSED)
    light = Spectrum(GRID, np.ones(GRID.nm.size), Quantity.RADIANCE, "lamp")
    return Calibration(fit, light, LightScale(2.0, None, None, "chart"), np.eye(3), ("a", "b"))


def same(a, b):
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, name), getattr(b, name))
                                          for name in a.__dataclass_fields__)
    return np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b


def test_a_record_comes_back_as_it_was_stored():
    arrays = {}
    node = json.loads(json.dumps(pack(calibration(), "c", arrays)))
    assert same(unpack(Calibration, node, arrays), calibration())


def test_tuples_of_names_and_whole_numbers_survive():
    record = SurfaceAgreement(("a", "b"), ("w", "w"), np.array([3, 4]), np.ones((2, 3)),
                              np.zeros((2, 3)))
    arrays = {}
    back = unpack(SurfaceAgreement, json.loads(json.dumps(pack(record, "r", arrays))), arrays)
    assert same(back, record)


def save(results, value):
    with stage_folder(results, "photo") as folder:
        save_stage(folder, {"settings": {"v": value}}, {"calibration": calibration()}, 1.0, {})


def test_a_stage_is_replaced_whole(tmp_path):
    save(tmp_path, 1)
    save(tmp_path, 2)
    assert load_stage(tmp_path, "photo").key == {"settings": {"v": 2}}
    assert same(load_stage(tmp_path, "photo").record(Calibration, "calibration"), calibration())
    assert [path.name for path in tmp_path.iterdir()] == ["photo"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_a_stage_cut_short_leaves_the_last_good_result(tmp_path, error):
    save(tmp_path, 1)
    with pytest.raises(error), stage_folder(tmp_path, "photo") as folder:
        (folder / "half").write_text("half")
        raise error
    assert load_stage(tmp_path, "photo").key == {"settings": {"v": 1}}
    assert [path.name for path in tmp_path.iterdir()] == ["photo"]


def test_a_replacement_cut_between_its_renames_is_undone(tmp_path):
    save(tmp_path, 1)
    (tmp_path / "photo").rename(tmp_path / ".photo.old")
    assert load_stage(tmp_path, "photo").key == {"settings": {"v": 1}}


def test_half_a_facts_file_counts_as_no_result(tmp_path):
    save(tmp_path, 1)
    facts = tmp_path / "photo" / "facts.json"
    facts.write_text(facts.read_text()[:50])
    assert load_stage(tmp_path, "photo") is None


def test_damaged_arrays_get_a_sentence(tmp_path):
    save(tmp_path, 1)
    (tmp_path / "photo" / "arrays.npz").write_bytes(b"PK\x03\x04 not a zip")
    with pytest.raises(InputError, match="run again with --force"):
        load_stage(tmp_path, "photo").record(Calibration, "calibration")


def test_stored_arrays_cannot_carry_code(tmp_path):
    save(tmp_path, 1)
    np.savez(tmp_path / "photo" / "arrays.npz",
             **{"calibration.sensitivity.curves": np.array([{}], dtype=object)})
    with pytest.raises(InputError, match="damaged"):
        load_stage(tmp_path, "photo").record(Calibration, "calibration")


def test_the_same_records_give_the_same_bytes(tmp_path):
    save(tmp_path / "a", 1)
    save(tmp_path / "b", 1)
    for name in ("facts.json", "arrays.npz"):
        assert sha256_of(tmp_path / "a" / "photo" / name) == sha256_of(tmp_path / "b" / "photo"
                                                                       / name)


def test_why_a_stage_is_stale_is_said_in_words():
    before = {"files": {"a.dng": "1", "b.csv": "2"}, "settings": {"width": 96}}
    now = {"files": {"a.dng": "9", "c.csv": "2"}, "settings": {"width": 96}}
    assert why_stale(before, now) == ["files: a.dng changed", "files: b.csv is no longer used",
                                      "files: c.csv is new"]
    assert why_stale(before, before) == []
    assert fingerprint(before) != fingerprint(now)


def test_a_text_file_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.txt"
    write_text_whole(path, "first")
    with pytest.raises(UnicodeEncodeError):
        # a lone surrogate cannot be encoded, half way through the write
        write_text_whole(path, "second \ud800")
    assert path.read_text() == "first"
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]


def test_a_folder_that_cannot_be_written_gets_a_sentence(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    with pytest.raises(EnvironmentProblem, match="cannot be written"):
        write_text_whole(blocked / "report.html", "x")
    with pytest.raises(EnvironmentProblem, match="cannot be written"), stage_folder(blocked
                                                                                    / "results",
                                                                                    "photo"):
        pass
