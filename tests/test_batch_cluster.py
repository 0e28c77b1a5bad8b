"""Batches on a Dask cluster: the bits of plain processes, whoever dies on the way."""
import contextlib
import http.client
import json
import os
import subprocess
import sys
import time
import urllib.parse
from pathlib import Path

import pytest
from batch_sessions import batch_of, begun, kill_worker_at, results_of, write_session

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.session.batch.executors import (
    open_processes,
)
from spectrabox.session.batch.tasks import kept_outcomes, run_batch
from spectrabox.session.batch.workers import open_workers

distributed = pytest.importorskip(
    "distributed", reason="no Dask here: pip install 'spectrabox[cluster]'")
default_client = distributed.default_client
ROOT = Path(__file__).resolve().parent.parent
# Dask closes sockets and event loops when they are collected
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning",
                                        "ignore::pytest.PytestUnraisableExceptionWarning")


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """A session that plain processes have made."""
    folder = write_session(tmp_path_factory.mktemp("one") / "as processes")
    tasks = batch_of([folder], folder.parent / "out")
    with open_processes(1) as workers:
        (outcome,) = run_batch(tasks, workers)
    assert outcome.state == "done"
    return folder


def test_a_cluster_makes_the_bits_of_processes_though_a_worker_is_killed(session, tmp_path):
    folders = begun(session, tmp_path, ["a", "b"], until="signals")
    tasks = batch_of(folders, tmp_path / "out")
    with open_workers("local", 1, len(folders)) as workers, kill_worker_at(folders[0]):
        assert workers.capacity()[0] == 1 and workers.about == ""
        # Dask's own setting has every array mapped anew: up to half as much processor again
        assert {*default_client().run(os.getenv, "MALLOC_TRIM_THRESHOLD_").values()} == {None}
        outcomes = run_batch(tasks, workers)
        assert [(each.state, each.says) for each in outcomes if each.state != "done"] == []
    for folder in folders:
        assert results_of(folder) == results_of(session)


def listening(psutil):
    """Addresses at which this process and those that it has started listen."""
    return {each.laddr for process in (psutil.Process(), *psutil.Process().children(recursive=True))
            for each in process.net_connections() if each.status == psutil.CONN_LISTEN}


def page_of(port, path):
    """What a browser gets from a port; None where that speaks no HTTP."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    with contextlib.closing(connection):
        try:
            connection.request("GET", path, headers={"Host": "elsewhere.example"})
            return connection.getresponse().status
        except (http.client.HTTPException, OSError):
            return None


def test_nobody_without_its_certificate_gets_into_a_cluster_of_this_machine(tmp_path):
    """As another user of the machine would try: at every port, in clear and by TLS of his own."""
    psutil = pytest.importorskip("psutil")
    mark = tmp_path / "mark"
    with open_workers("local", 1, 1):
        scheduler = urllib.parse.urlsplit(default_client().scheduler.address)
        ports = listening(psutil)
        assert {each.ip for each in ports} == {"127.0.0.1"} and scheduler.scheme == "tls"
        answers = {each.port: {page_of(each.port, path) for path in (
            "/", "/status", "/info/main/workers.html", "/json/counts.json", "/metrics", "/health",
            "/statics/dask.svg")} for each in ports}
        assert all(each in ({None}, {404}) for each in answers.values()), answers
        secured = {port for port, each in answers.items() if each == {None}}
        assert scheduler.port in secured and len(secured) == 3      # with worker and its nanny
        for port in secured:
            for scheme, security in (("tcp", None), ("tls", distributed.Security.temporary())):
                with pytest.raises(OSError), distributed.Client(
                        f"{scheme}://127.0.0.1:{port}", security=security, timeout=2,
                        set_as_default=False) as stranger:
                    stranger.submit(mark.touch).result(timeout=2)
        # it is the certificate that lets in
        with distributed.Client(scheduler.geturl(), security=default_client().security, timeout=10,
                                set_as_default=False) as owner:
            owner.submit(mark.touch).result(timeout=30)
    assert mark.exists()


def test_a_dashboard_is_there_where_it_is_asked_for():
    with open_workers("local", 1, 1, dashboard=True) as workers:
        assert workers.about.startswith("dashboard: http://127.0.0.1:")
        port = urllib.parse.urlsplit(workers.about.removeprefix("dashboard: ")).port
        assert page_of(port, "/health") == 200
    with pytest.raises(InputError, match="--dashboard is of --cluster local"), \
            open_workers("tcp://127.0.0.1:1", None, 1, dashboard=True):
        pass


@pytest.fixture
def dask(tmp_path):
    """A function that starts a scheduler with one worker; all are gone at the end."""
    started = []

    def start():
        file = tmp_path / f"scheduler {len(started)}.json"
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
        for words in (("distributed.cli.dask_scheduler", "--port", "0", "--host", "127.0.0.1",
                       "--dashboard-address", "127.0.0.1:0", "--scheduler-file", str(file)),
                      ("distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads",
                       "1", "--memory-limit", "2GiB", "--no-dashboard", "--no-nanny")):
            started.append(subprocess.Popen([sys.executable, "-m", *words], env=environment,
                                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
            end = time.monotonic() + 60
            while not file.exists() and time.monotonic() < end:
                time.sleep(0.05)
        return json.loads(file.read_text())["address"], *started[-2:]

    yield start
    for process in started:
        process.kill()
        process.wait()


def test_a_scheduler_that_dies_costs_nothing_that_is_stored(session, tmp_path, dask):
    folders = begun(session, tmp_path, ["a", "b"], until="signals")
    tasks = batch_of(folders, tmp_path / "out")
    address, scheduler, worker = dask()
    with pytest.raises(EnvironmentProblem, match="the same command again to go on"), \
            open_workers(address, None, 2) as workers:
        assert workers.capacity()[2] == 2 * 2**30
        for outcome in run_batch(tasks, workers):
            assert outcome.state == "done", outcome.says
            scheduler.kill()
    worker.kill()
    worker.wait()
    done = kept_outcomes(tasks)
    assert len(done) == 1
    address, _, _ = dask()
    with open_workers(address, None, 1) as workers:
        (outcome,) = run_batch([each for each in tasks if each.folder not in done], workers)
    assert outcome.state == "done", outcome.says
    for folder in folders:
        assert results_of(folder) == results_of(session)


def test_a_scheduler_that_is_not_there_is_one_sentence(monkeypatch):
    monkeypatch.setattr("spectrabox.session.batch.workers.CONNECTING_S", 0.5)
    with pytest.raises(EnvironmentProblem, match="no workers can be reached through tcp"), \
            open_workers("tcp://127.0.0.1:1", None, 1):
        pass


def test_without_dask_the_answer_is_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(EnvironmentProblem, match=r"pip install 'spectrabox\[cluster\]'"), \
            open_workers("local", None, 1):
        pass
