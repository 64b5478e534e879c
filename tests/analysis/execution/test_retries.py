"""A trial that failed runs again where that may help, or on request; never else."""

from dataclasses import dataclass

import pytest

from cooploc import estimators
from cooploc.analysis.execution.progress import RunProgress
from cooploc.analysis.execution.run import execute, is_worth_retry
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.scenarios.studies.study import Study

LIMIT = "TimeLimit: longer than the time limit of 2 s a trial (trace.py:9)"
DIED = "the process that ran it died (killed, crashed, or out of memory)"
STUDY = Study(
    name="small",
    trials=3,
    time_limit=200.0,
    scenarios=("robots-1-3/n=1[ticks=3]",),
    estimators=("dead-reckoning", "moody"),
)


@pytest.mark.parametrize(
    ("failure", "time_limit", "again"),
    [
        ("RuntimeError: sensor on fire (mine.py:3)", 600.0, False),
        ("ValueError: MemoryError is not what this is", 600.0, False),
        ("MemoryError: (mine.py:3)", 1.0, True),
        ("_ArrayMemoryError: Unable to allocate 9 GiB (mine.py:3)", 1.0, True),
        ("OSError: [Errno 28] No space left on device (mine.py:3)", 1.0, True),
        ("OSError: [Errno 2] No such file (mine.py:3)", 1.0, False),
        (DIED, 1.0, True),
        (LIMIT, 2.0, False),
        (LIMIT, 1.0, False),
        (LIMIT, 2.5, True),
        ("TimeLimit: longer than the time limit of 1e-05 s a trial", 0.1, True),
    ],
)
def test_a_failure_is_worth_a_retry_where_its_cause_may_be_gone(failure, time_limit, again):
    assert is_worth_retry(failure, time_limit) is again
    assert is_worth_retry(failure, time_limit, "all")


class TimeLimit(Exception):
    """As that of a run."""


@dataclass(frozen=True)
class Moody(DeadReckoning):
    """Fails in trial 1, as long as there is something in `now`."""

    now = ()

    def init(self, prior, world, rows):
        if self.now and (rows.trial == 1).any():
            raise self.now[0]
        return super().init(prior, world, rows)


class Told(RunProgress):
    def __init__(self):
        self.done = []

    def advance(self, what, trials, failed, share):
        self.done.append((what.rpartition(" ")[2], trials, failed))


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.setitem(estimators.BUILTIN, "moody", (f"{__name__}:Moody", {}))

    def go(*failure, **options):
        monkeypatch.setattr(Moody, "now", failure)
        told = Told()
        study = STUDY.with_options(time_limit=options.pop("time_limit", None))
        rows = execute(study, tmp_path / "run", progress=told, **options)
        return told.done, int(rows["failure"].notna().sum())

    return go


def test_what_failed_by_itself_fails_again_and_runs_on_request_alone(run):
    assert run(RuntimeError("on fire")) == ([("dead-reckoning", 3, 0), ("moody", 3, 1)], 1)
    assert run() == ([], 1)
    assert run(retry_failed=True) == ([("moody", 3, 0)], 0)
    assert run(retry_failed=True) == ([], 0)


def test_what_found_the_memory_full_runs_again_by_itself(run):
    assert run(MemoryError("none left"))[1] == 1
    assert run(MemoryError("none left")) == ([("moody", 3, 1)], 1)
    assert run() == ([("moody", 3, 0)], 0)
    assert run() == ([], 0)


def test_what_a_time_limit_ended_runs_again_once_the_limit_has_grown(run):
    assert run(TimeLimit("longer than the time limit of 200 s a trial"))[1] == 1
    assert run() == ([], 1)
    assert run(time_limit=100.0) == ([], 1)
    assert run(time_limit=2000.0) == ([("moody", 3, 0)], 0)


def test_parts_that_vanish_again_and_again_are_named(tmp_path, run):
    class Thief(Told):
        def advance(self, what, trials, failed, share):
            for part in (tmp_path / "run" / "parts").glob("*dead-reckoning*.parquet"):
                part.unlink()

    with pytest.raises(ValueError, match=r"parts vanish from .* \(robots-1-3/n=1\[ticks=3\], dead-reckoning, trial 0"):
        execute(STUDY, tmp_path / "run", progress=Thief())
