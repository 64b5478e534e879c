"""A run's report: one HTML page that needs no network, and beside it its tables as files."""

import base64
import hashlib
import io
import itertools
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from importlib.metadata import version
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
from cooploc.analysis.formats import join_words
from cooploc.analysis.metrics import ranking
from cooploc.analysis.metrics.compare import FAR, table_warnings
from cooploc.analysis.metrics.consistency import OVER_CONFIDENT
from cooploc.analysis.metrics.crlb import floors
from cooploc.analysis.metrics.errors import SENSES
from cooploc.analysis.metrics.statistics import LEAST_TRIALS
from cooploc.analysis.plot import results, style
from cooploc.analysis.report import result_tables, run_numbers, sentences
from cooploc.analysis.report.claim_tables import claims_shown
from cooploc.analysis.report.labels import Labels
from cooploc.analysis.report.run_numbers import (
    DOTS,
    FLOORED,
    HOLLOW,
    Numbers,
    RunFigure,
    draw_experiment,
    trial_counts,
)
from cooploc.analysis.report.tables import (
    Row,
    Table,
    TableColumn,
    csv_text,
    fill_template,
    read_template,
    read_toml,
    text_column,
    words,
)  # fmt: skip
from cooploc.estimators import configure, make
from cooploc.estimators.errors import BadInput, count_of
from cooploc.estimators.label_syntax import parse, shorten_labels
from cooploc.estimators.listing import setting_kind
from cooploc.estimators.registry import source_of
from cooploc.scenarios.studies.study import Study, stream_sentence

WIDE = 36  # characters of an estimator's label that a page writes in full
FEW = 4  # scenarios that the first figure of a page draws side by side
BELOW = "95 %", "remark"  # heads of columns that stand below their left neighbour
SYMBOLS = dict(zip(style.MARKERS, "✖●■◆▲▼✚★⬟⬢◀▶♦◉⬣✦✧✶⅄⋏✯✺≻", strict=False))  # of the figures' markers
PLAIN = r"([-+]?\d+(\.\d+)?( %)?)?"  # what the page's script reads as a number
MOST_BYTES = 2_000_000  # of a page
FORMS = {"tex": "latex", "md": "markdown", "csv": "csv"}  # ending of a file -> method of `Table`
FLOOR_PATHS, FLOOR_TRIALS = 16, 8  # over which a floor is taken, in a fifth of the time that one to 0.2 % takes


@style.as_shipped()
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
    numbers = run_numbers.numbers_of(kept, WIDE)
    table = numbers.table
    lowest = floors(table["scenario"], kept.manifest["seed"], run_numbers.FLOORED, FLOOR_PATHS, FLOOR_TRIALS)
    numbers = numbers._replace(table=table.assign(floor=table["scenario"].map(lowest)))
    context = content(numbers, ledger) | {"holds": holds(run, numbers)}
    texts: dict[str, str] = {}
    for one in context["tables"]:
        texts |= {f"tables/{one.name}.{ending}": getattr(one, form)() for ending, form in FORMS.items()}
    texts["tables/trials.csv"] = csv_text(rmse_by_trial(numbers.table, numbers.results))
    texts |= pages({**context, "files": sorted(texts)})
    (out / "tables").mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (out / name).write_text(text, encoding="utf-8")
    return out / PAGE


def pages(context: dict[str, Any]) -> dict[str, str]:
    """Return the page by its file's name; of one that is too long each experiment is on a page of its own.

    Tables of what is still too long leave the columns that are shown on demand to their files.
    """
    page = render(context)
    if len(page.encode()) <= MOST_BYTES:
        return {PAGE: page}
    apart: list[dict[str, Any]] = context["experiments"] if len(context["experiments"]) > 1 else []
    back = context["wording"]._replace(links={e: PAGE + at for e, at in context["wording"].links.items()})
    parts: list[tuple[str, dict[str, Any]]] = [(PAGE, {"apart": bool(apart)})]
    for one in apart:
        labels = {what: list(dict.fromkeys(row[what] for row in one["tables"][0].rows)) for what in context["labels"]}
        parts.append((f"{one['anchor']}.html", {"only": one, "wording": back, "labels": labels}))
    texts = {name: render({**context, **changed}) for name, changed in parts}
    for name, changed in parts:
        if len(texts[name].encode()) > MOST_BYTES:
            few = changed.get("wording", context["wording"])._replace(collapsed=False)
            texts[name] = render({**context, **changed, "wording": few})
    return texts


def render(context: dict[str, Any], body: str = "body.html.j2") -> str:
    """Return the page with the template of its body; everything that is not marked as safe is escaped."""
    script, css = (Markup(read_template(name)) for name in ("page.js", "page.css"))  # our own files
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    context = {"manifest": {"versions": {"cooploc": version("cooploc")}}, "embedded": {}, **context}
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
        "apart": False,  # whether experiments are on pages of their own
        "only": None,  # the experiment of such a page
        "consistency": replace(consistency, columns=tuple(filter(some, consistency.columns))),
        "experiments": experiments,
        "claims": claims,
        "estimators": introduce_estimators(kept.rows),
        "scenarios": scenarios,
        "fitted": manifest.get("recordings") or {},
        "missing": missing,
        "remarks": [
            *filter(None, [of_problem]),
            *ranking.certificate_remarks(table),
            *table_warnings(table),
        ],
        "failures": result_tables.failures(kept.rows),
        "events": events,
        "methods": methods(bool(kept.looks)),
        "paragraph": paragraph(numbers),
        "bibtex": bibtex(manifest["versions"]["cooploc"], manifest["commit"]),
        "versions": versions,
        "embedded": embed(kept),
        "wording": Wording({e: f"#{at}" for e, at in anchors_of(names).items()}, numbers.names, marks),
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
    again = only and part["scenario"].nunique() <= FEW  # the first figure of the page
    single = [] if again else run_numbers.group_by_sweep(list(plan)).get(("", ""), [])
    costly = run_numbers.first_middle_last(single or list(plan))[0 if only else -1 :]
    drawn = draw_experiment(part, single, costly, numbers.names, numbers.pens, style.PAGE)
    changed: list[Table] = []
    for sweep in run_numbers.sweeps_of_experiment(part, list(plan), costly):
        if changes := sentences.changes_over_sweep(sweep, results):
            texts.append(sentences.sweep_sentence(sweep, changes, results.stopping))
            changed.append(result_tables.sweep_table(f"{anchor}-sweep{len(changed) + 1}", changes, sweep.parameter))
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
    baselines = ", ".join(map(numbers.names.shorten, dict.fromkeys(numbers.table["baseline"])))
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
    number, scenarios = next(counter), drawn.rows["scenario"].unique()  # none where all failed
    return {
        "anchor": f"figure-{number}",
        "svg": inline_svg(drawn.figure, number, drawn.caption.partition(". ")[0]),
        "caption": f"{drawn.caption} {run_numbers.trial_counts(drawn.rows)}.",
        "scenario": scenarios[0] if len(scenarios) == 1 else "",
    }


def inline_svg(figure: Figure, number: int, label: str) -> Markup:
    """Return a figure as SVG to be put into a page: own ids, no links, a label.

    It is without ids that nothing uses and empty groups, its coordinates are to a tenth of a point, and what elements
    look like is said once for all that look so: a quarter as long.
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
    svg = re.sub(r'(?<= d=")[^"]*', lambda path: re.sub(r" ?([A-Za-z]) ?", r"\1", path[0]), svg)
    ids: dict[str, int] = {}
    named = r'(\bid="|url\(#|href="#)([^")]+)'
    svg = re.sub(named, lambda found: f"{found[1]}f{number}-{ids.setdefault(found[2], len(ids))}", svg)
    while (plainer := re.sub(r"<g>((?:(?!</?g\b).)*)</g>", r"\1", svg)) != svg:
        svg = plainer
    svg = re.sub(r' clip-path="([^"]*)" style="([^"]*)"', r' style="\2; clip-path: \1"', svg)
    rules: dict[str, str] = {}  # what many elements look like -> its class
    looks = r'style="([^"]*)"'
    svg = re.sub(looks, lambda found: f'class="{rules.setdefault(found[1], f"f{number}-c{len(rules)}")}"', svg)
    css = "".join(f".{name}{{{rule}}}" for rule, name in rules.items())
    head = f'<svg role="img" aria-label="{escape(label)}"'
    return Markup(svg.replace("<svg", head, 1).replace(">", f"><style>{css}</style>", 1))


# ------------------------------------------------------------------------------------------------ tables


class Wording(NamedTuple):
    """Names of estimators on a page, and where links lead."""

    links: Mapping[str, str] = {}  # estimator -> the address of its introduction
    names: Labels = Labels({}, {})
    marks: Mapping[str, Markup] = {}  # estimator -> its marker
    collapsed: bool = True  # whether tables have the columns that are shown on demand, or leave them to their files

    def cell(self, column: TableColumn, row: Row) -> Markup:
        """Return the text of a cell: an estimator with its marker and a link."""
        label = row.get("estimator", "")
        if column.keys[0] != "estimator" or label not in self.links:
            return escape(column.text(row))
        short = self.names.shorten(label)
        title = Markup(' title="{}"').format(label) if short != label else ""
        name, bracket, rest = short.partition("[")
        link = Markup('{}<a href="{}"{}>{}{}{}{}</a>')  # a long label goes on with its bracket in the next line
        break_ = Markup("<wbr>") if bracket and not name.endswith(" ") else ""
        return link.format(self.marks.get(label, ""), self.links[label], title, name, break_, bracket, rest)


def marker(pen: style.Pen, centralised: bool) -> Markup:
    """Return the marker of an estimator, as in the figures; grey where it is centralised."""
    colour = to_hex(style.colour_of({"centralised": centralised}, pen))
    mark = Markup('<span class="mark" aria-hidden="true" style="color: {}">{}</span>')
    return mark.format(colour, SYMBOLS.get(pen.marker, "●"))


def html(table: Table, wording: Wording | None = None, group: str = "") -> Markup:
    """Return a `<table>` whose cells carry as `data-sort` what cannot be read from them; everything is escaped.

    Columns that are empty in every row are left out. Neighbouring rows with the same value of the key `group` form a
    group with a head of its own.
    """
    known = wording or Wording()
    cells: list[dict[str, Any]] = []  # a column with those that stand below it
    for column in table.columns:
        unseen = column.collapsed and not known.collapsed
        if column.keys[0] == group or unseen or not any(map(column.text, table.rows)):
            continue
        if cells and column.head in BELOW:
            cells[-1]["below"].append(column)
        else:
            plain = column.right and all(re.fullmatch(PLAIN, column.text(row)) for row in table.rows)
            cells.append({"column": column, "below": [], "plain": plain})
    grouped = itertools.groupby(table.rows, lambda row: row[group]) if group else [("", table.rows)]
    groups = [(key, list(rows)) for key, rows in grouped]
    filled = {"table": table, "group": group, "cells": cells, "groups": groups, "wording": known}
    return Markup(fill_template("table.html.j2", **filled, sort_value=sort_value))


def sort_value(value: Any) -> str | None:
    """Return what a number is sorted by, nothing where it is absent; None for text."""
    if isinstance(value, str) or value is None:
        return None
    return "" if value != value else f"{float(value):.6g}"


# ---- texts: each estimator's introduction, the methods, and how to cite


def anchors_of(estimators: Iterable[Any]) -> dict[str, str]:
    """Return the anchor of each estimator's introduction."""
    return {str(label): f"estimator-{i}" for i, label in enumerate(estimators, 1)}


def introduce_estimators(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return an introduction of each method, in the order in which they ran; no code that is not built in runs."""
    methods: dict[str, list[dict[str, str]]] = {}
    for label, anchor in anchors_of(rows["estimator"].unique()).items():
        method, _, given = label.partition("[")
        given = given.removesuffix("]").replace(",", ", ")
        one = {"label": label, "anchor": anchor, "given": given, "standing": setting_kind(label)}
        methods.setdefault(method, []).append(one)
    return [_introduce(name, ones, rows) for name, ones in methods.items()]


def _introduce(name: str, configurations: list[dict[str, str]], rows: pd.DataFrame) -> dict[str, Any]:
    rows = rows[rows["estimator"].isin([one["label"] for one in configurations])]
    senses = " or ".join(rows[SENSES].dropna().unique()) if SENSES in rows else ""
    out = {"configurations": configurations, "senses": senses, "knows": _known_readings(rows)}
    out["name"] = shown = shorten_labels(name)
    try:
        made = make(name) if configure(name).builtin else None
    except BadInput:  # it is no longer known
        made = None
    if made is None:
        about = f"Not built in{f': {parse(name)[0]}' * (shown != name)}."
        return {**out, "about": about, "source": "", "defaults": {}}
    values = {one.name: getattr(made, one.name) for one in fields(made) if one.init and one.name != "uses"}
    texts = {key: f"{v:g}".replace("inf", "∞") if isinstance(v, float) else str(v) for key, v in values.items()}
    about = (type(made).__doc__ or "").strip().partition("\n")[0]
    return {**out, "about": about, "source": source_of(type(made)), "defaults": texts}


def _known_readings(rows: pd.DataFrame) -> str:
    """Return which readings reach a robot that runs it."""
    if "offline" in rows and rows["offline"].eq(True).any():
        return "every reading of every robot, of later ticks too: a bound that no robot could run"
    if rows["bound"].eq(True).any():
        return "every reading of every robot: a bound on all others in a simulated world"
    if rows["centralised"].eq(True).any():
        return "every reading of every robot, on one computer"
    return f"its own readings, and {'what teammates send' if rows['messages'].gt(0).any() else 'nothing of teammates'}"


def methods(until_decided: bool) -> dict[str, str]:
    """Return terms and what they mean, in a run of a fixed number of trials or in one until decided."""
    known = read_toml("page/methods.toml")
    terms = {term: text.format(far=FAR, floored=FLOORED) for term, text in known["terms"].items()}
    return {**terms, **known["until_decided"], "Decided": words("captions")["stopped"]} if until_decided else terms


def bibtex(version: str, commit: str | None) -> str:
    """Return a BibTeX entry for cooploc in the version that ran."""
    return fill_template("cooploc.bib.j2", version=version, commit=commit)


def paragraph(numbers: Numbers) -> str:
    """Return the methods of a run, in sentences that a paper can use."""
    table, manifest = numbers.table, numbers.kept.manifest
    text = fill_template(
        "paragraph.txt.j2",
        estimators=count_of(table["estimator"].nunique(), "estimator"),
        scenarios=count_of(table["scenario"].nunique(), "scenario"),
        baselines=" or ".join(dict.fromkeys(table["baseline"])),
        comparisons=count_of(int(table["p"].notna().sum()), "comparison"),
        trials=trial_counts(table),
        manifest=manifest,
        centralised=table["centralised"].any(),
        until_decided=bool(numbers.kept.looks),
        over_confident=f"{OVER_CONFIDENT:g}",
    )
    return text.replace("\n", " ").strip()
