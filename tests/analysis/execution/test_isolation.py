"""Whatever a plug-in does to its process costs its own trials alone: a few cells of benchmarks/reliability."""

import json
import os
import signal
import time

import pandas as pd
import pytest
from processes import inside

from cooploc.analysis.execution.run import execute, prepare
from cooploc.scenarios.process import BUILTIN, pool
from cooploc.scenarios.studies.study import Study

pytestmark = pytest.mark.slow
FILE = """
import ctypes, os, resource, time
import numpy as np
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.scenarios import Family
from cooploc.scenarios.worlds.radio import Paper

class Segfaults(DeadReckoning):
    def init(self, prior, world, rows):
        if (rows.trial == 1).any():
            ctypes.string_at(0)
        return super().init(prior, world, rows)

class Leaves(DeadReckoning):
    def __init__(self):
        os._exit(0)

class DiesThreeTimes(DeadReckoning):  # before the run, in both trials, and in one alone
    def init(self, prior, world, rows):
        if (died := len([name for name in os.listdir() if name.startswith("died")])) < 3:
            open(f"died{died}", "w").close()
            os._exit(3)
        return super().init(prior, world, rows)

class Interrupts(DeadReckoning):
    def predict(self, s, z):
        raise KeyboardInterrupt

class Wanders(DeadReckoning):
    def fuse(self, s, z, mail):
        os.chdir("/")
        resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))
        return super().fuse(s, z, mail)

class World(Paper):
    def simulate(self, label, trials, seed, world):
        if 2 in trials:
            time.sleep(1000)
        return super().simulate(label, trials, seed, world)

class Torn(Paper):
    def simulate(self, label, trials, seed, world):
        truth, stream = super().simulate(label, trials, seed, world)
        third = (stream.trial == 2)[:, None, None, None]
        return truth, stream.replace_arrays({"senses.odometry": np.where(third, np.inf, stream.senses.odometry)})

hangs, torn = Family("hangs in trial 2", World), Family("has no number in trial 2", Torn)
"""
WORLD = "robots-1-3/n=1[ticks=4]"
SAID = {
    "Segfaults": {1: "its process died (SIGSEGV)"},
    "Leaves": dict.fromkeys((0, 1), "its process died (exit code 0)"),
    "Interrupts": dict.fromkeys((0, 1), "KeyboardInterrupt"),
    "Wanders": {},
    "DiesThreeTimes": {},
}


@pytest.fixture
def place(tmp_path, monkeypatch):
    (tmp_path / "bad.py").write_text(FILE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def failures(rows):
    return rows.dropna(subset="failure").groupby("trial")["failure"].first().to_dict()


def test_what_a_plug_in_does_to_its_process_costs_its_own_trials(place):
    names = ("dead-reckoning", *(f"bad.py:{name}" for name in SAID))
    study = Study(name="cells", trials=2, baseline="dead-reckoning", scenarios=(WORLD,), estimators=names)
    rows = execute(prepare(study), place / "run", jobs=2, check=False)
    alone = execute(prepare(study.replace_options(only=("dead-reckoning",))), place / "alone")
    for name, said in SAID.items():
        found = failures(rows[rows["estimator"] == f"bad.py:{name}"])
        assert set(found) == set(said), (name, found)
        assert all(line in found[trial] for trial, line in said.items()), found
    same = rows[rows["estimator"] == "dead-reckoning"].reset_index(drop=True)
    alone["ticks"] = alone["ticks"].astype(same["ticks"].dtype)  # beside rows without any, they are no whole numbers
    pd.testing.assert_frame_equal(same.drop(columns="seconds"), alone.drop(columns="seconds"))


def test_processes_that_are_kept_find_the_files_of_the_next_run_in_its_directory(place, monkeypatch):
    """They were started in the directory of the run before; and one of them died meanwhile."""
    for folder in ("first", "second"):
        (place / folder).mkdir()
        (place / folder / f"{folder}.py").write_text(FILE)
        monkeypatch.chdir(place / folder)
        names = ("dead-reckoning", f"{folder}.py:Wanders")
        study = Study(name="cells", trials=2, scenarios=(WORLD,), estimators=names)
        assert not failures(execute(prepare(study), place / folder / "run", jobs=2, check=False))
        kept = pool(BUILTIN, 2)
        os.kill(next(iter(kept._processes)), signal.SIGKILL)
        while not kept._flags.broken:
            time.sleep(0.05)


def test_a_scenario_that_hangs_costs_the_trial_where_it_does(place):
    world, names = ("bad.py:hangs[ticks=3]",), ("dead-reckoning", "ekf-local")
    study = Study(name="cells", trials=3, time_limit=1.5, scenarios=world, estimators=names)
    for _, mine in execute(prepare(study), place / "run").groupby("estimator"):
        assert list(failures(mine)) == [2]
        assert failures(mine)[2].startswith("ProcessHung: longer than the time limit of 1.5 s a trial")


def test_a_trial_that_a_scenario_cannot_have_simulated_costs_no_other(place):
    study = Study(name="cells", trials=3, scenarios=("bad.py:torn[ticks=3]", WORLD), estimators=("dead-reckoning",))
    for scenario, mine in execute(prepare(study), place / "run").groupby("scenario"):
        assert list(failures(mine)) == [2] * (scenario != WORLD)
        assert all("senses.odometry is infinite somewhere" in why for why in failures(mine).values())


def test_a_run_in_one_process_is_called_so(place):
    (place / "cells.toml").write_text(f'trials = 2\nscenarios = ["{WORLD}"]\nestimators = ["dead-reckoning"]\n')
    arguments = ("run", "cells.toml", "--out", "run", "--no-isolate")
    done = inside(*arguments, cwd=place)
    assert done.returncode == 0, done.stderr
    assert "ran in one process (--no-isolate)" in done.stdout
    assert json.loads((place / "run" / "manifest.json").read_text())["isolated"] is False
    refused = inside(*arguments, "--jobs", 2, cwd=place)
    assert refused.returncode == 2
    assert "--jobs 2 asks for others" in refused.stderr
