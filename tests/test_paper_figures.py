"""The scripts that remake the paper's figures, and the page that shows them."""
from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "docs" / "results"
PAGE = (RESULTS / "paper.md").read_text(encoding="utf-8")
FIGURES = range(1, 12)


@pytest.mark.parametrize("number", FIGURES)
def test_the_page_shows_every_figure_and_names_its_script(number):
    assert f"## {number}. " in PAGE
    assert f"python benchmarks/paper/figure_{number}.py" in PAGE
    assert (ROOT / "benchmarks" / "paper" / f"figure_{number}.py").is_file()


def test_pictures_of_the_page_are_there_and_small():
    pictures = re.findall(r"!\[[^]]*\]\(([^)]*)\)", PAGE)
    assert len(pictures) == 10      # none of the physical box: its photos carry no licence
    for picture in pictures:
        assert (RESULTS / picture).stat().st_size < 150_000, picture


def test_the_physical_box_says_which_data_it_lacks(monkeypatch, capsys):
    from benchmarks.paper import figure_11
    monkeypatch.setattr(sys, "argv", ["figure_11.py"])
    figure_11.main()
    assert "give the folder that holds yale_box with --data" in capsys.readouterr().out


def test_a_residual_draw_for_every_coarse_draw_holds_the_truth_more_often_than_one_lifted_solution(
        monkeypatch, capsys, tmp_path):
    from benchmarks.paper import figure_5
    monkeypatch.setattr(sys, "argv", ["figure_5.py", "--pairs", "5:9", "--draws", "40", "--json",
                                      "--out", str(tmp_path / "figure_5.png")])
    figure_5.main()
    held = {row["sampled"]: row["coverage_95"]
            for row in json.loads(capsys.readouterr().out)["rows"]}
    assert held["as published"] < held["coarse"] < held["refined"] < held["fine"]
