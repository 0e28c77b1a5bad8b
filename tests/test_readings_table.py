"""Tables of spectra that other programs read, and draws in files."""
import csv
import json
import sys

import colour
import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.radiometry.appearance import tristimulus
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats.delimited import metadata_path, metadata_text, plain_text
from spectrabox.radiometry.spectra.spectrum_files import read_table
from spectrabox.session.cli import app
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import load_finished

NM = np.arange(400, 701, 2.5)
NAMES = ["wall, left mean", 'door "A" upper', "tile #3; glossy", "=SUM(A1) mean", "Täfelung µ"]
DIGITS = 1e-8       # nine significant digits: half of the last


@pytest.fixture
def table(tmp_path):
    """A plain table with names that a careless writer would break it by, and its columns."""
    rng = np.random.default_rng(5)
    columns = {name: rng.uniform(1e-6, 1, NM.size) for name in NAMES}
    path = tmp_path / "spectra.csv"
    path.write_text(plain_text(NM, columns), encoding="utf-8")
    metadata_path(path).write_text(metadata_text(
        path.name, columns, quantity=Quantity.REFLECTANCE, source="a box\nof mine"),
        encoding="utf-8")
    return path, list(columns.values())


def test_colour_science_reads_every_column(table):
    path, columns = table
    spectra = colour.read_sds_from_csv_file(str(path))
    assert len(spectra) == len(NAMES)
    for spectrum, values in zip(spectra.values(), columns, strict=True):
        np.testing.assert_array_equal(spectrum.wavelengths, NM)
        np.testing.assert_allclose(spectrum.values, values, rtol=DIGITS)


def test_pandas_reads_every_column_as_numbers(table):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    path, columns = table
    frame = pandas.read_csv(path, index_col="wavelength_nm")
    np.testing.assert_allclose(frame.to_numpy(), np.transpose(columns), rtol=DIGITS)
    assert all(kind.kind == "f" for kind in frame.dtypes)


def test_a_spreadsheet_finds_one_header_row_and_nothing_but_numbers(table):
    path, _ = table
    text = path.read_text(encoding="utf-8")
    rows = list(csv.reader(text.splitlines(), csv.Sniffer().sniff(text[:3000], ",;\t")))
    assert {len(row) for row in rows} == {len(NAMES) + 1}
    assert all(np.isfinite([float(cell) for cell in row]).all() for row in rows[1:])
    assert not any(cell.startswith("=") for cell in rows[0])       # no formula


def test_what_the_table_states_lies_beside_it(table):
    path, columns = table
    read = read_table(path)
    assert (read.facts["quantity"], read.facts["unit"], read.facts["source"]) == (
        "reflectance", "1", "a box of mine")
    np.testing.assert_allclose(read.values, columns, rtol=DIGITS)
    stated = json.loads(metadata_path(path).read_text(encoding="utf-8"))
    assert [each["dc:title"] for each in stated["tableSchema"]["columns"][1:]] == NAMES
    metadata_path(path).unlink()
    assert "quantity" not in read_table(path).facts


@pytest.mark.parametrize("damaged", ["", "{", "[]", '{"tableSchema": 3}', "[" * 100_000,
                                     '{"tableSchema": {"columns": [{}]}}', '\udcff'])
def test_damaged_metadata_leave_the_table_without_a_quantity(table, damaged):
    path, _ = table
    metadata_path(path).write_bytes(damaged.encode("utf-8", "surrogateescape"))
    assert "quantity" not in read_table(path).facts


def test_the_spectra_of_a_session_are_read_by_colour_science(finished):
    assert CliRunner().invoke(app, ["report", str(finished)]).exit_code == 0
    spectra = colour.read_sds_from_csv_file(str(finished / "spectra.csv"))
    summary = load_finished(read_session(finished)).records.spectra["green"]
    for title, values in (("green mean", summary.mean), ("green bound upper", summary.bound_upper)):
        np.testing.assert_allclose(spectra[title].values, values, rtol=DIGITS)
    assert read_table(finished / "spectra.csv").facts["quantity"] == "reflectance"


def test_colours_of_materials_are_those_of_colour_science(finished):
    assert CliRunner().invoke(app, ["report", str(finished)]).exit_code == 0
    with (finished / "materials.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["material"]: row for row in csv.DictReader(file)}
    samples = load_finished(read_session(finished)).records.spectra["green"].samples
    xyz = np.array([tristimulus(samples.grid.nm, each) for each in samples.spectra])
    green = rows["green"]
    written = [float(green[name]) for name in "XYZ"]
    np.testing.assert_allclose(written, xyz.mean(axis=0), atol=1e-6)        # six decimals
    np.testing.assert_allclose([float(green[f"standard deviation {name}"]) for name in "XYZ"],
                               xyz.std(axis=0, ddof=1), atol=1e-6)
    white = tristimulus(samples.grid.nm, np.ones(samples.grid.nm.size))
    expected = colour.XYZ_to_RGB(xyz.mean(axis=0), colour.RGB_COLOURSPACES["ACEScg"],
                                 colour.XYZ_to_xy(white), "Bradford")
    # the published matrices and whites have five digits
    np.testing.assert_allclose([float(green[f"ACEScg {name}"]) for name in "RGB"], expected,
                               atol=2e-4)


def draws_of(folder, ending, *more):
    out = folder / f"draws{ending}"
    result = CliRunner().invoke(app, ["draws", str(folder), "--out", str(out), "--json",
                                      "--step", "50", *more])
    assert result.exit_code == 0, result.output
    return out, json.loads(result.stdout)


def expected(folder, surface):
    samples = load_finished(read_session(folder)).records.spectra[surface].samples
    return samples.spectra[:7, np.isin(samples.grid.nm, np.arange(400, 701, 50))]


def test_draws_go_into_arrays(finished):
    out, facts = draws_of(finished, ".npz")
    with np.load(out) as file:
        index = file["surfaces"].tolist().index("green")
        np.testing.assert_array_equal(file["wavelengths_nm"], np.arange(400, 701, 50))
        np.testing.assert_allclose(file[f"draws_{index}"][:7], expected(finished, "green"),
                                   rtol=2.0**-24)
        assert facts["draws"] == {name: len(file[f"draws_{number}"])
                                  for number, name in enumerate(file["surfaces"].tolist())}


def test_draws_go_into_a_long_table(finished):
    out, _ = draws_of(finished, ".csv", "--samples", "7")
    with out.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["surface"] == "green"]
    found = np.array([float(row["reflectance"]) for row in rows]).reshape(7, 7)
    np.testing.assert_allclose(found, expected(finished, "green"), rtol=1e-6)
    assert [row["draw"] for row in rows[::7]] == list("0123456")
    assert [row["wavelength_nm"] for row in rows[:7]] == [str(nm) for nm in range(400, 701, 50)]


def test_draws_go_into_a_parquet_table(finished):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    out, _ = draws_of(finished, ".parquet", "--samples", "7")
    columns = parquet.read_table(out).to_pydict()
    found = np.array([value for name, value in zip(columns["surface"], columns["reflectance"],
                                                   strict=True) if name == "green"])
    np.testing.assert_allclose(found.reshape(7, 7), expected(finished, "green"), rtol=2.0**-24)


def test_without_pyarrow_a_parquet_table_is_refused_with_what_to_do(finished, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    result = CliRunner().invoke(app, ["draws", str(finished), "--out", str(finished / "a.parquet")])
    assert result.exit_code == 7 and "pip install pyarrow" in result.stderr
    assert not (finished / "a.parquet").exists()
