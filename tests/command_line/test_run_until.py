"""`cooploc run --until-decided` and `cl.run_study(..., max_trials=...)`: one run, its table, `show`, and verdicts."""

import pytest

import cooploc as cl

STUDY = """
trials = 10
baseline = "arl[particles=20]"
scenarios = ["trajectory[ticks=12]"]
estimators = ["arl[particles=20]", "dead-reckoning", "ekf-local"]
"""
LEDGER = """
paper = "P"
[[claims]]
id = "1"
says = "odometry alone is better"
kind = "change"
of = "dead-reckoning"
than = "arl[particles=20]"
scenarios = "trajectory[ticks=12]"
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("until")
    (folder / "small.toml").write_text(STUDY)
    (folder / "ledger.toml").write_text(LEDGER)
    ledger, out = folder / "ledger.toml", folder / "run"
    return folder, cl.run_study(folder / "small.toml", max_trials=20, ledger=ledger, out=out, check=False)


@pytest.mark.slow
def test_results_show_and_verdicts_say_what_was_decided_and_when(run, capsys):
    folder, found = run
    verdicts = dict(zip(found.table["estimator"], found.table["verdict"], strict=True))
    assert verdicts == {"arl[particles=20]": "", "dead-reckoning": "worse", "ekf-local": "open"}
    assert set(found.decisions.columns) >= {"verdict", "look", "low", "high", "e"}
    assert cl.load_run(folder / "run").table["verdict"].tolist() == found.table["verdict"].tolist()
    cl.show(found)
    shown = capsys.readouterr().out
    assert "worse, stopped at n = 10" in shown
    assert "decided after 20 trials: 1 of 2 comparisons, 1 of 1 claim; 1 open; the run has ended" in shown
    row = cl.verdicts(found, folder / "ledger.toml").iloc[0]
    assert (row["verdict"], row["look"]) == ("contradicted", 10)
    assert "Contradicted at n = 10" in row["sentence"]
