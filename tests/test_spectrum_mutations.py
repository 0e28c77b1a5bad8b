"""Damaged files of every format end in a sentence or in a well-formed table, never in anything
else.
"""
import warnings

import numpy as np
import pytest

from spectrabox.fixtures.mutations import mutated
from spectrabox.fixtures.spectral_files import write_examples
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.spectrum_files import read_table

COPIES = 350                # of each format


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    return write_examples(tmp_path_factory.mktemp("examples"))


@pytest.mark.parametrize("name",
                         ["CSV", "ASD", "CGATS", "TM-27", "ENVI", "ENVI header",
                          "rawtoaces", "spectral EXR",
                          "JCAMP-DX", "CxF"])
def test_a_damaged_file_gives_a_sentence_or_a_well_formed_table(examples, name, tmp_path):
    path = examples["ENVI"].with_suffix(".hdr") if name == "ENVI header" else examples[name]
    target = tmp_path / path.name
    for other in (".hdr", ".sli"):
        if name.startswith("ENVI"):
            (tmp_path / f"example{other}").write_bytes(
                examples["ENVI"].with_suffix(other).read_bytes())
    content = path.read_bytes()
    sentences = 0
    for seed in range(COPIES):
        target.write_bytes(mutated(content, seed))
        try:
            table = read_table(target)
        except InputError as error:
            assert str(error) and "\n" not in str(error)
            sentences += 1
            continue
        assert table.values.shape == (len(table.names),
                                      table.nm.size) and np.all(np.diff(table.nm) > 0)
        assert not np.any(np.isinf(table.values))
    assert 0 < sentences < COPIES


def test_every_example_is_read_without_a_warning(examples):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for path in examples.values():
            read_table(path)
