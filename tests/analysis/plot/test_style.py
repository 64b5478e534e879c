"""One look for each estimator, whatever else is shown."""

import matplotlib.pyplot as plt
import pandas as pd
import seaborn
from made_runs import rows_of
from matplotlib.colors import to_hex, to_rgb
from matplotlib.markers import MarkerStyle

import cooploc as cl
from cooploc.analysis.plot import style
from cooploc.estimators import BUILTIN


def test_every_built_in_estimator_has_a_look_of_its_own_whatever_else_is_shown():
    found = style.pens(BUILTIN)
    assert len(set(found.values())) == len(BUILTIN)
    markers = {look.marker for look in found.values()}
    assert len(markers) >= min(24, len(BUILTIN))  # differ in grey print
    assert all(MarkerStyle(marker).is_filled() for marker in markers)  # can be hollow
    assert style.pens(["ekf-ci", "arl"]) == {name: found[name] for name in ("ekf-ci", "arl")}


def test_colours_are_seaborns_for_the_colour_blind():
    own = style.BLUE, style.ORANGE, style.GREEN, style.VERMILION, style.PURPLE, style.BROWN, style.SKY
    theirs = seaborn.color_palette("colorblind", 10)
    assert list(own) == [to_hex(theirs[k]) for k in (0, 1, 2, 3, 4, 5, 9)]


def test_variants_have_the_hue_of_their_method_and_others_their_own():
    names = ["arl[K=1]", "mine", "arl", "arl[K=2]", "yours"]
    found = style.pens(names)
    assert list(found) == names
    assert len({(look.colour, look.marker) for look in found.values()}) == 5
    assert found["arl"] == style.pens(BUILTIN)["arl"]
    red, green, blue = to_rgb(found["arl[K=1]"].colour)
    assert red < green < blue  # as the blue of arl
    assert {found["mine"].colour, found["yours"].colour} <= set(style.OTHERS)


def test_a_name_once_drawn_keeps_its_look_in_later_figures():
    rows = pd.concat([rows_of("nlos", {name: (1.0, 1.0)}) for name in ("first", "second")], ignore_index=True)
    axes = cl.plot.rmse(rows), cl.plot.tradeoff(rows[rows["estimator"] == "second"])
    both, alone = ({one.get_label(): one.get_mec() for one in ax.get_legend().legend_handles} for ax in axes)
    assert alone["second"] == both["second"] != both["first"]
    plt.close("all")


def test_only_the_figures_are_listed():
    assert {"rmse", "animate", "pareto"} <= set(dir(cl.plot))
    assert all(callable(getattr(cl.plot, name)) for name in dir(cl.plot))
