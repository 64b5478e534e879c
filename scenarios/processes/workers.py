"""Processes for plug-ins and for several jobs: a crash, a hang or another working directory stays in them.

Every owner has processes of its own: a plug-in shares none with another one, nor with built-in estimators. They are
kept for the next call, which then begins at once.
"""

import contextlib
import io
import os
import pickle
import re
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, wait
from multiprocessing import resource_tracker
from multiprocessing.util import Finalize
from pathlib import Path
from typing import Any

import cloudpickle

from cooploc.estimators.registry import load, needed_files
from cooploc.scenarios.processes.outcome import Outcome, ProcessDied, ProcessHung, Raised

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
QUIET = {"PYTHONFAULTHANDLER": ""}  # a crash is told in one line
GROWTH = {"LOKY_MAX_MEMORY_LEAK_SIZE": "1e9"}  # [B] after which loky replaces a process between two calls
WORK = 0.05  # [s] of processor time that shows that a process works: one that waits uses a little, too
IDLE = 600  # [s] after which an idle process ends
BUILTIN, SESSION = "", "session"  # owners: built-in estimators, and what a user hands over in Python
_pools: dict[tuple[int, str, int], tuple[Executor, Mapping[str, float]]] = {}


def pool(owner: str, jobs: int = 1, environment: Mapping[str, str] | None = None) -> Executor:
    """An owner's processes: those of its last call, or new ones where a source file was edited since.

    Where they are new, they get these environment variables in addition.
    """
    from loky import ProcessPoolExecutor

    key, now = (os.getpid(), owner, jobs), _sources()
    if key in _pools and any(now.get(file, at) != at for file, at in _pools[key][1].items()):
        end(owner)
    if key not in _pools:
        Finalize(None, end_all, exitpriority=100)  # else a process that was itself forked would wait for them
        begin = {"initializer": begin_worker, "initargs": (os.getpid(),)}
        variables = {**ONE_THREAD, **QUIET, **GROWTH, **(environment or {})}
        _pools[key] = ProcessPoolExecutor(jobs, timeout=IDLE, env=variables, **begin), now
        resource_tracker.ensure_running()  # loky needs it; as it starts, it lets Ctrl-C in again
        with _no_interrupt():
            _pools[key][0].submit(int)  # starts them
    return _pools[key][0]


@contextlib.contextmanager
def _no_interrupt() -> Iterator[None]:
    """Processes that are started here never see Ctrl-C, not even as they import; in this one it waits until then."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end(owner: str) -> None:
    """End an owner's processes, whatever they do."""
    for key in [key for key in _pools if key[:2] == (os.getpid(), owner)]:
        executor: Any = _pools.pop(key)[0]
        executor.shutdown(kill_workers=True)


def end_all(but: Collection[str] = ()) -> None:
    """End the processes of all owners but these."""
    for owner in {owner for pid, owner, _ in _pools if pid == os.getpid()} - set(but):
        end(owner)


def call(
    owner: str,
    function: Callable[..., Any],
    *arguments: Any,
    seconds: float = float("inf"),
    processor_seconds: float = float("inf"),
) -> Any:
    """Call a function in a process of this owner, and return what it returns; what it prints is printed here.

    Raises:
        ProcessDied: its process died.
        ProcessHung: it took longer than `seconds`, or used more than `processor_seconds`.
        WorkerError: it raised an exception of a class that is neither Python's nor ours.

    """
    future = submit(owner, 1, function, *arguments)
    if processor_seconds < threading.TIMEOUT_MAX:
        _demand_within(owner, future, processor_seconds)
    return received(owner, future, seconds)


def _demand_within(owner: str, future: "Future[Outcome]", seconds: float) -> None:
    """Wait for a call that may use so much processor time [s], or be idle for as long; a busy machine costs it nothing.

    Raises:
        ProcessHung: it took longer; its processes are ended.

    """
    began = worked = used(owner)
    since = time.monotonic()  # when it was last seen to work
    while not wait([future], timeout=min(1.0, seconds / 10)).done:
        now = used(owner)
        if now - worked > WORK:
            worked, since = now, time.monotonic()
        if now - began > seconds:
            end(owner)
            raise ProcessHung(f"it took longer than {seconds:g} s of processor time")
        if time.monotonic() - since > seconds:
            end(owner)
            raise ProcessHung(f"it did nothing for {seconds:g} s")


def used(owner: str) -> float:
    """What an owner's processes have used so far; by the clock where the system does not say."""
    executors: list[Any] = [one for (pid, name, _), (one, _) in _pools.items() if (pid, name) == (os.getpid(), owner)]
    total = 0.0
    for pid in [pid for executor in executors for pid in list(executor._processes or ())]:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            total += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        except OSError:
            if not Path("/proc/self/stat").exists():
                return time.monotonic()
    return total


def submit(owner: str, jobs: int, function: Callable[..., Any], *arguments: Any) -> "Future[Outcome]":
    """Begin a call in one of an owner's processes."""
    # loky warns in a thread that serves all calls: where warnings are errors, they would all be lost
    warnings.filterwarnings("ignore", "A worker (stopped|was restarted) while some jobs were given", UserWarning)
    sent = cloudpickle.dumps((function, arguments))  # a worker reads it where an error can be caught
    return pool(owner, jobs).submit(_called, os.getcwd(), sys.path, needed_files(sent), sent)


def received(owner: str, future: "Future[Outcome]", seconds: float = float("inf")) -> Any:
    """What a call returned, or raised, as `call` says; whatever ends the wait ends the owner's processes too."""
    try:
        outcome = future.result(seconds if seconds < threading.TIMEOUT_MAX else None)
    except BrokenExecutor as e:
        end(owner)
        raise ProcessDied(f"its process died ({cause(e)})") from None
    except TimeoutError:
        end(owner)
        raise ProcessHung(f"it took longer than {seconds:g} s") from None
    except BaseException:  # Ctrl-C
        end(owner)
        raise
    if outcome.printed:
        print(outcome.printed, end="")
    if outcome.raised:
        raise outcome.raised.error()
    return pickle.loads(outcome.value)


def cause(e: BaseException) -> str:
    """Why a process died, as far as its exit code says."""
    codes = re.search(r"exit codes of the workers are \{(\w+)\((-?\d+)\)\}", str(e))
    if codes is None or codes[1] == "SIGKILL":
        return "killed, crashed, or out of memory"
    return f"exit code {codes[2]}" if codes[1] == "EXIT" else codes[1]


def begin_worker(parent: int) -> None:
    """Leave Ctrl-C and stdout to the parent process, end when it ends, and be ended first where memory runs out."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _called(folder: str, path: list[str], files: dict[str, Path], sent: bytes) -> Outcome:
    """What runs in the other process: in the parent's directory, which an earlier call may have left.

    The Python files that the call refers to are loaded first.
    """
    os.chdir(folder)
    sys.path[:] = path
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed):
            load(files)
            function, arguments = cloudpickle.loads(sent)
            value = function(*arguments)
        return Outcome(cloudpickle.dumps(value), None, printed.getvalue())
    except BaseException as e:
        return Outcome(b"", Raised.of(e), printed.getvalue())


def _sources() -> Mapping[str, float]:
    """When each imported source file was changed last, but for those of Python's own directories."""
    places = (sys.prefix, sys.base_prefix)
    files = [getattr(module, "__file__", None) for module in list(sys.modules.values())]
    found = {}
    for file in {f for f in files if isinstance(f, str) and f.endswith(".py") and not f.startswith(places)}:
        with contextlib.suppress(OSError):
            found[file] = os.stat(file).st_mtime
    return found
