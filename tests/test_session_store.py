import json
import os
import subprocess

import numpy as np
import pytest

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.files import (
    sweep_unfinished,
    whole_file,
    write_text_whole,
)
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.calibration import Calibration, LightScale, SensitivityFit
from spectrabox.radiometry.records.spectra import Outcome, Quantity, Spectrum
from spectrabox.session.store.record_files import (
    fingerprint,
    load_stage,
    pack,
    save_stage,
    stage_folder,
    unpack,
    why_stale,
)

GRID = visible_grid(10)


def calibration():
    curves = np.random.default_rng(2).uniform(size=(3, GRID.nm.size))
    fit = SensitivityFit(GRID, curves, None, None, None, None, None, None, 12.5, "m",
                         Outcome.ILL_POSED)
    light = Spectrum(GRID, np.ones(GRID.nm.size), Quantity.RADIANCE, "lamp")
    return Calibration(fit, light, LightScale(2.0, None, None, "chart"), np.eye(3), (
        Finding("calibration.glare", Severity.NOTE, "near", {"photo_number": 2, "glare": 0.1}),))


def same(a, b):
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, name), getattr(b, name))
                                          for name in a.__dataclass_fields__)
    return np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b


def test_a_record_comes_back_as_it_was_stored():
    arrays = {}
    node = json.loads(json.dumps(pack(calibration(), "c", arrays)))
    assert same(unpack(Calibration, node, arrays), calibration())


def save(results, value):
    with stage_folder(results, "photo") as folder:
        save_stage(folder, {"settings": {"v": value}}, {"calibration": calibration()}, 1.0, {})


def test_a_stage_is_replaced_whole(tmp_path):
    save(tmp_path, 1)
    save(tmp_path, 2)
    assert load_stage(tmp_path, "photo").key == {"settings": {"v": 2}}
    assert same(load_stage(tmp_path, "photo").read(Calibration, "calibration"), calibration())
    assert [path.name for path in tmp_path.iterdir()] == ["photo"]


@pytest.mark.parametrize("name", ["facts.json", "arrays.npz"])
def test_a_stored_file_that_cannot_be_opened_is_named(tmp_path, name):
    save(tmp_path, 1)
    assert load_stage(tmp_path, "photo").damage is None
    path = tmp_path / "photo" / name
    for damaged in (path.read_bytes()[:-20], b""):
        path.write_bytes(damaged)
        assert load_stage(tmp_path, "photo").damage == name
    path.unlink()
    assert load_stage(tmp_path, "photo").damage == name


def test_damaged_arrays_get_a_sentence(tmp_path):
    save(tmp_path, 1)
    (tmp_path / "photo" / "arrays.npz").write_bytes(b"PK\x03\x04 not a zip")
    with pytest.raises(InputError, match=r"remove .*photo and run again"):
        load_stage(tmp_path, "photo").read(Calibration, "calibration")


def test_stored_arrays_cannot_carry_code(tmp_path):
    save(tmp_path, 1)
    np.savez(tmp_path / "photo" / "arrays.npz",
             **{"calibration.sensitivity.curves": np.array([{}], dtype=object)})
    with pytest.raises(InputError, match="damaged"):
        load_stage(tmp_path, "photo").read(Calibration, "calibration")


def test_results_of_another_format_are_told_from_damaged_ones(tmp_path):
    with stage_folder(tmp_path, "photo") as folder:
        save_stage(folder, {"settings": {}}, {"calibration": calibration()}, 1.0, {})
        facts = json.loads((folder / "facts.json").read_text())
        (folder / "facts.json").write_text(json.dumps(facts | {"format": 1}))
    assert load_stage(tmp_path, "photo").fault == "are of another version of spectrabox"


def test_records_of_a_surface_that_was_not_stored_get_a_sentence(tmp_path):
    save(tmp_path, 1)
    stored = load_stage(tmp_path, "photo").read(dict[str, Calibration])
    assert same(stored["calibration"], calibration())
    with pytest.raises(InputError, match="hold nothing of 'wall': 'spectrabox run'"):
        stored["wall"]


def test_why_a_stage_is_stale_is_said_in_words():
    before = {"files": {"a.dng": "1", "b.csv": "2"}, "settings": {"width": 96}}
    now = {"files": {"a.dng": "9", "c.csv": "2"}, "settings": {"width": 96}}
    assert why_stale(before, now) == ["files: a.dng changed", "files: b.csv is no longer used",
                                      "files: c.csv is new"]
    assert why_stale(before, before) == []
    assert fingerprint(before) != fingerprint(now)


def test_the_umask_decides_who_may_read_what_is_written(tmp_path):
    before = os.umask(0o027)
    try:
        write_text_whole(tmp_path / "a.txt", "a")
    finally:
        os.umask(before)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640


def test_no_output_is_written_through_a_link(tmp_path):
    (tmp_path / "secret").write_text("kept")
    (tmp_path / "a.txt").symlink_to(tmp_path / "secret")
    (tmp_path / "results").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere").mkdir()
    with pytest.raises(EnvironmentProblem, match=r"a\.txt is a symbolic link"):
        write_text_whole(tmp_path / "a.txt", "lost")
    with pytest.raises(EnvironmentProblem, match="results is a symbolic link"):
        save(tmp_path / "results", 1)
    assert (tmp_path / "secret").read_text() == "kept"
    assert not list((tmp_path / "elsewhere").iterdir())


def test_what_killed_processes_left_is_swept_and_what_runs_is_not(tmp_path):
    ended = subprocess.Popen(["true"])
    ended.wait()
    (tmp_path / f".spectrabox-{ended.pid}-0a.exr").write_text("half")
    (tmp_path / f".spectrabox-{os.getpid()}-0a.exr").write_text("being written")
    (tmp_path / ".spectrabox-notes").write_text("of somebody")
    sweep_unfinished(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {f".spectrabox-{os.getpid()}-0a.exr",
                                                          ".spectrabox-notes"}


def test_a_folder_that_cannot_be_written_gets_a_sentence(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    with pytest.raises(EnvironmentProblem, match="cannot be written"):
        write_text_whole(blocked / "report.html", "x")
    with pytest.raises(EnvironmentProblem, match="cannot be written"), stage_folder(blocked
                                                                                    / "results",
                                                                                    "photo"):
        pass


def test_what_was_read_before_a_replacement_stays_whole(tmp_path):
    """A rename: whoever has the old file open, or linked, keeps all of it."""
    path, kept = tmp_path / "a.txt", tmp_path / "kept.txt"
    write_text_whole(path, "first " * 1000)
    kept.hardlink_to(path)
    with path.open() as reader:
        begun = reader.read(6)
        with whole_file(path) as unfinished:
            unfinished.write_text("second")
            assert path.read_text() == "first " * 1000
        assert begun + reader.read() == "first " * 1000
    assert path.read_text() == "second" and kept.read_text() == "first " * 1000
    assert {file.name for file in tmp_path.iterdir()} == {"a.txt", "kept.txt"}
