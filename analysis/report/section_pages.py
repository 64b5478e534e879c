"""Is a recording sane? One HTML page of its inspection, with a figure for each finding, that needs no network."""

import base64
import io

import matplotlib.pyplot as plt
from markupsafe import Markup
from matplotlib.figure import Figure

from cooploc.analysis.formats import count_of
from cooploc.analysis.plot.findings import finding
from cooploc.analysis.plot.worlds import recording
from cooploc.analysis.report.tables import fill_template, read_template
from cooploc.scenarios.recordings.inspect.inspection import Inspected

HEADS = "series", "of", "samples", "rate [Hz]", "from [s]", "to [s]", "gaps", "longest interval [s]"
DPI = 110


def inspection_page(found: Inspected) -> str:
    """Return the page of an inspection; what comes from the files is escaped."""
    findings = []
    for one in found.findings:
        figure = finding(one, found.log, found.corrected)
        findings.append({**one._asdict(), "change": one.change, "picture": encode(figure) if figure else ""})
    robots = len(found.log.robots)
    name = f"{found.format} ({found.why}), {count_of(robots, 'robot')}, {count_of(len(found.runs), 'run')}"
    problem = found.trial.problem
    sentence = f"{count_of(len(findings), 'thing')} to look at" if findings else "Nothing odd was found"
    sentence += f"; it does not run yet: {problem}." if problem else "; its log.toml runs."
    rows = [[f"{cell:.4g}" if isinstance(cell, float) else cell for cell in row[:8]] for row in found.rows]
    return fill_template(
        "inspection.html.j2",
        recording=found.log.name, what=name, verdict=sentence, findings=findings, heads=HEADS, series=rows,
        sketch=encode(recording(found.corrected, "")), tried=(*found.trial.lines, *[problem] * bool(problem)),
        style=Markup(read_template("page.css")),
    )  # fmt: skip


def encode(figure: Figure) -> str:
    """Return a figure as the base64 of a PNG, and close it."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=DPI)
    plt.close(figure)
    return base64.b64encode(out.getvalue()).decode()
