"""What later stages take is loaded while photos are decoded, and is there when they begin."""
import sys
import threading
import time

import pytest

from spectrabox.radiometry.outside import loaded_beside as loaded_beside_module
from spectrabox.radiometry.outside.loaded_beside import loaded_beside
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


def test_what_cannot_be_loaded_is_left_to_the_stage():
    with loading(NOWHERE) as ready_for:
        ready_for("chart")
        ready_for("calibrate")


def test_an_interrupt_waits_for_the_thread():
    """A program that ends amid the start of a library can crash."""
    loaded = []

    def load():
        time.sleep(0.05)
        loaded.append(True)

    with pytest.raises(KeyboardInterrupt), loaded_beside(load):
        raise KeyboardInterrupt
    assert loaded


def test_an_interrupt_does_not_wait_for_ever(monkeypatch):
    monkeypatch.setattr(loaded_beside_module, "PATIENCE_S", 0.05)
    never, begun, ended = threading.Event(), threading.Event(), threading.Event()

    def load():
        begun.set()
        never.wait(60)
        ended.set()

    with pytest.raises(KeyboardInterrupt), loaded_beside(load):
        assert begun.wait(60)
        raise KeyboardInterrupt
    assert not ended.is_set()
    never.set()
