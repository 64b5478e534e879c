"""What an estimator learned is part of what it is: hashed with its source, and tables say what it was trained on."""

import pytest
from processes import Log

import cooploc as cl
from cooploc.analysis.execution.run import execute, prepare
from cooploc.analysis.execution.run_directory import RunDir, read_run
from cooploc.analysis.metrics.ranking import short_certificate
from cooploc.analysis.tuning.tune import derived_seed
from cooploc.scenarios.studies.study import Study

PLUGIN = """
from typing import ClassVar
from cooploc.estimators.dead_reckoning import DeadReckoning

class Learned(DeadReckoning):
    artifacts: ClassVar[tuple[str, ...]] = ("weights.npz",)
    trained_on = "nlos, 5 trials; no more"

class Plain(DeadReckoning):
    pass
"""


@pytest.mark.slow
@pytest.mark.parametrize("edited", ["weights.npz", "mine.py"])
def test_a_run_says_it_and_computes_again_with_other_weights_or_another_source(tmp_path, edited):
    (tmp_path / "mine.py").write_text(PLUGIN)
    (tmp_path / "weights.npz").write_bytes(b"0.25")
    learned, plain = (f"{tmp_path}/mine.py:{name}" for name in ("Learned", "Plain"))
    study = Study(name="s", trials=2, scenarios=("robots-1-3/n=1[ticks=3]",), estimators=(learned, plain, "arl"))
    for _ in range(2):
        execute(prepare(study), tmp_path / "run", check=False)
    lines = read_run(tmp_path / "run").rows.groupby("estimator")["certificate"].first()
    assert short_certificate(lines[learned]) == "unchecked; trained on nlos, 5 trials, no more"
    assert short_certificate(lines[plain]) == "unchecked"
    assert RunDir(tmp_path / "run").manifest["certificates"][learned]["trained_on"]
    with (tmp_path / edited).open("a") as file:
        file.write("\n")
    before = {file.name: file.read_bytes() for file in (tmp_path / "run/parts").iterdir()}
    with pytest.raises(cl.BadInput, match="run holds a run with another seed"):
        execute(prepare(study.replace_options(seed=9)), tmp_path / "run", check=False)
    assert before == {file.name: file.read_bytes() for file in (tmp_path / "run/parts").iterdir()}
    fewer = study.replace_options(only=(plain, "arl"))
    execute(prepare(fewer), tmp_path / "run", check=False, progress=(log := Log()))
    assert any("mine.py was changed: its results are computed again" in line for line in log.said)
    assert log.began == (4, 2)
    kept = {file.name: file.read_bytes() for file in (tmp_path / "run/replaced").glob("*/*.parquet")}
    assert kept == {name: content for name, content in before.items() if "mine" in name}
    run = read_run(tmp_path / "run")
    assert run.rows.groupby("estimator")["trial"].nunique().to_dict() == {plain: 2, "arl": 2}
    assert not run.gaps


def test_training_streams_are_of_the_seed_that_tuning_uses_and_never_of_the_study():
    _, stream = cl.training("robots-1-3/n=1[ticks=3]", 2, seed=5)
    assert stream.seed == derived_seed(5, "training")
    judged = cl.simulate("robots-1-3/n=1[ticks=3]", trials=2, seed=5)[1]
    assert not set(stream.hashes) & set(judged.hashes)
