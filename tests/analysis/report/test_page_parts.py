"""The parts of a report's page that are made from a run alone: colours, parameters, trials, files, what failed."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_runs import kept_from, rows_of

from cooploc import scenarios
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.consistency import COLLAPSED, LEAST_COVERAGE, OVER_CONFIDENT
from cooploc.analysis.metrics.ranking import FEWEST_SEPARATED, SEPARATED
from cooploc.analysis.plot import style
from cooploc.analysis.report import html_page
from cooploc.analysis.report.result_tables import failures, parameter_text, scenario_tables
from cooploc.analysis.report.run_numbers import group_by_sweep, numbers_of, rows_of_estimator_sweeps
from cooploc.analysis.report.tables import read_toml, words
from cooploc.estimators import BUILTIN, make


@pytest.fixture
def rows():
    ones = {"arl": (1.0, 1.0), "ekf-local": (0.5, 1.0), "mrsl-rssi": (0.7, 9.0)}
    return pd.concat([rows_of(f"packet-drop/drop={d}", ones) for d in (0, 0.5)], ignore_index=True)


def test_markers_differ_where_those_of_the_figures_do():
    assert len({html_page.marker(look, False) for look in style.pens(BUILTIN).values()}) == len(BUILTIN) > 20


def test_parameters_that_scenarios_share_are_said_once_and_others_with_their_values(rows):
    given = {f"packet-drop/drop={d}": {"robots": 5, "side": 6.0, "drop": d} for d in (0, 0.5)}
    places, parameters = scenario_tables(compare(rows, "arl", full=True), given)
    assert [column.head for column in places.columns] == ["scenario", "robots", "trials", "baseline", "stream"]
    written = {row["parameter"]: (row["value"], row["unit"]) for row in parameters.rows}
    assert written == {"robots": ("5", ""), "side": ("6", "m"), "drop": ("0 (1); 0.5 (1)", "")}
    values = [np.inf, None, True, [[0, 1], [2, 3]], []]
    assert list(map(parameter_text, values)) == ["∞", "none", "yes", "0, 1; 2, 3", "none"]
    models = {scenarios.family(name).model_class(name) for name in scenarios.BUILTIN}
    assert {field for model in models for field in model.model_fields} - {"data"} <= set(read_toml("parameters.toml"))


def test_estimators_are_introduced_once_with_their_configurations_and_no_foreign_code_runs(tmp_path):
    foreign = f"{tmp_path / 'never.py'}:Mine"
    rows = rows_of("nlos", dict.fromkeys(("ekf-local", "ekf-local[anchor_reading=rssi]", foreign), (1.0, 1.0)))
    one, other = html_page.introduce_estimators(rows.assign(senses="RSSI"))
    assert (one["name"], one["senses"]) == ("ekf-local", "RSSI")
    assert "EKF" in one["about"]
    assert "Probabilistic Robotics" in one["source"]
    assert one["defaults"]["gate"] == f"{make('ekf-local').gate:g}"
    assert [each["given"] for each in one["configurations"]] == ["", "anchor_reading=rssi"]
    assert (other["about"], other["defaults"]) == ("Not built in.", {})


def test_what_is_to_be_copied_says_what_was_run_and_the_methods_how_the_run_ended(rows, tmp_path):
    text = html_page.paragraph(numbers_of(kept_from(rows, tmp_path)))
    assert "We compared 3 estimators in 2 scenarios with cooploc 0 (8 trials a scenario, random seed 3)" in text
    assert "baseline (arl)" in text
    entry = html_page.bibtex("1.2", "abc")
    assert all(words in entry for words in ("version = {1.2}", "commit abc"))
    assert entry.count("{") == entry.count("}")
    title = re.search(r"title = {(.*)},", entry)[1]
    assert f'title: "{title}"' in (Path(__file__).parents[3] / "CITATION.cff").read_text()
    fixed, decided = html_page.methods(False), html_page.methods(True)
    assert list(decided) == [*fixed, "Decided"]
    assert {term for term in fixed if fixed[term] != decided[term]} == {"p (Holm)", "Ties", "Rank, group"}
    assert not re.search(r"[{}]", "".join(decided.values()))


def test_failures_that_repeat_are_counted_though_their_numbers_differ():
    rows = rows_of("nlos", {"a": (1.0, 1.0), "b": (1.0, 1.0)})
    for i, at in enumerate((0, 3, 9)):
        rows.loc[at, ["failure", "traceback"]] = [f"ValueError: nan at tick {i}", "where"]
    rows.loc[12, ["failure", "traceback"]] = ["OSError: other", "there"]
    first, second = failures(rows)
    assert (first.message, first.trials) == ("ValueError: nan at tick 0", 3)
    assert first.where == ["nlos, a: trials 0, 3", "nlos, b: trial 1"]
    assert second.trials == 1


def test_captions_state_the_limits_that_the_code_has():
    captions, marks = words("captions"), words("marks")
    assert f"above {OVER_CONFIDENT:g}," in captions["consistency"]
    assert f"ANEES exceeds {COLLAPSED:g}" in captions["consistency"]
    assert f"above {OVER_CONFIDENT:g}," in marks["o"]
    for text in (captions["consistency"], marks["o"], words("remarks")["over-confident"]):
        assert f"{100 * LEAST_COVERAGE:.0f} %" in text
    assert f"below {SEPARATED:g}, over at least {FEWEST_SEPARATED} trials" in captions["board"]


def test_scenarios_that_differ_in_three_numbers_alone_are_a_sweep():
    grid = [f"a/n={n}[x={x}]" for n in (1, 2) for x in (1, 2, 3)]
    labels = [*grid, "b[x=1]", "b[x=2]", "c"]
    expected = {("a/n=1", "x"): grid[:3], ("a/n=2", "x"): grid[3:], ("", ""): ["b[x=1]", "b[x=2]", "c"]}
    assert group_by_sweep(labels) == expected
    rows = pd.DataFrame({"estimator": ["a[x=1]", "a[x=2]", "a[x=3]", "b[x=1]", "b[x=2]", "c", "d[y=1]"]})
    ((parameter, found),) = rows_of_estimator_sweeps(rows).items()
    assert (parameter, found["family"].tolist(), found["value"].tolist()) == ("x", ["a"] * 3, [1.0, 2.0, 3.0])
