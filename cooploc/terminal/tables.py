"""What the commands print: lists, results, the contents of a run, verdicts, plans, tuning, checks."""

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from html import escape
from itertools import groupby
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.claims import ledger as ledgers
from cooploc.analysis.claims.multiverse import shares
from cooploc.analysis.claims.verdicts import count_verdicts
from cooploc.analysis.execution.provenance import line
from cooploc.analysis.execution.run import seconds_left
from cooploc.analysis.execution.run_directory import RunDir, read_run
from cooploc.analysis.formats import change, count, duration, join_words, lines_about
from cooploc.analysis.metrics import ranking
from cooploc.analysis.metrics.compare import table_warnings
from cooploc.analysis.metrics.errors import drop_failed
from cooploc.analysis.metrics.ranking import short_certificate
from cooploc.analysis.metrics.sequential import PILOT, minutes
from cooploc.analysis.report import claim_tables, result_tables
from cooploc.analysis.report.labels import Labels, short_labels, variants_of
from cooploc.analysis.report.result_tables import (
    STUDY,
    decision,
    essential_columns,
    events,
    failures,
    lowest_that_qualifies,
    result_columns,
    sort_rows,
)
from cooploc.analysis.report.tables import Table, csv_text, frame, number_column, text_column, words
from cooploc.estimators.errors import BadInput, count_of
from cooploc.estimators.label_syntax import shorten_labels
from cooploc.scenarios.conformance import FIRST, Report
from cooploc.scenarios.recordings.scenario import NO_ORDER
from cooploc.scenarios.studies.study import Study, stream_sentence
from cooploc.terminal.console import in_shell, make_console
from cooploc.terminal.names import show_name

ONE_PROCESS = "all or some of this ran in one process (--no-isolate): estimators may have disturbed each other"
INTERVALS = "in brackets: 95 % intervals over trials; "
BOLD = "bold: the lowest RMSE of those that may be called best"
DECIDES = "trial ... decides: without that trial the interval would be half as wide, so the change is not comparable"
IN_ONE_PICTURE = 12  # scenarios; `cooploc report` draws one of each experiment


def keep_tables(table: pd.DataFrame, rows: pd.DataFrame, folder: Path) -> None:
    """Write the table of `compare` as `table.csv`, and `rmse.png` where any trial ended and it can be read."""
    (folder / "table.csv").write_text(csv_text(table), encoding="utf-8")
    ended = drop_failed(rows)
    if len(ended) and table["scenario"].nunique() <= IN_ONE_PICTURE:
        from cooploc.analysis.plot import rmse, style

        with style.as_shipped():
            style.save(rmse(ended), folder / "rmse.png")


def show_results(
    found: pd.DataFrame, rows: pd.DataFrame, folder: Path, as_json: bool, every_column: bool, legend: bool, sort: str
) -> None:
    """Print the results of a run by rising `sort`, then failures, where the files are, and what to do next."""
    manifest, console = RunDir(folder).manifest, make_console(stderr=as_json)
    ordered, lines = _arrange(found, rows, manifest, sort)
    show_table(found if as_json else ordered, rows, as_json, every_column, legend, manifest["study"])
    for text in lines:
        console.print(text)
    picture = f"{folder / 'rmse.png'}" if (folder / "rmse.png").exists() else f"cooploc report {in_shell(folder)}"
    for place in (f"picture: {picture}", f"table, every column: {folder / 'table.csv'}", f"run: {folder}"):
        console.print(place)
    console.print(f"next: cooploc report {in_shell(folder)}; --wide prints every column, --legend what they mean")


OF_THE_OTHERS = "numbers of an estimator that failed in trials are of its other trials, and not ranked"


def _arrange(
    found: pd.DataFrame, rows: pd.DataFrame, manifest: Mapping[str, Any], sort: str
) -> tuple[pd.DataFrame, list[str]]:
    """Return a run's table by rising `sort`, and what a reader must know of the run.

    A scenario that ranks no estimators stays in the order of the study.
    """
    notes, parts, lines = manifest.get("recordings", {}), _by_scenario(found), list[str]()
    weak = {name: [text for text in notes.get(name, []) if NO_ORDER in text] for name, _ in parts}
    ordered = pd.concat([sort_rows(part, STUDY if weak[name] else sort) for name, part in parts])
    if manifest.get("data") is not None:
        lines += lines_about({name: recording_lines(part, weak[name]) for name, part in parts})
    if not manifest.get("isolated", True):
        lines.append(ONE_PROCESS)
    lines += [OF_THE_OTHERS] * bool(lost := failures(rows))
    lines += [f"failed: {failed.message} ({'; '.join(failed.where)})" for failed in lost]
    sentence = stream_sentence(Study(**manifest["study"]), manifest["streams"])
    return ordered, [*lines, *([sentence] if sentence else [])]


def recording_lines(part: pd.DataFrame, weak: list[str]) -> list[str]:
    """Return what limits the order of one recording's table: `weak` reasons, single trials, ties."""
    lines, baseline = [*weak], part["baseline"].iloc[0]
    if part["trials"].max() < 2:
        lines.append("one trial: no intervals, so the order holds for this recording alone")
    others = part[part["change_low"].notna() & (part["estimator"] != baseline)]
    if len(others) and ((others["change_low"] <= 0) & (others["change_high"] >= 0)).all():
        lines.append(f"ranks no estimators: the interval of every comparison with {baseline} holds 0")
    return list(map(shorten_labels, lines))


def _by_scenario(table: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    return [(str(name), part) for name, part in table.groupby("scenario", sort=False)]


def show_table(
    table: pd.DataFrame,
    rows: pd.DataFrame,
    as_json: bool,
    every_column: bool = False,
    legend: bool = False,
    study: Mapping[str, Any] | None = None,
) -> None:
    """Print the table of `compare`, or JSON alone on stdout, and what a reader must know of it."""
    console, names = make_console(stderr=as_json, every=every_column), _names(table, study or {})
    if as_json:
        print(json.dumps(records(table), indent=1))
    else:
        shown = [_results(name, part, names, every_column) for name, part in _by_scenario(table)]
        for one in shown:
            best = lowest_that_qualifies(one.rows)
            console.print(one.terminal(partial(_bold, best)))
            console.print()
        captions = [BOLD] if every_column else _captions(table)
        more = (*_legend(shown), *[words("captions")["stopped"]] * ("look" in table)) if legend else ()
        for text in (*captions, *names.legend(table["estimator"].unique()), *more):
            console.print(text, style="dim")
        if every_column and (counted := events(rows)).rows:
            console.print(counted.terminal())
    for text in (*ranking.certificate_remarks(table), *table_warnings(table)):
        console.print(text)


def results_html(found: pd.DataFrame, rows: pd.DataFrame, folder: Path) -> str:
    """Return the results of a run as notebooks show them: the tables and sentences that the command line prints."""
    manifest = RunDir(folder).manifest
    table, lines = _arrange(found, rows, manifest, "rmse")
    text, parts, names = "", _by_scenario(table), _names(table, manifest["study"])
    for one in (_results(name, part, names, every_column=False) for name, part in parts[:IN_ONE_PICTURE]):
        best = lowest_that_qualifies(one.rows)
        strong = next((i for i, row in enumerate(one.rows) if row is best), None)
        text += one.notebook(strong)
    more = [f"{count_of(len(parts) - IN_ONE_PICTURE, 'scenario')} more: cl.report"] * (len(parts) > IN_ONE_PICTURE)
    below = (
        *_captions(table),
        *names.legend(table["estimator"].unique()),
        *more,
        *ranking.certificate_remarks(table),
        *table_warnings(table),
        *lines,
    )
    return f"{text}<p>{'<br>'.join(map(escape, below))}</p>"


def _captions(table: pd.DataFrame) -> list[str]:
    """Return what the cells of the essential columns mean."""
    intervals = INTERVALS * bool(table["rmse_low"].notna().any())
    return [intervals + BOLD, *[DECIDES] * bool(table["decisive_trial"].notna().any())]


def _names(table: pd.DataFrame, study: Mapping[str, Any]) -> Labels:
    """Return the estimators' names, with those that a study gives to parameters: "ekf-ci [any]"."""
    return short_labels(table["estimator"], variants_of(study), longest=sys.maxsize)


def _bold(chosen: dict[str, Any] | None, row: dict[str, Any]) -> str:
    return "bold" if row is chosen else ""


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows with the fields of `table.csv`, undefined values as None."""
    values = table.astype(object)
    known = values.notna() & ~values.isin([np.inf, -np.inf])
    return values.where(known, None).to_dict("records")  # type: ignore[return-value]


def _results(scenario: str, part: pd.DataFrame, names: Labels, every_column: bool) -> Table:
    """Return the table of one scenario."""
    first, rows = part.iloc[0], part.to_dict("records")
    size = f"{count_of(first['robots'], 'robot')}, {count_of(part['trials'].max(), 'trial')}"
    choose = result_columns if every_column else essential_columns
    chosen = choose(part["baseline"].map(names.shorten), "look" in part)
    columns = [replace(c, form=names.shorten) if c.keys == ("estimator",) else c for c in chosen if not c.report_only]
    columns = [c for c in columns if not c.rare or (part[c.keys[0]].fillna(0) != 0).any()]
    return Table("results", f"{scenario}: {size}, stream {first['stream'][:12]}", tuple(columns), rows)


def _legend(tables: list[Table]) -> list[str]:
    """Return what the columns and the remarks that are shown mean."""
    texts = {c: {c.text(row) for row in one.rows} - {""} for one in tables for c in one.columns}
    meaning = words("columns")
    shown = {c.keys[0]: c.head for c, found in texts.items() if found}
    heads = {("vs" if key == "change" else head): meaning[key] for key, head in shown.items() if key in meaning}
    remarks = " ".join(text for c, found in texts.items() if c.head in ("remark", "consistency") for text in found)
    heads |= {word: about for word, about in words("remarks").items() if word in remarks}
    return [f"{word}: {about}" for word, about in heads.items()]


def decision_line(rows: pd.DataFrame, decisions: Mapping[str, Any]) -> str:
    """Say how many comparisons and claims are decided, how many are open, and how long they may take."""
    said, still = [], 0
    for of in ("comparison", "claim"):
        ones = decisions[of]
        undecided = sum(one["verdict"] in ("open", "undecided") for one in ones)
        said += [f"{len(ones) - undecided} of {count_of(len(ones), of)}"] if ones else []
        still += undecided
    line = f"decided after {decisions['look']} trials: {', '.join(said)}; {still} open"
    going = [(scenario, estimator) for scenario, estimator in decisions["going"]]
    if not going:
        return f"{line}; the run has ended"
    left = seconds_left(rows, going, decisions["most"])
    return f"{line}; to {decisions['most']} trials, at most about {duration(left)} of one process"


CONTENT_COLUMNS = (
    text_column("experiment"),
    text_column("scenario"),
    text_column("estimator"),
    text_column("checks", form=short_certificate),
    number_column("trials"),
    number_column("failed", form=lambda failed: str(failed or "")),
    text_column("decided", of=("verdict", "look", "trials_there"), form=decision),
    text_column("", "remark"),
)


SHOWN = (
    "cl.show prints a run directory, results of cl.run_study, cl.verdicts(...), cl.compare(..., full=True), and names"
)


def show(what: str | PathLike[str] | pd.DataFrame, ledger: str | Path | None = None) -> None:
    """Print what a run, by its directory or its `Results`, holds, what is missing, and what failed and why.

    A table of `cl.verdicts`, with the `ledger` that it was judged by, or of `cl.compare` with full=True is printed as
    the command line prints it. Of the name of an estimator or a scenario its parameters are printed, with what they
    mean, of that of a study its file.

    Raises:
        BadInput: it is neither a run nor one of these tables or names.

    """
    if isinstance(what, pd.DataFrame):
        if {"claim", "verdict", "map"} <= set(what):
            show_verdicts(what, ledgers.load(ledger))
        elif {"baseline", "robots", "stream"} <= set(what):
            show_table(sort_rows(what), what, as_json=False)
        else:
            raise BadInput(f"this is another table: {SHOWN}")
        return
    if not isinstance(what, str | PathLike):
        raise BadInput(f"this is of type {type(what).__name__}: {SHOWN}")
    if isinstance(what, str) and not Path(what).exists() and show_name(what):
        return
    held, console = read_run(what, empty=True), make_console()
    manifest, decisions, certificates = held.manifest, held.decisions, held.manifest["certificates"]
    verdicts = {(one["scenario"], one["estimator"]): one for one in (decisions or {"comparison": []})["comparison"]}
    ended = held.rows.drop_duplicates(["scenario", "estimator", "trial"])
    failed = ended[ended["failure"].notna()]
    counts = [table.groupby(["scenario", "estimator"]).size().to_dict() for table in (ended, failed)]
    rows = []
    for scenario, cell in manifest["cells"].items():
        for estimator, asked in cell["estimators"].items():
            key = (scenario, estimator)
            there, lost = (count.get(key, 0) for count in counts)
            corrupt = sum(part[:2] == key for part in held.damaged)
            remarks = [f"{count_of(corrupt, 'corrupt part')}, will be computed again"] * (corrupt > 0)
            remarks += ["not finished"] * (there < asked)
            row = {"experiment": cell["experiment"], "scenario": scenario, "estimator": estimator}
            row |= {"trials": f"{there} of {asked}", "trials_there": there, "failed": lost}
            row |= {"remark": ", ".join(remarks), "checks": line(estimator, certificates)}
            rows.append({**verdicts.get(key, {"verdict": "", "look": 0}), **row})
    hidden = ["decided"] * (not decisions) + ["experiment"] * (len({row["experiment"] for row in rows}) == 1)
    shown = tuple(column for column in CONTENT_COLUMNS if column.head not in hidden)
    study, versions = manifest["study"], manifest["versions"]
    trials = count_of(study["trials"], "trial")
    console.print(f"{held.folder}: study {study['name']}, seed {manifest['seed']}, {trials}")
    console.print(": ".join(filter(None, (study.get("title"), study["about"]))))
    commit = f", commit {manifest['commit'][:12]}" if manifest["commit"] else ""
    console.print(f"cooploc {versions['cooploc']}{commit}, Python {versions['python']}, on {manifest['cpu']}\n")
    console.print(Table("contents", "", shown, rows).terminal())
    if decisions:
        console.print(decision_line(held.rows, decisions))
    console.print()
    for label, certificate in certificates.items():
        console.print(f"{shorten_labels(label)}, {certificate['status']}: {certificate['found']}")
        for one in [one for one in certificate["checks"] if one["status"] == "failed"][1:]:
            console.print(f"  {one['check']}: {one['detail']}", style="dim")
    if not manifest.get("isolated", True):
        console.print(ONE_PROCESS)
    for one in failures(failed):
        console.print(f"\nfailed: {one.message} ({'; '.join(one.where)})")
        if one.traceback.strip() != one.message:
            console.print(one.traceback.strip("\n"), style="dim", soft_wrap=True)
    if failed.empty:
        console.print("\nnothing failed")
    unfinished = any("not finished" in row["remark"] for row in rows)
    console.print(
        "next: the same cooploc run goes on" if unfinished else f"next: cooploc report {in_shell(held.folder)}"
    )


VERDICT_LEGEND = (
    "Changes are b/a - 1: negative where the error falls. A verdict, taken alone, is wrong in at most one of twenty "
    "repetitions of the run; of many some are. stands: still decided after Holm's correction over all judged cases. "
    "Each verdict is of one reading of the paper; cl.readings judges a claim in all that were run (the study "
    "readings runs them)."
)
READING_LEGEND = (
    "A specification is a case (scenario, estimators) in a reading of the paper; what runs the same counts once. "
    "letter: the reading nearest to the words of the paper; code: what public code of its authors does. implausible: "
    "the method compared with is worse than dead reckoning."
)
FEW = 5  # claims that were not run, of which each says why
STYLES = {"supported": "green", "direction only": "yellow", "flat": "magenta", "contradicted": "red"}
STYLES |= {"undecided": "cyan"}


def show_verdicts(
    verdicts: pd.DataFrame, ledger: ledgers.Ledger, every_column: bool = False, legend: bool = False
) -> None:
    """Print a table for every claim, then the readings, and how many verdicts may be false."""
    console, skipped = make_console(every=every_column), dict[str, str]()
    console.print(ledger.paper)
    for claim, part in verdicts.groupby("claim", sort=False):
        if (part["verdict"] == "not run").all():
            skipped[str(claim)] = claim_tables.cases_not_run(part)
            continue
        says, where, left_open, readings = part[["says", "where", "open", "map"]].iloc[0]
        console.print(f"\n{claim}. {claim_tables.name_claim(says, where)}", style="bold")
        console.print(claim_tables.cases(part).terminal(style=lambda row: STYLES.get(row["verdict"], "dim")))
        for text in filter(None, (claim_tables.cases_not_run(part), left_open and f"open: {left_open}")):
            console.print(f" {text}", style="dim")
        if readings:
            console.print(f" over all readings: {readings}")
    console.print()
    if len(skipped) > FEW:
        console.print(f"Not run at all, as this run lacks their scenarios or estimators: claims {join_words(skipped)}")
    for claim, why in skipped.items() if len(skipped) <= FEW else ():
        console.print(f"claim {claim}, {why}")
    ran = set(verdicts.loc[verdicts["verdict"] != "not run", "variant"])
    abouts = [f"{name}: {variant.about}" for name, variant in ledger.variants.items() if name in ran]
    for text in (*abouts, VERDICT_LEGEND) if legend else ():
        console.print(text, style="dim")
    console.print(str(count_verdicts(verdicts)))


def show_interpretations(found: pd.DataFrame, every_column: bool = False, legend: bool = False) -> None:
    """Print in how many readings of the paper each claim holds, where a run holds more than one."""
    if found["preset"].all():
        return
    console, counts = make_console(every=every_column), shares(found)
    console.print("\nThe claims over all readings of the paper that were run", style="bold")
    console.print(claim_tables.over_readings(counts).terminal())
    for row in counts.to_dict("records"):
        console.print(f" {row['claim']}. {row['says']}: {row['sentence']}.")
    if legend:
        console.print(READING_LEGEND, style="dim")


def show_paper(example: Path) -> None:
    """Say where a paper's figures and tables are, and how to look at them."""
    folder, latex, make = example.parent, example.read_text("utf-8"), f"pdflatex {example.stem}"
    counts = {"figure": latex.count(r"\includegraphics"), "table": latex.count(r"\input{tables/")}
    make_console().print(
        f"paper: {folder}\n"
        f"in it: {', '.join(count_of(number, noun) for noun, number in counts.items())}, estimators.bib\n"
        f"to see them all: cd {in_shell(folder)} && {make} && bibtex {example.stem} && {make} && {make}\n"
        "next: copy figures/ and tables/ beside your paper; --figures, --only and --scenarios choose, --all writes all"
    )


def show_changes(title: str, settings: list[str], found: pd.DataFrame, said: list[str], everything: bool) -> None:
    """Print what changed between two runs; rows and columns that did not only where `everything` is asked for."""
    from cooploc.analysis.report import run_diff

    console = make_console(every=everything)
    for text in (title, *settings, ""):
        console.print(text)
    shown = found if everything else found[found["verdict"] != run_diff.SAME]
    if len(shown):
        console.print(run_diff.table(shown).terminal())
    for text in said:
        console.print(text)


def show_reproduced(found: pd.DataFrame, differences: list[str]) -> None:
    """Print which trials of a report came out bit-equal."""
    console = make_console()
    shown = found.drop(columns="equal").rename(columns={"before": "RMSE then [m]", "after": "now [m]"})
    console.print(frame("Trials that were run again", shown, digits=9).terminal())
    equal = found["equal"].sum()
    console.print(f"{equal} of {len(found)} results are bit-equal")
    if equal < len(found) and differences:
        console.print(f"this machine differs from that of the report: {'; '.join(differences)}")


def show_plan(found: pd.DataFrame, difference: float, jobs: int) -> None:
    """Print the trials of each comparison, and the time of all."""
    console = make_console()
    forms = {"change": change, "trials": count, "until_decided": count}
    texts = {name: found[name].map(form) for name, form in forms.items()}
    console.print(frame("", found.assign(**texts).filter(["scenario", "estimator", "baseline", *forms])).terminal())
    console.print(
        f"Trials that show a change of RMSE of {100 * difference:g} % in four of five runs (80 % power): with one look "
        "at the end, and with --until-decided, where a change twice as large needs a quarter. From a pilot of "
        f"{PILOT} trials, which knows them to about a factor of two."
    )
    fixed, until = (duration(60 * minutes(found, column, jobs)) for column in ("trials", "until_decided"))
    processes = f" on {jobs} processes" if jobs > 1 else ""
    console.print(f"here{processes}, estimators take about {fixed} with one look, and {until} until decided, at most")


def show_tuning(
    history: pd.DataFrame, gains: pd.DataFrame, orders: Mapping[str, pd.DataFrame], record: dict[str, Any]
) -> None:
    """Print what was chosen, what it bought, and whether the order changed."""
    console = make_console()
    console.print(result_tables.chosen_table(history, record["tuned"]).terminal())
    console.print()
    for scenario, part in gains.groupby("scenario", sort=False):
        console.print(result_tables.gains_table(str(scenario), part).terminal())
        console.print()
    console.print(words("captions")["tuning"], style="dim")
    for name, order in orders.items():
        console.print(result_tables.order_sentence(order, name))
    console.print(
        f"seed {record['seed']}, training seed {record['training_seed']}: "
        f"none of the {len(record['streams'])} training streams is a reported one"
    )


def show_checks(report: Report, scenario: str = "", data: Path | None = None) -> None:
    """Print the results, how many of the checks passed, failed and were skipped, and what to do next."""
    console, other = make_console(), "dead-reckoning" if scenario else "mrsl-rssi"
    go_on = f"cooploc run {in_shell(scenario or 'quick')} --estimators {in_shell(f'{other},{report.name}')}"
    go_on += f" --data {in_shell(data)}" if data else ""
    made = [r for r in report.results if r.detail not in FIRST.values()]  # the rest means nothing after a failure
    found = [{"check": r.check, "result": r.status, "what was found": str(r)} for r in made]
    console.print(frame("checks", pd.DataFrame(found)).terminal())
    console.print(report.summary())
    console.print(f"next: {go_on if report.passed else 'correct what failed, and check again'}")


MOST = 40  # rows of a table; `cl.inspect` has all


def show_inspection(found: Any, files: Sequence[Path]) -> None:
    """Print the tables of an inspection, its findings, and the files that were written."""
    say, inspected, log = make_console().print, found.inspected, files[-1].parent / "log.toml"
    say(f"{inspected.path}: {inspected.format} ({inspected.why}), runs: {', '.join(inspected.runs)}\n")
    units = {"rate": "rate [Hz]", "first": "from [s]", "last": "to [s]", "longest": "longest [s]"}
    series = found.series.drop(columns="source").rename(columns=units)
    for name, table in (("series", series), ("columns", found.columns)):
        if len(table):
            say(frame(name, table.head(MOST)).terminal())
            say(f"  and {len(table) - MOST} more\n" if len(table) > MOST else "")
    for text in inspected.unused:
        say(f"not used: {text}")
    for (setting, nothing), together in groupby(inspected.findings, lambda f: (f.change, f.nothing)):
        for f in together:
            say(f"found ({f.sure}): {f.kind}{' ' * bool(f.robot)}{f.robot}: {f.fact}")
        say(f"  nothing to change in log.toml: {nothing}" if nothing else f"  to change in log.toml: {setting}")
    if not inspected.findings:
        say("nothing odd was found")
    kept = "" if log in files else "; the log.toml that is there was left as it is"
    say(f"written: {', '.join(map(str, files))}{kept}")
    for text in inspected.trial.lines:
        say(f"tried: {text}")
    if inspected.trial.problem:
        say(f"tried, and it does not run: {inspected.trial.problem}")
        if any(truth is not None for truth in inspected.log.truth):
            say(f"next: correct {log}, then cooploc inspect {in_shell(log.parent)}")
        else:
            anew = f"cooploc inspect --force {in_shell(log.parent)} drafts log.toml anew"
            say(f"next: look at the page; to judge estimators, add the true positions: {anew}")
    else:
        say(f"next: look at both, then cooploc run log --data {in_shell(log.parent)}")
