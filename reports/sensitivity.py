"""Writes reports/sensitivity.md, and its figure as PNG and SVG, from a run of the study `sensitivity`.

Run: python reports/sensitivity.py RUN_DIR [OUT]. Its floors take a few minutes.
"""

import sys
from pathlib import Path

import matplotlib as mpl

import cooploc as cl
from cooploc.analysis.plot.sensitivity_panels import NAMES
from cooploc.analysis.report.dependence import sentences
from cooploc.runs import kept

mpl.use("agg")
TEXT = """# What results depend on

    cooploc run sensitivity --out RUN_DIR
    python reports/sensitivity.py RUN_DIR      # this page, made of the run alone

Three robots in the 6 m world of the `paper` preset, one parameter at a time; {trials} trials, seed {seed}.

![RMSE of the estimators over six parameters](sensitivity.png)

Bands are 95 % intervals over trials. Dashed: the preset's value; of the assumed path-loss exponent, the true one.
Dotted: the floor of an estimator that uses all readings; it exists where the team assumes the true world and has a
compass. Hollow markers, and broken lines: over-confident. Grey: centralised.

{sentences}

- *Most* and *least*: by the ratio of an estimator's largest RMSE to its smallest one, which has no interval. *Beats*
  and *loses*: by the paired interval at each value, one at a time, without a correction for their number.
- *Floor*: it averages the information over all places that the prior allows, also those beside an anchor, and does not
  know that robots stay inside. For a vague prior it is therefore loose, and may fall as the prior widens.
- *Duration* counts all ticks from the first: a longer run has more of them after the prior is forgotten.
- *Assumed path loss*: the readings are the same for all values (`[assumed.eta=...]`); `ekf-joint`, `arl`, `mrsl-*`
  and `ctrn` read a direction of the anchors, `rssi-pf` the raw values.
- *No compass* (`no-compass`): wheeled robots, a state of position and heading, odometry of speed (sd 0.02 m/s) and
  turn rate (sd 0.1 rad/s). A heading of sd 1.8 rad is unknown. Every estimator runs there. Where an interval is wide,
  a few trials may bear most of the squared error.
"""


def main(run: str, out: str = "reports") -> None:
    """Write the page and the figure."""
    stored = cl.load_run(run)
    table = cl.sensitivity(stored)
    figure = cl.plot.sensitivity(table).figure
    with mpl.rc_context({"svg.hashsalt": "cooploc"}):
        figure.savefig(Path(out) / "sensitivity.png", dpi=150)
        figure.savefig(Path(out) / "sensitivity.svg", metadata={"Date": None})
    said = "\n".join(f"- **{_capital(NAMES.get(name, name))}.** {text}" for name, text in sentences(table))
    seed = kept(stored).manifest["seed"]
    filled = TEXT.format(trials=table["trials"].max(), seed=seed, sentences=said)
    (Path(out) / "sensitivity.md").write_text(filled, encoding="utf-8")


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


if __name__ == "__main__":
    main(*sys.argv[1:])
