"""Figures of results: sweeps are lines, other scenarios stand side by side, and a frontier joins what may be had."""

from itertools import pairwise

import matplotlib.pyplot as plt
import pandas as pd
import pytest
from made_runs import rows_of

import cooploc as cl
from cooploc.analysis.plot.results import frontier

TEAM = {"arl": (0.5, 1.0), "ekf-local": (0.4, 9.0)}


def test_a_sweep_has_its_parameters_as_columns_and_the_errors_of_each_value():
    found = cl.sweep("packet-drop[ticks=5]", ["dead-reckoning", "ekf-local"], trials=2, drop={0.5, 0}, robots=[2, 3])
    assert set(found["scenario"]) == {f"packet-drop/drop={d}[robots={n},ticks=5]" for d in (0, 0.5) for n in (2, 3)}
    assert found.groupby("scenario")[["drop", "robots"]].first().drop_duplicates().shape == (4, 2)
    assert list(dict.fromkeys(found["drop"])) == [0, 0.5]
    truth, stream = cl.simulate("packet-drop/drop=0.5[ticks=5]", trials=2, robots=3)
    same = found[(found["drop"] == 0.5) & (found["robots"] == 3)].reset_index(drop=True).drop(columns="drop")
    expected = cl.errors(truth, cl.run(["dead-reckoning", "ekf-local"], stream))
    pd.testing.assert_frame_equal(same.drop(columns="seconds"), expected.drop(columns="seconds"))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"drop": 0.5}, "nothing is swept"),
        ({"drop": set()}, "drop is empty"),
        ({"drpo": {0, 1}}, "no parameter 'drpo'"),
    ],
)
def test_a_sweep_of_nothing_or_of_something_unknown_is_refused(given, said):
    with pytest.raises(cl.BadInput, match=said):
        cl.sweep("packet-drop", "arl", **given)
    with pytest.raises(cl.BadInput, match=r"cl\.sweep runs estimators at each"):
        cl.simulate("packet-drop", drop={0, 0.5})


def test_a_sweep_is_drawn_as_lines_and_other_scenarios_side_by_side():
    swept = pd.concat([rows_of(f"packet-drop/drop={d}", TEAM) for d in (0.9, 0, 0.5)], ignore_index=True)
    ax = cl.plot.rmse(swept)
    (line,) = (
        line
        for line in ax.lines
        if line.get_color() == cl.plot.rmse(swept).lines[0].get_color() and len(line.get_xdata()) == 3
    )
    assert list(line.get_xdata()) == [0, 0.5, 0.9]
    assert ax.get_xlabel() == "drop"
    assert [text.get_text() for text in ax.get_xticklabels()] == ["0", "0.5", "0.9"]
    beside = cl.plot.rmse(pd.concat([swept, rows_of("nlos", TEAM)]))
    assert beside.get_xlabel() == ""
    assert len(beside.get_xticklabels()) == 4
    plt.close("all")


def test_a_column_can_be_drawn_along():
    tables = [rows_of(f"trajectory[ticks={n}]", TEAM).assign(length=n) for n in (5, 10)]
    ax = cl.plot.rmse(pd.concat(tables), over="length")
    assert ax.get_xlabel() == "length"
    for wrong, said in (
        ("lenght", "did you mean 'length'"),
        ("estimator", "numbers"),
        ("trial", "one scenario for each"),
    ):
        with pytest.raises(cl.BadInput, match=said):
            cl.plot.rmse(pd.concat(tables), over=wrong)
    plt.close("all")


def test_the_labels_of_many_scenarios_do_not_overlap():
    many = pd.concat([rows_of(f"robots-1-3/n={i}[ticks=50,drop=0.{i}]", TEAM) for i in range(1, 25)])
    ax = cl.plot.rmse(many)
    figure = ax.get_figure()
    figure.canvas.draw()
    boxes = [text.get_window_extent() for text in ax.get_xticklabels()]
    assert not any(a.overlaps(b) for a, b in pairwise(boxes))
    plt.close("all")


ROWS = pd.DataFrame(
    [
        ("silent", 0.0, 0.5, "consistent", False),
        ("dear", 100.0, 0.6, "consistent", False),  # sends, and is worse than silence
        ("liar", 10.0, 0.1, "over-confident", False),
        ("vague", 10.0, 0.2, "over-wide", False),
        ("centre", 10.0, 0.1, "consistent", True),
        ("fair", 20.0, 0.4, "not shown", False),
        ("same", 20.0, 0.45, "consistent", False),
        ("best", 200.0, 0.3, "conservative", False),
    ],
    columns=["estimator", "bytes", "rmse", "consistency", "centralised"],
)


def test_the_frontier_holds_what_no_honest_rule_beats_in_bytes_and_error():
    shuffled = ROWS.sample(frac=1, random_state=3)
    assert list(frontier(shuffled)["estimator"]) == ["silent", "fair", "best"]


def test_a_panel_for_each_scenario_and_the_frontier_in_it():
    frames = []
    for scenario in ("robots-1-3/n=1", "robots-1-3/n=3", "robots-1-3/n=2"):
        truth, stream = cl.simulate(scenario, trials=5, seed=1, ticks=5)
        frames.append(cl.errors(truth, cl.run(["ekf-local", "ekf-ci", "ekf-joint"], stream)))
    figure = cl.plot.pareto(pd.concat(frames)).figure
    shown = [ax for ax in figure.axes if ax.get_visible()]
    assert [ax.get_title(loc="left").partition("[")[0] for ax in shown] == [f"robots-1-3/n={n}" for n in (1, 3, 2)]
    figure.canvas.draw()
    below = [[label.get_text() for label in ax.get_xticklabels()] for ax in shown[1:]]  # nothing stands below these
    assert below == [["0", "10", "20", "50", "100"]] * 2
