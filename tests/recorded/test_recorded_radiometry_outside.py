"""Recorded: files, archives, memory, names and words from outside; records and their shapes."""
import bz2
import dataclasses
import gzip
import lzma
import os
import re
import signal
import zipfile
from types import SimpleNamespace
from typing import Annotated

import numpy as np
import pytest
from recorded_refusals import said

from spectrabox.radiometry import errors, records
from spectrabox.radiometry.files import (
    UNFINISHED,
    file_state,
    names_a_file,
    sha256_of,
    sweep_unfinished,
    whole_file,
    whole_folder,
    write_text_whole,
)
from spectrabox.radiometry.outside import free_memory as memory
from spectrabox.radiometry.outside import interruption
from spectrabox.radiometry.outside.archives import opened_npz, opened_zip, unpacked
from spectrabox.radiometry.outside.bands_of_rows import read_by_bands, written_by_bands
from spectrabox.radiometry.outside.loaded_beside import loaded_beside
from spectrabox.radiometry.outside.names import file_stem, name_fault, sharing_a_file
from spectrabox.radiometry.outside.second_process import beside
from spectrabox.radiometry.outside.words import cell, from_cell, message, plain, shortened
from spectrabox.radiometry.records import Outcome, share_inside
from spectrabox.radiometry.shaped import Record, array_fields
from spectrabox.radiometry.spectra.formats import zarr_array


def test_exit_codes(recorded):
    kinds = [each for each in vars(errors).values()
             if isinstance(each, type) and issubclass(each, errors.SpectraboxError)]
    recorded({each.__name__: (each.exit_code, str(each("a\x1bb\nx"))) for each in kinds})
    assert all(len(str(each("x" * 2001))) < 2000 for each in kinds)


def test_names(recorded):
    names = ("", "white paint", "B/W 50%", " a", "-a", "a ", "a.", "a\nb", "été 2", "x" * 80,
             "x" * 81, "é" * 80, "日" * 66, "日" * 67, "a\tb", "_a", "5")
    recorded({f"{number} {name[:9]!r}": (name_fault(name), file_stem(name)[:20])
              for number, name in enumerate(names)}
             | {"shared": sharing_a_file(["a/b", "A-b", "c", "a?b", "c", "e\u0301", "é"])})


def test_words(recorded):
    texts = ("plain", "\x00\x07\x1b[2J", "a\tb\nc\rd", "\u202etxt\u2066", "\x7f\x9f\x85", "\ud800",
             "=1+1", "+x", "-x", "@x", "'=x", "'x", "  a   b ", "\ufffe\ufdd0 \u2028 \u2030 \x20")
    recorded({text.encode("unicode_escape").decode(): (plain(text), cell(text), from_cell(text),
                                                       from_cell(cell(text)), message(text))
              for text in texts})
    digits = "".join(str(number % 10) for number in range(3000))
    recorded([shortened(digits[:count]) for count in (117, 118, 119, 300)]
             + [message(digits[:1999]) == digits[:1999], message(digits[:2000]) == digits[:2000],
                message("a\n" + digits[:2001])], case="long")


def test_names_of_files(recorded, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "D50").write_text("x")
    recorded({word: names_a_file(word) for word in (
        "D65", "D50", "FL3.15", "a.csv", "FL3.1a", "a/b", ".csv", "x" * 5000)})


def test_states_of_files(recorded, tmp_path):
    path = tmp_path / "a.txt"
    path.write_bytes(b"abc" * 1000)
    before = file_state(path)
    recorded({"sha": sha256_of(path), "stamp": len(before.stamp), "size": before.stamp[2],
              "missing": said(lambda: sha256_of(tmp_path / "b"), tmp_path),
              "folder": said(lambda: sha256_of(tmp_path), tmp_path)})
    assert file_state(path) == before
    os.utime(path, ns=(1, 1))
    assert file_state(path) != before


def test_files_are_written_whole(recorded, tmp_path):
    found = {}

    def left():
        return sorted(re.sub(r"\d+-[0-9a-f]{12}", "NAME", path.name) for path in tmp_path.iterdir())
    write_text_whole(tmp_path / "new" / "a.txt", "é\n")
    found["bytes"] = str((tmp_path / "new" / "a.txt").read_bytes())
    (tmp_path / "link").symlink_to(tmp_path / "new" / "a.txt")
    (tmp_path / "file").write_text("old")
    for name, opened in (("file", whole_file), ("folder", whole_folder)):
        for path in ("link", "new", "file"):
            found[f"{name} {path}"] = said(lambda o=opened, p=path: _entered(o, tmp_path / p),
                                           tmp_path)
        found[f"{name} below"] = said(lambda o=opened: _entered(o, tmp_path / "file" / "x"),
                                      tmp_path)
    (tmp_path / "file").write_text("old")
    with pytest.raises(KeyError), whole_file(tmp_path / "file") as unfinished:
        unfinished.write_text("new")
        raise KeyError
    found["after a failure"] = [(tmp_path / "file").read_text(), left()]
    with whole_folder(tmp_path / "set.x") as unfinished:
        (unfinished / "inner").mkdir(parents=True)
        (unfinished / "inner" / "a").write_text("1")
        found["while"] = left()
    with whole_folder(tmp_path / "set.x") as unfinished:
        unfinished.mkdir()
    found["replaced"] = [left(), sorted(path.name for path in (tmp_path / "set.x").iterdir())]
    for owner in (os.getpid(), 2**22 + 5, "x"):      # one that cannot be: above Linux's most
        (tmp_path / f"{UNFINISHED}{owner}-1").mkdir()
        (tmp_path / f"{UNFINISHED}{owner}-2.txt").write_text("")
    sweep_unfinished(tmp_path)
    found["swept"] = [name.replace(str(os.getpid()), "OURS") for name in left()]
    recorded(found)


def _entered(opened, path):
    with opened(path) as unfinished:
        if opened is whole_folder:
            unfinished.mkdir()
    return sorted(each.name for each in path.parent.iterdir())


def test_archives(recorded, tmp_path):
    rng = np.random.default_rng(1)
    np.savez(tmp_path / "a.npz", a=rng.normal(size=(3, 2)), b=np.arange(4))
    np.save(tmp_path / "one.npy", np.arange(3))
    np.savez(tmp_path / "objects.npz", a=np.array([{}], dtype=object))
    (tmp_path / "cut.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:-30])
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        size = sum(member.file_size for member in archive.infolist())

    def arrays(name, **limits):
        with opened_npz(tmp_path / name, **limits) as stored:
            return {key: stored[key] for key in stored}

    def members(**limits):
        with opened_zip(tmp_path / "a.npz", **limits) as archive:
            return archive.namelist()
    recorded({"size": size, **{name: said(lambda name=name: arrays(name)) for name in
                               ("a.npz", "one.npy", "objects.npz", "cut.npz")},
              "missing": said(lambda: arrays("no.npz"), tmp_path),
              **{f"limit {off}": (said(lambda off=off: sorted(arrays("a.npz", limit=size + off))),
                                  said(lambda off=off: members(limit=size + off)))
                 for off in (-1, 0)}})
    content = b"spectrum " * 400
    packed = {"plain": content, "gz": gzip.compress(content, mtime=0), "bz2": bz2.compress(content),
              "xz": lzma.compress(content)}
    recorded({f"{name} {limit}": said(lambda p=packed[name], limit=limit: len(unpacked(p, limit)))
              for name in packed for limit in (3599, 3600)}, case="packed")
    assert all(unpacked(each) == content for each in packed.values())


def test_rows_by_bands(recorded):
    picture = np.arange(11 * 2 * 3).reshape(11, 2, 3)
    asked = []

    def read(first, last):
        asked.append((first, last))
        return picture[first:last]
    rows = read_by_bands(read, 11, 4)
    for first, last in ((0, 3), (3, 5), (5, 11), (1, 2), (7, 8), (8, 11)):
        np.testing.assert_array_equal(rows(first, last), picture[first:last])
    written = []
    with written_by_bands(lambda first, pixels: written.append((first, pixels.copy())),
                          picture.shape, 4, np.dtype("i4")) as take:
        for first, last in ((0, 1), (1, 6), (6, 7), (7, 11)):
            take(first, picture[first:last])
    recorded({"asked": asked, "written": written})
    with written_by_bands(lambda first, pixels: written.append((first, pixels.shape)), (3, 2, 3), 4,
                          np.dtype("i4")) as take:
        take(0, picture[:3])
    recorded(written[-1], case="one band")


def test_free_memory(recorded, tmp_path, monkeypatch):
    (tmp_path / "info").write_text("MemTotal: 9 kB\nMemAvailable:    3000 kB\n")
    files = {}
    for name, text in (("limit", "5000000\n"), ("used", "1500000\n"), ("more", "6000000"),
                       ("max", "max\n")):
        files[name] = tmp_path / name
        files[name].write_text(text)
    found = {}
    for name, info, groups in (
            ("machine", "info", ()), ("group", "info", (("limit", "used"),)),
            ("full", "info", (("limit", "more"),)), ("none", "info", (("max", "used"),)),
            ("two", "info", (("more", "used"), ("limit", "used")))):
        monkeypatch.setattr(memory, "MEMINFO", tmp_path / info)
        monkeypatch.setattr(memory, "GROUPS", tuple((files[a], files[b]) for a, b in groups))
        found[name] = memory.free_memory()
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "nothing")
    monkeypatch.setattr(memory, "_built_in", lambda: 77)
    found["elsewhere"] = memory.free_memory()
    monkeypatch.setattr(memory, "GROUPS", ())
    monkeypatch.setattr(memory, "_built_in", lambda: None)
    recorded(found | {"unknown": memory.free_memory()})


def test_work_beside(recorded):
    with beside(lambda: {"a": 3}) as result:
        found = [result()]
    seen = []
    with loaded_beside(lambda: seen.append(1)) as loaded:
        loaded()
    with loaded_beside(lambda: __import__("no_such_module")):
        pass
    recorded([found, seen])


def test_signals_amid_an_import(monkeypatch):
    started = []

    class Timer:
        """Says when it would call what."""

        def __init__(self, after_s, call):
            started.append((after_s, callable(call)))
            self.start = lambda: started.append(self.daemon)
    monkeypatch.setattr(interruption.threading, "Timer", Timer)

    def frame(file):
        return SimpleNamespace(f_code=SimpleNamespace(co_filename=file))
    assert not interruption.put_off(2, None) and not interruption.put_off(2, frame("a.py"))
    assert not started
    assert interruption.put_off(2, frame("<frozen importlib._bootstrap>"))
    assert started == [(0.01, True), True]


def test_the_first_of_two_signals_in_a_hold_counts():
    heard = []
    before = {number: signal.signal(number, lambda number, frame: heard.append(number))
              for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        with interruption.Interruptions(held=True) as interruptions:
            interruptions._heard(signal.SIGTERM, None)
            interruptions._heard(signal.SIGINT, None)
            with interruptions.held():
                assert heard == []
            with interruptions.released():
                assert heard == [signal.SIGTERM]
            interruptions.hold()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert heard == [signal.SIGTERM]


def test_signals_soon_after_another_are_not_heard(monkeypatch):
    heard, now = [], [100.0]
    monkeypatch.setattr(interruption.time, "monotonic", lambda: now[0])
    before = signal.signal(signal.SIGTERM, lambda number, frame: heard.append(now[0]))
    try:
        with interruption.Interruptions(again_after_s=5.0) as interruptions:
            for now[0] in (100.0, 101.0, 104.9, 105.1, 106.0):
                interruptions._heard(signal.SIGTERM, None)
    finally:
        signal.signal(signal.SIGTERM, before)
    # what came in between is raised with the next that is heard, or at the end
    assert heard == [100.0, 105.1, 106.0]


@dataclasses.dataclass(frozen=True, eq=False)
class Shaped(Record):
    """Letters, a number, and what may be left out."""

    a: Annotated[np.ndarray, "N M"]
    b: Annotated[np.ndarray, "M 2"]
    c: Annotated[np.ndarray, "N"] | None = None


def test_shapes_of_records(recorded):
    shapes = (((3, 4), (4, 2), None), ((3, 4), (3, 2), None), ((3, 4), (4, 3), None),
              ((3,), (4, 2), None), ((3, 4), (4, 2), (3,)), ((3, 4), (4, 2), (4,)))

    def fits(*shapes):
        return Shaped(*(None if each is None else np.ones(each) for each in shapes)) and "fits"
    recorded({f"{each}": said(lambda each=each: fits(*each)) for each in shapes})
    ours = np.zeros((2, 2))
    kept = Shaped(ours, [[1, 2], [3, 4]])
    ours[0, 0] = 5
    assert kept.a[0, 0] == 0 and not kept.a.flags.writeable and not kept.b.flags.writeable


def test_records(recorded):
    """Fields, letters, defaults and sentences of every record that passes between stages."""
    kinds = [each for each in vars(records).values() if isinstance(each, type)]
    recorded({each.__name__: {
        "letters": array_fields(each),
        "defaults": {field.name: field.default for field in dataclasses.fields(each)
                     if field.default is not dataclasses.MISSING}}
        for each in kinds if dataclasses.is_dataclass(each)})
    recorded({each.__name__: {member.name: member.value for member in each} for each in kinds
              if issubclass(each, records.Enum) and each is not records.Enum}, case="words")
    rng = np.random.default_rng(2)
    lower, truth = rng.uniform(0, 1, (2, 3, 40))
    left_out = records.LeftOutPatches(
        records.WavelengthGrid(np.arange(40.0), np.ones(40)), truth + 0.1, lower, lower + 0.4,
        truth * 1.1, np.zeros(3, bool), np.ones(3), 0.9)
    edges = np.array([[0.0, 1.0, 2.0, 3.0]])
    recorded({"inside": left_out.inside, "rmse": left_out.rmse,
              "ends": share_inside(edges, edges, edges), "outcome": Outcome.EXACT}, case="values")


def test_pictures_as_arrays(recorded, tmp_path, monkeypatch):
    pytest.importorskip("zarr", reason="pip install spectrabox[zarr]")
    rng = np.random.default_rng(3)
    picture, nm = rng.uniform(size=(5, 7, 3)), np.array([450.0, 500.5, 610.0])
    found = {}
    for half in (True, False):
        path = tmp_path / f"{half}.zarr"
        with zarr_array.zarr_rows(path, 5, 7, nm, half, {"unit": "1"}) as take:
            take(0, picture[:2])
            take(2, picture[2:])
        opened = zarr_array.open_zarr(path)
        found[f"{half}"] = {"shape": opened.shape, "rows": opened.chunk_rows,
                            "type": str(opened.dtype), "values": opened.read(1, 4)}
    import zarr
    zarr.create_array(str(tmp_path / "plain.zarr"), data=picture, chunks=(2, 7, 3))
    found["plain"] = zarr_array.open_zarr(tmp_path / "plain.zarr").chunk_rows
    tables = {"mean": rng.uniform(size=(3, 4)), "other": rng.uniform(size=(3, 6))}
    group = tmp_path / "low.zarr"
    with zarr_array.low_rank_rows(group, 5, 7, False, tables, {"about": [1, "x"]}) as take:
        take(0, picture[..., :2])
    found["group"] = zarr_array.read_group(group, ["other", "mean"])
    found["coefficients"] = zarr_array.open_zarr(group / "coefficients").read(0, 5)
    for name, path in (("table", group / "mean"), ("group", group), ("none", tmp_path)):
        found[f"no picture {name}"] = said(lambda p=path: zarr_array.open_zarr(p).shape, tmp_path)
    found["no group"] = [said(lambda p=p: zarr_array.read_group(p, ["mean"]), tmp_path)
                         for p in (tmp_path, tmp_path / "True.zarr")]
    metadata = tmp_path / "True.zarr" / "zarr.json"
    metadata.write_text(metadata.read_text("utf-8").replace('"zstd"', '"zstd2"').replace(
        '"crc32c"', '"own"'), "utf-8")
    found["codec"] = said(lambda: zarr_array.open_zarr(tmp_path / "True.zarr").shape)
    for limit in (17, 18):
        monkeypatch.setattr(zarr_array, "MAX_TABLE", limit)
        found[f"limit {limit}"] = said(lambda: len(zarr_array.read_group(group, ["other"])))
    recorded(found)

    region_file = tmp_path / "region.zarr"
    zarr_array.create_picture(region_file, (300, 5000, 2), True, {"a": "b"}, ("y", "x", "c"))
    region = zarr_array.open_region(region_file)
    region.write(0, 0, picture[..., :2])
    region.write(250, 4990, picture[..., :2])
    synced = []
    monkeypatch.setattr(zarr_array, "sync", lambda path: synced.append(
        str(path.relative_to(region_file))))
    found = {}
    for first, last in ((0, 128), (0, 129), (128, 256), (256, 300), (130, 131)):
        region.sync(first, last)
        found[f"{first} {last}"] = sorted(synced)
        synced.clear()
    written = zarr_array.open_zarr(region_file)
    recorded({"synced": found, "rows": written.chunk_rows, "type": str(written.dtype),
              "first": written.read(0, 5)[:, :7], "last": written.read(250, 255)[:, 4988:]},
             case="regions")
