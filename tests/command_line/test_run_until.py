"""`cooploc run --until-decided` and `cl.run_until`: one run, its table, `show`, and verdicts."""

import json
import shutil

import pytest
from typer.testing import CliRunner

import cooploc as cl
from cooploc.cli import app

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
    found = cl.run_until(
        folder / "small.toml", max_trials=20, ledger=folder / "ledger.toml", out=folder / "run", check=False
    )
    return folder, found


def test_results_say_what_was_decided_and_when(run):
    folder, found = run
    verdicts = dict(zip(found.table["estimator"], found.table["verdict"], strict=True))
    assert verdicts == {"arl[particles=20]": "", "dead-reckoning": "worse", "ekf-local": "open"}
    assert set(found.decisions.columns) >= {"verdict", "look", "low", "high", "e"}
    assert cl.load_run(folder / "run").table["verdict"].tolist() == found.table["verdict"].tolist()


def test_show_says_what_is_decided_and_open(run, capsys):
    cl.show(run[1])
    shown = capsys.readouterr().out
    assert "worse, stopped at n = 10" in shown
    assert "open at n = 20" in shown
    assert "decided after 20 trials: 1 of 2 comparisons, 1 of 1 claim; 1 open; the run has ended" in shown


def test_the_ledger_marks_the_look_of_every_verdict(run):
    folder, found = run
    row = cl.verdicts(found, folder / "ledger.toml").iloc[0]
    assert (row["verdict"], row["look"]) == ("contradicted", 10)
    assert "Contradicted at n = 10" in row["sentence"]


def test_the_command_prints_the_same_and_computes_nothing_again(run, tmp_path):
    folder = shutil.copytree(run[0], tmp_path / "copy")  # the command decides anew, without the ledger
    before = {file: file.stat().st_mtime_ns for file in (folder / "run" / "parts").iterdir()}
    options = ["--until-decided", "--max-trials", "20", "--out", str(folder / "run"), "--json", "--no-check"]
    result = CliRunner().invoke(app, ["run", str(folder / "small.toml"), *options])
    assert result.exit_code == 0, result.stderr
    assert [row["trials"] for row in json.loads(result.stdout)] == [20, 10, 20]
    assert {file: file.stat().st_mtime_ns for file in (folder / "run" / "parts").iterdir()} == before


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--until-decided", "--trials", "5"], "give --max-trials"),
        (["--max-trials", "5"], "without --until-decided"),
        (["--until-decided", "--max-trials", "0"], "trials"),
    ],
)
def test_options_that_contradict_each_other_are_refused(options, said):
    result = CliRunner().invoke(app, ["run", "quick", *options])
    assert isinstance(result.exception, cl.BadInput)
    assert said in str(result.exception)
