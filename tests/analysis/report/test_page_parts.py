"""The parts of a report's page that are made from a run alone: colours, parameters, trials, files, what failed."""

import base64
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_runs import Outline, kept_from, rows_of

from cooploc import scenarios
from cooploc.analysis.claims.trial_table import collect
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.plot import results, style
from cooploc.analysis.report import colours, html_page, html_table, page_figures, sentences
from cooploc.analysis.report import page_texts as page_texts
from cooploc.analysis.report.html_page import LONGEST_TITLE, heading, numbers_of
from cooploc.analysis.report.page_texts import introduce_estimators
from cooploc.analysis.report.parameter_meanings import MEANINGS
from cooploc.analysis.report.result_tables import failure_kinds, failures, scenario_tables, written
from cooploc.estimators import BUILTIN, make


@pytest.fixture(scope="module")
def rows():
    ones = {"arl": (1.0, 1.0), "ekf-local": (0.5, 1.0), "mrsl-rssi": (0.7, 9.0)}
    return pd.concat([rows_of(f"packet-drop/drop={d}", ones) for d in (0, 0.5)], ignore_index=True)


@pytest.mark.parametrize("colour", ["#000000", *(to for to in style.OTHERS), style.BLUE, style.BROWN, style.SKY])
def test_colours_by_night_can_be_read_on_the_dark_ground(colour):
    assert colours.contrast(colours.by_night(colour), colours.NIGHT) >= colours.LEAST


def test_every_colour_of_a_page_has_a_value_for_day_and_night():
    day, night = colours.variables(colours.as_variables('<g style="fill: #0173b2; stroke: #ffffff"/>'))
    assert day == "--c0173b2: #0173b2; --cffffff: #ffffff;"
    assert f"--cffffff: {colours.NIGHT};" in night


def test_text_of_the_page_has_enough_contrast_by_day_and_by_night():
    css = (Path(html_table.__file__).parent / "page" / "page.css.j2").read_text()
    for block in re.findall(r":root \{(.*?)\}", css, re.DOTALL):
        named = dict(re.findall(r"--(\w+): (#[0-9a-f]+)", block))
        for ink in ("ink", "soft", "link"):
            for ground in ("paper", "tint"):
                assert colours.contrast(named[ink], named[ground]) >= 4.5, (ink, ground)


def test_markers_differ_where_those_of_the_figures_do():
    marks = html_table.marks(style.looks(BUILTIN), set())
    assert len(set(marks.values())) == len(BUILTIN) > 20


def test_the_answer_says_who_is_lowest_by_how_much_and_who_is_over_confident(rows):
    table, results = compare(rows, "arl", full=True), collect(rows)
    said = sentences.lowest(sentences.standings(table, results), table, results)
    assert said.startswith("ekf-local has the lowest RMSE of those that qualify in all 2 scenarios, at least ")
    assert "below that of the next (arl, packet-drop/drop=0" in said
    assert sentences.over_confident(table).startswith("Over-confident: mrsl-rssi in 2 of 2 scenarios; its ANEES is ")


def test_the_answer_names_what_is_not_separable_and_no_more_than_a_few():
    names = {f"e{i}": (1.0, 1.0) for i in range(9)}
    rows = rows_of("nlos", names)
    rows["mse"] *= np.random.default_rng(5).lognormal(0, 0.5, len(rows))
    table, results = compare(rows, "e0", full=True), collect(rows)
    said = sentences.lowest(sentences.standings(table, results), table, results)
    assert "not separable from it: " in said
    assert said.endswith("others.")
    assert sentences.over_confident(table) == "No estimator was found over-confident."
    few, some = rows[rows["trial"] < 3], collect(rows[rows["trial"] < 3])
    table = compare(few, "e0", full=True)
    assert sentences.lowest(sentences.standings(table, some), table, some).startswith(
        "Nothing is separable with 3 trials"
    )


def test_every_parameter_of_a_built_in_scenario_has_a_meaning():
    models = {scenarios.family(name).model_class(name) for name in scenarios.BUILTIN}
    fields = {field for model in models for field in model.model_fields} - {"data"}
    assert fields - set(MEANINGS) == set()


def test_parameters_that_scenarios_share_are_said_once_and_others_beside_each(rows):
    given = {f"packet-drop/drop={d}": {"robots": 5, "side": 6.0, "drop": d} for d in (0, 0.5)}
    places, parameters = scenario_tables(compare(rows, "arl", full=True), given)
    assert [column.head for column in places.columns] == ["scenario", "robots", "trials", "baseline", "drop", "stream"]
    assert {row["parameter"]: (row["value"], row["unit"]) for row in parameters.rows} == {
        "robots": ("5", ""),
        "side": ("6", "m"),
        "drop": ("differs", ""),
    }
    assert [written(value) for value in (np.inf, None, True, [[0, 1], [2, 3]], [])] == [
        *("∞", "none", "yes", "0, 1; 2, 3", "none")
    ]


def test_the_trials_of_a_page_are_those_of_the_run(rows, tmp_path):
    rows = rows.copy()
    rows.loc[(rows["estimator"] == "arl") & (rows["trial"] == 3), ["failure", "mse"]] = ["lost", np.nan]
    table, results = compare(rows, "ekf-local", full=True), collect(rows)
    trials = html_page.rmse_by_trial(table, results)
    first, *_ = html_page.compact(trials)
    steps = np.frombuffer(base64.b64decode(first["steps"]), "<u2").reshape(3, -1)
    known = np.exp(first["low"] + steps / (html_page.ABSENT - 1) * (first["high"] - first["low"]))
    known = np.where(steps == html_page.ABSENT, np.nan, known)
    assert np.allclose(known.T, trials[first["scenario"]].to_numpy(), rtol=1e-3, equal_nan=True)
    assert np.isnan(known[0, 3])
    html_page.write_trial_files(trials, tmp_path)
    file = pd.read_csv(tmp_path / html_page.addresses(list(trials))[first["scenario"]])
    assert list(file) == ["trial", *first["estimators"]]
    assert len(file) == 8


def test_failures_that_repeat_are_counted_whatever_numbers_they_hold():
    rows = rows_of("nlos", {"a": (1.0, 1.0), "b": (1.0, 1.0)})
    for i, at in enumerate((0, 3, 9)):
        rows.loc[at, ["failure", "traceback"]] = [f"ValueError: nan at tick {i}", "where"]
    rows.loc[12, ["failure", "traceback"]] = ["OSError: other", "there"]
    first, second = failure_kinds(rows)
    assert (first.message, first.trials) == ("ValueError: nan at tick 0", 3)
    assert first.where == [("nlos", "a", 2), ("nlos", "b", 1)]
    assert second.trials == 1


def test_a_failure_of_one_estimator_in_many_scenarios_is_one_line():
    made = [rows_of(f"nlos/n={n}", {"a": (1.0, 1.0), "b": (1.0, 1.0)}, trials=3, failed=("b",)) for n in (1, 2)]
    ((line, _),) = failures(pd.concat(made))
    assert line.startswith("b, 2 trials of 2 scenarios (nlos/n=1, nlos/n=2): ")


@pytest.mark.parametrize(
    ("study", "title", "below"),
    [
        ({"title": "Lost packets", "about": "When do they matter?"}, "Lost packets", "When do they matter?"),
        ({"title": "", "about": "When do they matter?"}, "When do they matter?", ""),
        ({"about": "word " * LONGEST_TITLE}, "mine", "word " * LONGEST_TITLE),
    ],
)
def test_a_page_is_called_as_the_user_says_else_what_its_study_is_about_or_the_studys_name(study, title, below):
    found = heading({"study": {"name": "mine", **study}})
    assert (found["title"], found["about"]) == (title, below)


def test_two_centralised_configurations_are_two_shades_of_grey():
    looks = style.looks(["ekf-joint", "ekf-joint[anchor_reading=rssi]"])
    one, other = html_table.marks(looks, set(looks)).values()
    assert one != other
    assert all(
        len(set(colour)) == 1 for colour in (re.findall("..", hue) for hue in re.findall(r"--c(\w{6})", one + other))
    )


def test_estimators_are_introduced_once_with_their_configurations_and_no_foreign_code_runs(tmp_path):
    foreign = f"{tmp_path / 'never.py'}:Mine"
    rows = rows_of("nlos", dict.fromkeys(("ekf-local", "ekf-local[anchor_reading=rssi]", foreign), (1.0, 1.0)))
    one, other = introduce_estimators(rows.assign(senses="RSSI"), {})
    assert one.name == "ekf-local"
    assert "EKF" in one.about
    assert "Probabilistic Robotics" in one.source
    assert one.senses == "RSSI"
    assert dict(one.defaults)["gate"] == f"{make('ekf-local').gate:g}"
    assert [each.given for each in one.configurations] == ["", "anchor_reading=rssi"]
    assert (other.about, other.defaults) == ("Not built in.", [])


def test_files_of_the_run_are_linked_where_the_page_lies_in_it_and_only_named_elsewhere(tmp_path):
    run = tmp_path / "run"
    (run / "parts").mkdir(parents=True)
    (run / "parts" / "a b.parquet").touch()
    (run / "manifest.json").touch()
    inside = [file.address for folder in html_page.run_files(run, run / "report") for file in folder.files]
    assert inside == ["../manifest.json", "../parts/a%20b.parquet"]
    outside = [file for folder in html_page.run_files(run, tmp_path / "page") for file in folder.files]
    assert [file.address for file in outside] == ["", ""]
    assert [file.name for file in outside] == ["manifest.json", "parts/a b.parquet"]


def test_what_is_to_be_copied_says_what_was_run(rows, tmp_path):
    said = page_texts.paragraph(numbers_of(kept_from(rows, tmp_path)))
    assert "We compared 3 estimators in 2 scenarios with cooploc 0 (8 trials a scenario, random seed 3)" in said
    assert "baseline (arl)" in said
    entry = page_texts.bibtex("1.2", "abc")
    assert "version = {1.2}" in entry
    assert "commit abc" in entry
    assert entry.count("{") == entry.count("}")
    cited = (Path(__file__).parents[3] / "CITATION.cff").read_text()
    assert f'title: "{page_texts.TITLE}"' in cited


def test_what_a_figure_says_is_never_taken_for_a_style_or_a_coordinate():
    label = 'at 0.125 style="fill: red" m'
    (figure,) = results.compose([lambda ax: ax.set_title(label) and None], style.PAGE, results.PANEL)
    page, css = page_figures.shared_styles(page_figures.inline(figure, 1, "a label"))
    assert f">{label}<" in page.replace("&quot;", '"')
    assert "fill: red" not in css
    assert 'class="s0"' in page
    assert Outline(page).open == []
