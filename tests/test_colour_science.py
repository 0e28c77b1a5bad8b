import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def run(code):
    return subprocess.run([sys.executable, "-W", "ignore", "-c", code], cwd=ROOT,
                          capture_output=True, text=True, check=False)


def test_colour_science_comes_without_matplotlib_until_somebody_plots():
    outcome = run("import sys; from radiometry.colour_science import colour_science; c = "
                  "colour_science(); assert 'matplotlib.pyplot' not in sys.modules; assert "
                  "len(c.SDS_COLOURCHECKERS['BabelColor Average']) == 24; import colour; assert "
                  "callable(colour.plotting.plot_single_sd); import colour.plotting; from "
                  "colour.plotting import plot_multi_sds; assert colour.plotting.__name__ == "
                  "'colour.plotting' and colour.plotting.__file__")
    assert outcome.returncode == 0, outcome.stderr


def test_a_colour_science_that_is_there_already_is_left_alone():
    outcome = run("import colour; before = colour.plotting; from radiometry.colour_science import "
                  "colour_science; assert colour_science() is colour and colour.plotting is before")
    assert outcome.returncode == 0, outcome.stderr
