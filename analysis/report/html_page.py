"""A run's report: one HTML page that needs no network, and beside it its tables and its trials as files."""

import base64
import hashlib
import itertools
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from cooploc.analysis.claims.ledger import Ledger
from cooploc.analysis.claims.trial_table import TrialTable
from cooploc.analysis.execution.reproduce import PAGE, embed
from cooploc.analysis.execution.run_directory import StoredRun
from cooploc.analysis.metrics import ranking
from cooploc.analysis.metrics.compare import outlier_warnings
from cooploc.analysis.metrics.crlb import floors
from cooploc.analysis.metrics.statistics import LEAST_TRIALS
from cooploc.analysis.report import html_table, page_figures, page_texts, result_tables, sentences
from cooploc.analysis.report.claim_tables import claims_shown
from cooploc.analysis.report.html_table import Wording
from cooploc.analysis.report.page_figures import Shown
from cooploc.analysis.report.run_numbers import (
    FLOORED,
    Numbers,
    group_by_sweep,
    numbers_of,
    rank_scenario,
    rows_of_experiment,
)
from cooploc.analysis.report.tables import Table, TableColumn, csv_text, text_column

FORMS = {"tex": "latex", "md": "markdown", "csv": "csv"}  # ending of a file -> method of `Table`
LONGEST_TITLE = 130  # characters of a study's description that is the page's title
TRIALS = "trials"  # folder of a CSV file for each scenario
FLOOR_PATHS, FLOOR_TRIALS = 16, 8  # over which a floor is taken, in a fifth of the time that one to 0.2 % takes
MOST = 400_000  # RMSE values that a page holds; of more trials the first ones


def write(kept: StoredRun, ledger: Ledger, out: Path) -> Path:
    """Write the page, its tables and its trials into a directory; return the page's path."""
    numbers = numbers_of(kept)
    table = numbers.table
    lowest = floors(table["scenario"], kept.manifest["seed"], FLOORED, FLOOR_PATHS, FLOOR_TRIALS)
    numbers = numbers._replace(table=table.assign(floor=table["scenario"].map(lowest)))
    context = content(numbers, ledger)
    texts: dict[str, str] = {}
    for one in context["tables"]:
        texts |= {f"tables/{one.name}.{ending}": getattr(one, form)() for ending, form in FORMS.items()}
    trials = rmse_by_trial(numbers.table, numbers.results)
    for scenario, name in file_names(trials).items():
        texts[name] = csv_text(trials[scenario].rename_axis("trial").reset_index())
    about = {"tables": "Tables for LaTeX, Markdown and programs", TRIALS: "RMSE of every trial"}
    folders = {text: sorted(name for name in texts if name.startswith(folder)) for folder, text in about.items()}
    texts[PAGE] = render({**context, "trials": compact(trials), "folders": folders})
    for folder in about:
        (out / folder).mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (out / name).write_text(text, encoding="utf-8")
    return out / PAGE


def render(context: dict[str, Any]) -> str:
    """Return the page; everything that is not marked as safe is escaped."""
    templates = html_table.environment()
    script, style = (Markup(html_table.read_template(name)) for name in ("page.js", "page.css"))  # our own files
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    body = Markup(templates.get_template("body.html.j2").render(**context))  # its parts are escaped by their templates
    page = templates.get_template("page.html.j2")
    return page.render(**context, style=style, body=body, script=script, script_hash=digest)


# ------------------------------------------------------------------------------------------------ content


def content(numbers: Numbers, ledger: Ledger) -> dict[str, Any]:
    """Return everything that the page shows but its files, and `tables`, all of its tables."""
    kept, table, manifest = numbers.kept, numbers.table, numbers.kept.manifest
    counter = itertools.count(1)
    first = page_figures.first_figure(numbers, counter)
    experiments = [experiment(name, plan, numbers, counter) for name, plan in kept.experiments.items()]
    found = sentences.standings(table, numbers.results)
    claims = claims_shown(kept, ledger)
    consistency, events = result_tables.consistency(table), result_tables.events(kept.rows)
    scenarios, versions = result_tables.scenario_tables(table, manifest["scenarios"]), _versions(manifest)
    tables = [result_tables.best(found), consistency, *([claims["overview"], claims["table"]] if claims else [])]
    tables += [one for each in experiments for one in (*each["tables"], each["standings"])]
    missing = [f"{s}, {e}: {n} of the planned trials are missing" for (s, e), n in kept.gaps.items()]
    marks = html_table.markers(numbers.looks, set(kept.rows.loc[kept.rows["centralised"].eq(True), "estimator"]))
    ended = dict.fromkeys(table.loc[table["rmse"].notna(), "scenario"])
    names = kept.rows["estimator"].unique()

    def some(column: TableColumn) -> bool:
        return any(row[column.keys[0]] for row in consistency.rows)

    return {
        **heading(manifest),
        "manifest": manifest,
        "lowest": sentences.lowest_errors(found, table),
        "over_confident": sentences.over_confident_estimators(table),
        "first": first,
        "consistency": replace(consistency, columns=tuple(filter(some, consistency.columns))),
        "experiments": experiments,
        "claims": claims,
        "estimators": page_texts.introduce_estimators(kept.rows),
        "scenarios": scenarios,
        "fitted": manifest.get("recordings") or {},
        "missing": missing,
        "remarks": [*ranking.certificate_remarks(table), *outlier_warnings(table)],
        "failures": result_tables.failures(kept.rows),
        "events": events,
        "methods": page_texts.methods(bool(kept.looks)),
        "paragraph": page_texts.paragraph(numbers),
        "bibtex": page_texts.bibtex(manifest["versions"]["cooploc"], manifest["commit"]),
        "versions": versions,
        "embedded": embed(kept),
        "wording": Wording(numbers.names, marks, page_texts.anchors_of(names), file_names(ended)),
        "labels": {what: list(dict.fromkeys(table[what])) for what in ("estimator", "scenario")},
        "tables": [*tables, *scenarios, *[events] * bool(events.rows), versions],
    }


def heading(manifest: dict[str, Any]) -> dict[str, str]:
    """Return the title that the user gave; without one the study's description, or its name where that is long."""
    study = manifest["study"]
    name, about = study["name"], study.get("about", "")
    if study.get("title"):
        return {"title": study["title"], "study": name, "about": about}
    short = 0 < len(about) <= LONGEST_TITLE
    return {"title": about if short else name, "study": name if short else "", "about": "" if short else about}


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
    part = rows_of_experiment(table, plan)
    found = sentences.standings(part, results)
    plain = re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")[:60]
    anchor = "experiment-" + (plain if plain == name else f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:6]}")
    only = len(part) == len(table)
    texts = [] if only else [sentences.lowest_errors(found, part), sentences.over_confident_estimators(part)]
    shown: list[Shown] = []
    changed: list[Table] = []
    for (_, parameter), group in group_by_sweep(list(plan)).items():
        rows = part[part["scenario"].isin(group)]
        if parameter:
            changes = sentences.changes_over_sweep(group, dict.fromkeys(rows["estimator"]), results)
            texts.append(sentences.sweep_sentence(group, changes, results.stopping))
            changed.append(result_tables.sweep_table(f"{anchor}-sweep{len(changed) + 1}", changes, parameter))
            shown.append(page_figures.lines(rows, numbers, counter))
        elif not (only and page_figures.is_few(part)):  # else it is the first figure of the page
            shown.append(page_figures.dots(rows, numbers, counter))
    shown.append(page_figures.scatter(part, numbers, counter))
    test = "confidence sequences of the change" if numbers.kept.looks else "t test of the change"
    few = f" Below {LEAST_TRIALS} trials there are no intervals." * bool(part["trials"].min() < LEAST_TRIALS)
    about = (
        f"{name}: {page_figures.trial_counts(part)}, seed {numbers.kept.manifest['seed']}; {test} against "
        f"the baseline, Holm over the {int(table['p'].notna().sum())} comparisons of this report.{few}"
    )
    ranks = {str(label): rank_scenario(rows, results) for label, rows in part.groupby("scenario", sort=False)}
    every = result_tables.results(anchor, part, ranks, about)
    return {
        "name": name,
        "anchor": anchor,
        "found": found,
        "sentences": list(filter(None, texts)),
        "figures": shown,
        "tables": [every, *changed],
        "standings": result_tables.best(found, f"best-{anchor}"),
    }


# ------------------------------------------------------------------------------------------------ trials


def rmse_by_trial(table: pd.DataFrame, results: TrialTable) -> dict[str, pd.DataFrame]:
    """Return of each scenario the RMSE [m]: a row per trial, a column per estimator; nan where the trial failed."""
    ended = table[table["rmse"].notna()].groupby("scenario", sort=False)["estimator"]
    return {str(s): results.errors(str(s), list(names)).pow(0.5).sort_index() for s, names in ended}


def file_names(scenarios: Any) -> dict[str, str]:
    """Return the file of each scenario's trials."""
    plain = (re.sub(r"[^A-Za-z0-9]+", "-", scenario).strip("-")[:60] for scenario in scenarios)
    return {s: f"{TRIALS}/{i:03}-{name}.csv" for i, (s, name) in enumerate(zip(scenarios, plain, strict=True), 1)}


def compact(trials: dict[str, pd.DataFrame]) -> list[dict[str, Any]]:
    """Return what the page holds of each scenario: estimators, trials, and their RMSE to four digits."""
    most = max(1, MOST // max(1, sum(len(one.columns) for one in trials.values())))
    return [
        {
            "scenario": scenario,
            "estimators": list(map(str, one.columns)),
            "trials": [int(trial) for trial in one.index[:most]],
            "every": len(one),
            "rmse": [
                [float(f"{v:.4g}") if np.isfinite(v) and v > 0 else None for v in one[name][:most]] for name in one
            ],
        }
        for scenario, one in trials.items()
    ]
