"""Tuning never sees a reported stream: seeds, recordings, and what tries to get around it."""

from dataclasses import replace

import numpy as np
import pytest
from made_logs import describe, lines, write

import cooploc as cl
from cooploc.analysis.tuning.search import demand_apart, derived_seed, lanes, overlap
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios.studies import study
from cooploc.scenarios.studies.study import Study, resolve_study


@pytest.fixture
def data(tmp_path):
    """A lab's log of four runs, one of which is a copy of another under another name."""
    describe(tmp_path)
    for seed, name in enumerate(("one", "two", "three")):
        write(tmp_path, name, lines(seed))
    write(tmp_path, "copy", lines(0))
    return tmp_path


def trained(judged, training, data):
    asked = Study(name="s", scenarios=judged, estimators=("ekf-local",), training=training)
    return lanes(resolve_study(asked, data).cells, asked.training, data, True)


def test_the_training_seed_is_another_one_and_the_sampler_s_a_third():
    for seed in range(2000):
        assert len({seed, derived_seed(seed, "training"), derived_seed(seed, "sampler")}) == 3
    assert len({derived_seed(seed, "training") for seed in range(2000)}) == 2000


def test_training_streams_and_reported_ones_have_no_hash_in_common():
    seen = {
        seed: set(cl.simulate("robots-1-3/n=1[ticks=3]", trials=50, seed=seed)[1].hashes)
        for seed in (7, derived_seed(7, "training"))
    }
    assert not set.intersection(*seen.values())


def test_results_of_which_tuning_saw_a_stream_are_refused():
    demand_apart(5, 1, ["a", "b"], ["c"])
    with pytest.raises(BadInput, match="has seen 1 of the reported streams"):
        demand_apart(5, 1, ["a", "b"], ["b", "c"])
    with pytest.raises(BadInput, match="choose another seed"):
        demand_apart(5, 5, ["a"], ["b"])


def test_a_recording_is_not_tuned_on_unless_the_study_says_on_which_other(data):
    with pytest.raises(BadInput, match="the run that is judged is refused"):
        trained(("log/one",), {}, data)
    lane = trained(("log/one",), {"log/one": ("log/two", "log/three")}, data)["log/one"]
    assert [lane.item(k).scenario for k in range(4)] == ["log/two", "log/three", "log/two", "log/three"]


@pytest.mark.parametrize("other", ["log/one", "log/all", "log/copy", "log/one[position_sd=0.3]"])
def test_the_judged_run_is_recognised_under_other_names(data, other):
    with pytest.raises(BadInput, match="which is judged"):
        trained(("log/one",), {"log/one": (other,)}, data)


def test_a_run_that_another_scenario_of_the_study_judges_is_refused_too(data):
    with pytest.raises(BadInput, match="would use readings of 'log/two'"):
        trained(("log/one", "log/two"), {"log/one": ("log/two",), "log/two": ("log/three",)}, data)


def test_parts_of_one_recording_are_apart_where_their_times_are():
    streams = [cl.simulate("robots-1-3/n=1[ticks=20]", trials=1, seed=seed)[1] for seed in (1, 2)]
    first, second = (replace(stream, notes={"recording": "same"}) for stream in streams)
    later = replace(second, time=second.time + (first.time[-1] - second.time[0]) + float(second.senses.dt[0, 0, 0]))
    assert overlap(first, second)
    assert not overlap(first, later)
    assert overlap(first, replace(later, time=later.time - 0.5))
    assert not overlap(first, replace(second, notes={"recording": "another"}))
    assert overlap(first, replace(second, notes={}))  # who does not say its name may be the same


def test_a_scenario_may_be_judged_only(data):
    found = trained(("log/one", "trajectory"), {"log/one": ()}, data)
    assert list(found) == ["trajectory"]


def test_training_that_names_no_scenario_of_the_study_is_refused(data):
    with pytest.raises(BadInput, match="not a scenario of the study"):
        trained(("trajectory",), {"nlos": ("robots-1-3",)}, data)


def test_a_study_of_tuned_estimators_refuses_the_seed_of_their_training(tmp_path):
    file = tmp_path / "tuned.toml"
    file.write_text('scenarios = ["trajectory"]\nestimators = ["arl"]\ntuned_with = 11\n')
    assert study.load(str(file)).with_options(seed=12).seed == 12
    with pytest.raises(BadInput, match="tuned on the streams of seed 11"):
        study.load(str(file)).with_options(seed=11)


def test_a_study_that_includes_another_has_its_training(tmp_path):
    (tmp_path / "real.toml").write_text(
        'scenarios = ["log/one"]\nestimators = ["arl"]\n[training]\n"log/one" = ["log/two"]\n'
    )
    both = tmp_path / "both.toml"
    both.write_text(f'include = ["{tmp_path / "real.toml"}"]\nscenarios = ["nlos"]\nestimators = ["arl"]\n')
    assert study.load(str(both)).training == {"log/one": ("log/two",)}


@pytest.mark.slow
def test_the_split_of_the_shipped_study_of_mrclam_keeps_its_parts_apart():
    found = study.load("paper-fair-mrclam").training
    for judged, parts in found.items():
        assert "start=300" in judged
        ends = [sum(float(x.partition("=")[2]) for x in part.split("[")[1].rstrip("]").split(",")) for part in parts]
        assert np.max(ends) <= 300
