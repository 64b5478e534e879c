"""One look for each estimator, whatever else is shown."""

import matplotlib.pyplot as plt
import pandas as pd
from made_runs import rows_of
from matplotlib.colors import to_rgb
from matplotlib.markers import MarkerStyle

import cooploc as cl
from cooploc.analysis.plot import style
from cooploc.analysis.plot.style import draw_marker
from cooploc.estimators import BUILTIN


def colours(ax):
    return {handle.get_label(): handle.get_markeredgecolor() for handle in ax.get_legend().legend_handles}


def test_every_built_in_estimator_has_a_look_that_no_other_has():
    found = style.looks(BUILTIN).values()
    assert len(set(found)) == len(BUILTIN)
    assert len({look.marker for look in found}) >= min(24, len(BUILTIN))  # apart in grey print


def test_every_marker_is_drawn_as_one_mark_that_can_be_hollow():
    row = pd.Series({"consistency": "over-confident", "centralised": False})
    for look in style.looks(BUILTIN).values():
        _, ax = plt.subplots()
        draw_marker(ax, 1.0, 2.0, row, look)
        assert [line.get_xydata().tolist() for line in ax.lines] == [[[1.0, 2.0]]]
        assert MarkerStyle(look.marker).is_filled()
        plt.close("all")


def test_a_look_does_not_depend_on_which_built_in_estimators_are_shown():
    everything = style.looks(BUILTIN)
    assert style.looks(["ekf-ci", "arl"]) == {name: everything[name] for name in ("ekf-ci", "arl")}


def test_variants_have_the_hue_of_their_method_and_others_their_own():
    names = ["arl[K=1]", "mine", "arl", "arl[K=2]", "yours"]
    found = style.looks(names)
    assert list(found) == names
    assert len({(look.colour, look.marker) for look in found.values()}) == 5
    assert found["arl"] == style.looks(BUILTIN)["arl"]
    red, green, blue = to_rgb(found["arl[K=1]"].colour)
    assert red < green < blue  # as the blue of arl
    assert {found["mine"].colour, found["yours"].colour} <= set(style.OTHERS)


def test_a_name_once_drawn_keeps_its_look_in_later_figures():
    rows = pd.concat([rows_of("nlos", {name: (1.0, 1.0)}) for name in ("first", "second")], ignore_index=True)
    both = colours(cl.plot.rmse(rows))
    alone = colours(cl.plot.tradeoff(rows[rows["estimator"] == "second"]))
    assert alone["second"] == both["second"] != both["first"]
    plt.close("all")


def test_only_the_figures_are_listed():
    assert {"rmse", "animate", "pareto"} <= set(dir(cl.plot))
    assert all(callable(getattr(cl.plot, name)) for name in dir(cl.plot))
