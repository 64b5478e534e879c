"""One experiment of a report: its figures, its tables, and what it says in words."""

import base64
import hashlib
import itertools
import os
import re
from collections.abc import Iterator
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np
import pandas as pd
from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from cooploc.analysis.claims.ledger import Ledger
from cooploc.analysis.claims.trial_table import TrialTable, collect
from cooploc.analysis.execution.reproduce import PAGE, embedded
from cooploc.analysis.execution.run_directory import StoredRun
from cooploc.analysis.metrics import ranking
from cooploc.analysis.metrics.compare import compare, outlier_warnings
from cooploc.analysis.metrics.crlb import floors
from cooploc.analysis.metrics.curves import sweep
from cooploc.analysis.metrics.ranking import is_refused, rank_groups
from cooploc.analysis.metrics.sequential import ANYTIME, FIXED, with_decisions
from cooploc.analysis.metrics.statistics import LEAST_TRIALS
from cooploc.analysis.plot import style
from cooploc.analysis.report import colours, html_table, page_figures, result_tables, sentences
from cooploc.analysis.report import page_texts as page_texts
from cooploc.analysis.report.claim_tables import claims_shown
from cooploc.analysis.report.html_table import Wording, html
from cooploc.analysis.report.page_figures import Shown
from cooploc.analysis.report.page_texts import (
    FLOOR_PATHS,
    FLOOR_TRIALS,
    FLOORED,
    anchors_of,
    introduce_estimators,
    methods,
)
from cooploc.analysis.report.result_tables import Numbers, events, failure_kinds, scenario_tables, short_names
from cooploc.analysis.report.tables import Table, csv_text, document, words

SWEEP = 3  # values from which a sweep becomes a line


class Experiment(NamedTuple):
    """An experiment, as a section of the page."""

    name: str
    anchor: str
    found: list[sentences.Standing]
    sentences: list[str]  # its answer, where the report has several experiments, and what it says of sweeps
    figures: list[Shown]
    tables: list[Table]
    standings: Table  # who is best where


def experiment(name: str, plan: dict[str, list[str]], numbers: Numbers, counter: Iterator[int]) -> Experiment:
    """An experiment with the estimators that it has in each scenario; `counter` numbers its figures."""
    labels = zip(numbers.table["scenario"], numbers.table["estimator"], strict=True)
    part = numbers.table[[estimator in plan.get(scenario, ()) for scenario, estimator in labels]]
    found = sentences.standings(part, numbers.results)
    anchor = f"experiment-{_anchor(name)}"
    only = len(part) == len(numbers.table)
    said = [] if only else [sentences.lowest(found, part, numbers.results), sentences.over_confident(part)]
    shown: list[Shown] = []
    changed: list[Table] = []
    for (_, parameter), group in groups(list(plan)).items():
        rows = part[part["scenario"].isin(group)]
        if parameter:
            changes = sentences.summary_changes(group, dict.fromkeys(rows["estimator"]), numbers.results)
            said.append(sentences.swept(group, changes, numbers.results.stopping))
            changed.append(result_tables.sweep(f"{anchor}-sweep{len(changed) + 1}", changes, parameter))
            shown.append(page_figures.lines(rows, numbers, counter))
        elif not (only and page_figures.few(part)):  # else it is the first figure of the page
            shown.append(page_figures.dots(rows, numbers, counter))
    shown.append(page_figures.scatter(part, numbers, counter))
    ranks = {str(label): ranked(rows, numbers.results) for label, rows in part.groupby("scenario", sort=False)}
    table = result_tables.results(anchor, part, ranks, f"{name}: {_about_experiment(part, numbers)}")
    standings = replace(result_tables.best(found), name=f"best-{anchor}")
    return Experiment(name, anchor, found, list(filter(None, said)), shown, [table, *changed], standings)


def ranked(rows: pd.DataFrame, results: TrialTable) -> tuple[dict[str, float], dict[str, str]]:
    """Mean ranks (of a fixed number of trials) and letters of one scenario's estimators that failed nowhere.

    One that failed would take its trials from all others, and change their ranks and letters. What is offline is not
    ranked with filters.
    """
    ended = rows["rmse"].notna() & (rows["failed"] == 0) & ~rows["offline"]
    names = list(rows.loc[ended & ~rows["certificate"].map(is_refused).astype(bool), "estimator"])
    if not names:
        return {}, {}
    mse = results.errors(rows["scenario"].iloc[0], names)
    return rank_groups(mse.dropna() if results.stopping is FIXED else mse, results.stopping)


def groups(labels: list[str]) -> dict[tuple[str, str], list[str]]:
    """The scenarios by family and what they sweep; those of short sweeps together with those that sweep nothing."""
    found: dict[tuple[str, str], list[str]] = {}
    for label in labels:
        found.setdefault(sweep(label)[:2], []).append(label)
    out: dict[tuple[str, str], list[str]] = {}
    for label in labels:
        which = sweep(label)[:2]
        out.setdefault(which if which[1] and len(found[which]) >= SWEEP else ("", ""), []).append(label)
    return out


def _about_experiment(part: pd.DataFrame, numbers: Numbers) -> str:
    """Trials, seed, test and correction, for the caption of a table."""
    few = part["trials"].min() < LEAST_TRIALS
    tested = int(numbers.table["p"].notna().sum())
    test = "confidence sequences of the change" if numbers.kept.looks else "t test of the change"
    return (
        f"{page_figures.trials(part).removesuffix('.')}, seed {numbers.kept.manifest['seed']}; {test} against "
        f"the baseline, Holm over the {tested} comparisons of this report."
        + f" Below {LEAST_TRIALS} trials there are no intervals."
        * bool(few)
    )


def _anchor(name: str) -> str:
    """A name for links and files."""
    plain = re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")[:60]
    return plain if plain == name else f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:6]}"


# The trials behind a report's numbers: a CSV file for each scenario, and what the page draws pairs of them from.
#
# The page holds each trial's RMSE as a 16-bit number on a logarithmic scale, exact to a ten-thousandth or so.

FOLDER = "trials"
MOST = 400_000  # RMSE values that a page holds, in two bytes each; of more trials the first ones
ABSENT = 65535


def rmse_by_trial(table: pd.DataFrame, results: TrialTable) -> dict[str, pd.DataFrame]:
    """Of each scenario the RMSE [m]: a row per trial, a column per estimator; nan where the trial failed."""
    out = {}
    for scenario, part in table[table["rmse"].notna()].groupby("scenario", sort=False):
        out[str(scenario)] = results.errors(str(scenario), list(part["estimator"])).pow(0.5).sort_index()
    return out


def names_of(scenarios: list[str]) -> dict[str, str]:
    """The file of each scenario."""
    plain = (re.sub(r"[^A-Za-z0-9]+", "-", scenario).strip("-")[:60] for scenario in scenarios)
    return {scenario: f"{i:03}-{name}.csv" for i, (scenario, name) in enumerate(zip(scenarios, plain, strict=True), 1)}


def addresses(scenarios: list[str]) -> dict[str, str]:
    """The address of each scenario's file, from the page."""
    return {scenario: f"{FOLDER}/{quote(name)}" for scenario, name in names_of(scenarios).items()}


def write_trial_files(trials: dict[str, pd.DataFrame], out: Path) -> None:
    """Write a file for each scenario."""
    (out / FOLDER).mkdir(parents=True, exist_ok=True)
    for scenario, name in names_of(list(trials)).items():
        file = trials[scenario].rename_axis("trial").reset_index()
        (out / FOLDER / name).write_text(csv_text(file), encoding="utf-8")


def compact(trials: dict[str, pd.DataFrame]) -> list[dict[str, Any]]:
    """What the page holds of each scenario: estimators, trials, and their RMSE, estimator by estimator."""
    cells = sum(len(one.columns) for one in trials.values())
    most = max(1, MOST // max(1, cells))
    return [_packed(scenario, one.iloc[:most], len(one)) for scenario, one in trials.items()]


def _packed(scenario: str, rmse: pd.DataFrame, every: int) -> dict[str, Any]:
    values = rmse.to_numpy(float).T
    known = np.isfinite(values) & (values > 0)
    logs = np.log(np.where(known, values, 1.0))
    low, high = (float(f(logs[known])) if known.any() else 0.0 for f in (np.min, np.max))
    steps = np.where(known, np.round((logs - low) / ((high - low) or 1.0) * (ABSENT - 1)), ABSENT)
    return {
        "scenario": scenario,
        "estimators": list(map(str, rmse.columns)),
        "trials": [int(trial) for trial in rmse.index],
        "every": every,
        "low": low,
        "high": high,
        "steps": base64.b64encode(steps.astype("<u2").tobytes()).decode(),
    }


# Everything that a report's page shows, from a run.

LONGEST_TITLE = 130  # characters; below a longer description stands only the study's name as a title


def numbers_of(kept: StoredRun) -> Numbers:
    """The run's table and trials, and how its estimators are drawn and written."""
    table = compare(kept.rows, kept.baselines, full=True)
    table = table if kept.comparisons is None else with_decisions(table, kept.comparisons)
    lowest = floors(table["scenario"], kept.manifest["seed"], FLOORED, FLOOR_PATHS, FLOOR_TRIALS)
    table["floor"] = table["scenario"].map(lowest)
    estimators = [str(name) for name in kept.rows["estimator"].unique()]
    names = short_names(estimators, kept.manifest["study"].get("variants", {}))
    results = collect(kept.rows, ANYTIME if kept.looks else FIXED)
    return Numbers(kept, table, results, style.looks(estimators), names)


def content(numbers: Numbers, ledger: Ledger) -> dict[str, Any]:
    """Everything that the page shows but its files, and `tables`, all of its tables."""
    kept, table = numbers.kept, numbers.table
    counter = itertools.count(1)
    first = page_figures.first_figure(numbers, counter)
    experiments = [experiment(name, plan, numbers, counter) for name, plan in kept.experiments.items()]
    found = sentences.standings(table, numbers.results)
    claims = claims_shown(kept, ledger)
    consistency, where = result_tables.confidence(table), result_tables.where({e.name: e.found for e in experiments})
    about = _about(numbers)
    tables = [where, result_tables.best(found), consistency, *([claims.overview, claims.table] if claims else [])]
    tables += [one for each in experiments for one in each.tables]
    tables += [*about["scenarios"], *([about["events"]] if about["events"].rows else []), about["versions"]]
    return {
        **heading(kept.manifest),
        **about,
        "lowest": sentences.lowest(found, table, numbers.results),
        "over_confident": sentences.over_confident(table),
        "first": first,
        "where": where,
        "consistency": _without_zeros(consistency),
        "experiments": experiments,
        "claims": claims,
        "wording": _wording(numbers),
        "symbols": html_table.symbols(numbers.looks),
        "labels": {what: list(dict.fromkeys(table[what])) for what in ("estimator", "scenario")},
        "tables": tables,
    }


def _about(numbers: Numbers) -> dict[str, Any]:
    """What was run and how, what went wrong, and what the page embeds."""
    kept, table = numbers.kept, numbers.table
    manifest = kept.manifest
    return {
        "manifest": manifest,
        "estimators": introduce_estimators(kept.rows, manifest.get("certificates", {})),
        "scenarios": scenario_tables(table, manifest["scenarios"]),
        "fitted": manifest.get("recordings") or {},
        "missing": [f"{s}, {e}: {n} of the planned trials are missing" for (s, e), n in kept.gaps.items()],
        "remarks": [*ranking.certificate_remarks(table), *outlier_warnings(table)],
        "failures": failure_kinds(kept.rows),
        "events": events(kept.rows),
        "methods": methods(bool(kept.looks)),
        "paragraph": page_texts.paragraph(numbers),
        "bibtex": page_texts.bibtex(manifest["versions"]["cooploc"], manifest["commit"]),
        "versions": _versions(kept),
        "embedded": embedded(kept),
    }


def heading(manifest: dict[str, Any]) -> dict[str, str]:
    """The title that the user gave; where there is none the study's description, or its name where that is long."""
    study = manifest["study"]
    name, about = study["name"], study.get("about", "")
    if study.get("title"):
        return {"title": study["title"], "study": name, "about": about}
    short = 0 < len(about) <= LONGEST_TITLE
    return {"title": about if short else name, "study": name if short else "", "about": "" if short else about}


def _without_zeros(table: Table) -> Table:
    """The table without columns that are zero in every row."""
    return replace(table, columns=tuple(c for c in table.columns if any(row[c.keys[0]] for row in table.rows)))


def _wording(numbers: Numbers) -> Wording:
    """How estimators are written on the page, and where their trials are."""
    rows = numbers.kept.rows
    central = set(rows.loc[rows["centralised"].eq(True), "estimator"])
    ended = numbers.table[numbers.table["rmse"].notna()]
    return Wording(
        numbers.names,
        html_table.marks(numbers.looks, central),
        anchors_of(rows["estimator"].unique()),
        addresses(list(dict.fromkeys(ended["scenario"]))),
    )


def _versions(kept: StoredRun) -> Table:
    manifest = kept.manifest
    imported = {name: at for one in manifest.get("imports", {}).values() for name, at in one.items()}
    used = {**imported, **manifest["versions"], **{key: manifest[key] for key in ("commit", "source", "cpu", "seed")}}
    rows = [{"what": what, "version": value} for what, value in {**used, "recordings": manifest["data"]}.items()]
    columns = words("what"), words("version or hash", "version")
    return Table("versions", "What the bits depend on", columns, rows)


# Links from a report to the files that it rests on: those of the run, and those beside the page.


class FileLink(NamedTuple):
    """A file, and its address from the page; empty where the page lies elsewhere and only the name can be given."""

    name: str
    address: str


class Folder(NamedTuple):
    """Files of one kind."""

    about: str
    files: list[FileLink]


ABOUT = {
    "": "The run: what was asked and what the results depend on",
    "parts": "Every trial's numbers (parquet), a file for some trials of an estimator in a scenario",
    "receipts": "A checksum for each of them",
}


def run_files(run: Path, out: Path) -> list[Folder]:
    """The files of a run's directory, by folder."""
    way = _way(run, out)
    found = []
    for folder, about in ABOUT.items():
        place = run / folder if folder else run
        names = sorted(p.name for p in place.iterdir() if p.is_file() and p.name[0] != ".") if place.is_dir() else []
        where = [f"{folder}/{name}" if folder else name for name in names]
        links = [FileLink(name, f"{way}/{quote(name)}" if way else "") for name in where]
        found += [Folder(about, links)] if links else []
    return found


def own_files(out: Path, *folders: str) -> list[Folder]:
    """The files beside the page."""
    about = {"tables": "Tables for LaTeX, Markdown and programs", "trials": "RMSE of every trial, by scenario"}
    return [Folder(about[folder], [_beside(folder, p.name) for p in _sorted(out / folder)]) for folder in folders]


def _beside(folder: str, name: str) -> FileLink:
    return FileLink(f"{folder}/{name}", f"{folder}/{quote(name)}")


def _sorted(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.is_file())


def _way(run: Path, out: Path) -> str:
    """From the page to the run, where both are in one tree: the page in the run, or both in the working directory.

    Anything else would write the names of directories of this machine into the page.
    """
    run, out, here = run.resolve(), out.resolve(), Path.cwd().resolve()
    together = out.is_relative_to(run) or (run.is_relative_to(here) and out.is_relative_to(here))
    return quote(Path(os.path.relpath(run, out)).as_posix()) if together else ""


# A run's report: one HTML page that needs no network, and beside it its tables and its trials as files.

SCRIPTS = "tables.js.j2", "filters.js.j2", "trials.js.j2", "copy.js.j2"
STYLES = "page.css.j2", "tables.css.j2", "parts.css.j2", "print.css.j2"


def write(kept: StoredRun, ledger: Ledger, out: Path) -> Path:
    """Write the page, its tables and its trials into a directory; returns the page's path.

    Raises:
        BadInput: estimators of one scenario ran on different streams.
        OSError: a file cannot be written.

    """
    numbers = numbers_of(kept)
    context = content(numbers, ledger)
    _write_tables(context.pop("tables"), context["title"], out)
    trials = rmse_by_trial(numbers.table, numbers.results)
    write_trial_files(trials, out)
    folders = [*own_files(out, "tables", FOLDER), *run_files(kept.folder, out)]
    page = out / PAGE
    page.write_text(render({**context, "trials": compact(trials), "folders": folders}), encoding="utf-8")
    return page


def render(context: dict[str, Any]) -> str:
    """The page; everything that is not marked as safe is escaped."""
    environment = Environment(
        loader=FunctionLoader(_template), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.globals["html"] = html
    environment.policies["json.dumps_kwargs"] = {"sort_keys": True, "separators": (",", ":")}
    script, style = (Markup("".join(map(_template, names))) for names in (SCRIPTS, STYLES))  # our own files
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    body, shared = map(Markup, page_figures.shared_styles(environment.get_template("body.html.j2").render(**context)))
    day, night = map(Markup, colours.variables(body + shared))
    css = {"style": style, "shared": shared, "day": day, "night": night}
    page = environment.get_template("page.html.j2")  # its parts are escaped by their templates
    return page.render(**context, **css, body=body, script=script, script_hash=digest)


def _write_tables(tables: list[Table], title: str, out: Path) -> None:
    (out / "tables").mkdir(parents=True, exist_ok=True)
    for one in tables:
        for ending, written in (("tex", one.latex()), ("md", one.markdown()), ("csv", one.csv())):
            (out / "tables" / f"{one.name}.{ending}").write_text(written, encoding="utf-8")
    names = [one.name for one in tables]
    (out / "tables" / "all.tex").write_text(document(names, title), encoding="utf-8")


def _template(name: str) -> str:
    return (files(__package__) / "page" / name).read_text(encoding="utf-8")
