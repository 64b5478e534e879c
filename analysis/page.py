"""A run's report: one HTML page that needs no network, and its tables as LaTeX, Markdown and CSV."""

import base64
import hashlib
import re
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from cooploc.analysis import answers, claims, figures, tabled, tables
from cooploc.analysis.compare import compare, notes
from cooploc.analysis.curves import sweep
from cooploc.analysis.kept import Kept
from cooploc.analysis.ledger import BASE, Ledger
from cooploc.analysis.reproduce import PAGE, sample
from cooploc.analysis.results import Results, collect
from cooploc.analysis.statistics import LEAST_TRIALS
from cooploc.analysis.tables import Column, Table, text

SWEEP = 3  # values from which a sweep becomes a line
SCATTERED = 3  # scenarios of an experiment whose accuracy is drawn against consistency and cost
METHODS = (
    ("Trial", "The unit of every interval and test; its robots and ticks are not independent, and pooled first."),
    ("RMSE", "Root of the mean over trials of the mean squared position error [m]; jackknife interval on its log."),
    ("Change", "RMSE relative to the baseline's on the same streams, paired by trial; Fieller's 95 % interval."),
    ("p (Holm)", "Wilcoxon's signed-rank test over trials, adjusted by Holm over all rows of all experiments."),
    ("Ties", "The 95 % interval of the paired change holds 0, or two one-sided t tests on the logarithms say that both "
     "are equal within 5 %. One is best alone only where it is told apart from every other that may be called best."),
    ("ANEES", "Position NEES / 2, per trial first; 1 is consistent. Over-confident: its 95 % interval lies above 1.5, "
     "or that of the share in 95 % ellipses below 0.86; conservative: below 0.67. Not assessed: too wide to tell. "
     "An over-confident estimator is never called best."),
    ("in 95 %", "Share of the true positions that lie inside the 95 % ellipse."),
    ("diverged", "Share of (trial, robot) whose last-quarter RMSE exceeds a quarter of the arena's side."),
    ("messages, bytes, µs", "Per robot and tick, as sent; µs as a clock measured them, on the processor named below."),
    ("Bound", "It knows more than any robot could; it is shown, and not ranked."),
    ("Below five trials", "Nothing is claimed: there is no interval, no test and no verdict."),
    ("Claims", "Each comes down to one number with its 95 % interval, and a verdict holds only where the whole "
     "interval does; cooploc verdicts prints them."),
)  # fmt: skip
LEGEND = (
    "Reduction is 1 - b/a, ratio a/b - 1. A verdict is wrong in at most one of twenty repetitions of the run; over all "
    "rows some are to be expected. Readings: paper, as it stands; others as the ledger describes them."
)


class Shown(NamedTuple):
    """A figure: panels, and what they show."""

    panels: list[Markup]
    caption: str
    width: str = ""  # of a panel: "", "middle" or "wide"


class Numbers(NamedTuple):
    """What everything is made of."""

    kept: Kept
    table: pd.DataFrame  # of `compare`
    standings: dict[str, answers.Standing]  # by scenario
    results: Results
    looks: dict[str, figures.Style]


def write(kept: Kept, ledger: Ledger, out: Path) -> Path:
    """Write the page and its tables into a directory; returns the page's path.

    Raises:
        BadInput: estimators of one scenario ran on different streams.
        OSError: a file cannot be written.

    """
    context = content(kept, ledger)
    (out / "tables").mkdir(parents=True, exist_ok=True)
    shown: list[Table] = context.pop("tables")
    for one in shown:
        for ending, written in (("tex", one.latex()), ("md", one.markdown()), ("csv", one.csv())):
            (out / "tables" / f"{one.name}.{ending}").write_text(written, encoding="utf-8")
    names = [one.name for one in shown]
    (out / "tables" / "all.tex").write_text(tables.document(names, context["title"]), encoding="utf-8")
    page = out / PAGE
    page.write_text(render(context), encoding="utf-8")
    return page


def render(context: dict[str, Any]) -> str:
    """The page; whatever is not marked as safe is escaped."""
    template = Environment(
        loader=FunctionLoader(_template), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    script, style = (Markup(_template(name)) for name in ("page.js.j2", "page.css.j2"))  # our own files
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return template.get_template("page.html.j2").render(**context, script=script, style=style, script_hash=digest)


def content(kept: Kept, ledger: Ledger) -> dict[str, Any]:
    """Everything that the page shows, and `tables`, all of its tables."""
    results = collect(kept.rows)
    table = compare(kept.rows, kept.baselines)
    found = answers.standings(table, results)
    looks = figures.styles(list(dict.fromkeys(kept.rows["estimator"])))
    numbers = Numbers(kept, table, {one.scenario: one for one in found}, results, looks)
    answer = _answer(numbers, claims.judge(ledger, kept.rows), ledger)
    counter = iter(range(1_000_000))
    experiments = [_experiment(name, labels, numbers, counter) for name, labels in kept.experiments.items()]
    versions, streams = _versions(kept), _streams(table)
    first = [answer[name] for name in ("best_table", "confidence_table", "overview", "claims_table")]
    return {
        "title": f"cooploc: {kept.manifest['study']['name']}",
        "manifest": kept.manifest,
        "answer": answer,
        "experiments": experiments,
        "gaps": [f"{s}, {e}: {n} of the trials that were asked for are not there" for (s, e), n in kept.gaps.items()],
        "failures": _failures(kept.rows),
        "notes": notes(kept.rows),
        "methods": METHODS,
        "versions": versions,
        "streams": streams,
        "embedded": {"manifest": kept.manifest, "sample": sample(kept)},
        "tables": [*first, *(one for each in experiments for one in each["tables"]), versions, streams],
    }


def _answer(numbers: Numbers, verdicts: pd.DataFrame, ledger: Ledger) -> dict[str, Any]:
    found = list(numbers.standings.values())
    return {
        "best": answers.overall(found),
        "best_table": tabled.best(found),
        "confidence": answers.confidence(numbers.table),
        "confidence_table": tabled.confidence(numbers.table),
        "claims": _standing_claims(verdicts),
        "claims_open": bool((verdicts["verdict"] != "not run").mean() > 0.5),
        "claims_table": tabled.claims(verdicts, ledger.paper),
        "overview": tabled.overview(claims.overview(verdicts)),
        "legend": LEGEND,
    }


def _standing_claims(verdicts: pd.DataFrame) -> str:
    """The claims as they stand, by verdict; one whose cases differ is named with their counts."""
    base = verdicts[verdicts["variant"] == BASE]
    alike: dict[str, list[str]] = {}
    mixed = []
    for claim, part in base.groupby("claim", sort=False):
        told = part["verdict"].value_counts(sort=False)
        if len(told) == 1:
            alike.setdefault(str(told.index[0]), []).append(str(claim))
        else:
            mixed.append(f"{claim} ({', '.join(f'{count} {verdict}' for verdict, count in told.items())})")
    parts = [f"{verdict}: {', '.join(alike[verdict])}" for verdict in claims.VERDICTS if verdict in alike]
    parts += [f"differs by case: {', '.join(mixed)}"] if mixed else []
    count = base["claim"].nunique()
    return f"Of {count} claim{'' if count == 1 else 's'}, as the paper states them, {'; '.join(parts)}."


def _experiment(name: str, labels: list[str], numbers: Numbers, counter: Any) -> dict[str, Any]:
    part = numbers.table[numbers.table["scenario"].isin(labels)]
    found = [numbers.standings[label] for label in labels]
    anchor = f"experiment-{_anchor(name)}"
    sweeps: list[str] = []
    shown: list[Shown] = []
    changed: list[Table] = []
    for (_, parameter), group in _groups(labels).items():
        rows = part[part["scenario"].isin(group)]
        if parameter:
            changes = answers.changes(group, dict.fromkeys(rows["estimator"]), numbers.results)
            sweeps.append(answers.swept(group, changes))
            changed.append(tabled.sweep(f"{anchor}-sweep{len(changed) + 1}", changes, parameter))
            shown.append(_lines(rows, numbers, counter))
        else:
            shown.append(_dots(rows, numbers, counter))
    shown.append(_scatter(part, numbers, counter))
    return {
        "name": name,
        "anchor": anchor,
        "sentence": answers.overall(found) + " " + answers.confidence(part),
        "sweeps": [line for line in sweeps if line],
        "standings": [(one.scenario, answers.sentence(one)) for one in found],
        "figures": shown,
        "tables": [tabled.results(anchor, part, f"{name}: {_about(part, numbers)}"), *changed],
    }


def _groups(labels: list[str]) -> dict[tuple[str, str], list[str]]:
    """The scenarios by family and what they sweep; those of short sweeps together with those that sweep nothing."""
    found: dict[tuple[str, str], list[str]] = {}
    for label in labels:
        found.setdefault(sweep(label)[:2], []).append(label)
    out: dict[tuple[str, str], list[str]] = {}
    for label in labels:
        which = sweep(label)[:2]
        out.setdefault(which if which[1] and len(found[which]) >= SWEEP else ("", ""), []).append(label)
    return out


def _lines(rows: pd.DataFrame, numbers: Numbers, counter: Any) -> Shown:
    svgs = figures.lines(rows, numbers.looks)
    parameter = sweep(rows["scenario"].iloc[0])[1]
    one = "each panel one estimator, all others in grey" if len(svgs) > 1 else "with intervals"
    return Shown(
        _panels(svgs, f"position RMSE over {parameter}", counter),
        f"Position RMSE over {parameter}, {one}; bands are 95 % intervals over trials. Hollow markers: over-confident; "
        f"a broken line: over-confident at most of the values; grey and dotted: a bound. {_about(rows, numbers)}",
        width="wide" if len(svgs) == 1 else "",
    )


def _dots(rows: pd.DataFrame, numbers: Numbers, counter: Any) -> Shown:
    svgs = [
        figures.dots(part, numbers.looks)
        for _, part in rows.groupby("scenario", sort=False)
        if part["rmse"].notna().any()
    ]
    about = "Position RMSE, smallest on top, with 95 % intervals over trials. Hollow: over-confident; grey: a bound."
    return Shown(_panels(svgs, "position RMSE of every estimator", counter), f"{about} {_about(rows, numbers)}", "wide")


def _scatter(rows: pd.DataFrame, numbers: Numbers, counter: Any) -> Shown:
    """Accuracy against consistency and cost, in the first, the middle and the last scenario."""
    ended = rows[rows["rmse"].notna()]
    labels = list(dict.fromkeys(ended["scenario"]))
    chosen = labels if len(labels) <= SCATTERED else [labels[0], labels[len(labels) // 2], labels[-1]]
    svgs = []
    for label in chosen:
        part = ended[ended["scenario"] == label]
        svgs += [figures.against(part, other, numbers.looks) for other in ("anees", "bytes", "seconds")]
    some = f" Shown are {len(chosen)} of {len(labels)} scenarios, the first, the middle and the last." * (
        len(chosen) < len(labels)
    )
    svgs += [figures.key(ended[ended["scenario"].isin(chosen)], numbers.looks)] if chosen else []
    shown = numbers.table[numbers.table["scenario"].isin(chosen)]
    return Shown(
        _panels(svgs, "position RMSE against ANEES, bytes and seconds", counter),
        "Accuracy against consistency (grey band: neither over-confident nor conservative), bytes and time, with 95 % "
        "intervals over trials. Broken line: the Pareto front, for which nothing else is no worse in both; bounds are "
        f"not on it, over-confident estimators (hollow) may be.{some} {_about(shown, numbers)}",
        width="middle",
    )


def _panels(svgs: list[str], label: str, counter: Any) -> list[Markup]:
    return [Markup(figures.inline(svg, next(counter), label)) for svg in svgs]  # matplotlib has escaped every text


def _about(part: pd.DataFrame, numbers: Numbers) -> str:
    """Trials, seed, test, correction and streams, for a caption."""
    counts = sorted(set(part["trials"]))
    trials = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}" if counts else "0"
    hashes = list(dict.fromkeys(part["stream"]))
    streams = ", ".join(one[:12] for one in hashes[:4]) + (
        f" and {len(hashes) - 4} more, listed below" if len(hashes) > 4 else ""
    )
    few = f" Below {LEAST_TRIALS} trials there are no intervals." if counts and counts[0] < LEAST_TRIALS else ""
    tested = int(numbers.table["p"].notna().sum())
    return (
        f"n = {trials} trials a scenario, seed {numbers.kept.manifest['seed']}; Wilcoxon's signed-rank test against "
        f"the baseline, Holm over the {tested} comparisons of this report; streams {streams}.{few}"
    )


def _failures(rows: pd.DataFrame) -> list[tuple[str, str]]:
    failed = rows[rows["failure"].notna()].drop_duplicates(["scenario", "estimator", "trial"])
    out = []
    for (scenario, estimator, failure), part in failed.groupby(["scenario", "estimator", "failure"], sort=False):
        trials = ", ".join(str(trial) for trial in part["trial"][:10]) + (" ..." if len(part) > 10 else "")
        out.append((f"{scenario}, {estimator}, trial {trials}: {failure}", str(part["traceback"].iloc[0])))
    return out


def _versions(kept: Kept) -> Table:
    manifest = kept.manifest
    told = {
        **manifest["versions"],
        "commit": manifest["commit"] or "",
        "source": manifest["source"],
        "cpu": manifest["cpu"],
    }
    told |= {"seed": manifest["seed"], "recordings": manifest["data"] or ""}
    columns = (Column("what", ("what",), False), Column("version or hash", ("version",), False))
    return Table("versions", "What the bits depend on", columns, tuple((text(k), text(v)) for k, v in told.items()))


def _streams(table: pd.DataFrame) -> Table:
    columns = (
        Column("scenario", ("scenario",), False),
        Column("trials", ("trials",)),
        Column("stream", ("stream",), False),
    )
    once = table.sort_values("trials", ascending=False, kind="stable").drop_duplicates("scenario").sort_index()
    rows = tuple((text(row["scenario"]), text(row["trials"]), text(row["stream"])) for row in once.to_dict("records"))
    return Table("streams", "Hashes of the streams: equal ones can be paired", columns, rows)


def _anchor(name: str) -> str:
    """A name for links and files."""
    plain = re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")[:60]
    return plain if plain == name else f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:6]}"


def _template(name: str) -> str:
    return (files(__package__) / name).read_text(encoding="utf-8")
