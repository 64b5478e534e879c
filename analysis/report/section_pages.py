"""Pages of a few sections, with figures and tables, that need no network: is a recording sane, and who judges best."""

import base64
import io
from collections.abc import Sequence
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cooploc.analysis.formats import join_words, metres
from cooploc.analysis.plot import anees, error_over_time, rmse, style, trajectories
from cooploc.analysis.plot.worlds import finding
from cooploc.analysis.report import html_page
from cooploc.analysis.report.result_tables import result_columns
from cooploc.analysis.report.tables import Table, frame
from cooploc.estimators.errors import count_of
from cooploc.scenarios.recordings.inspect.inspection import Inspected
from cooploc.scenarios.runner.run import Run
from cooploc.scenarios.stream import Truth

HEADS = "series", "of", "samples", "rate [Hz]", "from [s]", "to [s]", "gaps", "longest interval [s]"
RANKS = "rank", "group"  # of a run's report
DPI = 110
DRAWN = 8  # robots


class Section(NamedTuple):
    """A part of a page with a heading of its own."""

    head: str
    texts: Sequence[str] = ()
    change: str = ""  # a setting of log.toml
    pictures: Sequence[tuple[str, str]] = ()  # what each shows, and its PNG in base64
    caption: str = ""  # of the last one
    tables: Sequence[Table] = ()


@style.as_shipped()
def inspection_page(found: Inspected, sketch: bytes) -> str:
    """Return the page of an inspection, with a figure for each finding; what comes from the files is escaped.

    `sketch` is a PNG of the whole recording.
    """
    sections = []
    for number, one in enumerate(found.findings, 1):
        figure = finding(one, found.log, found.corrected)
        fact = one.fact if "/" in one.fact.split()[0] else f"{one.fact[:1].upper()}{one.fact[1:]}"  # not of a path
        said = [f"{fact}. ({'; '.join(filter(None, (one.sure, one.source)))})"]
        head = f"{number}. {one.kind.capitalize()}{': ' * bool(one.robot)}{one.robot}"
        said += [f"Nothing to change in log.toml: {one.nothing}."] if one.nothing else []
        change, pictures = "" if one.nothing else one.change, [(one.fact, _png(figure))] if figure else ()
        sections.append(Section(head, said, change, pictures))
    robots, problem = len(found.log.robots), found.trial.problem
    name = f"{found.format} ({found.why}), {count_of(robots, 'robot')}, {count_of(len(found.runs), 'run')}"
    sentence = f"{count_of(len(sections), 'thing')} to look at" if sections else "Nothing odd was found"
    sentence += f"; it does not run yet: {problem}." if problem else "; its log.toml runs."
    caption = (
        f"Tracks: solid the truth, dotted odometry alone from the true start{', findings corrected' * bool(sections)}"
    )
    caption = caption if any(found.log.truth) else "Tracks: odometry alone, every robot from 0, 0"
    caption += ". Who measured whom, how often. What was recorded when; gaps are white."
    whole = "tracks, who measured whom, and what was recorded when", base64.b64encode(sketch).decode()
    sections.append(Section("The whole recording", pictures=[whole], caption=caption))
    series = pd.DataFrame([row[:8] for row in found.rows], columns=list(HEADS))
    sections.append(Section("Series", tables=[frame("series", series)]))
    sections.append(Section("Does it run?", (*found.trial.lines, *[problem] * bool(problem))))
    beside = "Findings compare the recording with its own ground truth; none was applied."
    if not any(found.log.truth):
        beside = "There is no ground truth: series are compared with each other, and not with where the robots were."
    about = f"{name}. {beside}"
    return _page(f"Is {found.log.name} sane?", sentence, about, sections)


@style.as_shipped()
def judged_page(
    truth: Truth, run: Run, rows: pd.DataFrame, table: pd.DataFrame, tables: Sequence[Table], notes: Sequence[str]
) -> str:
    """Return the page of trajectories that were judged: `rows` by piece or trial, the `table` of `compare` against the
    first, further tables of theirs, and notes. Paths and errors over time are those of the first trial of `run`.
    """  # fmt: skip
    best, *others = table.to_dict("records")
    ties = [str(one["estimator"]) for one in others if not one["p_holm"] <= 0.05]
    has = "has the smallest RMSE," if others else "has an RMSE of"
    verdict = f"{best['estimator']} {has} {metres(best['rmse'])} m"
    verdict += f"; it is not told apart from {join_words(ties)}" * bool(ties) + "."
    columns = [one for one in result_columns(table["baseline"], until_decided=False) if one.keys[0] not in RANKS]
    results = Table("results", "Errors with 95 % intervals", tuple(columns), table.to_dict("records"))
    robots, known = range(min(truth.x.shape[2], DRAWN)), any(np.isfinite(t.P).any() for t in run.traces.values())
    first = list(dict.fromkeys(zip(rows["robot"], rows.get("name", "robot " + rows["robot"].astype(str)), strict=True)))
    paths = [(f"paths of {dict(first)[r]}", _png(trajectories(truth, run, int(run.trial[0]), r))) for r in robots]
    over = [("error over the ticks", _png(error_over_time(truth, run)))]
    over += [("ANEES over the ticks", _png(anees(truth, run)))] if known else []
    sections = [
        Section("Errors", pictures=[("RMSE with intervals", _png(rmse(rows)))], tables=[results]),
        *[Section("Notes", notes)] * bool(notes),
        Section("Paths", [f"From the top: {join_words([str(dict(first)[r]) for r in robots])}."], pictures=paths),
        Section("Over time", pictures=over, caption="A tick is a pose that all methods have."),
        Section("Drift, and each robot", tables=tables),
    ]
    return _page(f"Trajectories beside {truth.scenario}", verdict, f"{join_words(list(run.traces))}.", sections)


def _page(title: str, verdict: str, about: str, sections: Sequence[Section]) -> str:
    content = {"title": title, "verdict": verdict, "about": about, "sections": sections}
    return html_page.render(content, "sections.html.j2")


def _png(drawn: object) -> str:
    """Return a figure, or that of axes, as the base64 of a PNG, and close it."""
    figure = drawn if isinstance(drawn, Figure) else drawn.get_figure()  # type: ignore[attr-defined]
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=DPI)
    plt.close(figure)
    return base64.b64encode(out.getvalue()).decode()
