"""A study on a real Dask cluster on this machine: the bits of a local run, also when a worker is killed."""

import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from processes import environment, finish, install, parts, start, until

import cooploc as cl
from cooploc.analysis.execution import workers
from cooploc.analysis.execution.provenance import bits
from cooploc.analysis.execution.workers import Task
from cooploc.estimators import configure
from cooploc.scenarios import resolve

pytestmark = pytest.mark.slow
distributed = pytest.importorskip("distributed", reason="needs Dask: pip install 'cooploc[cluster]'")

FAR = ("run", "small.toml", "--out", "far", "--scheduler")
SMALL = """
trials = 6
baseline = "dead-reckoning"
scenarios = ["robots-1-3/n={1..6}[ticks=12]"]
estimators = ["dead-reckoning", "arl[particles=50]", "held", "mine.py:Mine"]
"""
MINE = "from cooploc.estimators.dead_reckoning import DeadReckoning as Mine\n"


@pytest.fixture(scope="module")
def plugins(tmp_path_factory):
    return install(tmp_path_factory.mktemp("plugins"))


class Cluster:
    """A scheduler and workers on this machine, started by Dask's own commands."""

    def __init__(self, folder, plugins):
        self.elsewhere, self.variables, self.begun = folder / "elsewhere", environment(plugins), []
        self.elsewhere.mkdir()
        said = folder / "scheduler.json"
        self._begin("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(said))
        until(lambda: said.exists() and said.read_text().rstrip().endswith("}"))  # Dask writes into it as it stands
        self.address = json.loads(said.read_text())["address"]

    def join(self):
        name = f"worker-{len(self.begun)}"
        self._begin("worker", self.address, "--nthreads", "1", "--name", name)
        until(lambda: name in worker_names(self.address))
        return self.begun[-1]

    def _begin(self, *arguments):
        command, nowhere = [sys.executable, "-m", "dask", *arguments, "--no-dashboard"], subprocess.DEVNULL
        self.begun.append(
            subprocess.Popen(command, env=self.variables, cwd=self.elsewhere, stdout=nowhere, stderr=nowhere)
        )


def kill(process):
    """A process and all its children, at once."""
    for child in psutil.Process(process.pid).children(recursive=True) if process.poll() is None else ():
        child.kill()
    process.kill()
    process.wait()


@pytest.fixture
def cluster(tmp_path, plugins):
    found = Cluster(tmp_path, plugins)
    yield found
    for process in found.begun:
        kill(process)


def worker_names(address):
    """The names of a scheduler's workers."""
    from distributed import Client

    try:
        with Client(address, timeout=60, set_as_default=False) as client:
            return {worker["name"] for worker in client.scheduler_info(n_workers=-1)["workers"].values()}
    except OSError:
        return set()


@pytest.fixture
def local(tmp_path, plugins):
    """The parts of the study without a cluster."""
    (tmp_path / "small.toml").write_text(SMALL)
    (tmp_path / "mine.py").write_text(MINE)
    told = finish("run", "small.toml", "--out", "local", plugins=plugins, cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    return parts(tmp_path / "local")


def started(cluster, tmp_path, plugins):
    """The study on the cluster, as soon as a worker is at it; it does not end while there is a file `hold`."""
    (tmp_path / "hold").touch()
    run = start(*FAR, cluster.address, plugins=plugins, cwd=tmp_path, prepare=be_patient)
    until(lambda: list(tmp_path.glob("held-*")) or run.poll() is not None)
    assert run.poll() is None
    return run


def be_patient():
    """Let a process wait for a scheduler on a busy machine."""
    workers.PATIENCE = 600


def be_hasty():
    """Let a process give a scheduler up soon."""
    workers.PATIENCE = 1


def test_a_cluster_gives_the_bits_of_a_local_run_though_a_worker_is_killed(cluster, local, tmp_path, plugins):
    victim, _ = cluster.join(), cluster.join()
    run = started(cluster, tmp_path, plugins)
    kill(victim)
    (tmp_path / "hold").unlink()
    _, told = run.communicate()
    assert run.returncode == 0, told
    assert parts(tmp_path / "far") == local


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("tcp://127.0.0.1:1", "no Dask scheduler answers at tcp://127.0.0.1:1"),
        ("nowhere", "cannot read the scheduler's address 'nowhere'"),
        ("http://127.0.0.1:1", "cannot read the scheduler's address 'http://127.0.0.1:1'"),
    ],
)
def test_a_cluster_that_does_not_answer_is_one_line(tmp_path, plugins, address, said):
    (tmp_path / "small.toml").write_text(SMALL.replace(', "mine.py:Mine"', ""))
    told = finish(*FAR, address, plugins=plugins, cwd=tmp_path, prepare=be_hasty)
    assert (told.returncode, told.stderr.count("\n")) == (2, 1), told.stderr
    assert said in told.stderr
    assert not (tmp_path / "far").exists()


def test_a_worker_that_has_other_files_of_plug_ins_or_none_ends_the_run_with_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(distributed, "get_worker", lambda: SimpleNamespace(address="tcp://w:1"))
    (tmp_path / "mine.py").write_text(MINE)
    task = Task(resolve("robots-1-3/n=1[ticks=3]"), range(2), 1, (configure("mine.py:Mine"),), 60.0, isolate=False)
    wanted = {**bits(), "plug-ins": workers._plugins_of(task)}
    (part,) = workers._measure_on_dask(wanted, tmp_path, task.labels())
    assert np.isfinite(part.frame["rmse"]).all()
    (tmp_path / "mine.py").write_text(f"{MINE}# of another version\n")
    with pytest.raises(
        cl.BadInput, match=r"worker tcp://w:1 has other plug-ins than .*: share their folder, or install"
    ):
        workers._measure_on_dask(wanted, tmp_path, task.labels())
    (tmp_path / "mine.py").unlink()
    with pytest.raises(cl.BadInput, match=f"tcp://w:1 lacks what the task names .*mine.py.*: share {tmp_path} with it"):
        workers._measure_on_dask(wanted, tmp_path, task.labels())


def test_a_plug_in_that_is_edited_while_a_run_goes_on_is_asked_for_as_it_was(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(MINE)
    submit = SimpleNamespace(submit=lambda measure, wanted, *rest: wanted["plug-ins"])
    client = SimpleNamespace(nthreads=dict, get_executor=lambda pure: submit)
    task = Task(resolve("robots-1-3/n=1[ticks=3]"), range(2), 1, (configure("mine.py:Mine"),), 60.0, isolate=False)
    processes = workers._dask_processes(client, "tcp://s:1")
    before = processes.submit(task)
    (tmp_path / "mine.py").write_text(f"{MINE}# edited\n")
    assert processes.submit(task) == before != workers._plugins_of(task)


def test_a_cluster_is_named_by_its_address(tmp_path):
    with pytest.raises(cl.BadInput, match=r"scheduler is a SimpleNamespace; give its address, .*scheduler_address$"):
        cl.run_study("quick", scheduler=SimpleNamespace(), out=tmp_path / "far")


def test_a_cluster_whose_workers_have_all_gone_is_given_up_after_a_minute(monkeypatch):
    now, there, asked = [0.0], {"tcp://w:1": 1}, []
    client = SimpleNamespace(
        status="running",
        nthreads=lambda: asked.append(now[0]) or there,
        get_executor=lambda pure: SimpleNamespace(submit=0),
    )
    monkeypatch.setattr(workers.time, "monotonic", lambda: now[0])
    processes = workers._dask_processes(client, "tcp://s:1")
    for now[0] in range(0, 100, 5):
        processes.require_alive()
    assert asked == [0, 15, 30, 45, 60, 75, 90]  # it is not asked after each result
    there.clear()
    for now[0] in range(100, 150, 5):
        processes.require_alive()
    now[0] = 170.0
    with pytest.raises(cl.BadInput, match=r"tcp://s:1 has lost all workers .*; what was finished is kept"):
        processes.require_alive()
