"""Who is not built in is checked before it runs: a certificate stands beside the name, and a cheat wins nothing."""

import json
import shutil
from pathlib import Path
from typing import NamedTuple

import broken
import pandas as pd
import pytest
from made_runs import Outline, rows_of

from cooploc.analysis.claims.ledger import load
from cooploc.analysis.claims.trial_table import collect
from cooploc.analysis.execution import certificates
from cooploc.analysis.execution.certificates import add_certificates
from cooploc.analysis.execution.run import Silent, execute, prepare
from cooploc.analysis.execution.run_directory import read_run
from cooploc.analysis.metrics import ranking
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.report import html_page, sentences
from cooploc.scenarios.conformance import CHECKS
from cooploc.scenarios.studies.study import Study

pytestmark = pytest.mark.slow
FILE = """
from dataclasses import dataclass
from broken import Prophet
from cooploc.estimators.ekf_local import EkfLocal

@dataclass(frozen=True)
class Honest(EkfLocal):
    scale: float = 1.0
"""
STUDY = Study(
    name="small",
    trials=6,
    baseline="ekf-local",
    scenarios=("robots-1-3/n=2[ticks=5]",),
    estimators=("ekf-local", "outside.py:Honest", "outside.py:Prophet"),
)
ALL = len(CHECKS)


class Told(Silent):
    """Remembers what a run said."""

    def __init__(self):
        self.said = []

    def say(self, line):
        self.said.append(line)


class Checked(NamedTuple):
    """A run of the study with all its checks."""

    folder: Path
    said: list[str]
    rows: pd.DataFrame

    @property
    def honest(self):
        """The certificate of the sound estimator."""
        return json.loads((self.folder / "run" / "manifest.json").read_text())["certificates"]["outside.py:Honest"]


def enter(folder, patched):
    """Where outside.py is, and the gallery of broken estimators that it takes one from; workers find them there."""
    (folder / "outside.py").write_text(FILE)
    shutil.copy(broken.__file__, folder)
    patched.chdir(folder)
    patched.setenv("PYTHONPATH", str(folder))
    patched.syspath_prepend(folder)
    return folder


@pytest.fixture(scope="module")
def checked(tmp_path_factory):
    told = Told()
    with pytest.MonkeyPatch.context() as patched:
        folder = enter(tmp_path_factory.mktemp("checked"), patched)
        return Checked(folder, told.said, execute(prepare(STUDY), folder / "run", progress=told))


@pytest.fixture
def place(tmp_path, monkeypatch):
    return enter(tmp_path, monkeypatch)


@pytest.fixture
def found_again(checked, monkeypatch):
    """What the checks found once is found again at no cost, where the point is when they are asked for."""
    monkeypatch.setattr(certificates, "certify", lambda label, isolate: checked.honest)


def test_a_sound_and_a_cheating_estimator_from_table_to_page(checked, tmp_path):
    rows, place = checked.rows, checked.folder
    assert [s for s in checked.said if s.startswith("checking ")] == [
        f"checking {name}, as it is not built in (--no-check leaves it out)" for name in STUDY.estimators[1:]
    ]
    assert f"outside.py:Honest: ✓ {ALL} checks" in checked.said
    assert "outside.py:Prophet: ✗ causality" in checked.said
    assert not rows["failure"].notna().any()  # it runs like any other
    table = compare(rows, "ekf-local").set_index("estimator")["certificate"]
    assert table["ekf-local"] == ""
    assert table["outside.py:Honest"] == f"passed: {ALL} checks"
    assert table["outside.py:Prophet"].startswith("failed: causality: robot 0's estimate changed")

    source = html_page.write(read_run(place / "run"), load(), tmp_path).read_text()
    marks = {row["data-estimator"]: row.get("data-certificate") for row in Outline(source).rows("data-consistency")}
    assert marks == {"ekf-local": None, "outside.py:Honest": "passed", "outside.py:Prophet": "failed"}
    assert "outside.py:Prophet failed a check and is not ranked: causality: robot 0&#39;s estimate" in source
    for ending in ("md", "tex", "csv"):
        written = (tmp_path / "tables" / f"experiment-small.{ending}").read_text()
        assert {"md": "✗ causality", "tex": r"\ensuremath{\times} causality", "csv": "failed: causality"}[
            ending
        ] in written
    ranked = pd.read_csv(tmp_path / "tables" / "experiment-small.csv").set_index("estimator")
    assert ranked.loc["outside.py:Prophet", ["rank", "group"]].isna().all()
    assert sorted(ranked["rank"].dropna()) == [1.5, 1.5]


def test_the_same_version_is_checked_once_and_another_is_refused(checked, place, found_again):
    study = STUDY.replace_options(only=("ekf-local", "outside.py:Honest"))
    shutil.copytree(checked.folder / "run", place / "run")
    told = Told()
    more = study.replace_options(trials=8, only=("ekf-local", "outside.py:Honest", "outside.py:Honest[scale=2]"))
    execute(prepare(more), place / "run", progress=told)
    assert [s.split(",")[0] for s in told.said if s.startswith("checking")] == ["checking outside.py:Honest[scale=2]"]
    (place / "outside.py").write_text(FILE + "\n# edited\n")
    told = Told()
    execute(prepare(study), place / "other", progress=told)
    assert [s.split(",")[0] for s in told.said if s.startswith("checking")] == ["checking outside.py:Honest"]


def test_who_is_not_checked_is_said_to_be_unchecked_until_somebody_does(place, found_again):
    study = STUDY.replace_options(only=("ekf-local", "outside.py:Honest"))
    told = Told()
    rows = execute(prepare(study), place / "run", check=False, progress=told)
    assert told.said == []
    lines = dict(zip(rows["estimator"], rows["certificate"], strict=True))
    assert lines == {"ekf-local": "", "outside.py:Honest": "unchecked: by request (--no-check)"}
    rows = execute(prepare(study), place / "run")
    assert set(rows["certificate"]) == {"", f"passed: {ALL} checks"}
    assert set(execute(prepare(study), place / "run", check=False)["certificate"]) == set(rows["certificate"])


def certified(rows, **told):
    found = {name: dict(zip(("status", "found"), line.split(": ", 1), strict=True)) for name, line in told.items()}
    return add_certificates(rows, found)


SMALLER = {"ekf-local": (1.0, 1.0), "a": (0.5, 1.0), "b": (0.4, 1.0)}


def test_nobody_is_called_best_who_failed_a_check_and_who_is_unchecked_is_said_to_be():
    rows = certified(rows_of("nlos", SMALLER), a="unchecked: by request", b="failed: causality: it peeks")
    table = compare(rows, "ekf-local", full=True)
    (found,) = sentences.standings(table, collect(rows))
    assert (found.best, found.barred) == ("a", ("b (failed the check causality)",))
    assert sentences.summary_sentence(found).endswith(
        "but does not qualify: b (failed the check causality). a was not checked."
    )
    assert ranking.certificate_remarks(table) == [
        "a is unchecked: by request",
        "b failed a check and is not ranked: causality: it peeks",
    ]
    honest = rows.assign(certificate="")
    (found,) = sentences.standings(compare(honest, "ekf-local", full=True), collect(honest))
    assert found.best == "b"
