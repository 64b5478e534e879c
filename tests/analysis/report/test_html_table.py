"""Tables of the page: what is escaped, what rows are sorted by, and what stands below what."""

from made_runs import EVIL, Outline
from markupsafe import Markup

from cooploc.analysis.formats import interval, metres
from cooploc.analysis.report.html_table import Wording, html
from cooploc.analysis.report.run_numbers import short_labels
from cooploc.analysis.report.tables import Table, number_column, text_column

COLUMNS = (
    text_column("scenario"),
    text_column("estimator"),
    text_column("remark"),
    number_column("RMSE [m]", "rmse", form=metres),
    number_column("95 %", "low", "high", form=interval(metres)),
    number_column("NLL", "nll", form=metres, collapsed=True),
    text_column("empty"),
)
LONG = "ekf[particles=500,anchor_reading=rssi]"
ROW = {"estimator": "a|<b>", "remark": "", "rmse": 0.123456, "low": 0.1, "high": 0.2, "nll": 1.0, "empty": ""}
ROWS = [{**ROW, "scenario": EVIL}, {**ROW, "scenario": "s", "estimator": LONG, "remark": f"as {LONG}"}]
TABLE = Table("t", "more", COLUMNS, ROWS, {"data-estimator": "estimator"})


def test_rows_are_sorted_by_their_values_and_intervals_stand_below_them():
    source = html(TABLE)
    assert '<td class="r" data-sort="0.123456">0.123<small>0.100 to 0.200</small></td>' in source
    assert '<th scope="row">a|&lt;b&gt;</th>' in html(TABLE, group="scenario")
    assert source.count('scope="col"') == 4  # the empty column is left out, interval and remark have none


def test_what_a_run_wrote_never_becomes_a_tag():
    outline = Outline(html(TABLE, group="scenario"))
    assert outline.open == []
    assert {tag for tag, _ in outline.tags}.isdisjoint({"script", "b"})


def test_rows_in_groups_have_a_head_for_each():
    source = html(TABLE, group="scenario")
    assert source.count("<tbody") == source.count('scope="rowgroup"') == 2
    assert '<tbody data-scenario="s">' in source


def test_columns_that_are_read_less_are_shown_on_demand():
    assert '<input type="checkbox"> all columns' in html(TABLE)
    plain = Table("t", "", COLUMNS[:2], ROWS)
    assert "checkbox" not in html(plain)


def test_estimators_get_their_marker_short_label_and_a_link_and_numbers_lead_to_their_trials():
    names = short_labels([LONG], {"raw": "anchor_reading=rssi, particles=500"})
    wording = Wording(names, {LONG: Markup("<svg></svg>")}, {LONG: "estimator-1"}, {"s": "trials/001-s.csv"})
    source = html(TABLE, wording)
    assert f'<svg></svg><a href="#estimator-1" title="{LONG}">ekf [raw]</a>' in source
    assert '<a class="trials" href="trials/001-s.csv" title="every trial">0.123</a>' in source
