"""Running a study: the same bits for any number of processes, whatever was there before, and failures kept apart."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
import pytest
from processes import Log, marks, parts

import cooploc as cl
from cooploc import estimators
from cooploc.analysis.execution import run
from cooploc.analysis.execution.run import execute, prepare
from cooploc.analysis.execution.run_directory import PartKey
from cooploc.analysis.execution.workers import split_tasks
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.scenarios.studies.study import Study

STUDY = Study(
    name="small",
    trials=12,
    baseline="dead-reckoning",
    scenarios=("trajectory[ticks=15]", "packet-drop/drop=0.5[ticks=10]"),
    estimators=("dead-reckoning", "mrsl-rssi[particles=40]", "ekf-joint"),
)


@pytest.fixture(autouse=True, scope="module")
def small_chunks():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "CHUNK_TRIALS", (10, 10))
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory, small_chunks):
    folder = tmp_path_factory.mktemp("runs") / "one"
    return folder, execute(prepare(STUDY), folder)


@pytest.mark.slow
def test_two_processes_give_the_bits_of_one(finished, tmp_path):
    folder, rows = finished
    again = execute(prepare(STUDY), tmp_path / "two", jobs=2)
    assert parts(tmp_path / "two") == parts(folder)
    pd.testing.assert_frame_equal(again.drop(columns="seconds"), rows.drop(columns="seconds"))


def test_few_tasks_are_halved_and_lose_nothing():
    (one, *_) = run.make_tasks(prepare(STUDY), (), (), isolate=True)
    halves = split_tasks([one], 2)
    assert [len(task.estimators) for task in halves] == [2, 1]
    pieces = split_tasks([one], 9)
    assert sorted(task.estimators[0].label for task in pieces) == sorted(STUDY.estimators)
    assert split_tasks([one] * 3, 3) == [one] * 3
    assert split_tasks([], 3) == []


def test_rows_are_those_of_the_library_calls(finished):
    _, rows = finished
    truth, stream = cl.simulate("trajectory[ticks=15]", trials=12, seed=STUDY.seed)
    run = cl.run({name: cl.make(name) for name in STUDY.estimators}, stream)
    mine = cl.errors(truth, run).drop(columns="seconds")
    theirs = rows[rows["scenario"] == "trajectory[ticks=15]"][mine.columns].reset_index(drop=True)
    pd.testing.assert_frame_equal(theirs, mine, check_dtype=False)


def test_what_is_there_is_not_computed_again(finished):
    folder, rows = finished
    before, told = marks(folder), Log()
    again = execute(prepare(STUDY), folder, progress=told)
    assert marks(folder) == before
    assert (told.computed, told.began) == ([], (2 * 12 * 3, 2 * 12 * 3))
    pd.testing.assert_frame_equal(again, rows)


def test_an_added_estimator_and_a_lost_part_are_all_that_runs(tmp_path, capsys):
    whole = STUDY.replace_options(only=("dead-reckoning", "arl[particles=30]"))
    folder = tmp_path / "run"
    execute(prepare(STUDY.replace_options(only=("dead-reckoning",))), folder)
    piece = PartKey("trajectory[ticks=15]", "dead-reckoning", range(10, 12))
    lost = folder / "parts" / f"{piece.name}.parquet"
    kept = lost.read_bytes()
    lost.write_bytes(kept[:100])
    cl.show(folder)
    said = capsys.readouterr().out
    assert all(words in said for words in ("1 corrupt part, will be computed", "finished"))  # a cell may take lines
    told = Log()
    execute(prepare(whole), folder, progress=told)
    assert [line for line in told.said if piece.name in line]
    assert ("small · trajectory[ticks=15] · dead-reckoning", 2) in told.computed
    assert sum(trials for what, trials in told.computed if what.endswith("dead-reckoning")) == 2
    assert sum(trials for what, trials in told.computed if "arl" in what) == 24
    assert lost.read_bytes() == kept


@pytest.mark.slow
def test_more_trials_compute_only_what_is_new_and_fewer_nothing(tmp_path, finished):
    folder = tmp_path / "run"
    small = STUDY.replace_options(only=("dead-reckoning",), trials=7)
    execute(prepare(small), folder)
    told = Log()
    rows = execute(prepare(small.replace_options(trials=12)), folder, progress=told)
    assert sum(trials for _, trials in told.computed) == 2 * 5
    whole = finished[1][finished[1]["estimator"] == "dead-reckoning"].reset_index(drop=True)
    pd.testing.assert_frame_equal(rows.drop(columns="seconds"), whole.drop(columns="seconds"))
    told = Log()
    fewer = execute(prepare(small.replace_options(trials=3)), folder, progress=told)
    assert (told.computed, told.began) == ([], (6, 6))
    assert sorted(set(fewer["trial"])) == [0, 1, 2]


def test_a_directory_of_another_seed_is_refused_and_new_scenarios_are_not(tmp_path):
    small, more = STUDY.replace_options(only=("dead-reckoning",)), ("trajectory[ticks=15]", "trajectory[ticks=14]")
    execute(prepare(small.replace_options(scenarios=more[:1])), tmp_path)
    assert set(execute(prepare(small.replace_options(scenarios=more)), tmp_path)["scenario"]) == set(more)
    with pytest.raises(cl.BadInput, match="another seed"):
        execute(prepare(small.replace_options(seed=9)), tmp_path)


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("thesis.txt", "precious", "is not a run directory"),
        ("manifest.json", '{"format": 99}', "format 99"),
        ("manifest.json", "{", "is damaged"),
    ],
)
def test_foreign_newer_and_damaged_directories_are_refused_and_left(tmp_path, file, text, said):
    (tmp_path / file).write_text(text)
    with pytest.raises(cl.BadInput, match=said):
        execute(prepare(STUDY), tmp_path)
    assert (tmp_path / file).read_text() == text


@dataclass(frozen=True)
class Moody(DeadReckoning):
    """Fails in some trials: raises in trial 3, returns nan in trial 5."""

    def init(self, prior, world, rows):
        if (rows.trial == 3).any():
            raise RuntimeError("three is too much")
        return super().init(prior._replace(x=np.where((rows.trial == 5)[:, None], np.nan, prior.x)), world, rows)


def test_a_failing_trial_costs_no_other_and_runs_again_on_request(tmp_path, monkeypatch):
    monkeypatch.setitem(estimators.BUILTIN, "moody", (f"{__name__}:Moody", {}))
    asked = prepare(STUDY.replace_options(only=("dead-reckoning", "moody")))
    rows = execute(asked, tmp_path / "run")
    moody = rows[(rows["estimator"] == "moody") & (rows["scenario"] == "trajectory[ticks=15]")]
    failures = moody.dropna(subset="failure").groupby("trial")["failure"].first()
    assert list(failures.index) == [3, 5]
    assert "RuntimeError: three is too much" in failures[3]
    assert "not finite" in failures[5]
    good = moody[moody["failure"].isna()].set_index(["trial", "robot"])["mse"]
    steady = rows[(rows["estimator"] == "dead-reckoning") & (rows["scenario"] == "trajectory[ticks=15]")]
    pd.testing.assert_series_equal(good, steady.set_index(["trial", "robot"])["mse"].loc[good.index])
    assert cl.summarize(rows).set_index(["scenario", "estimator"]).loc[("trajectory[ticks=15]", "moody"), "failed"] == 2
    monkeypatch.setattr(Moody, "init", DeadReckoning.init)  # it runs again on request alone
    told = Log()
    again = execute(asked, tmp_path / "run", progress=told)
    pd.testing.assert_frame_equal(again.drop(columns="seconds"), rows.drop(columns="seconds"), check_dtype=False)
    assert told.computed == []
    assert execute(asked, tmp_path / "run", progress=told, retry_failed=True)["failure"].isna().all()
    assert sum(trials for _, trials in told.computed) == 2 * 10
    assert {what.rpartition(" ")[2] for what, _ in told.computed} == {"moody"}


def test_what_cannot_run_is_refused_before_anything_is_written(tmp_path):
    camera = STUDY.replace_options(scenarios=("trajectory", "camera/n=2"))
    said = r"mrsl-rssi\[particles=40\] needs channel 'radio_rssi'; scenario 'camera/n=2' has"
    with pytest.raises(cl.IncompatibleEstimator, match=said):
        execute(prepare(camera), tmp_path / "run")
    with pytest.raises(cl.BadInput, match="not one of its estimators"):
        execute(prepare(STUDY.replace_options(baseline="arl")), tmp_path / "run")
    with pytest.raises(cl.BadInput, match="jobs is 0"):
        execute(prepare(STUDY), tmp_path / "run", jobs=0)
    assert not (tmp_path / "run").exists()
