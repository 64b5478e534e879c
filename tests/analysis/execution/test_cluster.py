"""A study on a real Dask cluster on this machine: the bits of a local run, also when a worker is killed."""

import os
import signal
import socket
import subprocess
import sys

import psutil
import pytest
from processes import environment, finish, install, marks, parts, start, until

pytestmark = pytest.mark.slow
pytest.importorskip("distributed", reason="needs Dask: pip install 'cooploc[cluster]'")

SMALL = """
trials = 6
baseline = "dead-reckoning"
scenarios = ["robots-1-3/n={1..6}[ticks=12]"]
estimators = ["dead-reckoning", "arl[particles=50]", "slow[seconds=0.05]"]
"""
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


@pytest.fixture(scope="module")
def plugins(tmp_path_factory):
    return install(tmp_path_factory.mktemp("plugins"))


@pytest.fixture
def cluster(tmp_path, plugins):
    """A scheduler and two workers, started by Dask's own commands: the address, and the workers' processes."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    options = {"cwd": tmp_path, "env": environment(plugins), **QUIET}
    dask = [sys.executable, "-m", "dask"]
    quiet = ["--no-dashboard"]
    begun = [subprocess.Popen([*dask, "scheduler", "--host", "127.0.0.1", "--port", str(port), *quiet], **options)]
    for _ in range(2):
        begun.append(subprocess.Popen([*dask, "worker", address, "--nthreads", "1", *quiet], **options))
    try:
        until(lambda: workers(address) == 2)
        yield address, begun[1:]
    finally:
        for process in begun:
            for child in psutil.Process(process.pid).children(recursive=True) if process.poll() is None else ():
                child.kill()
            process.kill()
            process.wait()


def workers(address):
    from distributed import Client

    try:
        with Client(address, timeout=2, set_as_default=False) as client:
            return len(client.nthreads())
    except OSError:
        return 0


def test_a_cluster_gives_the_bits_of_a_local_run_though_a_worker_is_killed(cluster, tmp_path, plugins):
    address, workers_ = cluster
    (tmp_path / "small.toml").write_text(SMALL)
    local = finish("run", "small.toml", "--out", "local", plugins=plugins, cwd=tmp_path)
    assert local.returncode == 0, local.stderr
    arguments = ("run", "small.toml", "--out", "far", "--scheduler", address)
    run = start(*arguments, plugins=plugins, cwd=tmp_path)
    until(lambda: marks(tmp_path / "far") or run.poll() is not None)
    assert run.poll() is None
    victim = workers_[0]
    for child in psutil.Process(victim.pid).children(recursive=True):
        os.kill(child.pid, signal.SIGKILL)
    victim.kill()
    _, told = run.communicate(timeout=200)
    assert run.returncode == 0, told
    assert parts(tmp_path / "far") == parts(tmp_path / "local")


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("tcp://127.0.0.1:1", "no Dask scheduler answers at tcp://127.0.0.1:1"),
        ("nowhere", "cannot read the scheduler's address 'nowhere'"),
    ],
)
def test_a_cluster_that_does_not_answer_is_one_line(tmp_path, plugins, address, said):
    (tmp_path / "small.toml").write_text(SMALL)
    arguments = ("run", "small.toml", "--out", "far", "--scheduler", address)
    told = finish(*arguments, plugins=plugins, cwd=tmp_path)
    assert told.returncode == 2
    assert said in told.stderr
    assert told.stderr.count("\n") == 1
    assert not (tmp_path / "far").exists()
