"""Spectra as other people's programs and meters write them: colour-science's own sample files."""
from pathlib import Path

import colour
import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.fixtures.mutations import mutated
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectrum_files import read_spectrum, read_table
from spectrabox.session.cli import app

OTHERS = Path(colour.__file__).parent / "io" / "tests" / "resources"
SEKONIC, UPRTEK = OTHERS / "RANDOM_001_02._3262K.csv", OTHERS / "ESPD2021_0104_231446.xls"


@pytest.mark.parametrize("path, lux", [(SEKONIC, 30.1), (UPRTEK, 695.154907)])
def test_a_meters_spectrum_has_the_illuminance_that_the_file_states(path, lux):
    spectrum = read_spectrum(path, role=Quantity.RELATIVE)
    assert spectrum.quantity is Quantity.IRRADIANCE
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    efficiency = np.interp(spectrum.grid.nm, observer.wavelengths, observer.values[:, 1])
    # K m is 683.002 lm/W; Sekonic prints three digits
    assert 683 * (efficiency * spectrum.values).sum() == pytest.approx(lux, rel=1e-3)


@pytest.mark.parametrize("path", [SEKONIC, UPRTEK])
def test_a_damaged_meter_file_gives_a_sentence_or_a_table(tmp_path, path):
    content, sentences = path.read_bytes(), 0
    for seed in range(60):
        (tmp_path / path.name).write_bytes(mutated(content, seed))
        try:
            table = read_table(tmp_path / path.name)
        except InputError as error:
            assert "\n" not in str(error)
            sentences += 1
            continue
        assert np.all(np.diff(table.nm) > 0) and table.values.shape == (len(table.names),
                                                                        table.nm.size)
    assert sentences < 60


def test_xrite_tables_have_the_numbers_that_colour_science_reads():
    path = OTHERS / "X-Rite_Digital_Colour_Checker.txt"
    table = read_table(path)
    theirs = colour.read_sds_from_xrite_file(str(path))
    assert table.names == tuple(theirs)
    np.testing.assert_array_equal(table.values, [each.values for each in theirs.values()])
    np.testing.assert_array_equal(table.nm, next(iter(theirs.values())).wavelengths)


def test_wavelengths_across_the_header_are_the_same_table():
    across = read_table(OTHERS / "colorchecker_n_ohta_transposed.csv")
    down = read_table(OTHERS / "colorchecker_n_ohta.csv")
    assert across.names == down.names
    np.testing.assert_array_equal(across.nm, down.nm)
    np.testing.assert_array_equal(across.values, down.values)


@pytest.mark.parametrize("header", ["id;name;R_400;R_410;R_420;R_430;R_440",
                                    "no;sample;400nm;410nm;420nm;430nm;440nm",
                                    "number;patch;400;410;420;430;440"])
def test_rows_are_named_by_their_first_word(tmp_path, header):
    (tmp_path / "a.csv").write_text(f"{header}\n1;red;0,1;0,2;0,3;0,4;0,5\n"
                                    "2;blue;0,5;0,4;0,3;0,2;0,1\n", encoding="utf-8")
    table = read_table(tmp_path / "a.csv")
    assert table.names == ("red", "blue")
    np.testing.assert_array_equal(table.nm, [400, 410, 420, 430, 440])
    np.testing.assert_array_equal(table.values, [[0.1, 0.2, 0.3, 0.4, 0.5],
                                                 [0.5, 0.4, 0.3, 0.2, 0.1]])


def test_columns_that_are_named_by_numbers_stay_columns(tmp_path):
    (tmp_path / "a.csv").write_text("nm,400,401,402,403,404\n400,1,2,3,4,5\n410,2,3,4,5,6\n",
                                    encoding="utf-8")
    assert read_table(tmp_path / "a.csv").names == ("400", "401", "402", "403", "404")


WRONG = {"sample": ["sample", "--sensitivity", "Nikon 5100 (NPL)", "--signal", "0.3,0.3,0.2",
                    "--noise", "0.01,0.01,0.01", "--light", "{red}"],
         "camera fit": ["camera", "fit", "--chart", "{photo}", "--light", "{red}"],
         "advise": ["advise", "--sensitivity", "Nikon 5100 (NPL)", "--signal", "0.3,0.3,0.2",
                    "--light", "{red}"]}


@pytest.mark.parametrize("command", WRONG)
def test_a_reflectance_is_no_light(captured, command):
    names = {"red": captured / "spectra" / "truth_red.csv",
             "photo": captured / "photos" / "chart.dng"}
    result = CliRunner().invoke(app, [word.format(**names) for word in WRONG[command]])
    assert result.exit_code == 3
    assert "truth_red.csv holds reflectance; relative is needed here" in result.stderr


def test_a_session_whose_light_is_a_reflectance_is_not_ready(captured):
    text = (captured / "session.toml").read_text(encoding="utf-8")
    assert "spectra/light.csv" in text
    (captured / "session.toml").write_text(text.replace("spectra/light.csv",
                                                        "spectra/truth_red.csv"), encoding="utf-8")
    result = CliRunner().invoke(app, ["check", str(captured)])
    assert result.exit_code != 0 and "truth_red.csv holds reflectance" in result.output
