"""One table in its five forms, and how numbers are written in all of them."""

import csv
import io

import numpy as np
import pandas as pd
import pytest
from made_runs import EVIL, Outline
from markupsafe import Markup
from rich.console import Console

from cooploc.analysis.formats import (
    change,
    count,
    duration,
    interval,
    join_words,
    metres,
    microseconds,
    p_value,
    percent,
    ratio,
)
from cooploc.analysis.metrics.ranking import short_certificate
from cooploc.analysis.report.html_page import Wording, html
from cooploc.analysis.report.labels import short_labels
from cooploc.analysis.report.result_tables import best, essential_columns, sort_rows
from cooploc.analysis.report.sentences import Standing
from cooploc.analysis.report.tables import Table, number_column, text_column
from cooploc.estimators.errors import BadInput, count_of

COLUMNS = (
    text_column("who", "name"),
    number_column("RMSE", "rmse", form=metres),
    number_column("95 %", "low", "high", form=interval(ratio)),
)
ROWS = [
    {"name": "a|b_c<d>", "rmse": 0.123456, "low": 0.1, "high": 0.2, "mark": "x<y"},
    {"name": "e", "rmse": np.nan, "low": np.nan, "high": 1, "mark": ""},
]
TABLE = Table("t", "50 % & more", COLUMNS, ROWS, {"data-mark": "mark"})


def printed(table, width=80):
    console = Console(markup=False, width=width)
    with console.capture() as captured:
        console.print(table.terminal())
    return captured.get()


def test_csv_has_the_values_in_full_and_nothing_where_they_are_absent():
    rows = list(csv.DictReader(io.StringIO(TABLE.csv())))
    assert rows[0] == {"name": "a|b_c<d>", "rmse": "0.123456", "low": "0.1", "high": "0.2"}
    assert rows[1]["rmse"] == rows[1]["low"] == ""


def test_latex_and_markdown_are_escaped():
    assert r"a\textbar{}b\_c\textless{}d\textgreater{} & 0.123 & 0.10 to 0.20 \\" in TABLE.latex()
    assert r"\caption{50 \% \& more}" in TABLE.latex()
    assert r"| a\|b\_c&lt;d&gt; | 0.123 | 0.10 to 0.20 |" in TABLE.markdown()


def test_a_terminal_leaves_out_empty_columns_and_folds_and_drops_others_where_it_is_narrow():
    silent = Table("t", "title", (*COLUMNS, text_column("remark")), [{**row, "remark": ""} for row in ROWS])
    assert "0.10 to 0.20" in printed(silent)
    assert "remark" not in printed(silent)
    columns = (COLUMNS[0], text_column("mark", second_line=True), text_column("more", second_line=True), *COLUMNS[1:])
    folded = printed(Table("t", "", columns, [{**row, "more": "z"} for row in ROWS]), 36)
    lines = [line.split() for line in folded.split("\n")]
    assert [["mark"] in lines, ["more", "RMSE", "95", "%"] in lines, ["x<y"] in lines] == [True] * 3
    assert lines.count(["z"]) == 2
    long = {**ROWS[0], COLUMNS[0].keys[0]: "density=exact,M=1,K=1,weights=exact", "more": "z"}
    assert "density=exact,M=1,K=1," in printed(Table("t", "", columns, [long]), 46).split()
    name, bracket = "mine.py:Mine", "[trust=0.25]"  # together too wide, and in two lines not
    narrow = printed(Table("t", "", columns, [{**long, COLUMNS[0].keys[0]: name + bracket}]), 40)
    assert {name, bracket} <= {*narrow.split()}
    before = number_column("cost\nbefore", "rmse", form=metres, priority=1)
    pair = before, number_column("cost\nafter", "rmse", form=metres, second_line=True, priority=1)
    assert "not shown at this width: cost\n" in printed(Table("t", "", (*COLUMNS, *pair), ROWS), 34)


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ([ratio(v) for v in (-0.001, 457.63, 1.3e6)], ["0.00", "457.6", "1.3e+06"]),
        ([ratio(v) for v in (np.inf, -np.inf, np.nan)], ["∞", "-∞", ""]),
        ([percent(v, 0) for v in (0.945, -0.001, np.nan)], ["94 %", "0 %", ""]),
        ([change(v) for v in (0.0, 1e-6, -0.2, 0.053, -0.0014)], ["0 %", "0.00 %", "-20 %", "+5.3 %", "-0.14 %"]),
        ([percent(v) for v in (0.995, 0.99984)], ["99.50 %", "99.984 %"]),
        ([p_value(p) for p in (0.04999, 0.0009, np.nan)], ["0.050", "<0.001", ""]),
        ([interval(change)(-0.2, 0.05), interval(metres)(np.nan, 1.0)], ["-20 % to +5.0 %", ""]),
        ([metres(0.12345), count(20.0), microseconds(1.2e-5)], ["0.123", "20", "12"]),
        ([duration(s) for s in (40, 720, 5400)], ["40 s", "12 min", "1.5 h"]),
        (
            [count_of(1, "trial"), count_of(3, "trial"), join_words("abc"), join_words([])],
            ["1 trial", "3 trials", "a, b and c", ""],
        ),
    ],
)
def test_each_kind_of_number_is_written_in_one_way(written, expected):
    assert written == expected


ORDER = pd.DataFrame(
    {"scenario": list("bbaa"), "estimator": list("wxyz"), "rmse": [0.3, 0.2, float("nan"), 0.1], "bytes": [0, 8, 1, 2]}
)


@pytest.mark.parametrize(("by", "order"), [("rmse", "xwzy"), ("bytes", "wxyz"), ("study", "wxyz")])
def test_rows_of_a_scenario_are_in_order_and_scenarios_stay(by, order):
    assert "".join(sort_rows(ORDER, by)["estimator"]) == order
    with pytest.raises(BadInput, match=r"--sort is 'rms'; did you mean 'rmse'\?"):
        sort_rows(ORDER, "rms")


@pytest.mark.parametrize(
    ("baseline", "head"),
    [("arl", "vs arl [%]"), ("rssi-pf [letters]", "vs baseline [%]"), ("ekf-joint[own=rssi]", "vs baseline [%]")],
)
def test_the_baseline_is_called_so_in_its_row_and_in_the_head_where_its_name_is_long(baseline, head):
    row = {"baseline": baseline, "change": 0.2, "change_low": 0.1, "change_high": 0.3, "decisive_trial": np.nan}
    (column,) = (c for c in essential_columns([baseline], until_decided=False) if c.head.startswith("vs "))
    assert column.head == head
    assert column.text({**row, "estimator": baseline}) == "baseline"
    assert column.text({**row, "estimator": "other", "decisive_trial": 2.0}) == "trial 2 decides"
    assert column.text({**row, "estimator": "other"}) == "+20 [+10, +30]"


@pytest.mark.parametrize(
    ("line", "shown"),
    [
        ("passed: 12 checks", "✓ 12 checks"),
        ("passed: 11 of 12 checks; silence: it circles; axes: why", "✓ 11 of 12 checks, not silence, not axes"),
        ("passed: 2 of 12 checks; 10 skipped: after 9 runs", "✓ 2 of 12 checks, 10 skipped"),
        ("failed: causality: why; trained on: nlos", "✗ causality; trained on nlos"),
        ("unchecked: by request", "unchecked"),
    ],
)
def test_checks_are_written_in_a_few_words(line, shown):
    assert short_certificate(line) == shown


def test_html_is_sorted_by_values_with_groups_markers_and_links_and_everything_is_escaped():
    long = "ekf[particles=500,anchor_reading=rssi]"
    columns = (
        *map(text_column, ("scenario", "estimator", "remark")),
        number_column("RMSE [m]", "rmse", form=metres),
        number_column("95 %", "low", "high", form=interval(metres)),
        number_column("NLL", "nll", form=metres, collapsed=True),
        text_column("empty"),
    )
    row = {"estimator": "a|<b>", "remark": "", "rmse": 0.123456, "low": 0.1, "high": 0.2, "nll": 1.0, "empty": ""}
    rows = [{**row, "scenario": EVIL}, {**row, "scenario": "s", "estimator": long, "remark": f"as {long}"}]
    table = Table("t", "more", columns, rows, {"data-estimator": "estimator"})
    names = short_labels([long], {"raw": "anchor_reading=rssi, particles=500"})
    wording = Wording({long: "#estimator-1"}, names, {long: Markup("<svg></svg>")})
    assert html(table).count('scope="col"') == 4  # the empty column is left out, interval and remark have none
    assert "checkbox" not in html(Table("t", "", columns[:2], rows))
    source = html(table, wording, group="scenario")
    for part in (
        "<td>0.123<small>0.100 to 0.200</small></td>",
        '<input type="checkbox"> all columns',
        '<th scope="row">a|&lt;b&gt;</th>',
        '<tbody data-scenario="s">',
        f'<svg></svg><a href="#estimator-1" title="{long}">ekf [raw]</a>',
    ):
        assert part in source
    assert source.count("<tbody") == source.count('scope="rowgroup"') == 2
    outline = Outline(source)
    assert outline.open == []
    assert {tag for tag, _ in outline.tags}.isdisjoint({"script", "b"})


def test_of_many_ties_a_page_names_some_and_the_file_all():
    one = Standing("s", "a", 9, 12, (), tied=tuple("bcdefghijkl"), equal=("m",))
    table = best([one])
    assert "m (equal), b, c, d, e, f, g, h and 4 more" in html(table)
    assert "m (equal), b, c, d, e, f, g, h, i, j, k, l" in table.csv()
