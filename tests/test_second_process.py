"""Work beside this process: its result, its failures, and nothing left behind."""
import os
import signal
import sys

import numpy as np
import pytest

from spectrabox.radiometry.outside import second_process
from spectrabox.radiometry.outside.second_process import beside

FORKS = pytest.mark.skipif(sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2,
                           reason="there is no second process")


def other_process():
    return {"process": os.getpid(), "numbers": np.arange(5)}


@FORKS
def test_the_work_is_done_by_another_process_and_its_result_comes_back():
    with beside(other_process) as result:
        found = result()
    assert found["process"] != os.getpid()
    np.testing.assert_array_equal(found["numbers"], np.arange(5))
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)


def test_with_one_core_the_work_is_done_here(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0}, raising=False)
    with beside(os.getpid) as result:
        assert result() == os.getpid()


@pytest.mark.parametrize("fail", [
    lambda: os.kill(os.getpid(), signal.SIGKILL), lambda: 1 / 0, lambda: sys.exit(3),
    lambda: os._exit(0), lambda: lambda: None], ids=["killed", "error", "exit", "silent",
                                                     "no pickle"])
def test_what_fails_there_is_done_here(fail):
    here = os.getpid()

    def work():
        return "done here" if os.getpid() == here else fail()

    with beside(work) as result:
        assert result() == "done here"


def test_an_error_of_the_work_is_raised_here():
    with beside(lambda: int("seven")) as result, pytest.raises(ValueError, match="seven"):
        result()


@FORKS
def test_a_process_without_an_answer_is_not_waited_for(monkeypatch):
    monkeypatch.setattr(second_process, "PATIENCE_S", 0.05)
    here = os.getpid()
    with beside(lambda: os.getpid() == here or signal.pause()) as result:
        assert result() is True
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)


@FORKS
@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError])
def test_a_block_that_breaks_off_leaves_no_process(stop):
    with pytest.raises(stop), beside(signal.pause):
        raise stop
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)
