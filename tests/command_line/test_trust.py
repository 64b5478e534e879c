"""A run or a report that somebody sent: it runs no code, stays in its directory, and says nothing to the terminal."""

import shutil

import numpy as np
import pandas as pd
import pytest
from attempts import commanded

from cooploc.analysis.report.tables import csv_text
from cooploc.terminal.console import escape_controls

EVIL = """
import pathlib
pathlib.Path("ran").write_text("code of the sender")
from cooploc.estimators.dead_reckoning import DeadReckoning
from cooploc.scenarios import BUILTIN
World = BUILTIN["trajectory"]
class Mine(DeadReckoning):
    "Mine."
"""
STUDY = """
trials = 2
scenarios = ["evil.py:World[ticks=3]"]
estimators = ["dead-reckoning", "evil.py:Mine"]
"""


@pytest.fixture(scope="module")
def sent(tmp_path_factory):
    """A run and its report, of a scenario and an estimator in a file that leaves a mark where it runs."""
    folder = tmp_path_factory.mktemp("sent")
    (folder / "evil.py").write_text(EVIL)
    (folder / "study.toml").write_text(STUDY)
    ran = commanded("run", "study.toml", "--out", "run", "--no-check", cwd=folder)
    assert ran.returncode == 0, ran.stderr
    assert (folder / "ran").exists()
    # Another file under the same name is imported again, if anything imports it.
    (folder / "evil.py").write_text(EVIL + "# changed\n")
    (folder / "ran").unlink()
    return folder


@pytest.mark.slow
def test_nothing_but_reproduce_runs_code_that_a_run_names_and_that_asks(sent):
    for command in ("show", "verdicts", "report"):
        assert commanded(command, "run", cwd=sent).returncode == 0
    shutil.copytree(sent / "run", sent / "copy")
    assert commanded("compare", "run", "copy", cwd=sent).returncode == 0
    assert not (sent / "ran").exists()
    refused = commanded("reproduce", "run/report", cwd=sent)
    assert refused.returncode == 2
    assert "code that the report names, in evil.py: read it, then repeat with --trust" in refused.stderr
    assert not (sent / "ran").exists()
    again = commanded("reproduce", "run/report", "--trust", "--trials", "1", cwd=sent)
    assert again.returncode == 0, again.stderr
    assert "2 of 2 results are bit-equal" in again.stdout
    assert (sent / "ran").exists()
    (sent / "evil.py").write_text(f"{EVIL}    def predict(self, s, z):\n        import os\n        os._exit(11)\n")
    died = commanded("reproduce", "run/report", "--trust", "--trials", "1", cwd=sent)
    assert died.returncode == 1, died.stderr
    assert "its process died" in " ".join(died.stdout.split())  # not that of the command
    assert "differs from that of the report: evil.py is another version" in died.stdout


def test_text_is_shown_as_it_is_but_for_what_is_hidden():
    plain = "µs, ±, −, “naïve”, 漢字, tab\tand\nline"
    assert escape_controls(plain) == plain
    assert escape_controls("a\x1b[31mb\x00\x7f\x85\u200b\u202e\ud800") == r"a\x1b[31mb\x00\x7f\x85\u200b\u202e\ud800"


def test_no_text_in_csv_begins_like_a_formula_and_numbers_stay_numbers():
    table = pd.DataFrame({"=head": ["=cmd|' /C calc'!A0", "+1", "@SUM(A1)", "a=b"], "value": [-1.5, np.nan, 1e-9, 7.0]})
    for one in (table, table.astype(object)):
        text = csv_text(one).replace('"', "").splitlines()
        assert text == ["'=head,value", "'=cmd|' /C calc'!A0,-1.5", "'+1,", "'@SUM(A1),1e-09", "a=b,7.0"]
