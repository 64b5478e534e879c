"""One table in its five forms, and how numbers are written in all of them."""

import csv
import io

import numpy as np
import pytest
from rich.console import Console

from cooploc.analysis.formats import (
    change,
    count,
    counted,
    duration,
    interval,
    listed,
    metres,
    microseconds,
    p_value,
    percent,
    ratio,
)  # fmt: skip
from cooploc.analysis.report.tables import Table, number_column, text_column

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


def test_csv_has_the_values_in_full_and_nothing_where_they_are_absent():
    rows = list(csv.DictReader(io.StringIO(TABLE.csv())))
    assert rows[0] == {"name": "a|b_c<d>", "rmse": "0.123456", "low": "0.1", "high": "0.2"}
    assert rows[1]["rmse"] == rows[1]["low"] == ""


def test_latex_is_escaped_and_has_the_rules_of_booktabs():
    assert r"a\textbar{}b\_c\textless{}d\textgreater{} & 0.123 & 0.10 to 0.20 \\" in TABLE.latex()
    for rule in (r"\toprule", r"\midrule", r"\bottomrule", r"\caption{50 \% \& more}"):
        assert rule in TABLE.latex()


def test_markdown_is_escaped():
    assert r"| a\|b\_c&lt;d&gt; | 0.123 | 0.10 to 0.20 |" in TABLE.markdown()


def test_a_terminal_shows_no_column_that_is_empty_in_every_row():
    silent = Table("t", "title", (*COLUMNS, text_column("remark")), [{**row, "remark": ""} for row in ROWS])
    console = Console(width=80)
    with console.capture() as captured:
        console.print(silent.terminal())
    assert "0.10 to 0.20" in captured.get()
    assert "remark" not in captured.get()


def test_a_long_table_runs_over_pages_in_latex():
    table = Table("t", "", (number_column("n"),), [{"n": i} for i in range(60)])
    assert r"\begin{longtable}" in table.latex()


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
        ([counted(1, "trial"), counted(3, "trial"), listed("abc")], ["1 trial", "3 trials", "a, b and c"]),
    ],
)  # fmt: skip
def test_each_kind_of_number_is_written_in_one_way(written, expected):
    assert written == expected


def test_in_a_narrow_terminal_what_belongs_under_a_column_is_a_second_line_of_it():
    columns = (COLUMNS[0], text_column("mark", second_line=True), text_column("more", second_line=True), *COLUMNS[1:])
    table = Table("t", "", columns, [{**row, "more": "z"} for row in ROWS])
    console = Console(width=36)
    with console.capture() as captured:
        console.print(table.terminal())
    lines = [line.split() for line in captured.get().splitlines()]
    assert ["mark"] in lines
    assert ["more", "RMSE", "95", "%"] in lines
    assert ["x<y"] in lines
    assert lines.count(["z"]) == 2


def test_a_column_that_is_left_out_is_named_once_for_itself_and_what_is_under_it():
    before = number_column("cost\nbefore", "rmse", form=metres, priority=1)
    pair = before, number_column("cost\nafter", "rmse", form=metres, second_line=True, priority=1)
    table = Table("t", "", (*COLUMNS, *pair), ROWS)
    console = Console(width=34)
    with console.capture() as captured:
        console.print(table.terminal())
    assert "not shown at this width: cost\n" in captured.get()
