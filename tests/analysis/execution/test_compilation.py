"""What built-in estimators need is compiled before the trials begin: once for a version, by processes side by side."""

import pytest
from processes import parts

from cooploc.analysis.execution import workers
from cooploc.analysis.execution.run import RunProgress, execute
from cooploc.analysis.execution.workers import Task, compile_kernels
from cooploc.scenarios.studies.study import Study, resolve_study

LABELS = "dead-reckoning", "ekf-local", "ekf-local[gate=9]", "ekf-local[anchor_reading=rssi]", "ekf-joint"
STUDY = Study(
    name="small", trials=1, baseline="ekf-local", scenarios=("robots-1-3/n={2,3,1}[ticks=3]",), estimators=LABELS
)


class Order(RunProgress):
    """Remembers what was called."""

    def __init__(self):
        self.calls = []

    def compiling(self):
        self.calls.append("compiling")

    def begin(self, trials, found):
        self.calls.append("begin")


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """What was compiled: (label, scenario), a list for each process or call."""
    found = []
    monkeypatch.setattr(workers, "kept_at", lambda kernel: tmp_path / "kept")
    monkeypatch.setattr(workers, "compiled", lambda cold: found.append(_labels(cold)))
    monkeypatch.setattr(workers, "_side_by_side", lambda cold, n, owner: found.append((n, _labels(cold))))
    return found


def _labels(cold):
    return [(task.estimators[0].label, task.scenario.label, len(task.trials)) for tasks in cold for task in tasks]


def tasks(labels=LABELS):
    study = resolve_study(STUDY.with_options(only=labels))
    return [Task(one.scenario, range(5), 0, one.estimators, 60.0) for one in study.cells]


def test_each_kind_is_compiled_once_for_the_smallest_team_and_for_the_largest(asked):
    compile_kernels(tasks(), 2, lambda: None)
    teams = "robots-1-3/n=1[ticks=3]", "robots-1-3/n=3[ticks=3]"
    kinds = "dead-reckoning", "ekf-local", "ekf-local[anchor_reading=rssi]", "ekf-joint"  # a gate is a number
    ((processes, labels),) = asked
    assert processes == 2
    found = sorted((label.replace("[gate=9]", ""), *rest) for label, *rest in labels)
    assert found == sorted((kind, team, 1) for kind in kinds for team in teams)
    compile_kernels(tasks(), 2, lambda: asked.append("again"))
    assert len(asked) == 1


def test_few_are_compiled_here_and_only_what_is_new(asked):
    begun = []
    for labels in (("dead-reckoning", "ekf-local"), ("dead-reckoning", "ekf-joint")):
        compile_kernels(tasks(labels), 1, lambda: begun.append(True))
    assert [{label for label, _, _ in one} for one in asked] == [{"dead-reckoning", "ekf-local"}, {"ekf-joint"}]
    assert len(begun) == 2


def test_it_is_said_before_the_trials_begin(asked, tmp_path):
    told = Order()
    execute(STUDY, tmp_path / "run", progress=told)
    assert told.calls[:2] == ["compiling", "begin"]
    told = Order()
    execute(STUDY.with_options(seed=1), tmp_path / "other", progress=told)
    assert told.calls[0] == "begin"


@pytest.mark.slow
def test_two_processes_compile_and_the_rows_are_those_of_one(tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "kept_at", lambda kernel: tmp_path / "kept")
    execute(STUDY, tmp_path / "one")
    assert len(list((tmp_path / "kept").iterdir())) == 4
    execute(STUDY, tmp_path / "two")  # nothing is left to compile
    assert parts(tmp_path / "one") == parts(tmp_path / "two")
