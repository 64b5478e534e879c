"""Runs that are killed, interrupted, starved of disk, or hold estimators that hang or crash."""

import os
import random
import re
import resource
import signal
import time
from functools import partial

import pandas as pd
import pytest
from dying import EXIT, die_at
from processes import finish, inside, install, marks, parts, start, table, until

from cooploc.analysis.execution.run_directory import RunDir

pytestmark = pytest.mark.slow
SMALL = """
trials = 6
baseline = "dead-reckoning"
scenarios = ["robots-1-3/n={1..6}[ticks=12]"]
estimators = ["dead-reckoning", "ekf-local", "arl[particles=50]"]
"""


@pytest.fixture(scope="module")
def plugins(tmp_path_factory):
    return install(tmp_path_factory.mktemp("plugins"))


@pytest.fixture
def place(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    return tmp_path


@pytest.fixture
def held(place):
    """Here the estimator `held` waits until the file is gone."""
    (place / "hold").touch()
    return place


def test_a_run_that_is_killed_again_and_again_ends_bit_identical(place, plugins):
    whole = finish("run", "small.toml", "--out", "whole", "--json", plugins=plugins, cwd=place)
    assert whole.returncode == 0, whole.stderr
    wanted, seen = parts(place / "whole"), {}
    moment = random.Random(5)
    for attempt in range(3):
        command = ("run", "small.toml", "--out", "run", "--jobs", 1 + attempt % 2)
        run = start(*command, plugins=plugins, cwd=place, prepare=partial(pause_after, len(seen) + 3))
        fresh = len(seen)
        until(lambda r=run, n=fresh: r.poll() is not None or len(marks(place / "run")) > n)
        time.sleep(moment.uniform(0, 0.1))
        assert run.poll() is None
        (os.killpg if attempt % 3 else os.kill)(run.pid, signal.SIGKILL)
        run.communicate()
        now = marks(place / "run")
        assert {name: now[name] for name in seen} == seen
        assert len(seen) < len(now) < len(wanted)
        seen = now
    again = finish("run", "small.toml", "--out", "run", "--json", plugins=plugins, cwd=place)
    assert again.returncode == 0, again.stderr
    assert parts(place / "run") == wanted
    assert {name: marks(place / "run")[name] for name in seen} == seen
    pd.testing.assert_frame_equal(*(pd.DataFrame(table(one)).drop("seconds") for one in (again, whole)))
    assert not list((place / "run").rglob("*.tmp"))


def pause_after(parts):
    """Let a process wait when there are so many: to be killed, however late a busy machine looks."""
    write = RunDir.write

    def watched(self, *arguments):
        receipt = write(self, *arguments)
        while len(marks(self.path)) >= parts:
            time.sleep(0.02)
        return receipt

    RunDir.write = watched


@pytest.mark.parametrize("jobs", [1, 2])
def test_ctrl_c_ends_a_call_that_would_take_for_ever_and_says_how_to_go_on(held, plugins, jobs):
    arguments = ("run", "small.toml", "--out", "run", "--estimators", "dead-reckoning,held")
    run = start(*arguments, "--jobs", jobs, plugins=plugins, cwd=held)
    until(lambda: list(held.glob("held-*")))
    os.killpg(run.pid, signal.SIGINT)
    _, told = run.communicate(timeout=300)  # half of the time that the call may take
    assert run.returncode == 130
    assert "the same command goes on from there" in told
    assert "Traceback" not in told
    until(lambda: not is_group(run.pid))


def is_group(group):
    """Whether a process group has a process."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize(
    ("does", "jobs", "said"),
    [
        ("raise", 1, "RuntimeError: sensor on fire (trouble.py:"),
        ("nan", 2, "estimate is not finite"),
        ("spin", 2, ": longer than the time limit of 1 s a trial"),
    ],
)
def test_a_trial_that_fails_is_recorded_and_costs_no_other(place, plugins, does, jobs, said):
    arguments = ("--estimators", f"dead-reckoning,trouble[does={does}]", "--trials", 6, "--jobs", jobs, "--json")
    limit = "time_limit = 1.0" if does == "spin" else ""
    (place / "small.toml").write_text(limit + SMALL.replace("{1..6}", "1"))
    told = finish("run", "small.toml", "--out", "run", *arguments, plugins=plugins, cwd=place)
    assert told.returncode == 1, told.stderr
    rows = {name: (row["failed"], row["trials"]) for name, row in table(told).items()}
    assert rows == {"dead-reckoning": (0, 6), f"trouble[does={does}]": (2, 4)}
    assert said in told.stderr
    shown = finish("show", "run", plugins=plugins, cwd=place)
    assert said in shown.stdout
    assert "trials 3, 4" in shown.stdout
    frames = [line for line in shown.stdout.splitlines() if line.startswith("  File ")]
    assert len(frames) == (does == "raise"), frames  # none of ours
    assert all("trouble.py" in line for line in frames)


def test_two_runs_into_one_directory_are_refused_until_the_first_is_gone(held, plugins):
    arguments = ("run", "small.toml", "--out", "run", "--estimators", "dead-reckoning,held")
    first = start(*arguments, plugins=plugins, cwd=held)
    until(lambda: marks(held / "run"))
    second = finish("run", "small.toml", "--out", "run", plugins=plugins, cwd=held)
    assert (second.returncode, second.stderr.count("\n")) == (2, 1)
    assert "another run is writing to run: wait for it, or name another by --out" in second.stderr
    first.kill()
    first.communicate()
    third = finish("run", "small.toml", "--out", "run", plugins=plugins, cwd=held)
    assert third.returncode == 0, third.stderr


def test_a_full_disk_stops_the_run_and_keeps_what_was_finished(place, plugins):
    """A file may not grow beyond a limit: small parts can be written, that of many robots cannot."""
    (place / "small.toml").write_text(
        SMALL.replace("{1..6}", "1").replace('ticks=12]"', 'ticks=12]", "scalability/n=99[ticks=2]"')
    )
    arguments = ("run", "small.toml", "--out", "run", "--estimators", "dead-reckoning")
    limited = finish(*arguments, plugins=plugins, cwd=place, prepare=partial(limit_file_size, 40_000))
    assert limited.returncode == 2, limited.stderr
    assert re.search(r"File too large: run/parts/scalability.*what was finished is kept", limited.stderr)
    assert "Traceback" not in limited.stderr
    kept = marks(place / "run")
    assert kept
    after = finish(*arguments, plugins=plugins, cwd=place)
    assert after.returncode == 0, after.stderr
    assert kept.items() < marks(place / "run").items()


def limit_file_size(limit):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))


def test_a_run_that_dies_before_any_of_its_file_operations_goes_on(tmp_path):
    tiny = 'trials = 1\nscenarios = ["robots-1-3/n=1[ticks=2]"]\nestimators = ["dead-reckoning"]\n'
    (tmp_path / "tiny.toml").write_text(tiny)
    whole = inside("run", "tiny.toml", "--out", "whole", cwd=tmp_path)
    assert whole.returncode == 0, whole.stderr
    for number in range(1, 200, 2):  # operations, more than a run of one part needs
        command = ("run", "tiny.toml", "--out", f"run{number}")
        died = finish(*command, plugins=tmp_path, cwd=tmp_path, prepare=partial(die_at, number, f"run{number}"))
        assert died.returncode == EXIT, died.stderr
        there = parts(tmp_path / f"run{number}")
        again = inside(*command, cwd=tmp_path)
        assert again.returncode == 0, f"before operation {number}: {again.stderr}"
        assert parts(tmp_path / f"run{number}") == parts(tmp_path / "whole")
        assert not list((tmp_path / f"run{number}").rglob("*.tmp"))
        if there:
            break
    assert 10 < number < 199
