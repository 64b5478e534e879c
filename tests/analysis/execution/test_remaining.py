"""The time left is honest within a factor of two from the first fifth on, whatever the parts of a study cost."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from cooploc.analysis.execution.run import Remaining
from cooploc.analysis.execution.run_directory import PartKey
from cooploc.analysis.execution.workers import MeasuredPart, Task
from cooploc.scenarios.studies.study import Study, resolve_study
from cooploc.terminal import console

QUICK = {"robots-1-3/n=1": 0.71, "robots-1-3/n=3": 1.0, "packet-drop/drop=0.7": 1.36}  # [s] of a part that was timed
EACH = "ekf-local", "ekf-naive", "ekf-ci", "arl", "ekf-luft", "ekf-split-ci", "ekf-joint"


def tasks(scenarios, estimators=EACH, trials=20, chunks=1):
    study = Study(name="timed", trials=trials, baseline="ekf-local", scenarios=tuple(scenarios), estimators=estimators)
    cells = resolve_study(study).cells
    return [Task(one.scenario, range(trials), k, one.estimators, 60.0) for one in cells for k in range(chunks)]


def parts(tasks, seconds):
    """Every part of the tasks, with the scenario and the seconds that it takes."""
    for task in tasks:
        for estimator in task.estimators:
            took, ticks = seconds(task, estimator.label), task.scenario.ticks
            frame = pd.DataFrame({"ticks": [ticks] * len(task.trials)})
            part = MeasuredPart(
                PartKey(task.scenario.label, estimator.label, task.trials), frame, took / ticks / len(task.trials)
            )
            yield part, task.scenario, took


def ratios(asked, seconds, monkeypatch, begin=0.2):
    """The time left that is shown, as a share of the true one, after each part from the first fifth on."""
    clock = [0.0]
    monkeypatch.setattr(console, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    shown, remaining, done = console.TerminalProgress(), Remaining(asked), list(parts(asked, seconds))
    total = sum(took for *_, took in done)
    shown.begin(len(done), 0)
    for part, scenario, took in done[:-1]:
        clock[0] += took
        shown.advance("", 1, 0, remaining.share_after(part, scenario))
        if clock[0] > begin * total:
            yield shown.seconds_left() / (total - clock[0])


def test_of_a_quick_run(monkeypatch):
    found = list(ratios(tasks(QUICK), lambda task, label: QUICK[task.scenario.label], monkeypatch))
    assert len(found) > 10
    assert all(0.5 < one < 2 for one in found)


def test_where_one_estimator_takes_longer_than_all_others_and_comes_last(monkeypatch):
    found = ratios(tasks(QUICK, chunks=5), lambda _, label: 20.0 if label == "ekf-joint" else 1.0, monkeypatch)
    assert all(0.5 < one < 2 for one in found)


def test_where_the_last_scenarios_are_short(monkeypatch):
    """Ten times the team for a tenth of the ticks: a tick of a large team takes longer, the trial does not."""
    asked = tasks(["scalability/n=5[ticks=200]", "scalability/n=50[ticks=20]"], chunks=3)
    cost = {5: 1.0, 50: 1.5}
    found = ratios(asked, lambda task, label: cost[task.scenario.robots], monkeypatch)
    assert all(0.5 < one < 2 for one in found)


def test_a_part_that_failed_says_nothing_about_time():
    asked = tasks(["robots-1-3/n=1"])
    remaining, done = Remaining(asked), list(parts(asked, lambda *_: 1.0))
    first, scenario, _ = done[0]
    assert remaining.share_after(first._replace(seconds=np.nan), scenario) == 0
    shares = [remaining.share_after(part, scenario) for part, *_ in done[1:]]
    assert shares == pytest.approx([k / 6 for k in range(1, 7)])
