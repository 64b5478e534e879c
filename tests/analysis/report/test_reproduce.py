"""What a report embeds suffices to run its trials again, and to tell whether they came out the same."""

import json
import re

import pytest
from made_logs import change, describe, lines, write
from processes import inside

import cooploc as cl
from cooploc.analysis.claims.ledger import load
from cooploc.analysis.execution import reproduce
from cooploc.analysis.execution.run import execute, prepare
from cooploc.analysis.execution.run_directory import read_run
from cooploc.analysis.report import html_page
from cooploc.scenarios.studies.study import Study

pytestmark = pytest.mark.slow
STUDY = Study(
    name="small",
    trials=5,
    seed=4,
    baseline="arl[particles=50]",
    scenarios=("trajectory[ticks=6]", "nlos/n=2[ticks=6]"),
    estimators=("arl[particles=50]", "ekf-naive"),
)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reproduced")
    execute(prepare(STUDY), folder / "run")
    html_page.write(read_run(folder / "run"), load(), folder / "report")
    return folder / "report"


def altered(report, folder, old, new):
    source = (report / "index.html").read_text()
    start, end = re.search(r'id="manifest">(.*?)</script>', source, re.DOTALL).span(1)
    assert old in source[start:end]
    content = json.loads(source[start:end].replace(old, new))
    folder.mkdir(exist_ok=True)
    (folder / "index.html").write_text(source[:start] + json.dumps(content) + source[end:])
    return folder


def test_the_trials_of_a_report_come_out_bit_equal_and_equal_exits_0(report):
    embedded = reproduce.load(report)
    assert len(embedded["sample"]) == 2 * 2 * reproduce.EACH
    assert reproduce.rerun(embedded, trials=4)["remark"].tolist() == ["bit-equal"] * 8
    assert reproduce.load(report.parent / "run")["sample"] == embedded["sample"]
    done = inside("reproduce", report / "index.html", "--trials", "2")
    assert done.returncode == 0, done.stderr
    assert "4 of 4 results are bit-equal" in done.stdout
    assert reproduce.differences(embedded) == []
    embedded["manifest"]["instructions"]["blas"] = "openblas Prescott"
    assert reproduce.differences(embedded) == ["blas uses other instructions"]


def test_another_result_exits_1_and_says_by_how_much(report, tmp_path):
    one = reproduce.load(report)["sample"][0]
    other = altered(report, tmp_path / "other", json.dumps(one["digest"]), json.dumps("0" * 64))
    embedded = reproduce.load(other)
    again = reproduce.rerun(embedded, trials=99)
    keys = ["scenario", "estimator", "trial"]
    assert again[~again["equal"]][keys].values.tolist() == [[one[key] for key in keys]]
    shifted = altered(report, tmp_path / "shifted", '"seed":4,"source"', '"seed":5,"source"')
    done = inside("reproduce", shifted, "--trials", "1")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "another stream; RMSE differs by" in " ".join(done.stdout.split())
    assert "0 of 2 results are bit-equal" in done.stdout


def test_what_is_no_report_is_refused(tmp_path):
    tag = '<script type="application/json" id="manifest">{}</script>'
    newer = '{"format": 99, "manifest": {"seed": 1, "versions": {}}, "sample": []}'
    bad = {"<html></html>": "embeds no manifest", tag.format("{broken"): "is damaged"}
    for page, message in {**bad, tag.format(newer): "this version reads up to"}.items():
        (tmp_path / "index.html").write_text(page)
        with pytest.raises(cl.BadInput, match=message):
            reproduce.load(tmp_path)


def test_a_report_of_recordings_is_run_again_with_their_directory_and_others_are_told_apart(tmp_path):
    data, report = tmp_path / "lab", tmp_path / "report"
    data.mkdir()
    describe(data)
    for i, name in enumerate(("a", "b", "c")):
        write(data, name, lines(i))
    names = ("dead-reckoning", "rssi-pf")
    study = Study(name="lab", trials=3, baseline=names[0], scenarios=("log/all",), estimators=names)
    execute(prepare(study, data), tmp_path / "run")
    html_page.write(read_run(tmp_path / "run"), load(), report)
    done = inside("reproduce", report, "--data", data)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "6 of 6 results are bit-equal" in done.stdout
    done = inside("reproduce", report)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert "--data" in done.stderr
    change(data, "b", {(4, "r1"): "-77"})
    done = inside("reproduce", report, "--data", data)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "another stream" in done.stdout
