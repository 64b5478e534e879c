"""`cooploc tune`: streams apart, the same bits, kept evaluations, plug-ins in their own process, the order compared."""

import os
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_logs import describe, lines, write
from processes import Log, inside, marks, parts

import cooploc as cl
from cooploc.analysis.report.result_tables import order_sentence
from cooploc.analysis.tuning.tune import as_toml, derived_seed, lanes, order, overlap, tune, tuned_study
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.scenario import ResolvedScenario
from cooploc.scenarios.studies.study import Study, load, resolve_study


@pytest.fixture
def data(tmp_path):
    """A lab's log of four runs, one of which is a copy of another under another name."""
    describe(tmp_path)
    for seed, name in enumerate(("one", "two", "three")):
        write(tmp_path, name, lines(seed, ticks=20))
    write(tmp_path, "copy", lines(0, ticks=20))
    return tmp_path


def trained(judged, training, data):
    asked = Study(name="s", scenarios=judged, estimators=("ekf-local",), training=training)
    return lanes(resolve_study(asked, data).cells, asked.training, data)


def test_the_training_seed_is_another_one_and_the_sampler_s_a_third():
    derived = [derived_seed(seed, purpose) for seed in range(2000) for purpose in ("training", "sampler")]
    assert len({*range(2000), *derived}) == 3 * 2000


def test_a_recording_is_not_tuned_on_unless_the_study_says_on_which_other(data):
    with pytest.raises(BadInput, match="the run that is judged is refused"):
        trained(("log/one",), {}, data)
    lane = trained(("log/one",), {"log/one": ("log/two", "log/three")}, data)["log/one"]
    assert [lane.item(k).scenario for k in range(4)] == ["log/two", "log/three", "log/two", "log/three"]


def test_a_study_with_nothing_to_tune_is_refused_before_anything_runs(tmp_path):
    study = STUDY.model_copy(update={"estimators": ("dead-reckoning",), "baseline": "dead-reckoning"})
    with pytest.raises(
        BadInput, match=r"^dead-reckoning declares no parameters to tune .*: name an estimator that does"
    ):
        tune(study, tmp_path / "out", budget=8)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("other", ["log/one", "log/all", "log/copy", "log/one[position_sd=0.3]"])
def test_the_judged_run_is_recognised_under_other_names(data, other):
    with pytest.raises(BadInput, match="which is judged"):
        trained(("log/one",), {"log/one": (other,)}, data)


def test_parts_of_one_recording_are_apart_where_their_times_are():
    streams = [cl.simulate("robots-1-3/n=1[ticks=20]", trials=1, seed=seed)[1] for seed in (1, 2)]
    first, second = (replace(stream, notes={"recording": "same"}) for stream in streams)
    later = replace(second, time=second.time + (first.time[-1] - second.time[0]) + float(second.senses.dt[0, 0, 0]))
    assert overlap(first, second)
    assert not overlap(first, later)
    assert overlap(first, replace(later, time=later.time - 0.5))
    assert not overlap(first, replace(second, notes={"recording": "another"}))
    assert overlap(first, replace(second, notes={}))  # who does not say its name may be the same


STUDY = Study(
    name="small",
    trials=6,
    scenarios=("robots-1-3/n=2[ticks=8]", "nlos[ticks=6]"),
    estimators=("dead-reckoning", "ekf-local", "mrsl-rssi[particles=30]"),
)


PLUGIN = """
import os
from dataclasses import dataclass
from pathlib import Path

import cooploc as cl
from cooploc.estimators.ekf_local import EkfLocal

Path(__file__).with_name(f"imported-by-{os.getpid()}").touch()


@dataclass(frozen=True)
class Mine(EkfLocal):
    effort: int = cl.tunable(2, 1, 9)

    def __post_init__(self):
        super().__post_init__()
        if self.effort > 5:
            raise ValueError("too much effort")
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """A tuning, and its folder."""
    out = tmp_path_factory.mktemp("tuned") / "out"
    return tune(STUDY, out, budget=24), out


def same(one, other):
    """Whether two tunings are equal in all but the time they took."""
    for name in ("history", "table"):
        pd.testing.assert_frame_equal(getattr(one, name), getattr(other, name), check_exact=True)
    drop = ["seconds"]
    pd.testing.assert_frame_equal(one.rows.drop(columns=drop), other.rows.drop(columns=drop), check_exact=True)
    assert one.record == other.record
    return True


@pytest.mark.slow
@pytest.mark.parametrize(("after", "jobs"), [(1, 2), (20, 1)])
def test_an_interrupted_tuning_goes_on_computes_nothing_twice_and_ends_the_same(found, tmp_path, after, jobs):
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        tune(STUDY, out, budget=24, progress=Log(after))
    before = marks(out / "training")
    assert before
    assert same(found[0], tune(STUDY, out, budget=24, jobs=jobs))
    assert before.items() <= marks(out / "training").items()


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
@pytest.mark.parametrize("which", ["shipped", "tuned"])
def test_the_table_ranks_the_estimators_of_each_scenario_by_their_error(found, which):
    for _, part in found[0].table.groupby("scenario"):
        rmse = part[f"rmse_{which}"].to_numpy()
        assert part[f"rank_{which}"].tolist() == [1 + (rmse < one).sum() for one in rmse]


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
def test_a_plug_in_is_tuned_in_processes_of_its_own_and_a_value_that_it_refuses_is_the_worst(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(PLUGIN)
    label = f"{file}:Mine"
    study = Study(name="p", trials=5, scenarios=("robots-1-3/n=1[ticks=8]",), estimators=(label, "ekf-local"))
    tuning = tune(study, tmp_path / "out", budget=60, check=False)
    tried = tuning.history[tuning.history["estimator"] == label]
    refused = tried["value: effort"].astype(int) > 5
    assert refused.any()
    assert not refused.all()
    assert tried[refused]["score"].min() > tried[~refused]["score"].max()
    assert list(tmp_path.glob("imported-by-*"))
    assert not (tmp_path / f"imported-by-{os.getpid()}").exists()


@pytest.mark.slow
def test_a_recording_is_tuned_on_other_runs(data):
    other = {"log/one": ("log/two", "log/three")}
    study = Study(name="l", trials=1, scenarios=("log/one",), estimators=("ekf-local",), training=other)
    tuning = tune(study, data / "out", budget=12, data=data)
    assert {place.partition(",")[0] for place in tuning.record["streams"]} == {"log/two", "log/three"}
    assert set(tuning.rows["scenario"]) == {"log/one"}


@pytest.mark.slow
def test_the_command_says_what_was_chosen_what_it_bought_and_what_became_of_the_order(tmp_path):
    study = tmp_path / "mine.toml"
    study.write_text(
        'trials = 5\nscenarios = ["robots-1-3/n=1[ticks=6]"]\nestimators = ["ekf-local", "dead-reckoning"]\n'
    )
    done = inside("tune", study, "--budget", "20", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for word in ("as shipped", "training gain", "fresh gain", "reversed", "training seed", "cooploc run"):
        assert word in done.stdout
    folder = tmp_path / "runs" / "mine-seed1-tuned"
    again = cl.load_tuned(folder)
    assert list(again.tuned) == ["ekf-local", "dead-reckoning"]
    assert again.table["fresh_gain"].notna().all()
    files = "score-against-budget.png parameters-ekf-local.png tuned.toml tuning.json history.csv"
    assert {*files.split(), "shipped-and-tuned.csv"} <= {file.name for file in folder.iterdir()}


def test_an_order_that_tuning_reverses_is_called_reversed_and_one_that_it_hides_vanishes(rng):
    levels = {"a": 1, "b": 2, "c": 4, "a[t=1]": 3, "b[t=1]": 2, "c[t=1]": 3}
    rows = pd.DataFrame([{"estimator": name, "mse": mse} for name, mse in levels.items()] * 30)
    rows = rows.assign(scenario="s", trial=np.arange(30).repeat(6), robot=0, ticks=5, nll=0.0, failure=None)
    rows["mse"] *= rng.uniform(0.9, 1.1, 30).repeat(6) * rng.uniform(0.97, 1.03, 180)
    table = order(rows, {name: f"{name}[t=1]" for name in "abc"}).set_index(["a", "b"])
    assert table.loc[("a", "b"), "became"] == "reversed"
    assert table.loc[("b", "c"), "became"] == "kept"
    assert table.loc[("a", "c"), "shipped"] == "a"
    assert "of 3 pairs of estimators in a scenario tuning reversed a significant order in 1" in order_sentence(
        table, "RMSE"
    )


def test_a_tuned_study_is_written_and_read_back_as_it_is(tmp_path):
    study = Study(
        name="mine", about='what "it" asks', scenarios=("nlos", "trajectory"), estimators=("arl", "ekf-local"),
        training={"nlos": ("trajectory",)},
    )  # fmt: skip
    tuned = tuned_study(study, {"arl": "arl[K=2]", "ekf-local": "ekf-local"}, 99, both=False)
    (tmp_path / "tuned.toml").write_text(as_toml(tuned), encoding="utf-8")
    again = load(str(tmp_path / "tuned.toml"))
    assert again.cells() == tuned.cells()
    assert (again.about, again.tuned_with, again.training) == (study.about, 99, study.training)
    both = tuned_study(study, {"arl": "arl[K=2]", "ekf-local": "ekf-local"}, 99, both=True)
    assert {cell.estimators for cell in both.cells()} == {("arl", "arl[K=2]", "ekf-local")}
