"""A file is written as its ending says, and under no ending that says otherwise."""
import json

import pytest
from typer.testing import CliRunner

from spectrabox.session.cli import app

SIGNAL = ["--sensitivity", "Nikon 5100 (NPL)", "--light", "D65", "--signal", "0.3,0.3,0.2"]
REFUSED = {
    "develop": (["develop", "a.dng", "--out", "a.tif"], ".exr (the signal in floating point)"),
    "camera fit": (["camera", "fit", "--patches", "a.csv", "--light", "A", "--out", "a.xls"],
                   ".csv (the curves"),
    "draws of curves": (["camera", "fit", "--patches", "a.csv", "--light", "A", "--draws-file",
                         "b.csv"], ".npz (draws of the curves)"),
    "camera prior": (["camera", "prior", ".", "--out", "a.json"], ".npz (a prior on curves)"),
    "sample": (["sample", *SIGNAL, "--out", "a.txt"], ".npz (the draws), .csv (means"),
    "uplift": (["uplift", "a.exr", *SIGNAL[:4], "--out", "b.exr"], "a folder is needed"),
    "spectrum convert": (["spectrum", "convert", "a.csv", "--out", "a.txt"],
                         ".csv (CSV), .sp (Argyll's CGATS), .spdx (IES TM-27)"),
    "several spectra": (["spectrum", "convert", "a.csv", "b.csv", "--out", "c", "--to", ".mat"],
                        ".sli (ENVI library), .exr (spectral EXR)"),
    "relight": (["relight", ".", "--out", "a.exr"], ".png (a picture;"),
    "board": (["geometry", "board", "--board", "b.toml", "--out", "b.pdf"], ".png (a picture"),
    "lens": (["geometry", "lens", "a.png", "--board", "b.toml", "--out", "l.toml"],
             ".json (the lens)"),
    "pose": (["geometry", "pose", "a.png", "--scene", "s.xml", "--out", "t.exr"],
             ".xml (the scene"),
    "meter replay": (["meter", "replay", "a.txt", "--plot", "a.svg"], ".png (a picture"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_no_command_writes_under_an_ending_that_says_otherwise(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words, expected = REFUSED[case]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2, result.output
    said = " ".join(result.output.replace("│", " ").split())
    assert expected in said
    assert list(tmp_path.iterdir()) == []       # and says so before it looks for its inputs


def test_what_an_ending_says_is_in_the_answer_for_scripts(tmp_path):
    out = tmp_path / "a.npz"
    result = CliRunner().invoke(app, ["sample", *SIGNAL, "--samples", "1000", "--noise",
                                      "0.01,0.01,0.01", "--out", str(out), "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout) and out.read_bytes().startswith(b"PK")
