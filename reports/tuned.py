"""Writes reports/tuned.md and its figures from tunings of the studies `paper-fair` and `paper-fair-mrclam`.

Run: python reports/tuned.py TUNED_DIR [MRCLAM_DIR [OUT]]. It computes nothing again.
"""

import sys
from pathlib import Path

import matplotlib as mpl

import cooploc as cl
from cooploc.analysis.report.tables import Table
from cooploc.analysis.report.tuning_sentences import bought, by_scenario, most_moved
from cooploc.analysis.report.tuning_tables import GAINS, LEGEND, chosen_table, gains_table, order_sentence, side_by_side

mpl.use("agg")
SHOWN = "ekf-naive"  # the estimator whose parameters are drawn
TEXT = """# Does the order change when everyone is tuned alike?

    cooploc tune paper-fair --budget {budget} --out TUNED_DIR
    python reports/tuned.py TUNED_DIR [MRCLAM_DIR]      # this page, made of the directories alone

Every estimator used at most {budget} training trials, of streams whose seed ({training_seed}) is derived from that of
the comparison ({seed}); none of the {streams} training streams is a reported one. Tuned are the parameters that an
estimator declares, by mean negative log-likelihood with a robust cap; what all are told alike, and which readings a
method uses, is not. One configuration serves all four worlds. An estimator leaves its published configuration only
where paired differences on the training streams show another one to score better.

## The answer

- {by_rmse}
- {by_nll}
- {bought}
- {moved}

In each world, by the errors alone, without a test of who is first:

{scenarios}

{side}

![Gain of the best configuration so far against the trials used](tuned-budget.png)

![What each parameter of one estimator did](tuned-parameters.png)

Filled marks ran all rounds; hollow ones were stopped early, where paired differences on the training streams showed
them to be worse. The cross is the configuration as published, the circle the one that was chosen.

## What was chosen

{chosen}

## As published and tuned, on fresh streams

{legend}

{tables}

{real}Is the procedure fair? Five copies of one estimator go through it again and again:
[tuned-alike.md](tuned-alike.md).
"""

REAL = """## Five real robots

    cooploc tune paper-fair-mrclam --budget {budget} --data DIR --out MRCLAM_DIR

UTIAS MRCLAM: tuned on parts of the first 300 s, judged on the 200 s after them, of which tuning saw nothing. One
recording is one trial, so there are no intervals, and no difference can be called significant.

{chosen}

{tables}

"""


def main(run: str, real: str = "", out: str = "reports") -> None:
    """Write the page and the figures."""
    found = cl.load_tuned(run)
    folder, side = Path(out), side_by_side(found.table).markdown()
    with mpl.rc_context({"svg.hashsalt": "cooploc"}):
        cl.plot.tuning(found.history).figure.savefig(folder / "tuned-budget.png", dpi=150)
        cl.plot.tuned_parameters(found.history, SHOWN).figure.savefig(folder / "tuned-parameters.png", dpi=150)
    text = TEXT.format(
        budget=found.record["budget"],
        training_seed=found.record["training_seed"],
        seed=found.record["seed"],
        streams=len(found.record["streams"]),
        by_rmse=order_sentence(found.order("rmse"), "RMSE"),
        by_nll=order_sentence(found.order("nll"), "score"),
        bought=bought(found.table),
        moved=most_moved(found.table),
        scenarios="\n".join(f"- {line}" for line in by_scenario(found.table)),
        side=side,
        chosen=chosen_table(found.history, found.tuned).markdown(),
        legend=LEGEND[0].upper() + LEGEND[1:],
        tables="\n".join(gains_table(str(name), part).markdown() for name, part in found.table.groupby("scenario")),
        real=_recorded(real) if real and Path(real).exists() else "",
    )
    (folder / "tuned.md").write_text(text, encoding="utf-8")


def _recorded(real: str) -> str:
    """What was found on the recording."""
    found = cl.load_tuned(real)
    tables = "\n".join(_one_trial(str(name), part) for name, part in found.table.groupby("scenario"))
    chosen = chosen_table(found.history, found.tuned).markdown()
    return REAL.format(budget=found.record["budget"], chosen=chosen, tables=tables)


def _one_trial(scenario: str, part: "object") -> str:
    """A table without the columns that one trial cannot fill."""
    whole = gains_table(scenario, part)  # type: ignore[arg-type]
    absent = ("95 %", "p", "rank published", "failed")
    columns = tuple(column for column in GAINS if column.head not in absent and column.keys[0] != "rank_tuned")
    return Table(whole.name, whole.caption, columns, whole.rows).markdown()


if __name__ == "__main__":
    main(*sys.argv[1:])
