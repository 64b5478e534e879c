"""Figures of results: sweeps are lines, other scenarios stand side by side, and a frontier joins what may be had."""

from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from made_runs import rows_of
from matplotlib.backends.backend_agg import FigureCanvasAgg

import cooploc as cl
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.plot import results, style
from cooploc.analysis.plot.results import frontier

TEAM = {"arl": (0.5, 1.0), "ekf-local": (0.4, 9.0)}


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def test_a_sweep_has_its_parameters_as_columns_and_the_errors_of_each_value():
    found = cl.sweep("packet-drop[ticks=5]", ["dead-reckoning", "ekf-local"], trials=2, drop={0.5, 0}, robots=[2, 3])
    assert set(found["scenario"]) == {f"packet-drop/drop={d}[robots={n},ticks=5]" for d in (0, 0.5) for n in (2, 3)}
    assert list(dict.fromkeys(found["drop"])) == [0, 0.5]
    truth, stream = cl.simulate("packet-drop/drop=0.5[ticks=5]", trials=2, robots=3)
    same = found[(found["drop"] == 0.5) & (found["robots"] == 3)].reset_index(drop=True).drop(columns="drop")
    expected = cl.errors(truth, cl.run(["dead-reckoning", "ekf-local"], stream))
    pd.testing.assert_frame_equal(same.drop(columns="seconds"), expected.drop(columns="seconds"))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"drop": 0.5}, "nothing is swept"),
        ({"drop": set()}, "nothing is swept"),
        ({"drpo": {0, 1}}, "no parameter 'drpo'"),
    ],
)
def test_a_sweep_of_nothing_or_of_something_unknown_is_refused(given, said):
    with pytest.raises(cl.BadInput, match=said):
        cl.sweep("packet-drop", "arl", **given)
    with pytest.raises(cl.BadInput, match=r"cl\.sweep runs estimators at each"):
        cl.simulate("packet-drop", drop={0, 0.5})


@pytest.mark.slow
def test_a_sweep_is_drawn_as_lines_and_other_scenarios_side_by_side():
    swept = pd.concat([rows_of(f"packet-drop/drop={d}", TEAM) for d in (0.9, 0, 0.5)], ignore_index=True)
    ax = cl.plot.rmse(swept)
    assert [0, 0.5, 0.9] in [list(line.get_xdata()) for line in ax.lines]
    assert ax.get_xlabel() == "share of packets that are lost"
    assert [text.get_text() for text in ax.get_xticklabels()] == ["0", "0.5", "0.9"]
    beside = cl.plot.rmse(pd.concat([swept, rows_of("nlos", TEAM)]))
    assert (beside.get_xlabel(), len(beside.get_xticklabels())) == ("", 4)


def test_where_an_estimator_failed_its_curve_has_a_gap():
    lost = [rows_of(f"nlos[eta={eta}]", {"arl": (0.5, 1.0)}) for eta in (2, 3, 4)]
    lost[1]["mse"] = np.nan
    swept = pd.concat([*lost, *(rows_of(f"nlos[eta={eta}]", {"ekf-local": (0.4, 1.0)}) for eta in (2, 3, 4))])
    curves = [line.get_ydata() for line in cl.plot.rmse(swept).lines if list(line.get_xdata()) == [2, 3, 4]]
    assert [list(np.isnan(curve)) for curve in curves] == [[False, True, False], [False] * 3]
    plt.close("all")


@pytest.mark.slow
def test_a_parameter_of_estimators_is_swept_too_on_the_scale_where_its_values_are_more_even():
    ax = cl.plot.rmse(rows_of("nlos", {f"{name}[particles={n}]": (1.0, 1.0) for name in "ab" for n in (50, 200, 800)}))
    assert ax.get_legend_handles_labels()[1] == ["a", "b"]
    assert (ax.get_xlabel(), ax.get_xscale()) == ("particles", "log")
    assert [text.get_text() for text in ax.get_xticklabels()] == ["50", "200", "800"]
    even = cl.plot.rmse(pd.concat([rows_of(f"nlos[eta={eta}]", TEAM) for eta in (2, 3, 4)]))
    assert (even.get_xlabel(), even.get_xscale()) == ("path-loss exponent", "linear")
    close = cl.plot.rmse(pd.concat([rows_of(f"packet-drop/drop={d}", TEAM) for d in (0, 0.01, 0.5, 1)]))
    assert [text.get_text() for text in close.get_xticklabels()] == ["", "0.01", "0.5", "1"]
    larger = {name: (9 * rmse, anees) for name, (rmse, anees) in TEAM.items()}
    both = enumerate((TEAM, larger), 1)
    grid = pd.concat([rows_of(f"nlos/n={n}[eta={eta}]", team) for n, team in both for eta in (2, 3, 4)])
    panels = cl.plot.rmse(grid).figure.axes
    assert [panel.get_xlabel() for panel in panels] == ["path-loss exponent"] * 2
    assert [panel.get_ylabel() for panel in panels] == ["position RMSE [m]", ""]
    assert panels[0].get_ylim() == panels[1].get_ylim() == pytest.approx((0.8 * 0.4, 1.25 * 4.5), rel=0.1)
    of_panels = [{float(y) for line in panel.lines for y in line.get_ydata()} for panel in panels]
    assert max(of_panels[0]) < 1 < min(of_panels[1])
    assert [panel.get_title(loc="left") for panel in panels] == ["nlos/n=1", "nlos/n=2"]
    assert cl.plot.rmse(grid, ax=plt.figure().subplots()).get_xlabel() == ""  # side by side, in one panel
    plt.close("all")


@pytest.mark.slow
@pytest.mark.parametrize("columns", [1, 2])
def test_a_legend_of_long_names_stays_in_its_figure(columns):
    names = {f"mrsl-rssi[particles={n}]": (1.0, 1.0) for n in range(100, 1000, 100)}
    table = compare(rows_of("nlos", names), next(iter(names)), full=True).assign(floor=0.1)
    figure = results.scatter(table, ("bytes",), style.pens(names), str, style.PAPER[columns])
    FigureCanvasAgg(figure).draw()
    legend = figure.legends[0].get_window_extent()
    assert 0 <= legend.x0 < legend.x1 <= figure.bbox.width
    assert figure.axes[0].get_position().height > 0.3


@pytest.mark.slow
def test_of_many_estimators_a_page_draws_those_with_the_smallest_errors_and_the_baseline():
    names = {"arl": (5.0, 1.0)} | {f"ekf-ci[gate={n},inflation=2]": (1.0, 1.0) for n in range(1, 60)}
    table = compare(rows_of("nlos", names), "arl", full=True).assign(floor=0.1)
    figure = results.ranking([table], style.pens(names), str)
    FigureCanvasAgg(figure).draw()
    (ax,) = figure.axes
    shown = [text.get_text() for text in ax.get_yticklabels()][::-1]
    assert shown == [*table.sort_values("rmse")["estimator"].head(results.FIT), "arl"]
    assert ax.get_xlabel() == "position RMSE [m], 49 of 60 estimators"
    boxes = [text.get_window_extent() for text in ax.get_yticklabels()]
    assert not any(a.overlaps(b) for a, b in pairwise(boxes))
    legend = results.scatter(table, ("anees",), style.pens(names), str).legends[0].get_texts()
    assert sorted(text.get_text() for text in legend) == sorted(shown)


def test_of_an_estimator_in_a_file_the_last_folder_alone_is_shown():
    ax = cl.plot.rmse(rows_of("nlos", {f"/a/{'deep/' * 40}new/mine.py:Mine[gate=9]": (1.0, 1.0), "arl": (1.0, 1.0)}))
    assert ax.get_legend_handles_labels()[1] == ["new/mine.py:Mine[gate=9]", "arl"]
    ax.figure.canvas.draw()
    assert ax.get_position().width > 0.3
    plt.close("all")


@pytest.mark.slow
def test_the_labels_of_many_scenarios_do_not_overlap():
    ax = cl.plot.rmse(pd.concat([rows_of(f"robots-1-3/n={i}[ticks=50,drop=0.{i}]", TEAM) for i in range(1, 25)]))
    ax.figure.canvas.draw()
    assert {text.get_rotation() for text in (*ax.get_xticklabels(), *ax.get_yticklabels())} == {0.0}
    boxes = [text.get_window_extent() for text in ax.get_yticklabels()]
    assert len(boxes) == 24
    assert not any(a.overlaps(b) for a, b in pairwise(boxes))


@pytest.mark.parametrize("lost", [(), ("e3",), tuple(f"e{i}" for i in range(9))])
def test_many_estimators_are_rows_in_order_of_error_and_those_without_one_stand_below(lost):
    rows = rows_of("nlos", {f"e{i}": (0.1 * (9 - i), 1.0) for i in range(9)})
    rows.loc[rows["estimator"].isin(lost), "mse"] = float("nan")
    ax = cl.plot.rmse(rows)
    names = [text.get_text() for text in ax.get_yticklabels()]
    failed = [f"e{i} (failed in trials)" for i in range(9) if f"e{i}" in lost]
    assert names == failed + [f"e{i}" for i in range(9) if f"e{i}" not in lost]
    drawn = [line for line in ax.lines if line.get_marker() not in ("None", "", None) and len(line.get_xdata()) == 1]
    assert sum(bool(line.get_xdata()[0] > 0) for line in drawn) == 9 - len(lost)
    assert ax.get_legend() is None


def test_the_frontier_holds_what_no_honest_rule_beats_in_bytes_and_error():
    rows = [
        ("silent", 0.0, 0.5, "consistent", False),
        ("dear", 100.0, 0.6, "consistent", False),  # sends, and is worse than silence
        ("liar", 10.0, 0.1, "over-confident", False),
        ("vague", 10.0, 0.2, "over-wide", False),
        ("centre", 10.0, 0.1, "consistent", True),
        ("fair", 20.0, 0.4, "not shown", False),
        ("same", 20.0, 0.45, "consistent", False),
        ("best", 200.0, 0.3, "conservative", False),
    ]
    rows = [(*row, "") for row in rows] + [("cheat", 1.0, 0.2, "consistent", False, "failed: no_cheating")]
    table = pd.DataFrame(rows, columns=["estimator", "bytes", "rmse", "consistency", "centralised", "certificate"])
    assert list(frontier(table.sample(frac=1, random_state=3))["estimator"]) == ["silent", "fair", "best"]


def texts_of(figure):
    legends = [*figure.legends, *(ax.get_legend() for ax in figure.axes if ax.get_legend())]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


@pytest.mark.slow
def test_the_frontier_is_drawn_in_a_panel_for_each_scenario():
    scenarios = ["robots-1-3/n=1", "robots-1-3/n=3", "robots-1-3/n=2"]
    figure = cl.plot.pareto(pd.concat([rows_of(name, TEAM) for name in scenarios])).figure
    assert [ax.get_title(loc="left").partition(",")[0] for ax in figure.axes] == scenarios
    assert "frontier" not in texts_of(figure)  # one of the two is over-confident: of one point nothing is drawn
    two = {"arl": (0.5, 1.0), "ekf-ci": (0.4, 1.0)}
    assert "frontier" in texts_of(cl.plot.pareto(rows_of(scenarios[1], two)).figure)
    figure.canvas.draw()
    below = [[label.get_text() for label in ax.get_xticklabels()] for ax in figure.axes[1:]]  # nothing is below these
    assert below == [["0", "10", "20", "50"]] * 2


@pytest.mark.parametrize(
    "draw", [cl.plot.claims, cl.plot.information, cl.plot.readings, cl.plot.sensitivity, cl.plot.tuning]
)
def test_a_figure_of_another_table_is_refused(draw):
    for given in (pd.DataFrame({"a": [1]}), "runs/mine", None):
        with pytest.raises(cl.BadInput, match=r"this draws what cl[.]\w+.* returns; it was given something else, a "):
            draw(given)
