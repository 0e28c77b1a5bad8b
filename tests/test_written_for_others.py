"""Files of spectra that other programs read with our numbers, and the table of formats that says
which test shows it.
"""
import ast
import re
from pathlib import Path

import colour
import numpy as np
import pytest
from spectral.io import envi

from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats.envi import envi_files
from spectrabox.radiometry.spectra.formats.tm27 import spdx_text
from spectrabox.radiometry.spectra.spectrum_files import read_table

OTHERS = Path(colour.__file__).parent / "io" / "tests" / "resources"
ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "reference" / "spectral-files.md"
NM, VALUES = np.arange(380, 781, 5.0), np.linspace(0.05, 0.9, 81)
TEST = re.compile(r"`(test_\w+\.py)::(test_\w+)`")


def test_colour_science_reads_our_tm27(tmp_path):
    (tmp_path / "a.spdx").write_text(spdx_text(NM, {"a": VALUES}, quantity=Quantity.REFLECTANCE,
                                               source="x"), encoding="utf-8")
    spectrum = colour.SpectralDistribution_IESTM2714(str(tmp_path / "a.spdx")).read()
    np.testing.assert_allclose(spectrum.wavelengths, NM)
    np.testing.assert_allclose(spectrum.values, VALUES, rtol=1e-8)      # nine significant digits


def test_we_read_the_tm27_of_colour_science():
    path = OTHERS / "Fluorescent.spdx"
    theirs = colour.SpectralDistribution_IESTM2714(str(path)).read()
    table = read_table(path)
    np.testing.assert_array_equal(table.nm, theirs.wavelengths)
    np.testing.assert_array_equal(table.values[0], theirs.values)


def test_spy_reads_our_spectral_library(tmp_path):
    header, values = envi_files(NM, {"red": VALUES, "blue": VALUES[::-1]},
                                quantity=Quantity.REFLECTANCE, source="x")
    (tmp_path / "a.hdr").write_text(header, encoding="utf-8")
    (tmp_path / "a.sli").write_bytes(values)
    library = envi.open(str(tmp_path / "a.hdr"), str(tmp_path / "a.sli"))
    assert library.names == ["red", "blue"]
    np.testing.assert_array_equal(library.bands.centers, NM)
    np.testing.assert_allclose(library.spectra, [VALUES, VALUES[::-1]], rtol=2.0**-23)


def table_rows():
    text = PAGE.read_text(encoding="utf-8").split("## Who reads whose files")[1].split("\n## ")[0]
    return [row for row in text.splitlines() if row.startswith("| ") and "---" not in row][1:]


@pytest.mark.parametrize("row", table_rows(), ids=lambda row: row.split("|")[1].strip())
def test_every_row_of_the_table_of_formats_names_tests_that_exist(row):
    format_, others, ours, tests = [cell.strip() for cell in row.strip("|").split("|")]
    named = TEST.findall(tests)
    claimed = [cell for cell in (others, ours) if cell and not cell.startswith("not ")]
    assert format_ and (named or not claimed)
    for file, name in named:
        tree = ast.parse((ROOT / "tests" / file).read_text(encoding="utf-8"))
        assert name in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
