"""Columns of signals are those of the bands whose names they bear."""
import json
from itertools import permutations

import numpy as np
import pytest
from typer.testing import CliRunner

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.cameras import columns_of_bands
from spectrabox.session.cli import app
from spectrabox.session.signals.signal_options import read_named_signals

SIGNAL = {"R": 0.4, "G": 0.2, "B": 0.05}


@pytest.mark.parametrize("order", list(permutations("RGB")))
@pytest.mark.parametrize("written", [str, str.lower, lambda band: {
    "R": "Red", "G": "green", "B": "BLUE"}[band]])
@pytest.mark.parametrize("separator", [",", ";"])
def test_a_signal_is_the_same_in_any_order_of_its_columns(tmp_path, order, written, separator):
    path = tmp_path / "signals.csv"
    head, row = [written(band) for band in order], [f"{SIGNAL[band]:g}" for band in order]
    path.write_text(f"{separator.join(head)}\n{separator.join(row)}\n")
    np.testing.assert_array_equal(*read_named_signals(path, "RGB").values(), [0.4, 0.2, 0.05])
    path.write_text(f"name,{separator.join(head)}\nwall,{separator.join(row)}\n")
    assert read_named_signals(path, "RGB")["wall"].tolist() == [0.4, 0.2, 0.05]


def test_columns_of_other_names_stand_in_the_order_of_the_bands():
    assert columns_of_bands(["first", "second", "third"], "RGB", "s") == [0, 1, 2]
    assert columns_of_bands("BGR", ["", "", ""], "s") == [0, 1, 2]      # of curves as arrays
    assert columns_of_bands(["band 2", "Band 1"], ["band 1", "band 2"], "s") == [1, 0]


@pytest.mark.parametrize(("header", "bands"), [("RGX", "RGB"), ("RRG", "RGB"), ("XYZ", "RGB"),
                                               ("BGR", "XYZ"), ("NRGB", "RGB")])
def test_columns_that_are_not_the_camera_s_bands_are_refused(header, bands):
    with pytest.raises(InputError, match=f"named {', '.join(header)}, and the camera's bands are "
                                         f"{', '.join(bands)}: name each column"):
        columns_of_bands(header, bands, "signals.csv")


def test_the_command_answers_for_the_signal_that_is_named(tmp_path):
    path = tmp_path / "signals.csv"
    path.write_text("B,G,R\n0.05,0.2,0.4\n")
    camera = ["sample", "--sensitivity", "Nikon 5100 (NPL)", "--light", "D65", "--json"]
    many = CliRunner().invoke(app, [*camera, "--signals", str(path)])
    path.write_text("R,G,B\n0.4,0.2,0.05\n")
    plain = CliRunner().invoke(app, [*camera, "--signals", str(path)])
    assert json.loads(many.stdout)["results"][0]["mean"] \
        == json.loads(plain.stdout)["results"][0]["mean"]
