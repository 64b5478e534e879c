"""What an estimator learned is part of what it is: hashed with its source, and tables say what it was trained on."""

import numpy as np
import pytest

import cooploc as cl
from cooploc.analysis.execution.provenance import files
from cooploc.analysis.execution.run import execute, prepare
from cooploc.analysis.execution.run_directory import RunDir, read_run
from cooploc.analysis.metrics.ranking import short_certificate
from cooploc.analysis.tuning.tune import derived_seed
from cooploc.estimators import configure
from cooploc.scenarios.studies.study import Study

PLUGIN = """
from pathlib import Path
from typing import ClassVar
import numpy as np
from cooploc.estimators.dead_reckoning import DeadReckoning

class Learned(DeadReckoning):
    artifacts: ClassVar[tuple[str, ...]] = ("weights.npz",)
    trained_on = "nlos, 5 trials; no more"

    def init(self, prior, world, rows):
        self_shift = float(np.load(Path(__file__).with_name("weights.npz"))["shift"])
        s = super().init(prior, world, rows)
        return s._replace(x=s.x + self_shift)

class Plain(DeadReckoning):
    pass
"""


@pytest.fixture
def plugin(tmp_path):
    (tmp_path / "mine.py").write_text(PLUGIN)
    np.savez(tmp_path / "weights.npz", shift=0.25)
    return tmp_path / "mine.py"


def hashed(plugin):
    return files([configure(f"{plugin}:Learned")])


def test_other_weights_are_another_estimator(plugin):
    before = hashed(plugin)
    assert hashed(plugin) == before
    np.savez(plugin.with_name("weights.npz"), shift=0.5)
    assert hashed(plugin) != before


def test_a_run_says_it_and_is_not_continued_with_other_weights(plugin, tmp_path):
    label = f"{plugin}:Learned"
    study = Study(name="s", trials=2, scenarios=("robots-1-3/n=1[ticks=3]",), estimators=(label, f"{plugin}:Plain"))
    execute(prepare(study), tmp_path / "run", check=False)
    lines = read_run(tmp_path / "run").rows.groupby("estimator")["certificate"].first()
    assert short_certificate(lines[label]) == "unchecked; trained on nlos, 5 trials, no more"
    assert short_certificate(lines[f"{plugin}:Plain"]) == "unchecked"
    assert RunDir(tmp_path / "run").manifest["certificates"][label]["trained_on"]
    np.savez(plugin.with_name("weights.npz"), shift=0.5)
    with pytest.raises(cl.BadInput, match=r"mine\.py"):
        execute(prepare(study), tmp_path / "run", check=False)


def test_training_streams_are_of_the_seed_that_tuning_uses_and_never_of_the_study():
    _, stream = cl.training("robots-1-3/n=1[ticks=3]", 2, seed=5)
    assert stream.seed == derived_seed(5, "training")
    judged = cl.simulate("robots-1-3/n=1[ticks=3]", trials=2, seed=5)[1]
    assert not set(stream.hashes) & set(judged.hashes)
