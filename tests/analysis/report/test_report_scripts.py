"""The scripts that write reports/information.md and reports/sensitivity.md, on runs of a moment."""

import runpy
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import cooploc as cl

REPORTS = Path(__file__).resolve().parents[3] / "reports"
STUDIES = {
    "information": ('"scalability/n=1[ticks=6]", "scalability/n=2[ticks=6]"', '"arl", "ekf-local"', '"mrsl-rssi"'),
    "sensitivity": ('"robots-1-3/n=2[ticks={4,8}]", "no-compass/n=2[ticks=4]"', '"arl", "rssi-pf"', '"mrsl-rssi"'),
}


@pytest.fixture
def made(request, tmp_path):
    scenarios, estimators, more = STUDIES[request.param]
    study = tmp_path / "short.toml"
    study.write_text(
        f"trials = 6\nscenarios = [{scenarios}]\nestimators = [{estimators}]\n"
        f"[[also]]\nscenarios = [{scenarios.split(', ')[-1]}]\nestimators = [{estimators}, {more}]\n"
    )
    run = cl.run_study(study, out=tmp_path / "run")
    runpy.run_path(str(REPORTS / f"{request.param}.py"))["main"](run.folder, tmp_path)
    yield request.param, tmp_path
    plt.close("all")


@pytest.mark.slow
@pytest.mark.parametrize("made", STUDIES, indirect=True)
def test_a_page_is_written_with_its_sentences_and_its_figure(made):
    name, folder = made
    page = (folder / f"{name}.md").read_text("utf-8")
    said = {"information": "The product of beliefs ", "sensitivity": "By paired intervals, "}[name]
    assert said in page
    assert "6 trials, seed 1" in page
    assert f"]({name}.png)" in page
    assert (folder / f"{name}.png").stat().st_size > 10_000
    assert "</svg>" in (folder / f"{name}.svg").read_text("utf-8")


@pytest.mark.slow
def test_the_audit_measures_pairs_and_floors():
    audit = runpy.run_path(str(REPORTS / "audit.py"))
    said, where, of, rmse, *_, change = audit["pair"]("a sentence", "robots-1-3/n=2[ticks=4]", "arl", "rssi-pf", 3)
    assert (said, where, of) == ("a sentence", "robots-1-3/n=2[ticks=4]", "`arl`")
    assert rmse.endswith(" m")
    assert " % (" in change
    single, team = (float(line.split(": ")[1].split(" m")[0]) for line in audit["floors"](2).splitlines())
    assert 0 < team < single
