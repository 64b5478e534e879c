import pandas as pd
import pytest

import cooploc as cl
from cooploc.analysis.plot.results import frontier

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


def test_who_sends_nothing_stands_at_zero():
    truth, stream = cl.simulate("robots-1-3/n=2", trials=5, seed=1, ticks=5)
    ax = cl.plot.pareto(cl.errors(truth, cl.run(["ekf-local"], stream)))
    assert ax.get_xticklabels()[0].get_text() == "0"
    assert min(line.get_xdata()[0] for line in ax.lines if len(line.get_xdata())) == pytest.approx(ax.get_xticks()[0])
