"""What later stages take is loaded while photos are decoded, and is there when they begin."""
import sys

import pytest

from spectrabox.session.load_ahead import loading_ahead
from spectrabox.session.stages.order import Stage

NOWHERE = {"calibrate": Stage("no_such_module", "run")}


def loading(stages):
    return loading_ahead(stages, flat=True, writer=False, device="cpu")


def test_a_stage_finds_its_module_loaded(tmp_path, monkeypatch):
    (tmp_path / "loaded_late.py").write_text("import time\ntime.sleep(0.2)\nwhole = True\n")
    monkeypatch.syspath_prepend(tmp_path)
    with loading({"calibrate": Stage("loaded_late", "run")}) as ready_for:
        ready_for("chart")
        ready_for("photo")
        ready_for("calibrate")
        assert sys.modules.pop("loaded_late").whole


def test_nothing_is_loaded_where_no_photo_is_decoded():
    with loading(NOWHERE) as ready_for:
        ready_for("calibrate")
        ready_for("sample")


def test_what_cannot_be_loaded_is_said_before_the_stage():
    with loading(NOWHERE) as ready_for:
        ready_for("chart")
        with pytest.raises(ModuleNotFoundError, match="no_such_module"):
            ready_for("calibrate")
