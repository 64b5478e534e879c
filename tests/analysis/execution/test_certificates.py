"""Estimators that are not built in are checked before they run: a certificate stands beside the name, no cheat wins."""

import json
import shutil

import broken
import pytest
from made_runs import Outline, rows_of
from processes import Log

from cooploc.analysis.claims.ledger import load
from cooploc.analysis.claims.trial_table import collect
from cooploc.analysis.execution import provenance
from cooploc.analysis.execution.provenance import add_certificates
from cooploc.analysis.execution.run import execute, prepare
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
SOUND = STUDY.replace_options(only=("ekf-local", "outside.py:Honest"))
PASSED = f"passed: {len(CHECKS)} checks"


def enter(folder, patch):
    """Put outside.py, and the gallery of broken estimators that it takes one from, where workers find them."""
    (folder / "outside.py").write_text(FILE)
    shutil.copy(broken.__file__, folder)
    patch.chdir(folder)
    patch.setenv("PYTHONPATH", str(folder))
    patch.syspath_prepend(folder)
    return folder


@pytest.fixture(scope="module")
def checked(tmp_path_factory):
    """A run of the study with all its checks: its folder, what it said, its rows."""
    log = Log()
    with pytest.MonkeyPatch.context() as patch:
        folder = enter(tmp_path_factory.mktemp("checked"), patch)
        return folder, log.said, execute(prepare(STUDY), folder / "run", progress=log)


@pytest.fixture
def place(checked, tmp_path, monkeypatch):
    """A folder where what the checks found once is found again at no cost."""
    found = json.loads((checked[0] / "run" / "manifest.json").read_text())["certificates"]["outside.py:Honest"]
    monkeypatch.setattr(provenance, "certify", lambda label, *how: found)
    return enter(tmp_path, monkeypatch)


def test_a_sound_and_a_cheating_estimator_from_table_to_page(checked, tmp_path):
    folder, said, rows = checked
    assert f"outside.py:Honest: ✓ {len(CHECKS)} checks" in said
    assert "outside.py:Prophet: ✗ causality" in said
    assert not rows["failure"].notna().any()  # it runs like any other
    table = compare(rows, "ekf-local").set_index("estimator")["certificate"]
    assert table[["ekf-local", "outside.py:Honest"]].to_list() == ["", PASSED]
    assert table["outside.py:Prophet"].startswith("failed: causality: robot 0's estimate changed")
    source = html_page.write(read_run(folder / "run"), load(), tmp_path).read_text()
    marks = {row["data-estimator"]: row.get("data-certificate") for row in Outline(source).rows("data-consistency")}
    assert marks == {"ekf-local": None, "outside.py:Honest": "passed", "outside.py:Prophet": "failed"}
    assert "outside.py:Prophet failed a check and is not ranked: causality: robot 0&#39;s estimate" in source


def test_the_same_version_is_checked_once_and_another_again(checked, place):
    def labels_checked(study, out):
        execute(prepare(study), out, progress=(log := Log()))
        return [line.split(",")[0].removeprefix("checking ") for line in log.said if line.startswith("checking ")]

    shutil.copytree(checked[0] / "run", place / "run")
    more = SOUND.replace_options(trials=8, only=(*SOUND.only, "outside.py:Honest[scale=2]"))
    assert labels_checked(more, place / "run") == ["outside.py:Honest[scale=2]"]
    (place / "outside.py").write_text(FILE + "\n# edited\n")
    assert labels_checked(SOUND, place / "other") == ["outside.py:Honest"]


def test_an_unchecked_estimator_is_said_to_be_until_it_is_checked(place):
    for check, line in ((False, "unchecked: by request (--no-check)"), (True, PASSED), (False, PASSED)):
        rows = execute(prepare(SOUND), place / "run", check=check)
        assert dict(zip(rows["estimator"], rows["certificate"], strict=True)) == {
            "ekf-local": "",
            "outside.py:Honest": line,
        }


def test_an_estimator_that_failed_a_check_is_never_called_best_and_an_unchecked_one_is_marked():
    honest = rows_of("nlos", {"ekf-local": (1.0, 1.0), "a": (0.5, 1.0), "b": (0.4, 1.0)})
    found = {"a": ("unchecked", "by request"), "b": ("failed", "causality: it peeks")}
    rows = add_certificates(honest, {name: {"status": s, "found": f} for name, (s, f) in found.items()})
    table = compare(rows, "ekf-local", full=True)
    (standing,) = sentences.standings(table, collect(rows))
    assert (standing.best, standing.barred) == ("a", ("b (failed the check causality)",))
    assert sentences.summary_sentence(standing).endswith("a was not checked.")
    assert ranking.certificate_remarks(table) == [
        "a is unchecked: by request",
        "b failed a check and is not ranked: causality: it peeks",
    ]
