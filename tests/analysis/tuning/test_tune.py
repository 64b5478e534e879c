"""`cooploc tune` from the study to the tuned study: same bits, kept evaluations, streams apart, plug-ins walled."""

import os

import pandas as pd
import pytest
from made_logs import describe, lines, write
from processes import inside, marks, parts

import cooploc as cl
from cooploc.analysis.execution.execute import Quiet
from cooploc.analysis.tuning.tune import Options, tune
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.scenario import ResolvedScenario
from cooploc.scenarios.studies.study import Study, load

STUDY = Study(
    name="small",
    trials=6,
    scenarios=("robots-1-3/n=2[ticks=8]", "nlos[ticks=6]"),
    estimators=("dead-reckoning", "ekf-local", "mrsl-rssi[particles=30]"),
)
PLUGIN = '''
"""A filter whose gate is a parameter, and which leaves a mark of every process that imports it."""
import os
from dataclasses import dataclass
from pathlib import Path

import cooploc as cl
from cooploc.estimators.ekf_local import EkfLocal

Path(__file__).with_name(f"imported-by-{os.getpid()}").touch()


@dataclass(frozen=True)
class Mine(EkfLocal):
    """Refuses some of its own values."""

    effort: int = cl.tunable(2, 1, 9)

    def __post_init__(self):
        super().__post_init__()
        if self.effort > 5:
            raise ValueError("too much effort")
'''


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """A tuning, and its folder."""
    out = tmp_path_factory.mktemp("tuned") / "out"
    return tune(STUDY, out, budget=24), out


class Interrupted(Quiet):
    """Ends the run by Ctrl-C after some parts."""

    def __init__(self, parts):
        self.left = parts

    def advance(self, what, trials, failed, share):
        self.left -= 1
        if not self.left:
            raise KeyboardInterrupt


def same(one, other):
    """Whether two tunings are equal in all but the time they took."""
    for name in ("history", "gains"):
        pd.testing.assert_frame_equal(getattr(one, name), getattr(other, name), check_exact=True)
    drop = ["seconds"]
    pd.testing.assert_frame_equal(one.rows.drop(columns=drop), other.rows.drop(columns=drop), check_exact=True)
    assert one.record == other.record
    return True


@pytest.mark.slow
def test_the_bits_do_not_depend_on_the_number_of_processes(found, tmp_path):
    assert same(found[0], tune(STUDY, tmp_path / "two", budget=24, options=Options(jobs=2)))


@pytest.mark.slow
@pytest.mark.parametrize("after", [1, 20])
def test_an_interrupted_tuning_goes_on_computes_nothing_twice_and_ends_the_same(found, tmp_path, after):
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        tune(STUDY, out, budget=24, progress=Interrupted(after))
    before = marks(out / "training")
    assert before
    assert same(found[0], tune(STUDY, out, budget=24))
    assert before.items() <= marks(out / "training").items()


@pytest.mark.slow
def test_every_evaluation_is_on_disk_and_the_same_call_computes_none(found):
    tuning, out = found
    before = marks(out / "training") | marks(out / "fresh")
    kept = cl.load_run(out / "training").rows.groupby(["scenario", "estimator", "trial"])
    assert tuning.history["trials"].sum() == len(kept)
    assert same(tuning, tune(STUDY, out, budget=24))
    assert before == marks(out / "training") | marks(out / "fresh")


@pytest.mark.slow
def test_every_estimator_has_the_same_budget_and_never_uses_more(found):
    used = found[0].history.groupby("estimator", sort=False)["trials"].sum()
    assert list(used.index) == list(STUDY.estimators)
    assert (used <= 24).all()
    assert (used.drop("dead-reckoning") > 24 - 2 * found[0].history["rounds"].max()).all()


@pytest.mark.slow
def test_tuning_simulates_no_reported_stream(tmp_path, monkeypatch):
    seeds, simulate = [], ResolvedScenario.simulate

    def watched(self, trials, seed):
        seeds.append((seed, (tmp_path / "out" / "tuned.toml").exists()))
        return simulate(self, trials, seed)

    monkeypatch.setattr(ResolvedScenario, "simulate", watched)
    tuning = tune(STUDY, tmp_path / "out", budget=8)
    assert {seed for seed, fresh in seeds if not fresh} == {tuning.record["training_seed"]}
    assert {seed for seed, fresh in seeds if fresh} == {STUDY.seed}
    assert not set(tuning.record["streams"].values()) & set(tuning.rows["stream"])


@pytest.mark.slow
def test_the_result_is_a_study_that_runs_and_gives_the_same_bits(found, tmp_path):
    tuning, out = found
    assert load(str(out / "tuned.toml")).seed == STUDY.seed
    done = inside("run", out / "tuned.toml", "--out", tmp_path / "again", "--json")
    assert done.returncode == 0, done.stderr
    again = parts(tmp_path / "again")
    assert again
    assert again.items() <= parts(out / "fresh").items()
    refused = inside("run", out / "tuned.toml", "--seed", tuning.record["training_seed"], "--out", tmp_path / "cheat")
    assert refused.returncode == 2
    assert "were tuned on the streams of seed" in refused.stderr


@pytest.mark.slow
def test_as_published_and_tuned_are_paired_on_the_same_fresh_streams(found):
    tuning = found[0]
    both = {*tuning.tuned, *tuning.tuned.values()}
    assert set(tuning.rows["estimator"]) == both
    streams = tuning.rows.groupby(["scenario", "trial"])["stream"].nunique()
    assert (streams == 1).all()
    table = tuning.gains.set_index(["scenario", "estimator"])
    unmoved = table[table["tuned"] == table.index.get_level_values("estimator")]
    assert (unmoved[["change", "fresh_gain", "training_gain"]] == 0).all(axis=None)
    assert (table["trials"] == STUDY.trials).all()


@pytest.mark.slow
def test_a_plug_in_is_tuned_in_processes_of_its_own_and_a_value_that_it_refuses_is_the_worst(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(PLUGIN)
    label = f"{file}:Mine"
    study = Study(name="p", trials=5, scenarios=("robots-1-3/n=1[ticks=8]",), estimators=(label, "ekf-local"))
    tuning = tune(study, tmp_path / "out", budget=60, options=Options(check=False))
    tried = tuning.history[tuning.history["estimator"] == label]
    refused = tried["value: effort"].astype(int) > 5
    assert refused.any()
    assert not refused.all()
    assert tried[refused]["score"].min() > tried[~refused]["score"].max()
    importers = {int(mark.name.rpartition("-")[2]) for mark in tmp_path.glob("imported-by-*")}
    assert importers
    assert os.getpid() not in importers


def test_a_recording_is_tuned_on_other_runs(tmp_path):
    describe(tmp_path)
    for seed, name in enumerate(("one", "two", "three")):
        write(tmp_path, name, lines(seed, ticks=20))
    study = Study(
        name="l",
        trials=1,
        scenarios=("log/one",),
        estimators=("ekf-local",),
        training={"log/one": ("log/two", "log/three")},
    )
    tuning = tune(study, tmp_path / "out", budget=12, options=Options(data=tmp_path))
    assert {place.partition(",")[0] for place in tuning.record["streams"]} == {"log/two", "log/three"}
    assert set(tuning.rows["scenario"]) == {"log/one"}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("quick", "--budget", "0"), "must be at least 1 trial"),
        (("quick", "--budget", "2"), "give at least --budget 3"),
        (("quick", "--estimators", ","), "estimators is empty"),
        (("quik",), "quick"),
        (("mrclam", "--budget", "9"), "is a recording"),
    ],
)
def test_what_cannot_be_tuned_is_refused_in_one_line(tmp_path, arguments, said):
    done = inside("tune", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_directory_of_something_else_is_refused(tmp_path):
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "mother.txt").touch()
    with pytest.raises(BadInput, match="not the directory of a tuning"):
        tune(STUDY, tmp_path / "letters", budget=8)


def test_the_command_says_what_was_chosen_what_it_bought_and_what_became_of_the_order(tmp_path):
    study = tmp_path / "mine.toml"
    study.write_text(
        'trials = 5\nscenarios = ["robots-1-3/n=1[ticks=6]"]\nestimators = ["ekf-local", "dead-reckoning"]\n'
    )
    done = inside("tune", study, "--budget", "20", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for word in ("as published", "training gain", "fresh gain", "reversed", "training seed", "cooploc run"):
        assert word in done.stdout
    folder = tmp_path / "runs" / "mine-seed1-tuned"
    again = cl.load_tuned(folder)
    assert list(again.tuned) == ["ekf-local", "dead-reckoning"]
    assert set(again.order()["became"]) <= {"kept", "reversed", "appeared", "vanished", "open"}
    assert again.table["fresh_gain"].notna().all()
    assert {"score-against-budget.png", "parameters-ekf-local.png"} <= {f.name for f in folder.iterdir()}
    assert {"tuned.toml", "tuning.json", "history.csv", "published-and-tuned.csv"} <= {f.name for f in folder.iterdir()}
