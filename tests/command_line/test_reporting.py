"""The commands that are about finished runs."""

import re

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
kind = "level"
of = "arl"
scenarios = "nlos"
size = 1.0
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reporting")
    (folder / "small.toml").write_text(SMALL)
    (folder / "ledger.toml").write_text(LEDGER)
    assert cooploc("run", "small.toml", "--out", "one", cwd=folder).returncode == 0
    return folder


def test_report_writes_a_page_and_its_tables_and_verdicts_prints_the_same_claims(place):
    done = cooploc("report", "one", "-o", "out", "--ledger", "ledger.toml", cwd=place)
    assert done.returncode == 0, done.stderr
    assert "out/index.html" in done.stdout
    page = (place / "out" / "index.html").read_text()
    assert 'data-claim="1"' in page
    assert 'data-claim="2" data-verdict="not run"' in page
    assert "&lt;b&gt;it flies&lt;/b&gt;" in page
    assert {f.suffix for f in (place / "out" / "tables").iterdir()} == {".tex", ".md", ".csv"}
    done = cooploc("verdicts", "one", "--ledger", "ledger.toml", cwd=place)
    assert done.returncode == 0, done.stderr
    assert "1. alone is better" in done.stdout
    assert "claims 2" in done.stdout


NAMED = "from cooploc.estimators.dead_reckoning import DeadReckoning\nclass Mine(DeadReckoning): 'Mine.'\n"


def test_a_given_name_is_what_terminal_page_figures_and_paper_show(place):
    (place / "own.py").write_text(NAMED)
    label = "mine=own.py:Mine"
    done = cooploc("run", "small.toml", "--out", "named", "--estimators", f"arl,{label}", "--trials", "2", cwd=place)
    assert done.returncode == 0, done.stderr
    assert "mine " in done.stdout
    assert cooploc("report", "named", "--paper", "-o", "cited", cwd=place).returncode == 0
    assert cooploc("report", "named", "-o", "seen", cwd=place).returncode == 0
    latex = "".join(file.read_text() for file in (place / "cited" / "tables").iterdir())
    page = (place / "seen" / "index.html").read_text().partition("application/json")[0]
    read = re.sub(r"<[^>]*>", " ", page.partition("</style>")[2])
    for shown in (done.stdout, latex, read.replace(f"Not built in: {label[5:]}.", "")):
        assert "mine" in shown
        assert "own.py:Mine" not in shown
    assert label in (place / "named" / "table.csv").read_text()
    again = cooploc("reproduce", "seen", "--trust", "--trials", "1", cwd=place)
    assert "2 of 2 results are bit-equal" in again.stdout, again.stderr


def test_report_for_a_paper_writes_figures_tables_and_references(place):
    asked = ("--scenarios", "trajectory[ticks=6]", "--columns", "rmse,group")
    done = cooploc("report", "one", "--paper", *asked, "-o", "paper", cwd=place)
    assert done.returncode == 0, done.stderr
    assert "paper: paper\nin it: 6 figures, 1 table, " in done.stdout
    assert "thrun2005" in (place / "paper" / "estimators.bib").read_text()
    assert r"\input{tables/" in (place / "paper" / "example.tex").read_text()
