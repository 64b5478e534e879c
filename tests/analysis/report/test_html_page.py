"""The report of a run as a page: what it says, what is on disk beside it, and that nothing in it can escape."""

import json
import re
import shutil
import subprocess

import numpy as np
import pandas as pd
import pytest
from made_runs import EVIL, Outline, kept_from, rows_of

from cooploc.analysis.claims.ledger import load
from cooploc.analysis.claims.trial_table import collect
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.sweeps import add_sweep
from cooploc.analysis.plot import results, style
from cooploc.analysis.report import html_page, result_tables

pytestmark = pytest.mark.slow
SWEEP = {"base": (1.0, 1.0), "good": (0.5, 1.0), "liar": (0.1, 9.0), "omniscient": (0.05, 1.0), "twin": (0.5, 1.0)}
AB = {"a": (1.0, 1.0), "b": (0.5, 1.0)}
DROPS = [f"packet-drop/drop={d}" for d in ("0", "0.5", "0.9")]


@pytest.fixture(scope="module")
def swept():
    rows = pd.concat([rows_of(label, SWEEP, bounds=("omniscient",)) for label in DROPS], ignore_index=True)
    return rows.assign(messages=(rows["estimator"] != "base") * 1.0)


@pytest.fixture(scope="module")
def written(swept, tmp_path_factory):
    out = tmp_path_factory.mktemp("report")
    kept = kept_from(swept, out)._replace(gaps={(DROPS[0], "good"): 2})
    html_page.write(kept, load(), out)
    return out


def page(kept, folder):
    return html_page.write(kept, load(), folder).read_text()


def test_the_page_nests_and_asks_nothing_of_any_network(written):
    source = (written / "index.html").read_text()
    outline = Outline(source)
    assert outline.open == []
    for tag, attributes in outline.tags:
        assert tag not in {"link", "iframe", "img", "object", "embed", "base", "form"}
        assert {"src", "action"}.isdisjoint(attributes), (tag, attributes)
        assert re.match(r"#|tables/[\w.%-]+$", attributes.get("href", "#")), (tag, attributes)
    assert not re.search(r"https?://|@import|url\((?!#)", source)
    ids = [attributes["id"] for _, attributes in outline.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    links = {attributes["href"] for tag, attributes in outline.tags if tag == "a"}
    assert {link[1:] for link in links if link[0] == "#"} <= set(ids)
    assert all((written / link).is_file() for link in links if link[0] != "#")
    assert set() < set(re.findall(r'(?:url\(#|href="#)(f\d+-[^)"]+)', source)) <= set(ids)


def test_contents_come_first_then_the_answer_and_a_sweep_is_said_with_intervals(written):
    source = (written / "index.html").read_text()
    sections = ("answer", "experiment-one", "estimators", "scenarios", "trouble", "methods", "files")
    order = [source.index("<nav"), *(source.index(f'id="{name}"') for name in sections)]
    assert order == sorted(order)
    assert Outline(source).rows("data-claim") == []  # nothing bears on a claim
    for words in (
        "Position RMSE over share of packets that are lost in packet-drop",
        "RMSE from drop = 0 to 0.9 (95\u00a0% intervals, unadjusted)",
        "8 trials a scenario, seed 3; t test of the change against the baseline, Holm over the 12 comparisons",
        "packet-drop/drop=0, good: 2 of the planned trials are missing",
    ):
        assert words in source
    known = re.findall(r"<dt>Knows</dt><dd>(.*?)(?:: a bound.*)?</dd>", source)
    own, every = "its own readings, and {}", "every reading of every robot"
    assert known == [own.format("nothing of teammates"), *[own.format("what teammates send")] * 2, every, known[1]]


def test_the_tables_on_disk_hold_the_numbers_of_the_page(written, swept):
    table = pd.read_csv(written / "tables" / "experiment-one.csv").set_index(["estimator", "scenario"])["rmse"]
    assert (len(table), set(table.index.levels[0])) == (15, set(SWEEP))
    mean = swept[swept["estimator"] == "good"].groupby("scenario")["mse"].mean() ** 0.5
    assert np.allclose(table["good"].sort_index(), mean.sort_index())


def test_claims_are_all_marked_where_the_run_touches_one(tmp_path):
    rows = rows_of("robots-1-3/n=3", {"arl": (1.0, 1.0), "mrsl-rssi": (0.5, 1.0)})
    source = page(kept_from(rows, tmp_path), tmp_path)
    marked = Outline(source).rows("data-claim")
    assert {row["data-claim"] for row in marked} == {claim.id for claim in load().claims}
    assert {"not run"} < {row["data-verdict"] for row in marked}
    assert re.search(r"<summary>Not run: \d+ claims</summary>", source)


def test_a_scenario_of_two_experiments_is_in_both_with_the_estimators_that_it_has_there(tmp_path, monkeypatch):
    rows = pd.concat([rows_of(label, {**AB, "c": (2.0, 1.0)}) for label in DROPS])
    blocks = [
        {"scenarios": DROPS[1:2], "estimators": ["a", "c"], "experiment": "first"},
        {"scenarios": ["packet-drop/drop={0,0.5,0.9}"], "estimators": ["a", "b"], "experiment": "second"},
    ]
    kept = kept_from(rows[(rows["estimator"] != "c") | (rows["scenario"] == DROPS[1])], tmp_path, "first", also=blocks)
    assert kept.experiments == {"first": {DROPS[1]: ["a", "c"]}, "second": {label: ["a", "b"] for label in DROPS}}
    assert "packet-drop: RMSE from drop = 0 to 0.9" in page(kept, tmp_path)
    best = [pd.read_csv(tmp_path / "tables" / f"best-experiment-{name}.csv") for name in ("first", "second")]
    assert [set(table["estimator"]) for table in best] == [{"a"}, {"b"}]
    monkeypatch.setattr(html_page, "MOST_BYTES", 10_000)  # each experiment goes to a page of its own
    first = page(kept, tmp_path)
    assert {"experiment-first.html", "experiment-second.html"} <= set(re.findall(r'href="([\w.-]+)"', first))
    assert "packet-drop: RMSE from drop = 0 to 0.9" not in first
    source = (tmp_path / "experiment-second.html").read_text()
    assert "packet-drop: RMSE from drop = 0 to 0.9" in source
    assert re.findall(r'href="index.html#(.*?)"', source)[0] in {of.get("id") for _, of in Outline(first).tags}
    assert "every column" in source  # which the file of the table has
    more = kept._replace(rows=pd.concat([kept.rows, rows_of(DROPS[0], {"d": (1.0, 1.0)})]))
    assert more.experiments["first"][DROPS[0]] == ["d"]  # run with --estimators, of no block


def test_a_run_in_which_everything_failed_has_a_page(tmp_path):
    rows = pd.concat([rows_of(f"nlos[eta={eta}]", AB) for eta in (2, 3, 4)], ignore_index=True)
    failed = rows.assign(failure="ValueError: no", traceback="there", **dict.fromkeys(("mse", "rmse", "anees"), np.nan))
    written = page(kept_from(failed, tmp_path), tmp_path)
    assert "ValueError: no" in written
    assert "Every trial failed" in written


def test_a_page_draws_and_says_what_estimators_sweep(tmp_path):
    swept = {f"arl[particles={n}]": (100 / n, 1.0) for n in (50, 100, 200)} | {"mrsl-rssi[particles=50]": (1.0, 1.0)}
    written = page(kept_from(rows_of("nlos", swept), tmp_path), tmp_path)
    assert "Position RMSE over particles in nlos" in written
    sentence = "nlos: RMSE from particles = 50 to 200 (95 % intervals, unadjusted): it falls for arl (-75 %,"
    assert sentence in written.replace("\xa0", " ")


def test_variants_share_a_panel_and_every_estimator_has_one(swept):
    table = compare(swept, "base", full=True).assign(floor=0.01)
    names = ["arl", "arl[K=1]", "arl[M=1]", "b", "c", "d[x=1]", "e"]
    table = pd.concat([table[table["estimator"] == "base"].assign(estimator=name) for name in names])
    panels = results.sweep_panels(add_sweep(table), style.pens(names), str).axes
    assert [ax.get_title(loc="left") for ax in panels] == ["arl", "b", "c", "d[x=1]", "e"]
    assert set(names[:3]) < set(panels[0].get_legend_handles_labels()[1])


def test_everything_is_escaped_and_the_latex_tables_compile(tmp_path):
    label = f"arl{EVIL}"
    rows = rows_of(f"nlos{EVIL}", {label: (1.0, 1.0), r"\input{x}~^{}|µ–猫": (0.5, 1.0)}, failed=(label,))
    source = page(kept_from(rows, tmp_path, experiment=f"x{EVIL}", about=EVIL, name=EVIL), tmp_path)
    outline = Outline(source)
    assert outline.open == []
    assert sum(tag == "script" for tag, _ in outline.tags) == 2
    assert "<script>alert" not in source
    assert re.findall(r"\bon\w+=", source) == []
    embedded = json.loads(re.search(r'id="manifest">(.*?)</script>', source, re.DOTALL)[1])
    assert embedded["manifest"]["study"]["about"] == EVIL
    files = list((tmp_path / "tables").iterdir())
    assert all(len(file.name) < 120 and "<" not in file.name for file in files)
    assert all("<script>" not in file.read_text() for file in files if file.suffix == ".md")
    if shutil.which("pdflatex"):
        packages = r"\usepackage[T1]{fontenc}\usepackage{textcomp,booktabs,longtable}"
        tables = "".join(rf"\input{{{file.name}}}" for file in files if file.suffix == ".tex")
        text = rf"\documentclass{{article}}{packages}\begin{{document}}{tables}\end{{document}}"
        command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", text]
        done = subprocess.run(command, cwd=tmp_path / "tables", capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-2000:]


def test_an_estimator_that_fails_changes_no_rank_and_no_letter_of_the_others():
    calm = rows_of("nlos", {**AB, "c": (1.01, 1.0)}, trials=12)
    wild = rows_of("nlos", {"wild": (0.7, 1.0)}, trials=12)
    wild.loc[wild["trial"] > 5, "mse"] = np.inf
    alone, beside = (
        result_tables.rank_scenario(compare(rows, "a", full=True), collect(rows))
        for rows in (calm, pd.concat([calm, wild], ignore_index=True))
    )
    assert alone == beside
    assert set(alone[1]) == {"a", "b", "c"}
    assert not set(alone[1]["b"]) & set(alone[1]["a"])
