"""A run's report: one HTML page that needs no network, and beside it its tables as files."""

import base64
import hashlib
import io
import itertools
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import pandas as pd
from markupsafe import Markup, escape
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from cooploc.analysis.claims.ledger import Ledger
from cooploc.analysis.claims.trial_table import TrialTable
from cooploc.analysis.execution.reproduce import PAGE, embed
from cooploc.analysis.execution.run_directory import StoredRun, select
from cooploc.analysis.formats import count_of, join_words
from cooploc.analysis.metrics import ranking
from cooploc.analysis.metrics.compare import outlier_warnings
from cooploc.analysis.metrics.crlb import floors
from cooploc.analysis.metrics.statistics import LEAST_TRIALS
from cooploc.analysis.plot import results, style
from cooploc.analysis.report import page_texts, result_tables, run_numbers, sentences
from cooploc.analysis.report.claim_tables import claims_shown
from cooploc.analysis.report.run_figures import DOTS, HOLLOW, RunFigure, draw_experiment
from cooploc.analysis.report.run_numbers import Labels, Numbers
from cooploc.analysis.report.tables import (
    Row,
    Table,
    TableColumn,
    csv_text,
    fill_template,
    read_template,
    text_column,
)  # fmt: skip
from cooploc.estimators.registry import shorten_labels
from cooploc.scenarios.studies.study import Study, stream_sentence

FEW = 4  # scenarios that the first figure of a page draws side by side
BELOW = "95 %", "remark"  # heads of columns that stand below their left neighbour
SYMBOLS = dict(zip(style.MARKERS, "✖●■◆▲▼✚★⬟⬢◀▶♦⯃⬣✦✧✶⅄⋏✯✺≻", strict=False))  # of the figures' markers
FORMS = {"tex": "latex", "md": "markdown", "csv": "csv"}  # ending of a file -> method of `Table`
FLOOR_PATHS, FLOOR_TRIALS = 16, 8  # over which a floor is taken, in a fifth of the time that one to 0.2 % takes


def write(
    run: StoredRun,
    ledger: Ledger,
    out: Path,
    estimators: Sequence[str] = (),
    scenarios: Sequence[str] = (),
    baseline: str = "",
) -> Path:
    """Write the page and its tables, of these estimators and scenarios alone, into a directory; return its path."""
    kept = select(run, estimators, scenarios, baseline)
    numbers = run_numbers.numbers_of(kept)
    table = numbers.table
    lowest = floors(table["scenario"], kept.manifest["seed"], run_numbers.FLOORED, FLOOR_PATHS, FLOOR_TRIALS)
    numbers = numbers._replace(table=table.assign(floor=table["scenario"].map(lowest)))
    context = content(numbers, ledger) | {"holds": holds(run, numbers)}
    texts: dict[str, str] = {}
    for one in context["tables"]:
        texts |= {f"tables/{one.name}.{ending}": getattr(one, form)() for ending, form in FORMS.items()}
    texts["tables/trials.csv"] = csv_text(rmse_by_trial(numbers.table, numbers.results))
    texts[PAGE] = render({**context, "files": sorted(texts)})
    (out / "tables").mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (out / name).write_text(text, encoding="utf-8")
    return out / PAGE


def render(context: dict[str, Any], body: str = "body.html.j2") -> str:
    """Return the page with the template of its body; everything that is not marked as safe is escaped."""
    script, css = (Markup(read_template(name)) for name in ("page.js", "page.css"))  # our own files
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    filled = Markup(fill_template(body, html=html, **context))  # its parts are escaped by their templates
    return fill_template("page.html.j2", **context, style=css, body=filled, script=script, script_hash=digest)


# ------------------------------------------------------------------------------------------------ content


def content(numbers: Numbers, ledger: Ledger) -> dict[str, Any]:
    """Return everything that the page shows but its files, and `tables`, all of its tables."""
    kept, table, manifest = numbers.kept, numbers.table, numbers.kept.manifest
    study, counter = manifest["study"], itertools.count(1)
    first = first_figure(numbers, counter)
    experiments = [experiment(name, plan, numbers, counter) for name, plan in kept.experiments.items()]
    found = sentences.standings(table, numbers.results)
    claims = claims_shown(kept, ledger)
    consistency, events = result_tables.consistency(table), result_tables.events(kept.rows)
    scenarios, versions = result_tables.scenario_tables(table, manifest["scenarios"]), _versions(manifest)
    tables = [result_tables.best(found), consistency, *([claims["overview"], claims["table"]] if claims else [])]
    tables += [one for each in experiments for one in (*each["tables"], each["standings"])]
    missing = [f"{s}, {shorten_labels(e)}: {n} of the planned trials are missing" for (s, e), n in kept.gaps.items()]
    central = set(kept.rows.loc[kept.rows["centralised"].eq(True), "estimator"])
    marks = {name: marker(pen, name in central) for name, pen in numbers.pens.items()}
    names = kept.rows["estimator"].unique()
    of_problem = stream_sentence(Study(**study), manifest["streams"])

    def some(column: TableColumn) -> bool:
        return any(row[column.keys[0]] for row in consistency.rows)

    return {
        "title": study.get("title") or study["name"],
        "study": study["name"] * bool(study.get("title")),
        "about": study.get("about", ""),
        "manifest": manifest,
        "lowest": shorten_labels(sentences.best_honest(found, table)),
        "over_confident": shorten_labels(sentences.over_confident_estimators(table)),
        "first": first,
        "consistency": replace(consistency, columns=tuple(filter(some, consistency.columns))),
        "experiments": experiments,
        "claims": claims,
        "estimators": page_texts.introduce_estimators(kept.rows),
        "scenarios": scenarios,
        "fitted": manifest.get("recordings") or {},
        "missing": missing,
        "remarks": [*filter(None, [of_problem]), *ranking.certificate_remarks(table), *outlier_warnings(table)],
        "failures": result_tables.failures(kept.rows),
        "events": events,
        "methods": page_texts.methods(bool(kept.looks)),
        "paragraph": page_texts.paragraph(numbers),
        "bibtex": page_texts.bibtex(manifest["versions"]["cooploc"], manifest["commit"]),
        "versions": versions,
        "embedded": embed(kept),
        "wording": Wording({e: f"#{at}" for e, at in page_texts.anchors_of(names).items()}, numbers.names, marks),
        "labels": {what: list(dict.fromkeys(table[what])) for what in ("estimator", "scenario")},
        "tables": [*tables, *scenarios, *[events] * bool(events.rows), versions],
    }


def holds(run: StoredRun, numbers: Numbers) -> str:
    """Return in a sentence what a page shows of a run, and what it compares with."""

    def sizes(one: StoredRun) -> str:
        return " in ".join(count_of(one.rows[name].nunique(), name) for name in ("estimator", "scenario"))

    every, shown = sizes(run), sizes(numbers.kept)
    some = f"Of the run's {every} this page shows {shown}" if shown != every else f"This run holds {every}"
    baselines = join_words(map(numbers.names.shorten, dict.fromkeys(numbers.table["baseline"])))
    return f"{some}, {run_numbers.trial_counts(numbers.table)}; changes are against {baselines}."


def _versions(manifest: dict[str, Any]) -> Table:
    imported = {name: at for one in manifest.get("imports", {}).values() for name, at in one.items()}
    used = {**imported, **manifest["versions"], **{key: manifest[key] for key in ("commit", "source", "cpu", "seed")}}
    rows = [{"what": what, "version": value} for what, value in {**used, "recordings": manifest["data"]}.items()]
    columns = text_column("what"), text_column("version or hash", "version")
    return Table("versions", "What the bits depend on", columns, rows)


# ------------------------------------------------------------------------------------------------ experiments


def experiment(name: str, plan: dict[str, list[str]], numbers: Numbers, counter: Iterator[int]) -> dict[str, Any]:
    """Return a section on an experiment with its estimators by scenario; `counter` numbers its figures.

    Its sentences are its answer, where the report has several experiments, and what it says of sweeps.
    """
    table, results = numbers.table, numbers.results
    part = run_numbers.rows_of_experiment(table, plan)
    found = sentences.standings(part, results)
    anchor = f"experiment-{safe_name(name)}"
    only = len(part) == len(table)
    texts = [] if only else [sentences.best_honest(found, part), sentences.over_confident_estimators(part)]
    changed: list[Table] = []
    for (_, parameter), group in run_numbers.group_by_sweep(list(plan)).items():
        if parameter:
            names = dict.fromkeys(part.loc[part["scenario"].isin(group), "estimator"])
            changes = sentences.changes_over_sweep(group, names, results)
            texts.append(sentences.sweep_sentence(group, changes, results.stopping))
            changed.append(result_tables.sweep_table(f"{anchor}-sweep{len(changed) + 1}", changes, parameter))
    again = only and part["scenario"].nunique() <= FEW  # the first figure of the page
    single = [] if again else run_numbers.group_by_sweep(list(plan)).get(("", ""), [])
    drawn = draw_experiment(part, single, numbers.names, numbers.pens, style.PAGE)
    test = "confidence sequences of the change" if numbers.kept.looks else "t test of the change"
    few = f" Below {LEAST_TRIALS} trials there are no intervals." * bool(part["trials"].min() < LEAST_TRIALS)
    about = (
        f"{name}: {run_numbers.trial_counts(part)}, seed {numbers.kept.manifest['seed']}; {test} against "
        f"the baseline, Holm over the {int(table['p'].notna().sum())} comparisons of this report.{few}"
    )
    every = result_tables.results(anchor, part, results, about)
    return {
        "name": name,
        "anchor": anchor,
        "found": found,
        "sentences": list(map(shorten_labels, filter(None, texts))),
        "figures": [show(one, counter) for one in drawn],
        "tables": [every, *changed],
        "standings": result_tables.best(found, f"best-{anchor}"),
    }


def safe_name(text: str) -> str:
    """Return a name for files and anchors: letters, digits and hyphens, and a hash where the text had others."""
    plain = re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-")[:60]
    return plain if plain == text else f"{plain}-{hashlib.sha256(text.encode()).hexdigest()[:6]}"


# ------------------------------------------------------------------------------------------------ trials


def rmse_by_trial(table: pd.DataFrame, results: TrialTable) -> pd.DataFrame:
    """Return the RMSE [m], a row per scenario and trial, a column per estimator; nan where the trial failed."""
    ended = table[table["rmse"].notna()].groupby("scenario", sort=False)["estimator"]
    parts = {str(s): results.errors(str(s), list(names)).pow(0.5).sort_index() for s, names in ended}
    return pd.concat(parts, names=["scenario", "trial"]).reset_index() if parts else pd.DataFrame()


# ------------------------------------------------------------------------------------------------ figures


def first_figure(numbers: Numbers, counter: Iterator[int]) -> dict[str, Any]:
    """Draw every RMSE of a few scenarios, or of many those relative to the baseline's."""
    ended = numbers.table[numbers.table["rmse"].notna()]
    if 0 < ended["scenario"].nunique() <= FEW:
        parts = [part for _, part in ended.groupby("scenario", sort=False)]
        return show(RunFigure(results.ranking(parts, numbers.pens, numbers.names.shorten), [], DOTS, ended), counter)
    baselines = ", ".join(map(numbers.names.shorten, dict.fromkeys(ended["baseline"])))
    number, most = ended["estimator"].nunique(), results.MOST
    some = f" Shown are the {most} of {number} that ran in the most scenarios." * (number > most)
    caption = (
        f"Position RMSE of every estimator divided by that of the baseline ({baselines}): a mark for each scenario, a "
        f"bar at their median; left of the dotted line the error is smaller. {HOLLOW}.{some}"
    )
    drawn = results.overview(numbers.table, numbers.pens, numbers.names.shorten)
    return show(RunFigure(drawn, [], caption, ended), counter)


def show(drawn: RunFigure, counter: Iterator[int]) -> dict[str, Any]:
    """Return a figure as the page shows it, and its scenario where it has only one."""
    number, (scenario, *more) = next(counter), drawn.rows["scenario"].unique()
    return {
        "anchor": f"figure-{number}",
        "svg": inline_svg(drawn.figure, number, drawn.caption.partition(". ")[0]),
        "caption": f"{drawn.caption} {run_numbers.trial_counts(drawn.rows)}.",
        "scenario": "" if more else scenario,
    }


def inline_svg(figure: Figure, number: int, label: str) -> Markup:
    """Return a figure as SVG to be put into a page: own ids, no links, a label.

    It is without ids that nothing uses and empty groups, and with coordinates to a tenth of a point: half as long.
    """
    out = io.StringIO()
    with mpl.rc_context(style.PAGE.rc), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # the reader's fonts draw the text
        figure.savefig(out, format="svg", metadata={"Date": None})
    svg = out.getvalue()
    svg = re.sub(r"<(metadata|style).*?</\1>", "", svg[svg.index("<svg") :], flags=re.DOTALL)  # the page has the style
    svg = re.sub(r' xmlns(:\w+)?="[^"]*"', "", svg).replace("xlink:href=", "href=")
    used = set(re.findall(r'(?:url\(#|href="#)([^")]+)', svg))
    svg = re.sub(r' id="([^"]*)"', lambda found: found[0] if found[1] in used else "", svg)
    svg = style.round_numbers(svg, r"<[a-z][^<>]*>", 1).replace("font-family: 'DejaVu Sans', sans-serif; ", "")
    svg = re.sub(r' transform="rotate\(-0 [^"]*\)"', "", svg)
    svg = re.sub(r">\s+<", "><", re.sub(r"\s*\n\s*", " ", svg))
    svg = re.sub(r"<g\b[^<>]*></g>", "", re.sub(r"<g\b[^<>]*/>", "", svg))
    svg = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>f{number}-", svg)
    return Markup(svg.replace("<svg", f'<svg role="img" aria-label="{escape(label)}"', 1))


# ------------------------------------------------------------------------------------------------ tables


class Wording(NamedTuple):
    """Names of estimators on a page, and where links lead."""

    links: Mapping[str, str] = {}  # estimator -> the address of its introduction
    names: Labels = Labels({}, {})
    marks: Mapping[str, Markup] = {}  # estimator -> its marker

    def cell(self, column: TableColumn, row: Row) -> Markup:
        """Return the text of a cell: an estimator with its marker and a link."""
        label = row.get("estimator", "")
        if column.keys[0] != "estimator" or label not in self.links:
            return escape(column.text(row))
        title = Markup(' title="{}"').format(label) if label in self.names.short else ""
        link = Markup('{}<a href="{}"{}>{}</a>')
        return link.format(self.marks.get(label, ""), self.links[label], title, self.names.shorten(label))


def marker(pen: style.Pen, centralised: bool) -> Markup:
    """Return the marker of an estimator, as in the figures; grey where it is centralised."""
    colour = to_hex(style.colour_of({"centralised": centralised}, pen))
    mark = Markup('<span class="mark" aria-hidden="true" style="color: {}">{}</span>')
    return mark.format(colour, SYMBOLS.get(pen.marker, "●"))


def html(table: Table, wording: Wording | None = None, group: str = "") -> Markup:
    """Return a `<table>` whose cells carry their values as `data-sort`; everything is escaped.

    Columns that are empty in every row are left out. Neighbouring rows with the same value of the key `group` form a
    group with a head of its own.
    """
    cells: list[dict[str, Any]] = []  # a column with those that stand below it
    for column in table.columns:
        if column.keys[0] == group or not any(map(column.text, table.rows)):
            continue
        if cells and column.head in BELOW:
            cells[-1]["below"].append(column)
        else:
            cells.append({"column": column, "below": []})
    grouped = itertools.groupby(table.rows, lambda row: row[group]) if group else [("", table.rows)]
    groups = [(key, list(rows)) for key, rows in grouped]
    known = {"wording": wording or Wording(), "sort_value": sort_value}
    return Markup(fill_template("table.html.j2", table=table, group=group, cells=cells, groups=groups, **known))


def sort_value(value: Any) -> str | None:
    """Return what a number is sorted by, nothing where it is absent; None for text."""
    if isinstance(value, str) or value is None:
        return None
    return "" if value != value else f"{float(value):.6g}"
