"""`cooploc plan`: how many trials a comparison needs, from ten."""

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

import cooploc as cl
from cooploc.analysis.metrics import sequential, statistics
from cooploc.analysis.metrics.sequential import minutes
from cooploc.cli import app

STUDY = """
trials = 40
baseline = "arl[particles=20]"
scenarios = ["trajectory[ticks=12]"]
estimators = ["arl[particles=20]", "dead-reckoning", "ekf-local"]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("plan")
    (made / "small.toml").write_text(STUDY)
    return made


def test_a_plan_counts_the_trials_of_every_comparison(folder):
    found = cl.plan(folder / "small.toml", difference=0.2, out=folder / "run")
    assert list(found["estimator"]) == ["dead-reckoning", "ekf-local"]
    assert (found["until_decided"] > found["trials"]).all()
    smaller = cl.plan(folder / "small.toml", difference=0.1, out=folder / "run")
    assert (smaller["trials"] > found["trials"]).all()
    assert 0 < minutes(found, "trials", jobs=2) == minutes(found, "trials") / 2


def test_a_run_goes_on_from_the_pilot(folder):
    cl.plan(folder / "small.toml", out=folder / "run")
    before = {file.name for file in (folder / "run" / "parts").iterdir()}
    cl.plan(folder / "small.toml", out=folder / "run")
    assert {file.name for file in (folder / "run" / "parts").iterdir()} == before


def test_the_command_prints_trials_and_time(folder):
    result = CliRunner().invoke(app, ["plan", str(folder / "small.toml"), "--out", str(folder / "run")])
    assert result.exit_code == 0, result.stderr
    assert "a change of RMSE of 10 % in four of five runs" in result.stdout
    assert "estimators take about" in result.stdout


def test_a_difference_of_nothing_is_refused(folder):
    with pytest.raises(cl.BadInput, match="difference is 0; it must lie above 0"):
        cl.plan(folder / "small.toml", difference=0, out=folder / "run")


def test_the_planned_number_until_decided_decides_four_of_five(folder):
    """Normal differences of a known spread, looked at once at the planned number: any look only adds power."""
    exact = statistics.Interval(0.0, *(np.array([-1, 1]) * statistics.quantile(30) / np.sqrt(30)))
    n = int(sequential.trials_until_decided(exact, 30, 0.5))
    d = stats.norm(0.5).rvs((2000, n), random_state=1)
    decided = np.mean([sequential.ANYTIME.mean(one).low > 0 for one in d])
    assert 0.75 < decided < 0.9
