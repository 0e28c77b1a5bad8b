"""What is written goes where it was asked to go, and a usage error is answered in JSON too."""
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.radiometry.spectra.spectrum_files import read_table
from spectrabox.session.cli import app

RECORDING = Path(__file__).parents[1] / "fixtures/cr30/Test_Sample_36.61_-20.75_-2.86.spm"


def test_a_replayed_spectrum_can_be_written(tmp_path):
    said = CliRunner().invoke(app, ["meter", "replay", str(RECORDING), "--json", "--out",
                                    str(tmp_path / "sample.csv")])
    facts = json.loads(said.stdout)
    table = read_table(tmp_path / "sample.csv")
    first = facts["readings"][0]
    assert table.names[0] == "reading 1" and table.facts["quantity"] == first["quantity"]
    np.testing.assert_array_equal(table.nm, first["wavelengths_nm"])
    # a table holds six digits
    np.testing.assert_allclose(table.values[0], first["values"], rtol=1e-5)
    assert facts["file"] == str(tmp_path / "sample.csv")


@pytest.mark.parametrize("make", [
    lambda: sb.sample([0.3, 0.2, 0.1], camera="Nikon 5100 (NPL)", light="D65", noise=0.003),
    lambda: sb.camera("Nikon 5100 (NPL)")])
def test_the_folder_of_a_mistyped_path_is_not_made(tmp_path, make):
    result = make()
    with pytest.raises(sb.InputError, match="there is no folder"):
        result.to_csv(tmp_path / "mistyped" / "a.csv")
    assert not (tmp_path / "mistyped").exists()
    assert result.to_csv(tmp_path / "a.csv").is_file()


@pytest.mark.parametrize(("words", "sentence"), [
    (["flat", "--bogus", "x.dng"], "No such option: --bogus"),
    (["sample", "--seed", "-1"], "'--seed'"), (["nothing"], "No such command 'nothing'"),
    (["sample", "--out", "a.txt"], "does not end in what is written here")])
def test_a_usage_error_is_answered_in_json_too(words, sentence):
    done = subprocess.run([sys.executable, "-m", "spectrabox", *words, "--json"], check=False,
                          capture_output=True, text=True)
    answer = json.loads(done.stdout)
    assert sentence in answer["error"] and answer["exit_code"] == done.returncode == 2
    assert sentence in done.stderr


@pytest.mark.parametrize("template", ["box", "flat"])
def test_the_status_of_a_new_session_is_a_list_of_its_stages(tmp_path, template):
    call = CliRunner().invoke
    assert call(app, ["new", str(tmp_path / "mine"), "--template", template]).exit_code == 0
    answer = call(app, ["status", str(tmp_path / "mine"), "--json"])
    facts = json.loads(answer.stdout)
    assert len(facts["stages"]) >= 4
    assert {stage["state"] for stage in facts["stages"]} <= {"missing", "not needed"}
    assert answer.exit_code == facts["exit_code"] == 3 and "is missing" in facts["error"]
    said = call(app, ["status", str(tmp_path / "mine")])
    assert "calibrate    missing" in said.stdout and facts["error"] in said.stdout
