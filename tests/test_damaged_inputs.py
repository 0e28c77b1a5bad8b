"""Damaged and hostile files of every kind end in a result or in a sentence; nothing outside their
folder is written.
"""
import bz2
import gzip
import io
import lzma
import struct
import warnings
import zipfile

import numpy as np
import pytest

from spectrabox.capture.photo.image_files import read_linear_file
from spectrabox.capture.photo.image_writers import write_exr
from spectrabox.fixtures.mutations import mutated, rewritten
from spectrabox.radiometry.errors import InputError, SpectraboxError
from spectrabox.radiometry.system import archives
from spectrabox.radiometry.system.archives import (
    DamagedArchiveError,
    opened_npz,
    opened_zip,
    unpacked,
)
from spectrabox.session.store.record_files import load_stage, save_stage, stage_folder

from tests.damaged_inputs import subjects

COPIES = 12


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    return subjects(tmp_path_factory.mktemp("kinds") / "inputs")


def test_damaged_files_of_every_kind_end_in_a_result_or_a_sentence(kinds):
    ends = {"result": 0, "sentence": 0}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")     # of libraries, on numbers that cannot be
        for kind in kinds:
            content = kind.path.read_bytes()
            kind.read(kind.path)
            for seed in range(COPIES):
                kind.path.write_bytes(rewritten(content, seed) if kind.text and seed % 2
                                      else mutated(content, seed))
                try:
                    kind.read(kind.path)
                    ends["result"] += 1
                except SpectraboxError as error:
                    assert len(str(error)) < 5000 and "\x1b" not in str(error), kind.name
                    ends["sentence"] += 1
            kind.path.write_bytes(content)
    assert min(ends.values()) > 100


@pytest.mark.parametrize("pack", [bz2.compress, gzip.compress, lzma.compress])
def test_what_unpacks_beyond_the_limit_is_not_unpacked(pack, monkeypatch):
    content = pack(bytes(3_000_000))
    monkeypatch.setattr(archives, "MAX_UNPACKED", 3_000_000)
    assert unpacked(content) == bytes(3_000_000)
    monkeypatch.setattr(archives, "MAX_UNPACKED", 2_999_999)
    with pytest.raises(DamagedArchiveError, match="unpacks to more than"):
        unpacked(content)
    with pytest.raises(DamagedArchiveError):
        unpacked(content[:len(content) // 2])


def test_a_zip_states_its_size_before_it_is_read(tmp_path, monkeypatch):
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.csv", bytes(2_000_000))
    monkeypatch.setattr(archives, "MAX_UNPACKED", 2_000_000)
    with opened_zip(tmp_path / "a.zip") as archive:
        assert archive.namelist() == ["a.csv"]
    monkeypatch.setattr(archives, "MAX_UNPACKED", 1_999_999)
    with pytest.raises(DamagedArchiveError, match=r"unpacks to 0\.0 GB"), \
            opened_zip(tmp_path / "a.zip"):
        pass


def test_a_zip_that_lies_about_its_size_gives_no_more_than_it_stated(tmp_path, monkeypatch):
    monkeypatch.setattr(archives, "MAX_UNPACKED", 2000)
    np.savez_compressed(tmp_path / "a.npz", big=np.zeros(1_000_000))
    content = (tmp_path / "a.npz").read_bytes()
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        size = archive.infolist()[0].file_size
    # both headers state the size as 32 or 64 bits
    for form in ("<I", "<Q"):
        content = content.replace(struct.pack(form, size), struct.pack(form, 1000))
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(DamagedArchiveError), opened_npz(tmp_path / "a.npz") as arrays:
        arrays["big"]


def test_a_picture_too_large_to_hold_is_refused_before_memory_is_asked_for(tmp_path, monkeypatch):
    write_exr(tmp_path / "a.exr", np.full((20, 30, 3), 0.5), ("R", "G", "B"))
    monkeypatch.setenv("SPECTRABOX_PHOTO_GB", "1e-6")
    with pytest.raises(InputError, match="states 30 x 20 pixels of 3 channels"):
        read_linear_file(tmp_path / "a.exr")


@pytest.mark.parametrize("before, after", [('"seconds"', '"second"'), ("1.0", '"1"')])
def test_stored_facts_whose_time_is_damaged_are_damaged(tmp_path, before, after):
    with stage_folder(tmp_path, "photo") as new:
        save_stage(new, {"settings": {"v": 1}}, {}, 1.0, {})
    facts = tmp_path / "photo" / "facts.json"
    text = facts.read_text()
    assert before in text
    facts.write_text(text.replace(before, after))
    stage = load_stage(tmp_path, "photo")
    assert stage.damage == "facts.json" and stage.seconds == 0.0
