"""What a Dask cluster may answer, without a cluster: no workers, late ones that are other, a scheduler that is gone."""

import asyncio
import concurrent.futures
from concurrent.futures import Future
from types import SimpleNamespace

import pytest

from cooploc.analysis.execution import workers
from cooploc.analysis.execution.provenance import bits
from cooploc.analysis.execution.workers import DaskCluster, FarParts
from cooploc.estimators.errors import BadInput

pytest.importorskip("distributed", reason="needs Dask: pip install 'cooploc[cluster]'")
ADDRESS = "tcp://10.0.0.1:8786"


class Client:
    """A connection to a scheduler that has some workers, or none."""

    def __init__(self, workers=1, status="running"):
        self.workers, self.status, self.asked = workers, status, False  # None: the connection is lost later

    def get_executor(self, pure):
        return None

    def nthreads(self):
        if self.asked and self.workers is None:
            raise OSError("closed")
        self.asked = True
        return dict.fromkeys(range(self.workers or 0), 1)


@pytest.fixture
def waited(monkeypatch):
    """What is said while a task takes so long [s], by a clock that the wait itself advances: a list of (when, what)."""

    def until(client, seconds):
        now, said, running = 0.0, [], {Future(): None}

        def wait(futures, timeout, return_when):
            nonlocal now
            now += timeout
            return SimpleNamespace(done=set(futures) if now >= seconds else set())

        monkeypatch.setattr(workers, "wait", wait)
        monkeypatch.setattr(workers, "time", SimpleNamespace(monotonic=lambda: now))
        assert DaskCluster(client, ADDRESS, lambda line: said.append((now, line))).first(running) == set(running)
        return said

    return until


def test_a_cluster_without_workers_is_told_within_ten_seconds_and_every_minute(waited):
    said = waited(Client(0), 200)
    assert {line for _, line in said} == {
        f"the Dask cluster at {ADDRESS} has no workers: waiting for one (dask worker ...)"
    }
    first, *later = [when for when, _ in said]
    assert first <= 10
    assert [when - first for when in later] == pytest.approx([60, 120, 180], abs=10)
    assert waited(Client(1), 200) == []


@pytest.mark.parametrize("client", [Client(status="closed"), Client(None)])
def test_a_scheduler_that_dies_meanwhile_is_one_line(waited, client):
    with pytest.raises(BadInput, match=f"the Dask scheduler at {ADDRESS} is gone; what was finished is kept"):
        waited(client, 20)


@pytest.mark.parametrize("error", [asyncio.CancelledError, concurrent.futures.CancelledError])
def test_a_task_that_was_cancelled_is_a_scheduler_that_is_gone(error):
    future = Future()
    future.set_exception(error())
    with pytest.raises(BadInput, match="is gone; what was finished is kept"):
        DaskCluster(Client(), ADDRESS, print).parts(None, future)


@pytest.mark.parametrize(("key", "remedy"), [("versions", "install the same"), ("instructions", "one kind of proc")])
def test_what_a_late_and_different_worker_gives_is_refused(key, remedy):
    future = Future()
    future.set_result(FarParts("tcp://late:1", {**bits(), key: {"numpy": "other"}}, []))
    with pytest.raises(BadInput, match=f"the Dask worker tcp://late:1 has other {key} than this machine: .*{remedy}"):
        DaskCluster(Client(), ADDRESS, print).parts(None, future)
    alike = Future()
    alike.set_result(FarParts("tcp://late:2", bits(), ["part"]))
    assert DaskCluster(Client(), ADDRESS, print).parts(None, alike) == ["part"]
