"""An edit of the code makes stale what the rooms of a stage say depends on it."""
import shutil

import pytest

from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import stage_states
from spectrabox.session.store import keys

STAGES = {"chart", "photo", "calibrate", "reconstruct", "sample"}


@pytest.fixture
def edited(tmp_path, monkeypatch):
    """A function that changes one file of a copy of the package, which the keys are made from."""
    copy = tmp_path / "spectrabox"
    shutil.copytree(keys.PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(keys, "PACKAGE", copy)

    def edit(file):
        with (copy / file).open("ab") as stream:
            stream.write(b"\n# edited\n")
    return edit


@pytest.mark.parametrize("file, stale", [
    ("session/report/page.py", set()),
    ("session/commands/session.py", set()),
    ("session/box/scenes.py", set()),           # what it reads is in the keys by its values
    ("measure/captured.py", STAGES),
    ("calibrate/prior/models/rawtoaces39.npz", STAGES),
    ("sampling/prior/models/surface_families.npz", STAGES),
    ("radiometry/records/spectra.py", STAGES)])
def test_an_edit_makes_stale_what_depends_on_it(finished, edited, file, stale):
    edited(file)
    states = stage_states(read_session(finished))
    assert {name for name, (state, _) in states.items() if state == "stale"} == stale
    for name in stale:
        assert states[name][1][0].startswith(("code: ", "stages: "))
