"""The commands that are about finished runs."""

import pytest
from processes import inside as cooploc

SMALL = 'trials = 6\nbaseline = "arl"\nscenarios = ["trajectory[ticks=6]"]\nestimators = ["arl", "ekf-local"]\n'
LEDGER = """
paper = "A. Author, 2022"
[[claims]]
id = "1"
says = "alone is better"
kind = "change"
of = "ekf-local"
than = "arl"
scenarios = "trajectory[ticks=6]"
[[claims]]
id = "2"
says = "<b>it flies</b>"
kind = "untestable"
why = "nothing here flies"
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reporting")
    (folder / "small.toml").write_text(SMALL)
    (folder / "ledger.toml").write_text(LEDGER)
    assert cooploc("run", "small.toml", "--out", "one", cwd=folder).returncode == 0
    assert cooploc("run", "small.toml", "--out", "two", "--seed", "2", cwd=folder).returncode == 0
    return folder


def test_report_writes_a_page_and_its_tables_and_says_where(place):
    done = cooploc("report", "one", "-o", "out", "--ledger", "ledger.toml", cwd=place)
    assert done.returncode == 0, done.stderr
    assert "out/index.html" in done.stdout
    page = (place / "out" / "index.html").read_text()
    assert 'data-claim="1"' in page
    assert 'data-claim="2" data-verdict="not testable"' in page
    assert "&lt;b&gt;it flies&lt;/b&gt;" in page
    assert {f.suffix for f in (place / "out" / "tables").iterdir()} == {".tex", ".md", ".csv"}


def test_report_for_a_paper_writes_figures_tables_and_references(place):
    asked = ("--scenarios", "trajectory[ticks=6]", "--columns", "rmse,group")
    done = cooploc("report", "one", "--paper", *asked, "-o", "paper", cwd=place)
    assert done.returncode == 0, done.stderr
    assert "paper: paper\nin it: 6 figures, 1 table, " in done.stdout
    assert "thrun2005" in (place / "paper" / "estimators.bib").read_text()
    assert r"\input{tables/" in (place / "paper" / "example.tex").read_text()
    wrong = cooploc("report", "one", "--columns", "rmse,anes", cwd=place)
    assert (wrong.returncode, wrong.stderr.count("\n")) == (2, 1)
    assert "did you mean 'anees'?" in wrong.stderr


def test_verdicts_prints_the_verdicts_that_the_report_has(place):
    done = cooploc("verdicts", "one", "--ledger", "ledger.toml", cwd=place)
    assert done.returncode == 0, done.stderr
    assert "1. alone is better" in done.stdout
    assert "nothing here flies" in done.stdout
    assert cooploc("verdicts", "one", cwd=place).returncode == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["report", "nowhere"], "nowhere holds no run"),
        (["report", "small.toml"], "small.toml exists and is not a run directory"),
        (["report", "one", "--ledger", "small.toml"], "small.toml: there is no key 'trials'"),
        (["verdicts", "nowhere"], "nowhere holds no run"),
        (["compare", "one", "nowhere"], "nowhere holds no run"),
        (["reproduce", "nowhere"], "cannot be read"),
        (["reproduce", "one", "--trials", "0"], "--trials"),
    ],
)
def test_what_is_not_usable_exits_2_with_one_line(place, arguments, said):
    done = cooploc(*arguments, cwd=place)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert said in done.stderr
