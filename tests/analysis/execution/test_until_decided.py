"""Runs that stop what is decided: the same however many processes, whatever interrupts them, whatever was there."""

import pytest
from processes import Log, parts

from cooploc.analysis.execution import run
from cooploc.analysis.execution.run import Answers, execute, prepare, run_until_decided
from cooploc.analysis.execution.run_directory import read_decisions
from cooploc.scenarios.studies.study import Study

WORLD = "trajectory[ticks=12]"
STUDY = Study(
    name="small",
    trials=40,
    baseline="arl[particles=20]",
    scenarios=(WORLD,),
    estimators=("arl[particles=20]", "dead-reckoning", "ekf-local"),
)
CLEAR, CLOSE = "dead-reckoning", "ekf-local"


@pytest.fixture(autouse=True, scope="module")
def small_chunks():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "CHUNK_TRIALS", (10, 10))
        yield


def contents(folder):
    return parts(folder), (folder / "decisions.json").read_text()


@pytest.fixture(scope="module")
def finished(tmp_path_factory, small_chunks):
    folder, told = tmp_path_factory.mktemp("runs") / "one", Log()
    return folder, run_until_decided(prepare(STUDY), folder, progress=told), told.said


def test_what_is_decided_stops_and_what_is_open_goes_on_with_its_baseline(finished):
    folder, rows, told = finished
    trials = rows.groupby("estimator")["trial"].nunique()
    verdicts = {one["estimator"]: one for one in read_decisions(folder)["comparison"]}
    assert verdicts[CLEAR]["verdict"] != "open"
    assert trials[CLEAR] == verdicts[CLEAR]["look"] < 40
    assert verdicts[CLOSE]["verdict"] == "open"
    assert trials[CLOSE] == trials[STUDY.baseline] == 40
    said = [line for line in told if line.startswith("after ")]
    assert "1 open, at most about" in said[-2]
    assert said[-1] == "after 40 trials: decided 1 of 2 comparisons"


@pytest.mark.slow
def test_two_processes_give_the_parts_and_decisions_of_one(finished, tmp_path):
    run_until_decided(prepare(STUDY), tmp_path / "two", jobs=2)
    assert contents(tmp_path / "two") == contents(finished[0])


@pytest.mark.slow
@pytest.mark.parametrize("after", [1, 4, 6])
def test_an_interrupted_run_ends_as_if_it_had_not_been(finished, tmp_path, after):
    with pytest.raises(KeyboardInterrupt):
        run_until_decided(prepare(STUDY), tmp_path / "run", progress=Log(after))
    run_until_decided(prepare(STUDY), tmp_path / "run")
    assert contents(tmp_path / "run") == contents(finished[0])


@pytest.mark.slow
def test_trials_that_were_there_before_change_no_decision(finished, tmp_path):
    execute(prepare(STUDY), tmp_path / "run")
    rows = run_until_decided(prepare(STUDY), tmp_path / "run")
    assert read_decisions(tmp_path / "run") == read_decisions(finished[0])
    assert len(rows) == len(finished[1])


@pytest.mark.slow
def test_another_open_question_keeps_its_cells_running(tmp_path):
    def ask(rows, n):
        cells = {(WORLD, CLEAR)} if n < 40 else set()
        return Answers("claim", frozenset(cells), 0, len(cells), [])

    rows = run_until_decided(prepare(STUDY), tmp_path / "run", [ask])
    assert rows.groupby("estimator")["trial"].nunique()[CLEAR] == 40


def test_a_baseline_alone_leaves_nothing_to_decide(tmp_path):
    told = Log()
    alone = STUDY.model_copy(update={"estimators": ("dead-reckoning",), "baseline": "dead-reckoning"})
    run_until_decided(prepare(alone), tmp_path / "run", progress=told)
    assert told.said[-1] == "after 10 trials: decided nothing, as no estimator stands beside the baseline"
