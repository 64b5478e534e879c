"""Everything that a report's page shows, from a run."""

import itertools
from dataclasses import replace
from typing import Any

from cooploc.analysis.claims.ledger import Ledger
from cooploc.analysis.claims.trial_table import collect
from cooploc.analysis.execution.stored_run import Kept
from cooploc.analysis.metrics import ranking
from cooploc.analysis.metrics.compare import compare, outlier_warnings
from cooploc.analysis.metrics.crlb import floors
from cooploc.analysis.metrics.sequential import ANYTIME, FIXED, with_decisions
from cooploc.analysis.plot import style
from cooploc.analysis.report import answer, citation, estimator_marks, page_figures, result_tables, summaries
from cooploc.analysis.report.claim_section import claims_shown
from cooploc.analysis.report.event_table import events
from cooploc.analysis.report.experiments import experiment
from cooploc.analysis.report.failures import failure_kinds
from cooploc.analysis.report.html_table import Wording
from cooploc.analysis.report.introductions import anchors_of, introductions
from cooploc.analysis.report.methods import FLOOR_PATHS, FLOOR_TRIALS, FLOORED, methods
from cooploc.analysis.report.reproduce import embedded
from cooploc.analysis.report.run_numbers import Numbers
from cooploc.analysis.report.scenario_tables import scenario_tables
from cooploc.analysis.report.short_names import short_names
from cooploc.analysis.report.tables import Table, words
from cooploc.analysis.report.trial_files import addresses

LONGEST_TITLE = 130  # characters; below a longer description stands only the study's name as a title


def numbers_of(kept: Kept) -> Numbers:
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
    found = summaries.standings(table, numbers.results)
    claims = claims_shown(kept, ledger)
    consistency, where = result_tables.confidence(table), result_tables.where({e.name: e.found for e in experiments})
    about = _about(numbers)
    tables = [where, result_tables.best(found), consistency, *([claims.overview, claims.table] if claims else [])]
    tables += [one for each in experiments for one in each.tables]
    tables += [*about["scenarios"], *([about["events"]] if about["events"].rows else []), about["versions"]]
    return {
        **heading(kept.manifest),
        **about,
        "lowest": answer.lowest(found, table, numbers.results),
        "over_confident": answer.over_confident(table),
        "first": first,
        "where": where,
        "consistency": _without_zeros(consistency),
        "experiments": experiments,
        "claims": claims,
        "wording": _wording(numbers),
        "symbols": estimator_marks.symbols(numbers.looks),
        "labels": {what: list(dict.fromkeys(table[what])) for what in ("estimator", "scenario")},
        "tables": tables,
    }


def _about(numbers: Numbers) -> dict[str, Any]:
    """What was run and how, what went wrong, and what the page embeds."""
    kept, table = numbers.kept, numbers.table
    manifest = kept.manifest
    return {
        "manifest": manifest,
        "estimators": introductions(kept.rows, manifest.get("certificates", {})),
        "scenarios": scenario_tables(table, manifest["scenarios"]),
        "fitted": manifest.get("recordings") or {},
        "missing": [f"{s}, {e}: {n} of the planned trials are missing" for (s, e), n in kept.gaps.items()]
        + [*kept.ignored],
        "remarks": [*ranking.certificate_remarks(table), *outlier_warnings(table)],
        "failures": failure_kinds(kept.rows),
        "events": events(kept.rows),
        "methods": methods(bool(kept.looks)),
        "paragraph": citation.paragraph(numbers),
        "bibtex": citation.bibtex(manifest["versions"]["cooploc"], manifest["commit"]),
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
        estimator_marks.marks(numbers.looks, central),
        anchors_of(rows["estimator"].unique()),
        addresses(list(dict.fromkeys(ended["scenario"]))),
    )


def _versions(kept: Kept) -> Table:
    manifest = kept.manifest
    imported = {name: at for one in manifest.get("imports", {}).values() for name, at in one.items()}
    used = {**imported, **manifest["versions"], **{key: manifest[key] for key in ("commit", "source", "cpu", "seed")}}
    rows = [{"what": what, "version": value} for what, value in {**used, "recordings": manifest["data"]}.items()]
    columns = words("what"), words("version or hash", "version")
    return Table("versions", "What the bits depend on", columns, rows)
