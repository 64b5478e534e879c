"""The report of a run: what it says, that it says no more than the numbers do, and that nothing in it can escape."""

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
from cooploc.analysis.execution.run_directory import read_run as kept_of
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.plot import results, style
from cooploc.analysis.report import html_page, page_figures, run_numbers, sentences

pytestmark = pytest.mark.slow
SWEEP = {"base": (1.0, 1.0), "good": (0.5, 1.0), "liar": (0.1, 9.0), "omniscient": (0.05, 1.0), "twin": (0.5, 1.0)}


@pytest.fixture(scope="module")
def swept():
    frames = [rows_of(f"packet-drop/drop={d}", SWEEP, bounds=("omniscient",)) for d in ("0", "0.5", "0.9")]
    return pd.concat(frames, ignore_index=True)


@pytest.fixture(scope="module")
def written(swept, tmp_path_factory):
    out = tmp_path_factory.mktemp("report")
    html_page.write(kept_from(swept, out), load(), out)
    return out


def standing(rows):
    table = compare(rows, rows["estimator"].iloc[0], full=True)
    (found,) = sentences.standings(table, collect(rows))
    return found


def test_the_page_nests_and_asks_nothing_of_any_network(written):
    source = (written / "index.html").read_text()
    outline = Outline(source)
    assert outline.open == []
    for tag, attributes in outline.tags:
        assert tag not in {"link", "iframe", "img", "object", "embed", "base", "form"}
        for key in ("src", "action"):
            assert key not in attributes, (tag, attributes)
        assert re.match(r"#|(tables|trials)/[\w.%-]+$", attributes.get("href", "#")), (tag, attributes)
    assert not re.search(r"https?://|@import|url\((?!#)", source)
    ids = [attributes["id"] for _, attributes in outline.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    links = {attributes["href"] for tag, attributes in outline.tags if tag == "a"}
    assert {link[1:] for link in links if link[0] == "#"} <= set(ids)
    assert all((written / link).is_file() for link in links if link[0] != "#")
    used = set(re.findall(r'(?:url\(#|href="#)(f\d+-[^)"]+)', source))
    assert used <= set(ids)
    assert used


def test_contents_come_first_then_the_answer_and_claims_that_nothing_bears_on_are_left_out(written):
    source = (written / "index.html").read_text()
    sections = ("answer", "experiment-one", "estimators", "scenarios", "trouble", "methods", "files")
    order = [source.index("<nav"), *(source.index(f'id="{name}"') for name in sections)]
    assert order == sorted(order)
    assert Outline(source).rows("data-claim") == []


def test_claims_are_all_marked_where_the_run_touches_one(tmp_path):
    rows = rows_of("robots-1-3/n=3", {"arl": (1.0, 1.0), "mrsl-rssi": (0.5, 1.0)})
    source = html_page.write(kept_from(rows, tmp_path), load(), tmp_path).read_text()
    marked = Outline(source).rows("data-claim")
    assert {row["data-claim"] for row in marked} == {claim.id for claim in load().claims}
    assert "not run" in {row["data-verdict"] for row in marked}
    assert len({row["data-verdict"] for row in marked}) > 1
    assert re.search(r"<summary>Not run: \d+ claims</summary>", source)


def test_a_sweep_is_drawn_as_lines_and_said_with_intervals(written):
    source = (written / "index.html").read_text()
    assert "Position RMSE over drop" in source
    assert "RMSE from drop = 0 to 0.9 (95\u00a0% intervals, unadjusted)" in source
    for word in (
        "seed 3",
        "t test of the change against the baseline",
        "Holm over the 12 comparisons",
        "8 trials a scenario",
    ):
        assert word in source


def test_who_is_over_confident_or_a_bound_is_never_called_best(swept):
    for scenario, rows in swept.groupby("scenario"):
        found = standing(rows)
        assert found.scenario == scenario
        assert found.best in {"good", "twin"}
        assert [line.split(" (")[0] for line in found.barred] == ["omniscient", "liar"]
        assert "is best" not in sentences.summary_sentence(found)


def test_a_tie_is_said_as_a_tie_and_a_difference_as_one():
    rng = np.random.default_rng(1)
    rows = rows_of("nlos", {"a": (1.0, 1.0), "b": (1.0, 1.0)}, trials=12)
    rows["mse"] = rng.lognormal(0, 0.5, len(rows))
    found = standing(rows)
    assert {found.best, *found.tied} == {"a", "b"}
    assert sentences.summary_sentence(found).startswith("A tie: ")
    apart = standing(rows_of("nlos", {"a": (1.0, 1.0), "b": (0.5, 1.0)}, trials=12))
    assert sentences.summary_sentence(apart).startswith("b is best: ")
    same = rows_of("nlos", {"a": (1.0, 1.0), "b": (1.0, 1.0)}, trials=12)
    same["mse"] = np.tile(same["mse"][:12], 2)
    assert standing(same).equal == ("b",)


def test_what_is_told_apart_has_an_interval_that_excludes_zero(swept):
    rows = swept[swept["scenario"] == "packet-drop/drop=0"]
    results, found = collect(rows), standing(rows)
    change = statistics.change(*results.mse((found.scenario, found.best), (found.scenario, "base")).T)
    assert change.low > 0
    assert "base" not in (*found.tied, *found.equal)


def test_who_may_be_over_confident_is_not_called_best():
    rows = rows_of("nlos", {"a": (1.0, 1.0), "wild": (0.1, 1.0)})
    rows.loc[(rows["estimator"] == "wild") & (rows["trial"] == 0), "anees"] = 1e9  # a heavy tail: an interval from ~0
    found = standing(rows)
    assert found.best == "a"
    assert found.barred[0].startswith("wild (probably over-confident, ANEES 1")
    slightly = rows.assign(anees=rows["anees"].clip(upper=8.0))  # 1.9 on average
    assert "leaves open whether it is over-confident" in sentences.summary_sentence(standing(slightly))
    flags = compare(rows, "a").set_index("estimator")["consistency"]
    assert flags.to_dict() == {"a": "consistent", "wild": "not shown"}


def test_a_scenario_of_two_experiments_is_in_both_with_the_estimators_that_it_has_there(tmp_path):
    labels = [f"packet-drop/drop={d}" for d in ("0", "0.5", "0.9")]
    rows = pd.concat([rows_of(label, {"a": (1.0, 1.0), "b": (0.5, 1.0), "c": (2.0, 1.0)}) for label in labels])
    blocks = [
        {"scenarios": labels[1:2], "estimators": ["a", "c"], "experiment": "first"},
        {"scenarios": ["packet-drop/drop={0,0.5,0.9}"], "estimators": ["a", "b"], "experiment": "second"},
    ]
    kept = kept_from(rows[(rows["estimator"] != "c") | (rows["scenario"] == labels[1])], tmp_path, "first", also=blocks)
    assert kept.experiments == {
        "first": {labels[1]: ["a", "c"]},
        "second": {label: ["a", "b"] for label in labels},
    }
    source = html_page.write(kept, load(), tmp_path).read_text()
    assert "packet-drop: RMSE from drop = 0 to 0.9" in source
    table = pd.read_csv(tmp_path / "tables" / "where.csv").set_index("experiment")
    assert table["scenarios"].to_dict() == {"first": 1, "second": 3}
    assert table["best"].to_dict() == {"first": "a (1)", "second": "b (3)"}
    more = kept._replace(rows=pd.concat([kept.rows, rows_of(labels[0], {"d": (1.0, 1.0)})]))
    assert more.experiments["first"][labels[0]] == ["d"]  # run with --estimators, of no block


def test_groups_are_shown_where_estimators_are_ranked_and_left_out_where_there_is_nothing_to_test(tmp_path):
    rng = np.random.default_rng(4)
    rows = rows_of("nlos", {"a": (1.0, 1.0), "b": (1.0, 1.0), "c": (9.0, 1.0)}, trials=20)
    rows["mse"] *= rng.lognormal(0, 0.5, len(rows))
    html_page.write(kept_from(rows, tmp_path), load(), tmp_path)
    table = pd.read_csv(tmp_path / "tables" / "experiment-one.csv").set_index("estimator")
    assert set(table.loc["a", "group"]) & set(table.loc["b", "group"])
    assert not set(table.loc["a", "group"]) & set(table.loc["c", "group"])
    assert table.loc["c", "rank"] == 3
    assert "that share a letter do not differ significantly" in (tmp_path / "index.html").read_text()
    for few in (rows[rows["trial"] < 4], rows[rows["estimator"] == "a"]):
        html_page.write(kept_from(few, tmp_path), load(), tmp_path)
        assert pd.read_csv(tmp_path / "tables" / "experiment-one.csv")["group"].isna().all()


def test_of_many_estimators_a_sweep_gives_the_range_and_its_table_all_numbers(tmp_path):
    names = {f"e{i}": (1.0 + i, 1.0) for i in range(14)}
    rows = pd.concat([rows_of(f"packet-drop/drop={d}", names) for d in (0, 1, 2)], ignore_index=True)
    rows["mse"] *= np.where(rows["scenario"].str.endswith("2"), 4.0, 1.0)
    source = html_page.write(kept_from(rows, tmp_path), load(), tmp_path).read_text()
    assert "it grows for 14 estimators (by 100\u00a0% to 100\u00a0%)." in source
    assert len(pd.read_csv(tmp_path / "tables" / "experiment-one-sweep1.csv")) == 14


def test_variants_share_a_panel_and_every_estimator_has_one(swept):
    table = compare(swept, "base", full=True).assign(floor=0.01)
    names = ["arl", "arl[K=1]", "arl[M=1]", "b", "c", "d[x=1]", "e"]
    table = pd.concat([table[table["estimator"] == "base"].assign(estimator=name) for name in names])
    drawn = results.sweep_panels(table, style.looks(names), str)
    svgs = [str(page_figures.inline(figure, i, "")) for i, figure in enumerate(drawn)]
    assert len(svgs) == 5
    assert all(name in svgs[0] for name in names[:3])
    for name, svg in zip(names[3:], svgs[1:], strict=True):
        assert f">{name}<" in svg


def test_below_five_trials_nothing_is_claimed():
    found = standing(rows_of("nlos", {"a": (1.0, 1.0), "b": (0.1, 1.0)}, trials=4))
    assert sentences.summary_sentence(found).startswith("Not assessed: 4 trials")
    assert found.best == ""
    lonely = standing(rows_of("nlos", {"a": (1.0, 1.0)}))
    assert sentences.summary_sentence(lonely) == "No estimator qualifies: there is nothing to compare."


def test_whoever_failed_in_a_trial_is_not_best():
    found = standing(rows_of("nlos", {"a": (1.0, 1.0), "b": (0.1, 1.0)}, failed=("b",)))
    assert found.best == "a"
    assert found.barred == ("b (1 trial failed)",)


def test_everything_is_escaped(tmp_path):
    label = f"arl{EVIL}"
    rows = rows_of(f"nlos{EVIL}", {label: (1.0, 1.0), "b": (0.5, 1.0)}, failed=(label,))
    kept = kept_from(rows, tmp_path, experiment=f"x{EVIL}", about=EVIL, name=EVIL)
    source = html_page.write(kept, load(), tmp_path).read_text()
    outline = Outline(source)
    assert outline.open == []
    assert sum(tag == "script" for tag, _ in outline.tags) == 3
    assert "<script>alert" not in source
    assert re.findall(r"\bon\w+=", source) == []
    told = json.loads(re.search(r'id="manifest">(.*?)</script>', source, re.DOTALL)[1])
    assert told["manifest"]["study"]["about"] == EVIL
    for file in (tmp_path / "tables").glob("*.md"):
        assert "<script>" not in file.read_text()
    assert all(len(file.name) < 120 and "<" not in file.name for file in (tmp_path / "tables").iterdir())


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no LaTeX is installed")
@pytest.mark.parametrize("label", ["arl[particles=50]", EVIL, r"\input{x}~^{}|µ–猫"])
def test_the_latex_tables_compile(tmp_path, label):
    rows = rows_of(f"nlos{label}", {label: (1.0, 1.0), "b": (0.5, 1.0)}, failed=(label,))
    html_page.write(kept_from(rows, tmp_path, name=label), load(), tmp_path)
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "all.tex"]
    done = subprocess.run(command, cwd=tmp_path / "tables", capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:]


def test_the_tables_on_disk_hold_the_numbers_of_the_page(written, swept):
    table = pd.read_csv(written / "tables" / "experiment-one.csv")
    assert len(table) == 15
    assert set(table["estimator"]) == set(SWEEP)
    mean = swept[swept["estimator"] == "good"].groupby("scenario")["mse"].mean() ** 0.5
    found = table[table["estimator"] == "good"].set_index("scenario")["rmse"]
    assert np.allclose(found.sort_index(), mean.sort_index())


def test_what_was_asked_for_and_is_not_there_is_said(tmp_path, swept):
    kept = kept_from(swept, tmp_path)._replace(gaps={("packet-drop/drop=0", "good"): 2})
    source = html_page.write(kept, load(), tmp_path).read_text()
    assert "packet-drop/drop=0, good: 2 of the planned trials are missing" in source


def test_a_run_directory_is_read_whole(tmp_path):
    from cooploc.analysis.execution.run import execute, prepare
    from cooploc.scenarios.studies.study import Study

    base = {"name": "small", "trials": 3, "baseline": "arl[particles=50]", "scenarios": ("trajectory[ticks=4]",)}
    execute(prepare(Study(**base, estimators=("arl[particles=50]", "ekf-local"))), tmp_path / "run")
    execute(prepare(Study(**base, estimators=("arl[particles=50]", "ekf-naive"))), tmp_path / "run")
    kept = kept_of(tmp_path / "run")
    assert list(dict.fromkeys(kept.rows["estimator"])) == ["arl[particles=50]", "ekf-local", "ekf-naive"]
    assert kept.gaps == {}
    next((tmp_path / "run" / "parts").glob("*ekf-local*")).write_bytes(b"corrupt")
    kept = kept_of(tmp_path / "run")
    assert kept.gaps == {("trajectory[ticks=4]", "ekf-local"): 3}


def test_an_estimator_that_fails_changes_no_rank_and_no_letter_of_the_others():
    calm = rows_of("nlos", {"a": (1.0, 1.0), "b": (0.5, 1.0), "c": (1.01, 1.0)}, trials=12)
    wild = rows_of("nlos", {"wild": (0.7, 1.0)}, trials=12)
    wild.loc[wild["trial"] > 5, "mse"] = np.inf
    alone, with_it = (ranked(rows) for rows in (calm, pd.concat([calm, wild], ignore_index=True)))
    assert alone == with_it
    assert set(alone[1]) == {"a", "b", "c"}
    assert not set(alone[1]["b"]) & set(alone[1]["a"])


def ranked(rows):
    """Mean ranks and letters of one scenario."""
    return run_numbers.ranked(compare(rows, "a", full=True), collect(rows))


def test_an_over_wide_covariance_is_not_called_best():
    found = standing(rows_of("nlos", {"a": (1.0, 1.0), "wide": (0.1, 0.001)}))
    assert (found.best, found.barred) == ("a", ("wide (over-wide, ANEES 0.00)",))
