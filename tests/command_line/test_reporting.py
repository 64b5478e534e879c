"""A name that is given to a plug-in in front of its file is what readers see."""

import re

import pytest
from processes import inside as cooploc

SMALL = 'trials = 6\nbaseline = "arl"\nscenarios = ["trajectory[ticks=6]"]\nestimators = ["arl", "ekf-local"]\n'


NAMED = "from cooploc.estimators.dead_reckoning import DeadReckoning\nclass Mine(DeadReckoning): 'Mine.'\n"


@pytest.mark.slow
def test_a_given_name_is_what_terminal_page_figures_and_paper_show(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    (tmp_path / "own.py").write_text(NAMED)
    label = "mine=own.py:Mine"
    done = cooploc("run", "small.toml", "--out", "named", "--estimators", f"arl,{label}", "--trials", "2", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "mine " in done.stdout
    assert cooploc("report", "named", "--paper", "-o", "cited", cwd=tmp_path).returncode == 0
    assert cooploc("report", "named", "-o", "seen", cwd=tmp_path).returncode == 0
    latex = "".join(file.read_text() for file in (tmp_path / "cited" / "tables").iterdir())
    page = (tmp_path / "seen" / "index.html").read_text().partition("application/json")[0]
    read = re.sub(r"<[^>]*>", " ", page.partition("</style>")[2])
    for shown in (done.stdout, latex, read.replace(f"Not built in: {label[5:]}.", "")):
        assert "mine" in shown
        assert "own.py:Mine" not in shown
    assert label in (tmp_path / "named" / "table.csv").read_text()
    again = cooploc("reproduce", "seen", "--trust", "--trials", "1", cwd=tmp_path)
    assert "2 of 2 results are bit-equal" in again.stdout, again.stderr


@pytest.mark.slow
def test_more_estimators_in_a_run_do_not_move_its_baseline_and_a_page_says_what_it_shows(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    cooploc("run", "small.toml", "--out", "grown", cwd=tmp_path)
    cooploc("run", "small.toml", "--estimators", "dead-reckoning,ekf-ci", "--out", "grown", cwd=tmp_path)
    shown = {}
    for options in ((), ("--only", "arl,ekf-ci", "--baseline", "ekf-ci")):
        assert cooploc("report", "grown", "-o", "seen", *options, cwd=tmp_path).returncode == 0
        shown[options] = (tmp_path / "seen" / "index.html").read_text()
    every, some = shown.values()
    assert "This run holds 4 estimators in 1 scenario, 6 trials a scenario; changes are against arl." in every
    assert "Of the run&#39;s 4 estimators in 1 scenario this page shows 2 estimators in 1 scenario" in some
    assert "changes are against ekf-ci." in some
    wrong = cooploc("report", "grown", "--baseline", "ekf-cj", cwd=tmp_path)
    assert (wrong.returncode, "this run has no estimator 'ekf-cj'; did you mean 'ekf-ci'?" in wrong.stderr) == (2, True)
