"""Whole sessions against their records: photos in, spectra out, through the commands alone.

Each record in ``tests/whole_sessions/`` is a table in physical units: colours, errors and widths in
per cent of white. ``pytest tests/test_whole_sessions.py --record`` writes them again; read the
difference before it is committed. ``session_tables.CLOSE`` says how far a number may be from its
record, and why.
"""
import json
from pathlib import Path

import numpy as np
import pytest
from flat_example import HEAD, regions_toml, write_flat
from session_box import write_box
from session_flat_samples import write_flat_samples, write_unknown_lamps
from session_scene import write_scene
from session_tables import (
    NONE,
    PER_CENT,
    as_text,
    differences,
    from_text,
    lab,
    likeliest,
    table_of,
)
from session_without_chart import write_transport_session, write_two_lamps
from typer.testing import CliRunner

from spectrabox.fixtures.demos.flat_demo import PHOTO_SIZE, write_flat_demo
from spectrabox.session.cli import with_only
from spectrabox.session.config.session_file import read_session

RECORDS = Path(__file__).parent / "whole_sessions"
PAINTING = tuple(side // 2 for side in PHOTO_SIZE)
SESSIONS = {
    "flat samples": write_flat_samples,
    "lamps that nobody measured": write_unknown_lamps,
    "demo of a painting": lambda folder: write_flat_demo(folder, 1, size=PAINTING) or folder,
    "box measured with a tape": write_box,
    "scene with several photos": write_scene,
    "scene picture without a chart": write_transport_session,
    "processed photo under two lamps": write_two_lamps,
}


@pytest.fixture
def hold(request):
    """Hold blocks of a table to their record, or record them with ``--record``."""
    def to_record(name, blocks):
        path = RECORDS / f"{name.replace(' ', '-')}.txt"
        if request.config.getoption("--record"):
            path.write_text(f"# {name}\n{as_text(blocks)}", encoding="utf-8")
        beyond = differences(blocks, from_text(path.read_text(encoding="utf-8")))
        assert not beyond, "\n".join(beyond)
    return to_record


def answer_of(*words):
    """What a command answers with ``--json``."""
    result = CliRunner().invoke(with_only(words[0]), [*map(str, words), "--json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.mark.usefixtures("no_advice")
@pytest.mark.parametrize("name", SESSIONS)
def test_a_session(name, hold, tmp_path):
    folder = SESSIONS[name](tmp_path / "session")
    hold(name, table_of(folder, answer_of("run", folder)))
    config = read_session(folder)
    page = (folder / "report.html").read_text(encoding="utf-8")
    for view in config.all_views[1:]:
        assert f"Photo “{view.name}”" in page
        assert config.regions or (folder / f"comparison {view.name}.exr").is_file()


def test_the_demo(finished, hold):
    """Its stages are those that every test has a copy of."""
    hold("demo", table_of(finished, answer_of("run", finished)))


def test_a_batch_with_a_known_white_card(hold, tmp_path):
    """Two sessions of one photo; the second has other regions, and the first's calibration."""
    folders, blocks = [tmp_path / "card", tmp_path / "no-card"], {}
    for folder, known in zip(folders, (("white_wall",), ()), strict=True):
        folder.mkdir()
        write_flat(folder)
        (folder / "session.toml").write_text(HEAD + regions_toml(known=known), encoding="utf-8")
    answer = answer_of("batch", *folders, "--workers", 1, "--out", tmp_path / "batch")
    blocks["batch"] = (["state", "verdict", "exit code"], [
        [folder.name, each["state"], each["verdict"], each["exit_code"]]
        for folder, each in zip(folders, answer["sessions"], strict=True)])
    for folder in folders:
        kept = answer_of("run", folder)
        assert {stage["state"] for stage in kept["stages"]} == {"kept"}
        blocks |= {f"{folder.name} {block}": table
                   for block, table in table_of(folder, kept).items()}
    hold("batch with a known white card", blocks)


@pytest.mark.parametrize("method", ["prior", "uniform", "paper"])
def test_a_signal(method, hold):
    """Published curves and a signal that somebody typed."""
    found = answer_of("sample", "--sensitivity", "Nikon 5100 (NPL)", "--light", "D65", "--signal",
                      "0.53,0.24,0.08", "--noise", "0.003,0.003,0.003", "--samples", 2000,
                      "--seed", 1, "--method", method)
    nm = np.array(found["wavelengths_nm"])
    width, bounds = (PER_CENT * np.mean(np.subtract(found[high], found[low])) for low, high in (
        ("lower", "upper"), ("bound_lower", "bound_upper")))
    columns = ["L*", "a*", "b*", "band", "bounds", "family", "share"]
    hold(f"signal by {method}", {"spectra": (columns, [
        [method, *lab(nm[::5], np.array(found["mean"])[::5]), width, bounds,
         *likeliest(found.get("certified", []))]])})


@pytest.mark.parametrize("name", [path.stem for path in RECORDS.glob("*.txt")])
def test_slips_show(name):
    """1 % of the light of a surface, a band of 90 % in place of one of 95 %, 3 % of the bounds."""
    recorded = from_text((RECORDS / f"{name}.txt").read_text(encoding="utf-8"))
    for block, (columns, rows) in recorded.items():
        slips = {"band": 0.84, "bounds": 0.96}
        if block.endswith("signals"):
            slips = dict.fromkeys(columns, 1.01)
        for column, factor in slips.items():
            if column in columns:
                at = columns.index(column) + 1
                kept = [row for row in rows if row[at] != NONE]
                slipped = [[*row[:at], row[at] * factor, *row[at + 1:]] for row in kept]
                beyond = differences({block: (columns, slipped)}, {block: (columns, kept)})
                assert len(beyond) == len(kept), beyond
