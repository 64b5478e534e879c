"""Processes in which plug-ins and parallel jobs run: a crash, a hang or a full memory stays in them.

`call` runs a function in a process, returning or raising as it does; `limit_time` ends a process whose trial hangs.
Processes are kept for the next call, which then begins at once. Each owner has its own.
"""

import contextlib
import faulthandler
import io
import multiprocessing
import os
import pickle
import re
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future
from functools import cache, partial
from multiprocessing import resource_tracker
from multiprocessing.util import Finalize
from pathlib import Path
from typing import Any, NamedTuple

import cloudpickle

from cooploc.estimators.errors import OURS, BadInput, one_line, places_of_user, traceback_text
from cooploc.estimators.plugin_files import load, needed_files

BUILTIN, PLUGINS, SESSION = "built in", "plug-ins", "session"  # owners: jobs, plug-ins of a study, objects in Python
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
# A crash says so in one line; a process that grew by this many bytes is replaced between two calls.
SAFE_PATH = "PYTHONSAFEPATH"  # what starts with it imports no random.py of its directory in place of Python's
ENVIRONMENT = {**ONE_THREAD, "PYTHONFAULTHANDLER": "", "LOKY_MAX_MEMORY_LEAK_SIZE": "1e9", SAFE_PATH: "1"}
IDLE = 600  # [s] after which an idle process ends
LONGEST = 1e7  # [s] beyond which a limit is none, as no timer goes so far
PATIENCE = 10.0  # [s] that imports and compilation may take longer than a trial
_pools: dict[tuple[int, str, int], tuple[Executor, Mapping[str, float]]] = {}
_starting = threading.RLock()  # held while processes start, as threads may ask for some at once
_limited = False  # whether this is a process for plug-ins, which a timer may end


class WorkerError(RuntimeError):
    """Code in another process failed: it raised, or its process did not outlive it."""


class ProcessDied(WorkerError):
    """The process crashed, was killed, or left."""


class ProcessHung(WorkerError):
    """The process took longer than it may, and was ended."""


class RemoteTraceback(Exception):
    """The cause of an exception that was raised in another process: its traceback, and the file and line."""

    def __init__(self, text: str, place: str) -> None:
        super().__init__(f"\n{text}")
        self.place = place


class Outcome(NamedTuple):
    """The result of a call in another process, or its exception: as text, and pickled if its class is known here."""

    pickled: bytes  # the result or the exception; empty for other exceptions
    printed: str  # on its stdout
    line: str = ""  # of an exception: its type and message
    traceback: str = ""
    place: str = ""
    places: tuple[str, ...] = ()  # in the traceback, in a user's code

    @classmethod
    def of_exception(cls, e: BaseException, printed: str = "") -> "Outcome":
        """Describe an exception for the process that asked."""
        module, pickled = type(e).__module__, b""
        if isinstance(e, Exception) and (module == "builtins" or module.startswith("cooploc.")):
            with contextlib.suppress(Exception):
                found = pickle.dumps(e)
                pickle.loads(found)
                pickled = found
        return cls(pickled, printed, one_line(e), traceback_text(e), place_of(e), tuple(places_of_user(e)))

    def unpack(self) -> Any:
        """Return the result, or raise the exception, in the process that asked."""
        if not self.line:
            return pickle.loads(self.pickled)
        error: Exception = pickle.loads(self.pickled) if self.pickled else WorkerError(self.line)
        if not isinstance(error, BadInput):  # in a notebook, no frames of our code
            debug = "In a process of its own; with isolate=False it runs here, for a debugger."
            error._render_traceback_ = partial(list, [*self.places, self.line, debug])  # type: ignore[attr-defined]
        raise error from RemoteTraceback(self.traceback, self.place)


def place_of(e: BaseException) -> str:
    """Return the last file and line in a user's code, such as " (mine.py:12)", here or in another process.

    Where there is none, that of a library or of our code; but not of an error of our own, which says what was wrong.
    """
    if isinstance(e.__cause__, RemoteTraceback):
        return e.__cause__.place
    frames = [one for one in traceback.extract_tb(e.__traceback__) if one.filename != __file__]
    theirs = [one for one in frames if not one.filename.startswith(OURS)]
    own = [] if type(e).__module__.startswith("cooploc.") else frames
    libraries, compiled = (sys.prefix, sys.base_prefix), (".pyx", ".pxd")
    written = [one for one in theirs if not one.filename.startswith(libraries) and not one.filename.endswith(compiled)]
    for one in (written or theirs or own)[-1:]:
        return f" ({Path(one.filename).name}:{one.lineno})"
    return ""


def call(
    owner: str,
    function: Callable[..., Any],
    *arguments: Any,
    seconds: float = float("inf"),
    limit: float = float("inf"),
) -> Any:
    """Call a function in a process of this owner, and return its result; what it prints comes on stderr.

    Raises:
        ProcessDied: its process died.
        ProcessHung: it took longer than `seconds`, or a trial longer than `limit` [s].
        WorkerError: it raised an exception of a class that is neither Python's nor ours.
    """
    return wait_for(owner, submit(owner, 1, function, *arguments), seconds, limit)


def submit(owner: str, jobs: int, function: Callable[..., Any], *arguments: Any) -> "Future[Outcome]":
    """Begin a call in one of an owner's processes."""
    # loky warns in a thread that serves all calls: where warnings are errors, they would all be lost
    warnings.filterwarnings("ignore", "A worker (stopped|was restarted) while some jobs were given", UserWarning)
    sent = cloudpickle.dumps((function, arguments))  # a worker reads it where an error can be caught
    run = partial(_run_call, os.getcwd(), sys.path, needed_files(sent), sent)
    try:
        return pool(owner, jobs).submit(run)
    except BrokenExecutor:  # a process died between two calls
        end(owner)
        return pool(owner, jobs).submit(run)


def wait_for(owner: str, future: "Future[Outcome]", seconds: float = float("inf"), limit: float = float("inf")) -> Any:
    """Return the result of a call, or raise as `call` says; where the wait fails, the owner's processes end."""
    began = time.monotonic()
    try:
        outcome = future.result(seconds if seconds < threading.TIMEOUT_MAX else None)
    except BrokenExecutor as e:
        end(owner)
        if cause_of(e) == "exit code 1" and time.monotonic() - began >= limit:  # as its own timer ends it
            raise ProcessHung(f"longer than the time limit of {limit:g} s a trial: its process was ended") from None
        raise ProcessDied(f"its process died ({cause_of(e)})") from None
    except TimeoutError:
        end(owner)
        raise ProcessHung(f"it took longer than {seconds:g} s") from None
    except BaseException:  # Ctrl-C
        end(owner)
        raise
    if outcome.printed:
        print(outcome.printed, end="", file=sys.stderr)  # stdout is the table's, or JSON's
    return outcome.unpack()


# Of a process that is ended while it starts, loky's tracker removes a lock, and would print a warning of it.
QUIET = "ignore:resource_tracker:UserWarning"


@contextlib.contextmanager
def _starting_processes() -> Iterator[None]:
    """Set what processes take over that start in a block."""
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    sys.warnoptions.append(QUIET)
    try:
        yield
    finally:
        sys.warnoptions.remove(QUIET)
        os.environ.pop(SAFE_PATH)
        os.environ.update({SAFE_PATH: before} if before else {})


def pool(owner: str, jobs: int = 1) -> Executor:
    """Return an owner's processes: those of its last call, or new ones."""
    with _starting:
        if owner != BUILTIN:
            end_if_edited(owner)
        key = os.getpid(), owner, jobs
        if key not in _pools:
            _pools[key] = _start(owner, jobs), _source_times()
        return _pools[key][0]


def _start(owner: str, jobs: int) -> Executor:
    from loky import ProcessPoolExecutor

    if multiprocessing.current_process().daemon:
        raise BadInput(
            "a process of multiprocessing.Pool may start no other: use concurrent.futures.ProcessPoolExecutor, or "
            "isolate=False and jobs=1, which keep all in one"
        )
    Finalize(None, end_all, exitpriority=100)  # else a process that was itself forked would wait for them
    begin = {"initializer": _begin_worker, "initargs": (os.getpid(), owner != BUILTIN)}
    with _starting_processes():
        executor: Executor = ProcessPoolExecutor(jobs, timeout=IDLE, env=ENVIRONMENT, **begin)
        resource_tracker.ensure_running()  # loky needs it; as it starts, it lets Ctrl-C in again
    # Processes that are started here never see Ctrl-C, not even as they import; in this one it waits until then.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        executor.submit(int)  # starts them
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return executor


def end_if_edited(owner: str) -> None:
    """End an owner's processes where a source file was edited since they began, so that new ones import it anew."""
    now = _source_times()
    for times in [times for key, (_, times) in _pools.items() if key[:2] == (os.getpid(), owner)]:
        if any(now.get(file, at) != at for file, at in times.items()):
            end(owner)


def end(owner: str) -> None:
    """End an owner's processes, whatever they do."""
    for key in [key for key in _pools if key[:2] == (os.getpid(), owner)]:
        executor: Any = _pools.pop(key)[0]
        executor.shutdown(kill_workers=True)


def end_all(but: Collection[str] = ()) -> None:
    """End the processes of all owners but these."""
    for owner in {owner for pid, owner, _ in _pools if pid == os.getpid()} - set(but):
        end(owner)


def cause_of(e: BaseException) -> str:
    """Say why a process died, as far as its exit code tells."""
    codes = re.search(r"exit codes of the workers are \{(\w+)\((-?\d+)\)\}", str(e))
    if codes is None or codes[1] == "SIGKILL":
        return "killed, crashed, or out of memory"
    return f"exit code {codes[2]}" if codes[1] == "EXIT" else codes[1]


def _begin_worker(parent: int, limited: bool) -> None:
    """Leave Ctrl-C and stdout to the parent process, end when it ends, and be ended first where memory runs out."""
    global _limited
    _limited = limited
    os.environ.pop(SAFE_PATH, None)  # programs that a plug-in starts find their files
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _run_call(folder: str, path: list[str], files: dict[str, Path], sent: bytes) -> Outcome:
    """Run a call in the other process: in the parent's directory, with the Python files that it refers to loaded."""
    os.chdir(folder)  # which an earlier call may have left
    sys.path[:] = path
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed):
            load(files)
            function, arguments = cloudpickle.loads(sent)
            value = function(*arguments)
        return Outcome(cloudpickle.dumps(value), printed.getvalue())
    except BaseException as e:
        return Outcome.of_exception(e, printed.getvalue())


def _source_times() -> Mapping[str, float]:
    """Return when each imported source file was changed last, but for those of Python's own directories."""
    places = (sys.prefix, sys.base_prefix)
    files = [getattr(module, "__file__", None) for module in list(sys.modules.values())]
    found = {}
    for file in {f for f in files if isinstance(f, str) and f.endswith(".py") and not f.startswith(places)}:
        with contextlib.suppress(OSError):
            found[file] = os.stat(file).st_mtime
    return found


@contextlib.contextmanager
def limit_time(seconds: float, trials: int = 1, ticks: int = 1) -> Iterator[Callable[..., Any]]:
    """End this process, if it is one for plug-ins, where a block takes longer than it may, whatever it does then.

    Yields a watcher that makes every call of an estimator. `seconds` are of one trial. Trials that run together share
    their calls: one call may take as long as one trial may, and all calls together as long as the trials may that are
    done by then.
    """
    began = armed = time.monotonic()
    slack = min(1.0, seconds / 10)  # [s] between settings of the timer
    limited = _limited and seconds < LONGEST

    def arm(left: float) -> None:
        faulthandler.dump_traceback_later(max(left, 1e-3), exit=True, file=_null_file())

    def watch(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        nonlocal armed
        now = time.monotonic()
        if limited and trials > 1 and now - armed > slack:
            armed = now
            arm(min(seconds + slack, began + seconds * (1 + (trials - 1) * (tick + 1) / ticks) - now))
        return call(*arguments)

    if limited:
        arm(seconds + slack * (trials > 1))
    try:
        yield watch
    finally:
        if limited:
            faulthandler.cancel_dump_traceback_later()


@cache
def _null_file() -> Any:
    """Return where the traceback of a process that is ended goes: the trial's row says that it failed."""
    return Path(os.devnull).open("w")
