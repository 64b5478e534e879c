"""Writes reports/information.md, and its figure as PNG and SVG, from a run of the study `information`.

Run: python reports/information.py RUN_DIR [OUT]. Its floors take a few minutes.
"""

import sys
from pathlib import Path

import matplotlib as mpl
import pandas as pd

import cooploc as cl
from cooploc.analysis.formats import change, metres, ratio
from cooploc.analysis.plot.information_matrix import BETWEEN, OWN, RULES
from cooploc.analysis.report.cooperation import heading, sentences
from cooploc.analysis.report.tables import Table, estimates, numbers, words
from cooploc.runs import kept

mpl.use("agg")
TEXT = """# What readings are worth, and what cooperation buys

    cooploc run information --out RUN_DIR
    python reports/information.py RUN_DIR      # this page, made of the run alone

Every robot reads something of the four anchors (nothing, the direction of arrival, the gradient from which it is
computed, or the four raw readings) and something of its teammates (nothing, the RSSI of their packets, or ranges). What
cooperation buys is the difference inside one row: the same filter with the same own readings, with and without
teammates, on the same streams. A comparison of methods that read different things compares readings and fusion at
once.

The 6 m world of the `paper` preset; {trials} trials, seed {seed}, 95 % intervals over trials. Particle filters use
each direction once, with its exact density (`density=exact,M=1,K=1`); `ctrn` is the covariance intersection of
particle filters, `ekf-ci` that of Kalman filters. The bound (`map-joint`) uses the cell's readings alone; there is
none of derived readings, direction and gradient.

![RMSE of every rule of fusion by own reading, team and reading between robots](information.png)

A floor is the posterior Cramer-Rao bound of an estimator that is given odometry and the readings of its cell, and
never sees what they were computed from. In the row of the direction it is given angles alone. Kalman filters there
weigh each angle by its gradient's strength, so that the floor of the row below is the one that holds for them. The
floor counts the two RSSI readings of a pair as independent; they share their shadowing, so it is loose there, and still
a bound. It bounds the mean over all trials that could be: over those that were run an error may lie below it by
chance.

## What cooperation buys in each row

{sentences}

## All cells

{table}
"""


def main(run: str, out: str = "reports") -> None:
    """Write the page and the figure."""
    stored = cl.load_run(run)
    table = cl.information(stored)
    figure = cl.plot.information(table).figure
    with mpl.rc_context({"svg.hashsalt": "cooploc"}):
        figure.savefig(Path(out) / "information.png", dpi=150)
        figure.savefig(Path(out) / "information.svg", metadata={"Date": None})
    said = "\n".join(_listed(heading(own, robots), texts) for own, robots, texts in sentences(table))
    seed = kept(stored).manifest["seed"]
    filled = TEXT.format(trials=table["trials"].max(), seed=seed, sentences=said, table=_table(table).markdown())
    (Path(out) / "information.md").write_text(filled, encoding="utf-8")


def _table(table: pd.DataFrame) -> Table:
    columns = (
        words("own", form=OWN.__getitem__),
        words("between", form=BETWEEN.__getitem__),
        numbers("robots"),
        words("fusion, filter", "fusion", "filter", form=lambda *rule: RULES[rule][0]),
        estimates("RMSE [m]", "rmse", metres),
        numbers("floor [m]", "floor", form=metres),
        estimates("ANEES", "anees", ratio),
        words("consistency"),
        estimates("against alone", "change", change),
    )
    caption = "RMSE and ANEES with 95 % intervals over trials; against alone: change of RMSE against the same filter."
    return Table("information", caption, columns, table.to_dict("records"))


def _listed(head: str, texts: list[str]) -> str:
    """A paragraph's first sentence, and the others below it."""
    return "\n".join([f"- **{head}.** {texts[0]}", *(f"    - {text}" for text in texts[1:])])


if __name__ == "__main__":
    main(*sys.argv[1:])
