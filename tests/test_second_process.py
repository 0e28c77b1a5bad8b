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


@pytest.fixture
def begun(monkeypatch):
    """Numbers of the processes that were begun: this one may have others."""
    fork, numbers = os.fork, []

    def counted():
        numbers.append(fork())
        return numbers[-1]
    monkeypatch.setattr(os, "fork", counted)
    return numbers


def none_is_left(begun):
    assert len(begun) == 1
    with pytest.raises(ChildProcessError):
        os.waitpid(begun[0], os.WNOHANG)


def other_process():
    return {"process": os.getpid(), "numbers": np.arange(5)}


@FORKS
def test_the_work_is_done_by_another_process_and_its_result_comes_back(begun):
    with beside(other_process) as result:
        found = result()
    assert found["process"] != os.getpid()
    np.testing.assert_array_equal(found["numbers"], np.arange(5))
    none_is_left(begun)


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
def test_a_process_without_an_answer_is_not_waited_for(monkeypatch, begun):
    monkeypatch.setattr(second_process, "PATIENCE_S", 0.05)
    here = os.getpid()
    with beside(lambda: os.getpid() == here or signal.pause()) as result:
        assert result() is True
    none_is_left(begun)


@FORKS
@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError])
def test_a_block_that_breaks_off_leaves_no_process(stop, begun):
    with pytest.raises(stop), beside(signal.pause):
        raise stop
    none_is_left(begun)


@FORKS
def test_an_interrupt_amid_the_fork_is_heard(begun):
    """Python swallows what is raised by what libraries have it call there."""
    armed = [signal.SIGINT]
    os.register_at_fork(after_in_parent=lambda: armed and signal.raise_signal(armed.pop()))
    with pytest.raises(KeyboardInterrupt), beside(signal.pause):
        pass
    none_is_left(begun)


@FORKS
def test_signals_are_heard_again_in_both_processes():
    with beside(lambda: signal.pthread_sigmask(signal.SIG_BLOCK, [])) as result:
        assert result() == signal.pthread_sigmask(signal.SIG_BLOCK, [])
