"""spectrum show and spectrum convert, as scripts see them."""
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.fixtures.spectral_files import NM, REFLECTANCE, asd_bytes, write_examples
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.spectrum_files import read_spectrum
from spectrabox.session.cli import app


def run(*arguments):
    return CliRunner().invoke(app, ["spectrum", *map(str, arguments)])


def test_show_gives_the_keys_that_scripts_rely_on(tmp_path):
    for name, path in write_examples(tmp_path).items():
        result = run("show", path, "--json")
        facts = json.loads(result.stdout)
        assert result.exit_code == 0 and facts["format"] == name
        assert {"wavelengths_nm", "quantity", "unit", "source", "spectra"} <= set(facts)
        assert facts["quantity"] == "reflectance" and facts["unit"] == "1"
        column = facts.get("values") or facts["spectra"][0]["values"]
        # the least exact format
        np.testing.assert_allclose(column, REFLECTANCE, rtol=1e-7)


def test_show_says_what_is_not_stated(tmp_path):
    (tmp_path / "loose.csv").write_text("nm,v\n400,0.5\n500,\n600,0.7\n")
    result = run("show", tmp_path / "loose.csv")
    assert "quantity not stated, unit not stated" in result.stdout
    assert "no number at 1 of 3" in result.stdout
    facts = json.loads(run("show", tmp_path / "loose.csv", "--json").stdout)
    assert facts["quantity"] is None and facts["unit"] is None and facts["values"] == [
        0.5, None, 0.7]


@pytest.mark.parametrize("suffix", [".csv", ".sp", ".spdx", ".sli"])
def test_convert_from_every_format_to_every_written_one(tmp_path, suffix):
    for path in write_examples(tmp_path).values():
        out = tmp_path / f"out{suffix}"
        result = run("convert", path, "-o", out, "--quantity", "reflectance")
        assert result.exit_code == 0, result.stdout + result.stderr
        found = read_spectrum(out, role=Quantity.REFLECTANCE)
        np.testing.assert_allclose(found.values, REFLECTANCE, rtol=1e-7)
        np.testing.assert_allclose(found.grid.nm, NM, rtol=1e-8)


def test_convert_resamples_and_says_how(tmp_path):
    path = write_examples(tmp_path)["ASD"]
    result = run("convert", path, "-o", tmp_path / "o.csv", "--grid", "400:700:5", "--json")
    assert "Sprague" in json.loads(result.stdout)["written"][0]["notes"][0]
    assert read_spectrum(tmp_path / "o.csv", role=Quantity.REFLECTANCE).grid.nm.size == 61


def test_convert_never_guesses_a_quantity(tmp_path):
    (tmp_path / "loose.csv").write_text("nm,v\n400,0.5\n500,0.6\n")
    result = run("convert", tmp_path / "loose.csv", "-o", tmp_path / "o.spdx", "--json")
    assert result.exit_code == 3 and "say it with --quantity" in json.loads(result.stdout)["error"]
    assert run("convert", tmp_path / "loose.csv", "-o", tmp_path / "o.spdx", "--quantity",
               "radiance").exit_code == 0
    assert read_spectrum(tmp_path / "o.spdx", role=Quantity.RELATIVE).quantity is Quantity.RADIANCE
    (tmp_path / "raw.asd").write_bytes(asd_bytes(kind=0))
    result = run("convert", tmp_path / "raw.asd", "-o", tmp_path / "o.csv", "--json")
    assert result.exit_code == 3 and "holds raw" in json.loads(result.stdout)["error"]


def test_several_files_go_into_a_folder(tmp_path):
    paths = [path for name, path in write_examples(tmp_path).items() if name in ("ASD", "TM-27")]
    for index, path in enumerate(paths):
        path.rename(tmp_path / f"{index}{path.suffix}")
    result = run("convert", tmp_path / "0.asd", tmp_path / "1.spdx", "-o", tmp_path / "out", "--to",
                 ".sp")
    assert result.exit_code == 0 and sorted(path.name
                                            for path in (tmp_path / "out").iterdir()) == [
        "0.sp", "1.sp"]


@pytest.mark.parametrize("options, code, message", [
                             (("--grid", "400:701:5"), 2, "does not divide"),
                             (("--grid", "x"), 2, "FIRST:LAST:STEP"),
                             (("--grid", "300:700:5"), 3, "covers 380-780 nm"),
                             (("--column", "nothing"), 3, "no column named 'nothing'"),
                             (("--quantity", "mood"), 2, "is not one of"),
                             (("--quantity", "radiance"), 3, "cannot be written as radiance")])
def test_bad_options_get_one_sentence(tmp_path, options, code, message):
    path = write_examples(tmp_path)["ASD"]
    result = run("convert", path, "-o", tmp_path / "o.csv", *options)
    assert result.exit_code == code and message in " ".join(result.stderr.replace("│", "").split())


AXES = {"nm": lambda nm: nm, "um": lambda nm: nm / 1e3, "Angstrom": lambda nm: 10 * nm,
        "1/cm": lambda nm: 1e7 / nm, "THz": lambda nm: 299_792.458 / nm,
        "eV": lambda nm: 1239.841984 / nm}


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("unit, scale", [("percent", 100), ("fraction", 1), ("%", 100)])
@pytest.mark.parametrize("header", ["x,y", "wavelength [furlong],reflectance [foo mol]"])
def test_what_a_file_does_not_state_is_said_by_options(tmp_path, axis, unit, scale, header):
    (tmp_path / "bare.csv").write_text(header + "\n" + "".join(
        f"{AXES[axis](nm):.9g},{scale * value:.9g}\n" for nm, value in zip(
            NM, REFLECTANCE, strict=True)))
    said = ("--unit", axis, "--unit", unit)
    result = run("convert", tmp_path / "bare.csv", "-o", tmp_path / "o.csv", "--quantity",
                 "reflectance", *said)
    assert result.exit_code == 0, result.output
    found = read_spectrum(tmp_path / "o.csv", role=Quantity.REFLECTANCE)
    np.testing.assert_allclose(found.grid.nm, NM, rtol=1e-8)       # nine digits are written
    np.testing.assert_allclose(found.values, REFLECTANCE, rtol=1e-8)
    without = run("convert", tmp_path / "bare.csv", "-o", tmp_path / "p.csv", "--quantity",
                  "reflectance")
    if header == "x,y" and axis in ("nm", "THz") and scale == 1:
        assert without.exit_code == 0       # numbers of light in THz are those of nm
    else:
        assert without.exit_code == 3 and "--unit" in without.output


def test_a_stated_unit_is_not_overruled(tmp_path):
    (tmp_path / "a.csv").write_text("wavelength (nm),r (%)\n400,50\n500,60\n")
    for unit, code in (("um", 3), ("fraction", 3), ("nm", 0), ("percent", 0), ("parsec", 3)):
        result = run("convert", tmp_path / "a.csv", "-o", tmp_path / f"{unit}.csv", "--quantity",
                     "reflectance", "--unit", unit)
        assert result.exit_code == code, result.output
        assert (tmp_path / f"{unit}.csv").exists() == (code == 0)
    [asd] = [path for path in write_examples(tmp_path).values() if path.suffix == ".asd"]
    assert run("convert", asd, "-o", tmp_path / "o.csv", "--unit", "um").exit_code == 3
